"""The result of a map: what map.json holds, and the table of the command and a notebook show."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from .. import __version__
from ..base.text import counted, duration, engineering, percent, sides_text
from ..results.finding import Finding, ResultTable, ResultWarning
from ..results.row import Values, plain, valued
from ..runner.run_directory import Tree
from ..runner.summary_table import TIMED, heading, model_findings
from .contact_map import Jump, Optimum, drift_text, load_text, optimum_note

OF_SOME = ("report", "reflection", "answers", "spatial_model")  # tables that not every map has
LEAST_TOLD = 0.1  # [s] of a stage of a report: a map that was there takes less


@dataclass(frozen=True, kw_only=True)
class MapSummary:
    """The tables of map.json."""

    scene: Values
    version: str = __version__
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
    report: Values | None = None  # times of a report
    reflection: Sequence[Values] | None = None  # of a map with [reflection], see there
    answers: Values | None = None  # of a map with [reflection]: its least tensions
    spatial_model: Values | None = (
        None  # of a planar tile: means of the spatial model at the largest load, with `load` and `planar`
    )

    def json(self) -> Tree:
        """All of map.json."""
        return {name: value for name, value in plain(self).items() if value is not None or name not in OF_SOME}

    @classmethod
    def of(cls, tree: Tree) -> MapSummary:
        """The result that `json` gave."""
        optimum = None if tree["optimum"] is None else Optimum.of(tree["optimum"])
        known = {"warnings": [*map(ResultWarning.of, tree["warnings"])], "optimum": optimum, "jumps": tree["jumps"]}
        return cls(**vars(valued(tree)) | known)


def map_table(result: MapSummary, *more: Finding) -> ResultTable:
    """The table of a map, with further findings at its end."""
    return ResultTable((*map_findings(result), *more), tuple(result.warnings), "map.json")


def map_findings(result: MapSummary) -> Iterator[Finding]:
    """The rows of the table of a map."""
    cells, solver, optimum, report = result.cells, result.solver, result.optimum, result.report
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
        for drift in optimum.drift:
            yield Finding(f"  valid {drift.what}", drift_text(drift), short=drift.along == "both")
    if result.spatial_model is not None:
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


def _spatial_finding(other: Values, *, by_tension: bool) -> Finding:
    """The largest load of a planar map in the spatial model."""

    def text(of: Values) -> str:
        tension = sides_text((of.tension_weft_N_per_m, of.tension_warp_N_per_m), "N/m")
        driven = f"{percent(of.strain_weft)} weft, {percent(of.strain_warp)} warp" if by_tension else tension
        return f"{driven}, {percent(0.01 * of.active_percent)} active, {engineering(of.stress_max_Pa, 'Pa')}"

    where = f"at {load_text(other.load, by_tension)}"
    found = f"{where}: {text(other)} (mean of {other.meshes} meshes); planar: {text(other.planar)}"
    return Finding("in the spatial model", found, short=True)
