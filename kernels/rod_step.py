"""The update of rods: stretch, what bending and twist pull with, contact and loads are summed, then nodes move and sections spin.

    n_j = T_j t_j + (gradient of bending and twist by edge j) + t_j x c_j/|e_j|       f_i = n_i - n_(i-1) + contact + load
    torque of segment j = - gradient by its angle + t_j . c_j + load

c_j is the couple of contact on the section of the segment, which turns with it.

Nodes and spins follow the two-term update of control.py.
"""

import warp as wp

from .control import (
    FORCE_FACTOR,
    FORCE_PART,
    KINETIC_PART,
    LENGTH_FACTOR,
    LOOK_AHEAD,
    SPEED_PART,
    STATUS,
    STATUS_RUNNING,
    STRONGEST_PART,
    TIME_STEP,
    VELOCITY_FACTOR,
)
from .stretch import axial_force

NODE_BLOCK = 64  # nodes whose sums go into one row

HELD_NODE = wp.constant(1)  # a node stays where it is
HELD_TURN = wp.constant(2)  # the section of the segment behind the node does not turn about it


@wp.func
def segment_pull(
    segment: int,
    end: int,
    tension: wp.float64,
    tangent: wp.array(dtype=wp.vec3d),
    pull_before: wp.array(dtype=wp.vec3d),
    pull_after: wp.array(dtype=wp.vec3d),
    contact_couple: wp.array(dtype=wp.vec3d),
    length: wp.array(dtype=wp.float64),
) -> wp.vec3d:
    """[N] gradient of the energy by the edge from node `segment` to node `end`."""
    t = tangent[segment]
    return tension * t + pull_after[segment] + pull_before[end] + wp.cross(t, contact_couple[segment]) / length[segment]


@wp.kernel
def step_rods(
    # in: wires
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    held: wp.array(dtype=wp.int32),
    natural_length: wp.array(dtype=wp.float64),
    node_mass: wp.array(dtype=wp.float64),
    spin_inertia: wp.array(dtype=wp.float64),
    stretch_stiffness: wp.array(dtype=wp.float64),
    load_force: wp.array(dtype=wp.vec3d),
    load_torque: wp.array(dtype=wp.float64),
    # in: what steers the step
    control: wp.array(dtype=wp.float64),
    # state in
    tension_offset: wp.array(dtype=wp.float64),
    length: wp.array(dtype=wp.float64),
    tangent: wp.array(dtype=wp.vec3d),
    pull_before: wp.array(dtype=wp.vec3d),
    pull_after: wp.array(dtype=wp.vec3d),
    torque_before: wp.array(dtype=wp.float64),
    torque_after: wp.array(dtype=wp.float64),
    contact_couple: wp.array(dtype=wp.vec3d),
    # in and out: what contact adds, then zero for the next step
    contact_force: wp.array(dtype=wp.vec3d),
    # state in and out
    displacement: wp.array(dtype=wp.vec3d),
    velocity: wp.array(dtype=wp.vec3d),
    spin: wp.array(dtype=wp.float64),
    angle: wp.array(dtype=wp.float64),
    # out
    turn: wp.array(dtype=wp.float64),
    force: wp.array(dtype=wp.vec3d),
    torque: wp.array(dtype=wp.float64),
    partial: wp.array2d(dtype=wp.float64),
):
    """One thread a node. `force` [N] and `torque` [N m] are the sums without holding, for who asks for reactions."""
    i = wp.tid()
    f = contact_force[i] + load_force[i]
    about = load_torque[i]
    contact_force[i] = wp.vec3d()
    factor = control[LENGTH_FACTOR]
    j = following[i]
    if j >= 0:
        tension = axial_force(length[i], natural_length[i] * factor, stretch_stiffness[i], tension_offset[i])
        f += segment_pull(i, j, tension, tangent, pull_before, pull_after, contact_couple, length)
        about += wp.dot(contact_couple[i], tangent[i]) - torque_after[i] - torque_before[j]
    h = previous[i]
    if h >= 0:
        tension = axial_force(length[h], natural_length[h] * factor, stretch_stiffness[h], tension_offset[h])
        f -= segment_pull(h, i, tension, tangent, pull_before, pull_after, contact_couple, length)
    force[i] = f
    torque[i] = about
    if control[STATUS] != STATUS_RUNNING:
        return
    if (held[i] & HELD_NODE) != 0:
        f = wp.vec3d()
    if (held[i] & HELD_TURN) != 0 or j < 0:
        about = wp.float64(0.0)
    a = control[VELOCITY_FACTOR]
    b = control[FORCE_FACTOR]
    dt = control[TIME_STEP]
    ahead = control[LOOK_AHEAD]
    mass = node_mass[i]
    inertia = spin_inertia[i]
    before = velocity[i]
    after = a * before + (b / mass) * f
    spin_before = spin[i]
    spin_after = a * spin_before + (b / inertia) * about
    velocity[i] = after
    spin[i] = spin_after
    displacement[i] = displacement[i] + dt * (after + ahead * (after - before))
    move = dt * (spin_after + ahead * (spin_after - spin_before))
    turn[i] = move
    angle[i] = angle[i] + move
    force_square = wp.dot(f, f)
    speed_square = wp.dot(after, after)
    row = i / NODE_BLOCK
    wp.atomic_add(partial, row, KINETIC_PART, mass * speed_square + inertia * spin_after * spin_after)
    wp.atomic_max(partial, row, SPEED_PART, speed_square)
    wp.atomic_max(partial, row, STRONGEST_PART, force_square)
    wp.atomic_add(partial, row, FORCE_PART, force_square)
