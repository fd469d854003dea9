"""Measures: pure functions of the observables of a state, the same for both models.

    record = list(Simulation(build_model(scene)).run())[-1]
    state = record.observables
    measure.mesh_tension(state)                              # weft, warp [N/m], force per current width
    measure.contacts(state).active_percent                   # [%] of the pairs
    measure.stress_extremes(state)                           # largest and 99 % stress [Pa], share of wire above the yield stress
    measure.energies(state).stored                           # [J]

`record.observables` belong to a recorded state; `planar.observables.read(model, state)` evaluates any state.
`measure.table.values(state, names)` has measures by the names of the columns of history.csv.
"""

from .measures import (
    Contacts,
    active_forces,
    active_threshold,
    areal_mass,
    axial_strain,
    boundary_stress,
    clamp_couple,
    contact_stress,
    contacts,
    energies,
    energy_scale,
    exceeded_stress,
    force_scale,
    fragment_tension,
    frame,
    hardened_energy,
    interior_stress,
    largest_contact_force,
    largest_stress,
    least_force,
    mean_boundary_force,
    mesh_tension,
    nominal_stress,
    pair_active,
    pairs_at_reach_end,
    penetration,
    plastic_extremes,
    positions,
    residual,
    rhombus_contacts,
    section,
    slid,
    stress_extremes,
    tension_scale,
    thermal_force,
    wire_stress,
    yield_share,
)
from .observables import Energies, MeshModel, Observables, WireStress
from .strain import clamp_rotation, couple_of, rotation, stretch, true_stress

__all__ = [
    "Contacts",
    "Energies",
    "MeshModel",
    "Observables",
    "WireStress",
    "active_forces",
    "active_threshold",
    "areal_mass",
    "axial_strain",
    "boundary_stress",
    "clamp_couple",
    "clamp_rotation",
    "contact_stress",
    "contacts",
    "couple_of",
    "energies",
    "energy_scale",
    "exceeded_stress",
    "force_scale",
    "fragment_tension",
    "frame",
    "hardened_energy",
    "interior_stress",
    "largest_contact_force",
    "largest_stress",
    "least_force",
    "mean_boundary_force",
    "mesh_tension",
    "nominal_stress",
    "pair_active",
    "pairs_at_reach_end",
    "penetration",
    "plastic_extremes",
    "positions",
    "residual",
    "rhombus_contacts",
    "rotation",
    "section",
    "slid",
    "stress_extremes",
    "stretch",
    "tension_scale",
    "thermal_force",
    "true_stress",
    "wire_stress",
    "yield_share",
]
