"""The curves in a file of wires, whatever its format; BCC, CSV, NPZ and USD are read here.

BasisCurves of USD stages (.usd, .usda, .usdc, .usdz) are linear, and cubic in all bases and wraps. The stage says unit
(metersPerUnit, 0.01 where it does not, as USD has it) and upright axis (upAxis); transforms are applied. Of points that move,
those at the first time code are taken, or at the one asked for. Curves with invalid points, basis or wrap are skipped. Widths, or
the primvar of that name, are constant, per curve, or per point and then the same along a curve.
"""

from __future__ import annotations

import csv
import io
import math
import os
import re
import struct
import subprocess
import sys
import zipfile
import zlib
from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from warpknit.base.text import engineering, exact
from warpknit.scene.units import QuantityError, si
from warpknit.scene.wire_file import USD, WireArrays, WireFileError, checked_bytes
from warpknit.wires.bases import (
    BASES,
    MOST,
    MOST_POINTS,
    WRAPS,
    BadFile,
    Curve,
    CurveFile,
    check_count,
    check_points,
    cubic,
    polyline,
    some_of,
    upright,
)
from warpknit.wires.pyp import read_pyp

MOST_NUMBERS = 5 * MOST_POINTS  # three of a point, and what says where wires begin and close

# What zipfile, zlib and numpy.lib.format raise on bytes that are no archive of arrays.
FAULTS = (
    zipfile.BadZipFile, zlib.error, ValueError, EOFError, KeyError, NotImplementedError, RuntimeError, OverflowError,
    SyntaxError, TypeError, IndexError,
)  # fmt: skip
CENTIMETRE = 0.01  # USD's unit where a stage does not say
SAME_WIDTH = 1e-3  # relative difference of widths along a wire that is none
STAGE_PATIENCE = 300.0  # [s] that a stage may take to read


def read_npz(path: Path | WireArrays, interpolation: str, closed: bool) -> CurveFile:
    """The wires of an NPZ file; interpolation: a key of `bases.polyline`. Raises `BadFile`, OSError."""
    try:
        with zipfile.ZipFile(io.BytesIO(path.data) if isinstance(path, WireArrays) else path) as archive:
            arrays = _arrays(archive)
    except FAULTS as error:
        raise BadFile(f"a file that is no archive of arrays ({type(error).__name__}: {str(error)[:60]})") from error
    wires, rings = _wires(arrays)
    unread = sorted(arrays.keys() - {"points", "counts", "closed"}) if {"points", "counts"} <= arrays.keys() else []
    notes = (f"arrays that are not read: {', '.join(unread)}",) if unread else ()
    return CurveFile(_polylines(wires, interpolation, closed | rings), notes=notes)


def _polylines(wires: Sequence[ArrayLike], interpolation: str, closed: np.ndarray) -> tuple[Curve, ...]:
    """Curves through the points of each wire; closed (wire,). Raises `BadFile` with the number of the wire."""
    curves = []
    for number, (points, ring) in enumerate(zip(wires, closed, strict=True), start=1):
        try:
            curves.append(polyline(check_points(np.array(points)), interpolation, closed=bool(ring)))
        except BadFile as error:
            raise BadFile(f"wire {number}: {error}") from error
    return tuple(curves)


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


AXES = ("x", "y", "z")
_COMMA = re.compile(r"[+-]?[\d.]*\d,[\d,.]*(e[+-]?\d+)?", re.IGNORECASE)  # a number with commas
_HEADING = re.compile(r"\s*(x|y|z|wire)\s*(?:\[(.{1,40})\])?\s*", re.IGNORECASE)


def read_table(path: Path, interpolation: str, closed: bool) -> CurveFile:
    """The wires of a CSV file; interpolation: a key of `bases.polyline`. Raises `BadFile`, OSError.

    A row a point: x, y, z, or wire, x, y, z; a blank line or another wire's name begins the next wire. Columns are parted by
    commas, semicolons or tabs. Headings may stand on top, in any order, with one unit in brackets: x [mm], y [mm], z [mm].
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            first = file.readline()
            file.seek(0)
            delimiter = next((mark for mark in "\t;" if mark in first), ",")
            rows = list(csv.reader(file, delimiter=delimiter))
    except (UnicodeDecodeError, csv.Error) as error:
        raise BadFile(f"a file that is no table of text ({error})") from error
    rows = [[cell.strip() for cell in row] for row in rows]
    start = next((number for number, row in enumerate(rows) if any(row)), 0)
    columns, metres = _headings(rows[start]) if rows else ({}, None)
    if columns:
        start += 1
    check_count(len(rows) - start)
    wires: list[list[list[float]]] = []
    name, width = None, len(columns)
    for number, row in enumerate(rows[start:], start=start + 1):
        if not any(row):
            name = None
            continue
        if not columns:
            if len(row) not in (3, 4):
                raise BadFile(f"{len(row)} columns in line {number}, not x, y, z or wire, x, y, z")
            columns, width = {name: place for place, name in enumerate(("wire", *AXES)[-len(row) :])}, len(row)
        if len(row) != width:
            hint = "; a comma parts columns: write decimal points" if delimiter == "," and len(row) > width else ""
            raise BadFile(f"{len(row)} columns in line {number}, {width} in the lines before{hint}")
        wire = row[columns["wire"]] if "wire" in columns else ""
        if name is None or wire != name:
            wires.append([])
            name = wire
        try:
            wires[-1].append([float(row[columns[axis]]) for axis in AXES])
        except ValueError as error:
            if comma := next((cell for cell in row if _COMMA.fullmatch(cell)), None):
                written = f"{comma[:40]!r} in line {number}, with a comma where a decimal point is meant"
                raise BadFile(f"{written}: write numbers as 1234.5") from error
            raise BadFile(f"{', '.join(row)[:40]!r} in line {number}, not numbers") from error
    return CurveFile(_polylines(wires, interpolation, np.full(len(wires), closed)), metres=metres)


def _headings(row: list[str]) -> tuple[dict[str, int], float | None]:
    """Place of each column and metres of the unit in brackets; nothing without headings."""
    found = [_HEADING.fullmatch(cell) for cell in row]
    if not any(found):
        return {}, None
    if not all(found):
        raise BadFile(f"the headings {', '.join(row)[:60]!r}, not x, y, z and at most wire")
    names = [match[1].lower() for match in found if match]
    units = {match[2] for match in found if match and match[1].lower() in AXES}
    if sorted(set(names) - {"wire"}) != list(AXES) or len(set(names)) != len(names):
        raise BadFile(f"the headings {', '.join(row)[:60]!r}, not x, y, z and at most wire")
    if len(units) > 1:
        raise BadFile(f"the headings {', '.join(row)[:60]!r} with more than one unit")
    unit = units.pop()
    try:
        metres = None if unit is None else si(f"1 {unit}", "length")
    except QuantityError as error:
        raise BadFile(f"the unit [{unit}] in its headings") from error
    return {name: place for place, name in enumerate(names)}, metres


HEADER = struct.Struct("<3sB2sBBQQ40s")
COUNT, POINT = 4, 12  # bytes


def read_bcc(path: Path, interpolation: str) -> CurveFile:
    """The curves of a BCC file. interpolation: of polylines, a key of `bases.polyline`. Raises `BadFile`, OSError.

    Of Cem Yuksel's yarn-level cloth models, https://www.cemyuksel.com/cyCodeBase/soln/using_bcc_files.html. Little-endian,
    without a unit: a header of 64 bytes ("BCC"; 0x44 for numbers of 4 bytes; "C0" for uniform Catmull-Rom curves or "PL" for
    polylines; 3 dimensions; which of them points up; the number of curves and of all control points; text), then each curve:
    its number of control points, negative where it is closed, and these. An open curve passes through its first and last
    control points.
    """
    data = path.read_bytes()
    if len(data) < HEADER.size:
        raise BadFile(f"a file of {len(data)} bytes, less than its header of {HEADER.size}")
    sign, sizes, kind, dimensions, up, curve_count, point_count, _ = HEADER.unpack_from(data)
    if sign != b"BCC":
        raise BadFile("a file that does not begin with BCC")
    if sizes != 0x44 or kind not in (b"C0", b"PL") or dimensions != 3 or up > 2:
        raise BadFile(
            f"a header with sizes {sizes:#04x}, curves {kind.decode('latin-1')!r}, {dimensions} dimensions and up {up},"
            " not 0x44, 'C0' or 'PL', 3 and 0 to 2"
        )
    check_count(point_count)
    size = HEADER.size + COUNT * curve_count + POINT * point_count
    if len(data) != size:
        raise BadFile(
            f"{len(data):,} bytes where the header says {curve_count:,} curves of {point_count:,} points, {size:,} bytes"
        )
    curves: list[Curve] = []
    place = HEADER.size
    for number in range(1, curve_count + 1):
        count = struct.unpack_from("<i", data, place)[0] if place + COUNT <= len(data) else 0
        place += COUNT
        if count == 0 or place + POINT * abs(count) > len(data):
            raise BadFile(f"curve {number} with {count} control points" if count else f"curve {number} without control points")
        points = np.frombuffer(data, "<f4", 3 * abs(count), place).reshape(-1, 3)
        place += POINT * abs(count)
        try:
            points = upright(check_points(points), up)
            if kind == b"PL":
                curves.append(polyline(points, interpolation, closed=count < 0))
            else:
                curves.append(cubic(points, "catmullRom", "periodic" if count < 0 else "pinned"))
        except BadFile as error:
            raise BadFile(f"curve {number}: {error}") from error
    if place != len(data):
        raise BadFile(f"{len(data) - place:,} bytes behind its last curve")
    return CurveFile(tuple(curves))


def curves_in(
    path: Path | WireArrays, interpolation: str, closed: bool, unit: float | None, time: float | None
) -> tuple[CurveFile, float]:
    """Curves in a file or arrays, and metres in their unit. Raises `WireFileError`."""
    checked_bytes(path)
    try:
        found = FORMATS[path.suffix.lower()][0](path, interpolation, closed, time)
        if not found.curves:
            raise BadFile("a file without wires")
        return found, _metres(found, path.suffix.lower(), unit)
    except (BadFile, OSError) as error:
        raise unreadable(path, error) from error


def unreadable(path: Path | WireArrays, error: Exception) -> WireFileError:
    """The error for a file that cannot be read."""
    if isinstance(error, OSError):
        return WireFileError(f"cannot be read ({(error.strerror or 'it is unreadable').lower()})", "give another file")
    return WireFileError(f"cannot be read ({error})", f"give {FORMATS[path.suffix.lower()][1]}")


def stated_radius(path: Path, *, time: float | None = None) -> tuple[np.ndarray | None, str]:
    """Radius (wire,) [m] in a file of WITH_WIDTHS, and why widths are unusable. Raises `WireFileError`."""
    found, metres = curves_in(path, "spline", False, None, time)
    return None if found.radius is None else found.radius * metres, found.no_radius


def _metres(found: CurveFile, suffix: str, unit: float | None) -> float:
    """[m] of a unit of the file."""
    if found.metres is not None and unit is not None:
        wrong = f"{exact(unit, 'm')} is not allowed: the file has its own unit, {exact(found.metres, 'm')}"
        raise WireFileError(wrong, "leave it out", "unit")
    if found.metres is None and unit is None and suffix != ".pyp":
        raise WireFileError("missing: the file has no unit", "write one, such as 'mm'", "unit")
    metres = unit if found.metres is None else found.metres
    return 1.0 if metres is None else metres


def read_usd(path: Path, interpolation: str, *, time: float | None = None) -> CurveFile:
    """The wires of a stage; interpolation: of linear curves, a key of `bases.polyline`. Raises `BadFile`, OSError."""
    state = path.stat()
    return curves_of(_read_stage(path.absolute(), time, (state.st_mtime_ns, state.st_size)), interpolation)


@lru_cache(maxsize=1)
def _read_stage(path: Path, time: float | None, state: tuple[int, int]) -> dict[str, np.ndarray]:
    """`stage_arrays` of the stage, read by another process; state: of the file, to read it once."""
    command = [sys.executable, "-m", "warpknit.wires.stage_process", os.fspath(path)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    try:
        done = subprocess.run(
            command + ([] if time is None else [repr(time)]),
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            timeout=STAGE_PATIENCE,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise BadFile(f"a file that is not read after {STAGE_PATIENCE:g} s") from error
    if done.returncode == 2 and done.stdout:
        raise BadFile(done.stdout.decode(errors="replace"))
    if done.returncode != 0:
        raise BadFile("a file that breaks the USD library, or takes more memory than there is for it")
    with np.load(io.BytesIO(done.stdout), allow_pickle=False) as archive:
        return dict(archive)


def curves_of(arrays: dict[str, np.ndarray], interpolation: str) -> CurveFile:
    """The curves of `stage_process.stage_arrays`. Raises `BadFile`."""
    metres = float(arrays["metres"])
    if not (np.isnan(metres) or 1e-12 <= metres <= 1e6):
        raise BadFile(f"a stage with {metres:g} metres per unit")
    curves: list[Curve] = []
    kept: list[int] = []
    bad: list[str] = []
    of_curves = np.split(arrays["points"], np.cumsum(arrays["counts"])[:-1])
    for number, points in enumerate(of_curves):
        name = f"curve {number + 1} of {arrays['paths'][number]}"
        try:
            points = upright(check_points(points), int(arrays["up"]))
            basis, wrap = str(arrays["bases"][number]), str(arrays["wraps"][number])
            if basis not in ("linear", *BASES) or wrap not in WRAPS:
                raise BadFile(f"basis {basis!r} and wrap {wrap!r}")
            is_linear = basis == "linear"
            curves.append(polyline(points, interpolation, closed=wrap == "periodic") if is_linear else cubic(points, basis, wrap))
            kept.append(number)
        except BadFile as error:
            bad.append(f"{name}: {error}")
    if bad and not curves:
        raise BadFile(bad[0])
    notes = [*arrays["notes"].tolist()]
    if bad:
        notes.append(f"curves that are skipped: {some_of(bad)}")
    low, high = arrays["widths"][kept].T
    has_width, no_radius = np.isfinite(low), ""
    uneven = np.flatnonzero(high - low > SAME_WIDTH * high)
    if len(uneven):
        wire, unit = int(uneven[0]), CENTIMETRE if np.isnan(metres) else metres
        limits = " to ".join(engineering(float(limit[wire]) * unit, "m") for limit in (low, high))
        no_radius = f"widths of {limits} along wire {wire + 1}"
    elif len(faults := arrays["faults"]):
        no_radius = str(faults[0])
    elif has_width.any() and not has_width.all():
        no_radius = f"widths of some curves, none of wire {int(np.argmin(has_width)) + 1}"
    elif not ((low > 0.0) & (high <= MOST))[has_width].all():
        no_radius = f"a width of {np.nanmin(low):g}"
    radius: np.ndarray | None = None
    if has_width.any() and not no_radius:  # the decimal numbers that single precision stands for
        different, place = np.unique(0.5 * (low + high), return_inverse=True)
        radius = 0.5 * np.array([float(f"{value:.7g}") for value in different])[place]
    return CurveFile(tuple(curves), CENTIMETRE if np.isnan(metres) else metres, radius, no_radius, notes=tuple(notes))


Reader = Callable[[Any, str, bool, float | None], CurveFile]  # of a file, interpolation, whether closed, and time code
TABLE = "a table with columns x, y, z, and wire where there are several"
USD_FORMAT: tuple[Reader, str] = (lambda path, how, _, time: read_usd(path, how, time=time)), "a USD stage with BasisCurves"
FORMATS: dict[str, tuple[Reader, str]] = dict.fromkeys(USD, USD_FORMAT) | {
    ".bcc": (lambda path, how, *_: read_bcc(path, how), "a BCC file of curves"),
    ".pyp": (lambda path, how, *_: read_pyp(path, how), "a periodic yarn pattern"),
    ".csv": (lambda path, how, closed, _: read_table(path, how, closed), TABLE),
    ".npz": (lambda path, how, closed, _: read_npz(path, how, closed), "arrays of points"),
}
