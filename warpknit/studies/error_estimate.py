"""`warpknit run --error PERCENT`: choice of settings, and estimate of the error of the run."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass

from ..errors import Diverged
from ..measure.table import Record
from ..mechanics.trial import Setting, edge_of
from ..runner.summary import Estimate
from ..scene import Scene
from .point import results_of
from .probe_run import ProbeRun, choose_setting, error_bound_percent

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class ErrorBound:
    """Settings chosen for an error of at most `percent`."""

    percent: float
    setting: Setting

    @property
    def overrides(self) -> tuple[tuple[str, object], ...]:
        """Keys of the scene."""
        return self.setting.overrides

    def error_estimator(self, scene: Scene) -> Callable[[Record], Estimate]:
        """A function that estimates the error of a run of `scene` at these settings from its last record."""
        return lambda record: estimate_of(record, scene, self)


def settings_for_error(scene: Scene, percent: float) -> ErrorBound:
    """The cheapest settings within an error of `percent`, by probe runs on a small mesh. Raises `Diverged`."""
    probe = ProbeRun(scene)
    setting, errors = choose_setting(probe, percent)
    what = "segments a wire" if edge_of(scene) == "hook" else "nodes a loop"
    _log.info(
        "%d %s, softening %g, tolerance %g: error of a small mesh of this scene %.2g %% (probe runs: %.2g node-steps)",
        setting.nodes_per_loop, what, setting.axial_softening, setting.residual_tolerance, errors.largest_percent,
        probe.node_steps,
    )  # fmt: skip
    return ErrorBound(percent, setting)


def estimate_of(record: Record, scene: Scene, bound: ErrorBound) -> Estimate:
    """Estimated error of a run from its last record."""
    results = results_of(record.observables)
    try:
        errors = ProbeRun(scene).errors_of_run(results, bound.setting)
    except Diverged as error:
        return Estimate(None, warning=f"the error was not estimated: {error}")
    if errors is None:
        return Estimate(None, warning="the error was not estimated: a small mesh of this scene does not converge")
    estimated = error_bound_percent(errors)
    warning = ""
    if estimated > bound.percent:
        warning = f"the error is estimated at {estimated:.2g} %, more than the {bound.percent:g} % asked for"
    return Estimate(estimated / 100.0, errors.active_percent, errors.tension, errors.contact_force, errors.stress, warning)
