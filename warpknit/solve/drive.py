"""What the two drives share: where a run stands, how a load is put on, and how steps are taken.

`Drive.stage` is a generator of `Record`s, one a recorded state. A divergence raises `Diverged`. After every look at the state
it calls `watch`, which may raise to stop the run.
"""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field, replace

import numpy as np

from .. import measure
from ..errors import Diverged
from ..kernels import control as c
from ..measure.edge_work import EdgeWork
from ..mesh.rim import Rim
from ..planar.diagnostics import Look
from ..planar.model import Model
from ..planar.neighbours import NeighbourSearch
from ..planar.observables import PlanarObservables, read
from ..planar.residual import Steadiness
from ..planar.state import State
from ..planar.strip_step import stepper_of
from ..planar.thermal import wire_warmth
from ..scene import Stage
from .tension import TensionSearch

CHECK_STEPS = 50  # steps between looks at the state


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
    work: float  # [J] put in since the start, where the drive keeps account of it (ramp)
    dissipated: float  # [J] taken out since the start, by the damping of a ramp or by friction
    left_out: float  # of the tension, that the mesh may be out of balance by as a membrane; 0 where that was looked after
    edge_work: float  # [J] put in by what differs from place to place: pulls at the edge, cords, warmth
    stations: np.ndarray  # (station, 2) [m] displacement of the rim (rim.py); empty where it only follows the load
    observables: PlanarObservables


@dataclass
class LoadStart:
    """The load at the start of a stage; no gradient before it has begun."""

    gradient: list[float] = field(default_factory=list)  # (4,) [-]
    tension: list[float] = field(default_factory=list)  # (weft, warp) [N/m]
    temperature: float = 0.0  # [K]
    levels: float = 0.0  # of the way from there, gone by the smallest mesh of a large one


@dataclass
class Progress:
    """Where a run is: for whoever watches it, and for a checkpoint. Plain numbers."""

    stage_index: int = 0
    stage: str = ""
    level: int = 0  # records of this stage so far
    part: int = 0  # steady states on the way to the next
    records: int = 0
    steps: int = 0
    settling: bool = False  # inside a level
    load_factor: float = 0.0
    residual: float = 0.0
    looks: int = 0  # of the level
    least_imbalance: float = 1e30  # after any correction of the mesh as a membrane, in the level
    in_vain: int = 0  # corrections since that came down
    trust: float = 1.0  # share of the last correction that was taken; 0 where they are given up
    start: LoadStart = field(default_factory=LoadStart)  # of the stage
    best: float = 1e30  # of what is left to do, in the level
    waited: int = 0  # looks since that came down by a tenth
    imbalance: float = 1e30  # of the mesh as a membrane, over what counts as steady; large meshes only
    tensions: list[list[float]] = field(default_factory=list)  # [N/m] nominal, at the last looks of a level nearly at rest
    search: TensionSearch = field(default_factory=TensionSearch)
    time: float = 0.0  # [s] of the stage, in a ramp
    work: float = 0.0  # [J] in a ramp
    compliance: list[float] = field(default_factory=list)  # [m/N] strain by tension, of a ramp driven by tension
    strain_move: list[float] = field(default_factory=list)  # at its last look
    followed: list[float] = field(default_factory=list)  # strains and tensions [N/m] at its last look
    stress: list[float] = field(default_factory=list)  # [N/m] nominal stress at the last look, in a ramp

    def as_dict(self) -> dict:
        return asdict(self)

    @classmethod
    def from_dict(cls, values: dict) -> Progress:
        return cls(**{**values, "search": TensionSearch(**values["search"]), "start": LoadStart(**values["start"])})


@dataclass(frozen=True)
class LoadPoint:
    """A deformation gradient and what goes with it."""

    gradient: np.ndarray  # (2, 2)
    temperature: float  # [K] in the middle
    temperature_gradient: tuple[float, float] = (0.0, 0.0)  # [K/m]
    stations: np.ndarray | None = None  # (station, 2) [m] displacement of the rim (rim.py) from the affinely mapped outline

    def strained(self, gradient: np.ndarray) -> LoadPoint:
        """The same at another deformation gradient."""
        return replace(self, gradient=gradient)


class Drive(ABC):
    """Steps a model through one stage after the other."""

    def __init__(self, model: Model, state: State, progress: Progress, watch: Callable[[Progress], None]) -> None:
        self.model = model
        self.state = state
        self.scene = model.scene
        self.progress = progress
        self.watch = watch
        self.stepper = stepper_of(model, state)
        self.neighbours = NeighbourSearch(model, state)
        self.look = Look(model, state, self.stepper)
        self.steadiness = Steadiness(model)
        self._is_warm = any(any(stage.temperature_gradient) for stage in self.scene.stages)
        self.left_out = 0.0  # stress over the tension, the most that corrections as a membrane were given up with
        self.rim: Rim | None = None  # where the edge does more than follow the load
        self.stations = np.zeros((0, 2))  # (station, 2) [m] displacement of its stations from the affinely mapped outline
        self.edge_work = EdgeWork() if self._is_warm else None

    @property
    def dissipated(self) -> float:
        """[J] taken out since the start."""
        return float(self.state.read_control()[int(c.DISSIPATED)])

    @abstractmethod
    def stage(self, stage: Stage) -> Iterator[Record]:
        """Records of one stage, from where `progress` stands."""

    def warm_up(self) -> None:
        """Have every kernel that the run will use compiled or loaded; everything stays as it is."""
        kept = self.everything()
        self._launch_all()
        self.put_back(kept)

    @abstractmethod
    def _launch_all(self) -> None:
        """Launch every kernel that the run will use."""

    def everything(self) -> dict[str, np.ndarray]:
        """Host copies of the state, of what the loop carries from look to look, and of the progress."""
        state = {f"state_{name}": value for name, value in self.state.arrays().items()}
        return self.memory() | state | {"progress": np.array(json.dumps(self.progress.as_dict()))}

    def put_back(self, kept: dict[str, np.ndarray]) -> None:
        """Put back what `everything` returned."""
        self.state.restore({name[6:]: value for name, value in kept.items() if name.startswith("state_")})
        self.progress.__dict__.update(Progress.from_dict(json.loads(str(kept["progress"]))).__dict__)
        self.recall(kept)

    def memory(self) -> dict[str, np.ndarray]:
        """Arrays that the loop carries from look to look."""
        return self.neighbours.memory() | (self.edge_work.memory() if self.edge_work is not None else {})

    def recall(self, kept: dict[str, np.ndarray]) -> None:
        """Put back what `memory` returned."""
        self.neighbours.recall(kept)
        if self.edge_work is not None:
            self.edge_work.recall(kept)

    # --- loads ---

    def load_now(self) -> LoadStart:
        index = self.progress.stage_index
        before = self.scene.stages[index - 1].temperature if index else self.scene.wire.reference_temperature
        gradient, stress = self.state.gradient, self.look.take().stress
        turned = measure.rotation(measure.clamp_rotation(gradient))
        tension = measure.true_stress(turned @ stress, turned @ gradient)
        return LoadStart(gradient.ravel().tolist(), np.diag(tension).tolist(), before)

    def target(self, stage: Stage, factor: float) -> LoadPoint:
        """Load of a stage at a load factor; a direction driven by tension keeps the strain it has."""
        start = self.progress.start
        began, now = np.array(start.gradient).reshape(2, 2), self.state.gradient
        turn, first, now = measure.clamp_rotation(began), measure.stretch(began), measure.stretch(now)
        target = first.copy()
        wire, frame = self.scene.wire, self.scene.model.frame_expansion
        warmed = 1.0 + frame * (stage.temperature - wire.reference_temperature)
        for axis, strain in enumerate((stage.strain_weft, stage.strain_warp)):
            end = (1.0 + strain) * warmed if strain is not None else None
            target[axis, axis] = now[axis, axis] if end is None else (1 - factor) * first[axis, axis] + factor * end
        target[0, 1] = (1 - factor) * first[0, 1] + factor * stage.shear * warmed
        turn += factor * (stage.clamp_rotation - turn)
        target = measure.rotation(-turn) @ target
        before = start.temperature
        warmer = np.array(self._stage_before.temperature_gradient if self._stage_before else (0.0, 0.0))
        warmer = (1 - factor) * warmer + factor * np.array(stage.temperature_gradient)
        stations = None
        if self.rim is not None:
            pulled = self.rim.pulled(self._stage_before.pull if self._stage_before else ())
            stations = (1 - factor) * pulled + factor * self.rim.pulled(stage.pull)
        return LoadPoint(target, before + factor * (stage.temperature - before), tuple(warmer.tolist()), stations)

    @property
    def _stage_before(self) -> Stage | None:
        index = self.progress.stage_index
        return self.scene.stages[index - 1] if index else None

    def record(self, stage: Stage, factor: float, steady: bool, work: float = 0.0) -> Record:
        progress = self.progress
        before = progress.start.temperature
        reading = read(self.model, self.state)
        record = Record(
            index=progress.records,
            stage=stage.name,
            stage_index=progress.stage_index,
            load_factor=factor,
            temperature=before + factor * (stage.temperature - before),
            steps=progress.steps,
            steady=steady,
            work=work,
            dissipated=self.dissipated,
            left_out=self.left_out,
            edge_work=self._account_edge(reading),
            stations=self.stations,
            observables=reading,
        )
        progress.records += 1
        progress.level += 1
        return record

    def _account_edge(self, reading: PlanarObservables) -> float:
        """[J] put in so far by what differs from place to place."""
        if self.edge_work is None:
            return 0.0
        clamps = reading.edge_force, reading.clamp_shift
        return self.edge_work.account(clamps, (reading.thermal_strain_force, reading.thermal_strain))

    def _set_ramp(self, target: LoadPoint, steps: int) -> None:
        """Aim at a load; with no steps it is there at once."""
        wire = self.scene.wire
        control = self.state.read_control()
        now = control[int(c.GRADIENT) : int(c.GRADIENT) + 5].tolist()
        factor = wire.length_factor(target.temperature)
        then = [*target.gradient.ravel().tolist(), factor]
        values: dict[int, float] = {int(c.RAMP_STEP): 0.0, int(c.RAMP_STEPS): float(steps)}
        for k in range(5):
            values[int(c.FROM) + k] = now[k]
            values[int(c.TO) + k] = then[k]
            if steps == 0:
                values[int(c.GRADIENT) + k] = then[k]
        values[int(c.RAMP_SHARE)] = 0.0 if steps else 1.0
        self.state.write_control(values)
        if self._is_warm:
            self.state.wire_warmth.assign(wire_warmth(self.model, target.temperature, target.temperature_gradient))
        # the affine motion itself brings a body and a wire within the search radius closer by at most this
        self.neighbours.expect(2.0 * float(np.abs(np.subtract(then[:4], now[:4])).max()) * self.neighbours.radius)

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
                raise self.divergence()
            if status == 1.0:
                self.neighbours.search()

    def _fastest(self) -> str:
        """Name the wire and node that move fastest."""
        panel, strip = self.model.panel, self.model.strip
        speed = np.hypot(self.state.node_vx.numpy().astype(float), self.state.node_vy.numpy().astype(float))
        speed = np.nan_to_num(speed, nan=np.inf)
        node = int(np.argmax(speed))
        wire = int(np.searchsorted(panel.wire_first, node, side="right") - 1)
        here = wire + (strip.wires.start if strip is not None else 0), node - int(panel.wire_first[wire])
        _, (wire, node) = max(self.model.ranks.everyone((float(speed[node]), here)))
        return f"wire {wire}, node {node}"

    def _mesh_tension(self, reading: PlanarObservables) -> np.ndarray:
        """Tensions (weft, warp) [N/m] of the mesh that the first rank has read."""
        return self.model.ranks.from_first(lambda: np.array(measure.mesh_tension(reading)))

    def divergence(self) -> Diverged:
        control = self.state.read_control()
        strain = [control[int(c.GRADIENT)] - 1, control[int(c.GRADIENT) + 3] - 1]
        return Diverged(
            f"diverged at step {self.progress.steps}: {self._fastest()}, stage {self.progress.stage!r}, weft strain"
            f" {strain[0]:.3g}, warp strain {strain[1]:.3g}; likely the load comes on too fast for the stiffness there:"
            f" raise output.frames (relax) or solver.loading_time (ramp)"
        )
