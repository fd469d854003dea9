"""Sums and renewals of a convergence check of rods, on the device (kernels/rod_checks.py)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from ..compute.host import fetch, shared, store
from ..compute.team import SharedLaunches
from ..kernels import rod_checks as k
from ..kernels.banded_mass import HELD_NODE
from ..kernels.rod_checks import STATE_COLUMNS
from ..kernels.rod_sums import sum_mass_products
from ..mechanics.numerics import AXIAL_ERROR, error_ratio
from .rod_step import RodStepper
from .rods import Rods


@dataclass(frozen=True)
class CheckArrays:
    """Arrays of the checks of rods, beside rest data and state; [node] unless noted."""

    KEPT = ("thermal_strain", "last_place", "last_force", "last_angle", "last_torque")

    bow_weight: wp.array  # vec2d, see Rods.bow_weights
    bow_at_rest: wp.array  # relative excess of the arc over the chord of each segment as knitted
    thermal_strain: wp.array  # of the segments, relative to the length factor
    is_sliding: wp.array  # int, 1 where a clamp moves the node
    stiffening: wp.array  # [wire] by which the softened stiffness of a wire is multiplied
    # state at the last check; from `motion` on the motion since then
    last_place: wp.array  # vec3d [m]
    last_force: wp.array  # vec3d [N]
    last_angle: wp.array  # [rad]
    last_torque: wp.array  # [N m]
    state_partial: wp.array  # [block, STATE_COLUMNS]
    partial: wp.array  # [block]


def check_arrays(rods: Rods, sliding: np.ndarray, bow_at_rest: np.ndarray, blocks: int, device: str) -> CheckArrays:
    """Arrays for `blocks` blocks of nodes; sliding: nodes of clamps that move; bow_at_rest [node]."""
    nodes = rods.node_count
    is_sliding = np.zeros(nodes, dtype=np.int32)
    is_sliding[sliding] = 1

    def reals(count: int = nodes) -> wp.array:
        return wp.zeros(count, dtype=wp.float64, device=device)

    def vectors() -> wp.array:
        return wp.zeros(nodes, dtype=wp.vec3d, device=device)

    return CheckArrays(
        bow_weight=wp.array(np.stack(rods.bow_weights, axis=1), dtype=wp.vec2d, device=device),
        bow_at_rest=shared(bow_at_rest, wp.float64, device),
        thermal_strain=reals(),
        is_sliding=wp.array(is_sliding, dtype=wp.int32, device=device),
        stiffening=reals(len(rods.wire_first)),
        last_place=vectors(),
        last_force=vectors(),
        last_angle=reals(),
        last_torque=reals(),
        state_partial=wp.zeros((blocks, STATE_COLUMNS), dtype=wp.float64, device=device),
        partial=reals(blocks),
    )


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
        self.stepper, rods, device = stepper, stepper.rods, stepper.device
        self.arrays = check_arrays(rods, sliding, bow_at_rest, len(stepper.arrays.block_first), device)
        mesh = stepper.strip.whole
        free = (mesh.held & int(HELD_NODE)) == 0
        self._free = int(np.count_nonzero(free)) // stepper.worlds
        self._stretching = int(np.count_nonzero((mesh.following >= 0) & (free | free[mesh.following]))) // stepper.worlds
        self._keeps_arc_length = wp.int32(keeps_arc_length)
        self._slowed = wp.zeros(stepper.worlds, dtype=wp.float64, device=device)
        self.launches = SharedLaunches(stepper.team, device, stepper.few)

    def sums(self, rows: np.ndarray, *, of_mean: bool) -> StateSums:
        """Sums of the state last evaluated, of worlds; `of_mean`: with the mean unbalanced forces since the last check."""
        stepper, state, arrays = self.stepper, self.stepper.state, self.arrays
        unbalanced, name = (state.force_sum, "mean sums") if of_mean else (state.force, "sums")
        sources = (stepper.arrays, state, arrays)
        self.launches.run(
            name,
            k.sum_states,
            "first_block",
            stepper.blocks,
            *sources,
            unbalanced=unbalanced,
            keeps_arc_length=self._keeps_arc_length,
        )
        partial, sums = fetch(arrays.state_partial), self.stepper.sums
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

    def unbalanced_blocks(self, limit: float, world: int) -> int:
        """Blocks of a world with an unbalanced force above `limit` [N], in the last `sums`."""
        exceeds = fetch(self.arrays.state_partial)[:, int(k.UNBALANCED_MAX)] > limit**2
        return int(self.stepper.sums.total(exceeds[:, None].astype(float), np.array([world]))[0, 0])

    def renew_tension_offsets(self, stiffening: np.ndarray) -> None:
        """Move the tension offsets by the multiplier rate times the errors of the softening; `stiffening` [wire of all worlds]
        raises the stiffness."""
        stepper, state, arrays = self.stepper, self.stepper.state, self.arrays
        store(arrays.stiffening, stiffening)
        sources = (stepper.arrays, state, arrays)
        self.launches.run(
            "offsets",
            k.renew_tension_offsets,
            "first_node",
            range(stepper.rods.node_count),
            *sources,
            keeps_arc_length=self._keeps_arc_length,
        )

    def motion(self, rows: np.ndarray) -> np.ndarray:
        """[row] [J] motion since the last check times the change of the forces; it stands in `last_place`, `last_angle`."""
        stepper, state, arrays = self.stepper, self.stepper.state, self.arrays
        self.launches.run(
            "motion", k.find_motion, "first_block", stepper.blocks, stepper.arrays, state, arrays, partial=arrays.partial
        )
        return self._total(rows)

    def _total(self, rows: np.ndarray | None) -> np.ndarray:
        """[row] the sums of `partial`."""
        return self.stepper.sums.total(fetch(self.arrays.partial)[:, None], rows)[:, 0]

    def keep_motion(self) -> None:
        """Keep the state last evaluated for the next `motion`."""
        stepper = self.stepper
        sources = (stepper.arrays, stepper.state, self.arrays)
        self.launches.run("keep", k.keep_motion, "first_node", range(stepper.rods.node_count), *sources)

    def slow_motion(self, share: np.ndarray) -> None:
        """Reduce all velocities of each world to a share [world]."""
        stepper = self.stepper
        store(self._slowed, share)
        nodes = range(stepper.rods.node_count)
        self.launches.run("slow", k.slow_motion, "first_node", nodes, stepper.arrays, stepper.state, slowed=self._slowed)

    def twice_energy(self, move: wp.array, turn: wp.array, name: str, rows: np.ndarray | None = None) -> np.ndarray:
        """[row] [J] v . M v + w . I w of motions (node, 3) and [node], by the masses of the dynamics; `name` of both arrays."""
        stepper, arrays = self.stepper, self.arrays
        self.launches.run(
            name, sum_mass_products, "first_block", stepper.blocks, stepper.arrays, stepper.state,
            move=move, turn=turn, partial=arrays.partial,
        )  # fmt: skip
        return self._total(rows)
