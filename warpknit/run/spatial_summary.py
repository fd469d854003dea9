"""What a run of the spatial model found: rows of history.csv and summary.json, with the keys of a planar run and a few more."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..measure.sliding import wires_slid
from ..mesh.rim import build_rim
from ..solve.simulate import Record
from ..spatial.hook_contact import hook_contact
from ..spatial.mesh import SpatialMesh
from ..spatial.observables import SpatialObservables
from .history import Row, hook_row
from .panel_report import cord_numbers
from .summary import energy_balance, energy_balance_of_stored, hook_part, kinetic_to_internal, run_summary


def row_of(record: Record) -> Row:
    """What history.csv keeps of a record; `work_J` is filled in by `account_work`, and the way of a hook's contact by
    `account_sliding`."""
    row = _mesh_row(record)
    return row if record.observables.mesh.scene.hook is None else hook_row(row, hook_contact(record.observables))


def _mesh_row(record: Record) -> Row:
    r = record.observables
    f, nominal = r.stretch, r.boundary_stress
    weft, warp = r.mesh_tension
    active, rhombus = r.site_active, r.site_active[r.mesh.panel.rhombus_bodies]
    return Row(
        index=record.index,
        stage=record.stage,
        load_factor=record.load_factor,
        strain_weft=float(f[0, 0] - 1.0),
        strain_warp=float(f[1, 1] - 1.0),
        shear=float(f[0, 1]),
        clamp_rotation=r.clamp_rotation,
        temperature_K=record.temperature,
        active_pairs=2 * int(active.sum()),
        active_percent=_percent(active),
        active_rhombus_percent=_percent(rhombus),
        tension_weft_N_per_m=weft,
        tension_warp_N_per_m=warp,
        stress_max_Pa=float(r.stress.max()),
        contact_force_max_N=float(r.site_force.max(initial=0.0)),
        energy_stretch_J=r.stretch_energy,
        energy_bend_J=r.bend_energy + r.hardened_energy,
        energy_contact_J=r.contact_energy,
        energy_kinetic_J=r.kinetic_energy,
        work_J=record.work or 0.0,
        edge_work_J=record.edge_work,
        dissipated_J=record.dissipated,
        residual=r.residual,
        penetration=r.penetration,
        steps=record.steps,
        steady=record.steady,
        nominal_weft_N_per_m=float(nominal[0, 0]),
        nominal_shear_N_per_m=float(nominal[0, 1]),
        nominal_warp_N_per_m=float(nominal[1, 1]),
        clamp_couple_N_per_m=r.clamp_couple,
        length_factor=r.length_factor,
        thermal_force_J=r.thermal_force,
    )


def stage_summary(record: Record, rows: list[Row]) -> dict[str, Any]:
    """Contacts, wire, mesh and quality of the state at the end of a stage; `rows` are all rows up to it."""
    r = record.observables
    mesh, panel = r.mesh, r.mesh.panel
    wire = mesh.scene.wire
    f = r.stretch
    weft, warp = r.mesh_tension
    stress = r.stress
    force = r.site_force[r.site_active]
    balance = energy_balance(rows, mesh)
    return (
        hook_part(rows[-1])
        | _panel_part(record)
        | {
            "name": record.stage,
            "quality": {
                "kinetic_to_internal": kinetic_to_internal(rows, mesh),
                "energy_balance": balance,
                "energy_balance_of_stored": energy_balance_of_stored(rows, mesh),
                "residual": r.residual,
                "membrane_left_out": 0.0,
                "penetration_max": max(row.penetration for row in rows),
            },
            "contacts": {
                **_counts(r, np.arange(r.sites.count)),
                "at_reach_end": 0,
                "force_max_N": float(force.max(initial=0.0)),
                "force_mean_N": float(force.mean()) if len(force) else 0.0,
                "threshold_N": r.threshold,
                "near_bodies": int(r.site_near.sum()),
                "near_percent": _percent(r.site_near),
                "elsewhere": len(r.elsewhere),
                "elsewhere_force_max_N": float(r.elsewhere.max(initial=0.0)),
                "central_rhombus": _counts(r, panel.rhombus_bodies),
            },
            "wire": {
                "stress_max_Pa": float(stress.max()),
                "stress_p99_Pa": float(np.percentile(stress, 99)),
                "stress_interior_max_Pa": r.interior_stress,
                "stress_max_so_far_Pa": max(row.stress_max_Pa for row in rows),
                "shear_stress_max_Pa": float(r.shear_stress.max()),
                "yield_stress_Pa": wire.yield_stress,
                "yield_fraction": float(np.mean(stress > wire.yield_stress)),
                "plastic_fraction": float(np.mean(r.plastic_strain > 0.0)),
                "plastic_strain_max": float(r.plastic_strain.max()),
                "axial_strain_max": float(np.abs(r.tension).max()) / mesh.rods.section.axial_stiffness,
                "slid_max_m": wires_slid(r.moved, mesh.rods.wire_first) if panel.boundary == "periodic" else 0.0,
            },
            "mesh": {
                "tension_weft_N_per_m": weft,
                "tension_warp_N_per_m": warp,
                "strain_weft": float(f[0, 0] - 1.0),
                "strain_warp": float(f[1, 1] - 1.0),
                "shear": float(f[0, 1]),
                "clamp_rotation_rad": r.clamp_rotation,
                "temperature_K": record.temperature,
                "areal_mass_kg_per_m2": r.areal_mass,
                "thickness_m": float(np.ptp(r.position[:, 2])) + mesh.rods.section.thickness,
            },
        }
    )


def _panel_part(record: Record) -> dict[str, Any]:
    """The edge of a mesh that hangs on cords."""
    mesh = record.observables.mesh
    if mesh.scene.panel.cord is None:
        return {}
    cords = cord_numbers(build_rim(mesh.panel, mesh.scene), record.observables.gradient, record.stations)
    return {"panel": {"outline": mesh.scene.panel.outline, "area_m2": mesh.panel.area} | cords}


def spatial_summary(
    mesh: SpatialMesh, rows: list[Row], stages: list[dict[str, Any]], *, notes: list[str], **how: Any
) -> dict[str, Any]:
    """The whole of summary.json; `how` goes to `run_summary`."""
    summary = run_summary(mesh, rows, stages, **how)  # type: ignore[arg-type]
    nodes, wall = mesh.rods.node_count, summary["solver"]["wall_s"]
    summary["model"]["nodes"] = nodes
    summary["solver"]["node_steps_per_s"] = summary["solver"]["steps"] * nodes / wall if wall > 0 else 0.0
    summary["warnings"] = [*notes, *summary["warnings"]]
    return summary


def _counts(r: SpatialObservables, sites: np.ndarray) -> dict[str, Any]:
    """Active pairs and bodies of some sites; a site has two pairs of equal force."""
    active = r.site_active[sites]
    return {
        "pairs": 2 * len(sites),
        "active": 2 * int(active.sum()),
        "active_percent": _percent(active) if len(sites) else None,
        "bodies": len(sites),
        "active_bodies": int(active.sum()),
    }


def _percent(which: np.ndarray) -> float:
    return 100.0 * float(which.mean()) if len(which) else 0.0
