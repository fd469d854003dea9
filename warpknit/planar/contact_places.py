"""Places of active contacts in a planar mesh (measure/observables.py)."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..measure import pair_active
from ..measure.observables import ContactPlaces, arcs_along


def contact_places(r: Any) -> ContactPlaces:
    """One place for each body with two active pairs."""
    panel, table = r.model.panel, r.model.table
    both = pair_active(r).reshape(-1, 2).all(axis=1)
    pairs = np.flatnonzero(np.repeat(both, 2))
    u = r.pair_u[pairs]
    knitted = np.stack([table.x, table.y], axis=1)
    towards = np.stack([table.rest_x, table.rest_y], axis=1)

    def place(entry: np.ndarray) -> np.ndarray:
        return np.asarray(knitted[entry] + u[:, None] * towards[entry])

    # [m] as knitted, in the repeat of the body, and in that of the wire
    at_body = place(panel.pair_table[pairs] + r.pair_slide[pairs]) + panel.pair_shift[pairs]
    origin = np.repeat(panel.block_origin, panel.block_count, axis=0)[r.pair_node[pairs]]
    at_wire = place(r.entry[r.pair_node[pairs]]) + origin
    wires = len(panel.wire_first)
    chords = np.add.reduceat(r.natural_length, panel.wire_first)
    lengths = r.length_factor * r.natural_length * np.repeat(panel.wire_length / chords, panel.wire_count)  # along the arcs
    wire = panel.pair_wire[pairs]
    return ContactPlaces(
        force=r.pair_force.reshape(-1, 2)[both].mean(axis=1),
        wire=wire.reshape(-1, 2),
        arc=arcs_along(lengths, panel.wire_first, wire, r.pair_node[pairs], u).reshape(-1, 2),
        rest=at_wire.reshape(-1, 2, 2),
        reach=at_body[1::2] - at_body[::2],
        wire_length=np.add.reduceat(lengths, panel.wire_first),
        wire_period=np.tile([0.0, panel.size[1]], (wires, 1)),
    )
