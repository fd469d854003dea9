"""Jumps between equilibria of the same load: the rules for the levels of a run and the cells of a map.

Along one branch of equilibria the energy, stored and dissipated, changes by the work of the load,

    E_b - E_a = integral of f dx,      f force, x its displacement,

which lies between f_a dx and f_b dx while f grows or falls. Two neighbouring states belong to different branches if their
energies are further apart (`energy_gap`), or if a value changes much faster between them than beside them (`stands_out`).
The share of active contacts is no sign of it: contacts of a repeat close together, without a jump.

Between two load levels there is an event where a class of contacts closes or opens, or a contact of two hooked wires; where the
largest stress passes the elastic limit, or the mean tension `output.service_tension`. Or the curve between them is unknown:
snap-through, end of slack, a large change of stiffness. Then the mean force f times the displacement x differs from the energy,

    | sum 1/2 (f_a + f_b) (x_b - x_a)  -  (E_b - E_a) |  >  UNBALANCED E,      E stored and dissipated energy,

E the energy stored at the end of the stage, extrapolated linearly from both levels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from .. import measure as m
from .observables import Observables

UNBALANCED = 0.05  # energy without work, over the stored energy
STORED_FLOOR = 1e-5  # of EI/W a loop: below it the stored energy counts as zero
STEEPER = 3.0  # change of a value over its changes on both sides
NOTABLE = 0.05  # of the largest value: smaller changes are not counted
SCATTER = 1e-3  # of the larger of weft and warp: smaller changes are the scatter of equilibria


def energy_gap(force: np.ndarray, place: np.ndarray, energy: np.ndarray) -> np.ndarray:
    """Change of energy beyond the possible work (state - 1,) [J], from each state to the next.

    force (state, component), place (state, component): their products are energies [J]. energy: (state,) [J].
    """
    step = np.diff(place, axis=0)
    ends = np.stack([force[:-1] * step, force[1:] * step])
    change = np.diff(energy)
    return np.maximum.reduce([ends.min(axis=0).sum(axis=1) - change, change - ends.max(axis=0).sum(axis=1), 0.0 * change])


def stands_out(path: np.ndarray, value: np.ndarray, least: np.ndarray | float = 0.0) -> np.ndarray:
    """Whether a value changes much faster than on both sides, and by over `least` (state - 1,).

    An adjacent change of opposite sign belongs to the same snap-through: the change beyond it is compared. path: (state,)
    increasing; nothing stands out where it is constant, at the ends, and beside unknown values (nan).
    """
    change = np.diff(value)
    slope = np.full(len(change) + 4, np.nan)
    way = np.diff(path)
    np.divide(change, way, out=slope[2:-2], where=way > 0.0)
    here = slope[2:-2]
    beside = [np.where(near * here < 0.0, far, near) for near, far in ((slope[1:-3], slope[:-4]), (slope[3:-1], slope[4:]))]
    notable = np.maximum(NOTABLE * np.nanmax(np.abs(value), initial=0.0), least)
    return np.asarray((np.abs(here) > STEEPER * np.abs(beside).max(axis=0)) & (np.abs(change) > notable))


def jumps(
    path: np.ndarray,
    force: np.ndarray,
    place: np.ndarray,
    *,
    stored: np.ndarray,
    dissipated: np.ndarray,
    values: Sequence[np.ndarray],
    floor: float,
) -> np.ndarray:
    """Whether a state and the next are on different branches of equilibria (state - 1,).

    path: (state,) increasing parameter of the load. force, place: see `energy_gap`. stored, dissipated: (state,) [J]. values:
    of one kind each, such as tensions, (state, side), that change evenly along a branch. floor [J]: stored energies below it
    count as zero.
    """
    largest = np.maximum(stored[:-1], stored[1:])
    loaded = largest > floor  # values of an unloaded mesh are rounding errors
    found = loaded & (np.abs(energy_gap(force, place, stored + dissipated)) > UNBALANCED * largest)
    for sides in values:
        larger = np.abs(sides).max(axis=1)
        least = SCATTER * np.fmax(larger[:-1], larger[1:])
        for value in sides.T:
            found |= loaded & stands_out(path, value, least)
    return found


# --- events between two neighbouring load levels


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
        passed = [(m.class_median_force(r, name) or 0.0) > threshold for name in m.classes_of(r.model)]
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
