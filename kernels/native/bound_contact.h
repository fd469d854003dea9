// Bound on the stiffness of contacts at a node (kernels/contact_checks.py).
#include "contacts_of_node.h"
const double distance = control.data[EVALUATED_GAP], sticking = control.data[STICKING];
double x = 0, y = 0, z = 0, turn = 0;
for_each_contact([&](int role, int segment, int pair, int contact, double push, double overlap, double place) {
    if (push == 0 && !(overlap > -distance)) return;
    const int one = pair_first.data[pair], other = pair_second.data[pair];
    const double* weight = (const double*)(slope_weight.data + rest_row.data[segment]);
    const double* of_one = (const double*)(slope_weight.data + rest_row.data[one]);
    const double* of_other = (const double*)(slope_weight.data + rest_row.data[other]);
    const double* normal = (const double*)(touch_normal.data + contact);
    const double here = contact_penalty.data[one], there = contact_penalty.data[other];
    const double next_here = contact_penalty.data[following.data[one]];
    const double next_there = contact_penalty.data[following.data[other]];
    double largest = here > next_here ? here : next_here;
    largest = there > largest ? there : largest;
    largest = next_there > largest ? next_there : largest;
    const double stiffness = weight_square * largest;
    const double tilt = MORE_TILT + (overlap < 0 ? -overlap / thickness : 0.0);
    const double nx = (normal[0] < 0 ? -normal[0] : normal[0]) + tilt;
    const double ny = (normal[1] < 0 ? -normal[1] : normal[1]) + tilt;
    const double nz = (normal[2] < 0 ? -normal[2] : normal[2]) + tilt;
    const double total = 2 + WEIGHT_SUM * (of_one[0] + of_one[3] + of_other[0] + of_other[3]);
    double share = BEYOND_WEIGHT * (role == 0 ? weight[0] : weight[3]);
    if (role == 1) share = 1 - place > LEAST_WEIGHT ? 1 - place : LEAST_WEIGHT;
    if (role == 2) share = place > LEAST_WEIGHT ? place : LEAST_WEIGHT;
    const double slender = thickest / natural_length.data[segment];
    const double along = stiffness * (nx + ny + nz), arm = sticking * slender * slender;
    x += share * total * (along * nx + sticking) + arm;
    y += share * total * (along * ny + sticking) + arm;
    z += share * total * (along * nz + sticking) + arm;
    if (role < 3) turn += stiffness * lever * lever + 0.25 * sticking * thickest * thickest;
});
return {x, y, z, turn};
