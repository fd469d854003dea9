"""Places of contacts and sites on the wires in space."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..measure.contact_places import ContactPlaces, arcs_along
from ..measure.measures import active_threshold
from ..wires.overlaps import segment_distances
from .rest_curve import rest_place
from .sites import NOWHERE


def site_places(r: Any) -> np.ndarray:
    """(site, 3) [m] contact point of the two wires of each site, that of the largest force if there are several.

    Without contact, the midpoint between the nearest points of both wires. In the tile in which the first wire is drawn.
    """
    place = np.full((r.sites.count, 3), np.nan)
    t = r.touching
    site, sign = r.touching_site
    for number in np.unique(site[site != NOWHERE]):
        which = np.flatnonzero(site == number)
        strongest = int(which[np.argmax(t.force[which])])
        place[number] = _touched(r, strongest, float(sign[strongest]))
    for number in np.flatnonzero(np.isnan(place[:, 0])):
        place[number] = _nearest(r, int(number))
    return place


def _touched(r: Any, contact: int, sign: float) -> np.ndarray:
    """(3,) [m] place of a contact; sign: 1 where its first wire is the first wire of the site, else -1."""
    t = r.touching
    node, s = (t.first, t.place[:, 0]) if sign > 0.0 else (t.second, t.place[:, 1])
    half = 0.5 * (r.length_factor * r.model.rods.section.thickness - t.overlap[contact])
    own = r.position[node[contact]] + r.curve.offset(node[contact : contact + 1], s[contact : contact + 1])[0]
    return np.asarray(own - sign * half * t.normal[contact])


def _nearest(r: Any, site: int) -> np.ndarray:
    """(3,) [m] midpoint between the nearest points of the two wires of a site, within its reach."""
    lines, shifts = zip(*(_along(r, site, side) for side in (0, 1)), strict=True)
    shift = r.sites.shift[site].copy()
    shift[:2] = r.gradient @ shift[:2]
    a, b = (grid.ravel() for grid in np.meshgrid(np.arange(len(lines[0]) - 1), np.arange(len(lines[1]) - 1)))
    begin, other = lines[0], lines[1] + shift
    distance, place_a, place_b = segment_distances(begin[a], begin[a + 1], other[b], other[b + 1])
    k = int(np.argmin(distance))
    own = begin[a[k]] + place_a[k] * (begin[a[k] + 1] - begin[a[k]])
    facing = other[b[k]] + place_b[k] * (other[b[k] + 1] - other[b[k]])
    return np.asarray(0.5 * (own + facing) - shifts[0][a[k]])


def _along(r: Any, site: int, side: int) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3) [m] nodes of one wire of a site within its reach, and the periodic shift (n, 3) [m] of each."""
    rods, wires = r.model.rods, r.model.wires
    wire = int(wires.site_wire[site, side])
    count, first = int(rods.wire_count[wire]), int(rods.wire_first[wire])
    seed = wires.site_seed[site, side]
    number = np.arange(np.floor(seed + wires.site_low[site, side]), np.ceil(seed + wires.site_high[site, side]) + 1).astype(int)
    if not rods.wire_closed[wire]:
        number = number[(number >= 0) & (number < count)]
        if len(number) < 2:
            number = np.array([max(0, min(round(seed), count - 1) - 1), min(round(seed), count - 1)])
    turns = number // count if rods.wire_closed[wire] else np.zeros(len(number), dtype=int)
    closing = np.zeros(3)
    closing[:2] = r.gradient @ rods.wire_period[wire, :2]
    shift = turns[:, None] * closing
    return r.position[first + number - turns * count] + shift, shift


def contact_places(r: Any) -> ContactPlaces:
    """Places of the contacts whose force exceeds the threshold."""
    rods, contacts = r.model.rods, r.touching
    kept = contacts.force > active_threshold(r.model)
    node = np.stack([contacts.first, contacts.second], axis=1)[kept]
    place, shift = contacts.place[kept], contacts.shift[kept]
    rest = np.stack([rest_place(rods, r.model.curve, node[:, side], place[:, side]) for side in (0, 1)], axis=1)
    lengths = rods.natural_arc * r.length_factor
    wire = rods.wire_of[node]
    return ContactPlaces(
        force=contacts.force[kept],
        wire=wire,
        arc=arcs_along(lengths, rods.wire_first, wire, node, place),
        rest=rest[..., :2],
        reach=(rest[:, 1] + shift - rest[:, 0])[:, :2],
        wire_length=np.add.reduceat(lengths, rods.wire_first),
        wire_period=rods.wire_period[:, :2],
    )
