"""Rods brought to rest: damped steps of one second with fictitious masses.

The damping follows the slowest mode that still moves (numerics.renewed_damping).

Segments may be softer than they are in truth: a running multiplier moves towards the tension that belongs to their strain,

    T = offset + K (|e|/L - 1)        offset -> offset + RATE K (strain of the arc - T/EA)

What is to have the strain T/EA is the arc of a segment and not its chord (kernels/rod_bend.py), over its natural length where it
is (`warm`).
"""

from __future__ import annotations

import math

import numpy as np

from ..kernels import control as c
from ..kernels.bend import BOW
from ..kernels.rod_step import HELD_NODE, HELD_TURN
from ..numerics import FIRST_DAMPING, LOOK_AHEAD, SPEED_SHARE, STEP_MARGIN, renewed_damping
from .clamps import MovingClamps
from .rest_curve import RestCurve
from .rod_step import RodStepper
from .step_bound import largest_rates, stable_step, unit_step_masses

MULTIPLIER_RATE = 0.05  # more of it shakes the wires, which the damping would take for a stiff mode


class RodRelaxation:
    """Masses, damping and multipliers with which steps bring rods to rest."""

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
        """`softening`: true axial stiffness over that of the dynamics; `stick_stiffness` [N/m] of friction; `curve` on which
        wires touch, Catmull-Rom's where left out; `clamps`: those that move, of the same stepper; `multipliers`: whether they
        take the softening out again."""
        self.stepper = stepper
        self.clamps = clamps
        self.softening = softening
        self.contact_stiffness, self.stick_stiffness, self.curve = contact_stiffness, stick_stiffness, curve
        self.slowest = 0.0  # [1/s] no less damping than this
        rods, state = stepper.rods, stepper.state
        self.has_segment = rods.following >= 0
        self.free = (rods.held & int(HELD_NODE)) == 0
        # a segment both of whose nodes are held does not move, whatever its tension
        self.stretches = self.has_segment & (self.free | self.free[rods.following])
        self.turning_free = ((rods.held & int(HELD_TURN)) == 0) & self.has_segment
        self.stretch = rods.section.axial_stiffness / softening
        state.stretch_stiffness.fill_(self.stretch)
        stepper.set_time_step(1.0, FIRST_DAMPING, LOOK_AHEAD)
        stepper.evaluate()
        self.keeps_arcs = multipliers and softening != 1.0
        self.warmth = np.zeros(rods.node_count)  # [node] of the segments, see `warm`
        self._has_multipliers = self.keeps_arcs
        self.stored_stiffness = rods.section.axial_stiffness if multipliers else self.stretch  # [N] that stretch is stored with
        self._bow_at_rest = self._bow() if self.keeps_arcs else np.zeros(rods.node_count)
        state.write_control({c.BOW_MOMENT: 2.0 * float(BOW) if self.keeps_arcs else 0.0})
        self.spacing = spacing = float(rods.natural_length[self.has_segment].min())
        self.speed_limit = SPEED_SHARE * spacing  # [m] a step
        state.write_control({c.DRIVE: 0.0, c.STEP_LIMIT: spacing})
        self.take_masses()
        self._last: tuple[np.ndarray, np.ndarray] | None = None

    def warm(self, warmth: np.ndarray) -> None:
        """Have the natural lengths of the segments exceed those of the length factor by `warmth` [node], relative. The running
        multipliers bring that into their tensions."""
        self.warmth = warmth
        self._has_multipliers |= bool(warmth.any())

    def take_masses(self) -> None:
        """Renew the fictitious masses for the turns and tensions as they are; speeds stay."""
        state = self.stepper.state
        mass, inertia = unit_step_masses(
            self.stepper.rods,
            stretch_stiffness=self.stretch,
            turning=self.turning(),
            tension=float(np.max(self.tension(), initial=0.0)),
            contact_stiffness=self.contact_stiffness,
            stick_stiffness=self.stick_stiffness,
            curve=self.curve,
        )
        state.node_mass.assign(mass)
        state.spin_inertia.assign(inertia)
        self.speed_limit = min(SPEED_SHARE * self.spacing, self._passing_speed(mass))
        state.write_control({c.SPEED_LIMIT: self.speed_limit})

    def _passing_speed(self, mass: np.ndarray) -> float:
        """[m/s] at which two wires, all of either flying at the other, are stopped by their contact while half of it is left.

        2 M v^2/2 = k (d/2)^2/2 for the heaviest wire; no limit where nothing touches.
        """
        rods = self.stepper.rods
        if self.contact_stiffness == 0.0:
            return math.inf
        heaviest = float(np.add.reduceat(mass, rods.wire_first).max())
        return float(rods.wire_radius.min()) * math.sqrt(self.contact_stiffness / (2.0 * heaviest))

    def stable_time_step(self) -> float:
        """[s] that turns and tensions allow as they are in the state last evaluated, with the masses as they are."""
        state = self.stepper.state
        rates = largest_rates(
            self.stepper.rods,
            state.node_mass.numpy(),
            state.spin_inertia.numpy(),
            stretch_stiffness=self.stretch,
            turning=self.turning(),
            tension=float(np.max(self.tension(), initial=0.0)),
            contact_stiffness=float(state.read_control()[int(c.CONTACT_STIFFNESS)]),
            curve=self.curve,
        )
        return STEP_MARGIN * stable_step(rates)

    def turning(self) -> np.ndarray:
        """[node] [rad] the largest angle between segments at a node and its neighbours, of the state last evaluated."""
        return self.stepper.rods.widest_turn(np.linalg.norm(self.stepper.state.curvature.numpy(), axis=1))

    def strain(self) -> np.ndarray:
        """[node] of the chords of the segments, of the state last evaluated."""
        state, rods = self.stepper.state, self.stepper.rods
        factor = float(state.read_control()[int(c.LENGTH_FACTOR)])
        strain = state.length.numpy() / (rods.natural_length * factor) - 1.0
        return np.where(self.has_segment, strain, 0.0)

    def arc_strain(self) -> np.ndarray:
        """[node] of the segments as arcs, where they keep the length of these; else of their chords."""
        if not self.keeps_arcs:
            return self.strain()
        return np.where(self.has_segment, self.strain() + self._bow() - self._bow_at_rest, 0.0)

    def _bow(self) -> np.ndarray:
        """[node] share by which the arcs of the segments are longer than their chords (kernels/bend.py)."""
        square = np.sum(self.stepper.state.curvature.numpy() ** 2, axis=1)
        return float(BOW) * (square + square[self.stepper.rods.following])

    def tension(self) -> np.ndarray:
        """[node] [N] of the segments, of the state last evaluated."""
        state = self.stepper.state
        carried = state.tension_offset.numpy() + state.stretch_stiffness.numpy() * self.strain()
        return np.where(self.has_segment, carried, 0.0)

    def out_of_balance(self) -> np.ndarray:
        """(free node, 3) [N] of the state last evaluated, and of clamps that slide."""
        free = self.stepper.state.force.numpy()[self.free]
        return free if self.clamps is None else np.concatenate([free, self.clamps.force])

    def untwisted(self) -> np.ndarray:
        """[free segment] [N m] torque out of balance, of the state last evaluated."""
        return self.stepper.state.torque.numpy()[self.turning_free]

    def stretch_error(self) -> float:
        """Largest difference between strain and T/EA: what the softening still does."""
        return float(np.abs(self._overstretched()[self.stretches]).max(initial=0.0))

    def _overstretched(self) -> np.ndarray:
        """[node] strain of the segments, less T/EA."""
        strain = (self.arc_strain() - self.warmth) / (1.0 + self.warmth)
        return strain - self.tension() / self.stepper.rods.section.axial_stiffness

    def update(self) -> None:
        """Take in the state: renew damping and multipliers."""
        stepper, state = self.stepper, self.stepper.state
        stepper.evaluate()
        if self._has_multipliers:
            offset = state.tension_offset.numpy() + MULTIPLIER_RATE * self.stretch * self._overstretched()
            state.tension_offset.assign(np.where(self.stretches, offset, 0.0))
        mass, moved = state.node_mass.numpy()[self.free], state.displacement.numpy()[self.free]
        if self.clamps is not None:
            mass = np.concatenate([mass, self.clamps.mass])
            moved = np.concatenate([moved, self.clamps.place[:, None] * [0.0, 1.0, 0.0]])
        mass = np.concatenate([np.repeat(mass, 3), state.spin_inertia.numpy()[self.turning_free]])
        moved = np.concatenate([moved.ravel(), state.angle.numpy()[self.turning_free]])
        pushed = np.concatenate([self.out_of_balance().ravel(), self.untwisted()]) / mass
        if self._last is not None:
            du, da = moved - self._last[0], pushed - self._last[1]
            force, way = -float(np.sum(mass * du * da)), float(np.sum(mass * du * du))
            renewed = renewed_damping(state.read_control()[int(c.DAMPING)], np.float64(force), np.float64(way), self.slowest)
            state.write_control({c.DAMPING: float(renewed)})
        self._last = (moved, pushed)

    def begin(self) -> None:
        """Stop all motion; the state has been moved by hand."""
        state = self.stepper.state
        state.velocity.zero_()
        state.spin.zero_()
        if self.clamps is not None:
            self.clamps.stop()
        self._last = None

    def carried(self) -> None:
        """The state has been moved by hand and goes on moving: what is to come is not compared with what was."""
        self._last = None

    def state_dict(self) -> dict[str, np.ndarray]:
        """What a checkpoint needs beside the state of the rods."""
        kept = {"speed_limit": np.array(self.speed_limit), "warmth": self.warmth, "multipliers": np.array(self._has_multipliers)}
        if self._last is not None:
            kept |= {"rest_moved": self._last[0], "rest_pushed": self._last[1]}
        return kept if self.clamps is None else kept | {"clamp_velocity": self.clamps.velocity.numpy().copy()}

    def load_state_dict(self, kept: dict[str, np.ndarray]) -> None:
        """Put back what `state_dict` returned."""
        self.speed_limit = float(kept["speed_limit"])
        self.warmth, self._has_multipliers = kept["warmth"], bool(kept["multipliers"])
        self._last = (kept["rest_moved"], kept["rest_pushed"]) if "rest_moved" in kept else None
        if self.clamps is not None:
            self.clamps.velocity.assign(kept["clamp_velocity"])
