"""Bending of spatial wires: its energy, and plastic turns, updated from one equilibrium to the next.

Backward Euler of the flow rule of kernels/rod_forces.py. Twist and tension stay elastic.
"""

from __future__ import annotations

import numpy as np

from ..compute.host import fetch, store
from ..compute.steering import Steering
from .rod_arrays import RodArrays, RodState
from .rods import Rods
from .wire_sums import WireSums


class Yielding:
    """Plastic bending of rods in the state last evaluated.

    Arrays run over the nodes; turns [rad] are along the section directors, and 0 at the ends of wires.
    """

    KEPT = ("dissipated",)

    def __init__(self, rods: Rods, arrays: RodArrays, state: RodState, sums: WireSums, worlds: int = 1) -> None:
        self.rods, self.arrays, self.state, self._sums = rods, arrays, state, sums
        self._inside = (rods.following >= 0) & (rods.previous >= 0)
        section = rods.section
        self._kept = section.hardening
        self.yields = section.yields
        self._steering = Steering(state.control)
        self.dissipated = np.zeros(worlds)  # [world] [J] over all ranks

    @property
    def length(self) -> np.ndarray:
        """[node] [m] natural length of a node at the current temperature."""
        factor = self._steering.length_factor
        return self.rods.node_length * (factor[0] if len(factor) == 1 else np.repeat(factor, self.arrays.world_nodes))

    @property
    def plastic(self) -> np.ndarray:
        """(node, 2) [rad] plastic turn; one row of zeros where the section does not yield."""
        return fetch(self.state.plastic_turn)

    @property
    def back(self) -> np.ndarray:
        """(node, 2) [rad] back turn: centre of the yield surface."""
        return self._kept / (1.0 - self._kept) * self.plastic if self.yields else np.zeros_like(self.plastic)

    def _trial(self) -> np.ndarray:
        turn = fetch(self.state.curvature) - fetch(self.arrays.natural_curvature)[self.rods.row] - self.plastic
        return np.where(self._inside[:, None], turn, 0.0)

    def _beyond(self) -> tuple[np.ndarray, np.ndarray]:
        """(node, 2) excess of the trial turns over the yield surface, and [node] their distance from the back turns."""
        beyond = self._trial() - self.back
        size = np.linalg.norm(beyond, axis=1)
        over = np.maximum(size - self.rods.of_nodes("yield_curvature") * self.length, 0.0) * self.yields
        return beyond * np.divide(over, size, out=np.zeros_like(size), where=size > 0.0)[:, None], size

    @property
    def elastic(self) -> np.ndarray:
        """(node, 2) [rad] elastic turn; the moment is EI over the length times it."""
        return self._trial() - (1.0 - self._kept) * self._beyond()[0] if self.yields else self._trial()

    @property
    def hardened_energy(self) -> np.ndarray:
        """[world] [J] stored by hardening: H kappa_p^2/2 a length, H = EI kept/(1 - kept)."""
        return self._energy(0.5 * np.sum(self.back * self.plastic, axis=1)) if self.yields else np.zeros(len(self.dissipated))

    def plastic_potential(self) -> np.ndarray:
        """[world] [J] incremental potential of bending and twist, whose gradient are the moments, beyond the elastic energy."""
        if not self.yields:
            return np.zeros(len(self.dissipated))
        over, size = self._beyond()
        passed = np.linalg.norm(over, axis=1)
        limit = size - passed
        bent = 0.5 * limit**2 + limit * passed + 0.5 * self._kept * passed**2
        bent += np.sum(self.back * (self._trial() - self.back), axis=1)
        return self._energy(bent - 0.5 * np.sum(self.elastic**2, axis=1))

    @property
    def elastic_energy(self) -> np.ndarray:
        """[world] [J] of elastic turns and twists and of the slopes of moments along the segments (kernels/rod_forces.py)."""
        return self._sums.of_nodes(fetch(self.state.bend_energy))

    def _energy(self, square: np.ndarray) -> np.ndarray:
        """[world] EI/l times squares of turns [rad^2] over the mesh, summed."""
        bending = self.rods.of_nodes("bending_stiffness")
        stiffness = np.divide(bending, self.length, out=np.zeros(len(square)), where=self._inside)
        return self._sums.of_nodes(stiffness * square)

    def advance(self, world: int = 0) -> None:
        """Accept the equilibrium of a world as a step of its load history: update the plastic turns."""
        if not self.yields:
            return
        change = (1.0 - self._kept) * self._beyond()[0]
        moment = self.rods.of_nodes("bending_stiffness") * self.rods.of_nodes("yield_curvature")
        self.dissipated[world] += self._sums.of_nodes(moment * np.linalg.norm(change, axis=1))[world]
        nodes = slice(world * self.arrays.world_nodes, (world + 1) * self.arrays.world_nodes)
        store(self.state.plastic_turn[nodes], (self.plastic + change)[nodes])
