"""`warpknit run --error PERCENT`: choice of settings, and estimate of the error of the run."""

from __future__ import annotations

import logging

from ..errors import Diverged
from ..measure.table import Record
from ..mechanics.trial import Setting, edge_of
from ..results.finding import ResultWarning
from ..runner.summary import Estimate
from ..scene import Scene
from .point import results_of
from .probe_run import ProbeRun, choose_setting, error_bound_percent

_log = logging.getLogger(__name__)


def settings_for_error(scene: Scene, percent: float) -> Setting:
    """The cheapest settings within an error of `percent`, by probe runs on a small mesh. Raises `Diverged`."""
    probe = ProbeRun(scene)
    setting, errors = choose_setting(probe, percent)
    what = "segments a wire" if edge_of(scene) == "hook" else "nodes a loop"
    _log.info(
        "%d %s, softening %g, tolerance %g: error of a small mesh of this scene %.2g %% (probe runs: %.2g node-steps)",
        setting.nodes_per_loop, what, setting.axial_softening, setting.residual_tolerance, errors.largest_percent,
        probe.node_steps,
    )  # fmt: skip
    return setting


def estimate_of(record: Record, scene: Scene, setting: Setting, percent: float) -> Estimate:
    """Estimated error of a run at a setting, chosen for an error of at most `percent`, from its last record."""
    results = results_of(record.observables)
    try:
        errors = ProbeRun(scene).errors_of_run(results, setting)
    except Diverged as error:
        return Estimate(warning=ResultWarning("W45", f"the error was not estimated: {error}"))
    if errors is None:
        return Estimate(warning=ResultWarning("W45", "the error was not estimated: a small mesh of this scene does not converge"))
    estimated = error_bound_percent(errors)
    warning = None
    if estimated > percent:
        text = f"the error is estimated at {estimated:.2g} %, more than the {percent:g} % asked for"
        warning = ResultWarning("W46", text)
    return Estimate(estimated / 100.0, errors.active_percent, errors.tension, errors.contact_force, errors.stress, warning)
