"""Worlds of the spatial model: steps, convergence checks and stresses of many meshes (mechanics/worlds.py)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
import warp as wp

from ..compute.host import fetch
from ..compute.launch import Launch, bind
from ..compute.steering import Steering
from ..kernels.rod_checks import UNBALANCED_MAX
from ..kernels.rod_stress import count_clamp_stress, count_segment_stress
from ..measure.strain import strain_text
from ..mechanics.numerics import ENERGY_FLOOR, FORCE_FLOOR, LOCAL_ALLOWANCE, SLOWEST_WAVE, renewed_throttle
from ..mechanics.protocols import Check
from ..mechanics.worlds import Worlds
from .clamps import MovingClamps
from .convergence import SoftMotion, Stability
from .mechanics import SpatialMechanics
from .model import SpatialModel
from .multipliers import LOADED, SOFTEST, ContactMultipliers
from .pair_search import search_cells
from .rest_curve import joined_curves
from .rod_arrays import RodState, StepForces
from .rod_relaxation import RodRelaxation, StateSums
from .rod_step import CHECK_STEPS, RodStepper, WireGroup
from .rods import joined
from .strip_step import StripRodStepper
from .wire_contact import ContactSums, WireContact

ROUND_OFF = 1e5  # of EA: smallest dead load with an equilibrium within the tolerance


class SpatialWorlds(Worlds):
    """Meshes of one topology, with own loads; also own loops, wires, friction."""

    KEPT = ("deepest",)

    def __init__(self, models: Sequence[SpatialModel], state: RodState | None = None) -> None:
        """models: of each world; state: of a single one, default at rest."""
        model = models[0].base or models[0]
        scene, worlds = models[0].scene, len(models)
        rods = joined([one.rods for one in models])
        curve = joined_curves([one.curve for one in models], rods)
        if model.strip is not None:
            self.stepper: RodStepper = StripRodStepper(model, state)
        else:
            self.stepper = RodStepper(rods, model.device, state, model.precision, worlds=worlds)
        mesh = model.global_model
        self.contact = WireContact(
            self.stepper,
            model.contact_stiffness,
            friction=np.array([one.scene.contact.friction for one in models]),
            curve=curve,
            cells=search_cells(mesh.rods, mesh.curve),
        )
        self.model = model
        self.clamps = self._moving_clamps()
        self.relaxation = RodRelaxation(
            self.stepper,
            softening=model.softening,
            wave_length=SLOWEST_WAVE * model.loop_length,
            spacing_of=model.global_model.rods,
            curve=curve,
            multipliers=model.ramp is None,
            has_history=scene.depends_on_path,
            knows_smooth=scene.wires is not None,
            wire_stiffness=self.stepper.rods.wire_stiffness if model.ramp is None else None,
        )
        softest = LOADED if scene.depends_on_path else SOFTEST
        self.multipliers = None if model.ramp is not None else ContactMultipliers(self.contact, model.soft_penalty, softest)
        self._force_scale = np.full(worlds, np.inf)  # [world] [N] reference force of the residual at the last check
        rods = mesh.rods
        rigidity = float((rods.of_wires("axial_stiffness") * rods.wire_length).sum())
        super().__init__([model] * worlds, self.stepper.steering, rigidity)
        self.stability = Stability(model, self.relaxation, self.contact)
        is_loose = scene.wires is not None and worlds == 1 and model.ramp is None and not scene.depends_on_path
        self.soft_motion = SoftMotion(self.relaxation, self.contact) if is_loose else None
        self.deepest = np.zeros(worlds)  # overlap over the thickness, up to the last convergence check
        self.members: list[SpatialMechanics] = [SpatialMechanics(self, one, world) for world, one in enumerate(models)]

    def prepare(self, rows: np.ndarray) -> None:
        """Contacts that loads may close, and masses for these."""
        if self.multipliers is not None:
            self.multipliers.stiffen(rows)
        self.relaxation.stop_motion(rows)
        self.relaxation.resting.begin()
        self.contact.search(rows)
        self.relaxation.masses.renew(rows, loading=True)
        self.contact.pop_max_penetration(rows)

    # --- steps

    def let_rest(self) -> None:
        self.relaxation.resting.allow()

    def move_all(self, rows: np.ndarray) -> None:
        self.relaxation.resting.end()

    def search(self, rows: np.ndarray) -> None:
        self.contact.refresh(rows=rows)

    def overlap(self, rows: np.ndarray) -> np.ndarray:
        thickness = 2.0 * float(self.model.rods.wire_radius.min())
        self.deepest[rows] = self.contact.pop_max_penetration(rows) / thickness
        return self.deepest[rows]

    def count_stress(self) -> None:
        if not self.stepper.counts_stress:
            held, device = self._held_nodes(), self.stepper.device
            order, lever = np.argsort(held, kind="stable"), np.concatenate([self.model.wires.held_lever] * self.stepper.worlds)
            clamps: dict[str, wp.array] = {
                "held_node": wp.array(held[order], dtype=wp.int32, device=device),
                "held_lever": wp.array(lever[order], dtype=wp.vec2d, device=device),
            }
            self.stepper.add_up_stress(partial(self._stress_launches, held[order], clamps))

    def _stress_launches(
        self, held: np.ndarray, clamps: dict[str, wp.array], group: WireGroup, stored: StepForces, row: int
    ) -> list[Launch]:
        """Launches that sum the nominal stress of a group of wires with its forces; row: of the counts."""
        sources, count = (self.stepper.arrays, self.stepper.state), {"own_row": row, "stress_count": self.stepper.stress_count}
        first, end = np.searchsorted(held, [group.nodes.start, group.nodes.stop]).tolist()
        forces = {"first_held": first, "stored_from": stored.stored_from, "force": stored.force}
        return [
            self.contact.stress_launch(group.blocks, **count),
            bind(count_segment_stress, len(group.blocks), *sources, first_block=group.blocks.start, **count),
            bind(count_clamp_stress, end - first, *sources, **forces, **clamps, **count),
        ]

    def _held_nodes(self) -> np.ndarray:
        """[held] held nodes of all worlds."""
        each = self.stepper.arrays.world_nodes
        return np.concatenate([self.model.wires.held_node + k * each for k in range(self.stepper.worlds)])

    def _moving_clamps(self) -> MovingClamps | None:
        """Clamps that a kernel moves with the load, some of them sliding; None without any, or on a moving edge."""
        wires, worlds = self.model.wires, self.stepper.worlds
        if not len(wires.held_node) or self.model.scene.has_moving_edge:
            return None
        sliding = np.zeros(0, dtype=np.int64) if wires.sliding_clamp is None else wires.sliding_clamp
        slides = np.concatenate([sliding + k * len(wires.held_node) // 2 for k in range(worlds)])
        lever = np.concatenate([wires.held_lever] * worlds).reshape(-1, 2, 2)
        return MovingClamps(self.stepper, self._held_nodes().reshape(-1, 2), lever, slides)

    def step(self, rows: np.ndarray, last_step: np.ndarray) -> None:
        steering = self.steering
        self.relaxation.resting.renew_frames()
        steering.set(rows, last_step=last_step)
        with self.stepper.only(rows):
            self.stepper.step(int((last_step - steering.step[rows]).max()))
        arrived = rows[steering.status[rows] == Steering.WAITING]
        steering.set(arrived, status=Steering.RUNNING)
        steering.set(rows, last_step=np.inf)

    # --- convergence

    def check(self, rows: np.ndarray, checks: np.ndarray, loading: np.ndarray) -> Check:
        with self.stepper.only(rows):
            return self._check(rows, checks, loading)

    def _check(self, rows: np.ndarray, checks: np.ndarray, loading: np.ndarray) -> Check:
        stepper, relaxation, stability = self.stepper, self.relaxation, self.stability
        members = [self.members[row] for row in rows.tolist()]
        late = rows[loading & np.array([not member.may_overlap for member in members])]  # loaded more slowly where wires overlap
        if len(late):
            throttle = renewed_throttle(1.0 - stepper.steering.ramp_lag[late], self.deepest[late])
            stepper.steering.set(late, ramp_lag=1.0 - throttle)
        for member, one in zip(members, loading.tolist(), strict=True):
            member.go_on_releasing(loading=one)
        self.strains.renew_masses(rows)
        stepper.evaluate(0.0, rows=rows)
        relaxation.damping.renew(rows, boundary=self.strains.motion(rows))
        stability.hold_damping()
        relaxation.resting.add_forces()
        state, contacts = relaxation.sums(rows, of_mean=True), self.contact.sums(rows)
        self.touches[rows] = (contacts.pushing > 0) | self.model.scene.wire.plastic
        self.strains.forget(rows[~self.touches[rows]])
        ratio = np.where(loading, np.inf, self.residual_ratio(state, contacts, rows))
        missing = self.strains.ratio(rows)
        counted = ~loading & ~stability.is_running[rows]
        if self.soft_motion is not None:
            balances = self._unbalance(state, contacts, rows) < self.model.scene.solver.residual_tolerance
            self.soft_motion.collect(counts=bool((counted & balances).all() and not self.strains.driven(rows).any()))
        relaxation.multipliers.monitor_progress(ratio[counted], state.excess_ratio[counted], rows[counted])
        moves = loading.any() or stability.is_running[rows].any() or self.strains.driven(rows).any()
        if moves or self._overlaps(contacts).any():
            relaxation.resting.wake()
        else:
            tolerance = self.model.scene.solver.residual_tolerance
            relaxation.resting.find(relaxation.multipliers.of_excess, tolerance * float(self._force_scale[rows[0]]))
        relaxation.multipliers.renew(state.mean_excess, rows, loading=loading)
        if self.multipliers is not None:
            self.multipliers.renew(contacts, relaxation.multipliers.rate(rows), rows, loading=loading)
        relaxation.masses.renew(rows, loading=loading)
        relaxation.damping.keep_motion(rows)
        for member, one in zip(members, loading.tolist(), strict=True):
            if member.edge is not None:
                member.raise_edge(member.edge, loading=one)
        left = stability.has_left.copy()
        ratio = np.maximum(ratio, missing)
        if not loading.all():
            ratio[~loading] = stability.after_check(ratio[~loading], rows[~loading])
        self.strains.rest(rows, stability.is_running[rows])
        if self.soft_motion is not None and 1.0 <= ratio[0] < np.inf:
            self.soft_motion.correct()
        for world in np.flatnonzero(stability.has_left & ~left).tolist():
            strains = strain_text(self.steering.gradient[world])
            self.members[world].tell(f"the equilibrium at strains of {strains} was unstable: the mesh snapped through to another")
        tolerance = self.model.scene.solver.residual_tolerance
        return Check(np.where(loading, np.nan, ratio * tolerance), np.where(loading, np.inf, ratio))

    def _overlaps(self, contacts: ContactSums) -> np.ndarray:
        """[row] whether overlaps of soft contacts exceed their tolerance."""
        return np.zeros(1, dtype=bool) if self.multipliers is None else self.multipliers.error_ratio(contacts) > 1.0

    def residual_ratio(self, state: StateSums, contacts: ContactSums, rows: np.ndarray) -> np.ndarray:
        """[row] the largest criterion over its tolerance: residual, and errors of softened axial strain and soft contacts."""
        residual = self.residual(state, contacts, rows) / self.model.scene.solver.residual_tolerance
        ratio = np.maximum(residual, state.excess_ratio)
        return ratio if self.multipliers is None else np.maximum(ratio, self.multipliers.error_ratio(contacts))

    def residual(self, state: StateSums, contacts: ContactSums, rows: np.ndarray) -> np.ndarray:
        """[row] the larger of the relative unbalanced force and the relative motion, compared with solver.residual_tolerance.

        Sums of the state last evaluated.
        """
        scene, stepper = self.model.scene, self.stepper
        bent = self.model.bending_stiffness / scene.knit.wale_spacing
        loops = stepper.strip.whole.node_count / stepper.worlds / scene.model.nodes_per_loop
        least = ENERGY_FLOOR * bent * loops
        motion = np.sqrt(self.relaxation.damping.kinetic_energy(rows) / np.maximum(state.energy, least))
        return np.maximum(self._unbalance(state, contacts, rows), motion)

    def _unbalance(self, state: StateSums, contacts: ContactSums, rows: np.ndarray) -> np.ndarray:
        """[row] the relative unbalanced force."""
        model, scene = self.model, self.model.scene
        bent = model.bending_stiffness / scene.knit.wale_spacing
        # the reference force is at least the knit's, or a smaller dead load
        load, of_knit = self.steering.dead_load[rows], FORCE_FLOOR * bent / scene.knit.wale_spacing
        round_off = float(np.finfo(wp.dtype_to_numpy(model.precision.real)).eps)
        smallest = ROUND_OFF * round_off * float(model.rods.of_wires("axial_stiffness").max())
        least = np.where(load == 0.0, of_knit, np.minimum(of_knit, np.maximum(load, smallest)))
        self._force_scale[rows] = scale = np.maximum(contacts.mean_push, least)
        rms = np.sqrt(state.unbalanced_square / max(state.free_nodes, 1))
        return rms / scale

    def moving_blocks(self, world: int) -> int:
        """Blocks of nodes of a world that a residual far above its tolerance moves."""
        scale = self.model.scene.solver.residual_tolerance * float(self._force_scale[world])
        limit = CHECK_STEPS * LOCAL_ALLOWANCE * scale  # of the sum since the check before
        exceeds = fetch(self.relaxation.state_partial)[:, int(UNBALANCED_MAX)] > limit**2
        return int(self.stepper.sums.total(exceeds[:, None].astype(float), np.array([world]))[0, 0])

    def stress(self, rows: np.ndarray) -> np.ndarray:
        self.stepper.evaluate(rows=rows)
        return self.stress_now(rows)

    def stress_at(self, rows: np.ndarray) -> np.ndarray:
        self.stepper.evaluate(0.0, rows=rows)
        return self.stress_now(rows)

    def stress_now(self, rows: np.ndarray) -> np.ndarray:
        with self.stepper.only(rows):
            total = self.contact.stress(rows)
        if len(self.model.global_model.wires.held_node):
            total = total + np.array([self.members[row].clamp_stress() for row in rows.tolist()])
        return np.asarray(total / self.model.panel.area)
