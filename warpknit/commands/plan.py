"""What a run would take, without running it: size, physics, memory, time step, steps, time.

    plan = make_plan(load_scene("scenes/atlas_patch.toml"))
    plan.as_dict(), list(plan.table().lines())

Steps and time are measured on a small mesh of the scene (solve/sample_run.py); sizes of large meshes assume endless cloth.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import psutil

from ..base.text import celsius, counted, duration, engineering, exact, memory, percent, rounded
from ..compute.device import find_device
from ..compute.memory import available_memory, required_memory
from ..knit.cloth import Cloth, knit_cloth
from ..knit.lapping import parse_chain
from ..mechanics.protocols import Model
from ..mesh.layout import copies_of_cloth, knit_scene, mesh_nodes, smaller_scene
from ..mesh.rim import net_nodes
from ..reflection.study import reflection_text
from ..results.finding import Finding, ResultTable, ResultWarning
from ..runner.cautions import cut_cautions, release_cautions, scene_cautions, sweep_cautions
from ..runner.estimates import MESHES as AGAIN
from ..runner.estimates import changes_of, fewer_nodes
from ..runner.strength import assumed_text
from ..runner.variants import MOST, first_meshes
from ..scene import Scene
from ..scene.capabilities import without_effect
from ..scene.options import DEFAULT, GIVEN
from ..solve.model import kind_of
from ..solve.sample_run import SAMPLE_NODES, Measured, measure_meshes, measure_run, sample_model
from ..studies.map_paths import map_paths
from ..wires.file_report import WireReport, wire_report

MESH = ("hook", "mesh", "contact", "wires", "hooks")  # rows on the mesh in the short table
UNUSED = "without effect"  # keys of the scene
HOOK_ENDS = "ends: the lower ends are clamped; the upper ends keep their direction and slide up and down; the right one is driven"


@dataclass(frozen=True)
class Overview:
    """What would run, without steps and time: result of `overview_of`."""

    scene: Scene
    device: str
    model: Model  # of the mesh, or of one of fewer repeats
    is_whole: bool  # whether `model` is of the mesh
    nodes: int
    wires: int
    bodies: int
    memory_bytes: int
    available_bytes: int
    physics: tuple[str, ...]
    mesh: tuple[tuple[str, str], ...]  # heading and text
    accuracy: str
    file: WireReport | None  # of wires from a file
    warnings: tuple[ResultWarning, ...]


@dataclass(frozen=True)
class Plan(Overview):
    """Result of `make_plan`."""

    run: Measured
    map_s: float | None  # [s] of `warpknit map` on one core; None without a sweep

    @property
    def steps(self) -> int:
        """Expected steps."""
        return self.run.steps

    @property
    def wall_s(self) -> float | None:
        """[s] of these steps of all meshes; None on a GPU."""
        return self.run.seconds * self._meshes_in_all if self.device == "cpu" else None

    @property
    def _meshes(self) -> int:
        return first_meshes(self.scene.variants)

    @property
    def _meshes_in_all(self) -> float:
        """Number of meshes, with the ones of the estimated error by their cost."""
        meshes = self._meshes
        if meshes == 1 or not self.scene.variants.sensitivity:
            return meshes
        return meshes + len(changes_of(self.scene)) * AGAIN * fewer_nodes(self.scene) / self.scene.model.nodes_per_loop

    def as_dict(self) -> dict[str, object]:
        """The object that `warpknit plan --json` prints."""
        file = {} if self.file is None else self.file.as_dict()
        return file | {
            "nodes": self.nodes,
            "wires": self.wires,
            "bodies": self.bodies,
            "pairs": 2 * self.bodies,
            "memory_bytes": self.memory_bytes,
            "time_step_s": self.model.time_step,
            "limited_by": self.model.limited_by,
            "steps": self.steps,
            "wall_s": self.wall_s,
            "physics": list(self.physics),
            "model": {"kind": self.scene.model.kind, "kind_reason": self.scene.kind_reason},
        }

    def table(self) -> ResultTable:
        """The plan as a table: cost, limits and physics; reasons where all rows are shown."""
        return ResultTable(tuple(self._findings()), self.warnings, "plan --json")

    def _findings(self) -> Iterator[Finding]:
        model, solver, loads = self.scene.model, self.scene.solver, _loads(self.scene)
        accuracy, *more_accuracy = self.accuracy.split("; ")
        physics = [sentence.partition(": ") for sentence in self.physics]
        names = dict.fromkeys(name for name, _, _ in physics if name != UNUSED)
        more = f", then {counted(len(loads) - 1, 'more load step')}" if loads[1:] else ""
        load, sweep = f"{self.scene.stages[0].text}{more}", self.scene.sweep
        if sweep is not None and not self.steps:  # no [load]
            load = f"{counted(len(sweep.pairs), 'pair')} of {sweep.quantity}"
        yield Finding(self.scene.name, f"{load}, on {self.device}", short=True)
        yield from (Finding("  load step", text) for text in loads if more)
        for heading, text in self.mesh:
            yield Finding(heading, text, short=heading in MESH)
        yield Finding(f"{model.kind} model", accuracy, short=True)
        yield Finding("  reason", self.scene.kind_reason, short=self.scene.kind_reason not in (GIVEN, DEFAULT))
        yield from (Finding("  accuracy", text) for text in more_accuracy)
        time = "time unknown on a GPU"
        if self.wall_s is not None:
            whole, count = self.wall_s, max(1, self.steps)
            time = f"{_about(lambda steps: duration(whole * steps / count), self.run)} on this CPU"
        meshes, variants = self._meshes, self.scene.variants
        each = "" if meshes == 1 else f" for each of {meshes} meshes"
        yield Finding("time", f"{time}, about {rounded(self.steps):,} steps{each}", short=self.map_s is None or self.steps > 0)
        if meshes > 1 and variants.standard_error:
            each += f", up to {MOST * variants.count} until the standard error is {percent(variants.standard_error)} or less"
        yield Finding("  steps", _about(lambda steps: f"{rounded(steps):,}", self.run) + each)
        yield Finding("  measured", _measured(self.run))
        if sweep is not None and self.map_s is not None:
            what = f"{counted(len(sweep.pairs), 'pair')} of {sweep.quantity}{f' of {meshes} meshes' if meshes > 1 else ''}"
            yield Finding("map", f"warpknit map takes about {duration(self.map_s)} on one core for {what}", short=True)
        yield Finding("memory", f"{memory(self.memory_bytes)} of {memory(self.available_bytes)} available", short=True)
        if solver.drive == "ramp":
            step = f"{engineering(self.model.time_step, 's')}, limited by {self.model.limited_by}"
            yield Finding("time step", step, short=True)
        if self.scene.reflection is not None:
            yield Finding("reflection", reflection_text(self.scene), short=True)
        yield Finding("switched on", ", ".join(names), short=True)
        yield from (Finding(UNUSED if name == UNUSED else f"  {name}", text, short=name == UNUSED) for name, _, text in physics)


def make_plan(scene: Scene, device: str | None = None) -> Plan:
    """Plan a run of `scene`, by steps of a small mesh.

    Raises the errors of a run: `DeviceError`, `MemoryNeeded`, `ModelError`, `KnitError`, `SceneError`.
    """
    overview = overview_of(scene, device)
    run = _measured_run(scene, overview.model, overview.nodes)
    failed = run.small.failure
    failure = [ResultWarning("W59", f"A small mesh of this scene fails: {failed}.")] if failed else []
    warnings = (*overview.warnings, *failure)
    return Plan(**vars(overview) | {"warnings": warnings}, run=run, map_s=_map_time(scene, overview))


def _map_time(scene: Scene, overview: Overview) -> float | None:
    """Time of the sweep on one core [s], or None without a sweep."""
    if scene.sweep is None:
        return None
    farthest = replace(scene, stages=(scene.sweep.stage(scene.stages[0], scene.sweep.pairs[-1]),))
    run = _measured_run(farthest, sample_model(farthest)[0], overview.nodes)
    levels = sum(path.count for path in map_paths(scene))
    return first_meshes(scene.variants) * levels / scene.levels * run.seconds


def _measured_run(scene: Scene, sample: Model, nodes: int) -> Measured:
    """Steps and time of one mesh of a run. sample: the `sample_model` of the scene."""
    meshes = min(first_meshes(scene.variants), SAMPLE_NODES // nodes)
    return measure_meshes(scene, meshes) if meshes > 1 else measure_run(sample, nodes, scene)


def _nodes_held(scene: Scene, nodes: int) -> int:
    """Nodes of a mesh and of the smaller ones that it starts from."""
    smaller = smaller_scene(scene)
    return nodes if smaller is None else nodes + _nodes_held(smaller, mesh_nodes(smaller))


def overview_of(scene: Scene, device: str | None = None) -> Overview:
    """What would run. Raises the errors of `make_plan`."""
    name = find_device(device, nodes=lambda: mesh_nodes(scene))
    file = None if scene.wires is None else wire_report(scene)
    cloth = knit_scene(scene, name) if scene.hook is None and scene.wires is None else None
    model, is_whole = sample_model(scene)
    nodes, wires, bodies, notes = model.node_count, len(model.panel.wire_first), model.panel.body_count, model.panel.notes
    if not is_whole and cloth is not None:
        (columns, rows), nodes, notes = copies_of_cloth(scene), mesh_nodes(scene), ()
        wires, bodies = len(cloth.threads) * columns, len(cloth.clasps) * columns * rows
    kind = kind_of(scene)
    about = "" if is_whole else "about "
    # the pieces of a cut are known once it is laid out
    on_wires = f" on {wires:,} wire{'s' if wires != 1 else ''}" if is_whole else ""
    mesh = (
        ("hook", "two wires, hooked once") if cloth is None else ("knit", _repeat(scene, cloth)),
        ("mesh", f"{about}{nodes:,} nodes{on_wires}"),
        ("contact", f"{about}{counted(bodies, 'clasp')}, {counted(2 * bodies, 'pair')}"),
    )
    return Overview(
        scene=scene,
        device=name,
        model=model,
        is_whole=is_whole,
        nodes=nodes,
        wires=wires,
        bodies=bodies,
        memory_bytes=psutil.Process().memory_info().rss + required_memory(scene, _nodes_held(scene, nodes)),
        available_bytes=min(available_memory(), available_memory(name)),
        physics=(
            *kind.physics(model, bodies),
            *physics_of(scene, model.loading_time),
            *without_effect(scene),
        ),
        mesh=(*mesh, *(("  cut", note) for note in notes)) if file is None else tuple(file.rows()),
        accuracy=kind.accuracy(scene),
        file=file,
        warnings=(
            *dict.fromkeys((*(() if file is None else file.warnings), *(model.panel.warnings if is_whole else ()))),
            *(() if cloth is None else kind.limitations(scene, cloth)),
            *(cut_cautions(model) if is_whole else ()),
            *scene_cautions(scene, cloth),
            *release_cautions(scene, cloth),
            *sweep_cautions(scene, cloth),
            *(ResultWarning("W14", text) for text in _overlaps(scene, cloth)),
        ),
    )


def _overlaps(scene: Scene, cloth: Cloth | None) -> Iterator[str]:
    if cloth is not None:
        repeat = knit_cloth(scene.knit.even, scene.wire.thickness, scene.model.merge_lenses)
        yield from kind_of(scene).overlaps_as_knitted(scene, repeat)


def _loads(scene: Scene) -> list[str]:
    named = len(scene.stages) > 1 or scene.stages[0].name != "load"
    return [f"{stage.name}: {stage.text}" if named else stage.text for stage in scene.stages]


def _about(text: Callable[[int], str], run: Measured) -> str:
    """Text of the expected steps, with the fewest and the most."""
    if run.is_bound:
        return f"more than {text(run.steps)}"
    least, expected, most = (text(steps) for steps in (run.least_steps, run.steps, run.most_steps))
    return f"about {expected}{f' ({least} to {most})' if least != most else ''}"


def _measured(run: Measured) -> str:
    small, stages = run.small, len(run.small.model.scene.stages)
    if run.is_bound:
        return f"on {small.model.node_count:,} nodes: {small.steps:,} steps, no load level reached"
    part = "the whole load" if small.place >= stages else f"{percent(small.place / stages, 0)} of the load"
    return f"on {small.model.node_count:,} nodes: {small.steps:,} steps to {part}"


def _repeat(scene: Scene, cloth: Cloth) -> str:
    links = [len(parse_chain(bar.chain)) for bar in scene.knit.bars]
    wire, plan_view = (engineering(length, "m") for length in (cloth.wire_length, cloth.stitch_length))
    repeated = f"; chains of {' and '.join(map(str, links))} links, each repeated" if len(set(links)) > 1 else ""
    stitches = f"a repeat of {cloth.wales} x {cloth.courses} stitches (wales x courses)"
    return f"{stitches}, {wire} of wire a loop ({plan_view} in plan view){repeated}"


# --- physics ----------------------------------------------------------------------------------------------------------


def physics_of(scene: Scene, loading_time: float) -> Iterator[str]:
    """Physics that panel, wire, load and solver switch on, one sentence each. loading_time [s]: of a ramp."""
    if scene.hook is None:
        yield from _panel_physics(scene)
    else:
        yield HOOK_ENDS
    wire, solver = scene.wire, scene.solver
    if wire.set_fraction != 1.0:
        yield f"natural curvature: {wire.set_fraction:g} of the knitted one; given, not computed from yield, wire.set_fraction"
    if wire.plating is not None:
        coat = f"{1e6 * wire.plating.thickness:g} um of {wire.plating.material}"
        yield f"plating: {coat} adds stiffness, mass and thickness, wire.plating"
    if wire.ends > 1:
        yield f"ends: {wire.ends} wires side by side make one yarn, wire.ends"
    hot = [stage for stage in scene.stages if stage.temperature != wire.reference_temperature]
    if hot:
        names = ", ".join(f"{celsius(stage.temperature)} in {stage.name!r}" for stage in hot)
        yield f"thermal strain: {names}, zero at {celsius(wire.reference_temperature)}"
    if scene.hook is None and any(stage.shear for stage in scene.stages):
        yield "shear: given in a load step, load.shear"
    if any(stage.clamp_rotation for stage in scene.stages):
        yield "rotated clamps: given in a load step, load.clamp_rotation"
    if any(any(stage.by_tension) for stage in scene.stages):
        yield "strain by tension: the load gives the tension of a direction; its strain is solved with the nodes"
    if scene.contact.friction:
        assumed = assumed_text(scene, "contact.friction")
        yield f"friction: contacts stick up to {scene.contact.friction:g} times their normal force, contact.friction{assumed}"
    if wire.plastic:
        yield f"yield: plastic bending above {exact(wire.yield_stress, 'Pa')}, with a permanent set, wire.plastic"
    if scene.depends_on_path:
        yield "load history: strain increments of at most 0.5 %, because results depend on it"
    elif solver.drive == "relax":
        path = "; a tight mesh may have several, and the load path decides"
        if scene.hook is not None:
            by_plane = scene.contact.treatment == "friction-plane"
            path = f", independent of the load path{' (except by the friction of the plane)' if by_plane else ''}"
        yield f"relaxation: one equilibrium a load level{path}, solver.drive = 'relax'"
    else:
        yield f"ramp: {engineering(loading_time, 's')} of real time for a load step, solver.drive = 'ramp'"
    if solver.drive == "ramp" and solver.mass_scaling != 1.0:
        yield f"mass scaling: all masses multiplied by {solver.mass_scaling:g}, solver.mass_scaling"
    if solver.drive == "ramp" and solver.target_time_step is not None:
        step = exact(solver.target_time_step, "s")
        yield f"mass scaling: masses raised for a stable step of {step}, solver.target_time_step"
    if solver.precision == "single":
        yield f"single precision: displacements are {scene.model.of_kind.single_positions}, the rest is float32, solver.precision"
    else:
        yield "double precision: float64 throughout, solver.precision"


def _panel_physics(scene: Scene) -> Iterator[str]:
    panel = scene.panel
    if scene.model.boundary == "periodic":
        yield "periodic boundary: one tile of an endless mesh, model.boundary = 'periodic'"
    else:
        yield "grips: every cut wire end is held in position and direction, model.boundary = 'gripped'"
    yield "affine prediction: the interior moves with the boundary; only the deviation is solved"
    smaller = smaller_scene(scene) if scene.solver.drive == "relax" else None
    if smaller is not None:
        repeats = " x ".join(map(str, smaller.knit.repeats))
        yield f"multilevel start: from the equilibrium of a smaller mesh of {repeats} repeats, recursively"
    if panel.outline != "rectangle":
        yield f"outline: the mesh is cut along a {panel.outline}, panel.outline"
    if panel.cord is not None and panel.grip_pitch is not None:
        nodes, spacing = net_nodes(panel.shape(scene.knit.size), panel.grip_pitch)
        yield (
            f"cords: {nodes} net nodes hold the edge, at most {engineering(spacing, 'm')} apart, with a cord between them at"
            f" {exact(panel.cord.tension, 'N')} tension, panel.cord"
        )
    if any(stage.pull for stage in scene.stages):
        yield "pulls: prescribed displacements of places at the edge, [[load.pull]]"
    if any(any(stage.temperature_gradient) for stage in scene.stages):
        yield "temperature gradient: thermal strain varies from wire to wire, load.temperature_gradient"
    if panel.focal_length is not None:
        yield f"surface: shape of a panel under tension on a paraboloid of f = {exact(panel.focal_length, 'm')}"
