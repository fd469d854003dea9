"""Dynamic relaxation of rods: damped steps of one second with fictitious masses.

The damping is the critical damping of the slowest mode that still moves (numerics.renewed_damping).

The dynamics may soften the axial stiffness; an augmented Lagrangian multiplier, the tension offset, takes the error out again:

    T = offset + K (|e|/L - 1)        offset -> offset + rate K (strain of the arc - T/EA)

The strain T/EA is that of the arc of a segment, not of its chord (kernels/rod_forces.py), over its natural length at the local
temperature (`set_thermal_strain`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from ..host import fetch, store
from ..kernels import control as c
from ..kernels.banded_mass import HELD_NODE, HELD_TURN
from ..kernels.bend import BOW
from ..numerics import AXIAL_ERROR, FASTEST_DAMPING, LOOK_AHEAD, SPEED_SHARE, STEP_MARGIN, renewed_damping
from .clamps import MovingClamps
from .fictitious_masses import BandedMasses, MassProduct
from .rest_curve import RestCurve
from .rod_step import EVALUATED, RodStepper
from .stalled import Stalled
from .step_bound import largest_rates, stable_step

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
# a wire is taut where its mean excess strain is above TAUT_ERROR AXIAL_ERROR and does not fall to a share within so many checks
TAUT_ERROR, TAUT_PROGRESS = 20.0, (0.5, 8)
TAUT_FACTOR = 4.0  # by which a taut wire is made stiffer: its mean excess strain has stalled
VIBRATION = 3.0  # speed of the whole motion over that of the mean one, from which on it counts
LEAST_DAMPING = 0.01  # [1/s] banded masses leave few modes slower than half of it


@dataclass(frozen=True)
class _Motion:
    """A state at a convergence check; zero where held."""

    place: np.ndarray  # (node, 3) [m]
    force: np.ndarray  # (node, 3) [N]
    angle: np.ndarray  # [node] [rad]
    torque: np.ndarray  # [node] [N m]


class RodRelaxation:
    """Fictitious masses, damping and multipliers of the dynamic relaxation of rods."""

    def __init__(
        self,
        stepper: RodStepper,
        *,
        softening: float = 1.0,
        wave_length: float | None = None,
        curve: RestCurve | None = None,
        clamps: MovingClamps | None = None,
        multipliers: bool = True,
        vibration: float = VIBRATION,
    ) -> None:
        """softening: true axial stiffness over that of the dynamics; wave_length [m] of the slowest wave, default: the longest
        wire; curve: on which wires touch, default Catmull-Rom; clamps: moving ones, of the same stepper; multipliers: whether
        they correct the softening; vibration: see `kinetic_energy`."""
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
        store(state.stretch_stiffness, self.softened_stiffness)
        stepper.set_time_step(1.0, FASTEST_DAMPING, LOOK_AHEAD)
        stepper.evaluate()
        self.keeps_arc_length = multipliers and softening != 1.0
        self.thermal_strain = np.zeros(rods.node_count)  # [node] of the segments, relative to the length factor
        self._has_multipliers = self.keeps_arc_length
        self.stored_stiffness = (
            rods.section.axial_stiffness if multipliers else self.softened_stiffness
        )  # [N] that stretch is stored with
        self._bow_at_rest = self._bow() if self.keeps_arc_length else np.zeros(rods.node_count)
        state.write_control({c.BOW_MOMENT: 2.0 * float(BOW) if self.keeps_arc_length else 0.0})
        spacing = float(rods.natural_length[self.has_segment].min())
        self._largest_move = SPEED_SHARE * spacing  # [m] a step
        if stepper.contact is not None:
            self._largest_move = min(self._largest_move, CONTACT_SPEED * rods.section.thickness)
        state.write_control({c.DRIVE: 0.0, c.STEP_LIMIT: spacing})
        sliding = np.zeros((0, 2), dtype=np.int64) if clamps is None else clamps.sliding_node
        longest = float(rods.wire_length.max())
        self._banded = BandedMasses(rods, longest if wave_length is None else wave_length, sliding)
        self._product = MassProduct(stepper.arrays, state)
        self.renew_masses()
        self.vibration = vibration
        self._last_check: _Motion | None = None
        self._mean_energy: float | None = None  # [J] kinetic energy of the mean motion since the last check
        self._rate: float = MAX_RATE
        self._best_ratio: float = math.inf
        self._stalled = 0  # checks without progress
        self._is_too_soft = False  # for the multipliers to converge
        self._taut = Stalled(len(rods.wire_first), TAUT_ERROR * AXIAL_ERROR, *TAUT_PROGRESS)  # [wire] mean excess strain

    def set_thermal_strain(self, thermal_strain: np.ndarray) -> None:
        """Set the strain [node] of the natural lengths beyond the common length factor; the multipliers apply it."""
        self.thermal_strain = thermal_strain
        self._has_multipliers |= bool(thermal_strain.any())

    def renew_masses(self, *, loading: bool = False) -> None:
        """Evaluate the state, and renew the fictitious masses for it; kinetic energy does not grow by it.

        The speed is limited so that only contacts that the masses allow for can touch until the next convergence check. While
        loading, wires may move at any speed.
        """
        stepper, state = self.stepper, self.stepper.state
        move = self._largest_move
        contact, contact_turn = np.zeros((stepper.rods.node_count, 3)), np.zeros(stepper.rods.node_count)
        if stepper.contact is not None:
            if not loading:
                speed = float(state.read_control()[int(c.SPEED_MAX)])
                move = min(move, max(FASTER * speed, LEAST_SPEED * stepper.rods.section.thickness))
            approach = min(APPROACH * CHECK_STEPS * move, EVALUATED * stepper.rods.section.thickness)
            stepper.contact.list_near_pairs(CHECK_STEPS * move)
            stepper.evaluate(approach)
            contact, contact_turn = stepper.contact.stiffness_bounds(approach)
        else:
            stepper.evaluate()
        state.write_control({c.SPEED_LIMIT: move})
        elastic = np.linalg.norm(stepper.yielding.elastic, axis=1)
        inside = np.maximum(stepper.yielding.length, 1e-300)
        masses = self._banded.at(
            stretch_stiffness=fetch(state.stretch_stiffness),
            turning=np.linalg.norm(fetch(state.curvature), axis=1),
            moment=stepper.rods.section.bending_stiffness * elastic / inside,
            tension=self.tension(),
            contact=contact,
            contact_turn=contact_turn,
            keeps_arc_length=self.keeps_arc_length,
        )
        before = self._product.twice_energy(*self._velocities())
        stepper.set_masses(masses)
        now = self._product.twice_energy(*self._velocities())
        if now > before:
            slower = math.sqrt(before / now)
            for velocity in (state.velocity, state.spin, *([] if self.clamps is None else [self.clamps.velocity])):
                store(velocity, slower * fetch(velocity))

    def _velocities(self) -> tuple[np.ndarray, np.ndarray]:
        """Velocities (node, 3) [m/s] of nodes, those of sliding clamps included, and spins [node] [1/s]."""
        state = self.stepper.state
        velocity = fetch(state.velocity)
        if self.clamps is not None:
            velocity = velocity.copy()
            velocity[self.clamps.sliding_node, 1] = fetch(self.clamps.velocity)[self.clamps.sliding][:, None]
        return velocity, fetch(state.spin)

    def stable_time_step(self) -> float:
        """[s] stable time step for the current masses, turning angles and tensions."""
        state = self.stepper.state
        rates = largest_rates(
            self.stepper.rods,
            fetch(state.node_mass)[:, 0],
            fetch(state.spin_inertia),
            stretch_stiffness=self.softened_stiffness,
            turning=self.turning(),
            tension=float(np.max(self.tension(), initial=0.0)),
            contact_stiffness=float(state.read_control()[int(c.CONTACT_STIFFNESS)]),
            curve=self.curve,
        )
        return STEP_MARGIN * stable_step(rates)

    def turning(self) -> np.ndarray:
        """[node] [rad] largest turning angle at a node and its neighbours, in the state last evaluated."""
        return self.stepper.rods.widest_turn(np.linalg.norm(fetch(self.stepper.state.curvature), axis=1))

    def strain(self) -> np.ndarray:
        """[node] strain of the chords of the segments, in the state last evaluated."""
        state, rods = self.stepper.state, self.stepper.rods
        factor = float(state.read_control()[int(c.LENGTH_FACTOR)])
        strain = fetch(state.length) / (rods.natural_length * factor) - 1.0
        return np.where(self.has_segment, strain, 0.0)

    def arc_strain(self) -> np.ndarray:
        """[node] strain of the arcs of the segments; of their chords where arc lengths are not kept."""
        if not self.keeps_arc_length:
            return self.strain()
        return np.where(self.has_segment, self.strain() + self._bow() - self._bow_at_rest, 0.0)

    def _bow(self) -> np.ndarray:
        """[node] relative excess of the arc over the chord of each segment (kernels/bend.py)."""
        rods, square = self.stepper.rods, np.sum(fetch(self.stepper.state.curvature) ** 2, axis=1)
        weight, next_weight = rods.bow_weights
        return float(BOW) * (weight * square + next_weight * square[rods.following])

    def tension(self) -> np.ndarray:
        """[node] [N] tension of the segments, in the state last evaluated."""
        state = self.stepper.state
        tension = fetch(state.tension_offset) + fetch(state.stretch_stiffness) * self.strain()
        return np.where(self.has_segment, tension, 0.0)

    def unbalanced_forces(self) -> np.ndarray:
        """(free node, 3) [N] unbalanced forces in the state last evaluated, then those of sliding clamps."""
        free = fetch(self.stepper.state.force)[self.free]
        return free if self.clamps is None else np.concatenate([free, self.clamps.force])

    def mean_unbalanced_forces(self) -> np.ndarray:
        """(free node, 3) [N] mean unbalanced forces of the last CHECK_STEPS steps, then those of sliding clamps now.

        A contact may appear with a force: in equilibrium it then comes and goes, and balances in the mean.
        """
        mean = fetch(self.stepper.state.force_sum)[self.free] / CHECK_STEPS
        return mean if self.clamps is None else np.concatenate([mean, self.clamps.force])

    def unbalanced_torques(self) -> np.ndarray:
        """[free segment] [N m] unbalanced torques in the state last evaluated."""
        return fetch(self.stepper.state.torque)[self.free_sections]

    def stretch_error(self) -> float:
        """Largest difference between strain and T/EA: the remaining error of the softening."""
        return float(np.abs(self._excess_strain()[self.can_stretch]).max(initial=0.0))

    def _excess_strain(self) -> np.ndarray:
        """[node] mechanical strain of the segments less T/EA."""
        strain = (self.arc_strain() - self.thermal_strain) / (1.0 + self.thermal_strain)
        return strain - self.tension() / self.stepper.rods.section.axial_stiffness

    def renew_damping(self) -> None:
        """Renew the damping by the motion since the last check, in the state last evaluated: Rayleigh's quotient."""
        state, now, self._mean_energy = self.stepper.state, self._motion(), None
        if self._last_check is not None:
            before = self._last_check
            force = -float(np.sum((now.place - before.place) * (now.force - before.force)))
            force -= float(np.sum((now.angle - before.angle) * (now.torque - before.torque)))
            moved = self._product.twice_energy(now.place - before.place, now.angle - before.angle)
            self._mean_energy = 0.5 * moved / CHECK_STEPS**2
            stiffness, inertia = np.float64(force), np.float64(moved)
            damping = renewed_damping(state.read_control()[int(c.DAMPING)], stiffness, inertia, LEAST_DAMPING)
            state.write_control({c.DAMPING: float(damping)})

    def kinetic_energy(self) -> float:
        """[J] of the mean motion since the last check; of all motion after the state was moved from outside.

        Where a contact comes and goes, its nodes vibrate about an equilibrium. Vibrations count `vibration` times less.
        """
        whole = 0.5 * float(self.stepper.state.read_control()[int(c.KINETIC_TWICE)])
        return whole if self._mean_energy is None else max(self._mean_energy, whole / self.vibration**2)

    @property
    def multiplier_rate(self) -> float:
        """Share of its error that a multiplier takes up at a convergence check.

        A multiplier that takes up the share r a step of the error of a mode with damping c keeps the mode stable for r < c.
        Multipliers of contact and of tension together may still excite a slow mode: without progress the rate is lowered, and
        raised again with it.
        """
        damping = float(self.stepper.state.read_control()[int(c.DAMPING)])
        return min(self._rate, RATE_TO_DAMPING * CHECK_STEPS * damping)

    def watch_progress(self, ratio: float) -> None:
        """Lower the rate of the multipliers where the residual ratio makes no progress, raise it where it does.

        Multipliers converge where the softened stiffness exceeds the negative stiffness with which a mesh snaps (Nocedal and
        Wright 2006, Numerical Optimization, 17.3: the penalty of an augmented Lagrangian). Where the axial strain makes no
        progress at the least rate, all wires are made stiffer.
        """
        if ratio < PROGRESS * self._best_ratio:
            self._best_ratio, self._stalled = ratio, 0
            self._rate = min(MAX_RATE, RAISED_RATE * self._rate)
            return
        self._stalled += 1
        if self._rate > MIN_RATE and self._stalled >= RATE_PATIENCE:
            self._rate, self._stalled = max(MIN_RATE, LOWERED_RATE * self._rate), 0
        elif self._stalled >= SOFT_PATIENCE:
            self._is_too_soft = self.stretch_error() / AXIAL_ERROR >= SOFT_SHARE * ratio

    def _reset_rate(self) -> None:
        """Start with the full rate of the multipliers."""
        self._rate, self._best_ratio, self._stalled, self._is_too_soft = MAX_RATE, math.inf, 0, False
        self._taut.reset()

    def renew_multipliers(self, *, loading: bool = False) -> None:
        """Move the tension offsets by the error of the softening, in the state last evaluated; stiffen taut wires."""
        if self._has_multipliers:
            state, excess = self.stepper.state, self._excess_strain()
            stiffness = fetch(state.stretch_stiffness)
            offset = fetch(state.tension_offset) + self.multiplier_rate * stiffness * excess
            stiffer = stiffness if loading else self._stiffer(stiffness, np.where(self.can_stretch, excess, 0.0))
            offset = offset + (stiffness - stiffer) * self.strain()  # the tension is kept
            store(state.tension_offset, np.where(self.can_stretch, offset, 0.0))
            store(state.stretch_stiffness, stiffer)

    def _stiffer(self, stiffness: np.ndarray, excess: np.ndarray) -> np.ndarray:
        """[node] [N] softened axial stiffness, raised where a wire is taut: its mean excess strain is imposed and makes no
        progress."""
        rods = self.stepper.rods
        total = np.add.reduceat(np.where(self.has_segment, excess * rods.natural_length, 0.0), rods.wire_first)
        raised = self._taut.after(np.abs(total) / rods.wire_length)
        factor = np.where(raised, TAUT_FACTOR, 1.0)
        if self._is_too_soft:
            factor = np.full(len(raised), SOFT_FACTOR)
            self._reset_rate()
        return np.minimum(np.repeat(factor, rods.wire_count) * stiffness, rods.section.axial_stiffness)

    def keep_motion(self) -> None:
        """Keep the state last evaluated for the next `renew_damping`; velocities become kinetic energy in the control array."""
        self._last_check = self._motion()
        store(self.stepper.state.force_sum, 0)
        energy = self._product.twice_energy(*self._velocities())
        self.stepper.state.write_control({c.KINETIC_TWICE: energy})

    def _motion(self) -> _Motion:
        state, free, turns = self.stepper.state, self.free, self.free_sections
        place, force = (np.where(free[:, None], fetch(array), 0.0) for array in (state.displacement, state.force))
        if self.clamps is not None:
            sliding = self.clamps.sliding_node  # both nodes move, and carry the mass, but the force counts once
            place[sliding, 1], force[sliding[:, 0]] = self.clamps.place[:, None], self.clamps.force
        return _Motion(place, force, np.where(turns, fetch(state.angle), 0.0), np.where(turns, fetch(state.torque), 0.0))

    def stop_motion(self) -> None:
        """Stop all motion, after the state was moved from outside; multipliers start with their full rate."""
        self._reset_rate()
        state = self.stepper.state
        state.write_control({c.DAMPING: FASTEST_DAMPING, c.SPEED_MAX: 0.0})
        store(state.velocity, 0)
        store(state.spin, 0)
        if self.clamps is not None:
            self.clamps.stop()
        self._last_check = None

    def reset_damping_estimate(self) -> None:
        """Start the damping estimate anew, after the state was moved from outside; velocities are kept."""
        self._last_check = None

    def begin_anew(self) -> None:
        """The same, with the full rate of the multipliers, whose errors have grown by the move."""
        self._reset_rate()
        self.reset_damping_estimate()

    def state_dict(self) -> dict[str, np.ndarray]:
        """Arrays for a checkpoint, in addition to the state of the rods."""
        kept = {"thermal_strain": self.thermal_strain, "multipliers": np.array(self._has_multipliers)}
        kept |= self._taut.state_dict("taut")
        kept["multiplier_rate"] = np.array([self._rate, self._best_ratio, self._stalled])
        if self._last_check is not None:
            kept |= {f"check_{name}": array for name, array in vars(self._last_check).items()}
        return kept if self.clamps is None else kept | {"clamp_velocity": fetch(self.clamps.velocity).copy()}

    def load_state_dict(self, kept: dict[str, np.ndarray]) -> None:
        """Restore what `state_dict` returned."""
        self.thermal_strain, self._has_multipliers = kept["thermal_strain"], bool(kept["multipliers"])
        self._rate, self._best_ratio, stalled = kept["multiplier_rate"].tolist()
        self._stalled = int(stalled)
        self._taut.load_state_dict("taut", kept)
        self._last_check = None
        if "check_place" in kept:
            self._last_check = _Motion(*(kept[f"check_{field.name}"] for field in fields(_Motion)))
        if self.clamps is not None:
            store(self.clamps.velocity, kept["clamp_velocity"])
