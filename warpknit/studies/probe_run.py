"""Probe runs: a small mesh of the same knit, wire and load, at few and at many nodes, to estimate discretisation errors.

`warpknit run --error PERCENT` chooses its settings and estimates the error of the run by them.

Discretisation errors are the same in every repeat, and the same at every grip. So a periodic tile is probed with one repeat, or
the fewest that its model allows. A gripped mesh is probed with PATCH repeats a side, where the grips have a larger share, by the
ratio of the sizes. Hooks and scattered loops are probed at full size. Pulls at the edge and temperature gradients are left out.
"""

from __future__ import annotations

import logging
import math
from dataclasses import asdict, replace
from functools import cached_property

from ..base.errors import Diverged
from ..measure.table import Record
from ..mechanics.probe_settings import Setting, edge_of
from ..mesh.layout import of_repeats
from ..results.finding import ResultWarning
from ..results.row import Row
from ..runner.summary import Estimate
from ..scene import Scene
from ..solve.model import build_model, kind_of
from .points import Errors, Scales, TradeRow, errors_of, results_of, run_point, scales_of

PATCH = 2  # repeats a side of the gripped mesh
LEVELS = 2  # of a mesh whose state does not depend on the load history
SAFETY = 1.3  # factor on the estimate
FLOOR_PERCENT = 0.2  # added to it: error of the fine run and of the convergence tolerance
_log = logging.getLogger(__name__)


def with_setting(scene: Scene, setting: Setting) -> Scene:
    """The scene at other numerical settings."""
    model = replace(scene.model, nodes_per_loop=setting.nodes_per_loop)
    numerics = asdict(setting)
    del numerics["nodes_per_loop"]
    return replace(scene, model=model, solver=replace(scene.solver, **numerics))


class ProbeRun:
    """Runs the small mesh of a scene at several settings."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.edge = edge_of(scene)
        self.small = _small(scene)
        self.node_steps = 0

    @cached_property
    def scales(self) -> Scales:
        return scales_of(build_model(self.small))

    @cached_property
    def fine(self) -> Row:
        """Reference results of the small mesh, at many nodes. Raises `Diverged`."""
        setting = kind_of(self.scene).fine(self.scene)
        row = self._run(setting)
        if not row.has_results:
            raise Diverged(f"error estimate: the reference run of {setting.nodes_per_loop} nodes a loop failed: {row.message}")
        return row

    def errors(self, setting: Setting, results: Row | None = None) -> Errors | None:
        """Estimated errors of the scene at a setting; None where the small mesh does not converge.

        results: of a run of the scene, which are compared with the fine run if it is a periodic tile or a hook. A gripped mesh
        has smaller errors than the small mesh: the grips' share in a mean scales with 1/size.
        """
        small, large = self.small.knit.repeats, self.scene.knit.repeats
        if results is not None and self.edge != "gripped":
            force = results.contact_force_sum_N / (math.prod(large) / math.prod(small))
            return errors_of(results.changed(contact_force_sum_N=force), self.fine, self.scales)
        row = self._run(setting)
        if not row.has_results:
            return None
        errors = errors_of(row, self.fine, self.scales)
        share = min(1.0, min(small) / min(large)) if self.edge == "gripped" else 1.0
        return replace(errors, active_percent=share * errors.active_percent, tension=share * errors.tension,
                       contact_force=share * errors.contact_force)  # fmt: skip

    def _run(self, setting: Setting) -> TradeRow:
        row = run_point(lambda: with_setting(self.small, setting))
        self.node_steps += row.node_steps
        return row


def error_bound_percent(errors: Errors) -> float:
    """[%] upper bound on the largest error."""
    return SAFETY * errors.largest_percent + FLOOR_PERCENT


def choose_setting(probe: ProbeRun, percent: float) -> tuple[Setting, Errors]:
    """The cheapest setting with errors below `percent`, else the best one tried; and its errors."""
    best: tuple[Setting, Errors] | None = None
    for setting in kind_of(probe.scene).settings(probe.scene, percent):
        errors = probe.errors(setting)
        if errors is None:
            continue
        if best is None or errors.largest_percent < best[1].largest_percent:
            best = setting, errors
        if error_bound_percent(errors) <= percent:
            return setting, errors
    if best is None:
        raise Diverged("no setting found at which a small mesh of this scene converges")
    return best


def _small(scene: Scene) -> Scene:
    output = scene.output if scene.depends_on_path else replace(scene.output, frames=min(scene.output.levels, LEVELS))
    solver = replace(scene.solver, drive="relax")
    small = replace(scene, output=output, solver=solver)
    if scene.hook is not None or scene.knit.scatter:
        return small
    side, (columns, rows) = PATCH if scene.model.boundary == "gripped" else 1, scene.knit.repeats
    return of_repeats(small, min(side, columns), min(side, rows))


def settings_for_error(scene: Scene, percent: float) -> Setting:
    """Cheapest settings within an error of `percent`, by probe runs. Raises `Diverged`."""
    probe = ProbeRun(scene)
    setting, errors = choose_setting(probe, percent)
    what = "segments a wire" if edge_of(scene) == "hook" else "nodes a loop"
    _log.info(
        "chosen: %d %s, softening %g, tolerance %g (error of a small mesh %.2g %%; probe runs took %.2g node-steps)",
        setting.nodes_per_loop, what, setting.axial_softening, setting.residual_tolerance, errors.largest_percent,
        probe.node_steps,
    )  # fmt: skip
    return setting


def estimate_of(record: Record, scene: Scene, setting: Setting, percent: float) -> Estimate:
    """Estimated error of a run from its last record; `percent`: the requested one."""
    results = results_of(record.observables)
    try:
        errors = ProbeRun(scene).errors(setting, results)
    except Diverged as error:
        return Estimate(warning=ResultWarning("W45", f"The error was not estimated: {error}."))
    if errors is None:
        text = "The error was not estimated: a small mesh of this scene does not converge."
        return Estimate(warning=ResultWarning("W45", text))
    estimated = error_bound_percent(errors)
    warning = None
    if estimated > percent:
        text = f"The estimated error is {estimated:.2g} %, above the {percent:g} % of --error."
        warning = ResultWarning("W46", text)
    strain = errors.tension if any(scene.stages[-1].by_tension) else None
    return Estimate(
        estimated / 100.0, errors.active_percent, errors.tension, errors.contact_force, errors.stress, warning, strain=strain
    )
