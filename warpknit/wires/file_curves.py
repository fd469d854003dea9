"""The curves in a file of wires, whatever its format."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from warpknit.base.text import exact
from warpknit.scene.wire_file import USD, WireFileError, checked_bytes
from warpknit.wires.bcc import read_bcc
from warpknit.wires.csv_file import read_table
from warpknit.wires.curve import BadFile, CurveFile
from warpknit.wires.npz import read_npz
from warpknit.wires.pyp import read_pyp
from warpknit.wires.usd import read_usd


def curves_in(path: Path, interpolation: str, closed: bool, unit: float | None, time: float | None) -> tuple[CurveFile, float]:
    """What stands in a file, and the metres in its unit. Raises `WireFileError`."""
    checked_bytes(path)
    suffix = path.suffix.lower()
    try:
        found = _reader(path, suffix, interpolation, closed, time)
        if not found.curves:
            raise BadFile("a file without wires")
        return found, _metres(found, suffix, unit)
    except BadFile as error:
        raise WireFileError(f"cannot be read ({error})", f"give {expected_in(suffix)}") from error
    except OSError as error:
        raise WireFileError(f"cannot be read ({(error.strerror or 'it is unreadable').lower()})", "give another file") from error


def stated_radius(path: Path, *, time: float | None = None) -> tuple[np.ndarray | None, str]:
    """(wire,) [m] radius of the wires in a file of WITH_WIDTHS, and why widths in it are none. Raises `WireFileError`."""
    found, metres = curves_in(path, "spline", False, None, time)
    return None if found.radius is None else found.radius * metres, found.no_radius


def _reader(path: Path, suffix: str, interpolation: str, closed: bool, time: float | None) -> CurveFile:
    if suffix in USD:
        return read_usd(path, interpolation, time=time)
    if suffix == ".bcc":
        return read_bcc(path, interpolation)
    if suffix == ".pyp":
        return read_pyp(path, interpolation)
    return (read_table if suffix == ".csv" else read_npz)(path, interpolation, closed=closed)


def expected_in(suffix: str) -> str:
    """What a file with this suffix is, in words."""
    names = dict.fromkeys(USD, "a USD stage with BasisCurves") | {
        ".bcc": "a BCC file of curves",
        ".pyp": "a periodic yarn pattern",
        ".csv": "a table with columns x, y, z, and wire where there are several",
        ".npz": "arrays of points",
    }
    return names[suffix]


def _metres(found: CurveFile, suffix: str, unit: float | None) -> float:
    """[m] of a unit of the file."""
    if found.metres is not None and unit is not None:
        wrong = f"{exact(unit, 'm')} is not allowed: the file has its own unit, {exact(found.metres, 'm')}"
        raise WireFileError(wrong, "leave it out", "unit")
    if found.metres is None and unit is None and suffix != ".pyp":
        raise WireFileError("missing: the file has no unit", "write one, such as 'mm'", "unit")
    metres = unit if found.metres is None else found.metres
    return 1.0 if metres is None else metres
