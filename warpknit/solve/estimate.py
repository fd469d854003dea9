"""Steps and time that a planar run would take, from what others took."""

from __future__ import annotations

import math

from ..mesh.smaller import smaller_scene
from ..numerics import thread_count
from ..planar.step import NODES_A_THREAD
from ..scene import Scene

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
HOOKED = 0.5  # times the steps of a tile with as many nodes a loop as a wire has: 0.3 to 1
TENSION_STATES = 10.0  # steady states tried for a level that is driven by tension
RAMP_SHARE = 1.2  # steps of a ramp over loading time/step at the start: 1.15 and 1.20, the step shrinks with the load
RAMP_BY_TENSION = 2.0  # times that, where the boundary has to find a tension: 1.9 on the cell at 5 mN/m both ways

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


def ramp_steps(scene: Scene, loading_time: float, time_step: float) -> int:
    """Steps of a ramp: the loading time [s] of each stage over the step [s] at its start, and a little more as that shrinks."""
    stages = sum(RAMP_BY_TENSION if any(stage.by_tension) else 1.0 for stage in scene.stages)
    return max(1, round(RAMP_SHARE * stages * loading_time / time_step))


def wall_time(scene: Scene, steps: int, nodes: int) -> float:
    """Time [s] of so many steps on this machine's cores, without compilation and files."""
    rates = NODE_STEPS_PER_S if nodes < MEMORY_RULES else NODE_STEPS_PER_S_FROM_MEMORY
    time = steps * (STEP_TIME + nodes / (rates[scene.solver.precision] * thread_count(nodes // NODES_A_THREAD)))
    if scene.solver.drive == "relax" and smaller_scene(scene) is not None:
        time *= SMALLER_SHARE
    return time
