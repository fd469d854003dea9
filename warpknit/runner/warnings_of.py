"""Warnings about a result, for summary.json and the table."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from .. import measure
from ..base.text import celsius, counted, engineering, is_at_grips, percent, short_percent, sides_text
from ..measure import MeshModel
from ..measure.jumps import UNBALANCED
from ..results.finding import ResultWarning
from ..results.row import Row
from .answers import zero_tension
from .branches import jumps_of, tensions_text
from .cautions import cut_cautions, ramp_cautions, scene_cautions
from .history import ends_of, missing_steps
from .strength import exceeded_text, limit_text

STEEP = 0.3  # slope above which its square is not small
LEVELS_FOLLOWED = 4  # of a stage: with fewer the work is too inaccurate to detect a snap-through
SHORTER = -0.005 * (1.0 + 1e-9)  # imposed strain below which a mesh counts as compressed: 0.5 %, beyond round-off
PUSHED = -0.03  # of the largest tension: below it, beyond the residual, a direction that is held counts as compressed
PRESTRESS = 0.01  # of the largest tension: less at zero load is not reported
CARRIED = 0.2  # of the tension, by wires of less than a loop
TAUT = 3.0  # largest stress over that away from the grips, of wires that are taut between two grips
CLOSED = -0.1  # strain under tension below which the release of the wires counts as closing the knit
EVEN_LOAD = 0.5  # least tension there over the largest, as a larger one across contracts a mesh too
UNEVEN = 0.25  # relative difference between the median tension of a panel and the mean at its edges


def warnings_of(model: MeshModel, rows: Sequence[Row]) -> list[ResultWarning]:
    """Warnings from the rows of a run, beside the model's."""
    stages = ends_of(rows)
    short_wires = [*_taut_between_grips(model, stages)]
    return [
        *model.panel.warnings,
        *_overstressed(model, rows, stages),
        *(short_wires or cut_cautions(model)),
        *_compressed(model, rows),
        *scene_cautions(model.scene, model.cloth),
        *(ramp_cautions(rows) if rows and model.scene.solver.drive == "ramp" else []),
        *_about_stages(stages),
        *([] if short_wires else _unevenly_pulled(model, stages)),
        *_contacts_as_knitted(model, rows),
        *_lost_contact([row for row in rows if row.is_hook]),
        *_changed_branch(model, rows),
        *_unbalanced(model, rows, stages),
    ]


def _overstressed(model: MeshModel, rows: Sequence[Row], stages: Sequence[Row]) -> Iterator[ResultWarning]:
    if not rows:
        return
    wire, most = model.scene.wire, max(rows, key=lambda row: row.stress_max_Pa)
    largest = most.stress_max_Pa
    if exceeded := exceeded_text(model.scene, largest):
        interior = max((end.stress_interior_max_Pa for end in stages), default=largest)
        is_gripped = model.scene.hook is not None or model.scene.model.boundary == "gripped"
        where = f"; away from the grips {engineering(interior, 'Pa')}" if is_gripped and is_at_grips(interior, largest) else ""
        yields = largest <= wire.tensile_strength
        plastic = f"; {_yielding(stages)}" if yields and wire.plastic else ""
        step = f" in '{most.stage}'" if len(stages) > 1 else ""
        text = f"The largest wire stress, {engineering(largest, 'Pa')}{step}, is {exceeded}{where}{plastic}."
        elastic = "Set wire.plastic = true to compute the permanent set, or reduce the load."
        yield ResultWarning("W04", text, elastic if yields and not wire.plastic else None)


def _taut_between_grips(model: MeshModel, stages: Sequence[Row]) -> Iterator[ResultWarning]:
    """Warning on short wires between grips: with the largest stress, or much tension."""
    is_short = measure.short_wires(model)
    if not stages or not is_short.any():
        return
    end = stages[-1]
    largest, interior = end.stress_max_Pa, end.stress_interior_max_Pa
    sides = {side: fragment_share(end, side) for side in ("weft", "warp")}
    carried = " and ".join(f"{percent(share, 0)} of the {side} tension" for side, share in sides.items() if share > CARRIED)
    is_taut = is_short[end.stress_max_wire] and largest > TAUT * interior
    if not is_taut and not carried:
        return
    found = [f"carry {carried.replace(' tension and', ' and')}"] if carried else []
    if is_taut:
        found.append(f"reach {engineering(largest, 'Pa')} ({engineering(interior, 'Pa')} away from the grips)")
    yield ResultWarning("W05", f"Cut wire ends at the grips {', and '.join(found)}.")


def fragment_share(end: Row, side: str) -> float:
    """Share of the weft or warp tension in short wires between grips."""
    tension, part = end.get(f"tension_{side}_N_per_m") or 0.0, end.get(f"fragment_tension_{side}_N_per_m") or 0.0
    return part / tension if tension > 0.0 else 0.0


def _yielding(stages: Sequence[Row]) -> str:
    share = max((end.plastic_fraction or 0.0 for end in stages), default=0.0)
    if share == 0.0:
        return "it yields in bending alone, which stays below"
    strain = max(end.plastic_strain_max or 0.0 for end in stages)
    return f"{short_percent(share)} of the wire yields in bending, to a plastic strain of {short_percent(strain)}"


def _compressed(model: MeshModel, rows: Sequence[Row]) -> Iterator[ResultWarning]:
    tensions = [np.zeros(2) if row.is_hook else np.array(row.tension) for row in rows]
    largest = max((float(np.abs(tension).max()) for tension in tensions), default=0.0)
    pushing = min(PUSHED * largest, -zero_tension(model))
    for row, tension in zip(rows, tensions, strict=True):
        imposed = ~_driven_by_tension(model, row.stage)
        if np.any(imposed & (np.array([row.strain_weft, row.strain_warp]) < SHORTER)):
            yield ResultWarning("W06", f"The mesh is compressed, where a real mesh would {model.when_compressed}.")
            return
        pushed = imposed & (tension < pushing)
        if model.scene.solver.drive == "relax" and np.any(pushed):  # the tension of a ramp has inertia in it
            sides = " and ".join(side for side, is_pushed in zip(("weft", "warp"), pushed, strict=True) if is_pushed)
            text = f"The mesh pushes along {sides} ({sides_text(tension.tolist(), 'N/m')}), where a real mesh would"
            yield ResultWarning("W07", f"{text} {model.when_compressed}.")
            return


def _about_stages(stages: Sequence[Row]) -> Iterator[ResultWarning]:
    surfaces = [(end.get("panel") or {}).get("surface", {}) for end in stages]
    steep = max((surface.get("slope_max", 0.0) for surface in surfaces), default=0.0)
    if steep > STEEP:
        text = f"The slope of the paraboloid reaches {steep:.2g} at the edge; the shape is computed for small slopes."
        yield ResultWarning("W10", text)
    if ends := max((end.at_reach_end for end in stages), default=0):
        text = f"{counted(ends, 'active contact')} at the end of the sliding range: these forces are not valid."
        yield ResultWarning("W11", text)


def _unevenly_pulled(model: MeshModel, stages: Sequence[Row]) -> Iterator[ResultWarning]:
    for end in stages:
        driven, panel = _driven_by_tension(model, end.stage), end.get("panel") or {}
        median: list[Any] = [panel.get(f"tension_median_{side}_N_per_m") for side in ("weft", "warp")]
        uneven = [m is not None and abs(m - t) > UNEVEN * abs(t) for m, t in zip(median, end.tension, strict=True)]
        if np.any(driven & np.array(uneven)):
            text = f"The edges carry the given tension. Half of the panel carries less than {sides_text(median, 'N/m')}."
            yield ResultWarning("W09", text)
            return


def _contacts_as_knitted(model: MeshModel, rows: Sequence[Row]) -> Iterator[ResultWarning]:
    """Warning on the mesh before any load: released by `wire.set_fraction`, prestressed, or with active contacts."""
    if not rows:
        return
    scene, first = model.scene, rows[0]
    wire, stress = scene.wire, engineering(first.stress_max_Pa, "Pa")
    is_released = wire.set_fraction != 1.0 and first.load_factor == 0.0 and first.steady
    breaks, closed = is_released and first.stress_max_Pa > wire.tensile_strength, _contraction(model, rows) if is_released else ""
    if breaks or closed:
        above = f", above the {limit_text(scene, 'tensile_strength')}" if breaks else ""
        least = math.ceil(100.0 * (1.0 - (1.0 - wire.set_fraction) * wire.yield_stress / first.stress_max_Pa)) / 100.0
        text = f"wire.set_fraction = {wire.set_fraction:g} stresses the wire to {stress} before any load{above}{closed}."
        advice = f"Set wire.set_fraction = {least:g} or more." if least > wire.set_fraction else None
        yield ResultWarning("W12", text, advice)
    elif scene.wires is not None:
        largest = max(abs(one) for row in rows for one in row.tension)
        if first.load_factor == 0.0 and max(map(abs, first.tension)) > max(PRESTRESS * largest, zero_tension(model)):
            text = f"The mesh is prestressed before loading: {sides_text(first.tension, 'N/m')}, wire stress {stress}."
            yield ResultWarning("W13", text)
    elif first.active_pairs:
        tension, active = sides_text(first.tension, "N/m"), counted(first.active_pairs, "active pair")
        text = f"The mesh as knitted has {active}, with {tension} at zero strain."
        yield ResultWarning("W14", text, "Raise wire.set_fraction." if wire.set_fraction < 1.0 else None)


def _contraction(model: MeshModel, rows: Sequence[Row]) -> str:
    """Shortening of the mesh under its first tension, in words; empty below CLOSED."""
    if len(rows) < 2 or rows[1].is_hook:
        return ""
    row = rows[1]
    strain, tension = np.array([row.strain_weft, row.strain_warp]), np.array(row.tension)
    shorter = _driven_by_tension(model, row.stage) & (strain < CLOSED) & (tension > EVEN_LOAD * tension.max())
    sides = [
        f"{percent(-strain[k])} in {('weft', 'warp')[k]} at {engineering(tension[k], 'N/m')}" for k in np.flatnonzero(shorter)
    ]
    return f", and shortens the mesh by {' and '.join(sides)}" if sides else ""


def _lost_contact(rows: Sequence[Row]) -> Iterator[ResultWarning]:
    force = [min(row.force_left_N, row.force_right_N) for row in rows]
    if not force or force[-1] > 0.0 or max(force) == 0.0:
        return
    largest = int(np.argmax(force))
    where = f"The wires lost contact after {engineering(rows[largest].displacement_m, 'm')}"
    yield ResultWarning("W15", f"{where}, at a contact force of {engineering(force[largest], 'N')}.")


def _changed_branch(model: MeshModel, rows: Sequence[Row]) -> Iterator[ResultWarning]:
    """Warning on the first snap-through between levels, with the number of others; by the rule of maps."""
    if found := jumps_of(model, rows):
        a, b = found[0]
        others = f", and at {counted(len(found) - 1, 'more place')}" if len(found) > 1 else ""
        there = f"mean tension {tensions_text(a, b)}"
        if a.temperature_K != b.temperature_K:
            there = f"{celsius(a.temperature_K)} and {celsius(b.temperature_K)}"
        yield ResultWarning("W18", f"Snap-through to another equilibrium between {_between(a, b)} ({there}){others}.")


def _between(a: Row, b: Row) -> str:
    """Loads of two neighbouring records, as shares of the load step of the second."""
    before = a.load_factor if a.stage == b.stage else 0.0
    return f"{100.0 * before:.3g} % and {100.0 * b.load_factor:.3g} % of {b.stage!r}"


def _unbalanced(model: MeshModel, rows: Sequence[Row], stages: Sequence[Row]) -> Iterator[ResultWarning]:
    """Warning on work that is not stored: with the records around most of it, without slack."""
    balance = stages[-1].get("energy_balance_of_stored", 0.0) if stages else 0.0
    if abs(balance) <= UNBALANCED or model.scene.output.levels < LEVELS_FOLLOWED:
        return
    share = np.array(missing_steps(rows, model)) / max(row.stored for row in rows)
    if abs(share.sum()) > UNBALANCED:
        k = int(np.argmax(np.sign(share.sum()) * share))
        most = f"{percent(share[k], 0)} between {_between(rows[k], rows[k + 1])}"
        text = f"Work and stored energy differ by {percent(share.sum(), 0)} ({most}): a snap-through, or too few load levels."
        yield ResultWarning("W19", text)


def _driven_by_tension(model: MeshModel, name: str) -> np.ndarray:
    """Whether a load step prescribes tension in weft and warp (2,), so that strain follows."""
    stage = next(stage for stage in model.scene.stages if stage.name == name)
    return np.array(stage.by_tension)
