"""Answers to a designer's questions from the rows of a run: at which tension contacts close and the wire yields, what heat does,
which tension is best and how far it may drift.

Closings are found in closings.py, the best tension in best_tension.py. Tensions are known to a tolerance: smaller ones are zero.

Keys. A state has `strain_weft`, `strain_warp`, `tension_weft_N_per_m`, `tension_warp_N_per_m` and `temperature_K`.

    contacts                          classes of contact: `name`, `pairs`, `active_percent` at the end, and `closes`; null if
                                      they stay open
    contacts[].closes                 the state where half of the pairs carry more than the threshold, its `stage`, the records
                                      `between`
    contacts[].closes.resolved        false where the forces give no place between two records: the state is
                                      halfway, or the record behind where the mesh jumps or takes up slack
    contacts[].closes.jump            true where the mesh jumps to another equilibrium between them
    contacts[].closes.slack           true where the mesh strains freely for most of the way between them
    contacts[].closes.as_knitted      true where the class is closed in the first record
    contacts[].closes.closed_percent  share of its pairs that are closed in the second record of `between`
    contacts[].closes.first_touch     the record in which a class was closed before, and opened again; null without one
    contacts[].closes.opens           the record behind in which less than half of its pairs are closed, with its `stage`; null
                                      without one
    contacts[].closed                 the ranges of records in which the class is closed: the state `from` which and `to` which,
                                      each with its `stage`; more than one where it opened again, empty where it stays open
    contacts[].closed[].closed_percent  largest share of its pairs that are closed in the range
    contacts[].closed[].lasts         true where the last record is in the range
    service                           `tension_N_per_m` with `active_percent` and the `state` where the mean of weft and warp
                                      first reaches it, and one more for each later stage that passes it, as on unloading; `why`
                                      there is none, or what limits it
    service[].stage                   the stage of this state; null without one
    service[].resolved                false where a class closes, or on unloading opens, at an unknown tension between the same
                                      two records, so that the share is unknown
    service[].between                 then these two records, each with `active_percent`; null otherwise
    service[].jump                    the records on both sides where the mesh jumps to another equilibrium at this tension,
                                      each with `active_percent`, in place of a state; null without one
    first_yield                       the state where the largest stress `stress_max_Pa` reaches the yield stress, the records
                                      `between`, and the place in the second of them; null if not
    first_yield.resolved              false where the mesh jumps, or takes up slack, between them: the state and its stress are
                                      those of the record behind
    first_yield.jump                  true where the mesh jumps to another equilibrium between them
    first_yield.slack                 true where the mesh strains freely for most of the way between them
    first_yield.as_knitted            true where the stress of the first record is above the yield stress
    first_yield_interior              the same away from the grips, which clamp wires twice; without a place
    largest_stress                    the largest stress of the run, and its place
    largest_tension                   the state of the largest tension
    asked_tension_N_per_m             largest mean tension of weft and warp that a stage asks for; null without a stage by tension
                                      in both
    tension_tolerance_N_per_m         smaller tensions are zero within the tolerance of the equilibria
    tension_error_percent             known error of tensions at the preset: of tight knits against the reference preset, at nine
                                      of ten loads; else that of the double atlas mesh; null where it is not known
    heat                              each stage that changes the temperature alone: values at its begin and end
    heat[].held                       what it holds in weft and warp, `tension` or `strain` each
    heat[].peak                       largest stress of its records, and the temperature there
    heat[].jump                       true where the mesh jumps to another equilibrium in the stage: between records of `jumps`
    heat[].jump_between               the records on both sides of the first of these jumps; null without one
    best                              the state in the middle of the widest range of tension with the most active contacts, up to
                                      first yield, with the largest stress, both away from the grips; what a single record alone
                                      shows does not count. Stages that go on loading at one temperature count as one; one that
                                      changes the temperature under a held tension does not count
    best.stress_with_grips_Pa         the largest stress of this state, at the grips as well
    best.stress_over_limit            the stress away from the grips over the elastic limit
    best.first_yield_over_tension     mean tension of first yield away from the grips over that of this state; null where the wire
                                      does not yield, at an unknown tension, a smaller one, or at another temperature
    best.next_jump                    the states on both sides of the first snap-through at a larger tension, up to first yield;
                                      null without one
    best.stage                        the stage of this state
    best.stages                       number of stages among the records up to first yield, all of which are searched
    best.low                          the lower end of this range, in which at most one percentage point of contacts opens along
                                      the load; that of `best` where the range is a single record
    best.high                         the upper end
    best.low_between                  the records on both sides of the lower end, where contacts close or open between them at an
                                      unknown tension; null where it is known, or the records end there
    best.low_jump                     true where the mesh jumps to another equilibrium between them
    best.high_between                 the same of the upper end
    best.high_jump                    the same of the upper end
    best.jumps                        the states on both sides of each jump to another equilibrium within the range
    best.open_low                     true where the records begin there
    best.open_high                    true where the records end there
    best.grows                        true where no record but the last is known to be in the range: the state is the last one
                                      then
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from .. import measure
from ..measure import MeshModel
from ..measure.contact_classes import classes_of
from ..mesh.tight_loops import tension_error
from ..scene import Stage
from ..solve.tension import TOLERANCE
from .best_tension import best_tension, margin
from .branches import Jump, is_heated
from .closings import STATE, Answer, closed_ranges, closing, is_jump, service_shares, state_between, state_of, takes_up_slack
from .history import Row, mean_tension, stages_of

SERVICE_TENSIONS = (2.0, 3.4, 4.9)  # [N/m] of meshes in orbit (VSOP-2, ASP Conf. Ser. 402, 66)
HEATED = (*STATE, "active_percent", "stress_max_Pa")
PEAK = ("stress_max_part", "stress_max_wire", "stress_max_node", "stress_max_x_m", "stress_max_y_m")
ZERO_TENSION = 0.01  # of EI/C^3: tensions of loose meshes are found to the residual tolerance of this (solve/tension.py)


def answers_of(model: MeshModel, rows: Sequence[Row], jumps: Sequence[Jump] = ()) -> Answer | None:
    """The section `answers` of summary.json, in SI units; None of two hooked wires, which have no tension.

    jumps: neighbouring rows of different branches of equilibria (branches.py); no state is interpolated between them.
    """
    if not rows or model.scene.hook is not None:
        return None
    classes = classes_of(model)
    threshold = measure.active_threshold(model)
    first_yield = _first_yield(model, rows, jumps)
    top = max(rows, key=mean_tension)
    given = model.scene.output.service_tension
    wanted = SERVICE_TENSIONS if given is None else (given,)
    error = max(TOLERANCE, model.scene.solver.residual_tolerance)
    asked = _asked_tension(model.scene.stages)
    limit = model.scene.wire.yield_stress
    inner, inner_jumps = _away_from_grips(rows, jumps)
    inner_yield = _first_yield(model, inner, inner_jumps)
    if inner_yield is not None:
        inner_yield = {name: value for name, value in inner_yield.items() if name not in PEAK}
    yields = _yielding_record(inner, limit)
    known = inner if yields is None else inner[: yields + 1]  # what is loaded further does not change the best tension
    closings, until = (
        {one.name: closing(rows, one.name, threshold, measure.least_force(model), jumps, end, yields) for one in classes}
        for end in (None, len(known))
    )
    best = best_tension(known, limit, classes, until, inner_jumps)
    service = [one for tension in wanted for one in service_shares(tension, rows, classes, closings, jumps, error)]
    return {
        "contacts": [
            {
                "name": one.name,
                "pairs": one.pairs,
                "active_percent": vars(rows[-1])[f"active_{one.name}_percent"],
                "closes": closings[one.name],
                "closed": closed_ranges(rows, one.name, threshold),
            }
            for one in classes
        ],
        "service": [
            one for one in service if given is not None or one["state"] or one["jump"] or one["tension_N_per_m"] <= (asked or 0.0)
        ],
        "first_yield": first_yield,
        "first_yield_interior": inner_yield,
        "largest_stress": _peak(max(rows, key=lambda row: row.stress_max_Pa)),
        "largest_tension": state_of(top),
        "asked_tension_N_per_m": asked,
        "tension_tolerance_N_per_m": ZERO_TENSION * model.scene.solver.residual_tolerance * measure.tension_scale(model),
        "tension_error_percent": tension_error(model.scene),
        "heat": heat_of(rows, model.scene.stages, jumps),
        "best": None if best is None else best | margin(best, limit, inner_yield),
    }


def _away_from_grips(rows: Sequence[Row], jumps: Sequence[Jump]) -> tuple[Sequence[Row], Sequence[Jump]]:
    """The rows, and the pairs of them between which the mesh jumps, with the largest stress away from the grips.

    `stress_with_grips_Pa`: that at the grips as well.
    """
    inner = {}
    for row in rows:
        away = vars(row).get("stress_interior_max_Pa", row.stress_max_Pa)
        inner[id(row)] = Row(**vars(row) | {"stress_max_Pa": away, "stress_with_grips_Pa": row.stress_max_Pa})
    return [inner[id(row)] for row in rows], [(inner[id(one)], inner[id(other)]) for one, other in jumps]


def _asked_tension(stages: Sequence[Stage]) -> float | None:
    """[N/m] the largest mean tension of stages that give both tensions; None without one."""
    both = [(stage.tension_weft, stage.tension_warp) for stage in stages if all(stage.by_tension)]
    return max((0.5 * ((weft or 0.0) + (warp or 0.0)) for weft, warp in both), default=None)


def _peak(row: Row) -> Answer:
    """Where the stress is largest, and how large."""
    return {"stress_max_Pa": row.stress_max_Pa} | {name: vars(row).get(name) for name in PEAK}


def _yielding_record(rows: Sequence[Row], limit: float) -> int | None:
    """The first record with a stress above the elastic limit [Pa]."""
    return next((k for k, row in enumerate(rows) if row.stress_max_Pa > limit), None)


def _first_yield(model: MeshModel, rows: Sequence[Row], jumps: Sequence[Jump]) -> Answer | None:
    """The state in which the largest stress first reaches the elastic limit, and the place; None if it does not."""
    limit = model.scene.wire.yield_stress
    k = _yielding_record(rows, limit)
    if k is None:
        return None
    before, after = rows[max(k - 1, 0)], rows[k]
    found = {
        "stage": after.stage, "as_knitted": k == 0, "jump": is_jump(before, after, jumps),
        "slack": k > 0 and takes_up_slack(before, after), "between": [state_of(before), state_of(after)],
    }  # fmt: skip
    found |= _peak(after) | {"resolved": not found["jump"] and not found["slack"]}
    if k == 0 or not found["resolved"]:
        return state_of(after) | found
    share = (limit - before.stress_max_Pa) / (after.stress_max_Pa - before.stress_max_Pa)
    return state_between(before, after, share) | found | {"stress_max_Pa": limit}


def heat_of(rows: Sequence[Row], stages: Sequence[Stage], jumps: Sequence[Jump]) -> list[Answer]:
    """Stages that change the temperature, and hold strain or tension in either direction: values at begin and end."""
    by_tension = {stage.name: stage.by_tension for stage in stages}
    return [_heated(part, by_tension[part[-1].stage], jumps) for part in stages_of(rows) if is_heated(part)]


def _heated(part: Sequence[Row], by_tension: Sequence[bool], jumps: Sequence[Jump]) -> Answer:
    """The answer of one stage, from the record before it on."""
    peak = max(part, key=lambda row: row.stress_max_Pa)
    jump = next((both for both in pairwise(part) if is_jump(*both, jumps)), None)
    return {
        "stage": part[-1].stage, "held": ["tension" if one else "strain" for one in by_tension],
        **{name: [vars(row)[name] for row in (part[0], part[-1])] for name in HEATED},
        "peak": {"stress_max_Pa": peak.stress_max_Pa, "temperature_K": peak.temperature_K},
        "jump": jump is not None,
        "jump_between": None if jump is None else [state_of(row) for row in jump],
    }  # fmt: skip
