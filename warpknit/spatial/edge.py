"""The edge of a mesh in space where it does more than follow the load: places that are pulled, and cords between net nodes.

Stations stand along the outline (mesh/rim.py), and the clamps of the wires go with the two around them: a clamp at rest
position c moves to F c + q. Stations that are held are given. The free ones hang on the cord and feel what their clamps carry,
R = cord + sum of w f; they are moved by a share of K^-1 R, K being the stiffness of the cord, until nothing is left. The share is
halved where that made R larger. Whenever stations move, the mesh is carried along by a thin plate through the clamps, so that
what is left to the wires is a strain of the whole, as with the load itself.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sparse
from scipy.interpolate import RBFInterpolator
from scipy.sparse.linalg import splu

from ..mesh.rim import Rim, build_rim
from .model import SpatialModel

SMOOTHING = 1e-8  # of the thin plate, over the size of the mesh: clamps at one place do not make it singular
MOST_SHARE, LEAST_SHARE = 0.7, 0.02  # of a correction
SLOWER, FASTER = 0.5, 1.1
FARTHEST = 2.0  # node spacings that a station may move at once


class Edge:
    """Stations of a gripped mesh in space."""

    def __init__(self, mesh: SpatialModel) -> None:
        self.mesh = mesh
        self.rim: Rim = build_rim(mesh.panel, mesh.scene)
        self.moved = np.zeros((len(self.rim.arc), 2))  # [station, 2] [m] beside the load
        self.begin_at, self.end_at = self.moved, self.moved  # of the given stations, over a level
        self.left = np.array([np.inf, 1.0])  # [N] root mean squares at free stations: out of balance, and of their clamps' forces
        self._share = MOST_SHARE
        held = mesh.wires.held_node
        size = float(mesh.panel.size.max())
        weights = self.rim.clamps.toarray()
        place = mesh.rods.position[:, :2] / size
        plate = RBFInterpolator(mesh.panel.clamp_position / size, weights, kernel="thin_plate_spline", smoothing=SMOOTHING)
        self._carry = plate(place)  # (node, station)
        self._carry[held] = np.repeat(weights, 2, axis=0)

    def set_off(self, pulled: np.ndarray) -> None:
        """Given stations go from where they are to `pulled` (station, 2) [m]."""
        self.begin_at, self.end_at = self.moved, pulled
        self.left = np.array([np.inf, 1.0])

    def displacement(self, moved: np.ndarray) -> np.ndarray:
        """(node, 2) [m] by which stations moved by (station, 2) [m] carry the mesh; of held nodes, what their clamps move."""
        return np.asarray(self._carry @ moved)

    def grip_forces(self, force: np.ndarray) -> np.ndarray:
        """(clamp, 2) [N] of the clamps on the wires, from the forces (node, 3) of the wires on their nodes."""
        return -force[self.mesh.wires.held_node, :2].reshape(-1, 2, 2).sum(axis=1)

    def pull(self, share: float) -> np.ndarray:
        """Move given stations to a share of the level; (node, 2) [m] by which that carries the mesh."""
        before = self.moved
        on_the_way = self.begin_at + share * (self.end_at - self.begin_at)
        self.moved = np.where(self.rim.given[:, None], on_the_way, before)
        return self.displacement(self.moved - before)

    def follow(self, gradient: np.ndarray, force: np.ndarray) -> np.ndarray:
        """Move free stations towards balance; (node, 2) [m] by which that carries the mesh. force: (node, 3) [N] of the wires on
        their nodes."""
        correction = self._correction(gradient, force)
        self.moved = self.moved + correction
        return self.displacement(correction)

    def balance(self, gradient: np.ndarray, force: np.ndarray) -> np.ndarray:
        """(station, 2) [N] out of balance: the cord less what the clamps pull; as it is at given stations, too."""
        cord, _ = self.rim.cord_forces(gradient, self.moved)
        return np.asarray(cord - self.rim.clamps.T @ self.grip_forces(force))

    def _correction(self, gradient: np.ndarray, force: np.ndarray) -> np.ndarray:
        free = np.flatnonzero(~self.rim.given)
        left = self.balance(gradient, force)[free]
        carried = (self.rim.clamps.T @ self.grip_forces(force))[free]
        size = float(np.sqrt(np.mean(left**2)))
        self._share = float(np.clip(self._share * (SLOWER if size > self.left[0] else FASTER), LEAST_SHARE, MOST_SHARE))
        self.left = np.array([size, float(np.sqrt(np.mean(carried**2)))])
        columns = np.stack([2 * free, 2 * free + 1], axis=1).ravel()
        stiffness = sparse.csc_matrix(self.rim.cord_stiffness(gradient, self.moved))[columns][:, columns]
        step = self._share * splu(sparse.csc_matrix(stiffness)).solve(left.ravel()).reshape(-1, 2)
        farthest = float(np.linalg.norm(step, axis=1).max(initial=0.0))
        most = FARTHEST * float(self.mesh.rods.natural_length.max())
        found = np.zeros_like(self.moved)
        found[free] = step * min(1.0, most / max(farthest, 1e-300))
        return found

    def still_to_do(self, tolerance: float) -> float:
        """What is out of balance at free stations over what a tolerance allows of what their clamps carry."""
        return float(self.left[0] / max(tolerance * self.left[1], 1e-300)) if self.rim.is_free else 0.0

    @property
    def clamp_displacement(self) -> np.ndarray:
        """(clamp, 2) [m] beside the load."""
        return np.asarray(self.rim.clamps @ self.moved)

    # --- checkpoints

    def state_dict(self) -> dict[str, np.ndarray]:
        """What a checkpoint needs."""
        return {
            "edge_moved": self.moved, "edge_begin": self.begin_at, "edge_end": self.end_at, "edge_left": self.left,
            "edge_share": np.array(self._share),
        }  # fmt: skip

    def load_state_dict(self, kept: dict[str, np.ndarray]) -> None:
        """Put back what `state_dict` returned."""
        self.moved, self.begin_at, self.end_at = kept["edge_moved"], kept["edge_begin"], kept["edge_end"]
        self.left, self._share = kept["edge_left"], float(kept["edge_share"])
