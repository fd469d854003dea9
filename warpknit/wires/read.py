"""Wires from a file, whatever its format, as nodes at equal arc length.

Each piece of a curve is halved twice; the length of a part is a Gauss-Legendre sum of eight points. The parameter of a node is
found by Newton's method on the arc length inside its part, whose derivative is the speed. The nodes lie on the curve; how equal
their distances are depends on the quadrature alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from warpknit.base.text import both, engineering, exact
from warpknit.scene.messages import scene_error
from warpknit.scene.wire_file import WireArrays, WireFileError
from warpknit.wires.bases import BadFile, Curve, CurveFile
from warpknit.wires.centre_lines import Wires, repeated, transported
from warpknit.wires.file_curves import curves_in, unreadable
from warpknit.wires.parting import pushed_apart

if TYPE_CHECKING:
    from warpknit.scene import Scene


PARTS = 4  # of a piece
NEWTON_STEPS = 6
FOUND = 1e-9  # of a piece: a step shorter than this leaves its square
BLOCK = 1 << 15  # pieces or nodes at once: bounds the memory
PLACES, WEIGHTS = np.polynomial.legendre.leggauss(8)
PLACES, WEIGHTS = 0.5 * (PLACES + 1.0), 0.5 * WEIGHTS  # on [0, 1]


class ArcLength:
    """Arc length along the pieces (piece, 4, 3) of a curve."""

    def __init__(self, curve: Curve) -> None:
        self.pieces = curve.pieces
        parts = np.empty((len(self.pieces), PARTS))
        for first in range(0, len(self.pieces), BLOCK):
            block = self.pieces[first : first + BLOCK, None]
            start = np.arange(PARTS) / PARTS
            parts[first : first + BLOCK] = _lengths(block, start, start + 1.0 / PARTS)
        self.parts = parts.ravel()
        self.knots = np.concatenate([[0.0], np.cumsum(self.parts)])  # arc length at the ends of the parts

    @property
    def length(self) -> float:
        return float(self.knots[-1])

    def points(self, arcs: np.ndarray) -> np.ndarray:
        """(node, 3) at arc lengths (node,) between 0 and `length`."""
        blocks = [self._points(arcs[first : first + BLOCK]) for first in range(0, len(arcs), BLOCK)]
        return np.concatenate(blocks) if blocks else np.empty((0, 3))

    def _points(self, arcs: np.ndarray) -> np.ndarray:
        part = np.clip(np.searchsorted(self.knots, arcs, side="right") - 1, 0, len(self.parts) - 1)
        wanted = np.clip(arcs - self.knots[part], 0.0, self.parts[part])
        pieces, start = self.pieces[part // PARTS], (part % PARTS) / PARTS
        end = start + 1.0 / PARTS
        share = np.divide(wanted, self.parts[part], out=np.zeros_like(wanted), where=self.parts[part] > 0.0)
        place = start + share / PARTS
        for _ in range(NEWTON_STEPS):
            speed = _speed(pieces, place)
            excess = _lengths(pieces, start, place) - wanted
            step = np.divide(excess, speed, out=np.zeros_like(excess), where=speed > 0.0)
            place = np.clip(place - step, start, end)
            if np.abs(step).max(initial=0.0) < FOUND:
                break
        return _bezier(pieces, place)


def _lengths(pieces: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Arc length (...) of pieces (..., 4, 3) between parameters (...)."""
    span = np.asarray(end - start)
    places = start[..., None] + span[..., None] * PLACES
    return np.asarray(span * (_speed(pieces[..., None, :, :], places) @ WEIGHTS))


def _speed(pieces: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Norm (...) of the derivative by the parameter."""
    return np.linalg.norm(_bezier(3.0 * np.diff(pieces, axis=-2), t), axis=-1)


def _bezier(points: np.ndarray, t: np.ndarray) -> np.ndarray:
    """(..., 3) of control points (..., n, 3), by de Casteljau's steps."""
    t = t[..., None, None]
    while points.shape[-2] > 1:
        points = points[..., :-1, :] + t * np.diff(points, axis=-2)
    return np.asarray(points[..., 0, :])


def segment_count(length: float, kind: str, spacing: float) -> int:
    """Segments of equal length nearest to `spacing`; two at least, four of a wire that goes on."""
    return max(2 if kind == "open" else 4, round(length / spacing))


def resample(curve: Curve, arc: ArcLength, count: int) -> tuple[np.ndarray, np.ndarray | None]:
    """Nodes at equal arc length, `count` segments, and stress-free lengths (segment,) of the straight segments. Each is shorter
    or longer than drawn by the same factor as the wire along its curve.

    The first node is where the curve begins; of an open curve the last is where it ends.
    """
    places = np.linspace(0.0, arc.length, count + 1)
    points = arc.points(places if curve.kind == "open" else places[:-1])
    points[0] = curve.pieces[0, 0]
    if curve.kind == "open":
        points[-1] = curve.pieces[-1, 3]
    if curve.slack is None:
        return points, None
    free = np.concatenate([[0.0], np.cumsum(np.repeat(curve.slack, PARTS) * arc.parts)])
    along = np.diff(np.interp(places, arc.knots, free)) / (arc.length / count)
    ends = points if curve.kind == "open" else np.concatenate([points, points[:1] + curve.pieces[-1, 3] - curve.pieces[0, 0]])
    return points, along * np.linalg.norm(np.diff(ends, axis=0), axis=1)


def natural_turns(curve: Curve, arc: ArcLength, points: np.ndarray) -> np.ndarray | None:
    """Natural turns (node, 3) [rad] of a periodic wire, as vectors on its section at rest; None: as at rest.

    points (node, 3): its nodes. The turns of the file, over the length of their points, are interpolated along the wire and
    transported to the tangents of the nodes.
    """
    if curve.natural_turn is None:
        return None
    at_points = _tangents(curve.pieces[:, 3] - curve.pieces[:, 0])
    at_nodes = _tangents(np.concatenate([points[1:], points[:1] + curve.pieces[-1, 3] - curve.pieces[0, 0]]) - points)
    return _interpolated(curve.natural_turn, arc, len(points), lambda rate, i: transported(rate, at_points[i], at_nodes))


def twist_strains(curve: Curve, arc: ArcLength, count: int) -> np.ndarray | None:
    """[node] [rad] twist at rest less natural twist of `count` nodes; None: the natural twist is that at rest."""
    if curve.twist is None:
        return None
    return _interpolated(curve.twist[:, None], arc, count, lambda rate, _: rate)[:, 0]


def _interpolated(
    values: np.ndarray, arc: ArcLength, count: int, moved: Callable[[np.ndarray, np.ndarray], np.ndarray]
) -> np.ndarray:
    """Values (node, n) of `count` nodes, from values (point, n) integrated over the points; moved: from points to the nodes."""
    knots = arc.knots[::PARTS]
    length = np.diff(knots)
    place = np.arange(count) * (arc.length / count)
    here = np.clip(np.searchsorted(knots, place, side="right") - 1, 0, len(length) - 1)
    rate, after = values / (0.5 * (length + np.roll(length, 1)))[:, None], (here + 1) % len(length)
    first, second = moved(rate[here], here), moved(rate[after], after)
    return (first + ((place - knots[here]) / length[here])[:, None] * (second - first)) * arc.length / count


def _tangents(edge: np.ndarray) -> np.ndarray:
    """(point, 3) unit vectors between the directions of the edges (point, 3) before and behind."""
    along = edge / np.linalg.norm(edge, axis=1)[:, None]
    both = along + np.roll(along, 1, axis=0)
    return np.asarray(both / np.linalg.norm(both, axis=1)[:, None])


MOST_NODES = 4_000_000
LARGEST = 1e3  # [m] of a coordinate
MOST_REPEATS = 1e4  # that a wire reaches over
SAME_THICKNESS = 0.01  # over the thickness: files keep seven digits, people three
MEETS = 1e-3  # of a period: how near the ends of a wire must be to a whole number of them


def read_wires(
    path: Path | WireArrays,
    *,
    node_spacing: float,
    unit: float | None = None,
    interpolation: str = "spline",
    closed: bool = False,
    period: tuple[float, float] | None = None,
    time: float | None = None,
    scene: Path | None = None,
) -> Wires:
    """The wires in the file at `path`, whose suffix says its format.

    node_spacing [m]: distance of nodes at equal arc length, about. unit [m]: of files without one. interpolation: spline |
    linear, between the points of polylines. closed: join the ends of all polylines (.csv, .npz). period [m] along x and y: of a
    periodic mesh, whose open wires continue from repeat to repeat. time: time code of a USD stage. scene: that names the file.
    Raises `SceneError`, of one line, for every fault of the file.
    """
    try:
        found, metres = curves_in(path, interpolation, closed, unit, time)
        found = _repeating(found, None if period is None else np.array(period) / metres)
        return _wires(found, metres, node_spacing)
    except (BadFile, WireFileError) as error:
        fault = error if isinstance(error, WireFileError) else unreadable(path, error)
        subject = f"{path.name!r} " if fault.key == "file" else ""
        raise scene_error(scene or path, f"wires.{fault.key}", f"{subject}{fault.wrong}", fault.instead) from error


@lru_cache(maxsize=1)
def rest_wires(scene: Scene) -> Wires:
    """The wires of a scene with [wires], in all its repeats, at rest; found once. Raises `SceneError`."""
    wires = drawn_wires(scene)
    is_drawn = scene.wires is None or scene.wires.overlaps == "prestress"
    return wires if is_drawn else pushed_apart(wires, thickness_of(scene, wires))


@lru_cache(maxsize=1)
def drawn_wires(scene: Scene) -> Wires:
    """The same as in the file, with overlaps; read once. Raises `SceneError`."""
    options = scene.wires
    assert options is not None
    given = {name: getattr(options, name) for name in ("node_spacing", "unit", "interpolation", "closed", "period", "time")}
    wires = read_wires(options.path, **given, scene=scene.path)
    if (wires.period is not None) != (scene.model.boundary == "periodic"):
        repeat, other = ("repeat", "periodic") if wires.period is not None else ("do not repeat", "gripped")
        wrong = f"{scene.model.boundary!r} does not fit the wires, which {repeat}"
        raise scene_error(scene.path, "model.boundary", wrong, f"write {other!r}")
    if wires.node_count * math.prod(options.repeats) > MOST_NODES:
        wrong = f"{list(options.repeats)} make {wires.node_count * math.prod(options.repeats):,} nodes"
        raise scene_error(scene.path, "wires.repeats", wrong, f"write repeats that make at most {MOST_NODES:,}")
    return repeated(_as_used(scene, wires), options.repeats)


def thickness_of(scene: Scene, wires: Wires) -> np.ndarray:
    """Thickness of each wire of a scene (wire,) [m]; the file's where its widths count."""
    if scene.wires is not None and scene.wires.widths and wires.radius is not None:
        return 2.0 * wires.radius
    return np.full(len(wires.points), scene.wire.thickness)


def _as_used(scene: Scene, wires: Wires) -> Wires:
    """Wires with the used parts of their file, and notes on unused ones."""
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


def _repeating(found: CurveFile, period: np.ndarray | None) -> CurveFile:
    """The same, with open curves as periodic ones. period (2,) between their ends; None: in the file."""
    if found.period is not None and period is not None:
        raise WireFileError("is not allowed: the file has its own period", "leave it out", "period")
    repeat = found.period if period is None else period
    if repeat is None:
        return found
    curves: list[Curve] = []
    for number, curve in enumerate(found.curves, start=1):
        if (np.abs(curve.pieces[:, :, :2]).max(axis=(0, 1)) > MOST_REPEATS * repeat).any():  # of another unit, or damaged
            wrong = f"wire {number} reaches farther than {MOST_REPEATS:g} repeats of {repeat[0]:.4g} x {repeat[1]:.4g} file units"
            raise WireFileError(wrong, "write one repeat of the mesh", "period")
        if curve.kind == "open" and period is not None:
            apart = curve.pieces[-1, 3] - curve.pieces[0, 0]
            repeats = np.round(apart[:2] / period)
            away = np.abs(apart - [*(repeats * period), 0.0]).max()
            if not repeats.any() or away > MEETS * period.min():
                ends = both(*(f"{count:.3g}" for count in apart[:2] / period))
                raise WireFileError(
                    f"the ends of wire {number} are {ends} periods apart",
                    "write the distance between the ends of every open wire, or a whole fraction of it",
                    "period",
                )
            curve = replace(curve, kind="periodic", shift=(int(repeats[0]), int(repeats[1])))
        curves.append(curve)
    return replace(found, curves=tuple(curves), period=repeat)


def _wires(found: CurveFile, metres: float, node_spacing: float) -> Wires:
    """The curves resampled, in m."""
    arcs = []
    for number, curve in enumerate(found.curves, start=1):
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
