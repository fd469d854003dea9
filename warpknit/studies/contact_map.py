"""The contact map: one cell for each pair of strains or tensions, with the measures of its equilibrium.

Rows of map.csv and map_details.csv, the mean over meshes of scattered loops, and the optimum. NumPy and plain numbers only.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..base.errors import Diverged
from ..base.text import alike, between, both, of_sides, sides_text
from ..measure import energy_scale, table
from ..measure.jumps import STORED_FLOOR, jumps
from ..measure.table import Measure, Record
from ..mechanics.protocols import Model
from ..results.finding import ResultWarning
from ..results.row import Row, read_rows, write_rows
from ..runner.best_tension import DRIFT

STEADY = "steady"
SIDES = ("weft", "warp")
SAME_SHARE = 0.01  # percentage points: tolerance for equal shares of active contacts


TARGETS = tuple(f"target_tension_{side}_N_per_m" for side in SIDES)  # columns of a map by tension
STRAINS = tuple(f"strain_{side}" for side in SIDES)
SPREAD = (*STRAINS, *(f"tension_{side}_N_per_m" for side in SIDES), "active_percent", "stress_max_Pa")
Pair = tuple[float, float]  # strains, or tensions [N/m], in weft and warp


def levels_of_pairs(pairs: Sequence[Pair], levels: int) -> list[int]:
    """Load levels of pairs of strains in a map [pair]: equal increments, `levels` to the largest strain."""
    largest = max((abs(strain) for pair in pairs for strain in pair), default=0.0) or 1.0
    return [max(1, math.ceil(max(map(abs, pair)) / largest * levels - 1e-9)) for pair in pairs]


class MapRow(Row):
    """One load of a map: the columns of map.csv and map_details.csv (measure/table.py); None where not converged."""

    stop_reason: str
    message: str  # why the load did not converge
    variants: int  # number of converged meshes in the row
    std_active_percent: float | None  # standard deviation over the meshes; of tensions, strains and stress too

    @property
    def by_tension(self) -> bool:
        """Whether the load is a pair of tensions, at which the strains were found."""
        return TARGETS[0] in self

    @property
    def load(self) -> Pair:
        """Strains, or tensions [N/m], that the map prescribes in weft and warp."""
        first, second = (self[name] for name in (TARGETS if self.by_tension else STRAINS))
        return first, second


def measures_of(part: str) -> list[Measure]:
    """Measures of the part "map" or "details"."""
    return [line for line in table.MEASURES if line.map == part]


def columns_of(part: str, by_tension: bool = False) -> list[str]:
    """Columns of map.csv ("map") or map_details.csv ("details")."""
    names, targets = [line.name for line in measures_of(part)], TARGETS if by_tension else ()
    if part == "map":
        return ["strain_weft", "strain_warp", *names, "stop_reason", *targets]
    own = (*(f"std_{name}" for name in SPREAD), *names, "dissipated_J", "variants", "steps", "message", *targets)
    return ["strain_weft", "strain_warp", *own]


def map_row(load: Pair, end: Record | Diverged, *, steps: int, by_tension: bool = False) -> MapRow:
    """Row of an equilibrium, or of a load that did not converge. load: strains, or (`by_tension`) tensions [N/m]."""
    observables = end.observables if isinstance(end, Record) else None
    strains: Sequence[float | None] = (None, None) if by_tension else load
    if by_tension and observables is not None:
        strains = (np.diag(observables.stretch) - 1.0).tolist()
    names = [line.name for part in ("map", "details") for line in measures_of(part)]
    return MapRow(
        **dict(zip(STRAINS, strains, strict=True)),
        stop_reason="diverged" if observables is None else STEADY,
        **dict.fromkeys(f"std_{name}" for name in SPREAD),
        variants=0 if observables is None else 1,
        steps=steps,
        message="" if isinstance(end, Record) else str(end),
        dissipated_J=end.dissipated if isinstance(end, Record) else None,
        **(dict.fromkeys(names) if observables is None else table.values(observables, names)),
        **(dict(zip(TARGETS, load, strict=True)) if by_tension else {}),
    )


def write_map(rows: Sequence[MapRow], path: Path, details: Path) -> None:
    """Write both tables, atomically."""
    by_tension = any(row.by_tension for row in rows)
    for target, part in ((path, "map"), (details, "details")):
        write_rows(target, rows, columns_of(part, by_tension))


def read_map(path: Path, details: Path) -> list[MapRow]:
    """Rows that `write_map` wrote; none where the files are absent. Values are bit-identical."""
    if not (path.exists() and details.exists()):
        return []
    more = {row.load: row for row in read_rows(details, MapRow)}
    return [row.changed(**vars(more[row.load])) for row in read_rows(path, MapRow) if row.load in more]


def mean_map(maps: Sequence[Sequence[MapRow]]) -> list[MapRow]:
    """Mean of maps over the converged meshes. Loads without any row are left out."""
    by_load: dict[Pair, list[MapRow]] = {}
    for rows in maps:
        for row in rows:
            by_load.setdefault(row.load, []).append(row)
    return [_mean(rows) if len(maps) > 1 else rows[0] for rows in by_load.values()]


def _mean(rows: Sequence[MapRow]) -> MapRow:
    steady = [row for row in rows if row.stop_reason == STEADY]
    reason = STEADY if len(steady) == len(rows) else f"{len(steady)} of {len(rows)} meshes converged" if steady else "diverged"

    def over(name: str, how: Callable[[list[float]], Any]) -> float | None:
        values = [row.get(name) for row in steady]
        return float(how(values)) if values and None not in values else None

    def deviation(values: list[float]) -> float:
        return float(np.std(values, ddof=1))

    measures = {line.name: over(line.name, np.mean) for line in measures_of("map") + measures_of("details")}
    targets = dict(zip(TARGETS, rows[0].load, strict=True)) if rows[0].by_tension else {}
    strains = {name: over(name, np.mean) if targets else rows[0].load[k] for k, name in enumerate(STRAINS)}
    return MapRow(
        **strains,
        stop_reason=reason,
        **{f"std_{name}": over(name, deviation) if len(steady) > 1 else None for name in SPREAD},
        variants=len(steady),
        steps=sum(row.steps for row in rows),
        message=next((row.message for row in rows if row.message), ""),
        dissipated_J=over("dissipated_J", np.mean),
        **measures,
        **targets,
    )


def axes_of(rows: Sequence[MapRow]) -> tuple[list[float], list[float]]:
    """Strains, or tensions [N/m], of a map in weft and in warp, in their order."""
    weft, warp = (sorted({row.load[side] for row in rows}) for side in (0, 1))
    return weft, warp


def grid(rows: Sequence[MapRow], name: str, weft: Sequence[float], warp: Sequence[float]) -> np.ndarray:
    """Values (warp, weft) of a column of map.csv or map_details.csv; nan where there is none."""
    values = {row.load: row.get(name) for row in rows}
    cells = [[values.get((x, y)) for x in weft] for y in warp]
    return np.array([[math.nan if value is None else float(value) for value in line] for line in cells])


Jump = tuple[Pair, Pair]  # loads of two neighbouring cells


def find_jumps(mesh: Model, rows: Sequence[MapRow]) -> list[Jump]:
    """Neighbouring cells whose equilibria belong to different branches (measure/jumps.py), along weft and along warp."""
    if not rows:
        return []
    weft, warp = axes_of(rows)
    area, floor = mesh.panel.area, STORED_FLOOR * energy_scale(mesh)
    stored = np.sum([grid(rows, f"energy_{part}_J", weft, warp) for part in ("stretch", "bend", "contact")], axis=0)
    tensions = np.stack([grid(rows, f"tension_{side}_N_per_m", weft, warp) for side in SIDES], axis=-1)
    force = np.stack([area * grid(rows, f"nominal_{side}_N_per_m", weft, warp) for side in SIDES], axis=-1)
    strain = np.stack([grid(rows, f"strain_{side}", weft, warp) for side in SIDES], axis=-1)
    dissipated = np.nan_to_num(grid(rows, "dissipated_J", weft, warp))
    follows = strain if rows[0].by_tension else tensions  # the values that the load does not prescribe
    found: list[Jump] = []
    for path, axis in zip((weft, warp), (1, 0), strict=True):
        for line in range(stored.shape[1 - axis]):
            jumped = jumps(
                np.array(path),
                np.take(force, line, 1 - axis),
                np.take(strain, line, 1 - axis),
                stored=stored.take(line, 1 - axis),
                dissipated=dissipated.take(line, 1 - axis),
                values=[np.take(follows, line, 1 - axis)],
                floor=floor,
            )
            for k in np.flatnonzero(jumped):
                ends = [(weft[k + more], warp[line]) if axis else (weft[line], warp[k + more]) for more in (0, 1)]
                found.append((ends[0], ends[1]))
    return found


def load_text(load: Pair, by_tension: bool) -> str:
    """Strains, or tensions [N/m], in weft and warp, as text."""
    return of_sides(load_texts(load, by_tension))


def load_texts(loads: Pair, by_tension: bool) -> list[str]:
    """Two strains, or tensions [N/m], as text."""
    return alike(loads, "N/m") if by_tension else [f"{100.0 * value:.3g} %" for value in loads]


def jump_warning(found: Sequence[Jump], by_tension: bool = False) -> Iterator[ResultWarning]:
    """What the jumps of a map mean."""
    if not found:
        return
    loads = both(*(load_text(load, by_tension) for load in found[0]))
    kind = "tensions" if by_tension else "strains"
    where = f"{len(found)} neighbouring pairs of {kind}, first {loads}" if len(found) > 1 else f"the {kind} {loads}"
    yield ResultWarning(
        "W40",
        f"Snap-through to another equilibrium between {where}.",
    )


def unconverged_warning(rows: Sequence[MapRow], by_tension: bool) -> Iterator[ResultWarning]:
    """How many pairs of loads did not converge."""
    failed, quantity = sum(row.stop_reason != STEADY for row in rows), "tensions" if by_tension else "strains"
    if failed:
        yield ResultWarning("W39", f"{failed} of {len(rows)} pairs of {quantity} did not converge.")


@dataclass(frozen=True)
class TensionRange:
    """Valid range of tension about the optimum, cell by cell. Weft and warp tensions [N/m] of the last good cells."""

    along: str  # weft | warp | both: the load that drifts
    low: Pair
    high: Pair
    open_low: bool  # the map ends there
    open_high: bool
    diverged_low: bool  # the next pair did not converge
    diverged_high: bool
    jumps: tuple[tuple[Pair, Pair], ...] = ()  # tensions on both sides of each jump to another equilibrium that ends the range

    @property
    def what(self) -> str:
        """What drifts, in words."""
        return "both tensions" if self.along == "both" else f"{self.along} tension"


def drift_text(drift: TensionRange) -> str:
    """A `TensionRange` in words."""
    jumps = "; ".join(between(*(load_text(side, by_tension=True) for side in jump)) for jump in drift.jumps)
    snaps = f"; beyond it a snap-through {jumps}" if jumps else ""
    open_, diverged = (drift.open_low, drift.open_high), (drift.diverged_low, drift.diverged_high)
    if drift.low == drift.high:
        reasons = ((open_, "the map ends"), (diverged, "the next pair did not converge"))
        unknown = (
            f"; {' and '.join(sides)} it {why}"
            for found, why in reasons
            if (sides := [side for side, is_so in zip(("below", "above"), found, strict=True) if is_so])
        )
        return "in this cell of the map only" + "".join(unknown) + snaps
    ends = []
    for end, at, is_open, failed in zip((drift.low, drift.high), ("at most ", "at least "), open_, diverged, strict=True):
        text = sides_text(end, "N/m")
        text = f"{at}{text}, where the next pair did not converge" if failed else text
        ends.append(text + (" (edge of the map)" if is_open else ""))
    return f"from {ends[0]}{',' if drift.diverged_low else ''} to {ends[1]}{snaps}"


@dataclass(frozen=True)
class Optimum:
    """The load with the most active contacts and no wire above the elastic limit."""

    strain_weft: float
    strain_warp: float
    tension_weft_N_per_m: float
    tension_warp_N_per_m: float
    active_percent: float
    stress_max_Pa: float
    stress_margin: float  # 1 - stress over yield stress
    at_edge: tuple[str, ...] = ()  # directions (weft, warp) in which the map ends there: a wider one may have a better optimum
    load: Pair | None = None  # strains, or tensions [N/m], of its cell
    drift: tuple[TensionRange, ...] = ()  # with at most DRIFT fewer active contacts, and below the elastic limit

    @classmethod
    def of(cls, tree: Mapping[str, Any]) -> Optimum:
        """The optimum of map.json."""
        return cls(**{**tree, "load": tuple(tree["load"]), "drift": tuple(TensionRange(**drift) for drift in tree["drift"])})


def optimum_warnings(optimum: Optimum | None, jumps: Sequence[Jump]) -> Iterator[ResultWarning]:
    """What limits the optimum: the edge of the map, and jumps to another equilibrium beside it."""
    if optimum is None:
        return
    if optimum.at_edge:
        yield ResultWarning("W43", f"The optimum is at the edge of the map in {' and '.join(optimum.at_edge)}.")
    if _is_beside_jump(optimum.load, jumps):
        yield ResultWarning(
            "W44",
            "The optimum is beside a snap-through to another equilibrium.",
        )


def _is_beside_jump(load: Pair | None, jumps: Sequence[Jump]) -> bool:
    return any(load == tuple(cell) for jump in jumps for cell in jump)


def optimum_note(load: Pair | None, jumps: Sequence[Jump], *, found_again: bool = True) -> str:
    """What limits the optimum at a load, in the few words of a label; empty where nothing does."""
    return (", beside a jump" if _is_beside_jump(load, jumps) else "") + ("" if found_again else ", not found again")


def find_optimum(rows: Sequence[MapRow], yield_stress: float, jumps: Sequence[Jump] = ()) -> Optimum | None:
    """Optimum among converged cells under tension, with stress up to `yield_stress` [Pa]; or None.

    jumps: of `find_jumps`, which end the range of valid tension. A mesh of equal loops has few different shares of active
    contacts, and cells tie often. Ties are resolved by the number of equally good neighbours (robustness against strain errors),
    then by the smallest stress.
    """
    if not rows:
        return None
    weft, warp = axes_of(rows)
    active = np.nan_to_num(grid(rows, "active_percent", weft, warp))
    elastic = grid(rows, "stress_max_Pa", weft, warp) <= yield_stress  # False where unknown
    padded = np.pad(np.where(elastic, active, 0.0), 1)
    height, width = active.shape
    around = np.stack([padded[i : i + height, j : j + width] for i, j in np.ndindex(3, 3)])
    equal_neighbours = np.sum(around >= active - SAME_SHARE, axis=0)
    best: tuple[tuple[float, float, float], Optimum] | None = None
    for row in rows:
        values = (row.active_percent, row.tension_weft_N_per_m, row.tension_warp_N_per_m, row.stress_max_Pa)
        share, tension_weft, tension_warp, stress = (math.nan if value is None else value for value in values)
        tensile = share > 0.0 and tension_weft > 0.0 and tension_warp > 0.0
        if not (tensile and stress <= yield_stress and row.stop_reason == STEADY):
            continue
        neighbours = int(equal_neighbours[warp.index(row.load[1]), weft.index(row.load[0])])
        order = (round(share / SAME_SHARE), neighbours, -stress)
        if best is None or order > best[0]:
            margin = 1.0 - stress / yield_stress
            edges = tuple(
                side
                for side, value, axis in zip(SIDES, row.load, (weft, warp), strict=True)
                if len(axis) > 1 and (value == axis[-1] or value == axis[0] != 0.0)
            )
            strains = row.strain_weft, row.strain_warp
            best = order, Optimum(*strains, tension_weft, tension_warp, share, stress, margin, edges, row.load)
    return None if best is None else replace(best[1], drift=tuple(_drifts(rows, best[1], yield_stress, jumps)))


def _drifts(rows: Sequence[MapRow], optimum: Optimum, yield_stress: float, jumps: Sequence[Jump]) -> Iterator[TensionRange]:
    """Ranges about the optimum along weft, along warp, and along both together."""
    weft, warp = axes_of(rows)
    cells = {row.load: row for row in rows}
    assert optimum.load is not None
    at = weft.index(optimum.load[0]), warp.index(optimum.load[1])

    def cell(i: int, j: int) -> MapRow | None:
        return cells.get((weft[i], warp[j])) if 0 <= i < len(weft) and 0 <= j < len(warp) else None

    def is_good(row: MapRow) -> bool:
        if row.active_percent is None or row.stop_reason != STEADY:
            return False
        enough = row.active_percent >= optimum.active_percent - DRIFT
        return bool(enough and row.stress_max_Pa <= yield_stress and min(row.tension) > 0.0)

    for along, (i, j) in (("weft", (1, 0)), ("warp", (0, 1)), ("both", (1, 1))):
        ends: list[Pair] = []
        beyond: list[MapRow | None] = []
        passed: list[tuple[Pair, Pair]] = []
        for sign in (-1, 1):
            count, here = 0, cell(*at)
            while (row := cell(at[0] + sign * (count + 1) * i, at[1] + sign * (count + 1) * j)) is not None and is_good(row):
                assert here is not None
                low, high = (here, row)[::sign]
                if _is_jump(low.load, high.load, jumps):
                    passed.append((low.tension, high.tension))
                    break
                count, here = count + 1, row
            assert here is not None
            ends.append(here.tension)
            beyond.append(row)
        open_low, open_high = (row is None for row in beyond)
        diverged_low, diverged_high = (row is not None and row.stop_reason != STEADY for row in beyond)
        yield TensionRange(along, ends[0], ends[1], open_low, open_high, diverged_low, diverged_high, tuple(passed))


def _is_jump(low: Pair, high: Pair, jumps: Sequence[Jump]) -> bool:
    """Whether there is a jump from one cell to the next, along both loads: on each way, first along weft or first along warp."""
    corners = (high[0], low[1]), (low[0], high[1])
    return all((low, corner) in jumps or (corner, high) in jumps for corner in corners)
