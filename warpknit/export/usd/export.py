"""A run as a USD stage, every record in full."""

from pathlib import Path

from warpknit.export.run_record import RunRecord, item
from warpknit.export.usd.writer import StageWriter
from warpknit.results.frame import drawn_frame, drawn_layout

__all__ = ["export_usd"]


def export_usd(record: RunRecord) -> list[Path]:
    """Write scene.usda and its layers; the paths, the stage first."""
    writer = StageWriter(
        record.directory,
        drawn_layout(record.layout),
        scene_name=record.summary["scene"]["name"],
        scene_hash=str(item(record.summary, ("scene", "hash")) or ""),
        version=str(record.summary.get("version", "")),
        colour_stress_max=record.quantity("wire", "yield_stress_Pa"),
        streaming=True,
    )
    frames = [writer.add_frame(drawn_frame(record.layout, frame)) for frame in record.frames()]
    writer.close(complete=record.summary.get("stop_reason") in ("steady", "finished"))
    return [writer.path, *frames]
