"""Masses that are banded along the wire: factors and solution of M a = f.

M couples a node with the next and the next but one of its wire, each component by itself. The spin inertia couples a
segment with the next. Both are factored as L D L^T along each wire. Around a closed wire the last two nodes (the last segment)
couple with the first ones: their rows of L are full, all other rows have two entries (one). Solving takes a sweep forward and one
back:

    z_j = f_j - L(j, j-1) z_(j-1) - L(j, j-2) z_(j-2)         a_j = z_j/D_j - L(j+1, j) a_(j+1) - L(j+2, j) a_(j+2) - border

Held nodes and sections have no couplings and no acceleration. Olovsson, Simonsson and Unosson, "Selective mass scaling for
explicit finite element analyses", Int. J. Numer. Methods Eng. 63 (2005).
"""

import warp as wp

from .rod_motion import HELD_NODE, HELD_TURN

NEGLIGIBLE = wp.constant(wp.float64(1.0e-30))  # entry of a full row of L that counts as zero: it decays along the wire


@wp.func
def without_tiny_number(value: wp.float64) -> wp.float64:
    """The value, 0 where it is negligible beside 1."""
    return wp.where(wp.abs(value) < NEGLIGIBLE, wp.float64(0.0), value)


@wp.func
def without_tiny(value: wp.vec3d) -> wp.vec3d:
    """The components, 0 where they are negligible beside 1."""
    return wp.vec3d(without_tiny_number(value[0]), without_tiny_number(value[1]), without_tiny_number(value[2]))


@wp.func
def is_at(i: int, j: int, count: int) -> wp.float64:
    """1 where nodes i and j of a wire are the same, counted around it."""
    return wp.where(i % count == j, wp.float64(1.0), wp.float64(0.0))


@wp.func
def entry(
    j: int, row: int, first: int, count: int, next_mass: wp.array(dtype=wp.float64), second_mass: wp.array(dtype=wp.float64)
) -> wp.float64:
    """Coupling of node j of a wire with one of its last two."""
    i = first + j
    r = first + row
    found = is_at(j + 1, row, count) * next_mass[i] + is_at(j + 2, row, count) * second_mass[i]
    return found + is_at(row + 1, j, count) * next_mass[r] + is_at(row + 2, j, count) * second_mass[r]


@wp.kernel
def factor_masses(
    # in: wires
    wire_first: wp.array(dtype=wp.int32),
    wire_count: wp.array(dtype=wp.int32),
    # in: diagonals of the masses and of the spin inertias; couplings that do not exist are zero
    node_mass: wp.array(dtype=wp.vec3d),
    next_mass: wp.array(dtype=wp.float64),
    second_mass: wp.array(dtype=wp.float64),
    spin_inertia: wp.array(dtype=wp.float64),
    next_inertia: wp.array(dtype=wp.float64),
    # out: 1/D, and L: of a row to the left, and of the last two rows
    mass_pivot: wp.array(dtype=wp.vec3d),
    mass_lower: wp.array2d(dtype=wp.vec3d),
    mass_border: wp.array2d(dtype=wp.vec3d),
    spin_pivot: wp.array(dtype=wp.float64),
    spin_lower: wp.array(dtype=wp.float64),
    spin_border: wp.array(dtype=wp.float64),
):
    """One thread a wire, of two nodes or more."""
    wire = wp.tid()
    first = wire_first[wire]
    count = wire_count[wire]
    one = wp.float64(1.0)
    ones = wp.vec3d(one, one, one)
    # translation: D, L and the last rows at the two nodes before
    d1 = ones
    d2 = ones
    lower_before = wp.vec3d()
    last_before = wp.vec3d()
    last_before_that = wp.vec3d()
    other_before = wp.vec3d()
    other_before_that = wp.vec3d()
    last = node_mass[first + count - 1]
    other = node_mass[first + count - 2]  # the last but one
    cross = next_mass[first + count - 2] * ones
    for j in range(count - 2):
        i = first + j
        lower = wp.vec3d()
        lower_second = wp.vec3d()
        if j >= 2:
            lower_second = wp.cw_div(second_mass[i - 2] * ones, d2)
        if j >= 1:
            lower = wp.cw_div(next_mass[i - 1] * ones - wp.cw_mul(wp.cw_mul(lower_second, d2), lower_before), d1)
        below = wp.cw_mul(lower, d1)
        below_second = wp.cw_mul(lower_second, d2)
        d = node_mass[i] - wp.cw_mul(lower, below) - wp.cw_mul(lower_second, below_second)
        of_other = entry(j, count - 2, first, count, next_mass, second_mass) * ones
        of_last = entry(j, count - 1, first, count, next_mass, second_mass) * ones
        of_other -= wp.cw_mul(other_before, below) + wp.cw_mul(other_before_that, below_second)
        of_last -= wp.cw_mul(last_before, below) + wp.cw_mul(last_before_that, below_second)
        of_other = without_tiny(wp.cw_div(of_other, d))
        of_last = without_tiny(wp.cw_div(of_last, d))
        mass_pivot[i] = wp.cw_div(ones, d)
        mass_lower[0, i] = lower
        mass_lower[1, i] = lower_second
        mass_border[0, i] = of_other
        mass_border[1, i] = of_last
        last -= wp.cw_mul(wp.cw_mul(of_last, of_last), d)
        other -= wp.cw_mul(wp.cw_mul(of_other, of_other), d)
        cross -= wp.cw_mul(wp.cw_mul(of_other, of_last), d)
        other_before_that = other_before
        other_before = of_other
        last_before_that = last_before
        last_before = of_last
        d2 = d1
        d1 = d
        lower_before = lower
    i = first + count - 2
    lower = wp.cw_div(cross, other)
    mass_pivot[i] = wp.cw_div(ones, other)
    mass_pivot[i + 1] = wp.cw_div(ones, last - wp.cw_mul(lower, cross))
    for k in range(2):
        for row in range(2):
            mass_lower[row, i + k] = wp.vec3d()
            mass_border[row, i + k] = wp.vec3d()
    mass_lower[0, i + 1] = lower
    # spin
    d_before = one
    border = wp.float64(0.0)
    last_spin = spin_inertia[first + count - 1]
    for j in range(count - 1):
        i = first + j
        side = wp.float64(0.0)
        if j >= 1:
            side = next_inertia[i - 1] / d_before
        pivot = spin_inertia[i] - side * side * d_before
        entry_of_last = is_at(j + 1, count - 1, count) * next_inertia[i]
        entry_of_last += is_at(count, j, count) * next_inertia[first + count - 1]
        border = without_tiny_number((entry_of_last - border * d_before * side) / pivot)
        spin_pivot[i] = one / pivot
        spin_lower[i] = side
        spin_border[i] = border
        last_spin -= border * border * pivot
        d_before = pivot
    i = first + count - 1
    spin_pivot[i] = one / last_spin
    spin_lower[i] = wp.float64(0.0)
    spin_border[i] = wp.float64(0.0)


@wp.kernel
def find_accelerations(
    # in: wires
    wire_first: wp.array(dtype=wp.int32),
    wire_count: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    held: wp.array(dtype=wp.int32),
    # in: factors
    mass_pivot: wp.array(dtype=wp.vec3d),
    mass_lower: wp.array2d(dtype=wp.vec3d),
    mass_border: wp.array2d(dtype=wp.vec3d),
    spin_pivot: wp.array(dtype=wp.float64),
    spin_lower: wp.array(dtype=wp.float64),
    spin_border: wp.array(dtype=wp.float64),
    # in
    force: wp.array(dtype=wp.vec3d),
    torque: wp.array(dtype=wp.float64),
    # in and out: the forward sweep leaves what the sweep back reads
    acceleration: wp.array(dtype=wp.vec3d),
    spin_acceleration: wp.array(dtype=wp.float64),
):
    """One thread a wire."""
    wire = wp.tid()
    first = wire_first[wire]
    count = wire_count[wire]
    zero = wp.float64(0.0)
    z1 = wp.vec3d()
    z2 = wp.vec3d()
    w1 = zero
    other = wp.vec3d()  # sums of the last but one row, and of the last
    last = wp.vec3d()
    last_spin = zero
    for j in range(count):
        i = first + j
        lower = mass_lower[0, i]
        z = wp.vec3d()
        if (held[i] & HELD_NODE) == 0:
            z = force[i]
        if j == count - 2:
            z -= other
        elif j == count - 1:
            z = z - last - wp.cw_mul(lower, z1)
        else:
            z = z - wp.cw_mul(lower, z1) - wp.cw_mul(mass_lower[1, i], z2)
            other += wp.cw_mul(mass_border[0, i], z)
            last += wp.cw_mul(mass_border[1, i], z)
        acceleration[i] = z
        z2 = z1
        z1 = z
        w = zero
        if (held[i] & HELD_TURN) == 0 and following[i] >= 0:
            w = torque[i]
        if j == count - 1:
            w -= last_spin
        else:
            w -= spin_lower[i] * w1
            last_spin += spin_border[i] * w
        spin_acceleration[i] = w
        w1 = w
    i = first + count - 1
    last = wp.cw_mul(mass_pivot[i], acceleration[i])
    other = wp.cw_mul(mass_pivot[i - 1], acceleration[i - 1]) - wp.cw_mul(mass_lower[0, i], last)
    last_spin = spin_pivot[i] * spin_acceleration[i]
    acceleration[i] = last
    acceleration[i - 1] = other
    spin_acceleration[i] = last_spin
    z1 = wp.vec3d()
    z2 = wp.vec3d()
    after = wp.vec3d()
    after_second = wp.vec3d()
    lower_after = zero
    w1 = zero
    for k in range(count - 1):
        i = first + count - 2 - k
        w1 = spin_pivot[i] * spin_acceleration[i] - lower_after * w1 - spin_border[i] * last_spin
        lower_after = spin_lower[i]
        spin_acceleration[i] = w1
        if k > 0:
            z = wp.cw_mul(mass_pivot[i], acceleration[i]) - wp.cw_mul(after, z1) - wp.cw_mul(after_second, z2)
            z = z - wp.cw_mul(mass_border[0, i], other) - wp.cw_mul(mass_border[1, i], last)
            acceleration[i] = z
            z2 = z1
            z1 = z
            after = mass_lower[0, i]
            after_second = mass_lower[1, i + 1]
