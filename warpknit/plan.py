"""What running a scene would take, said without running it: size, physics, memory, time step, steps, time.

    plan = make_plan(load_scene("scenes/atlas_patch.toml"))
    print("\n".join(plan.lines()))

Sizes are those of the real model, built without compiling a kernel, up to COUNTED_NODES nodes, and those of the endless
cloth above. Steps and time are estimates: see solve/estimate.py and spatial/estimate.py for what they go by.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from typing import Any

from .device import find_device
from .knit.chain import parse_chain
from .knit.cloth import Cloth
from .memory import available_memory, required_memory
from .mesh.layout import SLIDE_ALLOWANCE, copies_of_cloth, estimated_nodes, knit_scene
from .mesh.panel import table_lead
from .mesh.rim import net_nodes
from .mesh.table import rest_table
from .planar.model import Model, build_model
from .planar.numerics import Numbers, choose_numbers
from .planar.plane_limits import tight_loops
from .planar.prolongation import smaller_scene
from .scene import Scene
from .scene.presets import PRESETS
from .solve.estimate import ESTIMATE_FACTOR, ramp_steps, relax_steps, wall_time
from .spatial.drive import CLOSEST
from .spatial.estimate import (
    HOOK_ENDS,
    SLOW_LEVELS,
    SPATIAL_FACTOR,
    SpatialSize,
    endless_size,
    size_of_mesh,
    spatial_accuracy,
    spatial_map_time,
    spatial_physics,
    spatial_steps,
    spatial_time,
)
from .spatial.mesh import build_mesh
from .spatial.ramp_masses import ramp_numbers
from .spatial.relax import SpatialRelaxation
from .text import duration, memory, rounded
from .wires.report import WireReport, wire_report

COUNTED_NODES = 2_000_000  # meshes up to here are laid out to be counted: a second or two
COUNTED_IN_SPACE = 50_000  # the same in space, five seconds
DOUBTFUL = 100.0  # times the distance at which centre lines meet: nearer than this a run is asked whether they do
PROGRAM_MEMORY = 430 * 2**20  # [bytes] of a run of few nodes, its libraries included


@dataclass(frozen=True)
class Plan:
    """What `make_plan` found. `counted` tells whether sizes are exact; `wall_s` is None on a GPU."""

    scene: str
    device: str
    nodes: int
    wires: int
    bodies: int
    pairs: int
    memory_bytes: int
    available_bytes: int
    time_step_s: float
    limited_by: str
    steps: int
    wall_s: float | None
    physics: tuple[str, ...]
    counted: bool
    relaxes: bool
    knit: str
    sweep: str
    accuracy: str
    factor: float  # by which steps and time may be off
    hooked_by: str  # in words, what the number of bodies counts
    exception: str  # in words, what takes longer all the same
    file: WireReport | None = None  # of wires from a file

    def as_dict(self) -> dict[str, Any]:
        """What `warpknit plan --json` prints."""
        kept = asdict(replace(self, file=None))
        for name in ("scene", "device", "available_bytes", "counted", "relaxes", "knit", "sweep", "accuracy", "hooked_by"):
            del kept[name]
        for name in ("factor", "exception", "file"):
            del kept[name]
        held = {} if self.file is None else self.file.as_dict()
        return held | kept | {"physics": list(self.physics)}

    def lines(self) -> list[str]:
        """The same as text."""
        about = "" if self.counted else "about "
        step = f"{self.time_step_s:.3g} s, limited by {self.limited_by}"
        if self.relaxes:
            step = "1, which fictitious masses make stable"
        if self.wall_s is None:
            time = "not estimated on a GPU"
        else:
            time = f"about {duration(self.wall_s)} on this CPU, kernels compiled"
        if self.file is not None:
            mesh = self.file.rows()
        else:
            mesh = [
                ("knit", self.knit) if self.knit else ("hook", "two wires, hooked once"),
                ("mesh", f"{about}{self.nodes:,} nodes on {self.wires:,} wires"),
                ("contact", f"{about}{self.bodies:,} {self.hooked_by}"),
            ]
        rows = [
            ("scene", f"{self.scene}, on {self.device}"),
            *mesh,
            ("memory", f"{memory(self.memory_bytes)} of {memory(self.available_bytes)} available"),
            ("time step", step),
            ("steps", f"about {rounded(self.steps):,}"),
            *([("sweep", self.sweep)] if self.sweep else []),
            ("time", time),
            ("", f"both within a factor of {self.factor:g}, where the mesh is like the ones they were measured on"),
            *([("", self.exception)] if self.exception else []),
            ("accuracy", self.accuracy),
            ("physics", self.physics[0]),
            *(("", sentence) for sentence in self.physics[1:]),
        ]
        return [f"{heading:<11}{text}" for heading, text in rows]


def make_plan(scene: Scene, device: str | None = None) -> Plan:
    """Plan a run of `scene`. Raises what a run of it would refuse: `DeviceError`, `MemoryNeeded`, `ModelError`, `KnitError`,
    `SceneError`."""
    name = find_device(device)
    file = None if scene.wires is None else wire_report(scene, scene.wire.thickness)
    cloth = knit_scene(scene) if scene.hook is None and scene.wires is None else None
    most = COUNTED_NODES if scene.model.kind == "planar" else COUNTED_IN_SPACE
    counted = cloth is None or estimated_nodes(scene, cloth) <= most
    mesh: MeshSize | SpatialSize
    is_ramp = scene.solver.drive == "ramp"
    if scene.model.kind == "spatial":
        laid_out = cloth is None or counted or is_ramp
        mesh = _size_in_space(scene, file) if cloth is None or laid_out else _endless_in_space(scene, cloth)
        steps = ramp_steps(scene, mesh.loading_time, mesh.time_step) if is_ramp else spatial_steps(scene)
        time, factor = spatial_time(steps, mesh), SPATIAL_FACTOR
    else:
        mesh = _count(build_model(scene, "cpu")) if cloth is None or counted else _estimate(scene, cloth)
        steps = ramp_steps(scene, mesh.loading_time, mesh.time_step) if is_ramp else relax_steps(scene, mesh.spacing)
        time, factor = wall_time(scene, steps, mesh.nodes), ESTIMATE_FACTOR
    in_space = isinstance(mesh, SpatialSize)
    return Plan(
        scene=scene.name,
        device=name,
        nodes=mesh.nodes,
        wires=mesh.wires,
        bodies=mesh.bodies,
        pairs=2 * mesh.bodies,
        memory_bytes=PROGRAM_MEMORY + required_memory(scene, mesh.nodes),
        available_bytes=available_memory(),
        time_step_s=mesh.time_step,
        limited_by=mesh.limited_by,
        steps=steps,
        wall_s=time if name == "cpu" else None,
        physics=(*physics_of(scene, mesh), *_left_out(scene, cloth)),
        counted=counted,
        relaxes=scene.solver.drive == "relax",
        knit="" if cloth is None else _repeat(scene, cloth),
        sweep=_sweep(scene, mesh),
        accuracy=spatial_accuracy(scene) if in_space else _accuracy(scene),
        factor=factor,
        hooked_by="places where wires hook each other" if in_space else f"bodies, {2 * mesh.bodies:,} pairs",
        exception=SLOW_LEVELS if in_space else "",
        file=file,
    )


def _left_out(scene: Scene, cloth: Cloth | None) -> Iterator[str]:
    """What a planar run of this knit would not show."""
    if cloth is not None and scene.model.kind == "planar":
        yield from tight_loops(scene, cloth)


def _accuracy(scene: Scene) -> str:
    """What is known of the error of the scene's settings."""
    name = scene.preset_in_force
    if name is None:
        return "no preset has these settings; `run --error` takes some that it measures on this scene"
    preset = PRESETS[name]
    grips = ", more where short wires between grips carry it" if scene.model.boundary == "gripped" and scene.hook is None else ""
    return (
        f"{name}: within {preset.error_percent:g} % on a repeat of the double atlas mesh{grips}, for {preset.node_steps:.2g}"
        " node-steps a load level; `run --error` measures it on this scene"
    )


def _sweep(scene: Scene, mesh: MeshSize | SpatialSize) -> str:
    """What `warpknit map` would run of the scene, in words; this plan is of one run of its load."""
    if scene.sweep is None:
        return ""
    pairs = len(set(scene.sweep.strain_weft)) * len(set(scene.sweep.strain_warp))
    meshes = f" of {scene.sweep.seeds} meshes" if scene.sweep.seeds > 1 else ""
    took = f" in about {duration(spatial_map_time(scene, mesh))}" if isinstance(mesh, SpatialSize) else ""
    return f"warpknit map brings {pairs:,} pairs of strains{meshes} to rest{took}; the numbers here are for one run of [load]"


def _repeat(scene: Scene, cloth: Cloth) -> str:
    """One repeat in words, with what tells of a lost link: the links of each bar."""
    links = [len(parse_chain(bar.chain)) for bar in scene.knit.bars]
    text = f"a repeat of {cloth.wales} wales x {cloth.courses} courses, {1e3 * cloth.stitch_length:.3g} mm of wire a loop"
    if len(set(links)) > 1:
        text += f"; chains of {' and '.join(map(str, links))} links, each over and over"
    return text


# --- size -------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class MeshSize:
    """What the rest of the plan goes by."""

    nodes: int
    wires: int
    bodies: int
    spacing: float  # [m] of the nodes, the least
    softening: float
    time_step: float  # [s]
    limited_by: str
    loading_time: float  # [s] of a stage of a ramp


def _count(model: Model) -> MeshSize:
    """The sizes of a model."""
    panel = model.panel
    return MeshSize(
        panel.node_count,
        len(panel.wire_first),
        panel.body_count,
        float(model.table.spacing.min()),
        model.softening,
        model.time_step,
        model.limited_by,
        model.loading_time,
    )


def _estimate(scene: Scene, cloth: Cloth) -> MeshSize:
    """The sizes of so many repeats of endless cloth: right for a tile, and but for its edges for a gripped mesh."""
    columns, rows = copies_of_cloth(scene)
    spacing = cloth.stitch_length / scene.model.nodes_per_loop
    table = rest_table(
        cloth,
        nodes_per_loop=scene.model.nodes_per_loop,
        set_fraction=scene.wire.set_fraction,
        lead=table_lead(cloth, 0.8 * spacing, SLIDE_ALLOWANCE * cloth.stitch_length),
    )
    numbers: Numbers = choose_numbers(scene, table, cloth.stitch_length)
    return MeshSize(
        estimated_nodes(scene, cloth),
        len(cloth.threads) * columns,
        len(cloth.clasps) * columns * rows,
        float(table.spacing.min()),
        numbers.softening,
        numbers.time_step,
        numbers.limited_by,
        numbers.loading_time,
    )


def _size_in_space(scene: Scene, file: WireReport | None) -> SpatialSize:
    """The sizes of the rods; what a run of them would refuse is refused."""
    mesh = build_mesh(scene)
    size = size_of_mesh(mesh)
    if scene.solver.drive == "ramp":
        numbers = ramp_numbers(mesh)
        step, by = numbers.time_step, numbers.rates.limited_by
        size = replace(size, time_step=step, limited_by=by, loading_time=numbers.loading_time)
    closest = None if file is None else file.overlaps.closest
    if closest is not None and closest < DOUBTFUL * CLOSEST * scene.wire.thickness:
        SpatialRelaxation(mesh).warm_up()
    return size


def _endless_in_space(scene: Scene, cloth: Cloth) -> SpatialSize:
    """The same from so many repeats of endless cloth."""
    columns, rows = copies_of_cloth(scene)
    return endless_size(estimated_nodes(scene, cloth), len(cloth.threads) * columns, len(cloth.clasps) * columns * rows)


# --- physics ----------------------------------------------------------------------------------------------------------


def physics_of(scene: Scene, mesh: MeshSize | SpatialSize) -> Iterator[str]:
    """What the scene switches on and why, a sentence each."""
    if isinstance(mesh, SpatialSize):
        yield from spatial_physics(scene, mesh.bodies)
        yield from _panel_physics(scene)
        yield from _solving_of(scene, mesh)
        return
    wire, solver = scene.wire, scene.solver
    yield f"stretching: wires carry tension, EA = {wire.axial_stiffness:.3g} N"
    yield f"bending: wires resist a change of curvature, EI = {wire.bending_stiffness:.3g} N m2"
    if scene.hook is not None:
        yield f"contact: one place, carried by contact.treatment = {scene.contact.treatment!r}"
        yield HOOK_ENDS
        yield from _solving_of(scene, mesh)
        return
    if mesh.bodies:
        merged = "nested lenses merged" if scene.model.merge_lenses else "one for each lens, model.merge_lenses = false"
        yield f"contact: wires hook in {mesh.bodies:,} places, each with a body between its two wires ({merged})"
    if scene.model.boundary == "periodic":
        yield "periodic boundary: one tile of an endless mesh, model.boundary = 'periodic'"
    else:
        yield "grips: every cut wire end is held in position and direction, model.boundary = 'gripped'"
        yield from _panel_physics(scene)
    yield "affine carry: the interior moves with the boundary, so that only what differs from it has to be solved"
    if solver.drive == "relax" and (smaller := smaller_scene(scene)) is not None:
        yield f"start: a smaller mesh of {' x '.join(map(str, smaller.knit.repeats))} repeats comes to rest first, and so on down"
    yield from _solving_of(scene, mesh)


def _solving_of(scene: Scene, mesh: MeshSize | SpatialSize) -> Iterator[str]:
    """What the wire, the stages and the solver add."""
    wire, solver = scene.wire, scene.solver
    if wire.set_fraction != 1.0:
        yield f"set: a wire let free keeps {wire.set_fraction:g} of its knitted curvature, wire.set_fraction"
    if wire.plating is not None:
        coat = f"{wire.plating.thickness * 1e6:.3g} um of {wire.plating.material}"
        yield f"plating: {coat} add stiffness, mass and thickness, wire.plating"
    if wire.ends > 1:
        yield f"ends: {wire.ends} wires side by side make one yarn, wire.ends"
    hot = [stage for stage in scene.stages if stage.temperature != wire.reference_temperature]
    if hot:
        names = ", ".join(f"{stage.temperature:.5g} K in {stage.name!r}" for stage in hot)
        yield f"thermal strain: {names}, against {wire.reference_temperature:.5g} K where it is zero"
    if scene.hook is None and any(stage.shear for stage in scene.stages):
        yield "shear: a stage asks for it"
    if any(stage.clamp_rotation for stage in scene.stages):
        yield "turned clamps: a stage asks for it, load.clamp_rotation"
    if any(any(stage.by_tension) for stage in scene.stages):
        yield "tension search: a direction is given by tension, so strains are tried until the steady mesh carries it"
    if scene.contact.friction:
        yield f"friction: bodies stick to their wires up to {scene.contact.friction:g} times the contact force, contact.friction"
    if wire.plastic:
        yield f"yield: wires keep a set beyond {wire.yield_stress / 1e6:.4g} MPa in bending, wire.plastic"
    if scene.depends_on_path:
        yield "path: steady states at most half a percent of strain apart, as each depends on the one before"
    elif solver.drive == "relax":
        path = "" if scene.contact.treatment != "friction-plane" else "the plane's friction apart, "
        yield f"relaxation: {path}no state depends on the path, so each load level is brought to rest, solver.drive = 'relax'"
    else:
        yield f"ramp: {mesh.loading_time:.3g} s of real time a stage, solver.drive = 'ramp'"
    if solver.drive == "ramp" and solver.mass_scaling != 1.0:
        yield f"mass scaling: all masses {solver.mass_scaling:g} times the real ones, solver.mass_scaling"
    if solver.drive == "ramp" and solver.target_time_step is not None:
        yield f"mass scaling: masses raised until a step of {solver.target_time_step:.3g} s is stable"
    if isinstance(mesh, MeshSize) and mesh.softening != 1.0:
        yield f"softening: wires stretch {mesh.softening:g} times as easily in the dynamics, solver.axial_softening"
    if solver.drive == "relax" and solver.multipliers and isinstance(mesh, MeshSize):
        yield "running multipliers: take out again what softening and contact penalty change, solver.multipliers"
    if solver.precision == "single":
        yield "single precision: displacements are 32-bit fixed point, the rest is float32, solver.precision"
    else:
        yield "double precision: everything is float64, solver.precision"


def _panel_physics(scene: Scene) -> Iterator[str]:
    """What [panel] and uneven loads switch on."""
    panel = scene.panel
    if panel.outline != "rectangle":
        yield f"outline: the mesh is cut along a {panel.outline}, panel.outline"
    if panel.cord is not None and panel.grip_pitch is not None:
        nodes, apart = net_nodes(panel.shape(scene.knit.size), panel.grip_pitch)
        yield (
            f"cords: {nodes} net nodes hold the edge, {1e3 * apart:.3g} mm apart or less, between them it hangs on a cord of"
            f" {panel.cord.tension:.3g} N, panel.cord"
        )
    if any(stage.pull for stage in scene.stages):
        yield "pulls: places of the edge are moved beside the load as a whole, [[load.pull]]"
    if any(any(stage.temperature_gradient) for stage in scene.stages):
        yield "gradient of temperature: each wire is as long as it is warm where it lies, load.temperature_gradient"
    if panel.focal_length is not None:
        yield f"surface: the shape that the tension gives a panel held on a paraboloid of f = {panel.focal_length:.3g} m"
