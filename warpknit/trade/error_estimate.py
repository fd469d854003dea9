"""`warpknit run --error PERCENT`: the settings it takes, and the estimate of what the run misses."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass

from ..errors import Diverged
from ..measure.table import Record
from ..run.summary import Estimate
from ..scene import Scene
from ..trial import Setting, edge_of
from .pilot import Pilot, bound_percent, choose_setting
from .point import found_at

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Within:
    """Settings that were chosen to miss no more than `percent`."""

    percent: float
    setting: Setting

    @property
    def overrides(self) -> tuple[tuple[str, object], ...]:
        """Keys of the scene."""
        return self.setting.overrides

    def judge(self, scene: Scene) -> Callable[[Record], Estimate]:
        """What estimates the error of a run of `scene` at these settings from its last record."""
        return lambda record: estimate_of(record, scene, self)


def settings_within(scene: Scene, percent: float) -> Within:
    """The cheapest settings that miss no more than `percent`, tried on a small mesh. Raises `Diverged`."""
    pilot = Pilot(scene)
    setting, errors = choose_setting(pilot, percent)
    what = "segments a wire" if edge_of(scene) == "hook" else "nodes a loop"
    _log.info(
        "%d %s, softening %g, tolerance %g: a small mesh of this scene misses %.2g %% (%.2g node-steps to find out)",
        setting.nodes_per_loop, what, setting.axial_softening, setting.residual_tolerance, errors.largest_percent,
        pilot.node_steps,
    )  # fmt: skip
    return Within(percent, setting)


def estimate_of(record: Record, scene: Scene, within: Within) -> Estimate:
    """The estimated error of a run, all relative but the share, which is in points of percent."""
    found = found_at(record.observables)
    try:
        errors = Pilot(scene).errors_of_run(found, within.setting)
    except Diverged as error:
        return Estimate(None, warning=f"the error was not estimated: {error}")
    if errors is None:
        return Estimate(None, warning="the error was not estimated: a small mesh of this scene does not come to rest")
    bound = bound_percent(errors)
    warning = ""
    if bound > within.percent:
        warning = f"the error is estimated at {bound:.2g} %, more than the {within.percent:g} % asked for"
    return Estimate(bound / 100.0, errors.active_percent, errors.tension, errors.contact_force, errors.stress, warning)
