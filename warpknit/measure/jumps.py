"""Jumps between equilibria of the same load: the rules for the levels of a run and the cells of a map.

Along one branch of equilibria the energy, stored and dissipated, changes by the work of the load,

    E_b - E_a = integral of f dx,      f force, x its displacement,

which lies between f_a dx and f_b dx while f grows or falls. Two neighbouring states belong to different branches if their
energies are further apart (`energy_gap`), or if a value changes much faster between them than beside them (`stands_out`).
The share of active contacts is no sign of it: contacts of a repeat close together, without a jump.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

UNBALANCED = 0.05  # energy without work, over the stored energy
STORED_FLOOR = 1e-5  # of EI/W a loop: below it the stored energy counts as zero
STEEPER = 3.0  # change of a value over its changes on both sides
NOTABLE = 0.05  # of the largest value: smaller changes are not counted
SCATTER = 1e-3  # of the larger of weft and warp: smaller changes are the scatter of equilibria


def is_unbalanced(energy: float, stored: float, floor: float) -> bool:
    """Whether such an energy without work [J] is a snap-through, relative to the stored energy; floor [J]."""
    return stored > floor and abs(energy) > UNBALANCED * stored


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
    found = np.zeros(len(path) - 1, dtype=bool)
    for k, gap in enumerate(energy_gap(force, place, stored + dissipated)):
        found[k] = is_unbalanced(float(gap), float(max(stored[k], stored[k + 1])), floor)
    loaded = np.maximum(stored[:-1], stored[1:]) > floor  # values of an unloaded mesh are rounding errors
    for sides in values:
        larger = np.abs(sides).max(axis=1)
        least = SCATTER * np.fmax(larger[:-1], larger[1:])
        for value in sides.T:
            found |= loaded & stands_out(path, value, least)
    return found
