"""Active contacts at service tensions: where a run passes the tension, the share of both records around."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ..mechanics.driven_strain import TOLERANCE
from ..results.row import Row, Values
from ..scene import Scene, Stage
from .best_tension import DRIFT
from .branches import Jump, Rows, is_heated, row_between, state_of
from .history import mean_tension, stages_of

SERVICE_TENSIONS = (2.0, 3.4, 4.9)  # [N/m] of meshes in orbit (VSOP-2, ASP Conf. Ser. 402, 66)
COMPRESSED = "compressed in weft or warp where the mean tension is this"
SCATTER = 1e-3  # of a mean tension: a smaller one in one direction is about zero


class Service(Values):
    """The share of active contacts at a service tension."""

    tension_N_per_m: float
    active_percent: float | None
    state: Row | None
    resolved: bool  # false where the records on both sides have different shares
    stage: str | None  # load step of this state; null without one
    jump: Sequence[Row] | None  # records on both sides of a snap-through at this tension, in place of a state
    between: Sequence[Row] | None  # records on both sides, each with `active_percent`, where not resolved; null otherwise
    why: str  # why there is no share, or what limits it; left out otherwise


def service_shares(run: Rows, scene: Scene) -> list[Service]:
    """Shares at the service tension of the scene; without one, at those SERVICE_TENSIONS that are reached or asked for."""
    given, asked = scene.output.service_tension, asked_tension(scene.stages)
    wanted = SERVICE_TENSIONS if given is None else (given,)
    error = max(TOLERANCE, scene.solver.residual_tolerance)
    shares = [_share(run, tension, around) for tension in wanted for around in _passages(run.rows, tension, error)]
    return [one for one in shares if given is not None or one.state or one.jump or one.tension_N_per_m <= (asked or 0.0)]


def _passages(rows: Sequence[Row], tension: float, error: float) -> list[Jump | None]:
    """Neighbouring rows between which the mean tension passes `tension` [N/m]: the first in each load step.

    Changes of temperature after the first passage are left out. A row within the `error` of the tension stands twice. Without any
    passage the result is one None.
    """
    slack = error * tension
    passages: list[Jump | None] = [(rows[0], rows[0])] if mean_tension(rows[0]) >= tension - slack else []
    for part in stages_of(rows):
        offsets = [mean_tension(row) - tension for row in part]
        if abs(offsets[0]) <= slack or (passages and is_heated(part)):
            continue  # the first row is the end of the stage before
        side = math.copysign(1.0, offsets[0])
        k = next((k for k, one in enumerate(offsets) if side * one <= slack), None)
        if k is not None:
            passages.append((part[k], part[k]) if abs(offsets[k]) <= slack else (part[k - 1], part[k]))
    return passages or [None]


def _share(run: Rows, tension: float, around: Jump | None) -> Service:
    """The share of active contacts between two rows, or in one given twice; None: tension not reached.

    `resolved`: whether both rows have the same share. Within a jump there is no state.
    """
    point = Service(
        tension_N_per_m=tension, active_percent=None, state=None, resolved=True, stage=around and around[1].stage,
        jump=None, between=None,
    )  # fmt: skip
    if around is None:
        return point
    before, after = around
    ends = [state_of(row, "active_percent") for row in around]
    if run.is_jump(before, after) and tension != mean_tension(after):
        return point.changed(resolved=False, jump=ends)
    there = after
    if before is not after:
        there = row_between(before, after, (tension - mean_tension(before)) / (mean_tension(after) - mean_tension(before)))
    if min(there.tension_weft_N_per_m, there.tension_warp_N_per_m) < -SCATTER * tension:
        return point.changed(why=COMPRESSED)
    if tension != mean_tension(after) and abs(after.active_percent - before.active_percent) > DRIFT:
        return point.changed(state=state_of(there), resolved=False, between=ends)
    return point.changed(state=state_of(there), active_percent=there.active_percent)


def asked_tension(stages: Sequence[Stage]) -> float | None:
    """[N/m] the largest mean tension of stages that give both tensions; None without one."""
    both = [(stage.tension_weft, stage.tension_warp) for stage in stages if all(stage.by_tension)]
    return max((0.5 * ((weft or 0.0) + (warp or 0.0)) for weft, warp in both), default=None)
