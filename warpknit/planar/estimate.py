"""Steps and time of a planar run, from measurements."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

from ..base.text import engineering, rounded
from ..knit.cloth import Cloth
from ..mechanics.estimate import (
    HOOK_ENDS,
    HOOKED,
    Cost,
    GpuTimes,
    Notes,
    Size,
    boundary_physics,
    endless_counts,
    gpu_time,
    multilevel_start,
    ramp_steps,
)
from ..mechanics.numerics import thread_count
from ..mechanics.protocols import TOO_THICK
from ..mesh.layout import SLIDE_ALLOWANCE, estimated_nodes
from ..mesh.panel import table_lead
from ..mesh.rest_table import rest_table
from ..mesh.smaller import smaller_scene
from ..scene import Scene
from ..scene.presets import PRESETS
from .limits import tight_loops
from .model import build_model
from .numerics import choose_numerics
from .step import NODES_A_THREAD

COUNTED_NODES = 2_000_000  # larger meshes are not built for their exact size
ESTIMATE_FACTOR = 3  # uncertainty of steps and time

# Measured on the Atlas-Atlas mesh of scenes/atlas_cell.toml: 13,750, 21,350 and 31,250 steps to 5, 10 and 20 levels.
STEPS_TO_LOAD = 10_000.0  # of a stage, at MEASURED_NODES and MEASURED_TOLERANCE, independent of the levels
STEPS_PER_LEVEL = 800.0
MEASURED_NODES = 24  # a loop
NODES_POWER = 1.25  # steps of the cell by nodes a loop: 6,600 at 8, 11,700 at 16, 17,500 at 27, 85,000 at 54
MEASURED_TOLERANCE = 3e-3
TOLERANCE_POWER = 1 / 3  # 11,500 steps at 1e-2, 30,750 at 3e-4
STEPS_FROM_SMALLER = 1_000.0  # of a level of a large mesh with multilevel start: 650 to 1,800 measured
STEPS_FROM_REPEAT = 15_000.0  # of a level of a mesh with another outline than a rectangle: 7,000 to 20,000 measured
SMALLER_SHARE = 1.6  # time of a large mesh, checks and smaller meshes included, over that of its steps
GRIPPED = 3.0  # factor on the steps of a tile: 1 to 4 at the standard preset, 2 to 3 at draft, 2 x 2 to 7 x 6 repeats
TENSION_STATES = 4.0  # times the steps of a level that goes by strain

STEP_TIME = 20e-6  # [s] overhead of a step on the CPU: launches, and a convergence check every 50 steps
RECORD_TIME = 0.01  # [s] to measure and write a state
NODE_STEPS_PER_S = {"single": 1.6e8, "double": 9e7}  # on one core, with contacts
NODE_STEPS_PER_S_FROM_MEMORY = {"single": 7e7, "double": 3.5e7}  # two machines measured, 3e7 and 1.1e8 in single
REPLICA_NODE_STEPS_PER_S = 2.5e7  # on one core, of the many small meshes of a map with their checks
MEMORY_BOUND_NODES = 4_000_000  # nodes from which steps are limited by memory bandwidth
# by the million and a panel of 30 x 30 repeats
GPU = GpuTimes(
    node=5e-7, step=35e-6, node_step=1.4e-10, check=5e-3, node_check=3.3e-9, node_record=5e-8, check_steps=50, smaller=9.0
)  # fmt: skip


def relax_steps(scene: Scene, spacing: float) -> int:
    """Steps of a relaxation at a node spacing [m], from measurements on the Atlas-Atlas mesh.

    Steps scale with n^NODES_POWER (n nodes a loop) where bending determines the fictitious masses, and sqrt(s*/s) times more
    where softened stretch does; s* = 0.6 (2 h/d)^2 is the softening at which both are equal. The number does not depend on the
    size of a tile, as its interior follows the boundary. A large mesh has a multilevel start.
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
    """Time [s] of `steps` on this machine's cores, without compilation and files."""
    rates = NODE_STEPS_PER_S if nodes < MEMORY_BOUND_NODES else NODE_STEPS_PER_S_FROM_MEMORY
    time = steps * (STEP_TIME + nodes / (rates[scene.solver.precision] * thread_count(nodes // NODES_A_THREAD)))
    if scene.solver.drive == "relax" and smaller_scene(scene) is not None:
        time *= SMALLER_SHARE
    return time + RECORD_TIME * (1 + scene.output.frames * len(scene.stages))


def size_of(scene: Scene, cloth: Cloth | None) -> tuple[Size, bool]:
    """Sizes of the mesh of a scene, and whether they are exact (large meshes are not built). Raises the errors of a run."""
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
        notes=model.panel.notes,
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
    numerics = choose_numerics(scene, table, cloth.stitch_length)
    return Size(
        nodes=nodes,
        wires=wires,
        bodies=bodies,
        spacing=float(table.spacing.min()),
        softening=numerics.softening,
        time_step=numerics.time_step,
        limited_by=numerics.limited_by,
        loading_time=numerics.loading_time,
    )


def cost_of(scene: Scene, size: Size) -> Cost:
    """Cost of a run."""
    if scene.solver.drive == "ramp":
        steps = ramp_steps(scene, size.loading_time, size.time_step)
        return Cost(steps, wall_time(scene, steps, size.nodes))
    steps = relax_steps(scene, size.spacing)
    return Cost(steps, wall_time(scene, steps, size.nodes), gpu_time(GPU, scene, steps, size.nodes))


def map_time(scene: Scene, size: Size, levels: Sequence[int]) -> float:
    """[s] of loads of a sweep with so many levels each, side by side on all cores."""
    assert scene.sweep is not None
    one = replace(scene, stages=(scene.sweep.stage(scene.stages[0], scene.sweep.pairs[-1]),))
    steps = relax_steps(one, size.spacing) * sum(levels) / scene.output.frames
    return steps * size.nodes / (REPLICA_NODE_STEPS_PER_S * thread_count(max(1, len(levels))))


def notes(scene: Scene, size: Size) -> Notes:
    """Remarks on estimates and accuracy."""
    return Notes(ESTIMATE_FACTOR, "", f"bodies, {2 * size.bodies:,} pairs", _accuracy(scene))


def _accuracy(scene: Scene) -> str:
    """Expected error of the settings of the scene, in words."""
    name = scene.preset_in_force
    if name is None:
        return "not known for these settings; `run --error PERCENT` chooses and checks settings on this scene"
    preset = PRESETS[name]
    grips = ", more for short wires between grips" if scene.model.boundary == "gripped" and scene.hook is None else ""
    return (
        f"{name}: within {preset.error_percent:g} % on a repeat of the double atlas mesh{grips}, for"
        f" {rounded(preset.node_steps):,} node-steps a load level; `run --error` measures it on this scene"
    )


def physics(scene: Scene, size: Size) -> Iterator[str]:
    """Physics that the scene switches on and why, one sentence each."""
    wire, solver = scene.wire, scene.solver
    yield f"stretching: wires carry tension, EA = {engineering(wire.axial_stiffness, 'N')}"
    yield f"bending: wires resist a change of curvature, EI = {engineering(1e6 * wire.bending_stiffness, 'N mm2')}"
    if scene.hook is not None:
        yield f"contact: one place, contact.treatment = {scene.contact.treatment!r}"
        yield HOOK_ENDS
    else:
        if size.bodies:
            merged = "nested lenses merged" if scene.model.merge_lenses else "one for each lens, model.merge_lenses = false"
            yield f"contact: {size.bodies:,} hooks, each a body between two wires ({merged})"
        yield from boundary_physics(scene)
        if solver.drive == "relax":
            yield from multilevel_start(smaller_scene(scene))
    if size.softening != 1.0:
        yield f"softening: axial stiffness divided by {size.softening:g} in the dynamics, solver.axial_softening"
    if solver.drive == "relax" and solver.multipliers:
        yield "augmented Lagrangian: multipliers correct the errors of softening and contact penalty, solver.multipliers"


def overlaps_as_knitted(scene: Scene, repeat: Cloth) -> Iterator[str]:
    """Warning where bodies of a repeat have no room as knitted. Those of merged lenses do not count: they may move aside."""
    reach = 0.5 * scene.wire.thickness + scene.model.body_radius
    narrow = [clasp for clasp in repeat.clasps if clasp.lenses == 1 and sum(arm.clearance for arm in clasp.arms) < 2.0 * reach]
    if narrow:
        of_all = f"{2 * len(narrow)} of {2 * len(repeat.clasps)} pairs of a repeat"
        yield f"at least {of_all} are active as knitted: {TOO_THICK}"


def limitations(scene: Scene, cloth: Cloth | None) -> Iterator[str]:
    """Limitations of the planar model for this scene."""
    if cloth is not None:
        yield from tight_loops(scene, cloth)
