"""Which wires lie in each other, in words."""

from __future__ import annotations

import math

import numpy as np

from .. import measure
from ..base.text import engineering, place_text
from ..errors import ModelError
from ..kernels.banded_mass import HELD_NODE
from ..wires.overlaps import CLOSEST
from .contacts import Contacts
from .observables import SpatialObservables
from .rods import Rods
from .strip import RodStrip

CLAMPED = 1e-9  # of the thickness: smaller overlaps of clamped wires are rounding
LEAST_DIFFERENCE = 0.005  # of a stiffness that differs from that of the scene: three digits


def refuse_intersecting_centre_lines(near: Contacts, rods: Rods, strip: RodStrip) -> None:
    """Intersecting centre lines do not tell which wire lies above the other. Raises `ModelError` on all ranks.

    near: contacts of the strip as knitted, of any gap below zero at least.
    """
    distance = 1.0 - near.overlap / rods.touch_distance(near.first, near.second)
    wires, places = strip.wire[rods.wire_of[np.stack([near.first, near.second])]], rods.position[near.first]
    worst = int(distance.argmin()) if len(distance) else None
    here = (np.inf, 0, 0, np.zeros(3)) if worst is None else (distance[worst], *wires[:, worst].tolist(), places[worst])
    least, first, second, (x, y, _) = min(strip.ranks.everyone(here), key=lambda there: float(there[0]))
    if least >= CLOSEST:
        return
    raise ModelError(
        f"the centre lines of wires {first + 1} and {second + 1} intersect near {place_text(x, y)}, so"
        " neither lies above the other; move one of them, by however little"
    )


def refuse_overlapping_clamps(near: Contacts, rods: Rods, strip: RodStrip) -> None:
    """Wires that overlap where both are clamped cannot part. Raises `ModelError` on all ranks.

    near: contacts of the strip as knitted, of any gap below zero at least.
    """
    held = (rods.held & int(HELD_NODE)) != 0
    rigid = held & held[rods.following]
    overlap = near.overlap * (rigid[near.first] & rigid[near.second])
    worst = int(overlap.argmax()) if len(overlap) else None
    here = (0.0, 0, 0, np.zeros(3))
    if worst is not None:
        wires = strip.wire[rods.wire_of[[near.first[worst], near.second[worst]]]]
        here = (float(overlap[worst]), *wires.tolist(), rods.position[near.first[worst]])
    most, first, second, (x, y, _) = max(strip.ranks.everyone(here), key=lambda there: there[0])
    if most > CLAMPED * rods.section.thickness:
        raise ModelError(
            f"wires {first + 1} and {second + 1} overlap by {engineering(most, 'm')} where both are clamped, near"
            f" {place_text(x, y)}, and cannot part there; move their ends apart, or set a smaller wire.diameter"
        )


def overlap_text(observed: SpatialObservables, penalty: np.ndarray, stretch: np.ndarray) -> str:
    """Wires and place of the deepest overlap, and the stiffness there if it is not that of the scene.

    penalty [node] [N/m] of contacts, stretch [node] [N] softened axial stiffness: those now.
    """
    model, contacts = observed.model, observed.touching
    if not len(contacts.overlap):
        return "apart by now"
    worst = int(np.argmax(contacts.overlap))
    nodes = contacts.first[worst], contacts.second[worst]
    first, second = (int(model.rods.wire_of[node]) for node in nodes)
    place = place_text(*measure.positions(observed)[0][nodes[0], :2])
    return f"deepest now between wires {first} and {second} near {place} from the corner" + "".join(
        f", {name} {engineering(now, unit)} in force in place of {engineering(of_scene, unit)}"
        for name, unit, now, of_scene in (
            ("contact penalty", "N/m", penalty[list(nodes)].mean(), model.contact_stiffness),
            ("axial stiffness", "N", stretch[nodes[0]], model.rods.of_nodes("axial_stiffness")[nodes[0]]),
        )
        if not math.isclose(now, of_scene, rel_tol=LEAST_DIFFERENCE)
    )
