"""Places of active contacts in an equilibrium: the resistors of the network model.

Planar: one place for each body with two active pairs, with the mean of their forces. Spatial: one place for every contact,
inside and outside the hooks of the knit.
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
    rest: np.ndarray  # (place, 2, 2) [m] rest position, in the repeat of the wire
    reach: np.ndarray  # (place, 2) [m] at rest, from the first wire to the second, which may lie in another repeat
    wire_length: np.ndarray  # [wire] [m]
    wire_period: np.ndarray  # (wire, 2) [m] at rest, shift of a wire to its own continuation


def arcs_along(lengths: np.ndarray, first: np.ndarray, wire: np.ndarray, node: np.ndarray, share: np.ndarray) -> np.ndarray:
    """[m] along their wire from its first node of places at a share of the segments behind nodes; lengths [node] of segments."""
    before = np.concatenate([[0.0], np.cumsum(lengths)])
    return np.asarray(before[node] - before[first[wire]] + share * lengths[node])
