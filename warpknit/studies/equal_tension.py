"""Equilibria under equal tensions in weft and warp, from the mesh as knitted; service points; equal tensions of a map.

One path gives the service tensions, the material card at a tension, the answers of a report, and the effect of heat (heat.py).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import takewhile

import numpy as np

from ..base.errors import Diverged
from ..base.text import engineering, exact, of_sides, percent
from ..results.row import Row
from ..runner.answers import SERVICE_TENSIONS, Service
from ..runner.branches import Jump, tensions_text
from ..runner.estimates import FRICTIONS
from ..runner.history import mean_tension
from ..runner.strength import exceeded_text, limit_text
from ..scene import Scene
from .card import MaterialCard
from .contact_map import SIDES, STEADY, MapRow, axes_of, grid
from .load_path import LoadPath, Meshes, Monitor, PathState, part_of, under_tension

BEGIN = 0.125  # of the least tension of interest: end of the first stage, so that small tensions are resolved
LEAST = 2.0**-12  # of the largest one: end of the first stage, at least
LEAST_LEVELS = 2  # of a stage that doubles the tension, which has half the levels of a run
APART = 1.05  # ratio of the tensions at the ends of two stages, at least, but for those that are wanted
YIELDED = "beyond first yield"
BROKEN = "beyond the strength of the wire"
LEFT = "another equilibrium than under equal tensions"
NO_PATH = "no strains of equal tension in the map"
MISSES = 2  # stages in a row that may fail
REFINED = 16  # times finer than the map on each side, for the search of equal tensions
DOUBLINGS = 4  # of the largest tension of interest, at most, in search of first yield
JUMPS_SHOWN = 4
SHOWN = ("strain_weft", "strain_warp", "active_percent", "stress_max_Pa")  # figures of a service tension
SAME_STRESS, SAME_STRAIN = 0.05, 0.003  # largest differences of one equilibrium found twice: relative, and strain


@dataclass(frozen=True)
class EqualTensionPath:
    """Rows of history.csv under equal tensions; states at the ends of load steps."""

    rows: Sequence[Row] = ()
    states: Mapping[float, Mapping[int, PathState]] = field(default_factory=dict)  # by tension [N/m], of each mesh
    at: Mapping[float, Row] = field(default_factory=dict)  # the rows of these states
    ended: str = ""  # why, where it did not go to its largest tension

    @property
    def failed(self) -> bool:
        """Whether it ends where the relaxation did not converge."""
        return self.ended not in ("", YIELDED, BROKEN)

    @property
    def end_text(self) -> str:
        """Its largest tension, and why it ends there."""
        top = engineering(mean_tension(self.rows[-1]), "N/m")
        if self.ended in (YIELDED, BROKEN):
            return f"to {top}, {self.ended}"
        return f"to {top}" + (f", above which the relaxation did not converge ({self.ended})" if self.ended else "")


def load_equally(meshes: Meshes, largest: float, monitor: Monitor = lambda _: None) -> EqualTensionPath:
    """The path to first yield, or through DOUBLINGS of the largest tension; its rows are means over the meshes.

    That is the larger of the service tensions and `largest` [N/m], of the map.

    If a load step does not converge, the path goes to the end of the next load step, at most MISSES times in a row. Then it ends
    with the records before. `monitor` gets the completed share.
    """
    path = LoadPath(meshes)
    scene = path.scene
    wanted = service_tensions(scene, None)
    top = max(largest, *wanted)
    ends = [*_ends(wanted, largest), *(top * 2.0**k for k in range(1, DOUBLINGS + 1))]
    rows: list[Row] = []
    states: dict[float, Mapping[int, PathState]] = {}
    at: dict[float, Row] = {}
    low, missed = 0.0, 0
    for number, high in enumerate(ends):
        before = len(rows)
        try:
            for row in path.rows(
                under_tension(scene, high), levels_between(scene, low, high), part_of(monitor, number, len(ends))
            ):
                rows.append(row)
                if row.load_factor < 1.0 and row.stress_max_Pa > scene.wire.yield_stress:
                    return EqualTensionPath(rows, states, at, YIELDED)
        except Diverged as error:
            missed += 1
            if missed > MISSES or high == ends[-1]:
                return EqualTensionPath(rows, states, at, str(error))
            del rows[before:]
        else:
            states[high], at[high] = path.states, rows[-1]
            if rows[-1].stress_max_Pa > scene.wire.yield_stress:
                return EqualTensionPath(rows, states, at, YIELDED)
            low, missed = high, 0
    return EqualTensionPath(rows, states, at)


def with_state_at(meshes: Meshes, path: EqualTensionPath, tension: float, monitor: Monitor = lambda _: None) -> EqualTensionPath:
    """The path with its state at `tension` [N/m], from the next smaller tension.

    The path continues to this tension beyond its end, or up to the strength of the wire. Without the state where the mesh does
    not converge. meshes: of the path.
    """
    if tension in path.states:
        return path
    low = max((one for one in path.states if one < tension), default=0.0)
    way, rows, ended, is_found = LoadPath(meshes, path.states.get(low)), list[Row](), path.ended, False
    scene = way.scene
    try:
        for row in way.rows(under_tension(scene, tension), levels_between(scene, low, tension), monitor):
            rows.append(row)
            if rows[-1].stress_max_Pa > scene.wire.tensile_strength:
                ended = BROKEN
                break
        else:
            is_found = True
    except Diverged as error:
        ended = str(error)
    top = max(map(mean_tension, path.rows), default=0.0)
    if tension < top:
        if not is_found:
            return path
        below = [*takewhile(lambda row: mean_tension(row) < tension, path.rows)]
        joined = [*below, rows[-1], *path.rows[len(below) :]]
    else:
        begin = next((number for number, row in enumerate(path.rows, 1) if row == path.at.get(low)), 0)
        joined = [*path.rows[:begin], *rows]
        if not is_found:
            return replace(path, rows=joined if max(map(mean_tension, joined), default=0.0) > top else path.rows, ended=ended)
    path = replace(path, rows=joined)
    return replace(path, states={**path.states, tension: way.states}, at={**path.at, tension: rows[-1]})


def unreached_text(scene: Scene, path: EqualTensionPath, tension: float) -> str:
    """Largest tension of a path without a state at `tension` [N/m], and why it ended."""
    if not path.rows:
        return f"the mesh as knitted did not converge: {path.ended}"
    top = max(path.rows, key=mean_tension)
    followed = f"the mesh was followed up to {engineering(mean_tension(top), 'N/m')}"
    if mean_tension(top) > tension:
        return f"{followed}, but no equilibrium was found at this tension: give a larger output.frames or another tension"
    if beyond := exceeded_text(scene, top.stress_max_Pa):
        stress = engineering(top.stress_max_Pa, "Pa")
        return f"{followed}, where the largest wire stress is {stress}, {beyond}; give a smaller tension, or a stronger wire"
    return f"{followed}, with the wire below its {limit_text(scene)}; {path.ended}"


def service_tensions(scene: Scene, requested: float | None) -> list[float]:
    """The SERVICE_TENSIONS, the scene's and the `requested` one [N/m]."""
    return sorted({*SERVICE_TENSIONS, *(one for one in (scene.output.service_tension, requested) if one is not None)})


def _ends(wanted: Sequence[float], largest: float) -> list[float]:
    """Tensions [N/m] at the ends of the stages: the wanted tensions, and doublings between them."""
    top = max(largest, *wanted)
    step, steps = max(BEGIN * min(one for one in (largest, *wanted) if one > 0.0), LEAST * top), []
    while step < top:
        steps.append(step)
        step *= 2.0
    fixed = {*wanted, top}
    return sorted(fixed | {one for one in steps if all(max(one / other, other / one) > APART for other in fixed)})


def levels_between(scene: Scene, low: float, high: float) -> int | str:
    """Levels from one tension [N/m] to the next, as `output.frames`."""
    if isinstance(scene.output.frames, str):
        return scene.output.frames
    doubling = max(LEAST_LEVELS, scene.output.frames // 2)
    return doubling if low == 0.0 else max(1, math.ceil(doubling * math.log2(high / low)))


@dataclass(frozen=True)
class ServicePoint:
    """The mesh at a tension in both directions: the one source for card, table and marker."""

    tension: float  # [N/m]
    row: Row | None = None  # the state, of several meshes with p10_NAME and p90_NAME of its figures; None where it is unknown
    why: str = ""  # there is no state, or what limits it
    resolved: bool = True  # whether the path under equal tensions has the same state

    @property
    def name(self) -> str:
        """The tension, as text."""
        return exact(self.tension, "N/m")

    @property
    def strains(self) -> tuple[float, float] | None:
        """Strains in weft and warp; None without a state."""
        return None if self.row is None else (self.row.strain_weft, self.row.strain_warp)

    @property
    def texts(self) -> tuple[str, str, str]:
        """Strain in weft and warp, share of active contacts and largest wire stress; or why there is no state."""
        if self.row is None:
            return self.why, "-", "-"
        weft, warp, active, stress = _parts(self.row)
        return f"{weft} / {warp}", active, stress + (f", {self.why}" if self.why else "")

    @property
    def range_texts(self) -> tuple[str, ...] | None:
        """The ranges of these figures over eight in ten meshes; None of one mesh."""
        if self.row is None or "p10_stress_max_Pa" not in self.row:
            return None
        low, high = (Row(**{name: self.row[f"{end}_{name}"] for name in SHOWN}) for end in ("p10", "p90"))
        weft, warp, *others = (f"{one} to {other}" for one, other in zip(_parts(low), _parts(high), strict=True))
        return f"{weft} / {warp}", *others

    @property
    def friction_texts(self) -> dict[str, tuple[str, ...]]:
        """The figures with other frictions, by name; none of one mesh."""
        if self.row is None:
            return {}
        of = {friction: [self.row.get(f"{friction}_{name}") for name in SHOWN] for friction in FRICTIONS}
        parts = {one: _parts(Row(**dict(zip(SHOWN, of[one], strict=True)))) for one in of if None not in of[one]}
        return {friction: (f"{weft} / {warp}", *others) for friction, (weft, warp, *others) in parts.items()}

    @property
    def answer(self) -> Service:
        """The point as the answers of a run have it."""
        row, tensions = self.row, dict.fromkeys(("tension_weft_N_per_m", "tension_warp_N_per_m"), self.tension)
        return Service(
            tension_N_per_m=self.tension, active_percent=None if row is None else row.active_percent,
            state=None if row is None else Row(strain_weft=row.strain_weft, strain_warp=row.strain_warp, **tensions),
            stage=None if row is None else row.get("stage", ""), resolved=self.resolved, jump=None,
            **({"why": self.why} if self.why else {}),
        )  # fmt: skip


def _parts(row: Row | MapRow) -> list[str]:
    """Strain in weft and warp, share of active contacts, largest wire stress, as texts."""
    strains = [percent(strain) for strain in (row.strain_weft, row.strain_warp)]
    return [*strains, percent(0.01 * row.active_percent), engineering(row.stress_max_Pa, "Pa")]


def service_points(
    scene: Scene, path: EqualTensionPath, jumps: Sequence[Jump], requested: float | None, card: MaterialCard | None
) -> list[ServicePoint]:
    """The mesh at `service_tensions`: on the path, which has these jumps, and by the `card` of the requested tension."""
    points = []
    for tension in service_tensions(scene, requested):
        row, own = path.at.get(tension), card if tension == requested else None
        shown = row if own is None else own.row.changed(stage="" if row is None else row.stage)
        if shown is None:
            points.append(ServicePoint(tension, why=_unreached(path, jumps, tension)))
            continue
        left = LEFT if row is not None and is_other(shown, row) else ""
        why = ", ".join(part for part in (YIELDED if shown.stress_max_Pa > scene.wire.yield_stress else "", left) if part)
        points.append(ServicePoint(tension, shown, why, resolved=not left))
    return points


def _unreached(path: EqualTensionPath, jumps: Sequence[Jump], tension: float) -> str:
    """Reason, in a few words, for no state at a `tension` [N/m]."""
    if not path.rows:
        return "the mesh as knitted did not converge" if path.ended else NO_PATH
    top = max(map(mean_tension, path.rows))
    if top < tension:
        if path.ended in (YIELDED, BROKEN):
            return path.ended
        up_to = engineering(top, "N/m")
        return f"the relaxation did not converge beyond {up_to}" if path.ended else f"not reached, up to {up_to}"
    jumped = any(mean_tension(before) < tension < mean_tension(after) for before, after in jumps)
    return "skipped by a snap-through" if jumped else "the relaxation did not converge there"


def jump_text(jumps: Sequence[Jump]) -> str | None:
    """Sentence on snap-throughs along a load path, or None."""
    if not jumps:
        return None
    places = "; ".join(tensions_text(*pair) for pair in jumps[:JUMPS_SHOWN]) + ("; ..." if len(jumps) > JUMPS_SHOWN else "")
    count = f"{len(jumps)} place{'s' if len(jumps) > 1 else ''}"
    return (
        f"the mesh snaps through to another equilibrium in {count} (between {places}). Several equilibria exist under one load:"
        " another load path or other output.frames may give other results"
    )


def largest_equal_tension(rows: Sequence[MapRow]) -> float:
    """The largest equal tension in weft and warp [N/m] of the bilinear map; 0 where there is none."""
    weft, warp = axes_of(rows)
    first, second = (_refined(grid(rows, f"tension_{side}_N_per_m", weft, warp)) for side in SIDES)
    apart = first - second
    largest = 0.0
    for axis in range(2):
        before, after = (np.take(apart, range(k, apart.shape[axis] - 1 + k), axis) for k in (0, 1))
        low, high = (np.take(first, range(k, first.shape[axis] - 1 + k), axis) for k in (0, 1))
        crossing = before * after <= 0.0  # not where it is unknown
        with np.errstate(invalid="ignore", divide="ignore"):
            share = np.where(before == after, 0.0, before / (before - after))
        tension = (1.0 - share) * low + share * high
        largest = max(largest, float(np.max(tension[crossing], initial=0.0)))
    return largest


def _refined(values: np.ndarray) -> np.ndarray:
    """Bilinear interpolation of a grid on REFINED times the points a side."""
    for axis in range(2):
        count = values.shape[axis]
        if count < 2:
            continue
        place = np.linspace(0.0, count - 1.0, REFINED * (count - 1) + 1)
        low = np.minimum(place.astype(int), count - 2)
        share = (place - low).reshape((-1, 1) if axis == 0 else (1, -1))
        values = (1.0 - share) * np.take(values, low, axis) + share * np.take(values, low + 1, axis)
    return values


def is_other(one: Row | MapRow, other: Row | MapRow) -> bool:
    """Whether two states under one load are different equilibria."""
    stress = one.stress_max_Pa / max(other.stress_max_Pa, 1e-300)
    strain = max(abs(one.strain_weft - other.strain_weft), abs(one.strain_warp - other.strain_warp))
    return bool(abs(stress - 1.0) > SAME_STRESS or strain > SAME_STRAIN)


def two_equilibria(load: str, one: Row | MapRow, of_one: str, other: Row | MapRow, of_other: str) -> str:
    """Sentence on two equilibria under one `load`, with their places on the page; or nothing."""
    if not is_other(one, other):
        return ""

    def text(row: Row | MapRow, where: str) -> str:
        weft, warp, active, stress = _parts(row)
        return f"strain {of_sides((weft, warp))}, {active} active, {stress} {where}"

    return f"The mesh has two equilibria at {load}: {text(one, of_one)}; {text(other, of_other)}."


def map_cell(cells: Sequence[MapRow], tension: float | None) -> MapRow | None:
    """Converged state of a map at one `tension` [N/m]; None for means of several meshes."""
    found = (one for one in cells if one.by_tension and one.load == (tension, tension))
    return next((one for one in found if one.stop_reason == STEADY and one.variants == 1), None)


def branches_at(tension: float, row: Row | None, cells: Sequence[MapRow], card: MaterialCard | None = None) -> str:
    """Sentence on two equilibria of the page at one `tension` [N/m]; empty for a single one. row: under equal tensions."""
    load, cell = exact(tension, "N/m"), map_cell(cells, tension)
    shown = row if card is None else card.row
    where = "under equal tensions" if card is None else "on the card" if row is None else "on the card and under equal tensions"
    if card is not None and row is not None and is_other(card.row, row):
        return two_equilibria(load, card.row, "on the card", row, "under equal tensions")
    return "" if shown is None or cell is None else two_equilibria(load, shown, where, cell, "in the map")
