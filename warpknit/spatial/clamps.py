"""Clamps that follow the load step by step; some slide along the warp, as those of two hooked wires."""

from __future__ import annotations

import numpy as np
import warp as wp

from ..compute.host import Entries
from ..compute.launch import Launch, bind
from ..kernels.rod_clamps import move_clamps
from .rod_step import RodStepper


class MovingClamps:
    """Clamps of a stepper, two held nodes each. Sets itself as the stepper's clamps."""

    KEPT = ("velocity",)

    def __init__(self, stepper: RodStepper, node: np.ndarray, lever: np.ndarray, sliding: np.ndarray) -> None:
        """node (clamp, 2); lever (clamp, 2, 2) [m] of the nodes at rest, from the clamp; sliding: their indices."""
        device = stepper.device
        self.stepper = stepper
        self.count, self.sliding = len(node), sliding
        self.sliding_node = node[sliding]
        self._entries = Entries(self.sliding_node.ravel(), device)
        slides = np.zeros(self.count, dtype=np.int32)
        slides[sliding] = 1
        self._clamps: dict[str, wp.array] = {
            "clamp_node": wp.array(node, dtype=wp.int32, device=device),
            "clamp_lever": wp.array(lever, dtype=wp.vec2d, device=device),
            "clamp_slides": wp.array(slides, dtype=wp.int32, device=device),
        }
        self.velocity = wp.zeros(self.count, dtype=wp.float64, device=device)  # [m/s] along the warp
        stepper.clamps = self

    @property
    def need_forces(self) -> bool:
        """Whether some of them slide."""
        return len(self.sliding) > 0

    def launches(self, worlds: range) -> list[Launch]:
        """Launches that move the clamps of some worlds after the step of the rods."""
        each = self.count // self.stepper.worlds
        sources = (self.stepper.arrays, self.stepper.state)
        own = {"first_clamp": worlds.start * each, "clamp_velocity": self.velocity}
        return [bind(move_clamps, len(worlds) * each, *sources, **own, **self._clamps)]

    # --- sliding clamps, in the state last evaluated

    @property
    def mass(self) -> np.ndarray:
        """[sliding clamp] [kg] mass of both nodes."""
        return self._of_nodes(self.stepper.state.node_mass)[:, :, 1].sum(axis=1)

    @property
    def place(self) -> np.ndarray:
        """[sliding clamp] [m] displacement from the affine position of its first node."""
        return self._of_nodes(self.stepper.state.displacement)[:, 0, 1]

    @property
    def force(self) -> np.ndarray:
        """(sliding clamp, 3) [N] unbalanced force, along the warp."""
        return self._of_nodes(self.stepper.state.force).sum(axis=1) * np.array([0.0, 1.0, 0.0])

    def _of_nodes(self, array: wp.array) -> np.ndarray:
        """(sliding clamp, 2, 3) the vectors of both nodes."""
        return self._entries.fetch(array).reshape(-1, 2, 3) if self.need_forces else np.zeros((0, 2, 3))
