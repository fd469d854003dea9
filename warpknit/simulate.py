"""The time loop: stages and load levels, when to search neighbours, and why a run stopped.

`simulate` is a generator of `Record`s, one a recorded state, so that what is recorded stays apart from how to step. It ends
by returning; a divergence raises `Diverged`. Between records it calls `watch`, which may stop it.

Two drives (scene key solver.drive):

* relax: every level is brought to rest with fictitious masses by FIRE (kernels/control.py); running multipliers take out
  what softened segments and contact penalties would change.
* ramp: real time and real (or scaled) masses; a stage loads over `loading_time` and is then held until steady.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import warp as wp

from . import measure
from .damping import SlowestMode
from .errors import Diverged
from .kernels import control as c
from .kernels.multipliers import extrapolate
from .model import Model
from .multipliers import Multipliers
from .neighbours import NeighbourSearch
from .scene import Stage
from .state import State
from .step import Stepper

CHECK_STEPS = 50  # steps between looks at the state
LEVEL_RAMP_STEPS = 100  # steps over which a level's load comes on, in relax
ENERGY_FLOOR = 1e-5  # of EI/W a loop: what kinetic energy is compared with where less is stored
ROUND_OFF_RMS = 2.0  # rms residual that counts as round-off, over the estimate of it
ROUND_OFF_LARGEST = 4.0  # the same of the largest residual, which is allowed LOCAL_ALLOWANCE times more
LOCAL_ALLOWANCE = 10.0
FORCE_FLOOR = 0.05  # of EI/W^2: what the residual is compared with where contacts carry less


@dataclass(frozen=True)
class Record:
    """A state worth keeping: where it stands in the load and what was read."""

    index: int
    stage: str
    stage_index: int
    load_factor: float
    temperature: float
    steps: int
    steady: bool
    reading: measure.Reading


@dataclass
class Progress:
    """Where a run is, for whoever watches it; also what a checkpoint needs beside the state."""

    stage_index: int = 0
    level: int = 0
    records: int = 0
    steps: int = 0
    phase: str = "load"
    stage: str = ""
    load_factor: float = 0.0
    residual: float = 0.0
    looks: int = 0  # of the level


@dataclass(frozen=True)
class LoadPoint:
    """A deformation gradient and what goes with it."""

    gradient: np.ndarray  # (2, 2)
    temperature: float

    def control(self, expansion: float, reference: float) -> list[float]:
        return [*self.gradient.ravel().tolist(), 1.0 + expansion * (self.temperature - reference)]


class Simulation:
    """A run of a model through the stages of its scene."""

    def __init__(
        self,
        model: Model,
        state: State,
        *,
        progress: Progress | None = None,
        watch: Callable[[Progress], None] | None = None,
    ) -> None:
        self.model = model
        self.state = state
        self.scene = model.scene
        self.stepper = Stepper(model, state)
        self.neighbours = NeighbourSearch(model, state)
        self.multipliers = Multipliers(model, state)
        self.slowest_mode = SlowestMode(model, state, self.stepper)
        self.progress = progress or Progress()
        self.watch = watch or (lambda _progress: None)
        h = float(model.table.spacing.min())
        axial = model.axial_stiffness / model.softening
        epsilon = float(np.finfo(np.float32 if model.precision.name == "single" else np.float64).eps) / 2
        # rounding of an edge, seen through the stretching and the bending stiffness of a segment
        self._round_off = epsilon * math.hypot(axial, 4 * model.bending_stiffness / h**2)
        self._stretch_energy = h / model.axial_stiffness
        self._bend_energy = model.bending_stiffness / h
        self._last = [wp.zeros_like(value) for value in self._level_values()]
        self._last_gradient: np.ndarray | None = None
        self._scratch = [wp.zeros(model.panel.node_count, dtype=model.precision.real, device=model.device) for _ in range(5)]

    # --- stages ---

    def run(self) -> Iterator[Record]:
        """Records of all stages, from where `progress` stands."""
        self.neighbours.search()
        while self.progress.stage_index < len(self.scene.stages):
            stage = self.scene.stages[self.progress.stage_index]
            self.progress.stage = stage.name
            yield from self._relax_stage(stage) if self.scene.solver.drive == "relax" else self._ramp_stage(stage)
            self.progress.stage_index += 1
            self.progress.level = 0

    def _start_of(self, index: int) -> LoadPoint:
        """Load at which a stage starts: what the stage before aimed at, or rest."""
        if index == 0:
            return LoadPoint(np.eye(2), self.scene.wire.reference_temperature)
        return LoadPoint(self._stage_end(index - 1), self.scene.stages[index - 1].temperature)

    def _stage_end(self, index: int) -> np.ndarray:
        stage = self.scene.stages[index]
        return np.array([[1.0 + (stage.strain_weft or 0.0), stage.shear], [0.0, 1.0 + (stage.strain_warp or 0.0)]])

    def _relax_stage(self, stage: Stage) -> Iterator[Record]:
        levels = self.scene.output.frames
        start = self._start_of(self.progress.stage_index)
        end = LoadPoint(self._stage_end(self.progress.stage_index), stage.temperature)
        while self.progress.level < levels + (self.progress.stage_index == 0):
            # the first stage has a level more: the unloaded state
            level = self.progress.level + (self.progress.stage_index > 0)
            factor = level / levels
            target = LoadPoint(
                start.gradient + factor * (end.gradient - start.gradient),
                start.temperature + factor * (end.temperature - start.temperature),
            )
            self.progress.load_factor = factor
            if self.progress.phase == "load":
                self._start_level(target)
                self.progress.phase = "settle"
                self.progress.looks = 0
            self._settle()
            yield self._record(stage, factor, target.temperature, steady=True)
            self.progress.level += 1
            self.progress.phase = "load"

    def _record(self, stage: Stage, factor: float, temperature: float, steady: bool) -> Record:
        record = Record(
            index=self.progress.records,
            stage=stage.name,
            stage_index=self.progress.stage_index,
            load_factor=factor,
            temperature=temperature,
            steps=self.progress.steps,
            steady=steady,
            reading=measure.read(self.model, self.state),
        )
        self.progress.records += 1
        return record

    # --- load ---

    def _set_ramp(self, target: LoadPoint, steps: int) -> None:
        """Aim at a load; with no steps it is there at once."""
        wire = self.scene.wire
        control = self.state.read_control()
        now = control[int(c.GRADIENT) : int(c.GRADIENT) + 5].tolist()
        then = target.control(wire.expansion, wire.reference_temperature)
        values: dict[int, float] = {int(c.RAMP_STEP): 0.0, int(c.RAMP_STEPS): float(steps)}
        for k in range(5):
            values[int(c.FROM) + k] = now[k]
            values[int(c.TO) + k] = then[k]
            if steps == 0:
                values[int(c.GRADIENT) + k] = then[k]
        self.state.write_control(values)
        # the affine motion itself brings a body and a wire within the search radius closer by at most this
        change = float(np.abs(np.subtract(then[:4], now[:4])).max())
        self.neighbours.expect(2.0 * change * self.neighbours.radius)

    # --- relax ---

    def _level_values(self) -> list[wp.array]:
        """What a level starts from: its displacements and multipliers."""
        s = self.state
        return [
            s.node_ux[s.parity], s.node_uy[s.parity], s.body_ux, s.body_uy, s.tension_offset, s.pair_offset,
        ]  # fmt: skip

    def _start_level(self, target: LoadPoint) -> None:
        """Put the load of the next level on, and the state where the last two levels point to."""
        control = self.state.read_control()
        now = control[int(c.GRADIENT) : int(c.GRADIENT) + 5].copy()
        wire = self.scene.wire
        then = np.array(target.control(wire.expansion, wire.reference_temperature))
        ratio = 0.0
        if self._last_gradient is not None:
            before = now - self._last_gradient
            ratio = float(np.clip((then - now) @ before / max(before @ before, 1e-30), 0.0, 1.0))
        for value, last in zip(self._level_values(), self._last, strict=True):
            lowest = 0.0 if value is self.state.pair_offset else -np.inf
            wp.launch(
                extrapolate,
                dim=value.shape[0],
                inputs=[wp.float64(ratio), wp.float64(lowest), value, last],
                device=self.model.device,
            )
        if self.scene.solver.multipliers:
            self.multipliers.bound_softening(measure.read(self.model, self.state))
        for speed in (self.state.node_vx, self.state.node_vy, self.state.body_vx, self.state.body_vy):
            speed.zero_()
        self._last_gradient = now
        self._set_ramp(target, 0 if ratio > 0.0 else LEVEL_RAMP_STEPS)

    def _settle(self) -> None:
        """Step until the level is steady."""
        tolerance = self.scene.solver.residual_tolerance
        limit = self.scene.solver.max_steps
        while True:
            self._advance(CHECK_STEPS)
            self.progress.looks += 1
            control = self.state.read_control()
            ramping = control[int(c.RAMP_STEP)] < control[int(c.RAMP_STEPS)]
            self.slowest_mode.look(use=not ramping)
            if not ramping and self._is_steady(control):
                return
            self.watch(self.progress)
            if limit is not None and self.progress.looks * CHECK_STEPS > limit:
                raise Diverged(
                    f"level {self.progress.load_factor:.3g} of stage {self.progress.stage!r} is not steady after {limit}"
                    f" steps (residual {self.progress.residual:.2g}): raise solver.max_steps or solver.residual_tolerance"
                )

    def _is_steady(self, control: np.ndarray) -> bool:
        """Whether forces balance, motion has died down, and the multipliers have done their work; moves the latter.

        Balance: rms nodal residual under the tolerance times the mean contact force, the largest under ten times as much, or
        both within what round-off leaves.
        Motion: root of kinetic over stored energy under the tolerance; it is what soft modes still have to go, which the
        residual does not see.
        """
        model, tolerance = self.model, self.scene.solver.residual_tolerance
        measure.evaluate(model, self.state, self._scratch)
        left = self.multipliers.update(self._scratch[3]) if self.scene.solver.multipliers else 0.0
        force = self.state.pair_force.numpy()
        closed = force[force > 0]
        scale = max(float(closed.mean()) if len(closed) else 0.0, FORCE_FLOOR * measure.force_scale(model))
        free = model.panel.node_count + model.panel.body_count - len(model.panel.held_node)
        rms, largest = math.sqrt(control[int(c.FORCE_SQUARE)] / free), float(control[int(c.FORCE_MAX)])
        floor = self._round_off / tolerance
        balance = max(
            rms / max(scale, ROUND_OFF_RMS * floor),
            largest / (LOCAL_ALLOWANCE * max(scale, ROUND_OFF_LARGEST * floor)),
        )
        tension, turning = (self._scratch[k].numpy().astype(np.float64) for k in (3, 4))
        stored = 0.5 * float(tension @ tension) * self._stretch_energy + 0.5 * float(turning @ turning) * self._bend_energy
        motion = math.sqrt(
            0.5 * float(control[int(c.KINETIC_TWICE)]) / max(stored, ENERGY_FLOOR * measure.energy_scale(model))
        )
        self.progress.residual = max(balance, motion)
        return self.progress.residual < tolerance and left < 1.0

    # --- steps ---

    def _advance(self, steps: int) -> None:
        """Take steps, searching neighbours whenever the state says that the last search no longer holds."""
        left = steps
        while left > 0:
            before = int(self.state.read_control()[int(c.STEP)])
            self.stepper.step(left)
            control = self.state.read_control()
            taken = int(control[int(c.STEP)]) - before
            self.progress.steps += taken
            left -= taken
            status = control[int(c.STATUS)]
            if status == 2.0:
                raise self._divergence()
            if status == 1.0:
                self.neighbours.search()

    def _divergence(self) -> Diverged:
        """Name the wire and node that moved fastest."""
        speed = np.hypot(self.state.node_vx.numpy().astype(float), self.state.node_vy.numpy().astype(float))
        node = int(np.argmax(np.nan_to_num(speed, nan=np.inf)))
        wire = int(np.searchsorted(self.model.panel.wire_first, node, side="right") - 1)
        control = self.state.read_control()
        strain = [control[int(c.GRADIENT)] - 1, control[int(c.GRADIENT) + 3] - 1]
        return Diverged(
            f"diverged at step {self.progress.steps}: wire {wire}, node {node - int(self.model.panel.wire_first[wire])},"
            f" stage {self.progress.stage!r}, weft strain {strain[0]:.3g}, warp strain {strain[1]:.3g}; likely the time step"
            f" is too long for the stiffness there: lower solver.axial_softening or raise solver.mass_scaling"
        )

