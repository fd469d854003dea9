"""Which wires lie in each other, in words."""

from __future__ import annotations

import math

import numpy as np

from .. import measure
from ..errors import ModelError
from ..text import engineering
from .contacts import Contacts
from .observables import SpatialObservables
from .rods import Rods
from .strip import RodStrip

CLOSEST = 1e-3  # of the thickness: smaller overlaps as knitted, and smaller distances of centre lines, count as zero
LEAST_DIFFERENCE = 0.005  # of a stiffness that differs from that of the scene: three digits


def refuse_intersecting_centre_lines(near: Contacts, rods: Rods, strip: RodStrip) -> None:
    """Intersecting centre lines do not tell which wire lies above the other. Raises `ModelError` on all ranks.

    near: contacts of the strip as knitted, of any gap below zero at least.
    """
    contact_distance = rods.wire_radius[rods.wire_of[near.first]] + rods.wire_radius[rods.wire_of[near.second]]
    distance = 1.0 - near.overlap / contact_distance
    wires, places = strip.wire[rods.wire_of[np.stack([near.first, near.second])]], rods.position[near.first]
    worst = int(distance.argmin()) if len(distance) else None
    here = (np.inf, 0, 0, np.zeros(3)) if worst is None else (distance[worst], *wires[:, worst].tolist(), places[worst])
    least, first, second, (x, y, _) = min(strip.ranks.everyone(here), key=lambda there: float(there[0]))
    if least >= CLOSEST:
        return
    raise ModelError(
        f"wires {first + 1} and {second + 1} pass through each other near x = {1e3 * x:.4g} mm, y = {1e3 * y:.4g} mm: their"
        " centre lines intersect, so neither lies above the other; allowed: any distance between them, however small"
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
    x, y = 1e3 * measure.positions(observed)[0][nodes[0], :2]
    return f"deepest now between wires {first} and {second} near x = {x:.4g} mm, y = {y:.4g} mm from the corner" + "".join(
        f", {name} {engineering(now, unit)} in force in place of {engineering(of_scene, unit)}"
        for name, unit, now, of_scene in (
            ("contact penalty", "N/m", penalty[list(nodes)].mean(), model.contact_stiffness),
            ("axial stiffness", "N", stretch[nodes[0]], model.rods.section.axial_stiffness),
        )
        if not math.isclose(now, of_scene, rel_tol=LEAST_DIFFERENCE)
    )
