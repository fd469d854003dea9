"""Elastic slips of friction (kernels/wire_friction.py) that a mesh takes over from one repeat."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from ..compute.host import fetch, store
from ..kernels.wire_closest import PLACES
from .wire_contact import WireContact

SLIPS = 2  # of a pair: one for each minimum


def elastic_slips(contact: WireContact) -> tuple[np.ndarray, np.ndarray]:
    """Places of the contacts of a single world, see `_at_rest`; their elastic slips (contact, 3) [m]."""
    step, pairs = int(contact.stepper.steering.step[0]), contact.pairs
    which = np.flatnonzero(fetch(pairs.slip_step)[step % 2, : SLIPS * contact.pair_count] == step)
    place, slip = (fetch(x)[step % 2, which] for x in (pairs.slip_place, pairs.elastic_slip))
    return _at_rest(contact, which // SLIPS, place), slip.copy()


def take_elastic_slips(contact: WireContact, at_rest: np.ndarray, slip: np.ndarray, repeat: np.ndarray) -> None:
    """Take over the elastic slips of one repeat, and begin an increment.

    at_rest, slip: `elastic_slips` of the repeat; repeat: its size (2,) [m]. A contact takes the slip of the nearest contact
    of the repeat at rest, within a segment.
    """
    step, pairs, near = int(contact.stepper.steering.step[0]), contact.pairs, contact.near_pairs()
    touches = fetch(contact.touch.touch_normal_force)[: PLACES * len(near)].reshape(-1, PLACES)[:, :SLIPS] != 0.0
    row, slot = np.nonzero(touches)
    pair = near[row]
    place = fetch(pairs.pair_place)[PLACES * pair + slot]
    # either wire of a contact may be the first one
    ways = at_rest, np.concatenate([at_rest[:, :3] + at_rest[:, 3:], -at_rest[:, 3:]], axis=1)
    size = np.array([*repeat, 0.0, 0.0, 0.0, 0.0])
    known, own = (_in_repeat(points, repeat) for points in (np.concatenate(ways), _at_rest(contact, pair, place)))
    segment = float(contact.stepper.rods.natural_length.max())
    distance, nearest = cKDTree(known, boxsize=size).query(own, distance_upper_bound=segment)
    is_known = np.isfinite(distance)
    which = (SLIPS * pair + slot)[is_known]
    numbers, places, slips = (fetch(x).copy() for x in (pairs.slip_step, pairs.slip_place, pairs.elastic_slip))
    numbers[:] = -1
    numbers[step % 2, which] = step
    places[step % 2, which], slips[step % 2, which] = place[is_known], np.concatenate([slip, -slip])[nearest[is_known]]
    for array, values in ((pairs.slip_step, numbers), (pairs.slip_place, places), (pairs.elastic_slip, slips)):
        store(array, values)
    contact.begin_increment(np.array([0]))


def _at_rest(contact: WireContact, pair: np.ndarray, place: np.ndarray) -> np.ndarray:
    """(contact, 6) [m] at rest: a place on the first segment of a pair, and the way from there to that on the second."""
    pairs, rods = contact.pairs, contact.stepper.rods
    first, second = (fetch(x)[pair] for x in (pairs.pair_first, pairs.pair_second))
    one, two = (rods.position[k] + place[:, n, None] * rods.rest_edge[k] for n, k in enumerate((first, second)))
    return np.concatenate([one, two + fetch(pairs.pair_shift)[pair] - one], axis=1)


def _in_repeat(points: np.ndarray, repeat: np.ndarray) -> np.ndarray:
    """Points (n, 6) with their first two coordinates in one repeat."""
    inside = points.copy()
    inside[:, :2] %= repeat
    inside[:, :2][inside[:, :2] >= repeat] = 0.0  # of round-off
    return inside
