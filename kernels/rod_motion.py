"""Time step of rods: sums stretch, bending, twist, contact and loads; then, with the accelerations
(banded_mass.py), updates nodes and sections.

    n_j = T_j t_j + (gradient of bending and twist by edge j) + t_j x c_j/|e_j|       f_i = n_i - n_(i-1) + contact + load
    torque of segment j = - gradient by its angle + t_j . c_j + load

c_j is the contact couple on the section of segment j.

Velocities and spins follow the two-term update of control.py.
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

NODE_BLOCK = 64  # nodes that share one row of `partial`

HELD_NODE = wp.constant(1)  # the node is fixed
HELD_TURN = wp.constant(2)  # the section of the segment behind the node does not rotate about it


@wp.func
def edge_gradient(
    segment: int,
    end: int,
    tension: wp.float64,
    tangent: wp.array(dtype=wp.vec3d),
    edge_gradient_before: wp.array(dtype=wp.vec3d),
    edge_gradient_after: wp.array(dtype=wp.vec3d),
    contact_couple: wp.array(dtype=wp.vec3d),
    length: wp.array(dtype=wp.float64),
) -> wp.vec3d:
    """[N] gradient of the energy by the edge from node `segment` to node `end`."""
    t = tangent[segment]
    return (
        tension * t
        + edge_gradient_after[segment]
        + edge_gradient_before[end]
        + wp.cross(t, contact_couple[segment]) / length[segment]
    )


@wp.kernel
def sum_rod_forces(
    # in: wires
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    natural_length: wp.array(dtype=wp.float64),
    stretch_stiffness: wp.array(dtype=wp.float64),
    load_force: wp.array(dtype=wp.vec3d),
    load_torque: wp.array(dtype=wp.float64),
    # in: what steers the step
    control: wp.array(dtype=wp.float64),
    # state in
    tension_offset: wp.array(dtype=wp.float64),
    length: wp.array(dtype=wp.float64),
    tangent: wp.array(dtype=wp.vec3d),
    edge_gradient_before: wp.array(dtype=wp.vec3d),
    edge_gradient_after: wp.array(dtype=wp.vec3d),
    angle_gradient_before: wp.array(dtype=wp.float64),
    angle_gradient_after: wp.array(dtype=wp.float64),
    contact_couple: wp.array(dtype=wp.vec3d),
    # in and out: contact forces, set to zero for the next step
    contact_force: wp.array(dtype=wp.vec3d),
    # out
    force: wp.array(dtype=wp.vec3d),
    torque: wp.array(dtype=wp.float64),
):
    """One thread a node. `force` [N] and `torque` [N m] include the forces that held nodes react to."""
    i = wp.tid()
    f = contact_force[i] + load_force[i]
    axial_torque = load_torque[i]
    contact_force[i] = wp.vec3d()
    factor = control[LENGTH_FACTOR]
    j = following[i]
    if j >= 0:
        tension = axial_force(length[i], natural_length[i] * factor, stretch_stiffness[i], tension_offset[i])
        f += edge_gradient(i, j, tension, tangent, edge_gradient_before, edge_gradient_after, contact_couple, length)
        axial_torque += wp.dot(contact_couple[i], tangent[i]) - angle_gradient_after[i] - angle_gradient_before[j]
    h = previous[i]
    if h >= 0:
        tension = axial_force(length[h], natural_length[h] * factor, stretch_stiffness[h], tension_offset[h])
        f -= edge_gradient(h, i, tension, tangent, edge_gradient_before, edge_gradient_after, contact_couple, length)
    force[i] = f
    torque[i] = axial_torque


@wp.kernel
def move_rods(
    # in
    node_mass: wp.array(dtype=wp.vec3d),
    spin_inertia: wp.array(dtype=wp.float64),
    control: wp.array(dtype=wp.float64),
    force: wp.array(dtype=wp.vec3d),
    acceleration: wp.array(dtype=wp.vec3d),
    spin_acceleration: wp.array(dtype=wp.float64),
    # state in and out
    displacement: wp.array(dtype=wp.vec3d),
    velocity: wp.array(dtype=wp.vec3d),
    spin: wp.array(dtype=wp.float64),
    angle: wp.array(dtype=wp.float64),
    force_sum: wp.array(dtype=wp.vec3d),
    # out
    pending_turn: wp.array(dtype=wp.float64),
    partial: wp.array2d(dtype=wp.float64),
):
    """One thread a node. The kinetic energy is that of the diagonal masses."""
    i = wp.tid()
    if control[STATUS] != STATUS_RUNNING:
        return
    a = control[VELOCITY_FACTOR]
    b = control[FORCE_FACTOR]
    dt = control[TIME_STEP]
    ahead = control[LOOK_AHEAD]
    before = velocity[i]
    after = a * before + b * acceleration[i]
    spin_before = spin[i]
    spin_after = a * spin_before + b * spin_acceleration[i]
    velocity[i] = after
    spin[i] = spin_after
    displacement[i] = displacement[i] + dt * (after + ahead * (after - before))
    move = dt * (spin_after + ahead * (spin_after - spin_before))
    pending_turn[i] = move
    angle[i] = angle[i] + move
    force_sum[i] = force_sum[i] + force[i]
    force_square = wp.where(wp.length_sq(acceleration[i]) > wp.float64(0.0), wp.length_sq(force[i]), wp.float64(0.0))
    speed_square = wp.dot(after, after)
    row = i / NODE_BLOCK
    wp.atomic_add(
        partial, row, KINETIC_PART, wp.dot(node_mass[i], wp.cw_mul(after, after)) + spin_inertia[i] * spin_after * spin_after
    )
    wp.atomic_max(partial, row, SPEED_PART, speed_square)
    wp.atomic_max(partial, row, STRONGEST_PART, force_square)
    wp.atomic_add(partial, row, FORCE_PART, force_square)
