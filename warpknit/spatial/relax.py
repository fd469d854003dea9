"""Load levels of a mesh in space, each brought to rest.

The load of a level comes on within some hundred steps, the whole mesh being carried affinely with its boundary, and is moved
on by what the last level moved beside that. It is steady when what is out of balance, motion, the drift of the tension, and what
the softening of the wires still does are all below the scene's tolerance, as in a planar relaxation. A direction that is driven
by tension is found as there, one steady state after the other.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from .. import measure
from ..errors import Diverged, ModelError
from ..kernels import control as c
from ..measure.edge_work import EdgeWork
from ..scene import Stage
from ..solve.drive import LoadStart, Progress
from ..solve.tension import MOST_STATES
from .clamps import MovingClamps
from .contact import WireContact
from .edge import Edge
from .mesh import SpatialMesh
from .reading import SpatialReading, read
from .rest import CHECK_STEPS, Rest
from .rod_arrays import RodState
from .rod_step import RodStepper
from .sites import Sites
from .steadiness import AXIAL_ERROR, Steadiness, tension_scale
from .warmth import segment_warmth

MASS_LOOKS = 20  # looks between renewals of the fictitious masses
LEVEL_STEPS = 500_000  # of a level after which it counts as never steady, where the scene gives no max_steps
SLOWEST_WAVE = 3.0  # loops of wire: bending waves longer than this are left overdamped
DEEPEST = 0.5  # of the thickness: an overlap from which wires may pass through each other
CLOSEST = 1e-3  # of the thickness: a smaller overlap as knitted is none, and a smaller distance of centre lines
RAMP_STEPS = 500  # steps over which the load of a level comes on
PATH_STRAIN = 0.005  # between steady states where friction or yield makes the state depend on the path, at most
EDGE_LOOKS = 4  # looks between corrections of what hangs on cords
EDGE_LEFT = 20.0  # of what counts as steady, below which they begin
FARTHEST = 0.2  # of the thickness: by how much the state is moved ahead


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
    reading: SpatialReading
    stations: np.ndarray  # (station, 2) [m] by which the edge is moved beside the load; none where it is not


class SpatialRelaxation:
    """Runs the stages of a scene from where `progress` stands. `watch` is called at every look and may raise to stop the run."""

    slower = "output.frames"  # the key that has the load come on more slowly

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
        self._before: tuple[np.ndarray, np.ndarray] | None = None  # gradient and displacement of the level before

    @property
    def model(self) -> SpatialMesh:
        """What runs, by the name that a planar simulation has for it."""
        return self.mesh

    @property
    def state(self) -> RodState:
        return self.stepper.state

    def _rest(self, *, multipliers: bool = True) -> Rest:
        mesh = self.mesh
        return Rest(
            self.stepper,
            softening=mesh.softening,
            contact_stiffness=mesh.contact_stiffness,
            curve=mesh.curve,
            clamps=self.clamps,
            multipliers=multipliers,
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
        if self._before is not None:
            kept |= {"gradient_before": self._before[0], "displacement_before": self._before[1]}
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
        if "gradient_before" in kept:
            self._before = kept["gradient_before"].copy(), kept["displacement_before"].copy()

    # --- stages and levels

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

    def _stage(self, stage: Stage) -> Iterator[SpatialRecord]:
        progress, levels = self.progress, self.scene.output.frames
        if progress.stage_index == 0 and progress.level == 0:
            self._rest_as_knitted()
            yield self._record(stage, 0.0)
        unloaded = progress.stage_index == 0
        while progress.level < levels + unloaded:
            level = progress.level + (not unloaded)
            begin, end = (level - 1) / levels, level / levels
            pulled = self._pulled_strain(begin, end)
            parts = self._parts(self._gradient(stage, begin), self._gradient(stage, end), pulled)
            while progress.part < parts:
                progress.load_factor = (level - 1 + (progress.part + 1) / parts) / levels
                self._bring_to_rest(stage)
                self.stepper.yielding.advance()
                progress.part += 1
            progress.part = 0
            yield self._record(stage, progress.load_factor)

    def _load_now(self) -> LoadStart:
        index = self.progress.stage_index
        before = self.scene.stages[index - 1].temperature if index else self.scene.wire.reference_temperature
        self.stepper.evaluate()
        tension = self._reading().mesh_tension
        return LoadStart(self.state.gradient.ravel().tolist(), list(tension), before)

    def _gradient(self, stage: Stage, factor: float) -> np.ndarray:
        """(2, 2) of a stage at a load factor; a direction driven by tension keeps the strain it has."""
        wire, frame = self.scene.wire, self.scene.model.frame_expansion
        warmed = 1.0 + frame * (stage.temperature - wire.reference_temperature)
        began = np.array(self.progress.start.gradient).reshape(2, 2)
        turn, start = measure.clamp_rotation(began), measure.stretch(began)
        weft, warp = stage.strain_weft or 0.0, stage.strain_warp or 0.0
        end = warmed * np.array([[1.0 + weft, stage.shear], [0.0, 1.0 + warp]])
        target = start + factor * (end - start)
        driven = np.array(stage.by_tension)
        target[np.diag_indices(2)] = np.where(driven, np.diag(measure.stretch(self.state.gradient)), np.diag(target))
        return measure.rotation(-turn - factor * (stage.clamp_rotation - turn)) @ target

    def _temperature(self, stage: Stage) -> float:
        """[K] at the load factor."""
        before = self.progress.start.temperature
        return before + self.progress.load_factor * (stage.temperature - before)

    def _warmth(self, stage: Stage) -> np.ndarray:
        """[node] of the segments at the load factor (Rest.warm)."""
        index, factor = self.progress.stage_index, self.progress.load_factor
        before = np.array(self.scene.stages[index - 1].temperature_gradient if index else (0.0, 0.0))
        slope = before + factor * (np.array(stage.temperature_gradient) - before)
        return segment_warmth(self.mesh, self._temperature(stage), slope)

    def _parts(self, begin: np.ndarray, end: np.ndarray, pulled: float) -> int:
        """Steady states on the way from one level to the next, on which pulls strain the edge by so much."""
        if not self.scene.depends_on_path:
            return 1
        return max(1, math.ceil(max(float(np.abs(end - begin).max()), pulled) / PATH_STRAIN - 1e-9))

    def _rest_as_knitted(self) -> None:
        """Bring the unloaded mesh to rest where wires overlap as knitted, or are not free of stress."""
        wire, progress = self.scene.wire, self.progress
        if not progress.settling:
            self.stepper.evaluate()
            overlaps = self.contact.near().overlap / self.mesh.rods.section.thickness
            deep = overlaps[overlaps > CLOSEST]
            if len(deep):
                self.notes.append(
                    f"as knitted wires overlap in {len(deep)} places, by {deep.max():.2g} of their thickness at most: they were"
                    " pushed apart before the load came on"
                )
            is_free = wire.set_fraction == 1.0 and self.rest.stretch_error() <= AXIAL_ERROR
            if not len(deep) and is_free and self.steadiness.left() < 1.0:
                return
            self._begin_settling()
        self._settle(may_overlap=True)
        self.stepper.yielding.advance()
        progress.settling = False

    def _bring_to_rest(self, stage: Stage) -> None:
        """Go to the load of `progress`, or on with one that was begun, to the strains that carry the tensions wanted."""
        if not self.progress.settling:
            self._begin_level(stage, self._gradient(stage, self.progress.load_factor))
        self._settle()
        if np.array(stage.by_tension).any():
            self._find_tension(stage)
        self.progress.settling = False

    def _begin_level(self, stage: Stage, gradient: np.ndarray) -> None:
        """Put a load on, and move the mesh to where the last two levels point."""
        before = self.state.gradient
        displacement = self.state.displacement.numpy().copy()
        kept = displacement.copy()
        if self._before is not None and not self.scene.depends_on_path:
            was, placed = self._before
            step, last = gradient - before, before - was
            size = float(np.sum(last * last))
            ratio = float(np.sum(step * last)) / size if size > 0.0 else 0.0
            move = max(0.0, ratio) * (displacement - placed)
            furthest = float(np.linalg.norm(move, axis=1).max(initial=0.0))
            most = FARTHEST * self.mesh.rods.section.thickness
            displacement = displacement + move * min(1.0, most / max(furthest, 1e-300))
        self._before = (before, kept)
        self.progress.search.begin_level()
        self._set_load(stage, gradient, displacement)

    def _set_load(self, stage: Stage, gradient: np.ndarray, displacement: np.ndarray) -> None:
        """Have a load come on, from displacements (node, 3) [m]."""
        wire = self.scene.wire
        factor = 1.0 + wire.expansion * (self._temperature(stage) - wire.reference_temperature)
        self.rest.warm(self._warmth(stage))
        before = self.state.gradient
        self._bring_on(gradient, factor, RAMP_STEPS)
        if self.clamps is None:
            held = self.mesh.wires.held_node
            displacement[held, :2] = self.mesh.held_shift(gradient, factor)
            if self.edge is not None:
                self.edge.set_off(self._pulls(self.progress.load_factor))
                displacement[held, :2] += self.edge.displacement(self.edge.moved)[held]
        self.state.displacement.assign(displacement)
        self.rest.begin()
        self.contact.expect(float(np.abs(gradient - before).max()))
        self._begin_settling()

    def _bring_on(self, gradient: np.ndarray, length_factor: float, steps: int) -> None:
        """Have gradient and length factor move to these over so many steps."""
        now = self.state.read_control()[int(c.GRADIENT) : int(c.GRADIENT) + 5].tolist()
        then = [*gradient.ravel().tolist(), length_factor]
        ramp = {int(c.FROM) + k: now[k] for k in range(5)} | {int(c.TO) + k: then[k] for k in range(5)}
        self.state.write_control(ramp | {int(c.RAMP_STEP): 0.0, int(c.RAMP_STEPS): float(steps)})
        self.contact.wake()

    def _pulls(self, factor: float) -> np.ndarray:
        """(station, 2) [m] by which stations of the edge are pulled at a load factor of the stage."""
        assert self.edge is not None
        index = self.progress.stage_index
        before = self.scene.stages[index - 1].pull if index else ()
        pulled = self.edge.rim.pulled
        return (1.0 - factor) * pulled(before) + factor * pulled(self.scene.stages[index].pull)

    def _pulled_strain(self, begin: float, end: float) -> float:
        """By which pulls strain the edge between its stations from one load factor of the stage to another."""
        return self.edge.strain(self._pulls(end) - self._pulls(begin)) if self.edge is not None else 0.0

    def _move_edge(self, edge: Edge, left: float) -> None:
        """Pull the edge on while the load comes on; what hangs on cords follows once the mesh itself is nearly at rest."""
        looks = self.progress.looks
        coming = looks * CHECK_STEPS <= RAMP_STEPS
        if coming:
            carried = edge.pull(looks * CHECK_STEPS / RAMP_STEPS)
        elif edge.rim.is_free and looks % EDGE_LOOKS == 0 and left < EDGE_LEFT:
            carried = edge.follow(self.state.gradient, self.state.force.numpy())
        else:
            return
        if np.any(carried):
            displacement = self.state.displacement.numpy().copy()
            displacement[:, :2] += carried
            self.state.displacement.assign(displacement)
            self.contact.search()
            self.rest.carried()

    def _find_tension(self, stage: Stage) -> None:
        """Try strains until the steady state carries the tensions wanted."""
        progress, driven, scale = self.progress, np.array(stage.by_tension), tension_scale(self.mesh)
        start = np.array(progress.start.tension)
        wanted = start + progress.load_factor * (np.array([stage.tension_weft or 0.0, stage.tension_warp or 0.0]) - start)
        while True:
            reading = self._reading()
            tension = np.array(reading.mesh_tension)
            following = progress.search.next_strain(np.diag(reading.stretch) - 1.0, tension, wanted, driven, scale)
            if following is None:
                return
            if progress.search.states > MOST_STATES:
                raise Diverged(
                    f"stage {stage.name!r}, load {progress.load_factor:.3g}: no strain found at which the mesh carries"
                    f" {wanted[0]:.3g} N/m in weft and {wanted[1]:.3g} N/m in warp (now {tension[0]:.3g} and"
                    f" {tension[1]:.3g} N/m): give smaller tensions, more output.frames, a smaller solver.residual_tolerance,"
                    " or strains"
                )
            stretch = reading.stretch
            stretch[np.diag_indices(2)] = np.where(driven, 1.0 + following, np.diag(stretch))
            gradient = measure.rotation(-reading.clamp_rotation) @ stretch
            self._set_load(stage, gradient, self.state.displacement.numpy().copy())
            self._settle()

    # --- to rest

    def _begin_settling(self) -> None:
        self.progress.settling, self.progress.looks = True, 0
        self.progress.tensions.clear()
        self.contact.take_deepest()

    def _settle(self, *, may_overlap: bool = False) -> None:
        """Step until the level is steady."""
        progress, most = self.progress, self.scene.solver.max_steps or LEVEL_STEPS
        while progress.looks < most // CHECK_STEPS:
            progress.steps += self.contact.advance(CHECK_STEPS)
            progress.looks += 1
            self.rest.look()
            self._refuse_divergence(may_overlap)
            if progress.looks % MASS_LOOKS == 0:
                self.rest.take_masses()
            if progress.looks * CHECK_STEPS == RAMP_STEPS:
                self.contact.expect(0.0)
            left = self.steadiness.left()
            if self.edge is not None:
                self._move_edge(self.edge, left)
                left = max(left, self.edge.still_to_do(self.scene.solver.residual_tolerance))
            progress.residual = left * self.scene.solver.residual_tolerance
            if left >= 1.0 or progress.looks * CHECK_STEPS <= RAMP_STEPS:
                progress.tensions.clear()
            else:
                progress.tensions.append(np.diag(self._reading().boundary_stress).tolist())
                if self.steadiness.still_to_come(progress.tensions) < 1.0:
                    return
            self.watch(progress)
        raise Diverged(
            f"level {progress.load_factor:.3g} of stage {progress.stage!r} is not steady after {most:,} steps (residual"
            f" {progress.residual:.2g} at a tolerance of {self.scene.solver.residual_tolerance:g}): raise solver.max_steps or"
            " solver.residual_tolerance"
        )

    def _reading(self) -> SpatialReading:
        return read(self.mesh, self.sites, self.rest, self.contact)

    def _record(self, stage: Stage, factor: float, *, steady: bool = True) -> SpatialRecord:
        progress = self.progress
        progress.load_factor = factor
        reading, edge = self._reading(), self.edge
        pushed = [(reading.warmth_force, reading.warmth)]
        if edge is not None:
            pushed.append((edge.grip_forces(reading.force), edge.clamp_displacement))
        record = SpatialRecord(
            index=progress.records,
            stage=stage.name,
            load_factor=factor,
            temperature=self._temperature(stage),
            steps=progress.steps,
            steady=steady,
            work=progress.work,
            dissipated=self._dissipated(),
            edge_work=self.edge_work.account(*pushed),
            reading=reading,
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
