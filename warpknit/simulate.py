"""The time loop: stages and load levels, when to search neighbours, and when a state is steady.

`Simulation.run` is a generator of `Record`s, one a recorded state, so that what is recorded stays apart from how to step. A
divergence raises `Diverged`. After every look at the state it calls `watch`, which may raise to stop the run.

Two drives (scene key solver.drive):

* relax: every level is brought to rest with fictitious masses (kernels/control.py, damping.py); running multipliers take
  out what softened segments and contact penalties would change (multipliers.py).
* ramp: real time and real (or scaled) masses; a stage loads over `loading_time` and is then held until steady.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field

import numpy as np
import warp as wp

from . import measure
from .damping import SlowestMode
from .errors import Diverged
from .kernels import control as c
from .kernels.multipliers import extrapolate, extrapolate_held_bodies
from .model import Model
from .multipliers import Multipliers
from .neighbours import RAMP_SHARE, NeighbourSearch
from .scene import Stage
from .state import State
from .step import Stepper
from .tension import MOST_STATES, TensionSearch
from .timestep import stable_step

CHECK_STEPS = 50  # steps between looks at the state
SOFTENING_LOOKS = 10  # looks between renewals of the bound on the softening
LEVEL_RAMP_STEPS = 100  # steps over which the first load of a stage comes on, in relax
LEVEL_STEP_LIMIT = 500_000  # steps of a level after which it counts as never steady, where the scene gives no max_steps
ENERGY_FLOOR = 1e-5  # of EI/W a loop: what kinetic energy is compared with where less is stored
FORCE_FLOOR = 0.05  # of EI/W^2: what the residual is compared with where contacts carry less
ROUND_OFF_RMS = 3.0  # rms residual that counts as round-off, over that of an edge: 1.7 of its length, a force has two edges
ROUND_OFF_LARGEST = 4.0  # the same of the largest residual, which is allowed LOCAL_ALLOWANCE times more
LOCAL_ALLOWANCE = 10.0
NEARLY_STEADY = 10.0  # residual over the tolerance below which multipliers that do not converge tell of taut wires
HOLD_LIMIT = 5.0  # loading times that a ramp is held at the end before it stops without being steady


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
    work: float | None  # [J] put in since the start, where the drive keeps account of it (ramp)
    reading: measure.Reading


@dataclass
class Progress:
    """Where a run is: for whoever watches it, and for a checkpoint. Plain numbers."""

    stage_index: int = 0
    stage: str = ""
    level: int = 0  # records of this stage so far
    records: int = 0
    steps: int = 0
    settling: bool = False  # inside a level
    load_factor: float = 0.0
    residual: float = 0.0
    looks: int = 0  # of the level
    start: dict[str, list[float] | float] = field(default_factory=dict)  # load at the start of the stage
    search: TensionSearch = field(default_factory=TensionSearch)
    time: float = 0.0  # [s] of the stage, in a ramp
    work: float = 0.0  # [J] in a ramp
    stress: list[float] = field(default_factory=list)  # [N/m] nominal stress at the last look, in a ramp

    def as_dict(self) -> dict:
        return asdict(self)

    @classmethod
    def from_dict(cls, values: dict) -> Progress:
        return cls(**{**values, "search": TensionSearch(**values["search"])})


@dataclass(frozen=True)
class LoadPoint:
    """A deformation gradient and what goes with it."""

    gradient: np.ndarray  # (2, 2)
    temperature: float  # [K]


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
        self.resumed = progress is not None
        self.progress = progress or Progress()
        self.watch = watch or (lambda _progress: None)
        h = float(model.table.spacing.min())
        epsilon = float(np.finfo(np.float32 if model.precision.name == "single" else np.float64).eps) / 2
        # rounding of an edge, seen through the stretching and the bending stiffness of a segment
        self._round_off_terms = (epsilon, 4 * model.bending_stiffness / h**2)
        self._stretch_energy = h / model.axial_stiffness
        self._bend_energy = model.bending_stiffness / h
        self._last = [wp.zeros_like(value) for value in self._level_values()]
        self._last_gradient: list[float] | None = None
        self._scratch = [
            wp.zeros(model.panel.node_count, dtype=model.precision.real, device=model.device) for _ in range(5)
        ]

    def warm_up(self) -> None:
        """Have every kernel that the run will use compiled or loaded; the state stays as it is."""
        before, kept = self.state.arrays(), self.memory()
        self.neighbours.search()
        self.stepper.step(2)
        self.slowest_mode.look(use=True)
        self._is_steady(self.state.read_control())
        if self.scene.solver.drive == "relax":
            self._start_level(LoadPoint(np.eye(2), self.scene.wire.reference_temperature))
        self.state.restore(before)
        self.recall(kept)
        self.progress.residual = 0.0

    # --- what a checkpoint needs beside the state ---

    def memory(self) -> dict[str, np.ndarray]:
        """Arrays that the loop carries from look to look."""
        kept = {f"last_{k}": value.numpy().copy() for k, value in enumerate(self._last)}
        kept["last_gradient"] = np.array(self._last_gradient or [])
        return kept | self.multipliers.memory() | self.slowest_mode.memory() | self.neighbours.memory()

    def recall(self, kept: dict[str, np.ndarray]) -> None:
        """Put back what `memory` returned."""
        for k, value in enumerate(self._last):
            value.assign(kept[f"last_{k}"])
        self._last_gradient = kept["last_gradient"].tolist() or None
        for part in (self.multipliers, self.slowest_mode, self.neighbours):
            part.recall(kept)

    # --- stages ---

    def run(self) -> Iterator[Record]:
        """Records of all stages, from where `progress` stands."""
        if not self.resumed:
            self.neighbours.search()
        stages = self.scene.stages
        progress = self.progress
        while progress.stage_index < len(stages):
            stage = stages[progress.stage_index]
            progress.stage = stage.name
            if not progress.start:
                progress.start = self._load_now()
            yield from self._relax(stage) if self.scene.solver.drive == "relax" else self._ramp(stage)
            progress.stage_index += 1
            progress.level, progress.start, progress.time = 0, {}, 0.0

    def _load_now(self) -> dict[str, list[float] | float]:
        index = self.progress.stage_index
        before = self.scene.stages[index - 1].temperature if index else self.scene.wire.reference_temperature
        reading = measure.read(self.model, self.state)
        return {
            "gradient": reading.gradient.ravel().tolist(),
            "tension": list(measure.mesh_tension(reading)),
            "temperature": before,
        }

    def _target(self, stage: Stage, factor: float) -> LoadPoint:
        """Load of a stage at a load factor; a direction driven by tension keeps the strain it has."""
        start = self.progress.start
        first = np.array(start["gradient"]).reshape(2, 2)
        now = self.state.read_control()[int(c.GRADIENT) : int(c.GRADIENT) + 4].reshape(2, 2)
        target = first.copy()
        for axis, strain in enumerate((stage.strain_weft, stage.strain_warp)):
            end = 1.0 + strain if strain is not None else None
            target[axis, axis] = now[axis, axis] if end is None else (1 - factor) * first[axis, axis] + factor * end
        target[0, 1] = (1 - factor) * first[0, 1] + factor * stage.shear
        before = float(start["temperature"])
        return LoadPoint(target, before + factor * (stage.temperature - before))

    def _record(self, stage: Stage, factor: float, steady: bool, work: float | None = None) -> Record:
        progress = self.progress
        before = float(progress.start["temperature"])
        record = Record(
            index=progress.records,
            stage=stage.name,
            stage_index=progress.stage_index,
            load_factor=factor,
            temperature=before + factor * (stage.temperature - before),
            steps=progress.steps,
            steady=steady,
            work=work,
            reading=measure.read(self.model, self.state),
        )
        progress.records += 1
        progress.level += 1
        return record

    def _set_ramp(self, target: LoadPoint, steps: int) -> None:
        """Aim at a load; with no steps it is there at once."""
        wire = self.scene.wire
        control = self.state.read_control()
        now = control[int(c.GRADIENT) : int(c.GRADIENT) + 5].tolist()
        factor = 1.0 + wire.expansion * (target.temperature - wire.reference_temperature)
        then = [*target.gradient.ravel().tolist(), factor]
        values: dict[int, float] = {int(c.RAMP_STEP): 0.0, int(c.RAMP_STEPS): float(steps)}
        for k in range(5):
            values[int(c.FROM) + k] = now[k]
            values[int(c.TO) + k] = then[k]
            if steps == 0:
                values[int(c.GRADIENT) + k] = then[k]
        self.state.write_control(values)
        # the affine motion itself brings a body and a wire within the search radius closer by at most this
        self.neighbours.expect(2.0 * float(np.abs(np.subtract(then[:4], now[:4])).max()) * self.neighbours.radius)

    # --- relax ---

    def _relax(self, stage: Stage) -> Iterator[Record]:
        """`output.frames` steady levels; the first stage starts with the unloaded state."""
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
                progress.settling, progress.looks = True, 0
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
            self.progress.looks = 0
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
        limit = self.scene.solver.max_steps or LEVEL_STEP_LIMIT
        while True:
            self._advance(CHECK_STEPS)
            self.progress.looks += 1
            control = self.state.read_control()
            ramping = control[int(c.RAMP_STEP)] < control[int(c.RAMP_STEPS)]
            self.slowest_mode.look(use=not ramping)
            if not ramping and self._is_steady(control):
                return
            if self.scene.solver.multipliers and self.progress.looks % SOFTENING_LOOKS == 0:
                self.multipliers.bound_softening(measure.read(self.model, self.state))
            self.watch(self.progress)
            if self.progress.looks * CHECK_STEPS > limit:
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
        force = self.state.pair_force.numpy()
        closed = force[force > 0]
        scale = max(float(closed.mean()) if len(closed) else 0.0, FORCE_FLOOR * measure.force_scale(model))
        free = model.panel.node_count + model.panel.body_count - len(model.panel.held_node)
        rms, largest = math.sqrt(control[int(c.FORCE_SQUARE)] / free), float(control[int(c.FORCE_MAX)])
        epsilon, bending = self._round_off_terms
        round_off = epsilon * np.hypot(self.state.wire_axial.numpy().astype(np.float64), bending)  # [wire]
        round_off_rms = math.sqrt(float(np.average(round_off**2, weights=model.panel.wire_count)))
        balance = max(
            rms / max(scale, ROUND_OFF_RMS * round_off_rms / tolerance),
            largest / (LOCAL_ALLOWANCE * max(scale, ROUND_OFF_LARGEST * float(round_off.max()) / tolerance)),
        )
        tension, turning = (self._scratch[k].numpy().astype(np.float64) for k in (3, 4))
        stored = 0.5 * float(tension @ tension) * self._stretch_energy + 0.5 * float(turning @ turning) * self._bend_energy
        motion = math.sqrt(
            0.5 * float(control[int(c.KINETIC_TWICE)]) / max(stored, ENERGY_FLOOR * measure.energy_scale(model))
        )
        self.progress.residual = max(balance, motion)
        left = 0.0
        if self.scene.solver.drive == "relax" and self.scene.solver.multipliers:
            left = self.multipliers.update(
                *self._scratch[2:5], nearly_steady=self.progress.residual < NEARLY_STEADY * tolerance
            )
        return self.progress.residual < tolerance and left < 1.0

    # --- ramp ---

    def _ramp(self, stage: Stage) -> Iterator[Record]:
        """Load over `loading_time`, recording `output.frames` states on the way, then hold until steady."""
        progress, frames = self.progress, self.scene.output.frames
        loading_time = self.model.loading_time
        unloaded = progress.stage_index == 0
        if progress.level == 0 and unloaded:
            yield self._record(stage, 0.0, steady=True, work=progress.work)
        if not progress.settling:
            self._set_ramp(self._target(stage, 1.0), math.ceil(loading_time / self._renew_step()))
            self.neighbours.expect(RAMP_SHARE * self.neighbours.margin)
            progress.settling = True
        recorded = progress.level - unloaded
        while True:
            step = self._renew_step()
            self._advance(CHECK_STEPS)
            progress.time += CHECK_STEPS * step
            progress.looks += 1
            self._account_work()
            control = self.state.read_control()
            share = min(1.0, float(control[int(c.RAMP_STEP)] / max(control[int(c.RAMP_STEPS)], 1.0)))
            progress.load_factor = _smooth(share)
            self._reserve_for_ramp(control)
            if share >= 1.0 and self._is_steady(control):
                break
            if progress.time > (1.0 + HOLD_LIMIT) * loading_time:
                break
            while recorded < frames - 1 and share * frames >= recorded + 1:
                recorded += 1
                yield self._record(stage, progress.load_factor, steady=False, work=progress.work)
            self.watch(progress)
        progress.settling, progress.load_factor = False, 1.0
        steady = progress.residual < self.scene.solver.residual_tolerance
        yield self._record(stage, 1.0, steady=steady, work=progress.work)

    def _renew_step(self) -> float:
        """The time step that the present tension and contact allow."""
        step = stable_step(self.model, self.state)
        self.state.write_control({c.TIME_STEP: step})
        return step

    def _account_work(self) -> None:
        """Work of the boundary since the last look: mean nominal stress times the change of the gradient times the area."""
        reading = measure.read(self.model, self.state)
        now = [*measure.nominal_stress(reading).ravel().tolist(), measure.thermal_force(reading)]
        now += [*reading.gradient.ravel().tolist(), reading.length_factor]
        if self.progress.stress:
            before = np.array(self.progress.stress)
            area = float(np.prod(self.model.panel.size))
            moved = np.array(now[5:]) - before[5:]
            mean = 0.5 * (np.array(now[:5]) + before[:5]) * np.array([area] * 4 + [1.0])
            self.progress.work += float(mean @ moved)
        self.progress.stress = now

    def _reserve_for_ramp(self, control: np.ndarray) -> None:
        """Search again before the affine motion since the last search uses up what was kept for it."""
        if control[int(c.RAMP_STEP)] < control[int(c.RAMP_STEPS)]:
            self.neighbours.follow(control[int(c.GRADIENT) : int(c.GRADIENT) + 4])

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
            f" stage {self.progress.stage!r}, weft strain {strain[0]:.3g}, warp strain {strain[1]:.3g}; likely the load comes"
            f" on too fast for the stiffness there: raise output.frames (relax) or solver.loading_time (ramp)"
        )


def _smooth(x: float) -> float:
    """The ramp of kernels/control.py."""
    return x * x * x * (10.0 + x * (6.0 * x - 15.0))
