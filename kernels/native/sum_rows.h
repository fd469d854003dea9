// One row of partial sums for ROWS of them (kernels/row_sums.py).
#include "sharing.h"
const int begin = ROWS * group, left = partial.shape[0] - begin, count = left < ROWS ? left : ROWS;
double kinetic = 0, fastest = 0, strongest = 0, square = 0, stress[4] = {};
EVERY(k, 0, count) {
    const double* part = partial.data + PARTIAL_COUNT * (size_t)(begin + k);
    kinetic += part[KINETIC_PART];
    fastest = part[SPEED_PART] > fastest ? part[SPEED_PART] : fastest;
    strongest = part[STRONGEST_PART] > strongest ? part[STRONGEST_PART] : strongest;
    square += part[FORCE_PART];
    for (int c = 0; c < 4; ++c) stress[c] += part[STRESS_PART + c];
}
double* row = fewer.data + PARTIAL_COUNT * group;
#include "sum_of_lanes.h"
