// Masses of a block of nodes of rods (kernels/rod_masses.py, for the bound).
typedef double real;
#include "rod_block.h"
#include "rod_around.h"
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
