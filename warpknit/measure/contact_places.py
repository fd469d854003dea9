"""Where the wires of a mesh at rest touch with a force that counts: what its network of resistors is made of.

In the plane wires touch by way of a body: one place for each body both of whose pairs are active, under the mean of their forces.
In space every contact is a place, those that the knit does not hook included, and two at one clasp count as two.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class ContactPlaces:
    """Places where two wires of a periodic mesh touch. Arrays (place, 2) are of both wires."""

    force: np.ndarray  # [place] [N]
    wire: np.ndarray  # (place, 2)
    arc: np.ndarray  # (place, 2) [m] along the wire from its first node
    rest: np.ndarray  # (place, 2, 2) [m] where that is at rest, in the repeat of the wire
    reach: np.ndarray  # (place, 2) [m] at rest, from the first wire to the second, which may lie in another repeat
    wire_length: np.ndarray  # [wire] [m] all round
    wire_period: np.ndarray  # (wire, 2) [m] at rest, by which a wire goes on at its first node


def arcs_along(lengths: np.ndarray, first: np.ndarray, wire: np.ndarray, node: np.ndarray, share: np.ndarray) -> np.ndarray:
    """[m] along their wire from its first node of places at a share of the segments behind nodes; lengths [node] of segments."""
    before = np.concatenate([[0.0], np.cumsum(lengths)])
    return np.asarray(before[node] - before[first[wire]] + share * lengths[node])
