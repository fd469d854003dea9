// Offset and penalty of contacts at a node (kernels/contact_checks.py).
#include "contacts_of_node.h"
const double rate = control.data[MULTIPLIER_RATE], floor = control.data[PENALTY_FLOOR], mean_force = control.data[MEAN_PUSH];
double total = 0, moved = 0, largest = 0, error = 0;
for_each_contact([&](int role, int, int, int, double push, double overlap, double place) {
    if (push == 0) return;
    double share = NEIGHBOUR;
    if (role == 1) share = 1 - place > LEAST_SHARE ? 1 - place : LEAST_SHARE;
    if (role == 2) share = place > LEAST_SHARE ? place : LEAST_SHARE;
    if (push > 0) {
        total += share * push;
        moved += share * push * overlap;
        largest = push > largest ? push : largest;
    }
    if (role == 1 || role == 2) {
        const double counts = push < mean_force ? (push > 0 ? push / mean_force : 0.0) : 1.0;
        const double size = counts * (overlap < 0 ? -overlap : overlap);
        error = size > error ? size : error;
    }
});
double raised = penalty_raised.data[i];
if (control.data[IS_LOADING] == 0) {
    const double best = overlap_best.data[i];
    const bool waits = error > allowed && error > PROGRESS * best;
    if (!waits) overlap_best.data[i] = error;
    int checks = waits ? overlap_checks.data[i] + 1 : 0;
    if (checks >= PATIENCE) {
        checks = 0;
        raised = RAISED * raised < MOST_RAISED ? RAISED * raised : MOST_RAISED;
    }
    overlap_checks.data[i] = checks;
    penalty_raised.data[i] = raised;
}
const double before = contact_penalty.data[i], offset = contact_offset.data[i];
double penalty = floor, next = WITHOUT_CONTACT * offset;
if (total > 0) {
    const double wanted = force_penalty * raised * largest;
    penalty = wanted > floor ? wanted : floor;
    penalty = penalty < DECAY * before ? DECAY * before : (penalty > GROWTH * before ? GROWTH * before : penalty);
    penalty = penalty > floor ? penalty : floor;
    next = offset * before / penalty + 0.5 * rate * moved / total;
}
contact_penalty.data[i] = penalty;
contact_offset.data[i] = next < 0 ? 0.0 : (next > most_offset ? most_offset : next);
