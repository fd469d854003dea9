"""The mechanics of one planar mesh (protocol: warpknit/mechanics/protocols.py)."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import warp as wp

from .. import measure
from ..compute.host import fetch
from ..compute.kept import Owner
from ..compute.launch import bind
from ..compute.steering import Steering
from ..kernels.multiplier_update import extrapolate, extrapolate_held_bodies
from ..measure import force_scale
from ..mechanics.numerics import CHECK_STEPS
from ..mechanics.protocols import TOO_THICK, Check, Drift, SingleMesh, strength_exceeded
from ..mesh.rim import LoadPoint, Rim
from .diagnostics import Diagnostics, Sums
from .history_variables import HistoryVariables
from .membrane_grid import MembraneGrid
from .model import Model
from .multipliers import Multipliers
from .neighbours import RAMP_SHARE, NeighbourSearch
from .observables import PlanarObservables, read
from .prolongation import Prolongation
from .residual import Residual
from .slowest_mode import SlowestMode
from .state import State
from .state_variables import state_variables
from .strip_step import stepper_of
from .thermal import wire_thermal_strain
from .time_step import stable_step

LOAD_STEPS = 100  # over which a load is applied that no prediction leads to
SOFTENING_CHECKS = 10  # convergence checks between updates of the bound on the softening
UNLOADED = 1e-3  # of EI/W^2: forces that count as zero in a mesh as knitted
DRIFT_CHECKS = (5, 40)  # convergence checks of the drift criterion, smallest and largest
DRIFT_NODES = 24  # nodes a loop above which they grow with the square of the nodes, as bending periods do
NEARLY_CONVERGED = 10.0  # residual over the tolerance below which unconverged multipliers indicate taut wires


def drift_of(nodes_per_loop: int) -> Drift:
    """Drift criterion of the tension."""
    lowest, highest = DRIFT_CHECKS
    return Drift(min(highest, max(lowest, round(lowest * (nodes_per_loop / DRIFT_NODES) ** 2))))


class PlanarMechanics:
    """Steps one state of a planar model."""

    KEPT = ("notes", "_last")

    check_steps = CHECK_STEPS
    can_overlap = may_overlap = False
    release_parts = 1
    path_increment = 0.005
    path_ratios = (5.0, 0.4)  # a slack mesh starts well from what has converged well
    rim: Rim | None = None  # the drive moves the edge with the membrane (solve/multilevel.py)
    stations = np.zeros((0, 2))

    def __init__(self, model: Model, state: State) -> None:
        self.model, self.state = model, state
        self.group = SingleMesh(self)
        self.notes: list[str] = []
        self.drift = drift_of(model.scene.model.nodes_per_loop)
        self.stepper = stepper_of(model, state)
        self.neighbours = NeighbourSearch(model, state)
        self.diagnostics = Diagnostics(model, state, self.stepper)
        self.residual = Residual(model)
        self._has_temperature_field = any(any(stage.temperature_gradient) for stage in model.scene.stages)
        # values at the end of the previous level
        self._last = [wp.zeros_like(value) for value in self._level_values()] if self._relaxes else []
        self._predictions: dict[int, list[wp.Launch]] = {}  # by parity
        self._active_as_knitted = 0  # pairs that carry force as knitted

    # for relaxations only

    @cached_property
    def multipliers(self) -> Multipliers:
        return Multipliers(self.model, self.state, self.diagnostics)

    @cached_property
    def slowest_mode(self) -> SlowestMode:
        return SlowestMode(self.model, self.state, self.stepper)

    @cached_property
    def history(self) -> HistoryVariables:
        return HistoryVariables(self.model, self.state)

    @property
    def _relaxes(self) -> bool:
        return self.model.scene.solver.drive == "relax"

    def compile(self) -> None:
        if self._relaxes:
            self.history.advance()
        self.search()
        self.step(2)
        if not self._relaxes:
            self.residual_now()
            return
        self.slowest_mode.update(use=True)
        self.check(1, loading=False)
        self.predict(0.0)
        self.set_load(LoadPoint(np.eye(2), self.model.scene.wire.reference_temperature), LOAD_STEPS)

    # --- loads

    def set_load(self, load: LoadPoint, steps: int, *, evenly: bool = False) -> None:
        wire, state = self.model.scene.wire, self.state
        now, then = state.steering.load, [*load.gradient.ravel().tolist(), wire.length_factor(load.temperature)]
        state.steering.begin_ramp(then, steps, evenly=evenly)
        state.steering.ramp_share = 0.0 if steps else 1.0
        if self._has_temperature_field:
            state.wire_thermal_strain.assign(wire_thermal_strain(self.model, load.temperature, load.temperature_gradient))
        # bound on the relative affine motion of a body and a wire within the search radius
        self.neighbours.expect(2.0 * float(np.abs(then[:4] - now[:4]).max()) * self.neighbours.radius)

    def release(self, begin: float, end: float) -> None:
        """Nothing: the natural curvature is that of `wire.set_fraction` from the start."""

    def load_steps(self, load: LoadPoint, predicted: bool) -> int:
        return 0 if predicted else LOAD_STEPS

    def _level_values(self) -> list[wp.array]:
        """Displacements and multipliers, which `predict` extrapolates."""
        s = self.state
        return [s.node_ux[s.parity], s.node_uy[s.parity], s.body_ux, s.body_uy, s.tension_offset, s.pair_offset]

    def predict(self, ratio: float) -> None:
        self.state.steering.set(extrapolation=ratio)
        if self.state.parity not in self._predictions:
            self._predictions[self.state.parity] = self._record_prediction()
        for launch in self._predictions[self.state.parity]:
            launch.launch()
        self.stop()

    def _record_prediction(self) -> list[wp.Launch]:
        """Record the launches of `predict` at the current parity."""
        values, s = self._level_values(), self.state
        # within the margin of the neighbour search, so that no body changes sides
        max_move = 0.5 * self.neighbours.margin / self.model.precision.unit
        if self.model.scene.hook is not None:
            max_move = np.inf  # the frame moves a fixed wire affinely (mesh/hook_mesh.py); the prediction must undo all of it
        launches = []
        for value, last in zip(values, self._last, strict=True):
            limit = np.inf if value is s.tension_offset or value is s.pair_offset else max_move
            named = {"control": s.control, "limit": wp.float64(limit), "value": value, "last": last}
            if value is s.body_ux or value is s.body_uy:
                launches.append(bind(extrapolate_held_bodies, value.shape[0], pair_force=s.pair_force, **named))
            else:
                lowest = wp.float64(0.0 if value is s.pair_offset else -np.inf)
                launches.append(bind(extrapolate, value.shape[0], lowest=lowest, **named))
        return [launch.record(self.model.device) for launch in launches if launch.threads > 0]

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
        self.stepper.step(count)

    def deepest_overlap(self) -> str:
        return ""

    def overlap(self) -> float:
        return 0.0

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
        self.multipliers.begin_level()

    def begin_test(self, *, is_certain: bool) -> None:
        """Nothing: of the plane no unstable equilibrium is known."""

    has_left = False

    def check(self, checks: int, *, loading: bool) -> Check:
        control, diagnostics = self.state.steering.read(), self.diagnostics
        if loading:
            self.slowest_mode.update(use=False)
            return Check(np.nan, np.inf)
        solver = self.model.scene.solver
        self.slowest_mode.update(diagnostics.evaluate, diagnostics.sum, use=True)
        self.sums = diagnostics.last_sums()
        residual = float(self._residual(control, self.sums))
        ratio = residual / solver.residual_tolerance
        if solver.multipliers:
            ratio = max(ratio, self.multipliers.update(self.sums, nearly_converged=ratio < NEARLY_CONVERGED))
        return Check(residual, ratio)

    def _residual(self, control: Steering, sums: Sums) -> np.ndarray:
        return self.residual.measure(control, sums, fetch(self.state.wire_axial))

    def renew(self, checks: int) -> None:
        if self.model.scene.solver.multipliers and checks % SOFTENING_CHECKS == 0:
            self.multipliers.bound_softening()

    def stress(self) -> np.ndarray:
        return self.diagnostics.sums().stress

    def causes(self) -> str:
        strength, stress = self.model.scene.wire.tensile_strength, measure.largest_stress(self.observe())
        causes = strength_exceeded(stress, strength)
        if self.residual.is_lost_in_round_off(self.diagnostics.sums(), self.state.wire_axial.numpy()):
            name = self.model.precision.name
            causes += f", round-off in {name} precision exceeds the forces: set solver.precision = 'double'"
        if self._active_as_knitted:
            causes += f", {self._active_as_knitted} pairs are active as knitted: {TOO_THICK}"
        return causes

    def is_in_equilibrium(self, load: LoadPoint) -> bool:
        """Whether the load is that of the knitted mesh, and that mesh is free of stress."""
        if not load.is_as_knitted(self.model.scene.wire.reference_temperature):
            return False
        self.stepper.evaluate_contact()
        sums = self.diagnostics.sums()
        self._active_as_knitted = int(sums.closed)
        least = UNLOADED * force_scale(self.model)
        bend = self.model.bending_stiffness / float(self.model.table.hinge_length.min()) ** 2
        return bool(sums.closed == 0 and sums.tension_largest < least and sums.turning_largest * bend < least)

    # --- real time

    def renew_time_step(self, steps: int) -> float:
        self.stepper.evaluate_contact()  # contact forces are not in a checkpoint
        step = stable_step(self.model, self.state, steps)
        self.state.steering.set(time_step=step)
        return step

    def reserve_for_load(self) -> None:
        self.neighbours.expect(RAMP_SHARE * self.neighbours.margin)

    def follow_load(self) -> None:
        control = self.state.steering.read()
        if control.ramp_step < control.ramp_steps:
            self.neighbours.follow(control.gradient.ravel())

    def residual_now(self) -> float:
        return float(self._residual(self.state.steering.read(), self.diagnostics.sums()))

    # --- meshes of one knit (solve/multilevel.py)

    def prolongation(self, smaller: PlanarMechanics) -> Prolongation:
        return Prolongation(self.model, self.state, smaller.model, smaller.state)

    def membrane_grid(self, low: np.ndarray, cell: np.ndarray, cells: np.ndarray) -> MembraneGrid:
        return MembraneGrid(self.model, self.state, self.slowest_mode.probe, low, cell, cells)

    def state_variables(self) -> dict[str, np.ndarray]:
        return state_variables(self.model, self.state)

    def move_clamps(self, begin: np.ndarray, end: np.ndarray) -> None:
        self.state.move_clamps(begin, end)

    def clamp_forces(self) -> np.ndarray:
        return self.diagnostics.clamp_forces()

    def renew_damping(self) -> None:
        self.slowest_mode.update(use=True)

    @property
    def checked_stress(self) -> np.ndarray:
        return self.sums.stress

    @property
    def owners(self) -> list[Owner]:
        owners: list[Any] = [self.state, self.neighbours, self]
        if self._relaxes:
            owners += [self.history, self.multipliers.rules, self.slowest_mode]
        return [Owner(one) for one in owners]

    # --- observation

    def observe(self) -> PlanarObservables:
        return read(self.model, self.state)

    def edge_work_terms(self, observed: PlanarObservables) -> list[tuple[np.ndarray, np.ndarray]]:
        clamps = observed.edge_force, observed.clamp_shift
        return [clamps, (observed.thermal_strain_force, observed.thermal_strain)]
