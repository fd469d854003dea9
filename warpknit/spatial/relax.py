"""Load levels of a mesh in space, each brought to rest.

The load of a level comes on within some hundred steps, the whole mesh being carried affinely with its boundary, and is moved
on by what the last level moved beside that. It is steady when what is out of balance, motion, the drift of the tension, and what
the softening of the wires still does are all below the scene's tolerance, as in a planar relaxation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from ..errors import Diverged
from ..kernels import control as c
from ..scene import Stage
from .clamps import MovingClamps
from .contact import WireContact
from .mesh import SpatialMesh
from .reading import SpatialReading, read
from .rest import CHECK_STEPS, Rest
from .rod_step import RodStepper
from .sites import Sites

FORCE_FLOOR = 0.05  # of EI/W^2: what the residual is compared with where contacts carry less
LOCAL_ALLOWANCE = 10.0  # times the tolerance that the largest residual may be
ENERGY_FLOOR = 1e-5  # of EI/W a loop
TENSION_FLOOR = 1e-3  # of EI/C^3
DRIFT_LOOKS = 8  # looks over which the tension must stand still, twice
SLOWEST_FALL = 0.98  # of the change of the tension from one such time to the next, that is reckoned with at most
AXIAL_ERROR = 2e-5  # strain that the softening may still hide
MASS_LOOKS = 20  # looks between renewals of the fictitious masses
LEVEL_STEPS = 500_000  # of a level after which it counts as never steady, where the scene gives no max_steps
SLOWEST_WAVE = 3.0  # loops of wire: bending waves longer than this are left overdamped
DEEPEST = 0.5  # of the thickness: an overlap from which wires may pass through each other
CLOSEST = 1e-3  # of the thickness: a smaller overlap as knitted is none
RAMP_STEPS = 500  # steps over which the load of a level comes on
PATH_STRAIN = 0.005  # between steady states where friction makes the state depend on the path, at most


@dataclass(frozen=True)
class SpatialRecord:
    """A state worth keeping."""

    index: int
    stage: str
    load_factor: float
    temperature: float  # [K]
    steps: int
    reading: SpatialReading


class SpatialRelaxation:
    """Runs the stages of a scene. `watch` is called after every look and may raise to stop the run."""

    def __init__(self, mesh: SpatialMesh, watch: Callable[[SpatialRelaxation], None] = lambda _: None) -> None:
        self.mesh, self.scene, self.watch = mesh, mesh.scene, watch
        self.sites = Sites(mesh.wires, mesh.rods)
        self.stepper = RodStepper(mesh.rods, mesh.device)
        self.contact = WireContact(self.stepper, mesh.contact_stiffness, friction=self.scene.contact.friction, curve=mesh.curve)
        self.clamps = self._moving_clamps()
        self.rest = Rest(
            self.stepper,
            softening=mesh.softening,
            contact_stiffness=mesh.contact_stiffness,
            curve=mesh.curve,
            clamps=self.clamps,
        )
        mass = float(self.stepper.state.node_mass.numpy().max())
        spacing = self.rest.spacing
        wave = 2.0 * math.pi / (SLOWEST_WAVE * mesh.loop_length)
        self.rest.slowest = 2.0 * math.sqrt(mesh.bending_stiffness * wave**4 * spacing / mass)
        self.notes: list[str] = []  # what the user should know
        self.stage, self.stage_index, self.level, self.steps, self.records = "", 0, 0, 0, 0
        self.load_factor = self.residual = 0.0
        self._before: tuple[np.ndarray, np.ndarray] | None = None  # gradient and displacement of the level before

    def _moving_clamps(self) -> MovingClamps | None:
        """Clamps that have to be moved step by step: those of a hook, some of which slide."""
        wires = self.mesh.wires
        if wires.sliding_clamp is None:
            return None
        node, lever = wires.held_node.reshape(-1, 2), wires.held_lever.reshape(-1, 2, 2)
        return MovingClamps(self.stepper, node, lever, wires.sliding_clamp)

    def warm_up(self) -> None:
        """Have the kernels compiled, and find what is near what."""
        self.contact.search()
        self.stepper.step(0)
        self.stepper.evaluate()

    def run(self) -> Iterator[SpatialRecord]:
        """Records of all stages: the mesh as knitted, then `output.frames` steady levels a stage.

        Raises:
            Diverged: a level cannot be brought to rest, or wires pass through each other.
        """
        self.contact.search()
        yield self._as_knitted()
        gradient, temperature = np.eye(2), self.scene.wire.reference_temperature
        for stage in self.scene.stages:
            self.stage, self.level = stage.name, 0
            target = self._gradient_of(stage)
            levels = self.scene.output.frames
            for level in range(1, levels + 1):
                self.level = level
                parts = self._parts(gradient, target)
                for part in range(1, parts + 1):
                    share = (level - 1 + part / parts) / levels
                    self.load_factor = share
                    now = temperature + share * (stage.temperature - temperature)
                    self.bring_to_rest(gradient + share * (target - gradient), now)
                yield self._record(now)
            gradient, temperature = target, stage.temperature
            self.stage_index += 1

    def _gradient_of(self, stage: Stage) -> np.ndarray:
        """(2, 2) at the end of a stage."""
        wire, frame = self.scene.wire, self.scene.model.frame_expansion
        warmed = 1.0 + frame * (stage.temperature - wire.reference_temperature)
        weft, warp = stage.strain_weft or 0.0, stage.strain_warp or 0.0
        return warmed * np.array([[1.0 + weft, stage.shear], [0.0, 1.0 + warp]])

    def _parts(self, begin: np.ndarray, end: np.ndarray) -> int:
        """Steady states on the way to a level."""
        if self.scene.contact.friction == 0.0:
            return 1
        strain = float(np.abs(end - begin).max()) / self.scene.output.frames
        return max(1, math.ceil(strain / PATH_STRAIN - 1e-9))

    def _as_knitted(self) -> SpatialRecord:
        """The unloaded mesh, brought to rest where wires overlap as knitted."""
        wire = self.scene.wire
        self.stage = self.scene.stages[0].name
        self.stepper.evaluate()
        overlaps = self.contact.near().overlap / self.mesh.rods.section.thickness
        deep = overlaps[overlaps > CLOSEST]
        if len(deep):
            self.notes.append(
                f"as knitted wires overlap in {len(deep)} places, by {deep.max():.2g} of their thickness at most: they were"
                " pushed apart before the load came on"
            )
        if len(deep) or wire.set_fraction != 1.0 or self.rest.stretch_error() > AXIAL_ERROR or self._left() >= 1.0:
            self._settle(may_overlap=True)
        return self._record(wire.reference_temperature)

    def _record(self, temperature: float) -> SpatialRecord:
        record = SpatialRecord(
            index=self.records,
            stage=self.stage,
            load_factor=self.load_factor,
            temperature=temperature,
            steps=self.steps,
            reading=read(self.mesh, self.sites, self.rest, self.contact),
        )
        self.records += 1
        return record

    def bring_to_rest(self, gradient: np.ndarray, temperature: float) -> None:
        """Put a load on, move the mesh to where the last two levels point, and step until it is steady."""
        state, wire = self.stepper.state, self.scene.wire
        before = state.gradient
        displacement = state.displacement.numpy().copy()
        factor = 1.0 + wire.expansion * (temperature - wire.reference_temperature)
        now = state.read_control()[int(c.GRADIENT) : int(c.GRADIENT) + 5].tolist()
        then = [*gradient.ravel().tolist(), factor]
        ramp = {int(c.FROM) + k: now[k] for k in range(5)} | {int(c.TO) + k: then[k] for k in range(5)}
        state.write_control(ramp | {int(c.RAMP_STEP): 0.0, int(c.RAMP_STEPS): float(RAMP_STEPS)})
        kept = displacement.copy()
        if self._before is not None and self.scene.contact.friction == 0.0:
            was, placed = self._before
            step, last = gradient - before, before - was
            size = float(np.sum(last * last))
            ratio = float(np.sum(step * last)) / size if size > 0.0 else 0.0
            move = max(0.0, ratio) * (displacement - placed)
            furthest = float(np.linalg.norm(move, axis=1).max(initial=0.0))
            most = 0.2 * self.mesh.rods.section.thickness
            displacement = displacement + move * min(1.0, most / max(furthest, 1e-300))
        self._before = (before, kept)
        if self.clamps is None:
            displacement[self.mesh.wires.held_node, :2] = self.mesh.held_shift(gradient)
        state.displacement.assign(displacement)
        self.rest.begin()
        self.contact.expect(float(np.abs(gradient - before).max()))
        self._settle()

    def _settle(self, *, may_overlap: bool = False) -> None:
        """Step until the level is steady."""
        most = self.scene.solver.max_steps or LEVEL_STEPS
        tensions: list[np.ndarray] = []
        self.contact.take_deepest()
        for look in range(1, most // CHECK_STEPS + 1):
            self.steps += self.contact.advance(CHECK_STEPS)
            self.rest.look()
            self._refuse_divergence(may_overlap)
            if look % MASS_LOOKS == 0:
                self.rest.take_masses()
            if look * CHECK_STEPS == RAMP_STEPS:
                self.contact.expect(0.0)
            self.residual = self._left() * self.scene.solver.residual_tolerance
            self.watch(self)
            if self._left() >= 1.0 or look * CHECK_STEPS <= RAMP_STEPS:
                tensions.clear()
                continue
            tensions.append(self._nominal())
            if len(tensions) > 2 * DRIFT_LOOKS and self._still_to_come(tensions) < 1.0:
                return
        raise Diverged(
            f"level {self.load_factor:.3g} of stage {self.stage!r} is not steady after {most:,} steps (residual"
            f" {self.residual:.2g} at a tolerance of {self.scene.solver.residual_tolerance:g}): raise solver.max_steps or"
            " solver.residual_tolerance"
        )

    def _left(self) -> float:
        """What is left to do, 1 being the most that counts as steady."""
        state, rest, tolerance = self.stepper.state, self.rest, self.scene.solver.residual_tolerance
        touching = self.contact.near().force
        scale = max(float(touching.mean()) if len(touching) else 0.0, FORCE_FLOOR * self._force_scale)
        force = np.linalg.norm(rest.out_of_balance(), axis=1)
        balance = max(float(np.sqrt(np.mean(force**2))), float(force.max()) / LOCAL_ALLOWANCE) / scale
        loops = self.mesh.rods.node_count / self.scene.model.nodes_per_loop
        least = ENERGY_FLOOR * self.mesh.bending_stiffness / self.scene.knit.wale_spacing * loops
        kinetic = 0.5 * float(state.read_control()[int(c.KINETIC_TWICE)])
        motion = math.sqrt(kinetic / max(self.stepper.energy(), least))
        return max(balance / tolerance, motion / tolerance, rest.stretch_error() / AXIAL_ERROR)

    @property
    def _force_scale(self) -> float:
        """EI/W^2 [N]."""
        return self.mesh.bending_stiffness / self.scene.knit.wale_spacing**2

    def _nominal(self) -> np.ndarray:
        """[N/m] nominal tensions."""
        return np.diag(read(self.mesh, self.sites, self.rest, self.contact).nominal_stress).copy()

    def _still_to_come(self, tensions: list[np.ndarray]) -> float:
        """How much the tensions at the last looks will still move, over what the tolerance allows.

        From what they moved over the last DRIFT_LOOKS and over as many before: the change goes on to fall by that ratio.
        """
        now, before, first = tensions[-1], tensions[-1 - DRIFT_LOOKS], tensions[-1 - 2 * DRIFT_LOOKS]
        moved, earlier = float(np.linalg.norm(now - before)), float(np.linalg.norm(before - first))
        ratio = min(moved / max(earlier, 1e-300), SLOWEST_FALL)
        floor = TENSION_FLOOR * self.mesh.bending_stiffness / self.scene.knit.course_spacing**3
        allowed = self.scene.solver.residual_tolerance * max(float(np.abs(now).max()), floor)
        return moved / (1.0 - ratio) / allowed

    def _refuse_divergence(self, may_overlap: bool) -> None:
        deepest = self.contact.take_deepest() / self.mesh.rods.section.thickness
        control = self.stepper.state.read_control()
        strain = f"weft strain {control[int(c.GRADIENT)] - 1:.3g}, warp strain {control[int(c.GRADIENT) + 3] - 1:.3g}"
        where = f"stage {self.stage!r}, {strain}"
        if control[int(c.STATUS)] == 2.0:
            speed = np.nan_to_num(np.linalg.norm(self.stepper.state.velocity.numpy(), axis=1), nan=np.inf)
            node = int(np.argmax(speed))
            wire = int(self.mesh.rods.wire_of[node])
            raise Diverged(
                f"diverged at step {self.steps}: wire {wire}, node {node - int(self.mesh.rods.wire_first[wire])}, {where};"
                " likely the load comes on too fast for the stiffness there: raise output.frames"
            )
        if deepest > DEEPEST and not may_overlap:
            raise Diverged(
                f"wires overlap by {deepest:.2g} of their thickness at step {self.steps}, {where}: the contact penalty does not"
                " hold them apart; raise output.frames or contact.stiffness"
            )
