"""The contact map: one cell for each pair of strains or tensions, with the measures of its equilibrium.

Rows of map.csv and map_details.csv, the mean over meshes of scattered loops, the optimum, map.json and the table of the command.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..base.errors import Diverged
from ..base.text import alike, between, both, counted, duration, engineering, of_sides, percent, sides_text
from ..measure import energy_scale, table
from ..measure.jumps import STORED_FLOOR, jumps
from ..measure.table import Record
from ..mechanics.protocols import Model
from ..results.finding import Finding, ResultTable, ResultWarning
from ..results.row import Row, Values, read_rows, valued, write_rows
from ..runner.best_tension import DRIFT
from ..runner.estimates import FRICTIONS
from ..runner.other_model import FIGURES
from ..runner.run_directory import Tree
from ..runner.summary_table import TIMED, heading, model_findings

STEADY = "steady"
LEAST_TOLD = 0.1  # [s] of a stage of a report: a map that was there takes less
SIDES = ("weft", "warp")
SAME_SHARE = 0.01  # percentage points: tolerance for equal shares of active contacts


TARGETS = tuple(f"target_tension_{side}_N_per_m" for side in SIDES)  # columns of a map by tension
STRAINS = tuple(f"strain_{side}" for side in SIDES)
Pair = tuple[float, float]  # strains, or tensions [N/m], in weft and warp
NAMES = {part: [line.name for line in table.MEASURES if line.map == part] for part in ("map", "details")}  # of measures


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


def columns_of(part: str, by_tension: bool = False) -> list[str]:
    """Columns of map.csv ("map") or map_details.csv ("details")."""
    targets = TARGETS if by_tension else ()
    if part == "map":
        return [*STRAINS, *NAMES["map"], "stop_reason", *targets]
    spread = (f"std_{name}" for name in FIGURES)
    return [*STRAINS, *spread, *NAMES["details"], "dissipated_J", "variants", "steps", "message", *targets]


def map_row(load: Pair, end: Record | Diverged, *, steps: int, by_tension: bool = False) -> MapRow:
    """Row of an equilibrium, or of a load that did not converge. load: strains, or (`by_tension`) tensions [N/m]."""
    columns = [*columns_of("map", by_tension), *columns_of("details", by_tension)]
    row = MapRow(**dict.fromkeys(columns) | dict(zip(TARGETS if by_tension else STRAINS, load, strict=True)) | {"steps": steps})
    if isinstance(end, Diverged):
        return row.changed(stop_reason="diverged", variants=0, message=str(end))
    found = table.values(end.observables, [*NAMES["map"], *NAMES["details"]]) | {"dissipated_J": end.dissipated}
    if by_tension:
        found |= dict(zip(STRAINS, (np.diag(end.observables.stretch) - 1.0).tolist(), strict=True))
    return row.changed(**found, stop_reason=STEADY, variants=1, message="")


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

    names = (*NAMES["map"], *NAMES["details"], "dissipated_J", *(STRAINS if rows[0].by_tension else ()))
    return rows[0].changed(
        **{name: over(name, np.mean) for name in names},
        **{f"std_{name}": over(name, deviation) if len(steady) > 1 else None for name in FIGURES},
        stop_reason=reason,
        variants=len(steady),
        steps=sum(row.steps for row in rows),
        message=next((row.message for row in rows if row.message), ""),
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
    """Warning on the jumps of a map."""
    if not found:
        return
    loads = both(*(load_text(load, by_tension) for load in found[0]))
    kind = "tensions" if by_tension else "strains"
    where = f"{len(found)} neighbouring pairs of {kind}, first {loads}" if len(found) > 1 else f"the {kind} {loads}"
    yield ResultWarning("W40", f"Snap-through to another equilibrium between {where}.")


def unconverged_warning(rows: Sequence[MapRow], by_tension: bool) -> Iterator[ResultWarning]:
    """Warning on pairs of loads that did not converge."""
    failed, quantity = sum(row.stop_reason != STEADY for row in rows), "tensions" if by_tension else "strains"
    if failed:
        yield ResultWarning("W39", f"{failed} of {len(rows)} pairs of {quantity} did not converge.")


class TensionRange(Values):
    """Valid range of tension about the optimum, cell by cell. Weft and warp tensions [N/m] of the last good cells."""

    along: str  # weft | warp | both: the load that drifts
    low: Pair
    high: Pair
    open_low: bool  # the map ends there
    open_high: bool
    diverged_low: bool  # the next pair did not converge
    diverged_high: bool
    jumps: Sequence[tuple[Pair, Pair]]  # tensions on both sides of each jump to another equilibrium that ends the range


def drift_name(drift: TensionRange) -> str:
    """The varied tension of a range, in words."""
    return "valid both tensions" if drift.along == "both" else f"valid {drift.along} tension"


def drift_text(drift: TensionRange) -> str:
    """A `TensionRange` in words."""
    jumps = "; ".join(between(*(load_text(side, by_tension=True) for side in jump)) for jump in drift.jumps)
    snaps = f"; beyond it a snap-through {jumps}" if jumps else ""
    if drift.low == drift.high:
        return f"in this cell of the map only{snaps}"
    open_, diverged = (drift.open_low, drift.open_high), (drift.diverged_low, drift.diverged_high)
    ends = []
    for end, at, is_open, failed in zip((drift.low, drift.high), ("at most ", "at least "), open_, diverged, strict=True):
        text = sides_text(end, "N/m")
        text = f"{at}{text}, where the next pair did not converge" if failed else text
        ends.append(text + (" (edge of the map)" if is_open else ""))
    return f"from {ends[0]}{',' if drift.diverged_low else ''} to {ends[1]}{snaps}"


class Optimum(Row):
    """The load with the most active contacts and no wire above the elastic limit: strains, tensions, contacts and stress."""

    stress_margin: float  # 1 - stress over yield stress
    at_edge: Sequence[str]  # directions (weft, warp) in which the map ends there: a wider one may have a better optimum
    load: Pair  # strains, or tensions [N/m], of its cell
    drift: Sequence[TensionRange]  # with at most DRIFT fewer active contacts, and below the elastic limit


def optimum_warnings(optimum: Optimum | None, jumps: Sequence[Jump]) -> Iterator[ResultWarning]:
    """Warnings on the optimum: at the edge of the map, or beside jumps to another equilibrium."""
    if optimum is None:
        return
    if optimum.at_edge:
        yield ResultWarning("W43", f"The optimum is at the edge of the map in {' and '.join(optimum.at_edge)}.")
    if _is_beside_jump(optimum.load, jumps):
        yield ResultWarning("W44", "The optimum is beside a snap-through to another equilibrium.")


def _is_beside_jump(load: Pair | None, jumps: Sequence[Jump]) -> bool:
    return load is not None and any(tuple(load) == tuple(cell) for jump in jumps for cell in jump)


def optimum_note(load: Pair | None, jumps: Sequence[Jump], *, found_again: bool = True) -> str:
    """Limits of the optimum at a load, in few words for a label; empty without any."""
    return (", beside a snap-through" if _is_beside_jump(load, jumps) else "") + ("" if found_again else ", not found again")


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

    def rank(row: MapRow) -> tuple[int, int, float]:
        neighbours = int(equal_neighbours[warp.index(row.load[1]), weft.index(row.load[0])])
        return round(row.active_percent / SAME_SHARE), neighbours, -row.stress_max_Pa

    good = [row for row in rows if _is_good(row, yield_stress) and row.active_percent > 0.0]
    if not good:
        return None
    best = max(good, key=rank)
    edges = [
        side
        for side, value, axis in zip(SIDES, best.load, (weft, warp), strict=True)
        if len(axis) > 1 and (value == axis[-1] or value == axis[0] != 0.0)
    ]
    return Optimum(
        **{name: best[name] for name in FIGURES},
        stress_margin=1.0 - best.stress_max_Pa / yield_stress,
        at_edge=edges,
        load=best.load,
        drift=list(_drifts(rows, best, yield_stress, jumps)),
    )


def _is_good(row: MapRow, yield_stress: float) -> bool:
    """Whether a cell has converged, under tension, with its wire below the elastic limit."""
    is_steady = row.stop_reason == STEADY and row.active_percent is not None
    return is_steady and row.stress_max_Pa <= yield_stress and min(row.tension) > 0.0


def _drifts(rows: Sequence[MapRow], best: MapRow, yield_stress: float, jumps: Sequence[Jump]) -> Iterator[TensionRange]:
    """Ranges about the best cell along weft, along warp, and along both together."""
    weft, warp = axes_of(rows)
    cells = {(weft.index(row.load[0]), warp.index(row.load[1])): row for row in rows}
    (begin,) = (place for place, row in cells.items() if row is best)
    for along, (i, j) in (("weft", (1, 0)), ("warp", (0, 1)), ("both", (1, 1))):
        found: dict[str, object] = {}
        passed = []
        for name, sign in (("low", -1), ("high", 1)):
            here, place = best, begin
            while True:
                place = place[0] + sign * i, place[1] + sign * j
                row = cells.get(place)
                if row is None or not _is_good(row, yield_stress) or row.active_percent < best.active_percent - DRIFT:
                    break
                low, high = (here, row)[::sign]
                if _is_jump(low.load, high.load, jumps):
                    passed.append((low.tension, high.tension))
                    break
                here = row
            is_failed = row is not None and row.stop_reason != STEADY
            found |= {name: here.tension, f"open_{name}": row is None, f"diverged_{name}": is_failed}
        yield TensionRange(along=along, **found, jumps=passed)


def _is_jump(low: Pair, high: Pair, jumps: Sequence[Jump]) -> bool:
    """Whether there is a jump between two cells, on both ways: weft first and warp first."""
    corners = (high[0], low[1]), (low[0], high[1])
    return all((low, corner) in jumps or (corner, high) in jumps for corner in corners)


class MapSummary(Values):
    """The tables of map.json. `report`, `reflection`, `answers`, `spatial_model` and `frictions` are left out without them."""

    scene: Values
    version: str
    stop_reason: str
    warnings: Sequence[ResultWarning]
    path: str  # of each load, in words
    loads: str  # strains | tensions
    cells: Values  # wanted, done, converged
    variants: int
    model: Values
    solver: Values
    wire: Values
    optimum: Optimum | None
    jumps: Sequence[Jump]
    report: Values  # times of a report
    reflection: Sequence[Values]  # of a map with [reflection], see there
    answers: Values  # of a map with [reflection]: its least tensions
    frictions: Values  # of several meshes: means at the optimum with half and twice the friction, by name
    spatial_model: Values  # of a planar tile: means of the spatial model at the largest load, with `load` and `planar`

    @classmethod
    def of(cls, tree: Tree) -> MapSummary:
        """The summary in map.json."""
        return cls(**vars(valued(tree)) | {"warnings": [*map(ResultWarning.of, tree["warnings"])]})


def map_table(result: MapSummary, *more: Finding) -> ResultTable:
    """The table of a map, with further findings at its end."""
    return ResultTable((*map_findings(result), *more), tuple(result.warnings), "map.json")


def map_findings(result: MapSummary) -> Iterator[Finding]:
    """The rows of the table of a map."""
    cells, solver, optimum, report = result.cells, result.solver, result.optimum, result.get("report")
    meshes = "" if result.variants == 1 else f", up to {result.variants} meshes each"
    yield heading(
        result.scene.name,
        f"{cells.steady} of {counted(cells.wanted, 'pair')} of {result.loads} converged{meshes}",
        result.stop_reason,
    )
    limit = engineering(result.wire.yield_stress_Pa, "Pa")
    assumed = f" (assumed {limit})" if result.wire.yield_stress_assumed else ""
    if optimum is None:
        text = f"none: no load of the map has tension, an active contact and a stress below {limit}; change [sweep]"
        yield Finding("optimum", text, short=True)
    else:
        where = optimum_note(optimum.load, result.jumps)
        strain = f"{percent(optimum.strain_weft)} weft, {percent(optimum.strain_warp)} warp"
        yield Finding("optimum at strain", strain, where=where, short=True)
        tension = sides_text((optimum.tension_weft_N_per_m, optimum.tension_warp_N_per_m), "N/m")
        yield Finding("  tension", tension, short=True)
        yield Finding(
            "  active contacts", percent(0.01 * optimum.active_percent), where=" (the most on this map below yield)", short=True
        )
        share = f", {percent(1.0 - optimum.stress_margin, 0)} of yield{assumed}"
        yield Finding("  largest wire stress", optimum.stress_max_Pa, "Pa", where=share, short=True)
        yield from friction_findings(result)
        for drift in optimum.drift:
            yield Finding(f"  {drift_name(drift)}", drift_text(drift), short=drift.along == "both")
    yield Finding("loads", result.path)
    if "spatial_model" in result:
        yield _spatial_finding(result.spatial_model, by_tension=result.loads == "tensions")
    steps = f"{solver.cell_steps:,} steps"
    wall = duration(solver.wall_s if report is None else report.wall_s, 3)
    yield from model_findings(result.model, f"{result.model.nodes:,} nodes, {steps}, {wall}")
    yield Finding("  speed", f"{solver.cell_steps_per_s:,.0f} steps a second")
    if report is None:
        yield Finding("  wall time", f"{duration(solver.wall_s, 3)} {TIMED}")
    else:
        stages = ", ".join(f"{name} {duration(took)}" for name, took in vars(report.stages_s).items() if took >= LEAST_TOLD)
        yield Finding("  wall time", f"{duration(report.wall_s, 3)}: {stages}")


def friction_findings(result: MapSummary) -> Iterator[Finding]:
    """The optimum with other frictions."""
    for name, means in vars(result.get("frictions", Values())).items():
        by_tension = result.loads == "tensions"
        text = "; ".join(_texts(means, by_tension))
        friction = f"{FRICTIONS[name] * result.model.friction:g}"
        yield Finding(f"  with friction {friction}", f"{'strain' if by_tension else 'tension'} {text}", short=True)


def _spatial_finding(other: Values, *, by_tension: bool) -> Finding:
    """The largest load of a planar map in the spatial model."""
    spatial, planar = (", ".join(_texts(of, by_tension)) for of in (other, other.planar))
    where = f"at {load_text(other.load, by_tension)}"
    found = f"{where}: {spatial} (mean of {other.meshes} meshes); planar: {planar}"
    return Finding("in the spatial model", found, short=True)


def _texts(of: Values, by_tension: bool) -> tuple[str, str, str]:
    """What the load does not prescribe, active contacts, largest stress."""
    tension = sides_text((of.tension_weft_N_per_m, of.tension_warp_N_per_m), "N/m")
    driven = of_sides((percent(of.strain_weft), percent(of.strain_warp))) if by_tension else tension
    return driven, f"{percent(0.01 * of.active_percent)} active", engineering(of.stress_max_Pa, "Pa")
