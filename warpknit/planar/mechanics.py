"""Worlds of the planar model, and the mechanics of one (warpknit/mechanics/protocols.py)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import warp as wp

from ..compute.host import fetch
from ..compute.kept import Owner
from ..compute.launch import bind
from ..compute.steering import Steering
from ..kernels.anchored_bodies import draw_anchors
from ..kernels.contact_friction import stick_contacts
from ..kernels.multiplier_update import extrapolate, extrapolate_held_bodies
from ..measure import force_scale
from ..mechanics.numerics import CHECK_STEPS
from ..mechanics.protocols import Check, Drift, Mechanics
from ..mechanics.worlds import Worlds
from ..mesh.rim import LoadPoint
from .diagnostics import Diagnostics, SlowestMode, Sums, is_lost_in_round_off, residual
from .host_state import read_strip
from .model import Model
from .multipliers import Multipliers
from .observables import PlanarObservables, read
from .state import State
from .step import NeighbourSearch, anchor_launch
from .time_step import stable_step
from .transfer import PlanarGrid, Prolongation, state_variables
from .world_step import WorldStepper

LOAD_STEPS = 100  # over which a load is applied that no prediction leads to
SOFTENING_CHECKS = 10  # convergence checks between updates of the bound on the softening
UNLOADED = 1e-3  # of EI/W^2: forces that count as zero in a mesh as knitted
DRIFT_CHECKS = (5, 40)  # convergence checks of the drift criterion, smallest and largest
DRIFT_NODES = 24  # nodes a loop above which they grow with the square of the nodes, as bending periods do
NEARLY_CONVERGED = 10.0  # residual over the tolerance below which unconverged multipliers indicate taut wires


class PlanarWorlds(Worlds):
    """Meshes of one model, each under its own load."""

    def __init__(self, models: Sequence[Model], state: State | None = None, *, threads: int | None = None) -> None:
        """`models`: of each world, alike but for their loads; `state`: of a single one, default as knitted.

        `threads`: see `WorldStepper`.
        """
        model = models[0]
        self.stepper = WorldStepper(model, len(models), state, threads=threads)
        self.state = self.stepper.state
        self.diagnostics, self.slowest_mode = Diagnostics(self.stepper), SlowestMode(self.stepper)
        self.multipliers = Multipliers(self.diagnostics)
        self.checked_stress = np.zeros((len(models), 2, 2))  # [N/m] nominal stress as last evaluated
        length = float(model.global_model.panel.wire_length.sum())
        super().__init__(models, self.state.steering, model.axial_stiffness * length)
        self.members = [PlanarMechanics(self, one, world) for world, one in enumerate(models)]

    def count_stress(self) -> None:
        for stepper in self.stepper.steppers:
            stepper.count_stress()

    def step(self, rows: np.ndarray, last_step: np.ndarray) -> None:
        self.stepper.step(rows, last_step)

    def search(self, rows: np.ndarray) -> None:
        for row in rows.tolist():
            self.members[row].search()

    def check(self, rows: np.ndarray, checks: np.ndarray, loading: np.ndarray) -> Check:
        found, ratio = np.full(len(rows), np.nan), np.full(len(rows), np.inf)
        if self.model.scene.solver.multipliers:
            self.multipliers.bound_softening(rows[checks % SOFTENING_CHECKS == 0])
        self.strains.renew_masses(rows)
        self.slowest_mode.measure(rows)
        sums = self.sums(rows)
        boundary, missing = self.strains.motion(rows), self.strains.ratio(rows)
        self.multipliers.begin_level(rows[missing > 1.0])  # the load moves
        if not loading.all():
            self.slowest_mode.renew_damping(rows[~loading], [part[~loading] for part in boundary])
            rows, sums, solver = rows[~loading], sums.of(~loading), self.model.scene.solver
            found[~loading] = self.residual_of(rows, sums)
            of_nodes = found[~loading] / solver.residual_tolerance
            if solver.multipliers:
                of_nodes = np.maximum(of_nodes, self.multipliers.update(rows, sums, of_nodes < NEARLY_CONVERGED))
            ratio[~loading] = of_nodes
            ratio = np.maximum(ratio, missing)
        return Check(found, ratio)

    def sums(self, rows: np.ndarray) -> Sums:
        """Sums of meshes, whose contact forces have been found."""
        sums = self.diagnostics.sums(rows)
        self.checked_stress[rows] = sums.stress
        return sums

    def residual_of(self, rows: np.ndarray, sums: Sums) -> np.ndarray:
        """[row] out-of-balance force and motion, for solver.residual_tolerance."""
        return residual(self.model, Steering(self.steering.values[rows]), sums, fetch(self.state.wire_axial)[rows])

    def stress(self, rows: np.ndarray) -> np.ndarray:
        return self.sums(rows).stress

    def stress_at(self, rows: np.ndarray) -> np.ndarray:
        self.stepper.run(rows, contact=True)
        return self.stress(rows)

    def stress_now(self, rows: np.ndarray) -> np.ndarray:
        return np.asarray(self.checked_stress[rows])


class PlanarMechanics(Mechanics):
    """Steps one world of a planar model."""

    KEPT = ("notes", "_last")

    check_steps = CHECK_STEPS
    path_increment = 0.005
    path_ratios = (5.0, 0.4)  # a slack mesh starts well from what has converged well

    def __init__(self, group: PlanarWorlds, model: Model, world: int) -> None:
        self.group, self.model, self.world, self.rows = group, model, world, np.array([world])
        self.state, self.stepper = group.stepper.states[world], group.stepper.steppers[world]
        self.notes: list[str] = []
        lowest, highest = DRIFT_CHECKS
        self.drift = Drift(min(highest, max(lowest, round(lowest * (model.scene.model.nodes_per_loop / DRIFT_NODES) ** 2))))
        self.neighbours = NeighbourSearch(model, self.state)
        self.history = HistoryVariables(model, self.state)
        self._relaxes = model.scene.solver.drive == "relax"
        self._has_temperature_field = any(any(stage.temperature_gradient) for stage in model.scene.stages)
        # values at the end of the previous level
        self._last = [wp.zeros_like(value) for value in self._level_values()] if self._relaxes else []
        self._active_as_knitted = 0  # pairs that carry force as knitted

    def compile(self) -> None:
        """Compile all kernels."""
        if self._relaxes:
            self.history.advance()
        self.search()
        self.step(2)
        if not self._relaxes:
            self.residual_now()
            return
        self.group.check(self.rows, np.ones(1, dtype=int), np.zeros(1, dtype=bool))
        self.predict(0.0)
        self.set_load(LoadPoint(np.eye(2), self.model.scene.wire.reference_temperature), LOAD_STEPS)

    # --- loads

    def set_load(self, load: LoadPoint, steps: int, *, evenly: bool = False) -> None:
        self._begin_ramp(load, steps, evenly=evenly)
        if self._has_temperature_field:
            self.state.wire_thermal_strain.assign(wire_thermal_strain(self.model, load.temperature, load.temperature_gradient))
        self.search()
        self.group.begin_load(self.world, load)

    def load_steps(self, load: LoadPoint, predicted: bool) -> int:
        return 0 if predicted and load.tension is None else LOAD_STEPS

    def _level_values(self) -> list[wp.array]:
        """Displacements and multipliers, which `predict` extrapolates."""
        s = self.state
        return [s.node_ux[s.parity], s.node_uy[s.parity], s.body_ux, s.body_uy, s.tension_offset, s.pair_offset]

    def predict(self, ratio: float) -> None:
        s = self.state
        s.steering.set(extrapolation=ratio)
        # within the margin of the neighbour search, so that no body changes sides
        max_move = 0.5 * self.neighbours.margin / self.model.precision.unit
        if self.model.scene.hook is not None:
            max_move = np.inf  # the frame moves a fixed wire affinely (mesh/hook_mesh.py); the prediction must undo all of it
        for value, last in zip(self._level_values(), self._last, strict=True):
            limit = np.inf if value is s.tension_offset or value is s.pair_offset else max_move
            named = {"control": s.control, "limit": wp.float64(limit), "value": value, "last": last}
            if value is s.body_ux or value is s.body_uy:
                launch = bind(extrapolate_held_bodies, value.shape[0], pair_force=s.pair_force, **named)
            else:
                launch = bind(extrapolate, value.shape[0], lowest=wp.float64(0.0 if value is s.pair_offset else -np.inf), **named)
            launch.run(self.model.device)
        self.stop()

    def stop(self) -> None:
        """Set all velocities to zero."""
        for speed in (self.state.node_vx, self.state.node_vy, self.state.body_vx, self.state.body_vy):
            speed.zero_()

    def advance_history(self) -> None:
        self.history.advance()

    @property
    def dissipated(self) -> float:
        return self.history.dissipated

    # --- steps

    def search(self) -> None:
        self.neighbours.search()

    def step(self, count: int) -> None:
        self.group.step(self.rows, self.group.steering.step[self.rows] + count)

    def fastest(self) -> tuple[int, int]:
        panel, strip = self.model.panel, self.model.strip
        speed = np.hypot(self.state.node_vx.numpy().astype(float), self.state.node_vy.numpy().astype(float))
        speed = np.nan_to_num(speed, nan=np.inf)
        node = int(np.argmax(speed))
        wire = int(np.searchsorted(panel.wire_first, node, side="right") - 1)
        here = wire + (strip.wires.start if strip is not None else 0), node - int(panel.wire_first[wire])
        _, there = max(self.model.ranks.everyone((float(speed[node]), here)))
        return there

    # --- convergence of a relaxation

    def begin_level(self) -> None:
        self.group.multipliers.begin_level(self.rows)

    @property
    def _sums(self) -> Sums:
        return self.group.diagnostics.sums(self.rows)

    def causes(self) -> str:
        causes = ""
        if is_lost_in_round_off(self.group.model, self._sums, fetch(self.group.state.wire_axial)[self.rows])[0]:
            name = self.model.precision.name
            causes += f", round-off in {name} precision exceeds the forces: set solver.precision = 'double'"
        if self._active_as_knitted:
            cause = "the yarn is too thick for the loops, or the bars lap through each other"
            causes += f", {self._active_as_knitted} pairs are active as knitted: {cause}"
        return causes

    def is_in_equilibrium(self, load: LoadPoint) -> bool:
        if not load.is_as_knitted(self.model.scene.wire.reference_temperature):
            return False
        self.stepper.evaluate_contact()
        sums = self._sums
        self._active_as_knitted = int(sums.closed[0])
        least = UNLOADED * force_scale(self.model)
        bend = self.model.bending_stiffness / float(self.model.table.hinge_length.min()) ** 2
        return bool(sums.closed[0] == 0 and sums.tension_largest[0] < least and sums.turning_largest[0] * bend < least)

    # --- real time

    def renew_time_step(self, steps: int) -> float:
        self.stepper.evaluate_contact()  # contact forces are not in a checkpoint
        step = stable_step(self.model, self.state, steps)
        self.state.steering.set(time_step=step)
        return step

    def residual_now(self) -> float:
        return float(self.group.residual_of(self.rows, self._sums)[0])

    # --- meshes of one knit (solve/multilevel.py)

    def prolongation(self, smaller: PlanarMechanics) -> Prolongation:
        return Prolongation(self.model, self.state, smaller.model, smaller.state)

    def membrane_grid(self, low: np.ndarray, cell: np.ndarray, cells: np.ndarray) -> PlanarGrid:
        return PlanarGrid(self.model, self.state, self.group.stepper.accelerations[self.world], low, cell, cells)

    def state_variables(self) -> dict[str, np.ndarray]:
        return state_variables(self.model, self.state)

    def move_clamps(self, begin: np.ndarray, end: np.ndarray) -> None:
        self.state.move_clamps(begin, end)

    def clamp_forces(self) -> np.ndarray:
        return self.group.diagnostics.clamp_forces(self.world)

    def renew_damping(self) -> None:
        self.group.slowest_mode.measure(self.rows)
        self.group.slowest_mode.renew_damping(self.rows)

    @property
    def owners(self) -> list[Owner]:
        group, worlds = self.group, len(self.group.members)
        owners = [Owner(self.state), Owner(self.neighbours), Owner(self)]
        if self._relaxes:
            of_worlds = [Owner(one, self.world, worlds) for one in (group.multipliers, group.slowest_mode, group.strains)]
            owners += [Owner(self.history), *of_worlds]
        return owners

    # --- observation

    def observe(self) -> PlanarObservables:
        return read(self.model, self.state)

    def edge_work_terms(self, observed: PlanarObservables) -> list[tuple[np.ndarray, np.ndarray]]:
        clamps = observed.edge_force, observed.clamp_shift
        return [clamps, (observed.thermal_strain_force, observed.thermal_strain)]


class HistoryVariables:
    """Stick places, plastic turning and anchors, updated at every equilibrium."""

    KEPT = ("dissipated",)

    def __init__(self, model: Model, state: State) -> None:
        self.model, self.state = model, state
        self.dissipated = 0.0  # [J]
        self._slipped = wp.zeros(len(state.pair_stuck), dtype=wp.float64, device=model.device)

    def advance(self) -> None:
        """Update the history variables from an equilibrium."""
        model, state = self.model, self.state
        if len(state.pair_stuck):
            sources = (model.rest, model.mesh, state, model.constants)
            bind(stick_contacts, model.pair_count, *sources, slipped=self._slipped).run(model.device)
            own = slice(None) if model.strip is None else model.strip.pair
            self._dissipate(np.sum(self._slipped.numpy()[own]))
        if model.yield_moment:
            self._yield()
        if model.treatment.anchored:  # anchors of bodies whose spring is at its force limit move
            anchor_launch(draw_anchors, model.panel.body_count, model, state).run(model.device)

    def _yield(self) -> None:
        """Update plastic turning: backward Euler, bilinear bending with kinematic hardening."""
        host = read_strip(self.model, self.state)
        kept = self.model.scene.wire.hardening
        beyond = host.turning - host.plastic_turn - host.back_turn
        change = np.sign(beyond) * np.maximum(np.abs(beyond) - host.yield_turn, 0.0) * (1.0 - kept)
        self.state.plastic_turn.assign(host.plastic_turn + change)
        if kept < 1.0:
            self.state.back_turn.assign(host.back_turn + kept / (1.0 - kept) * change)
        self._dissipate(self.model.yield_moment * np.sum(np.abs(change)))

    def _dissipate(self, energy: float) -> None:
        """Add dissipated energy [J] of all ranks."""
        self.dissipated += float(self.model.ranks.sum(np.array([energy]))[0])


def wire_thermal_strain(model: Model, temperature: float, gradient: tuple[float, float]) -> np.ndarray:
    """(wire, 2): relative excess of the length factor at the first node of each wire, and its increment a node.

    The temperature [K] is at the centre of the panel, its gradient [K/m] along weft and warp as knitted. Along a wire it is
    interpolated linearly from end to end: the loops deviate from it by less than a stitch.
    """
    panel, wire = model.panel, model.scene.wire
    last_node, factor = panel.wire_first + panel.wire_count - 1, wire.length_factor(temperature)
    place = model.node_rest - (panel.low + 0.5 * panel.size)
    excess = (place[node] @ np.array(gradient) for node in (panel.wire_first, last_node))
    first, last = (wire.expansion * e / factor for e in excess)
    return np.stack([first, (last - first) / (panel.wire_count - 1)], axis=1)
