"""summary.json: what a run found, in SI units (the keys are fixed, see docs/scenes.md)."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from .. import __version__, measure
from ..measure.sliding import wires_slid
from ..planar.model import Model
from ..scene.presets import PRESETS
from ..solve.simulate import Record
from .history import HookRow, Row
from .warnings_of import warnings_of

STORED_FLOOR = 1e-5  # of EI/W a loop: less counts as no stored energy


def stage_summary(record: Record, rows: list[Row], panel: dict[str, Any] | None = None) -> dict[str, Any]:
    """Contacts, wire, mesh and quality of the state at the end of a stage; `rows` are all rows up to it, `panel` what is said
    of a panel as a whole."""
    r = record.observables
    model = r.model
    contact = measure.contacts(r)
    rhombus = measure.contacts(r, model.panel.rhombus_bodies)
    force = r.pair_force[measure.pair_active(r)]
    largest, high, above = measure.stress_extremes(r)
    tension = measure.mesh_tension(r)
    plastic = measure.plastic_extremes(r)
    f = r.stretch
    return (
        hook_part(rows[-1])
        | {
            "name": record.stage,
            "quality": {
                "kinetic_to_internal": kinetic_to_internal(rows, model),
                "energy_balance": energy_balance(rows, model),
                "energy_balance_of_stored": energy_balance_of_stored(rows, model),
                "residual": measure.residual(r),
                "membrane_left_out": record.left_out,
                "penetration_max": max(row.penetration for row in rows),
            },
            "contacts": {
                "pairs": contact.pairs,
                "active": contact.active,
                "active_percent": contact.active_percent,
                "bodies": contact.bodies,
                "active_bodies": contact.active_bodies,
                "at_reach_end": measure.pairs_at_reach_end(r),
                "force_max_N": float(force.max(initial=0.0)),
                "force_mean_N": float(force.mean()) if len(force) else 0.0,
                "threshold_N": measure.active_threshold(model),
                "central_rhombus": {
                    "bodies": rhombus.bodies,
                    "pairs": rhombus.pairs,
                    "active": rhombus.active,
                    "active_percent": rhombus.active_percent if rhombus.bodies else None,
                },
            },
            "wire": {
                "stress_max_Pa": largest,
                "stress_p99_Pa": high,
                "stress_interior_max_Pa": measure.interior_stress(r),
                "stress_max_so_far_Pa": max(row.stress_max_Pa for row in rows),
                "yield_stress_Pa": model.scene.wire.yield_stress,
                "yield_fraction": above,
                "plastic_fraction": plastic[0],
                "plastic_strain_max": plastic[1],
                "axial_strain_max": float(np.max(np.abs(measure.axial_strain(r)))),
                "slid_max_m": wires_slid(r.u, model.panel.wire_first) if model.panel.boundary == "periodic" else 0.0,
            },
            "mesh": {
                "tension_weft_N_per_m": tension[0],
                "tension_warp_N_per_m": tension[1],
                "strain_weft": float(f[0, 0] - 1.0),
                "strain_warp": float(f[1, 1] - 1.0),
                "shear": float(f[0, 1]),
                "clamp_rotation_rad": r.clamp_rotation,
                "temperature_K": record.temperature,
                "areal_mass_kg_per_m2": measure.areal_mass(r),
            },
        }
        | ({} if panel is None else {"panel": panel})
    )


def hook_part(row: Row) -> dict[str, Any]:
    """What the last row says of two hooked wires, by the names of its columns; nothing of a mesh."""
    if not isinstance(row, HookRow):
        return {}
    return {"hook": {field.name: getattr(row, field.name) for field in fields(HookRow)[len(fields(Row)) :]}}


def kinetic_to_internal(rows: list[Row], model: Model) -> float:
    """Largest kinetic over stored energy of the states that count: steady ones, or a ramp's after a tenth of its load."""
    counted = [row for row in rows if (row.steady or row.load_factor > 0.1) and row.stored > 0.0 and row.load_factor > 0.0]
    floor = 1e-12 * measure.energy_scale(model)
    return max((row.energy_kinetic_J / max(row.stored, floor) for row in counted), default=0.0)


def energy_balance(rows: list[Row], model: Model) -> float:
    """Work in less stored, dissipated and kinetic energy of the last row, over the larger of stored and EI/W a loop.

    What the damping of a ramp took out is on the books; a relaxation works along steady states, where it takes out nothing.
    """
    return _missing_work(rows, model) / max(rows[-1].stored, measure.energy_scale(model))


def energy_balance_of_stored(rows: list[Row], model: Model) -> float:
    """The same over the most energy that was stored so far; 0 where next to none was."""
    most = max(row.stored for row in rows)
    least = STORED_FLOOR * measure.energy_scale(model)
    return _missing_work(rows, model) / most if most > least else 0.0


def _missing_work(rows: list[Row], model: Model) -> float:
    last = rows[-1]
    kinetic = last.energy_kinetic_J if model.scene.solver.drive == "ramp" else 0.0
    return last.work_J - last.stored - last.dissipated_J - kinetic


@dataclass(frozen=True)
class Estimate:
    """How far the last state of a run may be from the true one, by what it was estimated with."""

    error: float | None  # the largest of the four below, all relative; None where none could be made
    active_percent: float | None = None  # points of percent
    tension: float | None = None
    contact_force: float | None = None
    stress: float | None = None
    warning: str = ""


def run_summary(
    model: Model,
    rows: list[Row],
    stages: list[dict[str, Any]],
    *,
    stop_reason: str,
    wall: float,
    compile_time: float,
    steps: int,
    message: str = "",
    estimate: Estimate | None = None,
) -> dict[str, Any]:
    """The whole of summary.json; the last stage's values stand at the top."""
    estimate = estimate or Estimate(None)
    scene, panel = model.scene, model.panel
    last = {key: value for key, value in stages[-1].items() if key != "name"} if stages else {}
    if "quality" in last:
        last["quality"] = {**last["quality"], "estimated_error": estimate.error, "estimated_errors": {
            "active_percent": estimate.active_percent, "tension": estimate.tension,
            "contact_force": estimate.contact_force, "stress": estimate.stress,
        }}  # fmt: skip
    return {
        "scene": {"name": scene.name, "hash": scene.hash},
        "version": __version__,
        "device": model.device,
        "stop_reason": stop_reason,
        "message": message,
        "warnings": [*warnings_of(model, rows, stages), *([estimate.warning] if estimate.warning else [])],
        "model": {
            "kind": scene.model.kind,
            "boundary": scene.model.boundary,
            "precision": model.precision.name,
            "wires": len(panel.wire_first),
            "nodes": panel.node_count,
            "repeats": list(scene.knit.repeats),
            "bodies": panel.body_count,
            "pairs": model.pair_count,
            "rest_curve_error": model.curve_error / scene.wire.diameter,
        },
        "solver": {
            "time_step_s": model.time_step,
            "steps": steps,
            "wall_s": wall,
            "compile_s": compile_time,
            "ranks": model.ranks.count,
            "node_steps_per_s": steps * panel.node_count / wall if wall > 0 else 0.0,
            "mass_scaling": 1.0 + model.added_mass,
            "axial_softening": model.softening,
            "preset": scene.solver.preset,
            "preset_error_percent": None if scene.preset_in_force is None else PRESETS[scene.preset_in_force].error_percent,
            "drive": scene.solver.drive,
        },
        **last,
        "stages": stages,
    }
