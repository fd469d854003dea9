"""One explicit step of contact bodies on the ground, tied to anchors by springs.

    f = pairs - k d min(1, limit/(k |d|))        d = x - anchor

Without a limit this is a spring to the ground. With one it is a body on a plane with friction: the spring is the elastic slip,
the limit is the friction coefficient times the load on the plane. During a level of a relaxation the anchor is fixed, so that
the force does not depend on the path of the iteration. At its equilibrium, and in a ramp at every step, an anchor whose spring
is at the limit follows the body.

Displacements are relative to the affinely mapped rest shape, so the place on the ground is u + (F - I) X. The update is in
control.py.
"""

import warp as wp

from .control import (
    BODY_INVERSE_MASS,
    DRIVE,
    FORCE_FACTOR,
    FORCE_PART,
    GRADIENT,
    KINETIC_PART,
    LOOK_AHEAD,
    PARTIAL_COUNT,
    SPEED_PART,
    STATUS,
    STATUS_RUNNING,
    STRONGEST_PART,
    TIME_STEP,
    VELOCITY_FACTOR,
)  # fmt: skip


@wp.func
def moved_on_ground(control: wp.array(dtype=wp.float64), body_ux: wp.float64, body_uy: wp.float64, x: wp.float64, y: wp.float64):
    """Displacement [m] on the ground, from rest position (x, y)."""
    one = wp.float64(1.0)
    dx = body_ux + (control[GRADIENT] - one) * x + control[GRADIENT + 1] * y
    dy = body_uy + control[GRADIENT + 2] * x + (control[GRADIENT + 3] - one) * y
    return wp.vec2d(dx, dy)


@wp.func
def slipped(d: wp.vec2d, stiffness: wp.float64, limit: wp.float64):
    """Displacement [m] of the anchor of a spring of elongation d: the part above the limit."""
    length = wp.length(d)
    if stiffness * length <= limit:
        return wp.vec2d(wp.float64(0.0), wp.float64(0.0))
    return d * (wp.float64(1.0) - limit / (stiffness * length))


@wp.kernel
def step_anchored_bodies(
    # in: what steers the step
    control: wp.array(dtype=wp.float64),
    stiffness: wp.float64,
    limit: wp.float64,
    # in: rest data and contact
    body_origin_x: wp.array(dtype=wp.float64),
    body_origin_y: wp.array(dtype=wp.float64),
    pair_force: wp.array(dtype=wp.float64),
    pair_body_x: wp.array(dtype=wp.float64),
    pair_body_y: wp.array(dtype=wp.float64),
    # state in and out
    anchor_x: wp.array(dtype=wp.float64),
    anchor_y: wp.array(dtype=wp.float64),
    body_ux: wp.array(dtype=wp.float64),
    body_uy: wp.array(dtype=wp.float64),
    body_vx: wp.array(dtype=wp.float64),
    body_vy: wp.array(dtype=wp.float64),
    # in and out: anew
    body_partial: wp.array2d(dtype=wp.float64),
):
    """One thread steps all bodies: there are few. `anchor` [m] is a displacement on the ground."""
    if control[STATUS] != STATUS_RUNNING:
        return
    inverse_mass = control[BODY_INVERSE_MASS]
    ahead = control[LOOK_AHEAD]
    for column in range(PARTIAL_COUNT):
        body_partial[0, column] = wp.float64(0.0)
    for body in range(body_ux.shape[0]):
        f = wp.vec2d(wp.float64(0.0), wp.float64(0.0))
        for k in range(2):
            if pair_force[2 * body + k] != wp.float64(0.0):
                f += wp.vec2d(pair_body_x[2 * body + k], pair_body_y[2 * body + k])
        anchor = wp.vec2d(anchor_x[body], anchor_y[body])
        d = moved_on_ground(control, body_ux[body], body_uy[body], body_origin_x[body], body_origin_y[body]) - anchor
        slip = slipped(d, stiffness, limit)
        f -= stiffness * (d - slip)
        if control[DRIVE] != wp.float64(0.0):
            anchor_x[body] = anchor[0] + slip[0]
            anchor_y[body] = anchor[1] + slip[1]
        p = wp.vec2d(body_vx[body], body_vy[body])
        q = control[VELOCITY_FACTOR] * p + control[FORCE_FACTOR] * inverse_mass * f
        move = control[TIME_STEP] * (q + ahead * (q - p))
        body_vx[body] = q[0]
        body_vy[body] = q[1]
        body_ux[body] = body_ux[body] + move[0]
        body_uy[body] = body_uy[body] + move[1]
        body_partial[0, KINETIC_PART] += wp.dot(q, q) / inverse_mass
        body_partial[0, SPEED_PART] = wp.max(body_partial[0, SPEED_PART], wp.dot(q, q))
        body_partial[0, STRONGEST_PART] = wp.max(body_partial[0, STRONGEST_PART], wp.dot(f, f))
        body_partial[0, FORCE_PART] += wp.dot(f, f)


@wp.kernel
def draw_anchors(
    # in
    control: wp.array(dtype=wp.float64),
    stiffness: wp.float64,
    limit: wp.float64,
    body_origin_x: wp.array(dtype=wp.float64),
    body_origin_y: wp.array(dtype=wp.float64),
    body_ux: wp.array(dtype=wp.float64),
    body_uy: wp.array(dtype=wp.float64),
    # in and out
    anchor_x: wp.array(dtype=wp.float64),
    anchor_y: wp.array(dtype=wp.float64),
):
    """Move anchors whose spring exceeds the limit until it is at the limit."""
    body = wp.tid()
    anchor = wp.vec2d(anchor_x[body], anchor_y[body])
    d = moved_on_ground(control, body_ux[body], body_uy[body], body_origin_x[body], body_origin_y[body]) - anchor
    slip = slipped(d, stiffness, limit)
    anchor_x[body] = anchor[0] + slip[0]
    anchor_y[body] = anchor[1] + slip[1]
