"""Export of a run to the formats of other programs.

Each format of the table is a function of a `RunRecord` (run_record.py) that writes files into its directory and returns their
paths. Formats know layouts and frames only, and are imported when they are asked for, so that a run needs none of their
libraries.
"""

from importlib import import_module
from pathlib import Path

from warpknit.base.errors import ExportError
from warpknit.base.text import either
from warpknit.export.run_record import RunRecord, read_run

__all__ = ["FORMATS", "RunRecord", "export_record", "export_run"]

FORMATS = {  # what `--to` takes: the module here, and its function
    "usd": "usd.writer.export_usd",  # scene.usda and its layers
    "vtk": "vtk.export_vtk",  # vtk/wires.pvd, vtk/contacts.pvd
    "csv": "tables.export_tables",  # tables/*.csv
    "png": "figures.export_figures",  # figures/mesh*.png, figures/curves.png
}


def export_run(run_dir: Path, to: str) -> list[Path]:
    """Export a finished or interrupted run into its directory; the paths. Raises `ExportError`, `RunDirectoryError`."""
    if to not in FORMATS:
        raise ExportError(f"--to: {to!r} is unknown; give {either(list(FORMATS))}")
    return export_record(read_run(run_dir), to)


def export_record(record: RunRecord, to: str) -> list[Path]:
    """Export a run into its directory; the paths."""
    module, function = FORMATS[to].rsplit(".", 1)
    try:
        paths: list[Path] = getattr(import_module(f"{__name__}.{module}"), function)(record)
    except ModuleNotFoundError as error:
        raise ExportError(f"--to: {to!r} requires the package {error.name}; install it") from error
    return paths
