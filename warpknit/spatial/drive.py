"""What relaxations and ramps in space share: a mesh with its contact, the load of a stage, and records of states."""

from __future__ import annotations

import json
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from .. import measure
from ..errors import Diverged, ModelError
from ..kernels import control as c
from ..measure import strain
from ..measure.edge_work import EdgeWork
from ..scene import Stage
from ..solve.drive import LoadStart, Progress
from .clamps import MovingClamps
from .contact import STICK_SHARE, WireContact
from .edge import Edge
from .mesh import SpatialMesh
from .observables import SpatialObservables, read
from .rest import Rest
from .rod_arrays import RodState
from .rod_step import RodStepper
from .sites import Sites
from .steadiness import Steadiness
from .warmth import segment_warmth

SLOWEST_WAVE = 3.0  # loops of wire: bending waves longer than this are left overdamped
DEEPEST = 0.5  # of the thickness: an overlap from which wires may pass through each other
CLOSEST = 1e-3  # of the thickness: a smaller overlap as knitted is none, and a smaller distance of centre lines


@dataclass(frozen=True)
class SpatialRecord:
    """A state worth keeping."""

    index: int
    stage: str
    load_factor: float
    temperature: float  # [K]
    steps: int
    steady: bool
    work: float  # [J] put in since the start, where the drive keeps account of it (ramp)
    dissipated: float  # [J] taken out since the start
    edge_work: float  # [J] put in by what differs from place to place: uneven warmth, pulls and cords at the edge
    left_out: float  # of the tension, that the mesh may be out of balance by as a membrane: nothing in space
    observables: SpatialObservables
    stations: np.ndarray  # (station, 2) [m] by which the edge is moved beside the load; none where it is not


class SpatialDrive(ABC):
    """What runs the stages of a scene from where `progress` stands. `watch` is called at every look and may raise to stop the
    run."""

    slower: str  # the key that has the load come on more slowly
    multipliers = True  # whether running multipliers take out the softening

    def __init__(
        self,
        mesh: SpatialMesh,
        watch: Callable[[Progress], None] = lambda _: None,
        *,
        progress: Progress | None = None,
    ) -> None:
        self.mesh, self.scene, self.watch = mesh, mesh.scene, watch
        self.resumed = progress is not None
        self.progress = progress or Progress()
        self.sites = Sites(mesh.wires, mesh.rods)
        self.stepper = RodStepper(mesh.rods, mesh.device)
        self.contact = WireContact(self.stepper, mesh.contact_stiffness, friction=self.scene.contact.friction, curve=mesh.curve)
        self.clamps = self._moving_clamps()
        self.rest = self._rest()
        mass = float(self.stepper.state.node_mass.numpy().max())
        wave = 2.0 * math.pi / (SLOWEST_WAVE * mesh.loop_length)
        self.rest.slowest = 2.0 * math.sqrt(mesh.bending_stiffness * wave**4 * self.rest.spacing / mass)
        self.steadiness = Steadiness(mesh, self.rest, self.contact)
        self.edge_work = EdgeWork()
        self.edge = Edge(mesh) if self.scene.has_moving_edge else None
        self.notes: list[str] = []  # what the user should know

    @property
    def model(self) -> SpatialMesh:
        """What runs, by the name that a planar simulation has for it."""
        return self.mesh

    @property
    def state(self) -> RodState:
        return self.stepper.state

    def _rest(self) -> Rest:
        mesh = self.mesh
        return Rest(
            self.stepper,
            softening=mesh.softening,
            contact_stiffness=mesh.contact_stiffness,
            stick_stiffness=STICK_SHARE * mesh.contact_stiffness if self.scene.contact.friction > 0.0 else 0.0,
            curve=mesh.curve,
            clamps=self.clamps,
            multipliers=self.multipliers,
        )

    def _moving_clamps(self) -> MovingClamps | None:
        """Clamps that have to be moved step by step: those of a hook, some of which slide."""
        return None if self.mesh.wires.sliding_clamp is None else self._clamps_that_move(self.mesh.wires.sliding_clamp)

    def _clamps_that_move(self, sliding: np.ndarray) -> MovingClamps:
        wires = self.mesh.wires
        return MovingClamps(self.stepper, wires.held_node.reshape(-1, 2), wires.held_lever.reshape(-1, 2, 2), sliding)

    def warm_up(self) -> None:
        """Have the kernels compiled, and find what is near what. Raises `ModelError` where wires pass through each other."""
        self.contact.search()
        self.stepper.step(0)
        self.stepper.evaluate()
        self._refuse_wires_in_one_place()

    def _refuse_wires_in_one_place(self) -> None:
        """Centre lines that meet do not say which wire is to lie over the other."""
        near, rods = self.contact.near(0.0), self.mesh.rods
        touch = rods.wire_radius[rods.wire_of[near.first]] + rods.wire_radius[rods.wire_of[near.second]]
        if not len(touch) or (apart := 1.0 - near.overlap / touch).min() >= CLOSEST:
            return
        worst = int(apart.argmin())
        first, second = (int(rods.wire_of[nodes[worst]]) for nodes in (near.first, near.second))
        x, y, _ = rods.position[near.first[worst]]
        raise ModelError(
            f"wires {first + 1} and {second + 1} pass through each other near x = {x:.4g} m, y = {y:.4g} m: their centre lines"
            " meet, so that neither lies over the other; allowed: some distance, however small against the thickness"
        )

    def memory(self) -> dict[str, np.ndarray]:
        """What a checkpoint needs beside the state and the progress."""
        kept = {"notes": np.array(json.dumps(self.notes))} | self.contact.memory() | self.rest.memory() | self.edge_work.memory()
        kept |= self.stepper.yielding.memory()
        if self.edge is not None:
            kept |= self.edge.memory()
        return kept

    def recall(self, kept: dict[str, np.ndarray]) -> None:
        """Put back what `memory` returned; the state has been put back before."""
        self.notes = json.loads(str(kept["notes"]))
        self.contact.recall(kept)
        self.rest.recall(kept)
        self.edge_work.recall(kept)
        self.stepper.yielding.recall(kept)
        if self.edge is not None:
            self.edge.recall(kept)

    # --- stages and loads

    def run(self) -> Iterator[SpatialRecord]:
        """Records of all stages: the mesh as knitted, then `output.frames` steady levels a stage.

        Raises:
            Diverged: a level cannot be brought to rest, or wires pass through each other.
        """
        progress = self.progress
        if not self.resumed:
            self.contact.search()
        while progress.stage_index < len(self.scene.stages):
            stage = self.scene.stages[progress.stage_index]
            progress.stage = stage.name
            if not progress.start.gradient:
                progress.start = self._load_now()
            yield from self._stage(stage)
            progress.stage_index += 1
            progress.level, progress.start, progress.time = 0, LoadStart(), 0.0

    @abstractmethod
    def _stage(self, stage: Stage) -> Iterator[SpatialRecord]:
        """Records of one stage from where `progress` stands."""

    def _load_now(self) -> LoadStart:
        index = self.progress.stage_index
        before = self.scene.stages[index - 1].temperature if index else self.scene.wire.reference_temperature
        self.stepper.evaluate()
        tension = measure.mesh_tension(self._reading())
        return LoadStart(self.state.gradient.ravel().tolist(), list(tension), before)

    def _gradient(self, stage: Stage, factor: float) -> np.ndarray:
        """(2, 2) of a stage at a load factor; a direction driven by tension keeps the strain it has."""
        wire, frame = self.scene.wire, self.scene.model.frame_expansion
        warmed = 1.0 + frame * (stage.temperature - wire.reference_temperature)
        began = np.array(self.progress.start.gradient).reshape(2, 2)
        turn, start = strain.clamp_rotation(began), strain.stretch(began)
        weft, warp = stage.strain_weft or 0.0, stage.strain_warp or 0.0
        end = warmed * np.array([[1.0 + weft, stage.shear], [0.0, 1.0 + warp]])
        target = start + factor * (end - start)
        driven = np.array(stage.by_tension)
        target[np.diag_indices(2)] = np.where(driven, np.diag(strain.stretch(self.state.gradient)), np.diag(target))
        return strain.rotation(-turn - factor * (stage.clamp_rotation - turn)) @ target

    def _temperature(self, stage: Stage, factor: float) -> float:
        """[K] at a load factor."""
        before = self.progress.start.temperature
        return before + factor * (stage.temperature - before)

    def _warmth(self, stage: Stage) -> np.ndarray:
        """[node] of the segments at the load factor (Rest.warm)."""
        index, factor = self.progress.stage_index, self.progress.load_factor
        before = np.array(self.scene.stages[index - 1].temperature_gradient if index else (0.0, 0.0))
        slope = before + factor * (np.array(stage.temperature_gradient) - before)
        return segment_warmth(self.mesh, self._temperature(stage, factor), slope)

    def _bring_on(self, gradient: np.ndarray, length_factor: float, steps: int) -> None:
        """Have gradient and length factor move to these over so many steps."""
        now = self.state.read_control()[int(c.GRADIENT) : int(c.GRADIENT) + 5].tolist()
        then = [*gradient.ravel().tolist(), length_factor]
        ramp = {int(c.FROM) + k: now[k] for k in range(5)} | {int(c.TO) + k: then[k] for k in range(5)}
        self.state.write_control(ramp | {int(c.RAMP_STEP): 0.0, int(c.RAMP_STEPS): float(steps)})
        self.contact.wake()

    # --- states

    def _reading(self) -> SpatialObservables:
        return read(self.mesh, self.sites, self.rest, self.contact)

    def _record(self, stage: Stage, factor: float, *, steady: bool = True) -> SpatialRecord:
        progress = self.progress
        progress.load_factor = factor
        reading, edge = self._reading(), self.edge
        pushed = [(reading.thermal_strain_force, reading.thermal_strain)]
        if edge is not None:
            pushed.append((edge.grip_forces(reading.force), edge.clamp_displacement))
        record = SpatialRecord(
            index=progress.records,
            stage=stage.name,
            load_factor=factor,
            temperature=self._temperature(stage, factor),
            steps=progress.steps,
            steady=steady,
            work=progress.work,
            dissipated=self._dissipated(),
            edge_work=self.edge_work.account(*pushed),
            left_out=0.0,
            observables=reading,
            stations=edge.moved.copy() if edge is not None else np.zeros((0, 2)),
        )
        progress.records += 1
        progress.level += 1
        return record

    def _dissipated(self) -> float:
        """[J] taken out since the start, by yield."""
        return self.stepper.yielding.dissipated

    def _refuse_divergence(self, may_overlap: bool) -> None:
        deepest = self.contact.take_deepest() / (2.0 * float(self.mesh.rods.wire_radius.min()))
        control = self.state.read_control()
        strain = f"weft strain {control[int(c.GRADIENT)] - 1:.3g}, warp strain {control[int(c.GRADIENT) + 3] - 1:.3g}"
        where = f"stage {self.progress.stage!r}, {strain}"
        if control[int(c.STATUS)] == 2.0:
            speed = np.nan_to_num(np.linalg.norm(self.state.velocity.numpy(), axis=1), nan=np.inf)
            node = int(np.argmax(speed))
            wire = int(self.mesh.rods.wire_of[node])
            raise Diverged(
                f"diverged at step {self.progress.steps}: wire {wire}, node {node - int(self.mesh.rods.wire_first[wire])},"
                f" {where}; likely the load comes on too fast for the stiffness there: raise {self.slower}"
            )
        if deepest > DEEPEST and not may_overlap:
            raise Diverged(
                f"wires overlap by {deepest:.2g} of their thickness at step {self.progress.steps}, {where}: the contact"
                f" penalty does not hold them apart; raise {self.slower} or contact.stiffness"
            )
