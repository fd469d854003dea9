"""Fictitious masses of rods, banded along the wire, for the state last evaluated: the bound of spatial/fictitious_masses.py.

With lengths a, c of the segments before and behind a node and p, m its turning angle and moment, per node and per segment

    bend = (1 + e) (B/l + bow)      turned = [(1 + 1/e) B + GJ] p^2/(2 l) + |m|      edge = (turned at both ends)/L^2 + (K + T)/L

A node and its neighbours have the masses of (dx_b/c - dx_a/a)^2 bend + (dx)^2 edge; sections those of twist and bent, likewise.
"""

from typing import Any

import warp as wp

from warpknit.kernels.banded_mass import HELD_NODE, HELD_TURN
from warpknit.kernels.bend import BOW
from warpknit.kernels.native import constants, with_shared
from warpknit.kernels.rod_blocks import AROUND, BLOCK

TURNED = 2.0  # e of the bound
MORE_TURN = 0.15  # [rad] allowance for turns sharpened until the next update
MORE_TENSION = 1.2  # the same for tensions

_MASSES = (
    "typedef double real;\n"
    + BLOCK
    + AROUND
    + constants(TURNED=TURNED, MORE_TURN=MORE_TURN, MORE_TENSION=MORE_TENSION, BOW=BOW, HELD_NODE=HELD_NODE, HELD_TURN=HELD_TURN)
    + r"""
    const double bending_stiffness = wire_bending.data[wire], twist_stiffness = wire_twist.data[wire];
    const double yield_curvature = wire_yield.data[wire], stiffest = slope_factor * bending_stiffness;
    const double slow_mass = bending_stiffness * wave_fourth * spacing, slow_inertia = twist_stiffness * wave_square * spacing;
    const bool yields = yield_curvature > 0 && hardening < 1;
    const double factor = steer[LENGTH_FACTOR], back = yields ? hardening / (1 - hardening) : 0.0;
    const double most = twist_stiffness > bending_stiffness ? twist_stiffness : bending_stiffness;
    SHARED double inverse[SPAN], rest[SPAN], pull[SPAN], soft[SPAN], slides[SPAN], free[SPAN], turns[SPAN];
    const double* bent = (const double*)curvature.data;
    const double* own = (const double*)natural_curvature.data;
    const double* flow = (const double*)plastic_turn.data;
    const double* weight = (const double*)bow_weight.data;
    EACH(k, 0, whole) {
        const int i = at[k];
        rest[k] = natural_length.data[i];
        inverse[k] = 1 / rest[k];
        soft[k] = stretch_stiffness.data[i];
        const double tension = tension_offset.data[i] + soft[k] * (length.data[i] / (rest[k] * factor) - 1);
        pull[k] = has[k] * (tension > 0 ? MORE_TENSION * tension : 0.0);
        slides[k] = is_sliding.data[i];
        free[k] = (held.data[i] & HELD_NODE) == 0;
        turns[k] = (held.data[i] & HELD_TURN) == 0;
    }
    SHARED double bend[SPAN], turned[SPAN], twist[SPAN], twisted[SPAN];
    if (lane == 0) bend[0] = turned[0] = twist[0] = twisted[0] = 0;
    TOGETHER
    EACH(k, 1, whole) {
        const int i = at[k], row = i + to_row;
        bend[k] = turned[k] = twist[k] = twisted[k] = 0;
        if (inner[k] == 0) continue;
        const double share = 1 / node_length.data[row];
        const double trial_x = bent[2 * i] - own[2 * row] - (yields ? flow[2 * i] : 0.0);
        const double trial_y = bent[2 * i + 1] - own[2 * row + 1] - (yields ? flow[2 * i + 1] : 0.0);
        double elastic_x = trial_x, elastic_y = trial_y;
        if (yields) {
            const double beyond_x = trial_x - back * flow[2 * i], beyond_y = trial_y - back * flow[2 * i + 1];
            const double reach = sqrt(beyond_x * beyond_x + beyond_y * beyond_y), limit = yield_curvature * factor / share;
            const double off = reach > limit ? (1 - hardening) * (1 - limit / reach) : 0.0;
            elastic_x -= off * beyond_x;
            elastic_y -= off * beyond_y;
        }
        const double moment = bending_stiffness * sqrt(elastic_x * elastic_x + elastic_y * elastic_y) * share / factor;
        const double turn = sqrt(bent[2 * i] * bent[2 * i] + bent[2 * i + 1] * bent[2 * i + 1]) + MORE_TURN;
        const double half_square = 0.5 * turn * turn * share;
        double across = stiffest * share;
        if (keeps_arc_length) {
            across += 2 * BOW * (pull[k - 1] * rest[k - 1] * weight[2 * at[k - 1] + 1] + pull[k] * rest[k] * weight[2 * i]);
        }
        const double free_ends = slides[k - 1] + slides[k] + slides[k + 1 < whole ? k + 1 : k] > 0 ? 2.0 : 1.0;
        bend[k] = (1 + TURNED) * free_ends * across;
        turned[k] = ((1 + 1.0 / TURNED) * stiffest + twist_stiffness) * half_square + moment;
        twist[k] = most * share;
        twisted[k] = twist[k] + stiffest * half_square;
    }
    TOGETHER
    double* __restrict mass = (double*)(node_mass.data + first - HALO);
    double* __restrict next = next_mass.data + first - HALO;
    double* __restrict second = second_mass.data + first - HALO;
    double* __restrict inertia = spin_inertia.data + first - HALO;
    double* __restrict next_turn = next_inertia.data + first - HALO;
    typedef decltype(sweep.data[0].c[0] + sweep.data[0].c[0]) stored;
    const stored* pushed = (const stored*)(sweep.data + first - HALO);
    const bool touches = may_touch != 0;
    EACH(k, HALO, HALO + count) {
        const double a = inverse[k - 1], c = inverse[k], beyond = inverse[k + 1];
        double edge[2];
        for (int side = 0; side < 2; ++side) {
            const int j = k - 1 + side;
            const double free_end = slides[j] + slides[j + 1] > 0 ? 2.0 : 1.0;
            const double across = (turned[j] + turned[j + 1]) * inverse[j];
            edge[side] = has[j] * free_end * (across + soft[j] + pull[j]) * inverse[j];
        }
        const double own_bend = bend[k] * (a + c), after = bend[k + 1] * c;
        const double whole_mass = own_bend * (a + c) + bend[k - 1] * a * a + after * c + edge[0] + edge[1];
        for (int d = 0; d < 3; ++d) mass[3 * k + d] = share * (whole_mass + (touches ? pushed[4 * k + d] : 0.0) + slow_mass);
        const bool goes_on = has[k] != 0 && has[k + 1] != 0, both_free = has[k] != 0 && free[k] != 0 && free[k + 1] != 0;
        next[k] = both_free ? -share * (after * (c + beyond) + own_bend * c + edge[1]) : 0.0;
        second[k] = goes_on && free[k] != 0 && free[k + 2] != 0 ? share * after * beyond : 0.0;
        inertia[k] = spin_share * (twisted[k] + twisted[k + 1] + (touches ? pushed[4 * k + 3] : 0.0) + slow_inertia);
        next_turn[k] = goes_on && turns[k] != 0 && turns[k + 1] != 0 ? -spin_share * twist[k + 1] : 0.0;
    }
"""
)


@wp.func_native(with_shared(_MASSES))
def masses_of_block(
    # in: blocks and wires
    block: wp.int32,
    lane: wp.int32,
    block_first: wp.array(dtype=wp.int32),
    block_count: wp.array(dtype=wp.int32),
    block_wire: wp.array(dtype=wp.int32),
    wire_first: wp.array(dtype=wp.int32),
    wire_count: wp.array(dtype=wp.int32),
    wire_closed: wp.array(dtype=wp.int32),
    rest_row: wp.array(dtype=wp.int32),
    # in: rest data; whether a clamp moves the node
    held: wp.array(dtype=wp.int32),
    is_sliding: wp.array(dtype=wp.int32),
    natural_length: wp.array(dtype=wp.float64),
    node_length: wp.array(dtype=wp.float64),
    natural_curvature: wp.array(dtype=wp.vec2d),
    bow_weight: wp.array(dtype=wp.vec2d),
    wire_bending: wp.array(dtype=wp.float64),
    wire_twist: wp.array(dtype=wp.float64),
    wire_yield: wp.array(dtype=wp.float64),
    slope_factor: wp.float64,
    hardening: wp.float64,
    keeps_arc_length: wp.int32,
    # in: shares of the bound; of the slowest waves 1/length^2 and its square, and the distance of nodes
    share: wp.float64,
    spin_share: wp.float64,
    wave_square: wp.float64,
    wave_fourth: wp.float64,
    spacing: wp.float64,
    # in: what steers the step
    control: wp.array(dtype=wp.float64),
    # state in
    stretch_stiffness: wp.array(dtype=wp.float64),
    tension_offset: wp.array(dtype=wp.float64),
    length: wp.array(dtype=wp.float64),
    curvature: wp.array(dtype=wp.vec2d),
    plastic_turn: wp.array(dtype=wp.vec2d),
    # in: bounds on the stiffness of contacts, of nodes [N/m] and of sections [N m], where wires may touch
    may_touch: wp.int32,
    sweep: wp.array(dtype=Any),
    # out: see banded_mass.py
    node_mass: wp.array(dtype=wp.vec3d),
    next_mass: wp.array(dtype=wp.float64),
    second_mass: wp.array(dtype=wp.float64),
    spin_inertia: wp.array(dtype=wp.float64),
    next_inertia: wp.array(dtype=wp.float64),
): ...


@wp.kernel
def find_masses(
    # in: blocks and wires
    block_first: wp.array(dtype=wp.int32),
    block_count: wp.array(dtype=wp.int32),
    block_wire: wp.array(dtype=wp.int32),
    wire_first: wp.array(dtype=wp.int32),
    wire_count: wp.array(dtype=wp.int32),
    wire_closed: wp.array(dtype=wp.int32),
    rest_row: wp.array(dtype=wp.int32),
    first_block: int,
    threads_a_block: int,
    # in: rest data; whether a clamp moves the node
    held: wp.array(dtype=wp.int32),
    is_sliding: wp.array(dtype=wp.int32),
    natural_length: wp.array(dtype=wp.float64),
    node_length: wp.array(dtype=wp.float64),
    natural_curvature: wp.array(dtype=wp.vec2d),
    bow_weight: wp.array(dtype=wp.vec2d),
    wire_bending: wp.array(dtype=wp.float64),
    wire_twist: wp.array(dtype=wp.float64),
    wire_yield: wp.array(dtype=wp.float64),
    slope_factor: wp.float64,
    hardening: wp.float64,
    keeps_arc_length: wp.int32,
    # in: shares of the bound; of the slowest waves 1/length^2 and its square, and the distance of nodes
    share: wp.float64,
    spin_share: wp.float64,
    wave_square: wp.float64,
    wave_fourth: wp.float64,
    spacing: wp.float64,
    # in: what steers the step
    control: wp.array(dtype=wp.float64),
    # state in
    stretch_stiffness: wp.array(dtype=wp.float64),
    tension_offset: wp.array(dtype=wp.float64),
    length: wp.array(dtype=wp.float64),
    curvature: wp.array(dtype=wp.vec2d),
    plastic_turn: wp.array(dtype=wp.vec2d),
    # in: bounds on the stiffness of contacts, of nodes [N/m] and of sections [N m], where wires may touch
    may_touch: wp.int32,
    sweep: wp.array(dtype=Any),
    # out: see banded_mass.py
    node_mass: wp.array(dtype=wp.vec3d),
    next_mass: wp.array(dtype=wp.float64),
    second_mass: wp.array(dtype=wp.float64),
    spin_inertia: wp.array(dtype=wp.float64),
    next_inertia: wp.array(dtype=wp.float64),
):
    """`threads_a_block` threads a block: one, or ROD_LANES on a GPU."""
    thread = wp.tid()
    block = first_block + thread / threads_a_block
    masses_of_block(
        block,
        thread % threads_a_block,
        block_first,
        block_count,
        block_wire,
        wire_first,
        wire_count,
        wire_closed,
        rest_row,
        held,
        is_sliding,
        natural_length,
        node_length,
        natural_curvature,
        bow_weight,
        wire_bending,
        wire_twist,
        wire_yield,
        slope_factor,
        hardening,
        keeps_arc_length,
        share,
        spin_share,
        wave_square,
        wave_fourth,
        spacing,
        control,
        stretch_stiffness,
        tension_offset,
        length,
        curvature,
        plastic_turn,
        may_touch,
        sweep,
        node_mass,
        next_mass,
        second_mass,
        spin_inertia,
        next_inertia,
    )
