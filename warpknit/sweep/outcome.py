"""How a state of a sweep ended, and what is measured of it: the same of the planar and the spatial model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .. import measure
from ..errors import Diverged
from ..planar.observables import PlanarObservables
from ..spatial.observables import SpatialObservables

AnyReading = PlanarObservables | SpatialObservables


@dataclass(frozen=True)
class Outcome:
    """The mesh at rest under a load, or why it is not."""

    index: int  # of the load
    steps: int
    observables: AnyReading | None
    error: Diverged | None


@dataclass(frozen=True)
class Measured:
    """What a mesh carries at rest."""

    nominal_stress: np.ndarray  # (2, 2) [N/m] force per rest width
    tension: tuple[float, float]  # [N/m] weft and warp, force per current width
    thermal_force: float  # [J] derivative of the energy by the length factor of the wires
    areal_mass: float  # [kg/m2]
    active_percent: float  # of the pairs
    active_bodies_percent: float  # bodies both of whose pairs are active; in space, the same as of the pairs
    active_rhombus_percent: float | None  # of the pairs at the central rhombus; None where there is none
    contact_force_max: float  # [N]
    stress_max: float  # [Pa]
    stress_interior_max: float  # [Pa] away from the grips
    yield_fraction: float  # share of the nodes above the yield stress
    residual: float


def measured(r: AnyReading) -> Measured:
    """Measure a reading of either model."""
    if isinstance(r, SpatialObservables):
        return _measured_in_space(r)
    contacts, rhombus = measure.contacts(r), measure.contacts(r, r.model.panel.rhombus_bodies)
    largest, _, above = measure.stress_extremes(r)
    return Measured(
        nominal_stress=measure.nominal_stress(r),
        tension=measure.mesh_tension(r),
        thermal_force=measure.thermal_force(r),
        areal_mass=measure.areal_mass(r),
        active_percent=contacts.active_percent,
        active_bodies_percent=100.0 * contacts.active_bodies / max(1, contacts.bodies),
        active_rhombus_percent=rhombus.active_percent if rhombus.pairs else None,
        contact_force_max=float(r.pair_force.max(initial=0.0)),
        stress_max=largest,
        stress_interior_max=measure.interior_stress(r),
        yield_fraction=above,
        residual=measure.residual(r),
    )


def _measured_in_space(r: SpatialObservables) -> Measured:
    active, stress = r.site_active, r.stress
    rhombus = active[r.mesh.panel.rhombus_bodies]
    share = 100.0 * float(active.mean()) if len(active) else 0.0
    return Measured(
        nominal_stress=r.nominal_stress,
        tension=r.mesh_tension,
        thermal_force=r.thermal_force,
        areal_mass=r.areal_mass,
        active_percent=share,
        active_bodies_percent=share,
        active_rhombus_percent=100.0 * float(rhombus.mean()) if len(rhombus) else None,
        contact_force_max=float(r.site_force.max(initial=0.0)),
        stress_max=float(stress.max()),
        stress_interior_max=r.interior_stress,
        yield_fraction=float(np.mean(stress > r.mesh.scene.wire.yield_stress)),
        residual=r.residual,
    )
