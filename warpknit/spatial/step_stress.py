"""Launches that sum the nominal stress of a step, for tension-driven strains (mechanics/driven_strain.py)."""

from __future__ import annotations

import numpy as np
import warp as wp

from ..compute.launch import Launch, bind
from ..kernels.rod_stress import count_clamp_stress, count_segment_stress
from .rod_arrays import StepForces
from .rod_step import RodStepper, WireGroup
from .wire_contact import WireContact


class StepStress:
    """Launches that sum the nominal stress of a step. It registers itself with the stepper."""

    def __init__(self, stepper: RodStepper, contact: WireContact, held_node: np.ndarray, held_lever: np.ndarray) -> None:
        """held_node [held], of all worlds; held_lever (held, 2) [m] from their clamps."""
        order, device = np.argsort(held_node, kind="stable"), stepper.device
        self._stepper, self._contact, self._held = stepper, contact, held_node[order]
        self._clamps: dict[str, wp.array] = {
            "held_node": wp.array(self._held, dtype=wp.int32, device=device),
            "held_lever": wp.array(held_lever[order], dtype=wp.vec2d, device=device),
        }
        stepper.add_up_stress(self)

    def of_contacts(self, blocks: range, row: int) -> list[Launch]:
        """Launches for the contacts of blocks of nodes; row: of the counts."""
        return [self._contact.stress_launch(blocks, own_row=row, stress_count=self._stepper.stress_count)]

    def of_group(self, group: WireGroup, stored: StepForces, row: int) -> list[Launch]:
        """Launches for the wires of a group, whose forces have just been stored."""
        sources = (self._stepper.arrays, self._stepper.state)
        count = {"own_row": row, "stress_count": self._stepper.stress_count}
        first, end = np.searchsorted(self._held, [group.nodes.start, group.nodes.stop]).tolist()
        forces = {"stored_from": stored.stored_from, "force": stored.force}
        return [
            bind(count_segment_stress, len(group.blocks), *sources, first_block=group.blocks.start, **count),
            bind(count_clamp_stress, end - first, *sources, first_held=first, **forces, **self._clamps, **count),
        ]
