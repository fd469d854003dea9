"""Motion of rods: accelerations M a = f by the factors of banded_mass.py, and the update of nodes and sections.

    z_j = f_j - L(j, j-1) z_(j-1) - L(j, j-2) z_(j-2)         a_j = z_j/D_j - L(j+1, j) a_(j+1) - L(j+2, j) a_(j+2) - full rows

The sweep forward leaves z, the sweep back updates each node by the two-term update of control.py once its acceleration is known.
"""

from typing import Any

import warp as wp

from . import banded_mass, rod_blocks
from .control import STATUS, STATUS_RUNNING
from .native_text import native_text

MOTION_LANES = 512  # four numbers of the parts of a stretch of wire
PART = 4  # nodes of a part


@wp.func_native(native_text("rod_motion", globals(), vars(banded_mass), vars(rod_blocks)))
def move_wire(
    # in: wires
    wire: wp.int32,
    lane: wp.int32,
    wire_first: wp.array(dtype=wp.int32),
    wire_count: wp.array(dtype=wp.int32),
    wire_closed: wp.array(dtype=wp.int32),
    wire_border: wp.array(dtype=wp.int32),
    node_block: wp.array(dtype=wp.int32),
    block_rest: wp.array(dtype=wp.int32),
    # in: masses and their factors
    mass_factor: wp.array2d(dtype=Any),
    mass_border: wp.array2d(dtype=Any),
    wire_quiet: wp.array(dtype=wp.int32),
    node_mass: wp.array(dtype=wp.vec3d),
    spin_inertia: wp.array(dtype=wp.float64),
    # in: what steers the step; forces, torques and the sweep, from this node on
    control: wp.array(dtype=wp.float64),
    stored_from: wp.int32,
    force: wp.array(dtype=Any),
    torque: wp.array(dtype=Any),
    # state in and out
    displacement: wp.array(dtype=wp.vec3d),
    velocity: wp.array(dtype=Any),
    spin: wp.array(dtype=Any),
    angle: wp.array(dtype=Any),
    force_sum: wp.array(dtype=Any),
    block_travel: wp.array(dtype=wp.float64),
    # out
    sweep: wp.array(dtype=Any),
    pending_turn: wp.array(dtype=Any),
    block_speed: wp.array(dtype=wp.float64),
    partial: wp.array2d(dtype=wp.float64),
): ...


@wp.kernel(launch_bounds=(MOTION_LANES, 2), grid_stride=True)  # which spills less here
def move_rods(
    # in: wires
    wire_first: wp.array(dtype=wp.int32),
    wire_count: wp.array(dtype=wp.int32),
    wire_closed: wp.array(dtype=wp.int32),
    wire_border: wp.array(dtype=wp.int32),
    node_block: wp.array(dtype=wp.int32),
    block_rest: wp.array(dtype=wp.int32),
    first_wire: int,
    threads_a_block: int,
    # in: masses and their factors
    mass_factor: wp.array2d(dtype=Any),
    mass_border: wp.array2d(dtype=Any),
    wire_quiet: wp.array(dtype=wp.int32),
    node_mass: wp.array(dtype=wp.vec3d),
    spin_inertia: wp.array(dtype=wp.float64),
    # in: what steers the step; forces, torques and the sweep, from this node on
    world_nodes: int,
    control: wp.array2d(dtype=wp.float64),
    stored_from: wp.int32,
    force: wp.array(dtype=Any),
    torque: wp.array(dtype=Any),
    # state in and out
    displacement: wp.array(dtype=wp.vec3d),
    velocity: wp.array(dtype=Any),
    spin: wp.array(dtype=Any),
    angle: wp.array(dtype=Any),
    force_sum: wp.array(dtype=Any),
    block_travel: wp.array(dtype=wp.float64),
    # out
    sweep: wp.array(dtype=Any),
    pending_turn: wp.array(dtype=Any),
    block_speed: wp.array(dtype=wp.float64),
    partial: wp.array2d(dtype=wp.float64),
):
    """Move rods with `threads_a_block` threads a wire, and store a row of partial sums. One thread, or MOTION_LANES on a GPU. The
    kinetic energy uses diagonal masses.
    """
    thread = wp.tid()
    wire = first_wire + thread / threads_a_block
    own = control[wire_first[wire] / world_nodes]
    if own[STATUS] != STATUS_RUNNING:
        return
    move_wire(
        wire, thread % threads_a_block, wire_first, wire_count, wire_closed, wire_border, node_block, block_rest, mass_factor,
        mass_border, wire_quiet, node_mass, spin_inertia, own, stored_from, force, torque, displacement, velocity, spin, angle,
        force_sum, block_travel, sweep, pending_turn, block_speed, partial,
    )  # fmt: skip
