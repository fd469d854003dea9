"""Dynamic relaxation of rods: damped steps of one second with fictitious masses.

The damping is the critical damping of the slowest mode that still moves (numerics.renewed_damping).

The dynamics may soften the axial stiffness; an augmented Lagrangian multiplier, the tension offset, takes the error out again:

    T = offset + K (|e|/L - 1)        offset -> offset + RATE K (strain of the arc - T/EA)

The strain T/EA is that of the arc of a segment, not of its chord (kernels/rod_bend.py), over its natural length at the local
temperature (`set_thermal_strain`).
"""

from __future__ import annotations

import math

import numpy as np

from ..kernels import control as c
from ..kernels.bend import BOW
from ..kernels.rod_motion import HELD_NODE, HELD_TURN
from ..numerics import FIRST_DAMPING, LOOK_AHEAD, SPEED_SHARE, STEP_MARGIN, renewed_damping
from .clamps import MovingClamps
from .rest_curve import RestCurve
from .rod_step import RodStepper
from .step_bound import largest_rates, stable_step, unit_step_masses

MULTIPLIER_RATE = 0.05  # a higher rate excites the wires, which the damping estimate would take for a stiff mode


class RodRelaxation:
    """Fictitious masses, damping and multipliers of the dynamic relaxation of rods."""

    def __init__(
        self,
        stepper: RodStepper,
        *,
        softening: float = 1.0,
        contact_stiffness: float = 0.0,
        stick_stiffness: float = 0.0,
        curve: RestCurve | None = None,
        clamps: MovingClamps | None = None,
        multipliers: bool = True,
    ) -> None:
        """softening: true axial stiffness over that of the dynamics; stick_stiffness [N/m] tangential, of friction; curve: on
        which wires touch, default Catmull-Rom; clamps: moving ones, of the same stepper; multipliers: whether they correct the
        softening."""
        self.stepper = stepper
        self.clamps = clamps
        self.softening = softening
        self.contact_stiffness, self.stick_stiffness, self.curve = contact_stiffness, stick_stiffness, curve
        self.min_damping = 0.0  # [1/s]
        rods, state = stepper.rods, stepper.state
        self.has_segment = rods.following >= 0
        self.free = (rods.held & int(HELD_NODE)) == 0
        # a segment with two held nodes is rigid, whatever its tension
        self.can_stretch = self.has_segment & (self.free | self.free[rods.following])
        self.free_sections = ((rods.held & int(HELD_TURN)) == 0) & self.has_segment
        self.softened_stiffness = rods.section.axial_stiffness / softening
        state.stretch_stiffness.fill_(self.softened_stiffness)
        stepper.set_time_step(1.0, FIRST_DAMPING, LOOK_AHEAD)
        stepper.evaluate()
        self.keeps_arc_length = multipliers and softening != 1.0
        self.thermal_strain = np.zeros(rods.node_count)  # [node] of the segments, relative to the length factor
        self._has_multipliers = self.keeps_arc_length
        self.stored_stiffness = (
            rods.section.axial_stiffness if multipliers else self.softened_stiffness
        )  # [N] that stretch is stored with
        self._bow_at_rest = self._bow() if self.keeps_arc_length else np.zeros(rods.node_count)
        state.write_control({c.BOW_MOMENT: 2.0 * float(BOW) if self.keeps_arc_length else 0.0})
        self.spacing = spacing = float(rods.natural_length[self.has_segment].min())
        self.speed_limit = SPEED_SHARE * spacing  # [m] a step
        state.write_control({c.DRIVE: 0.0, c.STEP_LIMIT: spacing})
        self.renew_masses()
        self._last_check: tuple[np.ndarray, np.ndarray] | None = None

    def set_thermal_strain(self, thermal_strain: np.ndarray) -> None:
        """Set the strain [node] of the natural lengths beyond the common length factor; the multipliers apply it."""
        self.thermal_strain = thermal_strain
        self._has_multipliers |= bool(thermal_strain.any())

    def renew_masses(self) -> None:
        """Renew the fictitious masses for the current turning angles and tensions; velocities are kept."""
        state = self.stepper.state
        mass, inertia = unit_step_masses(
            self.stepper.rods,
            stretch_stiffness=self.softened_stiffness,
            turning=self.turning(),
            tension=float(np.max(self.tension(), initial=0.0)),
            contact_stiffness=self.contact_stiffness,
            stick_stiffness=self.stick_stiffness,
            curve=self.curve,
        )
        state.node_mass.assign(mass)
        state.spin_inertia.assign(inertia)
        self.speed_limit = min(SPEED_SHARE * self.spacing, self._pass_through_speed(mass))
        state.write_control({c.SPEED_LIMIT: self.speed_limit})

    def _pass_through_speed(self, mass: np.ndarray) -> float:
        """[m/s] largest speed at which the penalty stops two colliding wires before their centre lines cross.

        2 M v^2/2 = k (d/2)^2/2 for the heaviest wire; infinite without contact.
        """
        rods = self.stepper.rods
        if self.contact_stiffness == 0.0:
            return math.inf
        heaviest = float(np.add.reduceat(mass, rods.wire_first).max())
        return float(rods.wire_radius.min()) * math.sqrt(self.contact_stiffness / (2.0 * heaviest))

    def stable_time_step(self) -> float:
        """[s] stable time step for the current masses, turning angles and tensions."""
        state = self.stepper.state
        rates = largest_rates(
            self.stepper.rods,
            state.node_mass.numpy(),
            state.spin_inertia.numpy(),
            stretch_stiffness=self.softened_stiffness,
            turning=self.turning(),
            tension=float(np.max(self.tension(), initial=0.0)),
            contact_stiffness=float(state.read_control()[int(c.CONTACT_STIFFNESS)]),
            curve=self.curve,
        )
        return STEP_MARGIN * stable_step(rates)

    def turning(self) -> np.ndarray:
        """[node] [rad] largest turning angle at a node and its neighbours, in the state last evaluated."""
        return self.stepper.rods.widest_turn(np.linalg.norm(self.stepper.state.curvature.numpy(), axis=1))

    def strain(self) -> np.ndarray:
        """[node] strain of the chords of the segments, in the state last evaluated."""
        state, rods = self.stepper.state, self.stepper.rods
        factor = float(state.read_control()[int(c.LENGTH_FACTOR)])
        strain = state.length.numpy() / (rods.natural_length * factor) - 1.0
        return np.where(self.has_segment, strain, 0.0)

    def arc_strain(self) -> np.ndarray:
        """[node] strain of the arcs of the segments; of their chords where arc lengths are not kept."""
        if not self.keeps_arc_length:
            return self.strain()
        return np.where(self.has_segment, self.strain() + self._bow() - self._bow_at_rest, 0.0)

    def _bow(self) -> np.ndarray:
        """[node] relative excess of the arc over the chord of each segment (kernels/bend.py)."""
        square = np.sum(self.stepper.state.curvature.numpy() ** 2, axis=1)
        return float(BOW) * (square + square[self.stepper.rods.following])

    def tension(self) -> np.ndarray:
        """[node] [N] tension of the segments, in the state last evaluated."""
        state = self.stepper.state
        tension = state.tension_offset.numpy() + state.stretch_stiffness.numpy() * self.strain()
        return np.where(self.has_segment, tension, 0.0)

    def unbalanced_forces(self) -> np.ndarray:
        """(free node, 3) [N] unbalanced forces in the state last evaluated, then those of sliding clamps."""
        free = self.stepper.state.force.numpy()[self.free]
        return free if self.clamps is None else np.concatenate([free, self.clamps.force])

    def unbalanced_torques(self) -> np.ndarray:
        """[free segment] [N m] unbalanced torques in the state last evaluated."""
        return self.stepper.state.torque.numpy()[self.free_sections]

    def stretch_error(self) -> float:
        """Largest difference between strain and T/EA: the remaining error of the softening."""
        return float(np.abs(self._excess_strain()[self.can_stretch]).max(initial=0.0))

    def _excess_strain(self) -> np.ndarray:
        """[node] mechanical strain of the segments less T/EA."""
        strain = (self.arc_strain() - self.thermal_strain) / (1.0 + self.thermal_strain)
        return strain - self.tension() / self.stepper.rods.section.axial_stiffness

    def update(self) -> None:
        """Evaluate the state; renew damping and multipliers."""
        stepper, state = self.stepper, self.stepper.state
        stepper.evaluate()
        if self._has_multipliers:
            offset = state.tension_offset.numpy() + MULTIPLIER_RATE * self.softened_stiffness * self._excess_strain()
            state.tension_offset.assign(np.where(self.can_stretch, offset, 0.0))
        mass, place = state.node_mass.numpy()[self.free], state.displacement.numpy()[self.free]
        if self.clamps is not None:
            mass = np.concatenate([mass, self.clamps.mass])
            place = np.concatenate([place, self.clamps.place[:, None] * [0.0, 1.0, 0.0]])
        mass = np.concatenate([np.repeat(mass, 3), state.spin_inertia.numpy()[self.free_sections]])
        place = np.concatenate([place.ravel(), state.angle.numpy()[self.free_sections]])
        acceleration = np.concatenate([self.unbalanced_forces().ravel(), self.unbalanced_torques()]) / mass
        if self._last_check is not None:
            # Rayleigh quotient of the motion since the last check
            du, da = place - self._last_check[0], acceleration - self._last_check[1]
            stiffness, inertia = np.float64(-float(np.sum(mass * du * da))), np.float64(float(np.sum(mass * du * du)))
            damping = renewed_damping(state.read_control()[int(c.DAMPING)], stiffness, inertia, self.min_damping)
            state.write_control({c.DAMPING: float(damping)})
        self._last_check = (place, acceleration)

    def stop_motion(self) -> None:
        """Stop all motion, after the state was moved from outside."""
        state = self.stepper.state
        state.velocity.zero_()
        state.spin.zero_()
        if self.clamps is not None:
            self.clamps.stop()
        self._last_check = None

    def reset_damping_estimate(self) -> None:
        """Start the damping estimate anew, after the state was moved from outside; velocities are kept."""
        self._last_check = None

    def state_dict(self) -> dict[str, np.ndarray]:
        """Arrays for a checkpoint, in addition to the state of the rods."""
        kept = {
            "speed_limit": np.array(self.speed_limit), "thermal_strain": self.thermal_strain,
            "multipliers": np.array(self._has_multipliers),
        }  # fmt: skip
        if self._last_check is not None:
            kept |= {"check_place": self._last_check[0], "check_acceleration": self._last_check[1]}
        return kept if self.clamps is None else kept | {"clamp_velocity": self.clamps.velocity.numpy().copy()}

    def load_state_dict(self, kept: dict[str, np.ndarray]) -> None:
        """Restore what `state_dict` returned."""
        self.speed_limit = float(kept["speed_limit"])
        self.thermal_strain, self._has_multipliers = kept["thermal_strain"], bool(kept["multipliers"])
        self._last_check = (kept["check_place"], kept["check_acceleration"]) if "check_place" in kept else None
        if self.clamps is not None:
            self.clamps.velocity.assign(kept["clamp_velocity"])
