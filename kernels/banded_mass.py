"""Masses that are banded along the wire: their factors.

M couples a node with the next and the next but one of its wire, each component by itself. The spin inertia couples a segment
with the next. All four, x, y, z and spin, are factored as L D L^T along each wire, the four entries of a node side by side.
Around a closed wire the last two nodes couple with the first ones: their rows of L are full, all other rows have two entries.
rod_motion.py solves with the factors. Held nodes and sections, and nodes at rest (rod_blocks.py), have no couplings, and a zero
instead of 1/D, so that they have no acceleration.
Olovsson, Simonsson and Unosson, "Selective mass scaling for explicit finite element analyses", Int. J. Numer. Methods Eng. 63
(2005).
"""

from typing import Any

import warp as wp

from .rod_blocks import rests

HELD_NODE = wp.constant(1)  # the node is fixed
HELD_TURN = wp.constant(2)  # the section of the segment behind the node does not rotate about it
CLAMPED = wp.constant(4)  # the segment behind the node is in the clamp of a knit, and touches no other clamp

# factors of a node
PIVOT = wp.constant(0)  # 1/D
NEXT = wp.constant(1)  # L of the row to the node before
SECOND = wp.constant(2)  # L of the row to the node before that
FACTORS = 3
# full rows
OTHER = wp.constant(0)  # L of the last row but one to the node
LAST = wp.constant(1)  # L of the last row to the node
BORDERS = 2

OVERLAP = wp.constant(128)  # nodes

NEGLIGIBLE = wp.constant(wp.float64(1.0e-30))  # entry of a full row of L that counts as zero: it decays along the wire


@wp.func
def without_tiny(value: wp.vec4d) -> wp.vec4d:
    """The components, 0 where they are negligible beside 1."""
    for k in range(4):
        if wp.abs(value[k]) < NEGLIGIBLE:
            value[k] = wp.float64(0.0)
    return value


@wp.func
def is_at(i: int, j: int, count: int) -> wp.float64:
    """1 where nodes i and j of a wire are the same, counted around it."""
    return wp.where(i % count == j, wp.float64(1.0), wp.float64(0.0))


@wp.func
def beside(along: wp.float64, about: wp.float64) -> wp.vec4d:
    """A value for x, y and z, and one for the spin."""
    return wp.vec4d(along, along, along, about)


@wp.func
def entry(
    j: int,
    row: int,
    first: int,
    count: int,
    next_mass: wp.array(dtype=wp.float64),
    second_mass: wp.array(dtype=wp.float64),
    next_inertia: wp.array(dtype=wp.float64),
) -> wp.vec4d:
    """Coupling of node j of a wire with one of its last two."""
    i = first + j
    r = first + row
    found = is_at(j + 1, row, count) * beside(next_mass[i], next_inertia[i])
    found += is_at(row + 1, j, count) * beside(next_mass[r], next_inertia[r])
    zero = wp.float64(0.0)
    found += is_at(j + 2, row, count) * beside(second_mass[i], zero)
    return found + is_at(row + 2, j, count) * beside(second_mass[r], zero)


@wp.func
def inverse_pivot(i: int, d: wp.vec4d, following: wp.array(dtype=wp.int32), held: wp.array(dtype=wp.int32)) -> wp.vec4d:
    """1/D; 0 where the node is held, and where its section is or does not exist."""
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    inverse = wp.cw_div(beside(one, one), d)
    if (held[i] & HELD_NODE) != 0:
        inverse = beside(zero, inverse[3])
    if (held[i] & HELD_TURN) != 0 or following[i] < 0:
        inverse[3] = zero
    return inverse


@wp.func
def diagonal(i: int, node_mass: wp.array(dtype=wp.vec3d), spin_inertia: wp.array(dtype=wp.float64)) -> wp.vec4d:
    return wp.vec4d(node_mass[i][0], node_mass[i][1], node_mass[i][2], spin_inertia[i])


@wp.kernel
def factor_masses(
    # in: wires, and how many threads share each
    wire_first: wp.array(dtype=wp.int32),
    wire_count: wp.array(dtype=wp.int32),
    first_wire: int,
    parts: int,
    following: wp.array(dtype=wp.int32),
    held: wp.array(dtype=wp.int32),
    node_block: wp.array(dtype=wp.int32),
    block_rest: wp.array(dtype=wp.int32),
    # in: diagonals of the masses and of the spin inertias; couplings that do not exist are zero
    node_mass: wp.array(dtype=wp.vec3d),
    next_mass: wp.array(dtype=wp.float64),
    second_mass: wp.array(dtype=wp.float64),
    spin_inertia: wp.array(dtype=wp.float64),
    next_inertia: wp.array(dtype=wp.float64),
    # out: (node, FACTORS), and D; without the last two nodes of a wire
    mass_factor: wp.array2d(dtype=Any),
    sweep: wp.array(dtype=Any),
):
    """`parts` threads a wire of two nodes or more: one, or more on a GPU.

    A part begins OVERLAP nodes before its own as if the wire began there: D approaches its value within these, from above. The
    remaining difference changes the masses about the first two nodes of the part: for a gripped tricot of 1,587 nodes a wire they
    are 0.98 to 2.1 times M, where 1/MASS_MARGIN is the limit of stability (numerics.py).
    """
    thread = wp.tid()
    wire = first_wire + thread / parts
    part = thread % parts
    first = wire_first[wire]
    inside = wp.int64(wire_count[wire] - 2)
    begin = int(inside * wp.int64(part) / wp.int64(parts))
    end = int(inside * wp.int64(part + 1) / wp.int64(parts))
    start = wp.max(0, begin - OVERLAP)
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    # D and L at the two nodes before
    d1 = beside(one, one)
    d2 = beside(one, one)
    lower_before = wp.vec4d()
    for j in range(start, end):
        i = first + j
        lower = wp.vec4d()
        lower_second = wp.vec4d()
        own = rests(i, node_block, block_rest)
        if j >= start + 2 and not own and not rests(i - 2, node_block, block_rest):
            lower_second = wp.cw_div(beside(second_mass[i - 2], zero), d2)
        if j >= start + 1 and not own and not rests(i - 1, node_block, block_rest):
            lower = wp.cw_div(
                beside(next_mass[i - 1], next_inertia[i - 1]) - wp.cw_mul(wp.cw_mul(lower_second, d2), lower_before), d1
            )
        d = diagonal(i, node_mass, spin_inertia)
        d = d - wp.cw_mul(lower, wp.cw_mul(lower, d1)) - wp.cw_mul(lower_second, wp.cw_mul(lower_second, d2))
        if j >= begin:
            mass_factor[i, PIVOT] = mass_factor.dtype()
            if not own:
                mass_factor[i, PIVOT] = mass_factor.dtype(inverse_pivot(i, d, following, held))
            mass_factor[i, NEXT] = mass_factor.dtype(lower)
            mass_factor[i, SECOND] = mass_factor.dtype(lower_second)
            sweep[i] = sweep.dtype(d)
        d2 = d1
        d1 = d
        lower_before = lower


@wp.kernel
def factor_borders(
    # in: wires
    wire_first: wp.array(dtype=wp.int32),
    wire_count: wp.array(dtype=wp.int32),
    wire_closed: wp.array(dtype=wp.int32),
    wire_border: wp.array(dtype=wp.int32),
    first_wire: int,
    following: wp.array(dtype=wp.int32),
    held: wp.array(dtype=wp.int32),
    # in: diagonals of the masses and of the spin inertias; couplings that do not exist are zero
    node_mass: wp.array(dtype=wp.vec3d),
    next_mass: wp.array(dtype=wp.float64),
    second_mass: wp.array(dtype=wp.float64),
    spin_inertia: wp.array(dtype=wp.float64),
    next_inertia: wp.array(dtype=wp.float64),
    # in: D
    sweep: wp.array(dtype=Any),
    # in and out: (node, FACTORS); the last two nodes' are found
    mass_factor: wp.array2d(dtype=Any),
    # out: (row, BORDERS): a row for each node of a closed wire and the last four of an open one; node j's is
    # wire_border + j; first node of each wire from which full rows are zero, up to the last four nodes
    mass_border: wp.array2d(dtype=Any),
    wire_quiet: wp.array(dtype=wp.int32),
):
    """One thread a wire."""
    wire = first_wire + wp.tid()
    first = wire_first[wire]
    count = wire_count[wire]
    # the last rows at the two nodes before
    last_before = wp.vec4d()
    last_before_that = wp.vec4d()
    other_before = wp.vec4d()
    other_before_that = wp.vec4d()
    last = diagonal(first + count - 1, node_mass, spin_inertia)
    other = diagonal(first + count - 2, node_mass, spin_inertia)
    cross = entry(count - 2, count - 1, first, count, next_mass, second_mass, next_inertia)
    quiet = int(0)
    j = int(0)
    while j < count - 2:
        i = first + j
        of_other = entry(j, count - 2, first, count, next_mass, second_mass, next_inertia)
        of_last = entry(j, count - 1, first, count, next_mass, second_mass, next_inertia)
        if j >= 1:
            below = wp.cw_mul(wp.vec4d(mass_factor[i, NEXT]), wp.vec4d(sweep[i - 1]))
            of_other -= wp.cw_mul(other_before, below)
            of_last -= wp.cw_mul(last_before, below)
        if j >= 2:
            below_second = wp.cw_mul(wp.vec4d(mass_factor[i, SECOND]), wp.vec4d(sweep[i - 2]))
            of_other -= wp.cw_mul(other_before_that, below_second)
            of_last -= wp.cw_mul(last_before_that, below_second)
        d = wp.vec4d(sweep[i])
        of_other = without_tiny(wp.cw_div(of_other, d))
        of_last = without_tiny(wp.cw_div(of_last, d))
        is_zero = wp.length_sq(of_other) + wp.length_sq(of_last) == wp.float64(0.0)
        was_zero = wp.length_sq(other_before) + wp.length_sq(last_before) == wp.float64(0.0)
        if j < count - 4 and not is_zero:
            quiet = j + 1
        if wire_closed[wire] != 0 or j >= count - 4:
            mass_border[wire_border[wire] + j, OTHER] = mass_border.dtype(of_other)
            mass_border[wire_border[wire] + j, LAST] = mass_border.dtype(of_last)
        last -= wp.cw_mul(wp.cw_mul(of_last, of_last), d)
        other -= wp.cw_mul(wp.cw_mul(of_other, of_other), d)
        cross -= wp.cw_mul(wp.cw_mul(of_other, of_last), d)
        other_before_that = other_before
        other_before = of_other
        last_before_that = last_before
        last_before = of_last
        j += 1
        if j >= 2 and is_zero and was_zero:
            j = wp.max(j, count - 4)
    wire_quiet[wire] = quiet
    lower = wp.cw_div(cross, other)
    for k in range(count - 2, count):
        for factor in range(FACTORS):
            mass_factor[first + k, factor] = mass_factor.dtype()
        for border in range(BORDERS):
            mass_border[wire_border[wire] + k, border] = mass_border.dtype()
    i = first + count - 2
    mass_factor[i, PIVOT] = mass_factor.dtype(inverse_pivot(i, other, following, held))
    mass_factor[i + 1, PIVOT] = mass_factor.dtype(inverse_pivot(i + 1, last - wp.cw_mul(lower, cross), following, held))
    mass_factor[i + 1, NEXT] = mass_factor.dtype(lower)
