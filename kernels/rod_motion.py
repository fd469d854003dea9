"""Motion of rods: accelerations M a = f by the factors of banded_mass.py, and the update of nodes and sections.

    z_j = f_j - L(j, j-1) z_(j-1) - L(j, j-2) z_(j-2)         a_j = z_j/D_j - L(j+1, j) a_(j+1) - L(j+2, j) a_(j+2) - full rows

The sweep forward leaves z, the sweep back updates each node by the two-term update of control.py once its acceleration is known.
"""

import warp as wp

from . import banded_mass as m
from .control import STATUS, STATUS_RUNNING
from .native import STEERING, constants

# Four numbers a node: x, y, z and spin. Full rows are zero between `quiet` and the last four nodes.
_MOVE = (
    STEERING
    + constants(PIVOT=m.PIVOT, NEXT=m.NEXT, SECOND=m.SECOND, OTHER=m.OTHER, LAST=m.LAST, FACTORS=m.FACTORS, BORDERS=m.BORDERS)
    + r"""
    const int first = wire_first.data[wire], count = wire_count.data[wire], quiet = wire_quiet.data[wire];
    const double* __restrict factors = (const double*)(mass_factor.data + FACTORS * first);
    const double* __restrict borders = (const double*)(mass_border.data + BORDERS * wire_border.data[wire]);
    const double* __restrict push = (const double*)(force.data + first - stored_from);
    const double* __restrict couple = torque.data + first - stored_from;
    double* __restrict swept = (double*)(sweep.data + first - stored_from);
    double z1[4] = {0, 0, 0, 0}, z2[4] = {0, 0, 0, 0}, other[4] = {0, 0, 0, 0}, last[4] = {0, 0, 0, 0};
    for (int j = 0; j < count; ++j) {
        const double* __restrict l = factors + 4 * FACTORS * j;
        double z[4] = {push[3 * j], push[3 * j + 1], push[3 * j + 2], couple[j]};
        if (j == count - 2) {
            for (int c = 0; c < 4; ++c) z[c] -= other[c];
        } else if (j == count - 1) {
            for (int c = 0; c < 4; ++c) z[c] -= last[c] + l[4 * NEXT + c] * z1[c];
        } else {
            for (int c = 0; c < 4; ++c) z[c] -= l[4 * SECOND + c] * z2[c];
            for (int c = 0; c < 4; ++c) z[c] -= l[4 * NEXT + c] * z1[c];
            if (j < quiet || j >= count - 4) {
                for (int c = 0; c < 4; ++c) other[c] += (borders + 4 * BORDERS * j)[4 * OTHER + c] * z[c];
                for (int c = 0; c < 4; ++c) last[c] += (borders + 4 * BORDERS * j)[4 * LAST + c] * z[c];
            }
        }
        for (int c = 0; c < 4; ++c) swept[4 * j + c] = z[c];
        for (int c = 0; c < 4; ++c) z2[c] = z1[c];
        for (int c = 0; c < 4; ++c) z1[c] = z[c];
    }
    const double* steer = control.data;
    const double a = steer[VELOCITY_FACTOR], b = steer[FORCE_FACTOR], dt = steer[TIME_STEP], ahead = steer[LOOK_AHEAD];
    double* __restrict moved = (double*)(displacement.data + first);
    double* __restrict speed = (double*)(velocity.data + first);
    double* __restrict rate = spin.data + first;
    double* __restrict turned = angle.data + first;
    double* __restrict turn = pending_turn.data + first;
    double* __restrict total = (double*)(force_sum.data + first);
    const double* __restrict mass = (const double*)(node_mass.data + first);
    const double* __restrict inertia = spin_inertia.data + first;
    double kinetic = 0, fastest = 0, strongest = 0, squares = 0;
    for (int c = 0; c < 4; ++c) z1[c] = z2[c] = 0;
    for (int j = count - 1; j >= 0; --j) {
        const double* __restrict l = factors + 4 * FACTORS * j;
        double z[4];
        for (int c = 0; c < 4; ++c) z[c] = l[4 * PIVOT + c] * swept[4 * j + c];
        if (j == count - 1) {
            for (int c = 0; c < 4; ++c) last[c] = z[c];
        } else if (j == count - 2) {
            for (int c = 0; c < 4; ++c) z[c] -= (l + 4 * FACTORS)[4 * NEXT + c] * last[c];
            for (int c = 0; c < 4; ++c) other[c] = z[c];
        } else {
            // the last two rows are full: L to them is not zero only there
            for (int c = 0; c < 4; ++c) z[c] -= (l + 8 * FACTORS)[4 * SECOND + c] * z2[c];
            for (int c = 0; c < 4; ++c) z[c] -= (l + 4 * FACTORS)[4 * NEXT + c] * z1[c];
            if (j < quiet || j >= count - 4) {
                for (int c = 0; c < 4; ++c) z[c] -= (borders + 4 * BORDERS * j)[4 * OTHER + c] * other[c];
                for (int c = 0; c < 4; ++c) z[c] -= (borders + 4 * BORDERS * j)[4 * LAST + c] * last[c];
            }
            for (int c = 0; c < 4; ++c) z2[c] = z1[c];
            for (int c = 0; c < 4; ++c) z1[c] = z[c];
        }
        double q2 = 0, f2 = 0, e = 0;
        for (int c = 0; c < 3; ++c) {
            const double before = speed[3 * j + c], after = a * before + b * z[c];
            speed[3 * j + c] = after;
            moved[3 * j + c] += dt * (after + ahead * (after - before));
            total[3 * j + c] += push[3 * j + c];
            q2 += after * after;
            e += mass[3 * j + c] * after * after;
            f2 += push[3 * j + c] * push[3 * j + c];
        }
        const double before = rate[j], after = a * before + b * z[3], move = dt * (after + ahead * (after - before));
        rate[j] = after;
        turn[j] = move;
        turned[j] += move;
        kinetic += e + inertia[j] * after * after;
        fastest = q2 > fastest ? q2 : fastest;
        if (l[4 * PIVOT] != 0) {
            squares += f2;
            strongest = f2 > strongest ? f2 : strongest;
        }
    }
    double* row = partial.data + PARTIAL_COUNT * wire;
    row[KINETIC_PART] = kinetic;
    row[SPEED_PART] = fastest;
    row[STRONGEST_PART] = strongest;
    row[FORCE_PART] = squares;
"""
)


@wp.func_native(_MOVE)
def move_wire(
    # in: wires
    wire: wp.int32,
    wire_first: wp.array(dtype=wp.int32),
    wire_count: wp.array(dtype=wp.int32),
    wire_border: wp.array(dtype=wp.int32),
    # in: masses and their factors
    mass_factor: wp.array2d(dtype=wp.vec4d),
    mass_border: wp.array2d(dtype=wp.vec4d),
    wire_quiet: wp.array(dtype=wp.int32),
    node_mass: wp.array(dtype=wp.vec3d),
    spin_inertia: wp.array(dtype=wp.float64),
    # in: what steers the step; forces, torques and the sweep, from this node on
    control: wp.array(dtype=wp.float64),
    stored_from: wp.int32,
    force: wp.array(dtype=wp.vec3d),
    torque: wp.array(dtype=wp.float64),
    # state in and out
    displacement: wp.array(dtype=wp.vec3d),
    velocity: wp.array(dtype=wp.vec3d),
    spin: wp.array(dtype=wp.float64),
    angle: wp.array(dtype=wp.float64),
    force_sum: wp.array(dtype=wp.vec3d),
    # out
    sweep: wp.array(dtype=wp.vec4d),
    pending_turn: wp.array(dtype=wp.float64),
    partial: wp.array2d(dtype=wp.float64),
): ...


@wp.kernel
def move_rods(
    # in: wires
    wire_first: wp.array(dtype=wp.int32),
    wire_count: wp.array(dtype=wp.int32),
    wire_border: wp.array(dtype=wp.int32),
    first_wire: int,
    # in: masses and their factors
    mass_factor: wp.array2d(dtype=wp.vec4d),
    mass_border: wp.array2d(dtype=wp.vec4d),
    wire_quiet: wp.array(dtype=wp.int32),
    node_mass: wp.array(dtype=wp.vec3d),
    spin_inertia: wp.array(dtype=wp.float64),
    # in: what steers the step; forces, torques and the sweep, from this node on
    control: wp.array(dtype=wp.float64),
    stored_from: wp.int32,
    force: wp.array(dtype=wp.vec3d),
    torque: wp.array(dtype=wp.float64),
    # state in and out
    displacement: wp.array(dtype=wp.vec3d),
    velocity: wp.array(dtype=wp.vec3d),
    spin: wp.array(dtype=wp.float64),
    angle: wp.array(dtype=wp.float64),
    force_sum: wp.array(dtype=wp.vec3d),
    # out
    sweep: wp.array(dtype=wp.vec4d),
    pending_turn: wp.array(dtype=wp.float64),
    partial: wp.array2d(dtype=wp.float64),
):
    """One thread a wire, and a row of partial sums. The kinetic energy is that of the diagonal masses."""
    wire = first_wire + wp.tid()
    if control[STATUS] != STATUS_RUNNING:
        return
    move_wire(
        wire,
        wire_first,
        wire_count,
        wire_border,
        mass_factor,
        mass_border,
        wire_quiet,
        node_mass,
        spin_inertia,
        control,
        stored_from,
        force,
        torque,
        displacement,
        velocity,
        spin,
        angle,
        force_sum,
        sweep,
        pending_turn,
        partial,
    )
