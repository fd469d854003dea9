"""Measures: pure functions of a model and a reading of its state."""

from importlib import import_module
from typing import Any

_PLACE = {
    "Contacts": "planar.measures",
    "Energies": "planar.measures",
    "active_threshold": "planar.measures",
    "areal_mass": "planar.measures",
    "axial_strain": "planar.measures",
    "boundary_stress": "planar.measures",
    "clamp_couple": "planar.measures",
    "clamp_rotation": "measure.strain",
    "contact_stress": "planar.measures",
    "contacts": "planar.measures",
    "couple_of": "measure.strain",
    "edge_force": "planar.measures",
    "energies": "planar.measures",
    "energy_scale": "planar.measures",
    "force_scale": "planar.measures",
    "frame": "planar.measures",
    "friction_energy": "planar.friction",
    "hardened_energy": "planar.measures",
    "held_forces": "planar.measures",
    "interior_stress": "planar.measures",
    "mean_boundary_force": "planar.measures",
    "mesh_tension": "planar.measures",
    "nominal_stress": "planar.measures",
    "pair_active": "planar.measures",
    "pair_levers": "planar.measures",
    "pairs_at_reach_end": "planar.measures",
    "penetration": "planar.measures",
    "plastic_extremes": "planar.measures",
    "positions": "planar.measures",
    "residual": "planar.measures",
    "rotation": "measure.strain",
    "section": "planar.measures",
    "stress_extremes": "planar.measures",
    "stretch": "measure.strain",
    "tension_scale": "planar.measures",
    "thermal_force": "planar.measures",
    "true_stress": "measure.strain",
    "warmth_force": "planar.measures",
    "wire_stress": "planar.measures",
}
__all__ = [*_PLACE]


def __getattr__(name: str) -> Any:
    """Names are imported when they are asked for: models measure themselves with what stands beside this."""
    if name not in _PLACE:
        raise AttributeError(f"module 'warpknit.measure' has no attribute {name!r}")
    return getattr(import_module(f"warpknit.{_PLACE[name]}"), name)
