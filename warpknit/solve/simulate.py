"""The loop over the stages of a scene: a generator of `Record`s."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from ..base.errors import Diverged, InputError, ModelError
from ..base.text import engineering, percent
from ..compute import device_of_mesh
from ..compute.ranks import Ranks
from ..measure.table import Record
from ..mechanics.protocols import Mechanics, Model
from ..mesh.layout import estimated_nodes, one_repeat, smaller_scene
from ..scene import Scene
from .drive import Drive
from .model import build_model, initial_state, mechanics_of
from .multilevel import MultilevelRelaxation
from .progress import Progress
from .ramp import Ramp
from .relax import Relaxation
from .side_by_side import SideBySide, WorldProcesses, processes_of

__all__ = ["Progress", "Record", "Simulation"]


BALANCED = 1e-6  # of the forces on the nodes: a smaller resultant is round-off
NODES_A_STRIP = 4_000  # of a smaller mesh: below it communication costs more than it saves


class Simulation:
    """A run of a model through the load steps of its scene, without files. It begins at `state`, by default the mesh as knitted.

        for record in Simulation(build_model(scene)).run():
            print(record.load_factor, measure.mesh_tension(record.observables))      # [N/m] weft, warp

    A `Record` has its place in the load history (stage, load_factor, temperature [K], steps, `steady`) and `observables`: the
    state on the host, with `node_position` (node, 3) [m], `pair_force` [pair] [N], `wire_stress.node` [node] [Pa] and more, see
    `help(record.observables)`. `warpknit.measure` derives measures from them.

    worlds: scenes, or their models, that run side by side in place of the model. They may differ in loads and temperatures, in
    the spatial model also in the seed of the scatter and in friction. Records come in the order in which worlds converge;
    `record.world` is the number of the world. A world that fails ends, and `failures` has its error. Small meshes take a fraction
    of the time of single runs.

        scenes = [scene.changed([f"load.strain_weft={strain}"]) for strain in (0.02, 0.04, 0.06)]
        last = {record.world: record for record in Simulation(build_model(scene), worlds=scenes).run()}

    Worlds that differ in loads reproduce single runs bit by bit; worlds of other seeds agree with them within the tolerance.

    ends_only: worlds record the end of each load step only. spread: worlds may run in other processes; then their `drives` have
    progress and snapshots only. progress: from a checkpoint, to continue; with worlds one for each.
    monitor: called with the progress after every convergence
    check; it may raise an exception to stop.
    """

    def __init__(
        self,
        model: Model,
        state: Any = None,
        *,
        progress: Progress | Sequence[Progress] | None = None,
        monitor: Callable[[Progress], None] | None = None,
        worlds: Sequence[Scene | Model] = (),
        ends_only: bool = False,
        spread: bool = False,
    ) -> None:
        if not hasattr(model, "scene"):
            raise InputError(f"Simulation: {model!r} is not a model; give one, such as build_model(scene)")
        self.model = model
        self.worlds: SideBySide | WorldProcesses | None = None
        self.failures: dict[int, Diverged] = {}  # by world
        if worlds:
            begun = progress if isinstance(progress, Sequence) else ()
            self._begin_worlds(worlds, begun, monitor, ends_only, spread=spread)
            return
        assert not isinstance(progress, Sequence)
        self.state = initial_state(model) if state is None else state
        self.resumed = progress is not None
        self.progress = progress or Progress()
        self.monitor = monitor or (lambda _progress: None)
        self.solving = ""  # which smaller mesh is solved for the start of a large one, and how far it is
        if model.scene.solver.drive == "relax":
            mechanics = mechanics_of(model, self.state)
            self.drive: Drive = self._relaxation(mechanics, self.progress, self._cell_of(mechanics))
        else:
            self.drive = Ramp(mechanics_of(model, self.state), self.progress, self._monitored)

    def __repr__(self) -> str:
        progress = self.progress
        return f"<Simulation of {self.model.scene.name}: {progress.records} records, {progress.steps:,} steps>"

    def _monitored(self, progress: Progress, model: Model | None = None) -> None:
        """The progress of the mesh, or of a smaller one with this model."""
        self.solving = ""
        if model is not None and progress is not self.progress:
            columns, rows = model.scene.knit.repeats
            self.solving = f"smaller mesh of {columns} x {rows} repeats {percent(progress.level_share, 0)} done"
        self.monitor(self.progress)

    @property
    def mechanics(self) -> Any:
        """The mechanics that step the state."""
        return self.drive.mechanics

    @property
    def drives(self) -> Sequence[Any]:
        """Drive of the mesh, or of each world."""
        return [self.drive] if self.worlds is None else self.worlds.members

    @property
    def steps(self) -> int:
        """Time steps so far, of all worlds."""
        return sum(drive.progress.steps for drive in self.drives)

    @property
    def notes(self) -> list[str]:
        """Notes for the user on the mesh and its smaller ones."""
        return self.drive.notes

    def set_force(self, force: np.ndarray) -> None:
        """Put dead loads (node, 3) [N] on the nodes, from the next load level on. Spatial model only.

            simulation = Simulation(build_model(scene))
            node = simulation.model.global_model.rods.position     # (node, 3) [m] as knitted, of all ranks
            simulation.set_force(np.where(node[:, 2:] > 0.0, [0.0, 0.0, 1e-6], 0.0))
            for record in simulation.run(): ...

        If `output.frames` is a number, the force may be set again between two records, so that it follows the mesh. The energy
        balance does not include its work.
        Raises ModelError: for the planar model, for another shape, and if the forces on a periodic tile do not sum to zero.
        """
        set_dead_load = getattr(self.mechanics, "set_dead_load", None)
        if set_dead_load is None:
            raise ModelError("forces on nodes: the planar model has none; write model.kind = 'spatial'")
        model: Any = self.model
        wanted = (model.global_model.node_count, 3)
        values = np.asarray(force)
        if values.dtype.kind not in "fiu":
            raise ModelError(f"forces on nodes: an array of {values.dtype} has no numbers; give finite numbers of shape {wanted}")
        if values.shape != wanted or not np.all(np.isfinite(values)):
            raise ModelError(f"forces on nodes: an array of {values.shape} does not fit; give finite numbers of shape {wanted}")
        resultant, total = np.abs(values.sum(axis=0)).max(), np.abs(values).sum()
        if not model.global_model.rods.held.any() and resultant > BALANCED * total:
            raise ModelError(
                f"forces on nodes: their resultant of {engineering(float(resultant), 'N')} acts on a tile that nothing holds;"
                " give forces that add up to zero"
            )
        set_dead_load(values)

    # --- drives

    def _relaxation(self, mechanics: Mechanics, progress: Progress, cell: Relaxation | None) -> Relaxation:
        model: Model = mechanics.model
        monitored = partial(self._monitored, model=model)
        scene = smaller_scene(model.scene) if model.cloth is not None else None
        if scene is None:
            if cell is None or not model.scene.has_moving_edge:
                return Relaxation(mechanics, progress, monitored)
            return MultilevelRelaxation(mechanics, progress, monitored, cell=cell)
        smaller = self._smaller_model(model, scene)
        below = self._relaxation(mechanics_of(smaller, initial_state(smaller)), Progress(), cell)
        return MultilevelRelaxation(mechanics, progress, monitored, smaller=below, cell=cell)

    @staticmethod
    def _smaller_model(model: Model, scene: Scene) -> Model:
        """Build a smaller mesh of the same knit, on the CPU where faster.

        The ranks of the larger one share it; each has a copy where strips would be too small.
        """
        assert model.cloth is not None
        nodes, ranks = estimated_nodes(scene, model.cloth), model.ranks
        is_shared = nodes // ranks.count >= NODES_A_STRIP and scene.knit.repeats[0] >= ranks.count
        return build_model(scene, device_of_mesh(nodes, model.device), ranks if is_shared else Ranks())

    @classmethod
    def _cell_of(cls, mechanics: Mechanics) -> Relaxation | None:
        """A relaxation of one periodic repeat, for a large gripped mesh, else None."""
        model: Model = mechanics.model
        scene = model.scene
        if model.cloth is None or scene.model.boundary == "periodic":
            return None
        if smaller_scene(scene) is None and not scene.has_moving_edge:
            return None
        cell = cls._smaller_model(model, one_repeat(scene))
        return Relaxation(mechanics_of(cell, initial_state(cell)))

    # --- worlds

    def _begin_worlds(
        self,
        worlds: Sequence[Scene | Model],
        progress: Sequence[Progress],
        monitor: Callable[[Progress], None] | None,
        ends_only: bool,
        *,
        spread: bool,
    ) -> None:
        scenes = [one if isinstance(one, Scene) else one.scene for one in worlds]
        if any(scene.solver.drive != "relax" for scene in scenes):
            raise InputError("Simulation: worlds are relaxed; write solver.drive = 'relax'")
        models = [self._world_model(number, one) if isinstance(one, Scene) else one for number, one in enumerate(worlds)]
        if len({model.node_count for model in models}) > 1:
            raise InputError("Simulation: worlds have different numbers of nodes; give scenes of the same knit and repeats")
        if spread and processes_of(models) > 1:
            self.worlds = WorldProcesses(models, Simulation, ends_only=ends_only)
        else:
            self.worlds = SideBySide(models, lambda member: member.all_levels(ends_only=ends_only), progress)
            self.drive, self.state = self.worlds.members[0], self.worlds.members[0].state
        self.progress, self.resumed, self.solving = self.worlds.members[0].progress, bool(progress), ""
        self.monitor = monitor or (lambda _progress: None)

    def _world_model(self, number: int, scene: Scene) -> Model:
        """The model of a world: this one with its loads, or one of loops scattered otherwise."""
        model: Any = self.model
        own, alike = model.scene, scene
        if own.model.of_kind.own_loops and (own.contact.friction > 0.0) == (scene.contact.friction > 0.0):
            knit, contact = replace(scene.knit, seed=own.knit.seed), replace(scene.contact, friction=own.contact.friction)
            alike = replace(scene, knit=knit, contact=contact)
        for name in ("wire", "knit", "contact", "model", "panel", "solver"):
            if getattr(alike, name) != getattr(own, name):
                raise InputError(f"Simulation: world {number} differs from the model in [{name}]; change only loads or seeds")
        return replace(model, scene=scene) if scene.knit == own.knit else build_model(scene, model.device)

    # --- the run

    def compile(self) -> None:
        """Compile or load every kernel of the run; the state does not change. Raises `ModelError`."""
        self.drive.compile()

    def run(self) -> Iterator[Record]:
        """Records of all load steps from `progress` on: the unloaded mesh, then the load levels of each load step.

        Raises:
            Diverged: a level does not converge, wires pass through each other, or values are not finite.
        """
        if self.worlds is not None:
            for world, found in self.worlds.run(lambda: self.monitor(self.progress), self.failures):
                if isinstance(found, Diverged):
                    self.failures[world] = found
                else:
                    yield replace(found, world=world)
            return
        if not self.resumed:
            self.drive.mechanics.search()
        for stage in self.drive.stages():
            yield from self.drive.stage(stage)
