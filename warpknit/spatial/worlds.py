"""Worlds of the spatial model: steps, convergence checks and stresses of many meshes (mechanics/worlds.py)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import warp as wp

from ..compute.launch import Launch, bind
from ..compute.steering import Steering
from ..kernels.rod_stress import count_clamp_stress, count_segment_stress
from ..mechanics.numerics import SLOWEST_WAVE, renewed_throttle
from ..mechanics.protocols import Check
from ..mechanics.worlds import Worlds
from .clamps import MovingClamps
from .contact_multipliers import LOADED, SOFTEST, ContactMultipliers
from .convergence import Residual, Stability
from .mechanics import SpatialMechanics
from .model import SpatialModel, initial_state
from .pair_search import search_cells
from .rest_curve import joined_curves
from .rod_arrays import RodState, StepForces
from .rod_relaxation import RodRelaxation
from .rod_step import RodStepper, WireGroup
from .rods import joined
from .strip_step import stepper_of
from .wire_contact import WireContact


class SpatialWorlds(Worlds):
    """Meshes of one topology, with own loads; also own loops, wires, friction."""

    KEPT = ("deepest",)

    def __init__(self, models: Sequence[SpatialModel], state: RodState | None = None) -> None:
        """models: of each world; state: of a single one, default at rest."""
        model = models[0].base or models[0]
        scene, worlds = models[0].scene, len(models)
        rods = joined([one.rods for one in models])
        curve = joined_curves([one.curve for one in models], rods)
        if worlds == 1:
            self.stepper = stepper_of(models[0], initial_state(models[0]) if state is None else state)
        else:
            self.stepper = RodStepper(rods, model.device, None, model.precision, worlds=worlds)
        mesh = model.global_model
        self.contact = WireContact(
            self.stepper,
            model.contact_stiffness,
            friction=np.array([one.scene.contact.friction for one in models]),
            curve=curve,
            cells=search_cells(mesh.rods, mesh.curve),
        )
        self.clamps = moving_clamps(model, self.stepper)
        self.relaxation = RodRelaxation(
            self.stepper,
            softening=model.softening,
            wave_length=SLOWEST_WAVE * model.loop_length,
            spacing_of=model.global_model.rods,
            curve=curve,
            clamps=self.clamps,
            multipliers=model.ramp is None,
            has_history=scene.depends_on_path,
            knows_smooth=scene.wires is not None,
            wire_stiffness=self.stepper.rods.wire_stiffness if model.ramp is None else None,
        )
        softest = LOADED if scene.depends_on_path else SOFTEST
        self.multipliers = None if model.ramp is not None else ContactMultipliers(self.contact, model.soft_penalty, softest)
        self.residual = Residual(model, self.relaxation, self.multipliers)
        rods = mesh.rods
        rigidity = float((rods.of_wires("axial_stiffness") * rods.wire_length).sum())
        super().__init__([model] * worlds, self.stepper.steering, rigidity)
        self.stability = Stability(model, self.relaxation, self.contact)
        self.deepest = np.zeros(worlds)  # overlap over the thickness, up to the last convergence check
        self.members: list[SpatialMechanics] = [SpatialMechanics(self, one, world) for world, one in enumerate(models)]

    def prepare(self, rows: np.ndarray) -> None:
        """Contacts that loads may close, and masses for these."""
        if self.multipliers is not None:
            self.multipliers.stiffen(rows)
        self.relaxation.stop_motion(rows)
        self.contact.search(rows)
        self.relaxation.renew_masses(rows, loading=True)
        self.contact.pop_max_penetration(rows)

    # --- steps

    def search(self, rows: np.ndarray) -> None:
        self.contact.refresh(rows=rows)

    def overlap(self, rows: np.ndarray) -> np.ndarray:
        thickness = 2.0 * float(self.model.rods.wire_radius.min())
        self.deepest[rows] = self.contact.pop_max_penetration(rows) / thickness
        return self.deepest[rows]

    def count_stress(self) -> None:
        if self.stepper.step_stress is None:
            levers = np.concatenate([self.model.wires.held_lever] * self.stepper.worlds)
            StepStress(self.stepper, self.contact, held_nodes(self.model, self.stepper), levers)

    def step(self, rows: np.ndarray, last_step: np.ndarray) -> None:
        steering = self.steering
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
        lags = np.array([member.is_loading_gently(bool(one)) for member, one in zip(members, loading, strict=True)])
        if lags.any():
            late = rows[lags]
            throttle = renewed_throttle(1.0 - stepper.steering.ramp_lag[late], self.deepest[late])
            stepper.steering.set(late, ramp_lag=1.0 - throttle)
        for member, one in zip(members, loading.tolist(), strict=True):
            member.go_on_releasing(loading=one)
        self.strains.renew_masses(rows)
        stepper.evaluate(0.0, rows=rows)
        relaxation.renew_damping(rows, boundary=self.strains.motion(rows))
        stability.hold_damping()
        state, contacts = relaxation.sums(rows, of_mean=True), self.contact.checks.sums(rows)
        self.touches[rows] = (contacts.pushing > 0) | self.model.scene.wire.plastic
        self.strains.forget(rows[~self.touches[rows]])
        ratio = np.where(loading, np.inf, self.residual.ratio(state, contacts, rows))
        missing = self.strains.ratio(rows)
        counted = ~loading & ~stability.is_running[rows]
        relaxation.monitor_progress(ratio[counted], state.excess_ratio[counted], rows[counted])
        relaxation.renew_multipliers(state, rows, loading=loading)
        if self.multipliers is not None:
            self.multipliers.renew(contacts, relaxation.multiplier_rate(rows), rows, loading=loading)
        relaxation.renew_masses(rows, loading=loading)
        relaxation.keep_motion(rows)
        for member, one in zip(members, loading.tolist(), strict=True):
            if member.edge is not None:
                member.raise_edge(member.edge, loading=one)
        left = stability.has_left.copy()
        ratio = np.maximum(ratio, missing)
        if not loading.all():
            ratio[~loading] = stability.after_check(ratio[~loading], rows[~loading])
        self.strains.rest(rows, stability.is_running[rows])
        for world in np.flatnonzero(stability.has_left & ~left).tolist():
            self.members[world].tell(stability.note(world))
        tolerance = self.model.scene.solver.residual_tolerance
        return Check(np.where(loading, np.nan, ratio * tolerance), np.where(loading, np.inf, ratio))

    def stress(self, rows: np.ndarray) -> np.ndarray:
        with self.stepper.only(rows):
            self.stepper.evaluate(rows=rows)
            return self.stress_now(rows)

    def stress_at(self, rows: np.ndarray) -> np.ndarray:
        with self.stepper.only(rows):
            self.stepper.evaluate(0.0, rows=rows)
            return self.stress_now(rows)

    def stress_now(self, rows: np.ndarray) -> np.ndarray:
        with self.stepper.only(rows):
            total = self.contact.checks.stress(rows)
        if len(self.model.global_model.wires.held_node):
            total = total + np.array([self.members[row].clamp_stress() for row in rows.tolist()])
        return np.asarray(total / self.model.panel.area)


def held_nodes(model: SpatialModel, stepper: RodStepper) -> np.ndarray:
    """[held] held nodes of all worlds."""
    return np.concatenate([model.wires.held_node + k * stepper.arrays.world_nodes for k in range(stepper.worlds)])


def moving_clamps(model: SpatialModel, stepper: RodStepper) -> MovingClamps | None:
    """Clamps that a kernel moves with the load, and as they slide; not those that hang on a moving edge."""
    wires, worlds = model.wires, stepper.worlds
    if not len(wires.held_node) or model.scene.has_moving_edge:
        return None
    sliding = np.zeros(0, dtype=np.int64) if wires.sliding_clamp is None else wires.sliding_clamp
    count, lever = len(wires.held_node) // 2, np.concatenate([wires.held_lever] * worlds)
    slides = np.concatenate([sliding + k * count for k in range(worlds)])
    return MovingClamps(stepper, held_nodes(model, stepper).reshape(-1, 2), lever.reshape(-1, 2, 2), slides)


class StepStress:
    """Launches that sum the nominal stress of a step, for tension-driven strains; it registers itself with the stepper."""

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
