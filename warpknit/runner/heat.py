"""Heat: what a change of temperature does to contacts, tension, strain and stress."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from ..results.row import Row, Values
from ..scene import Stage
from .branches import STATE, Jump, Rows, is_heated, state_of
from .history import stages_of

HEATED = (*STATE, "active_percent", "stress_max_Pa")


class Heat(Values):
    """Effects of a change of temperature. The values of HEATED are pairs, at begin and end."""

    stage: str
    held: Sequence[str]  # what is constant in weft and in warp: `tension` or `strain`
    peak: Row  # largest stress of its records, and the temperature there
    jump: bool  # whether the load step has a snap-through: between records of `jumps`
    jump_between: Sequence[Row] | None  # the records on both sides of the first of these jumps; null without one


def heat_of(rows: Sequence[Row], stages: Sequence[Stage], jumps: Sequence[Jump]) -> list[Heat]:
    """Stages that change the temperature, and hold strain or tension in either direction: values at begin and end."""
    run, found = Rows(rows, jumps), []
    by_tension = {stage.name: stage.by_tension for stage in stages}
    for part in filter(is_heated, stages_of(rows)):
        peak = max(part, key=lambda row: row.stress_max_Pa)
        jump = next((both for both in pairwise(part) if run.is_jump(*both)), None)
        found.append(Heat(
            stage=part[-1].stage, held=["tension" if one else "strain" for one in by_tension[part[-1].stage]],
            **{name: [row[name] for row in (part[0], part[-1])] for name in HEATED},
            peak=Row(stress_max_Pa=peak.stress_max_Pa, temperature_K=peak.temperature_K),
            jump=jump is not None, jump_between=None if jump is None else [state_of(row) for row in jump],
        ))  # fmt: skip
    return found
