"""What a run of the spatial model would take, and which physics it switches on, without running it.

Measured on scenes/atlas_cell_spatial.toml, in four levels at a tolerance of 1e-2: 5,450 steps a level at 40 nodes a loop,
12,900 at 64.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from dataclasses import replace

from ..scene import Scene
from ..solve.step import CORES
from .relax import PATH_STRAIN

STEPS_A_LEVEL = 12_900.0
MEASURED_NODES, NODES_POWER = 64, 1.8
MEASURED_TOLERANCE, TOLERANCE_POWER = 1e-2, 1 / 3
TENSION_STATES = 6  # times the steps of a level that goes by strain: 4 to 9 at 20 mN/m both ways
STEP_TIME = 40e-6  # [s] of a step on the CPU, however few nodes
NODE_STEPS_PER_S = 4e6  # beyond that, with contact, on one core

HOOK_ENDS = "ends: the lower ones are clamped; the upper ones keep their direction, slide up and down, the right one is driven"


def spatial_steps(scene: Scene) -> int:
    """Steps of a relaxation in space."""
    work = (scene.model.nodes_per_loop / MEASURED_NODES) ** NODES_POWER
    work *= (MEASURED_TOLERANCE / scene.solver.residual_tolerance) ** TOLERANCE_POWER
    driven = sum(any(stage.by_tension) for stage in scene.stages)
    levels = (len(scene.stages) + (TENSION_STATES - 1) * driven) * scene.output.frames
    if scene.depends_on_path:
        strains = [abs(s or 0.0) for stage in scene.stages for s in (stage.strain_weft, stage.strain_warp, stage.shear)]
        levels = max(levels, math.ceil(sum(strains) / PATH_STRAIN))
    return round(levels * STEPS_A_LEVEL * work)


def spatial_time(steps: int, nodes: int) -> float:
    """Time [s] of so many steps on one core."""
    return steps * (STEP_TIME + nodes / NODE_STEPS_PER_S)


def process_count(loads: int) -> int:
    """Processes of one core each that share so many loads: WARPKNIT_THREADS, or one a core."""
    given = os.environ.get("WARPKNIT_THREADS", "")
    wanted = int(given) if given.isdecimal() else len(CORES)
    return max(1, min(wanted, len(CORES), loads))


def spatial_map_time(scene: Scene, nodes: int) -> float:
    """Time [s] of the map of a scene with a sweep: its loads by strain, one after the other in `process_count` processes."""
    assert scene.sweep is not None
    loads = len(set(scene.sweep.strain_weft)) * len(set(scene.sweep.strain_warp))
    one = replace(scene, stages=(replace(scene.stages[0], tension_weft=None, tension_warp=None),))
    return scene.sweep.seeds * math.ceil(loads / process_count(loads)) * spatial_time(spatial_steps(one), nodes)


def spatial_physics(scene: Scene, sites: int) -> Iterator[str]:
    """What the scene switches on and why, a sentence each."""
    wire = scene.wire
    yield f"stretching: wires carry tension, EA = {wire.axial_stiffness:.3g} N"
    yield f"bending: wires resist a change of curvature in space, EI = {wire.bending_stiffness:.3g} N m2"
    yield f"twist: wires resist being twisted, GJ = {wire.twist_stiffness:.3g} N m2"
    softer = "softening: wires stretch more easily in the dynamics"
    if scene.solver.drive == "relax":
        softer += "; running multipliers take that out again"
    softer += ", solver.axial_softening"
    if scene.hook is not None:
        yield "contact: round wires touch each other anywhere; two wires hook once, over and under each other"
        yield softer
        yield HOOK_ENDS
        return
    yield f"contact: round wires touch each other anywhere; the knit hooks them in {sites:,} places, which shares are counted by"
    yield softer
    if scene.model.boundary == "periodic":
        yield "periodic boundary: one tile of an endless mesh, model.boundary = 'periodic'"
    else:
        yield "grips: every cut wire end is held in position and direction, model.boundary = 'gripped'"
    yield "affine carry: the interior moves with the boundary, so that only what differs from it has to be solved"
