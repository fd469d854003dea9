"""Wires from a file, whatever its format, as nodes at equal arc length."""

from __future__ import annotations

import math
import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from warpknit.base.text import engineering, exact
from warpknit.scene.messages import scene_error
from warpknit.scene.wire_file import WireFileError
from warpknit.wires.arc_length import ArcLength, resample, segment_count
from warpknit.wires.centre_lines import Wires
from warpknit.wires.curve import BadFile, Curve, CurveFile
from warpknit.wires.file_curves import curves_in, expected_in
from warpknit.wires.natural_shape import natural_turns, twist_strains
from warpknit.wires.repeat import repeated

if TYPE_CHECKING:
    from warpknit.scene import Scene

MOST_NODES = 4_000_000
LARGEST = 1e3  # [m] of a coordinate
MOST_REPEATS = 1e4  # that a wire reaches over
SAME_THICKNESS = 0.01  # over the thickness: files keep seven digits, people three
MEETS = 1e-3  # of a period: how near the ends of a wire must be to a whole number of them


def read_wires(
    path: str | os.PathLike[str],
    *,
    node_spacing: float,
    unit: float | None = None,
    interpolation: str = "spline",
    closed: bool = False,
    period: tuple[float, float] | None = None,
    time: float | None = None,
) -> Wires:
    """The wires in the file at `path`, whose suffix says its format.

    node_spacing [m]: nodes are put at equal arc length along each wire, as near to this apart as their number allows.
    unit [m]: of files without one. interpolation: spline | linear, between the points of polylines. closed: join the ends of all
    polylines (.csv, .npz). period [m] along x and y: of a mesh that repeats, whose open wires then go on from repeat to repeat.
    time: time code of a USD stage. Raises `SceneError`, of one line, for whatever is wrong with the file.
    """
    path = Path(path)
    try:
        return _read(path, node_spacing, unit, interpolation, closed, period, time)
    except WireFileError as error:
        raise scene_error(path, f"wires.{error.key}", f"{_subject(path, error)}{error.wrong}", error.instead) from error


def rest_wires(scene: Scene) -> Wires:
    """The wires of a scene with [wires], in all its repeats, at rest. Raises `SceneError`."""
    options = scene.wires
    if options is None:
        raise scene_error(scene.path, "wires", "missing", "write a table with a file")
    try:
        wires = _read(
            options.path,
            options.node_spacing,
            options.unit,
            options.interpolation,
            options.closed,
            options.period,
            options.time,
        )
    except WireFileError as error:
        wrong = f"{_subject(options.path, error)}{error.wrong}"
        raise scene_error(scene.path, f"wires.{error.key}", wrong, error.instead) from error
    if (wires.period is not None) != (scene.model.boundary == "periodic"):
        repeat, other = ("repeat", "periodic") if wires.period is not None else ("do not repeat", "gripped")
        wrong = f"{scene.model.boundary!r} does not fit the wires, which {repeat}"
        raise scene_error(scene.path, "model.boundary", wrong, f"write {other!r}")
    if wires.node_count * math.prod(options.repeats) > MOST_NODES:
        wrong = f"{list(options.repeats)} make {wires.node_count * math.prod(options.repeats):,} nodes"
        raise scene_error(scene.path, "wires.repeats", wrong, f"write repeats that make at most {MOST_NODES:,}")
    return repeated(_as_used(scene, wires), options.repeats)


def thickness_of(scene: Scene, wires: Wires) -> np.ndarray:
    """(wire,) [m] thickness of each wire of a scene: that of the file where its widths count."""
    if scene.wires is not None and scene.wires.widths and wires.radius is not None:
        return 2.0 * wires.radius
    return np.full(len(wires.points), scene.wire.thickness)


def _as_used(scene: Scene, wires: Wires) -> Wires:
    """The wires with what the scene uses of their file, and notes on what it does not."""
    assert scene.wires is not None
    notes, fraction, file = list(wires.notes), scene.wire.set_fraction, scene.wires.path.name
    if wires.radius is not None and not scene.wires.widths:
        low, high = 2e3 * wires.radius.min(), 2e3 * wires.radius.max()
        here = 1e3 * scene.wire.thickness
        if max(high - here, here - low) > SAME_THICKNESS * here:
            widths = f"{high:.4g} mm" if high - low <= SAME_THICKNESS * high else f"{low:.4g} to {high:.4g} mm"
            notes.append(f"wires are {widths} thick in the file, {here:.4g} mm in the scene")
    if fraction != 1.0 and not (wires.natural_turns is None and wires.twist_strains is None):
        notes.append(f"natural curvature and twist of {file} (*RK, *RT) are not used: wire.set_fraction = {fraction:g} sets them")
        wires = replace(wires, natural_turns=None, twist_strains=None)
    return replace(wires, notes=tuple(notes))


def _subject(path: Path, error: WireFileError) -> str:
    """The name of the file, where the fault is its own."""
    return f"{path.name!r} " if error.key == "file" else ""


def _read(
    path: Path,
    node_spacing: float,
    unit: float | None,
    interpolation: str,
    closed: bool,
    period: tuple[float, float] | None,
    time: float | None,
) -> Wires:
    for key, value in (("node_spacing", (node_spacing,)), ("unit", (unit,)), ("period", period or ())):
        if not all(length is None or 0.0 < length < math.inf for length in value):
            raise WireFileError(f"{value!r} is not above 0 m", "give lengths above 0 m", key)
    found, metres = curves_in(path, interpolation, closed, unit, time)
    if period is not None:
        found = _repeating(found, np.array(period) / metres)
    try:
        return _wires(found, metres, node_spacing)
    except BadFile as error:
        raise WireFileError(f"cannot be read ({error})", f"give {expected_in(path.suffix.lower())}") from error


def _repeating(found: CurveFile, period: np.ndarray) -> CurveFile:
    """The same with open curves whose ends are some repeats apart going on as periodic ones."""
    if found.period is not None:
        raise WireFileError("is not allowed: the file has its own period", "leave it out", "period")
    curves: list[Curve] = []
    for number, curve in enumerate(found.curves, start=1):
        _check_reach(number, curve, period)
        if curve.kind == "open":
            apart = curve.pieces[-1, 3] - curve.pieces[0, 0]
            repeats = np.round(apart[:2] / period)
            away = np.abs(apart - [*(repeats * period), 0.0]).max()
            if not repeats.any() or away > MEETS * period.min():
                ends = ", ".join(f"{count:.3g}" for count in apart[:2] / period)
                raise WireFileError(
                    f"the ends of wire {number} are {ends} periods apart",
                    "write a period that fits a whole number of times between the ends of every open wire",
                    "period",
                )
            curve = replace(curve, kind="periodic", shift=(int(repeats[0]), int(repeats[1])))
        curves.append(curve)
    return replace(found, curves=tuple(curves), period=period)


def _check_reach(number: int, curve: Curve, period: np.ndarray) -> None:
    """Refuse a repeat (2,) that is tiny beside a curve: of another unit, or damaged."""
    if (np.abs(curve.pieces[:, :, :2]).max(axis=(0, 1)) > MOST_REPEATS * period).any():
        wrong = f"wire {number} reaches farther than {MOST_REPEATS:g} repeats of {period[0]:.4g} x {period[1]:.4g} file units"
        raise WireFileError(wrong, "write one repeat of the mesh", "period")


def _wires(found: CurveFile, metres: float, node_spacing: float) -> Wires:
    """The curves resampled, in m."""
    arcs = []
    for number, curve in enumerate(found.curves, start=1):
        if found.period is not None:
            _check_reach(number, curve, found.period)
        farthest = float(np.abs(curve.pieces).max()) * metres
        if not farthest <= LARGEST:
            raise WireFileError(
                f"with {exact(metres, 'm')} wire {number} is {engineering(farthest, 'm')} away",
                f"write one that keeps all wires within {exact(LARGEST, 'm')}",
                "unit",
            )
        arc = ArcLength(curve)
        if not arc.length > 0.0:
            raise BadFile(f"wire {number} without length")
        arcs.append(arc)
    total = sum(arc.length * metres / node_spacing for arc in arcs)
    if not total <= MOST_NODES:
        wrong = f"{exact(node_spacing, 'm')} makes {total:.3g} nodes"
        raise WireFileError(wrong, f"write one that makes at most {MOST_NODES:,}", "node_spacing")
    points, rest, turns, twists = [], [], [], []
    for curve, arc in zip(found.curves, arcs, strict=True):
        places, free = resample(curve, arc, segment_count(arc.length * metres, curve.kind, node_spacing))
        points.append(places * metres)
        rest.append(None if free is None else free * metres)
        turns.append(natural_turns(curve, arc, places))
        twists.append(twist_strains(curve, arc, len(places)))
    return Wires(
        points=tuple(points),
        kinds=tuple(curve.kind for curve in found.curves),
        shifts=np.array([curve.shift for curve in found.curves], dtype=np.int64),
        period=None if found.period is None else found.period * metres,
        radius=None if found.radius is None else found.radius * metres,
        rest_lengths=_of_all(rest),
        natural_turns=_of_all(turns),
        twist_strains=_of_all(twists),
        notes=found.notes + ((f"widths that are not used: {found.no_radius}",) if found.no_radius else ()),
    )


def _of_all(values: list[np.ndarray | None]) -> tuple[np.ndarray, ...] | None:
    """Values that every wire has, else None."""
    kept = tuple(value for value in values if value is not None)
    return kept if len(kept) == len(values) else None
