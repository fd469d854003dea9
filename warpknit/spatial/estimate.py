"""What a run of the spatial model would take, and which physics it switches on, without running it.

Measured by tools/benchmarks/plan.py on the scenes that it lists, with and without contact.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ..base.text import engineering, rounded, short_percent
from ..knit.cloth import Cloth
from ..mechanics.estimate import (
    HOOK_ENDS,
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
from ..mesh.layout import estimated_nodes
from ..mesh.load_point import PATH_STRAIN
from ..mesh.smaller import smaller_scene
from ..scene import Scene, Stage
from ..scene.presets import PRESETS
from ..wires.centre_lines import Wires
from ..wires.overlaps import find_overlaps
from .model import SpatialModel, build_model
from .nearby import pair_gaps
from .search_cells import search_cells

COUNTED_NODES = 50_000  # meshes up to here are laid out to be counted: five seconds
SPATIAL_FACTOR = 3  # steps and time of the scenes measured are off by so much either way
SLOW_LEVELS = "a level at which contacts of a tight knit come and go may take ten times as long"  # seen on a locknit

STEPS_A_LEVEL = 600.0  # however many nodes
MEASURED_TOLERANCE, TOLERANCE_POWER = 1e-2, 0.12
# times the steps of a level that goes by strain, and of the first one beside: 40 runs of one repeat within a factor of 3;
# tight knits, where the search goes on beyond snap-throughs, within 2
TENSION_STATES, FIRST_STATES = 3, 9
MAP_STATES = 1.8  # times the steps of a level, of a map to 20 %: 1.4 on a double atlas, 1.9 on a tricot, 2.4 on a reverse locknit
FREE_STATES = 2  # the same of a direction without tension: 0.6 to 8 on tight knits
GRIPPED = 3.0  # times the steps of a tile, of levels that go by strain: those by tension take as many
FROM_SMALLER = 1.4  # the same of a gripped mesh that starts from a smaller one: 775 steps
FROM_REPEAT = 0.2  # the same of a tile that starts from one repeat: 125 steps
SMALLER_SHARE = 2.0  # time of a gripped mesh with its smaller meshes over that of its own steps: 1.5 to 3
HOOKED = 2.0  # the same of two hooked wires
FROM_FILE = 0.7  # the same of wires from a file, by their loop_size

# time [s] of a step on one core
STEP_TIME = 80e-6  # however few nodes, with its share of a convergence check
NODE_TIME = 0.12e-6
PAIR_TIME = 0.01e-6  # of two segments that are near each other, most of which sleep
CLOSE_TIME = 0.3e-6  # more of two that touch or nearly do so, at rest
SITE_TIME = 1.2e-6  # of a place of hooking, whose wires touch for some of the levels
START_TIME = 3.5  # [s] of each process of a map, side by side: imports, kernels, model
CLOSE = 0.3  # thicknesses between surfaces
# by the million alone
GPU = GpuTimes(
    node=3.3e-6, step=7e-5, node_step=1.2e-9, check=3e-3, node_check=1e-8, node_record=3.1e-7, check_steps=25, smaller=8.0
)  # fmt: skip
PAIRS_OF_NODE = 0.45  # pairs of segments near each other: 0.40 and 0.44 on the double atlas, 3.3 on a tight tricot


def size_of(scene: Scene, cloth: Cloth | None) -> tuple[Size, bool]:
    """The sizes of a scene's mesh, and whether they are exact: large meshes are not built to be counted. What a run would
    refuse is refused."""
    counted = cloth is None or estimated_nodes(scene, cloth) <= COUNTED_NODES
    if cloth is not None and not counted and scene.solver.drive == "relax":
        nodes, wires, bodies = endless_counts(scene, cloth)
        return endless_size(nodes, wires, bodies), False
    return size_of_model(build_model(scene)), counted


def size_of_model(model: SpatialModel) -> Size:
    """The sizes of a mesh."""
    rods = model.rods
    gaps = pair_gaps(rods, search_cells(rods, model.curve))
    return Size(
        nodes=rods.node_count,
        wires=len(rods.wire_first),
        bodies=model.panel.body_count,
        near=len(gaps),
        close=int(np.count_nonzero(gaps < CLOSE * rods.section.thickness)),
        time_step=model.time_step,
        limited_by=model.limited_by,
        loading_time=model.loading_time,
        notes=model.panel.notes,
    )


def endless_size(nodes: int, wires: int, bodies: int) -> Size:
    """The sizes of a mesh too large to be laid out for an estimate."""
    return Size(nodes, wires, bodies, near=round(PAIRS_OF_NODE * nodes))


def cost_of(scene: Scene, size: Size) -> Cost:
    """What a run takes, on one core."""
    if scene.solver.drive == "ramp":
        steps = ramp_steps(scene, size.loading_time, size.time_step)
    else:
        steps = spatial_steps(scene)
    size = replace(size, near=size.near or round(PAIRS_OF_NODE * size.nodes))
    seconds = spatial_time(steps, size)
    smaller = _smaller(scene)
    if smaller is not None and scene.model.boundary == "gripped":
        seconds *= SMALLER_SHARE
    elif smaller is not None:  # the repeat that a tile starts from
        part = 1.0 / math.prod(scene.knit.repeats)
        counts = {name: round(part * getattr(size, name)) for name in ("nodes", "bodies", "near", "close")}
        seconds += spatial_time(spatial_steps(smaller), replace(size, **counts))
    return Cost(steps, seconds, None if scene.solver.drive == "ramp" else gpu_time(GPU, scene, steps, size.nodes))


def _smaller(scene: Scene) -> Scene | None:
    """The scene of the smaller mesh from which a relaxation starts; not with an edge that moves (model.py)."""
    is_knit = scene.hook is None and scene.wires is None
    return smaller_scene(scene) if is_knit and scene.solver.drive == "relax" and not scene.has_moving_edge else None


def map_time(scene: Scene, size: Size, levels: Sequence[int]) -> float:
    """[s] of loads of a sweep with so many levels each, one after the other in `thread_count` processes."""
    assert scene.sweep is not None
    if not levels:
        return 0.0
    one = replace(scene, stages=(scene.sweep.stage(scene.stages[0], scene.sweep.pairs[-1]),))
    far = 1.0 if scene.sweep.by_tension else MAP_STATES
    return START_TIME + far * sum(levels) / scene.output.frames / thread_count(len(levels)) * cost_of(one, size).seconds


def notes(scene: Scene, size: Size) -> Notes:
    """What is known of these estimates, and of the accuracy."""
    return Notes(
        SPATIAL_FACTOR, SLOW_LEVELS, f"places where wires hook each other, {2 * size.bodies:,} pairs", spatial_accuracy(scene)
    )


def spatial_steps(scene: Scene) -> int:
    """Steps of a relaxation in space."""
    work = (MEASURED_TOLERANCE / scene.solver.residual_tolerance) ** TOLERANCE_POWER
    if scene.hook is not None:
        work *= HOOKED
    elif _smaller(scene) is not None:
        work *= FROM_SMALLER if scene.model.boundary == "gripped" else FROM_REPEAT
    if scene.wires is not None:
        work *= FROM_FILE
    befores = (None, *scene.stages[:-1])
    states = sum(_states(scene, stage, before) for stage, before in zip(scene.stages, befores, strict=True))
    return round(states * STEPS_A_LEVEL * work)


def _states(scene: Scene, stage: Stage, before: Stage | None) -> float:
    """Steady states of a stage that comes after another, in those of a tile by strain."""
    levels = scene.output.frames
    if any(stage.by_tension):
        if stage.tension_weft or stage.tension_warp:
            return levels * TENSION_STATES + (FIRST_STATES if before is None else 0)
        return levels * FREE_STATES
    grips = GRIPPED if scene.hook is None and scene.model.boundary == "gripped" and _smaller(scene) is None else 1.0
    if not scene.depends_on_path:
        return levels * grips
    farthest = max(
        abs((getattr(stage, key) or 0.0) - (getattr(before, key, None) or 0.0)) for key in ("strain_weft", "strain_warp", "shear")
    )
    return levels * grips * max(1, math.ceil(farthest / levels / PATH_STRAIN - 1e-9))


def spatial_time(steps: int, size: Size) -> float:
    """Time [s] of so many steps on one core."""
    nodes = NODE_TIME * size.nodes + SITE_TIME * size.bodies
    return steps * (STEP_TIME + nodes + PAIR_TIME * size.near + CLOSE_TIME * size.close)


def spatial_accuracy(scene: Scene) -> str:
    """What is known of the error of the scene's nodes."""
    if scene.hook is not None or scene.wires is not None:
        return "not measured on wires like these: run it again with other nodes to see what they are worth"
    if (name := scene.preset_in_force) is not None:
        preset = PRESETS[name].of("spatial", scene.solver.drive)
        more = f"; {scene.preset_caveat}" if scene.preset_caveat else ""
        return (
            f"{name}: within {preset.error_percent:g} % on a repeat of the double atlas mesh, for {rounded(preset.node_steps):,}"
            f" node-steps a load level{more}; `run --error` measures it on this scene"
        )
    return (
        f"{scene.model.nodes_per_loop} nodes a loop; on a repeat of the double atlas mesh 20 to 32 miss up to 2.1 % of"
        " tension and 1.2 % of contact forces, 48 miss 0.1 %; `run --error` measures it on this scene"
    )


def physics(scene: Scene, size: Size) -> Iterator[str]:
    """What the scene switches on and why, a sentence each."""
    wire = scene.wire
    yield f"stretching: wires carry tension, EA = {engineering(wire.axial_stiffness, 'N')}"
    yield f"bending: wires resist a change of curvature in space, EI = {engineering(1e6 * wire.bending_stiffness, 'N mm2')}"
    yield f"twist: wires resist being twisted, GJ = {engineering(1e6 * wire.twist_stiffness, 'N mm2')}"
    softer = "softening: wires stretch more easily in the dynamics"
    if scene.solver.drive == "relax":
        softer += "; multipliers take that out again"
    softer += ", solver.axial_softening"
    if scene.hook is not None:
        yield "contact: round wires touch each other anywhere; two wires hook once, over and under each other"
        yield softer
        yield HOOK_ENDS
        return
    yield f"contact: round wires touch each other anywhere; shares of active contacts are of {size.bodies:,} places"
    yield softer
    yield from boundary_physics(scene)
    yield from multilevel_start(_smaller(scene))


def overlaps_as_knitted(scene: Scene, repeat: Cloth) -> Iterator[str]:
    """Warning where wires of a repeat overlap as knitted."""
    threads = tuple(thread.points for thread in repeat.threads)
    kinds, along_warp = ("periodic",) * len(threads), np.tile([0, 1], (len(threads), 1))
    found = find_overlaps(Wires(threads, kinds, along_warp, repeat.size, None, None), scene.wire.thickness)
    if found.closest is not None and found.places:
        places = f"{found.places} place{'s' if found.places > 1 else ''}"
        depth = short_percent(1.0 - found.closest / scene.wire.thickness)
        yield f"as knitted, wires overlap in {places} of a repeat, by up to {depth} of their thickness: {TOO_THICK}"


def limitations(scene: Scene, cloth: Cloth | None) -> Iterator[str]:
    """What a run in space would not show."""
    yield from ()
