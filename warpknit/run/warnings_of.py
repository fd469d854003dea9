"""What the user should know about a result: the warnings of summary.json and of the table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ..measure import MeshModel
from ..text import engineering
from .cautions import cautions
from .history import Row

STEEP = 0.3  # slope from which its square is no longer small
LEVELS_FOLLOWED = 4  # of a stage: with fewer the work along them is too rough to tell of a snap
SHORTER = -0.005  # strain imposed on a mesh from which it is compressed; under a tension it only contracts
UNEVEN = 0.25  # by which the median of a panel may miss the tension that its edges are pulled by
STRAIN_JUMP = 0.06  # between two recorded states of a relaxation: worth a warning
UNBALANCED = 0.05  # of the most that was stored, by which work and stored energy may differ

Stages = Sequence[dict[str, Any]]


def warnings_of(model: MeshModel, rows: Sequence[Row], stages: Stages) -> list[str]:
    """A line each; `rows` are those of history.csv, `stages` those of summary.json."""
    return [
        *model.panel.notes,
        *_overstressed(model, rows, stages),
        *_compressed(model, rows),
        *cautions(model, list(rows)),
        *model.warnings(stages),
        *_unevenly_pulled(model, stages),
        *_out_of_reach(stages),
        *_pressed_as_knitted(rows),
        *_lost_contact([row for row in rows if row.is_hook]),
        *_jumped(model, rows),
        *_snapped(model, stages),
    ]


def _overstressed(model: MeshModel, rows: Sequence[Row], stages: Stages) -> Iterator[str]:
    wire = model.scene.wire
    largest = max((row.stress_max_Pa for row in rows), default=0.0)
    interior = max((stage["wire"]["stress_interior_max_Pa"] for stage in stages), default=largest)
    is_gripped = model.scene.hook is not None or model.scene.model.boundary == "gripped"
    where = f" (away from the grips {engineering(interior, 'Pa')})" if is_gripped and interior < 0.95 * largest else ""
    law = "the result has it yield in bending and never break" if wire.plastic else "the result is elastic"
    stressed = f"a wire is stressed to {engineering(largest, 'Pa')}{where}, beyond its"
    if largest > wire.tensile_strength:
        yield f"{stressed} strength of {engineering(wire.tensile_strength, 'Pa')}: it would break; {law}"
    elif largest > wire.yield_stress:
        keeps = "keeps" if wire.plastic else "would keep"
        yield f"{stressed} elastic limit of {engineering(wire.yield_stress, 'Pa')}: it {keeps} a set; {law}"


def _compressed(model: MeshModel, rows: Sequence[Row]) -> Iterator[str]:
    for row in rows:
        imposed = ~_driven_by_tension(model, row.stage)
        if np.any(imposed & (np.array([row.strain_weft, row.strain_warp]) < SHORTER)):
            yield f"the mesh is compressed: a real one would {model.when_compressed}"
            return


def _unevenly_pulled(model: MeshModel, stages: Stages) -> Iterator[str]:
    """Whether most of a panel carries what its edges are pulled by."""
    left_out = max((stage["quality"]["membrane_left_out"] for stage in stages), default=0.0)
    if left_out > 0.0:
        yield f"the mesh is slack or uneven: over many repeats its stress may be {left_out:.1%} of the tension out of balance"
    for stage in stages:
        asked = _driven_by_tension(model, stage["name"])
        median = [stage.get("panel", {}).get(f"tension_median_{side}_N_per_m") for side in ("weft", "warp")]
        mean = [stage["mesh"][f"tension_{side}_N_per_m"] for side in ("weft", "warp")]
        apart = [m is not None and abs(m - t) > UNEVEN * abs(t) for m, t in zip(median, mean, strict=True)]
        if np.any(asked & np.array(apart)):
            there = " / ".join(engineering(m, "N/m") for m in median)
            yield (
                f"the edges are pulled as asked, but half of the panel carries less than {there} in weft / warp: short wires"
                " between grips carry more than their share; a larger piece, or boundary = 'periodic', says more of the mesh"
            )
            return


def _out_of_reach(stages: Stages) -> Iterator[str]:
    steep = max((stage.get("panel", {}).get("surface", {}).get("slope_max", 0.0) for stage in stages), default=0.0)
    if steep > STEEP:
        yield f"the paraboloid is as steep as {steep:.2g} at the edge of the panel: its shape is worked out for small slopes"
    ends = max((stage["contacts"]["at_reach_end"] for stage in stages), default=0)
    if ends:
        yield f"{ends} active contacts have slid as far along their wire as the model follows: never trust their forces"


def _pressed_as_knitted(rows: Sequence[Row]) -> Iterator[str]:
    if rows and rows[0].active_pairs:
        yield (
            f"as knitted {rows[0].active_pairs} pairs press already, with {rows[0].tension_weft_N_per_m:.2g} N/m in weft and"
            f" {rows[0].tension_warp_N_per_m:.2g} N/m in warp at no strain: the yarn is thicker than the loops leave room for"
        )


def _lost_contact(rows: Sequence[Row]) -> Iterator[str]:
    """Whether two hooked wires have come apart."""
    force = [min(row.force_left_N, row.force_right_N) for row in rows]
    if not force or force[-1] > 0.0 or max(force) == 0.0:
        return
    most = int(np.argmax(force))
    where = f"the wires have lost each other after {engineering(rows[most].displacement_m, 'm')}"
    yield f"{where}, where they pressed with {engineering(force[most], 'N')}: the contact has slid off its target"


def _jumped(model: MeshModel, rows: Sequence[Row]) -> Iterator[str]:
    if model.scene.solver.drive != "relax":
        return
    for a, b in zip(rows, rows[1:], strict=False):
        by_tension = _driven_by_tension(model, b.stage)
        jump = float(np.max(np.abs([b.strain_weft - a.strain_weft, b.strain_warp - a.strain_warp]) * by_tension))
        if jump > STRAIN_JUMP:
            yield (
                f"the mesh jumps by {jump:.1%} strain between loads {a.load_factor:.3g} and {b.load_factor:.3g} of stage"
                f" {b.stage!r}: slack was taken up, or more than one state carries such a load and which is found depends on"
                " the way there"
            )
            return


def _snapped(model: MeshModel, stages: Stages) -> Iterator[str]:
    followed = model.scene.output.frames >= LEVELS_FOLLOWED or model.scene.solver.drive == "ramp"
    if stages and followed and abs(stages[-1]["quality"]["energy_balance_of_stored"]) > UNBALANCED:
        yield (
            f"work and stored energy differ by {stages[-1]['quality']['energy_balance_of_stored']:.0%} of the most that was"
            " stored: the mesh snapped between recorded states, or output.frames is too small to follow it"
        )


def _driven_by_tension(model: MeshModel, name: str) -> np.ndarray:
    """(2,) whether a stage drives weft and warp by tension: what they are strained by is the mesh's own then."""
    stage = next(stage for stage in model.scene.stages if stage.name == name)
    return np.array(stage.by_tension)
