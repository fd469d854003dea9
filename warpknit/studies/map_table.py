"""The result of a map: what map.json holds, and the table of the command and a notebook show."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from .. import __version__
from ..base.text import duration, engineering, percent
from ..results.finding import Finding, ResultWarning, warning_lines
from ..results.row import Values, plain, valued
from ..runner.run_directory import Tree
from ..runner.strength import assumed_note
from ..runner.summary_table import TIMED, model_findings
from .contact_map import Jump, Optimum, drift_text, optimum_note

OF_SOME = ("report", "reflection", "answers")  # tables that not every map has
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
    cells: Values  # wanted, done, steady
    variants: int
    model: Values
    solver: Values
    wire: Values
    optimum: Optimum | None
    jumps: Sequence[Jump]
    report: Values | None = None  # times of a report
    reflection: Sequence[Values] | None = None  # of a map with [reflection], see there
    answers: Values | None = None  # of a map with [reflection]: its least tensions

    def json(self) -> Tree:
        """All of map.json."""
        return {name: value for name, value in plain(self).items() if value is not None or name not in OF_SOME}

    @classmethod
    def of(cls, tree: Tree) -> MapSummary:
        """The result that `json` gave."""
        optimum = None if tree["optimum"] is None else Optimum.of(tree["optimum"])
        known = {"warnings": [ResultWarning("", text) for text in tree["warnings"]], "optimum": optimum, "jumps": tree["jumps"]}
        return cls(**vars(valued(tree)) | known)


def map_findings(result: MapSummary) -> Iterator[Finding]:
    """The lines of the table of a map."""
    yield from warning_lines(result.warnings)
    yield from model_findings(result.model)
    cells, solver, optimum, report = result.cells, result.solver, result.optimum, result.report
    meshes = "" if result.variants == 1 else f", up to {result.variants} meshes each"
    yield Finding(f"pairs of {result.loads}", f"{cells.steady} of {cells.wanted} converged{meshes}")
    steps = f"{solver.cell_steps:,} of {result.model.nodes:,} nodes, {solver.cell_steps_per_s:,.0f} a second"
    yield Finding("time steps", steps)
    if report is None:
        yield Finding("wall time", f"{duration(solver.wall_s, 3)} {TIMED}")
    else:
        stages = ", ".join(f"{name} {duration(took)}" for name, took in vars(report.stages_s).items() if took >= LEAST_TOLD)
        yield Finding("wall time", f"{duration(report.wall_s, 3)} for the report: {stages}")
    note = assumed_note("wire.yield_stress", result.wire.yield_stress_assumed)
    if optimum is None:
        below = f"below {engineering(result.wire.yield_stress_Pa, 'Pa')}{note}"
        text = f"none: no tensile load of the map has an active contact and a stress {below}; another [sweep] may"
        yield Finding("optimum", text)
    else:
        strains = f"{percent(optimum.strain_weft)} / {percent(optimum.strain_warp)}"
        yield Finding("optimum strain, weft / warp", strains, where=optimum_note(optimum.load, result.jumps))
        yield Finding("  tension, weft / warp", (optimum.tension_weft_N_per_m, optimum.tension_warp_N_per_m), "N/m")
        yield Finding("  active contacts", percent(0.01 * optimum.active_percent))
        share = f", {percent(1.0 - optimum.stress_margin, 0)} of the elastic limit"
        yield Finding("  largest stress", optimum.stress_max_Pa, "Pa", where=share, sure=note)
        for drift in optimum.drift:
            yield Finding(f"  {drift.along} may drift", drift_text(drift))
    yield Finding("stopped", result.stop_reason)
