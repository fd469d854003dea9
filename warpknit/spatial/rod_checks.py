"""Sums and renewals of a convergence check of rods, on the device (kernels/rod_checks.py)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from ..compute.arrays import array, new_arrays
from ..compute.host import fetch
from ..compute.team import SharedLaunches
from ..kernels import rod_checks as k
from ..kernels.banded_mass import HELD_NODE
from ..kernels.rod_checks import STATE_COLUMNS
from ..kernels.rod_sums import sum_mass_products
from ..mechanics.numerics import AXIAL_ERROR, error_ratio
from .rod_step import RodStepper


@dataclass(frozen=True)
class CheckArrays:
    """Arrays of the checks of rods, beside rest data and state."""

    KEPT = ("thermal_strain", "last_place", "last_force", "last_angle", "last_torque")

    bow_weight: wp.array = array(wp.vec2d)  # see Rods.bow_weights
    bow_at_rest: wp.array = array(wp.float64)  # relative excess of the arc over the chord of each segment as knitted
    thermal_strain: wp.array = array(wp.float64)  # of the segments, relative to the length factor
    is_sliding: wp.array = array(wp.int32)  # 1 where a clamp moves the node
    stiffening: wp.array = array(wp.float64, "wire")  # by which the softened stiffness of a wire is multiplied
    slowed: wp.array = array(wp.float64, "world")  # by which velocities are multiplied
    # state at the last check; once `find_motion` has run, the motion since then
    last_place: wp.array = array(wp.vec3d)  # [m]
    last_force: wp.array = array(wp.vec3d)  # [N]
    last_angle: wp.array = array(wp.float64)  # [rad]
    last_torque: wp.array = array(wp.float64)  # [N m]
    state_partial: wp.array = array(wp.float64, "block", int(STATE_COLUMNS))
    partial: wp.array = array(wp.float64, "block")


@dataclass(frozen=True)
class StateSums:
    """Sums over the state last evaluated; [world] of those asked for."""

    unbalanced_square: np.ndarray  # [N2] of the free nodes, summed
    unbalanced_max: np.ndarray  # [N] the largest
    free_nodes: int
    energy: np.ndarray  # [J] of stretch, bending and twist, elastic
    excess_max: np.ndarray  # largest difference between the strain of a segment and T/EA
    excess_square: np.ndarray  # squares of the same, summed
    stretching: int  # segments that can stretch
    mean_excess: np.ndarray  # (world, wire) of the segments that can stretch, over the length of the wire

    @property
    def excess_ratio(self) -> np.ndarray:
        """Errors of axial strains over what is allowed."""
        return error_ratio(self.excess_square, self.stretching, self.excess_max, AXIAL_ERROR)


class RodChecks:
    """Sums over all rods of a stepper, the same for any number of threads."""

    KEPT = ("arrays",)

    def __init__(self, stepper: RodStepper, sliding: np.ndarray, *, keeps_arc_length: bool, bow_at_rest: np.ndarray) -> None:
        """sliding: nodes of clamps that move; keeps_arc_length: whether strains are measured along arcs; bow_at_rest [node]."""
        self.stepper, rods, blocks = stepper, stepper.rods, len(stepper.arrays.block_first)
        is_sliding = np.zeros(rods.node_count, dtype=np.int32)
        is_sliding[sliding] = 1
        counts = {"node": rods.node_count, "wire": len(rods.wire_first), "world": stepper.worlds, "block": blocks}
        values = {"bow_weight": np.stack(rods.bow_weights, axis=1), "bow_at_rest": bow_at_rest, "is_sliding": is_sliding}
        self.arrays = new_arrays(CheckArrays, stepper.device, counts, values)
        mesh = stepper.strip.whole
        free = (mesh.held & int(HELD_NODE)) == 0
        self._free = int(np.count_nonzero(free)) // stepper.worlds
        self._stretching = int(np.count_nonzero((mesh.following >= 0) & (free | free[mesh.following]))) // stepper.worlds
        self.keeps_arc_length = wp.int32(keeps_arc_length)
        self._launches = SharedLaunches(stepper.team, stepper.device, stepper.few)

    def launch(self, kernel: wp.Kernel, name: str = "", **named: Any) -> None:
        """Launch a kernel for the own blocks or nodes; name: of the recorded launch, default the kernel's."""
        self.stepper.share_launch(self._launches, name or kernel.key, kernel, self.arrays, **named)

    def sums(self, rows: np.ndarray, *, of_mean: bool) -> StateSums:
        """Sums of the state last evaluated, of worlds; `of_mean`: with the mean unbalanced forces since the last check."""
        stepper, state, sums = self.stepper, self.stepper.state, self.stepper.sums
        unbalanced, name = (state.force_sum, "mean sums") if of_mean else (state.force, "sums")
        self.launch(k.sum_states, name, unbalanced=unbalanced, keeps_arc_length=self.keeps_arc_length)
        partial = fetch(self.arrays.state_partial)
        total, largest = sums.total(partial, rows), sums.largest(partial, rows)
        excess = (sums.of_wires(partial[:, int(k.EXCESS_SUM)]) / stepper.rods.wire_length).reshape(stepper.worlds, -1)
        return StateSums(
            unbalanced_square=total[:, int(k.UNBALANCED_SQUARE)],
            unbalanced_max=np.sqrt(largest[:, int(k.UNBALANCED_MAX)]),
            free_nodes=self._free,
            energy=total[:, int(k.STRETCH_ENERGY)] + total[:, int(k.BEND_ENERGY)],
            excess_max=largest[:, int(k.EXCESS_MAX)],
            excess_square=total[:, int(k.EXCESS_SQUARE)],
            stretching=self._stretching,
            mean_excess=excess[rows],
        )

    def total(self, rows: np.ndarray) -> np.ndarray:
        """[row] the sums of `partial`."""
        return self.stepper.sums.total(fetch(self.arrays.partial)[:, None], rows)[:, 0]

    def twice_energy(self, move: wp.array, turn: wp.array, name: str, rows: np.ndarray) -> np.ndarray:
        """[row] [J] v . M v + w . I w of motions (node, 3) and [node], by the masses of the dynamics; `name` of both arrays."""
        self.launch(sum_mass_products, name, move=move, turn=turn, partial=self.arrays.partial)
        return self.total(rows)
