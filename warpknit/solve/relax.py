"""The drive `relax`: every load level is brought to rest with fictitious masses (kernels/control.py, damping.py).

Running multipliers take out what softened segments and contact penalties would change (multipliers.py).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import warp as wp

from .. import measure
from ..errors import Diverged
from ..kernels import control as c
from ..kernels.multipliers import extrapolate, extrapolate_held_bodies
from ..launch import bind
from ..model.model import Model
from ..model.state import State
from ..scene import Stage
from .damping import SlowestMode
from .drive import CHECK_STEPS, Drive, LoadPoint, Progress, Record
from .multipliers import Multipliers
from .path import Path
from .response import carried_values
from .tension import MOST_STATES

SOFTENING_LOOKS = 10  # looks between renewals of the bound on the softening
LEVEL_RAMP_STEPS = 100  # steps over which the first load of a stage comes on
LEVEL_STEP_LIMIT = 500_000  # steps of a level after which it counts as never steady, where the scene gives no max_steps
WORSE = 100.0  # times what was left at best: the mesh has gone on to another state
PATIENCE = 1500  # looks without progress by a tenth after which a level counts as never steady
PATIENT_NODES = 100  # a loop, up to which that holds: periods of bending take steps with the square of the nodes
PATH_STRAIN = 0.005  # between steady states on a path that the state depends on, at most
UNLOADED = 1e-3  # of EI/W^2: forces that count as none in a mesh as knitted
DRIFT_LOOKS = (5, 40)  # looks over which the tension must stand still, least and most
DRIFT_NODES = 24  # a loop, from which they grow with the square of the nodes, as periods of bending do
TENSION_FLOOR = 1e-3  # of EI/C^3: what a change of tension is compared with where the mesh carries less
NEARLY_STEADY = 10.0  # residual over the tolerance below which multipliers that do not converge tell of taut wires


@dataclass(frozen=True)
class WantedTension:
    """The directions (weft, warp) of a level that are driven by tension, and how much."""

    driven: np.ndarray  # (2,) bool
    tension: np.ndarray  # (2,) [N/m]

    def gradient(self, gradient: np.ndarray, strain: np.ndarray) -> np.ndarray:
        """The deformation gradient with `strain` in the driven directions."""
        there = measure.stretch(gradient)
        there[np.diag_indices(2)] = np.where(self.driven, 1.0 + strain, np.diag(there))
        return measure.rotation(measure.clamp_rotation(gradient)).T @ there


class Relaxation(Drive):
    """`output.frames` steady levels a stage; the first stage starts with the unloaded state."""

    def __init__(self, model: Model, state: State, progress: Progress, watch: Callable[[Progress], None]) -> None:
        super().__init__(model, state, progress, watch)
        self.multipliers = Multipliers(model, state, self.look)
        self.path = Path(model, state)
        self.slowest_mode = SlowestMode(model, state, self.stepper)
        self._last = [wp.zeros_like(value) for value in self._level_values()]
        self._last_gradient: list[float] | None = None
        self._pressed = 0  # pairs that carry force in the mesh as knitted

    @property
    def dissipated(self) -> float:
        return self.path.dissipated

    def _launch_all(self) -> None:
        self.path.advance()
        self.neighbours.search()
        self.stepper.step(2)
        self.slowest_mode.look(use=True)
        self._left(self.state.read_control())
        self._start_level(LoadPoint(np.eye(2), self.scene.wire.reference_temperature))

    def memory(self) -> dict[str, np.ndarray]:
        kept = {f"last_{k}": value.numpy().copy() for k, value in enumerate(self._last)}
        kept["last_gradient"] = np.array(self._last_gradient or [])
        kept |= self.path.memory() | {"left_out": np.array(self.left_out)}
        return super().memory() | kept | self.multipliers.memory() | self.slowest_mode.memory()

    def recall(self, kept: dict[str, np.ndarray]) -> None:
        super().recall(kept)
        for k, value in enumerate(self._last):
            value.assign(kept[f"last_{k}"])
        self._last_gradient = kept["last_gradient"].tolist() or None
        self.multipliers.recall(kept)
        self.path.recall(kept)
        self.left_out = float(kept["left_out"])
        self.slowest_mode.recall(kept)

    def stage(self, stage: Stage) -> Iterator[Record]:
        progress = self.progress
        levels = self.scene.output.frames
        unloaded = progress.stage_index == 0
        driven = np.array(stage.by_tension)
        tension_start = np.array(progress.start.tension)
        tension_end = np.array([stage.tension_weft or 0.0, stage.tension_warp or 0.0])
        while progress.level < levels + unloaded:
            factor = (progress.level + (not unloaded)) / levels
            parts = self._parts_of_level(stage, factor, levels)
            while progress.part < parts:
                there = factor - (parts - progress.part - 1) / (parts * levels)
                progress.load_factor = there
                wanted = None
                if driven.any() and there > 0.0:
                    wanted = WantedTension(driven, tension_start + there * (tension_end - tension_start))
                self.bring_to_rest(self.target(stage, there), wanted)
                self.path.advance()
                progress.part += 1
            progress.part = 0
            yield self.record(stage, factor, steady=True)

    def _parts_of_level(self, stage: Stage, factor: float, levels: int) -> int:
        """Steady states on the way to a level: where the state depends on the way, the strain between two is bounded."""
        if not self.scene.depends_on_path or factor <= 0.0:
            return 1
        ends = [self.target(stage, f) for f in (factor - 1.0 / levels, factor)]
        strain = float(np.abs(ends[1].gradient - ends[0].gradient).max())
        if self.rim is not None and ends[0].stations is not None and ends[1].stations is not None:
            # a pull strains what is near it most
            along = np.diff(ends[1].stations - ends[0].stations, axis=0, append=(ends[1].stations - ends[0].stations)[:1])
            strain = max(strain, float(np.abs(along).max()) * len(self.rim.arc) / self.rim.outline.length)
        return max(1, math.ceil(strain / PATH_STRAIN - 1e-9))

    def bring_to_rest(self, target: LoadPoint, wanted: WantedTension | None) -> None:
        """Go to the next load level, the smaller mesh first, or on with the one that was begun."""
        progress = self.progress
        if progress.steps == 0 and wanted is None and self.is_at_rest(target):
            return
        if not progress.settling:
            target = self._prepare(target, wanted)
            self.begin_level(target)
        self._settle()
        if wanted is not None:
            self._find_tension(wanted, target)
        progress.settling = False

    def _prepare(self, target: LoadPoint, wanted: WantedTension | None) -> LoadPoint:
        """What is done before a load is put on, and the load."""
        return target

    def begin_level(self, target: LoadPoint) -> None:
        """Put the load of the next level on; what is left is to settle."""
        self._start_level(target)
        self.progress.search.begin_level()
        self.multipliers.begin_level()
        self.progress.settling = True
        self._begin_settling()

    def is_at_rest(self, target: LoadPoint) -> bool:
        """Whether a mesh that was not stepped yet is at rest under a load: as knitted, unless it was knitted under stress."""
        as_knitted = np.array_equal(target.gradient, np.eye(2)) and target.temperature == self.scene.wire.reference_temperature
        if not as_knitted:
            return False
        self.stepper.evaluate_contact()
        sums = self.look.take()
        self._pressed = int(sums.closed)
        least = UNLOADED * measure.force_scale(self.model)
        bend = self.model.bending_stiffness / float(self.model.table.hinge_length.min()) ** 2
        return bool(sums.closed == 0 and sums.tension_largest < least and sums.turning_largest * bend < least)

    def rest_at(self, gradient: np.ndarray, temperature: float) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Nominal stress (2, 2) [N/m] of the mesh at rest under a load, and the values that describe the state."""
        self.bring_to_rest(LoadPoint(gradient, temperature), None)
        return measure.nominal_stress(measure.read(self.model, self.state)), carried_values(self.model, self.state)

    def _find_tension(self, wanted: WantedTension, target: LoadPoint) -> None:
        """Try strains until the steady state carries the wanted tension."""
        scale = measure.tension_scale(self.model)
        while True:
            reading = measure.read(self.model, self.state)
            strain = np.diag(reading.stretch) - 1.0
            tension = self._mesh_tension(reading)
            following = self.progress.search.next_strain(strain, tension, wanted.tension, wanted.driven, scale)
            if following is None:
                return
            if self.progress.search.states > MOST_STATES:
                raise Diverged(
                    f"stage {self.progress.stage!r}, load {self.progress.load_factor:.3g}: no strain found at which the mesh"
                    f" carries {wanted.tension[0]:.3g} N/m in weft and {wanted.tension[1]:.3g} N/m in warp (now"
                    f" {tension[0]:.3g} and {tension[1]:.3g} N/m): give smaller tensions, more output.frames, or strains"
                )
            self._begin_settling()
            self._set_ramp(target.strained(wanted.gradient(reading.gradient, following)), LEVEL_RAMP_STEPS)
            self._settle()

    def _level_values(self) -> list[wp.array]:
        """What a level starts from: its displacements and multipliers."""
        s = self.state
        return [s.node_ux[s.parity], s.node_uy[s.parity], s.body_ux, s.body_uy, s.tension_offset, s.pair_offset]

    def _start_level(self, target: LoadPoint) -> None:
        """Put the load of the next level on, and the state where the last two levels point to."""
        now = self.state.gradient.ravel()
        ratio = 0.0
        if self._last_gradient is not None and not self.scene.depends_on_path:
            before = now - np.array(self._last_gradient)
            ahead = target.gradient.ravel() - now
            ratio = float(np.clip(ahead @ before / max(before @ before, 1e-30), 0.0, 1.0))
        # no further than the neighbour search looks beyond a contact, so that no body changes sides
        furthest = 0.5 * self.neighbours.margin / self.model.precision.unit
        if self.scene.hook is not None:
            furthest = np.inf  # a wire that stays is carried along by the frame (hook.py), and must be put back all the way
        s = self.state
        for value, last in zip(self._level_values(), self._last, strict=True):
            limit = np.inf if value is s.tension_offset or value is s.pair_offset else furthest
            named = {"ratio": wp.float64(ratio), "limit": wp.float64(limit), "value": value, "last": last}
            if value is s.body_ux or value is s.body_uy:
                launch = bind(extrapolate_held_bodies, value.shape[0], pair_force=s.pair_force, **named)
            else:
                lowest = wp.float64(0.0 if value is s.pair_offset else -np.inf)
                launch = bind(extrapolate, value.shape[0], lowest=lowest, **named)
            launch.run(self.model.device)
        self._begin_at_rest()
        self._last_gradient = now.tolist()
        self._set_ramp(target, 0 if ratio > 0.0 else LEVEL_RAMP_STEPS)

    def _begin_at_rest(self) -> None:
        for speed in (self.state.node_vx, self.state.node_vy, self.state.body_vx, self.state.body_vy):
            speed.zero_()

    def _settle(self) -> None:
        """Step until the level is steady."""
        progress = self.progress
        while True:
            self._advance(CHECK_STEPS)
            progress.looks += 1
            control = self.state.read_control()
            ramping = control[int(c.RAMP_STEP)] < control[int(c.RAMP_STEPS)]
            self.slowest_mode.look(use=not ramping)
            if not ramping:
                left = self._left_of_all(self._left(control))
                if left < 1.0:
                    left = max(left, self._drift())
                    if left < 1.0:
                        return
                else:
                    progress.tensions.clear()
                self._expect_progress(left)
            if self.scene.solver.multipliers and progress.looks % SOFTENING_LOOKS == 0:
                self.multipliers.bound_softening()
            self.watch(progress)
            if progress.looks * CHECK_STEPS > self.most_steps:
                raise self.too_long()

    def _left_of_all(self, left: float) -> float:
        """What is left to do, 1 being the most that counts as steady, given what is left in the forces."""
        return left

    def _begin_settling(self) -> None:
        progress = self.progress
        progress.looks, progress.best, progress.waited = 0, 1e30, 0
        progress.tensions.clear()

    def _drift(self) -> float:
        """How much the nominal tensions moved over the last `drift_looks`, over what the tolerance allows; 1 or more before that.

        A soft mode can be far from rest where forces are nearly balanced and slow; the tension tells.
        """
        tensions = self.progress.tensions
        tensions.append(self.look.take().stress.ravel().tolist())  # with what the multipliers have just changed
        if len(tensions) <= drift_looks(self.scene.model.nodes_per_loop):
            return 1.0
        moved = np.abs(np.subtract(tensions[-1], tensions.pop(0))).max()
        scale = max(np.abs(tensions[-1]).max(), self.least_tension)
        return float(moved / (self.scene.solver.residual_tolerance * scale))

    @property
    def least_tension(self) -> float:
        """[N/m] what tensions are compared with where the mesh carries less."""
        return TENSION_FLOOR * measure.tension_scale(self.model)

    def _expect_progress(self, left: float) -> None:
        progress = self.progress
        progress.waited += 1
        if left < 0.9 * progress.best or left > WORSE * progress.best:  # a snap begins anew
            progress.best, progress.waited = left, 0
        if progress.waited > patience_of(self.scene.model.nodes_per_loop):
            raise self.no_progress()

    def no_progress(self) -> Diverged:
        """The error of a level that gets no nearer to rest."""
        steps = patience_of(self.scene.model.nodes_per_loop) * CHECK_STEPS
        return Diverged(
            f"level {self.progress.load_factor:.3g} of stage {self.progress.stage!r} does not come to rest:"
            f" no better for {steps:,} steps ({self._how_far()}); raise output.frames, or"
            f" solver.residual_tolerance if that is near enough"
        )

    def too_long(self) -> Diverged:
        """The error of a level that takes more steps than it may."""
        return Diverged(
            f"level {self.progress.load_factor:.3g} of stage {self.progress.stage!r} is not steady after {self.most_steps:,}"
            f" steps ({self._how_far()}): raise solver.max_steps or solver.residual_tolerance"
        )

    @property
    def most_steps(self) -> int:
        """Steps of a level after which it counts as never steady."""
        return self.scene.solver.max_steps or LEVEL_STEP_LIMIT

    def _how_far(self) -> str:
        """Residual, what moves most, and what may keep the mesh from coming to rest."""
        reading = measure.read(self.model, self.state)
        wire, stress = self.scene.wire, float(measure.stress_extremes(reading)[0])
        causes = ""
        if stress > wire.tensile_strength:
            causes += f", wires at {stress / 1e9:.3g} GPa are beyond their strength"
        if self.steadiness.is_lost_in_round_off(self.look.take(), self.state.wire_axial.numpy()):
            causes += f", round-off in {self.model.precision.name} precision is more than the forces: solver.precision = 'double'"
        if self._pressed:
            causes += f", {self._pressed} pairs press as knitted: the yarn is thicker than the loops leave room for"
        return (
            f"residual {self.progress.residual:.2g} at a tolerance of {self.scene.solver.residual_tolerance:g},"
            f" {self._fastest()} moves most{causes}"
        )

    def _left(self, control: np.ndarray) -> float:
        """What is left to do, 1 being the most that counts as steady; moves the multipliers."""
        tolerance = self.scene.solver.residual_tolerance
        self._sums = self.look.take()
        self.progress.residual = float(self.steadiness.measure(control, self._sums, self.state.wire_axial.numpy()))
        left = self.progress.residual / tolerance
        if self.scene.solver.multipliers:
            left = max(left, self.multipliers.update(self._sums, nearly_steady=left < NEARLY_STEADY))
        return left


def drift_looks(nodes_per_loop: int) -> int:
    """Looks over which the tension of a level must stand still."""
    least, most = DRIFT_LOOKS
    return min(most, max(least, round(least * (nodes_per_loop / DRIFT_NODES) ** 2)))


def patience_of(nodes_per_loop: int) -> int:
    """Looks without progress that a level is given. Fictitious masses go with 4 EI/h^3, so slow motions of the wires take steps
    with the square of the nodes."""
    return round(PATIENCE * max(1.0, (nodes_per_loop / PATIENT_NODES) ** 2))
