"""What a scene of the spatial model (`model.kind = "spatial"`) may ask for."""

from __future__ import annotations

from warpknit.scene.file import SceneFile
from warpknit.scene.source import Source

WITH = "with model.kind = 'spatial'"


def refuse_unsupported(source: Source, file: SceneFile) -> None:
    """Raise SceneError where the scene asks the spatial model for what only the planar one does."""
    if file.model.kind != "spatial":
        return
    for location, given, supported, allowed in (
        (("hook",), "a hook", file.hook is None, f"[knit] {WITH}"),
        (("model", "boundary"), file.model.boundary, file.model.boundary == "periodic", f"'periodic' {WITH}"),
        (("solver", "drive"), file.solver.drive, file.solver.drive == "relax", f"'relax' {WITH}"),
        (("solver", "precision"), file.solver.precision, file.solver.precision != "single", f"'double' {WITH}"),
        (("solver", "multipliers"), file.solver.multipliers, file.solver.multipliers, f"true {WITH}"),
        (("wire", "plastic"), file.wire.plastic, not file.wire.plastic, f"false {WITH}"),
    ):
        if not supported:
            raise source.refusal(location, given, allowed)
    for place, stage in ((("load",), file.load), *((("path", k), stage) for k, stage in enumerate(file.path))):
        for direction in ("weft", "warp"):
            tension = getattr(stage, f"tension_{direction}")
            if tension is not None:
                raise source.refusal((*place, f"tension_{direction}"), tension, f"strain_{direction} {WITH}")
