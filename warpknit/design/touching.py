"""Where the wires of a mesh at rest touch with a force that counts: what its network of resistors is made of, in either model.

In the plane wires touch by way of a body: one place for each body both of whose pairs are active, under the mean of their forces.
In space every contact is a place, those that the knit does not hook included, and two at one clasp count as two.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .. import measure
from ..planar.observables import PlanarObservables
from ..spatial.observables import SpatialObservables
from ..sweep.outcome import AnyReading


@dataclass(frozen=True)
class Touching:
    """Places where two wires of a periodic mesh touch. Arrays (place, 2) are of both wires."""

    force: np.ndarray  # [place] [N]
    wire: np.ndarray  # (place, 2)
    arc: np.ndarray  # (place, 2) [m] along the wire from its first node
    rest: np.ndarray  # (place, 2, 2) [m] where that is at rest, in the repeat of the wire
    reach: np.ndarray  # (place, 2) [m] at rest, from the first wire to the second, which may lie in another repeat
    wire_length: np.ndarray  # [wire] [m] all round
    wire_period: np.ndarray  # (wire, 2) [m] at rest, by which a wire goes on at its first node


def touching_of(r: AnyReading) -> Touching:
    """Where the wires of a reading touch."""
    return _in_space(r) if isinstance(r, SpatialObservables) else _in_the_plane(r)


def _in_the_plane(r: PlanarObservables) -> Touching:
    panel, table = r.model.panel, r.model.table
    both = measure.pair_active(r).reshape(-1, 2).all(axis=1)
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
    lengths = r.natural_length * r.length_factor
    wires = len(panel.wire_first)
    wire = panel.pair_wire[pairs]
    return Touching(
        force=r.pair_force.reshape(-1, 2)[both].mean(axis=1),
        wire=wire.reshape(-1, 2),
        arc=_arcs(lengths, panel.wire_first, wire, r.pair_node[pairs], u).reshape(-1, 2),
        rest=at_wire.reshape(-1, 2, 2),
        reach=at_body[1::2] - at_body[::2],
        wire_length=np.add.reduceat(lengths, panel.wire_first),
        wire_period=np.tile([0.0, panel.size[1]], (wires, 1)),
    )


def _in_space(r: SpatialObservables) -> Touching:
    rods, contacts = r.mesh.rods, r.touching
    kept = contacts.force > r.threshold
    node = np.stack([contacts.first, contacts.second], axis=1)[kept]
    place, shift = contacts.place[kept], contacts.shift[kept]
    rest = np.stack([r.rest_place(node[:, side], place[:, side]) for side in (0, 1)], axis=1)
    lengths = rods.natural_length * r.length_factor
    wire = rods.wire_of[node]
    return Touching(
        force=contacts.force[kept],
        wire=wire,
        arc=_arcs(lengths, rods.wire_first, wire, node, place),
        rest=rest[..., :2],
        reach=(rest[:, 1] + shift - rest[:, 0])[:, :2],
        wire_length=np.add.reduceat(lengths, rods.wire_first),
        wire_period=rods.wire_period[:, :2],
    )


def _arcs(lengths: np.ndarray, first: np.ndarray, wire: np.ndarray, node: np.ndarray, share: np.ndarray) -> np.ndarray:
    """[m] along their wire from its first node of places at a share of the segments behind nodes; lengths [node] of segments."""
    before = np.concatenate([[0.0], np.cumsum(lengths)])
    return np.asarray(before[node] - before[first[wire]] + share * lengths[node])
