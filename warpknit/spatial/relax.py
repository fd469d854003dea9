"""Load levels of a mesh in space, each brought to rest.

The load of a level comes on within some hundred steps, the whole mesh being carried affinely with its boundary, and is moved
on by what the last level moved beside that. It is steady when what is out of balance, motion, the drift of the tension, and what
the softening of the wires still does are all below the scene's tolerance, as in a planar relaxation. A direction that is driven
by tension is found as there, one steady state after the other.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from .. import measure
from ..errors import Diverged
from ..measure import strain
from ..scene import Stage
from ..solve.tension import MOST_STATES
from .drive import CLOSEST, SpatialDrive, SpatialRecord
from .edge import Edge
from .rest import CHECK_STEPS
from .steadiness import AXIAL_ERROR, tension_scale

MASS_LOOKS = 20  # looks between renewals of the fictitious masses
LEVEL_STEPS = 500_000  # of a level after which it counts as never steady, where the scene gives no max_steps
RAMP_STEPS = 500  # steps over which the load of a level comes on
PATH_STRAIN = 0.005  # between steady states where friction or yield makes the state depend on the path, at most
EDGE_LOOKS = 4  # looks between corrections of what hangs on cords
EDGE_LEFT = 20.0  # of what counts as steady, below which they begin
FARTHEST = 0.2  # of the thickness: by how much the state is moved ahead


class SpatialRelaxation(SpatialDrive):
    """Brings every load level of a scene to rest."""

    slower = "output.frames"
    _before: tuple[np.ndarray, np.ndarray] | None = None  # gradient and displacement of the level before

    def memory(self) -> dict[str, np.ndarray]:
        kept = super().memory()
        if self._before is not None:
            kept |= {"gradient_before": self._before[0], "displacement_before": self._before[1]}
        return kept

    def recall(self, kept: dict[str, np.ndarray]) -> None:
        super().recall(kept)
        if "gradient_before" in kept:
            self._before = kept["gradient_before"].copy(), kept["displacement_before"].copy()

    # --- levels

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
        factor = self.scene.wire.length_factor(self._temperature(stage, self.progress.load_factor))
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
            tension = np.array(measure.mesh_tension(reading))
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
            gradient = strain.rotation(-reading.clamp_rotation) @ stretch
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
                progress.tensions.append(np.diag(measure.boundary_stress(self._reading())).tolist())
                if self.steadiness.still_to_come(progress.tensions) < 1.0:
                    return
            self.watch(progress)
        raise Diverged(
            f"level {progress.load_factor:.3g} of stage {progress.stage!r} is not steady after {most:,} steps (residual"
            f" {progress.residual:.2g} at a tolerance of {self.scene.solver.residual_tolerance:g}): raise solver.max_steps or"
            " solver.residual_tolerance"
        )
