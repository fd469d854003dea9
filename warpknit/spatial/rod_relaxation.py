"""Dynamic relaxation of rods: damped steps of one second with fictitious masses (fictitious_masses.py).

The damping is the critical one of the slowest mode that still moves (numerics.renewed_damping). The motion between two checks of
the convergence gives Rayleigh's quotient by the fictitious masses, and the mean kinetic energy.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from ..compute.host import fetch, is_in_place, store, store_at, zeros
from ..kernels import rod_checks as k
from ..kernels.rod_blocks import MOVES, RESTS, RESTS_BESIDE, ROD_BLOCK
from ..mechanics.numerics import (
    AXIAL_ERROR,
    FASTEST_DAMPING,
    LOCAL_ALLOWANCE,
    LOOK_AHEAD,
    STEP_MARGIN,
    error_ratio,
    renewed_damping,
)
from .fictitious_masses import FictitiousMasses
from .multipliers import AxialMultipliers
from .rest_curve import RestCurve
from .rod_arrays import OPEN_BORDER
from .rod_step import CHECK_STEPS, RodStepper
from .rods import Rods
from .step_bound import largest_rates, stable_step

VIBRATION = 3.0  # speed of the whole motion over the mean motion, above which it counts
# largest speed that counts by diagonal masses over banded ones: smooth motion's grows with the nodes a loop, from
# 10 to 13 with 20 over 20 to 25 with 28 to 57 to 63 with 64
SMOOTH = 24.0
LEAST_DAMPING = 0.003  # [1/s] banded masses leave few modes slower than half of that
CALM = 0.3  # of the tolerance of the residual, in a block at rest


@dataclass(frozen=True)
class StateSums:
    """Sums over the state last evaluated; [world] of the requested worlds."""

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
        """Errors of axial strains over their tolerance."""
        return error_ratio(self.excess_square, self.stretching, self.excess_max, AXIAL_ERROR)


class RestingBlocks:
    """Finds the blocks at rest, of a single world on a CPU. Blocks at the ends of wires, and of closed wires, always move.

    A block rests where forces nearly balance and axial strains are within their tolerance, in it and in the blocks beside it in
    its wire. Its nodes and their multipliers stay as they are. Checks evaluate the whole mesh: a block whose forces no longer
    balance moves again.
    """

    KEPT = ("_is_stale", "_is_allowed", "is_corrected")

    def __init__(self, stepper: RodStepper) -> None:
        self._stepper = stepper
        arrays, rods = stepper.arrays, stepper.rods
        self._first, self._count, wire = (fetch(of) for of in (arrays.block_first, arrays.block_count, arrays.block_wire))
        behind = self._first + self._count
        inside = (self._first > rods.wire_first[wire]) & (behind <= (rods.wire_first + rods.wire_count)[wire] - OPEN_BORDER)
        can_rest = stepper.worlds == 1 and is_in_place(stepper.device)
        self._may_rest = inside & ~rods.wire_closed[wire].astype(bool) & can_rest
        self._can_any = stepper.strip.ranks.any(bool(self._may_rest.any()))
        # number of each block in the mesh of all ranks
        of_wire = -(-stepper.strip.whole.wire_count // ROD_BLOCK)
        first_of_wire = (np.cumsum(of_wire) - of_wire)[stepper.strip.wire[wire]]
        self._of_mesh = first_of_wire + (self._first - rods.wire_first[wire]) // ROD_BLOCK
        self._partial = zeros((len(self._first), int(k.STATE_COLUMNS)), wp.float64, stepper.device)
        self._launch = stepper.launcher()
        self._is_allowed = np.zeros(stepper.worlds, dtype=bool)
        self.is_corrected = np.zeros(stepper.worlds, dtype=bool)  # membrane corrections bound the error of long waves
        self._is_stale = np.zeros(stepper.worlds, dtype=bool)  # the state has been moved from outside since the last evaluation

    @property
    def _rests(self) -> np.ndarray:
        """[block] whether its nodes rest."""
        return fetch(self._stepper.state.block_rest) != int(MOVES)

    def begin(self) -> None:
        """Begin a load: all blocks move."""
        self._is_allowed[:] = self.is_corrected[:] = False
        self.wake()

    def allow(self) -> None:
        """Let blocks rest under the present load, with membrane corrections."""
        self._is_allowed[:] = self.is_corrected[:] = True

    def end(self) -> None:
        """Let all blocks move up to the next load."""
        self._is_allowed[:] = False
        if self._rests.any():
            self.wake()
            self._stepper.factor_masses()

    def wake(self) -> None:
        """Let all blocks move."""
        store(self._stepper.state.block_rest, int(MOVES))

    def moved(self, rows: np.ndarray) -> None:
        """Note that the state of worlds has been moved from outside."""
        self._is_stale[rows] = True

    def renew_frames(self) -> None:
        """Evaluate a state moved from outside where nodes rest."""
        if self._is_stale.any() and self._stepper.strip.ranks.any(bool(self._rests.any())):
            self._stepper.evaluate(0.0)
        self._is_stale[:] = False

    def add_forces(self) -> None:
        """Set sums of forces on nodes at rest, by the state last evaluated."""
        state = self._stepper.state
        if (rests := self._rests).any():
            nodes = self._nodes(rests)
            fetch(state.force_sum)[nodes] = CHECK_STEPS * fetch(state.force)[nodes]

    def find(self, of_excess: dict[str, object], force: float) -> None:
        """Find the blocks at rest in the state last evaluated.

        of_excess: see `AxialMultipliers`; force [N]: tolerance of the residual.
        """
        if not self._can_any or not self._is_allowed.any():
            return
        stepper, state, most = self._stepper, self._stepper.state, (CALM * force) ** 2
        self._launch("resting", k.sum_states, **of_excess, unbalanced=state.force, state_partial=self._partial)
        square, largest, excess, excess_square = fetch(self._partial).T[
            [int(column) for column in (k.UNBALANCED_SQUARE, k.UNBALANCED_MAX, k.EXCESS_MAX, k.EXCESS_SQUARE)]
        ]
        calm = (square <= most * self._count) & (largest <= LOCAL_ALLOWANCE**2 * most)
        calm &= error_ratio(excess_square, self._count, excess, AXIAL_ERROR) <= 1.0
        found = (self._may_rest & _and_beside(calm))[stepper.blocks.start : stepper.blocks.stop]
        rests = np.concatenate(stepper.strip.ranks.everyone(found))[self._of_mesh]
        nodes = self._nodes(rests)
        fetch(state.velocity)[nodes] = 0.0
        fetch(state.spin)[nodes] = 0.0
        fetch(state.block_speed)[rests] = 0.0
        store(state.block_rest, np.where(rests, np.where(_and_beside(rests), int(RESTS), int(RESTS_BESIDE)), int(MOVES)))

    def _nodes(self, blocks: np.ndarray) -> np.ndarray:
        """[node] whether it is in one of these blocks."""
        return np.repeat(blocks, np.diff(np.append(self._first, self._stepper.rods.node_count)))


def _and_beside(blocks: np.ndarray) -> np.ndarray:
    """Which of the blocks, and the ones before and after them, are true."""
    padded = np.pad(blocks, 1)
    return np.asarray(padded[:-2] & blocks & padded[2:])


class AdaptiveDamping:
    """Renews the damping of worlds by their motion from check to check; measures its energy (kernels/rod_checks.py)."""

    KEPT = ("_last", "_has_last", "_last_slide")  # not the mean energy, which each check renews

    def __init__(
        self, stepper: RodStepper, masses: FictitiousMasses, resting: RestingBlocks, *, has_history: bool, knows_smooth: bool
    ) -> None:
        """has_history: whether wires slide or yield, also while they vibrate; knows_smooth: see `kinetic_energy`."""
        self._stepper, self._masses, self._resting, self._knows_smooth = stepper, masses, resting, knows_smooth
        self._vibration = 1.0 if has_history else VIBRATION
        nodes, device = stepper.rods.node_count, stepper.device
        self._last: dict[str, wp.array] = {  # [node] state at the last check; once `find_motion` has run, the motion since then
            "last_place": zeros(nodes, wp.vec3d, device),  # [m]
            "last_force": zeros(nodes, wp.vec3d, device),  # [N]
            "last_angle": zeros(nodes, wp.float64, device),  # [rad]
            "last_torque": zeros(nodes, wp.float64, device),  # [N m]
        }
        self._partial = zeros(len(stepper.arrays.block_first), wp.float64, device)  # [block]
        self._launch = stepper.launcher()
        # [world]
        self._has_last = np.zeros(stepper.worlds, dtype=bool)  # whether the state at the last check is known
        self._last_slide = np.zeros_like(self._slide())  # see `_slide`, at the last check
        self._mean_energy = np.full(stepper.worlds, np.nan)  # [J] kinetic energy of the mean motion since then, where known

    def renew(self, rows: np.ndarray, *, boundary: tuple[np.ndarray, np.ndarray] | None = None) -> None:
        """Renew the damping by the motion since the last check; in the state last evaluated.

        boundary: [row] [J] motion of the strains times the change of their forces, and twice the kinetic energy of that motion.
        """
        self._mean_energy[rows] = np.nan
        has_last = self._has_last[rows]
        rows = rows[has_last]
        if not len(rows):
            return
        stepper, steering = self._stepper, self._stepper.steering
        self._launch("motion", k.find_motion, partial=self._partial, **self._last)
        work = stepper.sums.total(fetch(self._partial)[:, None], rows)[:, 0]
        self._has_last[rows] = False
        if len(self._last_slide):  # both nodes move, and carry the mass; the force counts once
            place, force = (self._slide() - self._last_slide).T
            by_world = (value.reshape(stepper.worlds, -1) for value in (place, force))
            work += np.array([float(p @ f) for p, f in zip(*by_world, strict=True)])[rows]
            store_at(self._last["last_place"], (stepper.clamps.sliding_node, 1), place[:, None])
        moved = self._masses.twice_energy(self._last["last_place"], self._last["last_angle"], "moved", rows)
        if boundary is not None:
            work, moved = work + boundary[0][has_last], moved + boundary[1][has_last]
        self._mean_energy[rows] = 0.5 * moved / CHECK_STEPS**2
        steering.set(rows, damping=renewed_damping(steering.damping[rows], -work, moved, LEAST_DAMPING))

    def _slide(self) -> np.ndarray:
        """(sliding clamp, 2) [m] places of the sliding clamps, and [N] their forces."""
        clamps = self._stepper.clamps
        return np.zeros((0, 2)) if clamps is None else np.stack([clamps.place, clamps.force[:, 1]], axis=1)

    def motion(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray] | None:
        """Motion since the last check, after `renew`: of nodes (node, 3) [m] and sections [node] [rad], zero where held, and the
        changes of forces (node, 3) [N] and torques [node] [N m]. None where it is not known of all worlds.
        """
        if np.isnan(self._mean_energy).any():
            return None
        place, angle, force, torque = (fetch(self._last[f"last_{name}"]) for name in ("place", "angle", "force", "torque"))
        state = self._stepper.state
        return place.copy(), angle.copy(), fetch(state.force) - force, fetch(state.torque) - torque

    def kinetic_energy(self, rows: np.ndarray) -> np.ndarray:
        """[row] [J] of the mean motion since the last check; after a move from outside, of all motion.

        Where a contact comes and goes, its nodes vibrate about an equilibrium. Vibrations count VIBRATION times less, with
        diagonal masses, which overestimate smooth motion (SMOOTH). knows_smooth: motion with equal energies by banded masses and
        mean motion is no vibration: a loose mesh drifts for long with hardly any force. Where membrane corrections bound the
        error of long waves, all motion has banded masses.
        """
        whole, mean = 0.5 * self._stepper.steering.kinetic_twice[rows], self._mean_energy[rows]
        if (is_corrected := self._resting.is_corrected[rows]).any():
            whole = np.where(is_corrected, 0.5 * self._masses.twice_kinetic_energy(rows), whole)
        vibrates = ~(whole / self._vibration**2 <= mean)
        if vibrates.any():
            banded = 0.5 * self._masses.twice_kinetic_energy(rows)
            if self._knows_smooth:
                vibrates &= ~(banded / self._vibration**2 <= mean)
            whole = np.where(vibrates, np.minimum(whole, SMOOTH**2 * banded), whole)
        by_all = np.where(np.isnan(mean), whole, np.fmax(mean, whole / self._vibration**2))
        return np.where(vibrates, by_all, mean)

    def keep_motion(self, rows: np.ndarray) -> None:
        """Keep the state last evaluated for the next `renew`; velocities become kinetic energy in the control array."""
        self._launch("keep", k.keep_motion, **self._last)
        self._has_last[rows], self._last_slide = True, self._slide()
        self._stepper.steering.set(rows, kinetic_twice=self._masses.twice_kinetic_energy(rows))

    def stop_motion(self, rows: np.ndarray) -> None:
        """Stop all motion, after the state was moved from outside."""
        stepper, state, clamps = self._stepper, self._stepper.state, self._stepper.clamps
        stepper.steering.set(rows, damping=FASTEST_DAMPING, speed_max=0.0)
        for speed in (state.velocity, state.spin, *([] if clamps is None else [clamps.velocity])):
            stepper.store_rows(speed, rows, 0.0)
        self.reset(rows)

    def reset(self, rows: np.ndarray) -> None:
        """Start the estimate anew, after the state was moved from outside; velocities are kept."""
        self._has_last[rows] = False
        self._resting.moved(rows)


class RodRelaxation:
    """Parts of the dynamic relaxation of rods, and what convergence checks sum."""

    KEPT = ("damping", "multipliers", "resting")

    def __init__(
        self,
        stepper: RodStepper,
        *,
        softening: float = 1.0,
        wave_length: float | None = None,
        spacing_of: Rods | None = None,
        curve: RestCurve | None = None,
        multipliers: bool = True,
        has_history: bool = False,
        knows_smooth: bool = False,
        wire_stiffness: np.ndarray | None = None,
    ) -> None:
        """softening: true axial stiffness over the dynamic one; wave_length [m] of the slowest wave, default: the longest wire;
        spacing_of: rods whose spacing of nodes counts, default: the stepper's; curve: on which wires touch, default Catmull-Rom;
        multipliers: whether they correct the softening; has_history, knows_smooth: see `AdaptiveDamping`;
        wire_stiffness [wire] [N]: least axial stiffness of the dynamics.
        """
        self.stepper = stepper
        self.curve = curve
        stepper.set_time_step(1.0, FASTEST_DAMPING, LOOK_AHEAD)
        self.multipliers = AxialMultipliers(stepper, softening, wire_stiffness, correct=multipliers)
        keeps_arc_length = self.multipliers.keeps_arc_length
        self.masses = FictitiousMasses(stepper, wave_length, spacing_of, keeps_arc_length=keeps_arc_length)
        self.resting = RestingBlocks(stepper)
        self.damping = AdaptiveDamping(stepper, self.masses, self.resting, has_history=has_history, knows_smooth=knows_smooth)
        self.state_partial = zeros((len(stepper.arrays.block_first), int(k.STATE_COLUMNS)), wp.float64, stepper.device)
        self._launch = stepper.launcher()
        mesh = stepper.strip.whole
        counts = (int(np.count_nonzero(counted)) // stepper.worlds for counted in (mesh.is_free, mesh.can_stretch))
        self._free_nodes, self._stretching = counts
        self.masses.renew()

    def stable_time_step(self) -> float:
        """[s] stable time step for the current masses, turning angles and tensions."""
        state = self.stepper.state
        rates = largest_rates(
            self.stepper.rods,
            fetch(state.node_mass)[:, 0],
            fetch(state.spin_inertia),
            stretch_stiffness=self.multipliers.softened_stiffness,
            turning=self.stepper.rods.widest_turn(np.linalg.norm(fetch(state.curvature), axis=1)),
            tension=float(np.max(self.tension(), initial=0.0)),
            contact_stiffness=state.steering.contact_stiffness,
            curve=self.curve,
        )
        return STEP_MARGIN * stable_step(rates)

    def strain(self) -> np.ndarray:
        """[node] strain of the chords of the segments, in the state last evaluated."""
        state, rods = self.stepper.state, self.stepper.rods
        factor = self.stepper.steering.length_factor
        factor = factor[0] if len(factor) == 1 else np.repeat(factor, self.stepper.arrays.world_nodes)
        strain = fetch(state.length) / (rods.natural_length * factor) - 1.0
        return np.where(rods.following >= 0, strain, 0.0)

    def tension(self) -> np.ndarray:
        """[node] [N] tension of the segments, in the state last evaluated."""
        state = self.stepper.state
        tension = fetch(state.tension_offset) + fetch(state.stretch_stiffness) * self.strain()
        return np.where(self.stepper.rods.following >= 0, tension, 0.0)

    def sums(self, rows: np.ndarray | None = None, *, of_mean: bool) -> StateSums:
        """Sums of the last evaluated state with sliding clamps; all worlds or `rows`.

        of_mean: with the mean unbalanced forces of the last CHECK_STEPS steps. A contact may appear with a force: in equilibrium
        it then comes and goes, and balances in the mean. Forces of sliding clamps are present values.
        """
        stepper, state, sums, yielding = self.stepper, self.stepper.state, self.stepper.sums, self.stepper.yielding
        rows = stepper.rows if rows is None else rows
        unbalanced, name, steps = (state.force_sum, "mean sums", CHECK_STEPS) if of_mean else (state.force, "sums", 1)
        named = self.multipliers.of_excess | {"unbalanced": unbalanced, "state_partial": self.state_partial}
        self._launch(name, k.sum_states, **named)
        partial = fetch(self.state_partial)
        total, largest = sums.total(partial, rows), sums.largest(partial, rows)
        square = total[:, int(k.UNBALANCED_SQUARE)] / steps**2
        most, free = np.sqrt(largest[:, int(k.UNBALANCED_MAX)]) / steps, self._free_nodes
        energy = total[:, int(k.STRETCH_ENERGY)] + total[:, int(k.BEND_ENERGY)]
        if yielding.yields:
            energy = energy + yielding.plastic_potential()[rows]
        if stepper.clamps is not None and stepper.clamps.need_forces:
            force = np.abs(stepper.clamps.force[:, 1]).reshape(stepper.worlds, -1)[rows]
            square = square + np.array([float(own @ own) for own in force])
            most, free = np.maximum(most, force.max(axis=1)), free + force.shape[1]
        excess = (sums.of_wires(partial[:, int(k.EXCESS_SUM)]) / stepper.rods.wire_length).reshape(stepper.worlds, -1)
        return StateSums(
            unbalanced_square=square,
            unbalanced_max=most,
            free_nodes=free,
            energy=energy,
            excess_max=largest[:, int(k.EXCESS_MAX)],
            excess_square=total[:, int(k.EXCESS_SQUARE)],
            stretching=self._stretching,
            mean_excess=excess[rows],
        )

    def stop_motion(self, rows: np.ndarray | None = None) -> None:
        """Stop all motion, after the state was moved from outside; multipliers start with their full rate."""
        rows = self.stepper.rows if rows is None else rows
        self.multipliers.reset(rows)
        self.damping.stop_motion(rows)

    def begin_anew(self, rows: np.ndarray | None = None) -> None:
        """Start the damping estimate anew: with the multipliers' full rate, after a move that raised their errors."""
        rows = self.stepper.rows if rows is None else rows
        self.multipliers.reset(rows)
        self.damping.reset(rows)
