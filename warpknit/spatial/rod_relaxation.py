"""Dynamic relaxation of rods: damped steps of one second with fictitious masses.

The damping is the critical damping of the slowest mode that still moves (numerics.renewed_damping).

The dynamics may soften the axial stiffness. An augmented Lagrangian multiplier, the tension offset, removes the error:

    T = offset + K (|e|/L - 1)        offset -> offset + rate K (strain of the arc - T/EA)

The strain T/EA belongs to the arc of a segment, not to its chord (kernels/rod_forces.py), over its natural length at the local
temperature (`set_thermal_strain`).

The fictitious masses are banded along the wire. A diagonal mass that bounds the bending stiffness EI/h^3 of the shortest waves
makes long waves slow: their steps grow with the square of the nodes. A mass that is itself a difference operator along the wire
moves waves of all lengths at about the same rate (selective mass scaling: Olovsson, Simonsson and Unosson, Int. J. Numer. Methods
Eng. 63, 2005). Per node n between segments a and b, with turning angle p, moment m and lengths l, and per segment with axial
stiffness K and tension T, the stiffness is bounded by

    (1 + e) (B/l_n + bow) |dx_b/l_b - dx_a/l_a|^2                 bending across; bow = (T_a l_a + T_b l_b)/24, kernels/bend.py
    [(1 + 1/e) B + GJ] p^2/(2 l_n) (|dx_a|^2/l_a^2 + |dx_b|^2/l_b^2)        turning edges: the normals of a and b differ by p,
                                                                  |n_b . v - n_a . u|^2 <= (1 + e)|v - u|^2 + (1 + 1/e) p^2 ...
    |m| (|dx_a|^2/l_a^2 + |dx_b|^2/l_b^2)                         second derivative of the angle
    (K + T)/l |dx|^2                                              stretch along the segment, tension across
    k (sum of |w n|) |w_i n_x| dx_i^2, ...                        a contact k (w n . dx)^2 of normal n, by Cauchy and Schwarz,
                                                                  and the same along y and z

with the difference dx of the displacements of the two nodes of a segment and B = 19/9 EI, by which slopes of moments stiffen the
shortest waves (kernels/rod_forces.py); and of twist by EI/l_n (df_b - df_a)^2, as a sharp turn couples bending and twist, and
B p^2/(2 l_n) (df_a^2 + df_b^2). Displacements and twist are coupled: the stiffness of both is bounded by 1 + COUPLING times the
first and 1 + 1/COUPLING times the second. A quarter of the bound is the mass at the stability limit (kernels/rod_masses.py).

A uniform mass moves waves longer than `wave_length`, which carry almost no force.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from ..compute.arrays import array, new_arrays
from ..compute.host import fetch, lanes, store, store_at
from ..compute.team import SharedLaunches
from ..kernels import rod_checks as k
from ..kernels.banded_mass import HELD_NODE, HELD_TURN
from ..kernels.bend import BOW
from ..kernels.rod_blocks import ROD_LANES
from ..kernels.rod_checks import STATE_COLUMNS
from ..kernels.rod_masses import find_masses
from ..kernels.rod_sums import sum_mass_products
from ..mechanics.numerics import (
    AXIAL_ERROR,
    FASTEST_DAMPING,
    LOOK_AHEAD,
    MASS_MARGIN,
    SPEED_SHARE,
    STEP_MARGIN,
    error_ratio,
    renewed_damping,
)
from .clamps import MovingClamps
from .rest_curve import RestCurve
from .rod_step import EVALUATED, RodStepper
from .rods import Rods
from .step_bound import SLOPE_FACTOR, largest_rates, stable_step

CHECK_STEPS = 25  # steps between convergence checks
# of multipliers, see `multiplier_rate`
MAX_RATE, MIN_RATE, RATE_TO_DAMPING = 0.5, 0.05, 0.5
PROGRESS = 0.9  # of the least residual ratio: counts as progress
# checks without progress before the rate is lowered, and to which share of it; factor by which it is raised with progress
RATE_PATIENCE, LOWERED_RATE, RAISED_RATE = 12, 0.6, 1.5
# checks without progress at the least rate after which all wires are made stiffer, by which factor, and share of the axial strain
# in the residual ratio from which on
SOFT_PATIENCE, SOFT_FACTOR, SOFT_SHARE = 24, 4.0, 0.99
APPROACH = 2.4  # of two wires, over the largest displacement
# thicknesses: largest displacement a step of wires that may touch, and the least limit; up to FASTER times the speed
CONTACT_SPEED, LEAST_SPEED, FASTER = 0.1, 0.001, 1.5
# a wire is taut if its mean excess strain stays above TAUT_ERROR AXIAL_ERROR for this number of checks
TAUT_ERROR, TAUT_PROGRESS = 20.0, (0.5, 8)
# the same where axial strain is what keeps the mesh from convergence
LEADING_ERROR, LEADING_PROGRESS = 5.0, (0.5, 3)
TAUT_FACTOR = 4.0  # by which a taut wire is made stiffer: its mean excess strain has stalled
VIBRATION = 3.0  # speed of the whole motion over the mean motion, above which it counts
# largest speed that counts by diagonal masses over banded ones: smooth motion's grows with the nodes a loop, from
# 10 to 13 with 20 over 20 to 25 with 28 to 57 to 63 with 64
SMOOTH = 24.0
# [1/s] banded masses leave few modes slower than half of the first; the second where overshoots would slide or yield wires
LEAST_DAMPING, LEAST_OF_HISTORY = 0.003, 0.01
COUPLING = 0.5  # of displacements and twist


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


class Stalled:
    """Softened constraints that have stalled: their error stays above its tolerance.

    Errors are (world, constraint), over the convergence checks.
    """

    KEPT = ("best", "checks")

    def __init__(self, worlds: int, count: int, tolerance: float, progress: float, patience: int) -> None:
        """Progress: an error falls to the share `progress` of itself within `patience` checks."""
        self._tolerance, self._progress, self._patience = tolerance, progress, patience
        self.best = np.full((worlds, count), np.inf)  # error at the last progress
        self.checks = np.zeros((worlds, count), dtype=int)  # without progress since

    def reset(self, rows: np.ndarray) -> None:
        """Start some worlds anew."""
        self.best[rows], self.checks[rows] = np.inf, 0

    def after(self, error: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """(row, constraint) whether a constraint has stalled, with the errors of a check; its count then starts anew."""
        waits = (error > self._tolerance) & (error > self._progress * self.best[rows])
        self.best[rows] = np.where(waits, self.best[rows], error)
        checks = np.where(waits, self.checks[rows] + 1, 0)
        stalled = checks >= self._patience
        self.checks[rows] = np.where(stalled, 0, checks)
        return stalled


class RodRelaxation:
    """Fictitious masses, damping and multipliers of the dynamic relaxation of rods."""

    # not the mean energy, which each check renews
    KEPT = (
        "arrays", "clamps", "_has_multipliers", "_has_last", "_last_slide", "_rate", "_best_ratio", "_stalled", "_ratio",
        "_has_risen", "_excess_leads", "_taut", "_leading",
    )  # fmt: skip

    def __init__(
        self,
        stepper: RodStepper,
        *,
        softening: float = 1.0,
        wave_length: float | None = None,
        spacing_of: Rods | None = None,
        curve: RestCurve | None = None,
        clamps: MovingClamps | None = None,
        multipliers: bool = True,
        has_history: bool = False,
        knows_smooth: bool = False,
        wire_stiffness: np.ndarray | None = None,
    ) -> None:
        """softening: true axial stiffness over the dynamic one; wave_length [m] of the slowest wave, default: the longest wire;
        spacing_of: rods whose spacing of nodes counts, default: the stepper's; curve: on which wires touch, default Catmull-Rom;
        clamps: moving ones, of the same stepper; multipliers: whether they correct the softening; has_history: whether wires
        slide or yield, also while they vibrate; knows_smooth: see `kinetic_energy`;
        wire_stiffness [wire] [N]: least axial stiffness of the dynamics.
        """
        self.stepper = stepper
        self.clamps = clamps
        self.softening = softening
        self.curve = curve
        rods, state = stepper.rods, stepper.state
        self.has_segment = rods.following >= 0
        self.free = (rods.held & int(HELD_NODE)) == 0
        # a segment with two held nodes is rigid, whatever its tension
        self.can_stretch = self.has_segment & (self.free | self.free[rods.following])
        self.free_sections = ((rods.held & int(HELD_TURN)) == 0) & self.has_segment
        self.softened_stiffness = rods.section.axial_stiffness / softening
        least = 0.0
        if wire_stiffness is not None:  # beside a clamp the half segment inside it stretches too
            least = wire_stiffness[rods.wire_of] / (1.0 + rods.half_in_clamp / rods.natural_length)
        store(state.stretch_stiffness, np.maximum(least, rods.of_nodes("axial_stiffness") / softening))
        stepper.set_time_step(1.0, FASTEST_DAMPING, LOOK_AHEAD)
        stepper.evaluate()
        self.keeps_arc_length = multipliers and softening != 1.0
        worlds = stepper.worlds
        self._has_multipliers = np.full(worlds, self.keeps_arc_length)
        self.stored_softening = 1.0 if multipliers else softening
        stepper.steering.set(bow_moment=2.0 * float(BOW) if self.keeps_arc_length else 0.0)
        mesh = stepper.strip.whole
        spaced = spacing_of or mesh
        least = float(spaced.natural_length[spaced.following >= 0].min())
        self._largest_move = SPEED_SHARE * least  # [m] a step
        if stepper.contact is not None:
            self._largest_move = min(self._largest_move, CONTACT_SPEED * rods.section.thickness)
        stepper.steering.set(drive=0.0, step_limit=least)
        sliding = np.zeros((0, 2), dtype=np.int64) if clamps is None else clamps.sliding_node
        longest = float(mesh.wire_length.max())
        bow = np.zeros(rods.node_count)  # relative excess of the arc over the chord of each segment (kernels/bend.py)
        if self.keeps_arc_length:
            square, (weight, next_weight) = np.sum(fetch(state.curvature) ** 2, axis=1), rods.bow_weights
            bow = float(BOW) * (weight * square + next_weight * square[rods.following])
        is_sliding, blocks = np.zeros(rods.node_count, dtype=np.int32), len(stepper.arrays.block_first)
        is_sliding[sliding] = 1
        counts = {"node": rods.node_count, "wire": len(rods.wire_first), "world": worlds, "block": blocks}
        values = {"bow_weight": np.stack(rods.bow_weights, axis=1), "bow_at_rest": bow, "is_sliding": is_sliding}
        self.arrays = new_arrays(CheckArrays, stepper.device, counts, values)
        self._launches = SharedLaunches(stepper.team, stepper.device, stepper.few)
        free = (mesh.held & int(HELD_NODE)) == 0
        self._free_nodes = int(np.count_nonzero(free)) // worlds
        self._stretching = int(np.count_nonzero((mesh.following >= 0) & (free | free[mesh.following]))) // worlds
        slowest = longest if wave_length is None else wave_length
        self._of_masses = slowest, float(spaced.natural_length[spaced.following >= 0].mean())
        self._knows_smooth = knows_smooth
        self._vibration = 1.0 if has_history else VIBRATION
        self._least_damping = LEAST_OF_HISTORY if has_history else LEAST_DAMPING
        # [world]
        self._has_last = np.zeros(worlds, dtype=bool)  # whether the state at the last check is known
        self._last_slide = np.zeros((len(sliding), 2))  # [m] of the sliding clamps then, and [N] their forces
        self._mean_energy = np.full(worlds, np.nan)  # [J] kinetic energy of the mean motion since the last check, where known
        self._rate, self._best_ratio = np.full(worlds, MAX_RATE), np.full(worlds, np.inf)
        self._ratio, self._has_risen = np.full(worlds, np.inf), np.zeros(worlds, dtype=bool)
        self._stalled = np.zeros(worlds, dtype=int)  # checks without progress
        self._is_too_soft = np.zeros(worlds, dtype=bool)  # for the multipliers to converge
        wires = len(rods.wire_first) // worlds  # mean excess strain of each
        self._taut = Stalled(worlds, wires, TAUT_ERROR * AXIAL_ERROR, *TAUT_PROGRESS)
        self._leading = Stalled(worlds, wires, LEADING_ERROR * AXIAL_ERROR, *LEADING_PROGRESS)
        self._excess_leads = np.zeros(worlds, dtype=bool)  # of all criteria, at the last check
        self.renew_masses()

    def set_thermal_strain(self, thermal_strain: np.ndarray, world: int = 0) -> None:
        """Set the strain [node] of the natural lengths of a world beyond its length factor; the multipliers apply it."""
        self.stepper.store_rows(self.arrays.thermal_strain, np.array([world]), thermal_strain)
        self._has_multipliers[world] |= self.stepper.strip.ranks.any(bool(thermal_strain.any()))

    def renew_masses(self, rows: np.ndarray | None = None, *, loading: bool | np.ndarray = False) -> None:
        """Evaluate the state and renew its fictitious masses, without more kinetic energy. Of all worlds, or of `rows`.

        The speed is limited so that only contacts that the masses allow for can touch until the next convergence check. While
        loading [row], wires may move at any speed.
        """
        stepper = self.stepper
        with stepper.only(rows) as own:
            move = np.full(len(own), self._largest_move)
            if stepper.contact is not None:
                thickness = stepper.rods.section.thickness
                slow = np.maximum(FASTER * stepper.steering.speed_max[own], LEAST_SPEED * thickness)
                move = np.where(np.broadcast_to(loading, own.shape), move, np.minimum(move, slow))
                approach = np.minimum(APPROACH * CHECK_STEPS * move, EVALUATED * thickness)
                stepper.contact.list_near_pairs(CHECK_STEPS * move, own)
                stepper.evaluate(approach, rows=own)
                stepper.contact.bound_stiffness(own)
            else:
                stepper.evaluate(rows=own)
            stepper.steering.set(own, speed_limit=move)
            before = self._twice_energy(own)
            self._set_masses()
            now = self._twice_energy(own)
            if np.any(now > before):
                slower = np.ones(stepper.worlds)
                slower[own] = np.sqrt(np.divide(before, now, out=np.ones(len(own)), where=now > before))
                store(self.arrays.slowed, slower)
                self._launch(k.slow_motion)
                if self.clamps is not None:
                    each = len(fetch(self.clamps.velocity)) // stepper.worlds
                    store(self.clamps.velocity, np.repeat(slower, each) * fetch(self.clamps.velocity))

    def _set_masses(self) -> None:
        """Set fictitious masses for the state last evaluated, by the bound above."""
        stepper, (wave_length, spacing) = self.stepper, self._of_masses
        wave, share, spin_share = (
            2.0 * math.pi / wave_length,
            *(0.25 * MASS_MARGIN * (1.0 + x) for x in (COUPLING, 1.0 / COUPLING)),
        )
        threads, touches = lanes(ROD_LANES, stepper.device), stepper.contact is not None
        self._launch(
            find_masses, f"masses {touches}", threads=threads, threads_a_block=threads, may_touch=wp.int32(touches),
            slope_factor=wp.float64(SLOPE_FACTOR), hardening=wp.float64(stepper.rods.section.hardening),
            keeps_arc_length=wp.int32(self.keeps_arc_length), share=wp.float64(share), spin_share=wp.float64(spin_share),
            wave_square=wp.float64(wave**2), wave_fourth=wp.float64(wave**4), spacing=wp.float64(spacing),
        )  # fmt: skip
        stepper.factor_masses()

    def _launch(self, kernel: wp.Kernel, name: str = "", **named: Any) -> None:
        """Launch a kernel for the own blocks or nodes; name: of the recorded launch, default the kernel's."""
        self.stepper.share_launch(self._launches, name or kernel.key, kernel, self.arrays, **named)

    def _partial_sums(self, rows: np.ndarray) -> np.ndarray:
        """[row] sums of `partial`."""
        return self.stepper.sums.total(fetch(self.arrays.partial)[:, None], rows)[:, 0]

    def twice_energy(self, move: wp.array, turn: wp.array, name: str, rows: np.ndarray) -> np.ndarray:
        """[row] [J] v . M v + w . I w of motions (node, 3) and [node], by the masses of the dynamics; `name` of both arrays."""
        self._launch(sum_mass_products, name, move=move, turn=turn, partial=self.arrays.partial)
        return self._partial_sums(rows)

    def _twice_energy(self, rows: np.ndarray) -> np.ndarray:
        """Twice the kinetic energy of nodes and sections [row] [J], with sliding clamps."""
        state = self.stepper.state
        if self.clamps is None or not len(self.clamps.sliding):
            return self.twice_energy(state.velocity, state.spin, "energy", rows)
        sliding, velocity = self.clamps.sliding_node, fetch(state.velocity).copy()
        store_at(state.velocity, (sliding, 1), fetch(self.clamps.velocity)[self.clamps.sliding][:, None])
        energy = self.twice_energy(state.velocity, state.spin, "energy", rows)
        store(state.velocity, velocity)
        return energy

    def stable_time_step(self) -> float:
        """[s] stable time step for the current masses, turning angles and tensions."""
        state = self.stepper.state
        rates = largest_rates(
            self.stepper.rods,
            fetch(state.node_mass)[:, 0],
            fetch(state.spin_inertia),
            stretch_stiffness=self.softened_stiffness,
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
        return np.where(self.has_segment, strain, 0.0)

    def tension(self) -> np.ndarray:
        """[node] [N] tension of the segments, in the state last evaluated."""
        state = self.stepper.state
        tension = fetch(state.tension_offset) + fetch(state.stretch_stiffness) * self.strain()
        return np.where(self.has_segment, tension, 0.0)

    def sums(self, rows: np.ndarray | None = None, *, of_mean: bool) -> StateSums:
        """Sums of the last evaluated state with sliding clamps; all worlds or `rows`.

        of_mean: with the mean unbalanced forces of the last CHECK_STEPS steps. A contact may appear with a force: in equilibrium
        it then comes and goes, and balances in the mean. Forces of sliding clamps are present values.
        """
        rows = self.stepper.rows if rows is None else rows
        stepper, state, sums, yielding = self.stepper, self.stepper.state, self.stepper.sums, self.stepper.yielding
        unbalanced, name, steps = (state.force_sum, "mean sums", CHECK_STEPS) if of_mean else (state.force, "sums", 1)
        self._launch(k.sum_states, name, unbalanced=unbalanced, keeps_arc_length=wp.int32(self.keeps_arc_length))
        partial = fetch(self.arrays.state_partial)
        total, largest = sums.total(partial, rows), sums.largest(partial, rows)
        square = total[:, int(k.UNBALANCED_SQUARE)] / steps**2
        most, free = np.sqrt(largest[:, int(k.UNBALANCED_MAX)]) / steps, self._free_nodes
        energy = total[:, int(k.STRETCH_ENERGY)] + total[:, int(k.BEND_ENERGY)]
        if yielding.yields:
            energy = energy + yielding.plastic_potential()[rows]
        if self.clamps is not None and len(self.clamps.sliding):
            force = np.abs(self.clamps.force[:, 1]).reshape(stepper.worlds, -1)[rows]
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

    def renew_damping(self, rows: np.ndarray | None = None, *, boundary: tuple[np.ndarray, np.ndarray] | None = None) -> None:
        """Renew the damping by the motion since the last check: Rayleigh's quotient in the last evaluated state.

        boundary: [row] [J] motion of the strains times the change of their forces, and twice the kinetic energy of that motion.
        """
        rows = self.stepper.rows if rows is None else rows
        self._mean_energy[rows] = np.nan
        has_last = self._has_last[rows]
        rows = rows[has_last]
        if not len(rows):
            return
        arrays, steering = self.arrays, self.stepper.steering
        self._launch(k.find_motion, partial=arrays.partial)
        work = self._partial_sums(rows)
        self._has_last[rows] = False
        if self.clamps is not None and len(self.clamps.sliding):  # both nodes move, and carry the mass; the force counts once
            place, force = (self._slide() - self._last_slide).T
            by_world = (value.reshape(self.stepper.worlds, -1) for value in (place, force))
            work += np.array([float(p @ f) for p, f in zip(*by_world, strict=True)])[rows]
            store_at(arrays.last_place, (self.clamps.sliding_node, 1), place[:, None])
        moved = self.twice_energy(arrays.last_place, arrays.last_angle, "moved", rows)
        if boundary is not None:
            work, moved = work + boundary[0][has_last], moved + boundary[1][has_last]
        self._mean_energy[rows] = 0.5 * moved / CHECK_STEPS**2
        steering.set(rows, damping=renewed_damping(steering.damping[rows], -work, moved, self._least_damping))

    def _slide(self) -> np.ndarray:
        """(sliding clamp, 2) [m] places of the sliding clamps, and [N] their forces."""
        return np.zeros((0, 2)) if self.clamps is None else np.stack([self.clamps.place, self.clamps.force[:, 1]], axis=1)

    def kinetic_energy(self, rows: np.ndarray) -> np.ndarray:
        """[row] [J] of the mean motion since the last check; after a move from outside, of all motion.

        Where a contact comes and goes, its nodes vibrate about an equilibrium. Vibrations count VIBRATION times less, with
        diagonal masses, which overestimate smooth motion (SMOOTH). knows_smooth: motion with equal energies by banded masses and
        mean motion is no vibration: a loose mesh drifts for long with hardly any force.
        """
        whole, mean = 0.5 * self.stepper.steering.kinetic_twice[rows], self._mean_energy[rows]
        vibrates = ~(whole / self._vibration**2 <= mean)
        if vibrates.any():
            banded = 0.5 * self._twice_energy(rows)
            if self._knows_smooth:
                vibrates &= ~(banded / self._vibration**2 <= mean)
            whole = np.where(vibrates, np.minimum(whole, SMOOTH**2 * banded), whole)
        by_all = np.where(np.isnan(mean), whole, np.fmax(mean, whole / self._vibration**2))
        return np.where(vibrates, by_all, mean)

    def multiplier_rate(self, rows: np.ndarray) -> np.ndarray:
        """[row] share of its error that a multiplier removes at a convergence check.

        If a multiplier removes the share r of the error of a mode in each step, the mode with damping c is stable for r < c.
        Multipliers of contact and of tension together may still excite a slow mode: without progress the rate is lowered, and
        raised again with it.
        """
        return np.minimum(self._rate[rows], RATE_TO_DAMPING * CHECK_STEPS * self.stepper.steering.damping[rows])

    def monitor_progress(self, ratio: np.ndarray, excess: np.ndarray, rows: np.ndarray) -> None:
        """Lower the multipliers' rate where the residual ratio [row] stalls; else raise it.

        excess: the part of the ratio that errors of axial strains have.

        Multipliers converge where the softened stiffness exceeds the negative stiffness of a snap-through (Nocedal and Wright
        2006, Numerical Optimization, 17.3: the penalty of an augmented Lagrangian). Where the axial strain makes no progress at
        the least rate, all wires are made stiffer.
        """
        self._excess_leads[rows] = excess >= SOFT_SHARE * ratio
        self._has_risen[rows] |= ratio > self._ratio[rows]
        self._ratio[rows] = ratio
        is_better = ratio < PROGRESS * self._best_ratio[rows]
        better, others = rows[is_better], rows[~is_better]
        self._best_ratio[better], self._stalled[better], self._has_risen[better] = ratio[is_better], 0, False
        self._rate[better] = np.minimum(MAX_RATE, RAISED_RATE * self._rate[better])
        self._stalled[others] += 1
        is_due = (self._rate[others] > MIN_RATE) & (self._stalled[others] >= RATE_PATIENCE)
        due, slowest = others[is_due], others[~is_due & (self._stalled[others] >= SOFT_PATIENCE)]
        lowered = due[self._has_risen[due]]
        self._rate[lowered] = np.maximum(MIN_RATE, LOWERED_RATE * self._rate[lowered])
        self._stalled[due], self._has_risen[due] = 0, False
        self._is_too_soft[slowest] = self._excess_leads[slowest]

    def _reset_rate(self, rows: np.ndarray) -> None:
        """Start with the full rate of the multipliers."""
        self._rate[rows], self._best_ratio[rows], self._stalled[rows], self._is_too_soft[rows] = MAX_RATE, np.inf, 0, False
        self._ratio[rows], self._has_risen[rows] = np.inf, False
        self._taut.reset(rows)
        self._leading.reset(rows)

    def renew_multipliers(
        self, sums: StateSums | None = None, rows: np.ndarray | None = None, *, loading: bool | np.ndarray = False
    ) -> None:
        """Move tension offsets by the error of the softening; stiffen taut wires. sums: of that state, where they are known."""
        rows = self.stepper.rows if rows is None else rows
        has = self._has_multipliers[rows]
        if not has.any():
            return
        sums = self.sums(rows, of_mean=False) if sums is None else sums
        stiffening = np.ones((self.stepper.worlds, sums.mean_excess.shape[1]))
        stiffens = has & ~np.broadcast_to(loading, rows.shape)
        if stiffens.any():
            stiffening[rows[stiffens]] = self._stiffening(sums.mean_excess[stiffens], rows[stiffens])
        self.stepper.steering.set(rows, multiplier_rate=np.where(has, self.multiplier_rate(rows), 0.0))
        store(self.arrays.stiffening, stiffening.ravel())
        self._launch(k.renew_tension_offsets, keeps_arc_length=wp.int32(self.keeps_arc_length))

    def _stiffening(self, mean_excess: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """(row, wire) factor of the softened axial stiffness where a wire is taut: its mean excess strain is imposed and makes no
        progress."""
        raised, leading = (stalled.after(np.abs(mean_excess), rows) for stalled in (self._taut, self._leading))
        raised |= leading & self._excess_leads[rows][:, None]
        too_soft = self._is_too_soft[rows]
        self._reset_rate(rows[too_soft])
        return np.where(too_soft[:, None], SOFT_FACTOR, np.where(raised, TAUT_FACTOR, 1.0))

    def keep_motion(self, rows: np.ndarray | None = None) -> None:
        """Keep the state last evaluated for the next `renew_damping`; velocities become kinetic energy in the control array."""
        rows = self.stepper.rows if rows is None else rows
        self._launch(k.keep_motion)
        self._has_last[rows], self._last_slide = True, self._slide()
        self.stepper.steering.set(rows, kinetic_twice=self._twice_energy(rows))

    def stop_motion(self, rows: np.ndarray | None = None) -> None:
        """Stop all motion, after the state was moved from outside; multipliers start with their full rate."""
        rows, stepper = self.stepper.rows if rows is None else rows, self.stepper
        self._reset_rate(rows)
        stepper.steering.set(rows, damping=FASTEST_DAMPING, speed_max=0.0)
        moving = [stepper.state.velocity, stepper.state.spin, *([] if self.clamps is None else [self.clamps.velocity])]
        for speed in moving:
            stepper.store_rows(speed, rows, 0.0)
        self._has_last[rows] = False

    def reset_damping_estimate(self, rows: np.ndarray | None = None) -> None:
        """Start the damping estimate anew, after the state was moved from outside; velocities are kept."""
        self._has_last[self.stepper.rows if rows is None else rows] = False

    def begin_anew(self, rows: np.ndarray | None = None) -> None:
        """Start the damping estimate anew: with the multipliers' full rate, after a move that raised their errors."""
        self._reset_rate(self.stepper.rows if rows is None else rows)
        self.reset_damping_estimate(rows)
