"""Steps and time that a planar run would take, from what others took."""

from __future__ import annotations

import math
from collections.abc import Iterator

from ..estimate import HOOK_ENDS, HOOKED, Cost, Notes, Size, boundary_physics, endless_counts, ramp_steps
from ..knit.cloth import Cloth
from ..mesh.layout import SLIDE_ALLOWANCE, estimated_nodes
from ..mesh.panel import table_lead
from ..mesh.rest_table import rest_table
from ..mesh.smaller import smaller_scene
from ..numerics import thread_count
from ..scene import Scene
from ..scene.presets import PRESETS
from .limits import tight_loops
from .model import build_model
from .numerics import choose_numerics
from .step import NODES_A_THREAD

COUNTED_NODES = 2_000_000  # meshes up to here are laid out to be counted: a second or two
ESTIMATE_FACTOR = 3  # steps and time may be off by so much either way

# Measured on the Atlas-Atlas mesh of scenes/atlas_cell.toml: 13,750, 21,350 and 31,250 steps to 5, 10 and 20 levels.
STEPS_TO_LOAD = 10_000.0  # of a stage, at MEASURED_NODES and MEASURED_TOLERANCE, however many levels it has
STEPS_PER_LEVEL = 800.0
MEASURED_NODES = 24  # a loop
NODES_POWER = 1.25  # steps of the cell by nodes a loop: 6,600 at 8, 11,700 at 16, 17,500 at 27, 85,000 at 54
MEASURED_TOLERANCE = 3e-3
TOLERANCE_POWER = 1 / 3  # 11,500 steps at 1e-2, 30,750 at 3e-4
STEPS_FROM_SMALLER = 2_000.0  # of a level of a large mesh, which starts from a smaller one: 1,550 to 2,600 measured
STEPS_FROM_REPEAT = 15_000.0  # of a level of a mesh cut along another outline than a rectangle: 7,000 to 20,000 measured
SMALLER_SHARE = 1.4  # time of a large mesh with its looks and its smaller meshes over that of its steps
GRIPPED = 2.5  # times the steps of a tile: 1 to 4 at the standard preset, 2 to 3 at draft, 2 x 2 to 7 x 6 repeats
TENSION_STATES = 10.0  # steady states tried for a level that is driven by tension

STEP_TIME = 10e-6  # [s] of a step on the CPU, however few nodes: launches, and a look at the state every 50 steps
NODE_STEPS_PER_S = {"single": 1.6e8, "double": 9e7}  # beyond that, on one core, with contacts
NODE_STEPS_PER_S_FROM_MEMORY = {"single": 1.1e8, "double": 5e7}
MEMORY_RULES = 4_000_000  # nodes from which the caches no longer help


def relax_steps(scene: Scene, spacing: float) -> int:
    """Steps of a relaxation with nodes `spacing` [m] apart, from what the Atlas-Atlas mesh took.

    Steps go with n^NODES_POWER (n nodes a loop) where bending rules the fictitious masses; there are sqrt(s*/s) times as
    many where the softened stretch rules them, s* = 0.6 (2 h/d)^2 being the softening at which both are equal. A
    tile takes the same number whatever its size, as the interior moves with its boundary. A large mesh starts from a smaller one.
    """
    solver = scene.solver
    if smaller_scene(scene) is not None:
        if scene.panel.outline != "rectangle":
            return round(STEPS_FROM_REPEAT * len(scene.stages) * scene.output.frames)
        states = sum(2.0 if any(stage.by_tension) else 1.0 for stage in scene.stages)
        return round(states * STEPS_FROM_SMALLER * scene.output.frames)
    n = scene.model.nodes_per_loop
    balance = 0.6 * (2.0 * spacing / scene.wire.diameter) ** 2
    work = (n / MEASURED_NODES) ** NODES_POWER * math.sqrt(max(1.0, balance / solver.axial_softening))
    work *= (MEASURED_TOLERANCE / solver.residual_tolerance) ** TOLERANCE_POWER
    if scene.hook is not None:
        work *= HOOKED
    elif scene.model.boundary == "gripped":
        work *= GRIPPED
    total = 0.0
    for stage in scene.stages:
        states = TENSION_STATES if any(stage.by_tension) else 1.0
        steps = states * work * (STEPS_TO_LOAD + STEPS_PER_LEVEL * scene.output.frames)
        if solver.max_steps is not None:
            steps = min(steps, states * scene.output.frames * solver.max_steps)
        total += steps
    return max(1, round(total))


def wall_time(scene: Scene, steps: int, nodes: int) -> float:
    """Time [s] of so many steps on this machine's cores, without compilation and files."""
    rates = NODE_STEPS_PER_S if nodes < MEMORY_RULES else NODE_STEPS_PER_S_FROM_MEMORY
    time = steps * (STEP_TIME + nodes / (rates[scene.solver.precision] * thread_count(nodes // NODES_A_THREAD)))
    if scene.solver.drive == "relax" and smaller_scene(scene) is not None:
        time *= SMALLER_SHARE
    return time


def size_of(scene: Scene, cloth: Cloth | None) -> tuple[Size, bool]:
    """The sizes of a scene's mesh, and whether they are exact: large meshes are not built to be counted. What a run would
    refuse is refused."""
    if cloth is not None and estimated_nodes(scene, cloth) > COUNTED_NODES:
        return _endless(scene, cloth), False
    model = build_model(scene, "cpu")
    size = Size(
        nodes=model.node_count,
        wires=len(model.panel.wire_first),
        bodies=model.panel.body_count,
        spacing=float(model.table.spacing.min()),
        softening=model.softening,
        time_step=model.time_step,
        limited_by=model.limited_by,
        loading_time=model.loading_time,
    )
    return size, True


def _endless(scene: Scene, cloth: Cloth) -> Size:
    nodes, wires, bodies = endless_counts(scene, cloth)
    spacing = cloth.stitch_length / scene.model.nodes_per_loop
    table = rest_table(
        cloth,
        nodes_per_loop=scene.model.nodes_per_loop,
        set_fraction=scene.wire.set_fraction,
        lead=table_lead(cloth, 0.8 * spacing, SLIDE_ALLOWANCE * cloth.stitch_length),
    )
    numbers = choose_numerics(scene, table, cloth.stitch_length)
    return Size(
        nodes=nodes,
        wires=wires,
        bodies=bodies,
        spacing=float(table.spacing.min()),
        softening=numbers.softening,
        time_step=numbers.time_step,
        limited_by=numbers.limited_by,
        loading_time=numbers.loading_time,
    )


def cost_of(scene: Scene, size: Size) -> Cost:
    """What a run takes."""
    if scene.solver.drive == "ramp":
        steps = ramp_steps(scene, size.loading_time, size.time_step)
    else:
        steps = relax_steps(scene, size.spacing)
    return Cost(steps, wall_time(scene, steps, size.nodes))


def map_time(scene: Scene, size: Size) -> float | None:
    """[s] of the map of a scene: not estimated, as its loads go side by side."""
    return None


def notes(scene: Scene, size: Size) -> Notes:
    """What is known of these estimates, and of the accuracy."""
    return Notes(ESTIMATE_FACTOR, "", f"bodies, {2 * size.bodies:,} pairs", _accuracy(scene))


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


def physics(scene: Scene, size: Size) -> Iterator[str]:
    """What the scene switches on and why, a sentence each."""
    wire, solver = scene.wire, scene.solver
    yield f"stretching: wires carry tension, EA = {wire.axial_stiffness:.3g} N"
    yield f"bending: wires resist a change of curvature, EI = {wire.bending_stiffness:.3g} N m2"
    if scene.hook is not None:
        yield f"contact: one place, carried by contact.treatment = {scene.contact.treatment!r}"
        yield HOOK_ENDS
    else:
        if size.bodies:
            merged = "nested lenses merged" if scene.model.merge_lenses else "one for each lens, model.merge_lenses = false"
            yield f"contact: wires hook in {size.bodies:,} places, each with a body between its two wires ({merged})"
        yield from boundary_physics(scene)
        if solver.drive == "relax" and (smaller := smaller_scene(scene)) is not None:
            repeats = " x ".join(map(str, smaller.knit.repeats))
            yield f"multilevel start: a smaller mesh of {repeats} repeats is brought to equilibrium first, and so on down"
    if size.softening != 1.0:
        yield f"softening: wires stretch {size.softening:g} times as easily in the dynamics, solver.axial_softening"
    if solver.drive == "relax" and solver.multipliers:
        yield "augmented Lagrangian: multipliers take out what softening and contact penalty change, solver.multipliers"


def limitations(scene: Scene, cloth: Cloth | None) -> Iterator[str]:
    """What a run in the plane would not show."""
    if cloth is not None:
        yield from tight_loops(scene, cloth)
