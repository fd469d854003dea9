"""Dynamic relaxation of rods: damped steps of one second with fictitious masses.

fictitious_masses.py   masses that keep the step stable
adaptive_damping.py    damping by the motion from one convergence check to the next
axial_multipliers.py   multipliers that remove the error of a softened axial stiffness
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from ..compute.host import fetch, zeros
from ..kernels import rod_checks as k
from ..mechanics.numerics import AXIAL_ERROR, FASTEST_DAMPING, LOOK_AHEAD, STEP_MARGIN, error_ratio
from .adaptive_damping import AdaptiveDamping
from .axial_multipliers import AxialMultipliers
from .fictitious_masses import FictitiousMasses
from .rest_curve import RestCurve
from .rod_step import CHECK_STEPS, RodStepper
from .rods import Rods
from .step_bound import largest_rates, stable_step


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


class RodRelaxation:
    """Parts of the dynamic relaxation of rods, and what convergence checks sum."""

    KEPT = ("damping", "multipliers")

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
        self.damping = AdaptiveDamping(stepper, self.masses, has_history=has_history, knows_smooth=knows_smooth)
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
