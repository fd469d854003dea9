"""The drive `relax`: every load level is brought to rest with fictitious masses (kernels/control.py, damping.py).

Running multipliers take out what softened segments and contact penalties would change (multipliers.py).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import warp as wp

from . import measure
from .damping import SlowestMode
from .drive import CHECK_STEPS, Drive, LoadPoint, Progress, Record
from .errors import Diverged
from .kernels import control as c
from .kernels.multipliers import extrapolate, extrapolate_held_bodies
from .model import Model
from .multipliers import Multipliers
from .scene import Stage
from .state import State
from .tension import MOST_STATES

SOFTENING_LOOKS = 10  # looks between renewals of the bound on the softening
LEVEL_RAMP_STEPS = 100  # steps over which the first load of a stage comes on
LEVEL_STEP_LIMIT = 500_000  # steps of a level after which it counts as never steady, where the scene gives no max_steps
WORSE = 100.0  # times what was left at best: the mesh has gone on to another state
PATIENCE = 1500  # looks without progress by a tenth after which a level counts as never steady
DRIFT_LOOKS = 4  # looks over which the tension must stand still
TENSION_FLOOR = 1e-3  # of EI/C^3: what a change of tension is compared with where the mesh carries less
NEARLY_STEADY = 10.0  # residual over the tolerance below which multipliers that do not converge tell of taut wires


class Relaxation(Drive):
    """`output.frames` steady levels a stage; the first stage starts with the unloaded state."""

    def __init__(self, model: Model, state: State, progress: Progress, watch: Callable[[Progress], None]) -> None:
        super().__init__(model, state, progress, watch)
        self.multipliers = Multipliers(model, state)
        self.slowest_mode = SlowestMode(model, state, self.stepper)
        self._last = [wp.zeros_like(value) for value in self._level_values()]
        self._last_gradient: list[float] | None = None

    def warm_up(self) -> None:
        self.neighbours.search()
        self.stepper.step(2)
        self.slowest_mode.look(use=True)
        self._left(self.state.read_control())
        self._start_level(LoadPoint(np.eye(2), self.scene.wire.reference_temperature))

    def memory(self) -> dict[str, np.ndarray]:
        kept = {f"last_{k}": value.numpy().copy() for k, value in enumerate(self._last)}
        kept["last_gradient"] = np.array(self._last_gradient or [])
        return super().memory() | kept | self.multipliers.memory() | self.slowest_mode.memory()

    def recall(self, kept: dict[str, np.ndarray]) -> None:
        super().recall(kept)
        for k, value in enumerate(self._last):
            value.assign(kept[f"last_{k}"])
        self._last_gradient = kept["last_gradient"].tolist() or None
        self.multipliers.recall(kept)
        self.slowest_mode.recall(kept)

    def stage(self, stage: Stage) -> Iterator[Record]:
        progress = self.progress
        levels = self.scene.output.frames
        unloaded = progress.stage_index == 0
        driven = np.array([stage.strain_weft is None, stage.strain_warp is None])
        tension_start = np.array(progress.start["tension"])
        tension_end = np.array([stage.tension_weft or 0.0, stage.tension_warp or 0.0])
        scale = self.model.bending_stiffness / self.scene.knit.course_spacing**3
        while progress.level < levels + unloaded:
            factor = (progress.level + (not unloaded)) / levels
            progress.load_factor = factor
            if not progress.settling:
                self._start_level(self._target(stage, factor))
                progress.search.begin_level()
                self.multipliers.begin_level()
                progress.settling = True
                self._begin_settling()
            self._settle()
            if driven.any() and factor > 0.0:
                self._find_tension(tension_start + factor * (tension_end - tension_start), driven, scale, stage, factor)
            progress.settling = False
            yield self._record(stage, factor, steady=True)

    def _find_tension(self, wanted: np.ndarray, driven: np.ndarray, scale: float, stage: Stage, factor: float) -> None:
        """Try strains until the steady state carries the wanted tension."""
        while True:
            reading = measure.read(self.model, self.state)
            strain = np.diag(reading.gradient) - 1.0
            tension = np.array(measure.mesh_tension(reading))
            following = self.progress.search.next_strain(strain, tension, wanted, driven, scale)
            if following is None:
                return
            if self.progress.search.states > MOST_STATES:
                raise Diverged(
                    f"stage {stage.name!r}, load {factor:.3g}: no strain found at which the mesh carries"
                    f" {wanted[0]:.3g} N/m in weft and {wanted[1]:.3g} N/m in warp (now {tension[0]:.3g} and"
                    f" {tension[1]:.3g} N/m): give smaller tensions, more output.frames, or strains"
                )
            self._begin_settling()
            target = self._target(stage, factor)
            gradient = target.gradient.copy()
            gradient[np.diag_indices(2)] = np.where(driven, 1.0 + following, np.diag(gradient))
            self._set_ramp(LoadPoint(gradient, target.temperature), LEVEL_RAMP_STEPS)
            self._settle()

    def _level_values(self) -> list[wp.array]:
        """What a level starts from: its displacements and multipliers."""
        s = self.state
        return [s.node_ux[s.parity], s.node_uy[s.parity], s.body_ux, s.body_uy, s.tension_offset, s.pair_offset]

    def _start_level(self, target: LoadPoint) -> None:
        """Put the load of the next level on, and the state where the last two levels point to."""
        now = self.state.read_control()[int(c.GRADIENT) : int(c.GRADIENT) + 4].copy()
        ratio = 0.0
        if self._last_gradient is not None:
            before = now - np.array(self._last_gradient)
            ahead = target.gradient.ravel() - now
            ratio = float(np.clip(ahead @ before / max(before @ before, 1e-30), 0.0, 1.0))
        # no further than the neighbour search looks beyond a contact, so that no body changes sides
        furthest = 0.5 * self.neighbours.margin / self.model.precision.unit
        s = self.state
        for value, last in zip(self._level_values(), self._last, strict=True):
            numbers = [wp.float64(ratio), wp.float64(furthest)]
            kernel = extrapolate_held_bodies
            if value is s.body_ux or value is s.body_uy:
                numbers.append(s.pair_force)
            else:
                kernel = extrapolate
                if value is s.tension_offset or value is s.pair_offset:
                    numbers[1] = wp.float64(np.inf)
                numbers.append(wp.float64(0.0 if value is s.pair_offset else -np.inf))
            wp.launch(kernel, dim=value.shape[0], inputs=[*numbers, value, last], device=self.model.device)
        for speed in (self.state.node_vx, self.state.node_vy, self.state.body_vx, self.state.body_vy):
            speed.zero_()
        self._last_gradient = now.tolist()
        self._set_ramp(target, 0 if ratio > 0.0 else LEVEL_RAMP_STEPS)

    def _settle(self) -> None:
        """Step until the level is steady."""
        progress = self.progress
        limit = self.scene.solver.max_steps or LEVEL_STEP_LIMIT
        while True:
            self._advance(CHECK_STEPS)
            progress.looks += 1
            control = self.state.read_control()
            ramping = control[int(c.RAMP_STEP)] < control[int(c.RAMP_STEPS)]
            self.slowest_mode.look(use=not ramping)
            if not ramping:
                left = self._left(control)
                if left < 1.0:
                    left = max(left, self._drift())
                    if left < 1.0:
                        return
                else:
                    progress.tensions.clear()
                self._expect_progress(left)
            if self.scene.solver.multipliers and progress.looks % SOFTENING_LOOKS == 0:
                self.multipliers.bound_softening(measure.read(self.model, self.state))
            self.watch(progress)
            if progress.looks * CHECK_STEPS > limit:
                raise Diverged(
                    f"level {progress.load_factor:.3g} of stage {progress.stage!r} is not steady after {limit:,} steps"
                    f" ({self._how_far()}): raise solver.max_steps or solver.residual_tolerance"
                )

    def _begin_settling(self) -> None:
        self.progress.looks, self.progress.best, self.progress.waited = 0, 1e30, 0
        self.progress.tensions.clear()

    def _drift(self) -> float:
        """How much the nominal tensions moved over DRIFT_LOOKS, over what the tolerance allows; 1 or more before that.

        A soft mode can be far from rest where forces are nearly balanced and slow; the tension tells.
        """
        tensions = self.progress.tensions
        tensions.append(measure.nominal_stress(measure.read(self.model, self.state)).ravel().tolist())
        if len(tensions) <= DRIFT_LOOKS:
            return 1.0
        moved = np.abs(np.subtract(tensions[-1], tensions.pop(0))).max()
        least = TENSION_FLOOR * self.model.bending_stiffness / self.scene.knit.course_spacing**3
        scale = max(np.abs(tensions[-1]).max(), least)
        return float(moved / (self.scene.solver.residual_tolerance * scale))

    def _expect_progress(self, left: float) -> None:
        progress = self.progress
        progress.waited += 1
        if left < 0.9 * progress.best or left > WORSE * progress.best:  # a snap begins anew
            progress.best, progress.waited = left, 0
        if progress.waited > PATIENCE:
            raise Diverged(
                f"level {progress.load_factor:.3g} of stage {progress.stage!r} does not come to rest:"
                f" no better for {PATIENCE * CHECK_STEPS:,} steps ({self._how_far()}); raise output.frames, or"
                f" solver.residual_tolerance if that is near enough"
            )

    def _how_far(self) -> str:
        """Residual, what moves most, and whether the wires are beyond what they bear."""
        reading = measure.read(self.model, self.state)
        wire, stress = self.scene.wire, float(measure.stress_extremes(reading)[0])
        beyond = f", wires at {stress / 1e9:.3g} GPa are beyond their strength" if stress > wire.tensile_strength else ""
        return (
            f"residual {self.progress.residual:.2g} at a tolerance of {self.scene.solver.residual_tolerance:g},"
            f" {self._fastest()} moves most{beyond}"
        )

    def _left(self, control: np.ndarray) -> float:
        """What is left to do, 1 being the most that counts as steady; moves the multipliers."""
        tolerance = self.scene.solver.residual_tolerance
        self.progress.residual = self.steadiness.measure(control)
        left = self.progress.residual / tolerance
        if self.scene.solver.multipliers:
            left = max(left, self.multipliers.update(
                self.steadiness.strain, self.steadiness.tension, self.steadiness.turning, nearly_steady=left < NEARLY_STEADY
            ))  # fmt: skip
        return left
