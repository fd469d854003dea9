"""Polylines from an NPZ file of NumPy: either `points` (point, 3) with `counts` (wire,), or an array (point, 3) for each wire.

`closed` (wire,) may stand beside `points` and `counts`. Sizes are read and checked before any array is.
"""

from __future__ import annotations

import math
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from warpknit.wires.bases import polyline
from warpknit.wires.curve import MOST_POINTS, BadFile, CurveFile, check_count, check_points

MOST_NUMBERS = 5 * MOST_POINTS  # three of a point, and what says where wires begin and close

# What zipfile, zlib and numpy.lib.format raise on bytes that are no archive of arrays.
FAULTS = (
    zipfile.BadZipFile, zlib.error, ValueError, EOFError, KeyError, NotImplementedError, RuntimeError, OverflowError,
    SyntaxError, TypeError, IndexError,
)  # fmt: skip


def read_npz(path: Path, interpolation: str, *, closed: bool = False) -> CurveFile:
    """The wires of an NPZ file; interpolation: a key of `bases.polyline`. Raises `BadFile`, OSError."""
    try:
        with zipfile.ZipFile(path) as archive:
            arrays = _arrays(archive)
    except FAULTS as error:
        raise BadFile(f"a file that is no archive of arrays ({type(error).__name__}: {str(error)[:60]})") from error
    wires, rings = _wires(arrays)
    unread = sorted(arrays.keys() - {"points", "counts", "closed"}) if {"points", "counts"} <= arrays.keys() else []
    notes = (f"arrays that are not read: {', '.join(unread)}",) if unread else ()
    curves = []
    for number, (points, ring) in enumerate(zip(wires, rings, strict=True), start=1):
        try:
            curves.append(polyline(check_points(points), interpolation, closed=closed or bool(ring)))
        except BadFile as error:
            raise BadFile(f"wire {number}: {error}") from error
    return CurveFile(tuple(curves), notes=notes)


def _arrays(archive: zipfile.ZipFile) -> dict[str, np.ndarray]:
    """The arrays of numbers by name. The sizes of all, which a small archive may make huge, are looked at before one is read."""
    names, total = archive.namelist(), 0
    for name in names:
        with archive.open(name) as file:
            version = np.lib.format.read_magic(file)
            header: Any = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
            shape, _, kind = header(file)
        if kind.kind not in "fiub" or kind.itemsize > 8:
            raise BadFile(f"{name} of type {kind}, not numbers")
        total += math.prod(shape)
    if total > MOST_NUMBERS:
        raise BadFile(f"{total:,} numbers, more than {MOST_NUMBERS:,}")
    arrays: dict[str, np.ndarray] = {}
    for name in names:
        with archive.open(name) as file:
            arrays[name.removesuffix(".npy")] = np.lib.format.read_array(file, allow_pickle=False)
    return arrays


def _wires(arrays: dict[str, np.ndarray]) -> tuple[list[np.ndarray], np.ndarray]:
    """Points (point, 3) of each wire, and whether it is closed (wire,)."""
    if "points" in arrays and "counts" in arrays:
        points, counts = arrays["points"], arrays["counts"]
        if points.ndim != 2 or points.shape[1] != 3 or counts.ndim != 1 or counts.dtype.kind not in "iu":
            raise BadFile(
                f"points {points.shape} and counts {counts.shape} of {counts.dtype}, not (point, 3) and (wire,) integers"
            )
        if (counts < 1).any() or (counts > len(points)).any() or int(counts.sum(dtype=np.int64)) != len(points):
            raise BadFile(f"counts that do not add up to its {len(points):,} points")
        rings = arrays.get("closed", np.zeros(len(counts), dtype=bool))
        if rings.shape != counts.shape or not np.isin(rings, (0, 1)).all():
            raise BadFile(f"closed {rings.shape} of {rings.dtype}, not (wire,) of true and false")
        wires = np.split(points, np.cumsum(counts, dtype=np.int64)[:-1])
        check_count(len(points))
        return wires, rings.astype(bool)
    for name, array in arrays.items():
        if array.ndim != 2 or array.shape[1] != 3:
            raise BadFile(f"{name} of shape {array.shape}, not (point, 3)")
    check_count(sum(len(array) for array in arrays.values()))
    return list(arrays.values()), np.zeros(len(arrays), dtype=bool)
