"""Events between two neighbouring load levels, from their observables.

A class of contacts closes or opens, or a contact of two hooked wires. The largest stress passes the elastic limit. The mean
tension passes `output.service_tension`. Or the curve between two levels is unknown: snap-through, end of slack, a large change of
stiffness. Then the mean force f times the displacement x differs from the change of energy,

    | sum 1/2 (f_a + f_b) (x_b - x_a)  -  (E_b - E_a) |  >  UNBALANCED E,      E stored and dissipated energy,

E the energy stored at the end of the stage, extrapolated linearly from both levels.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from .. import measure as m
from .contact_classes import classes_of, median_force
from .jumps import STORED_FLOOR, UNBALANCED
from .observables import Observables


@dataclass(frozen=True)
class Level:
    """Compared values of a load level; all arrays, for checkpoints."""

    share: np.ndarray  # () of the load of the stage
    passed: np.ndarray  # (event,) bool: whether each contact is closed, each stress above the limit, the tension reached
    force: np.ndarray  # (component,) [J]
    place: np.ndarray  # (component,) displacements, whose products with the forces are energies
    stored: np.ndarray  # () [J]
    dissipated: np.ndarray  # () [J] less the work of a moving edge; nan where that work is not known

    @classmethod
    def from_arrays(cls, kept: dict[str, np.ndarray]) -> Level:
        """The level of arrays by the names of its fields."""
        return cls(**{field.name: kept[field.name] for field in fields(cls)})


def level_of(r: Observables, share: float, dissipated: float) -> Level:
    """Compared values of a state at a share of the load; dissipated [J]: nan if energies do not count."""
    scene, threshold = r.model.scene, m.active_threshold(r.model)
    if scene.hook is None:
        passed = [(median_force(r, one.name) or 0.0) > threshold for one in classes_of(r.model)]
    else:
        passed = m.pair_active(r).tolist()
    passed += [stress > scene.wire.yield_stress for stress in (m.largest_stress(r), m.interior_stress(r))]
    if scene.output.service_tension is not None:
        passed.append(0.5 * sum(m.mesh_tension(r)) >= scene.output.service_tension)
    stress, strain = m.boundary_stress(r), r.stretch - np.eye(2)
    upper = np.triu_indices(2)
    force = r.model.panel.area * np.array([*stress[upper], m.clamp_couple(r)])
    place = np.array([*strain[upper], r.clamp_rotation, r.length_factor])
    stored = r.energies.stretch + r.energies.bend + r.energies.contact
    return Level(*map(np.array, (share, passed, np.append(force, r.thermal_force), place, float(stored), dissipated)))


def happens(before: Level, after: Level, energy_scale: float) -> bool:
    """Whether there is an event between two levels of a stage; energy_scale [J]: EI/W a loop."""
    if np.any(before.passed != after.passed):
        return True
    work = 0.5 * float((before.force + after.force) @ (after.place - before.place))
    stored, change = float(after.stored), float(after.stored - before.stored)
    at_end = stored + change * float((1.0 - after.share) / (after.share - before.share))
    largest = max(float(before.stored), stored, at_end)
    missing = abs(work - change - float(after.dissipated - before.dissipated))
    return largest > STORED_FLOOR * energy_scale and missing > UNBALANCED * largest
