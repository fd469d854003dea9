// Strains, tensions and moments of the nodes of a block (kernels/energy.py).
enum { KEEPS = 1 };
#include "wire_forces.h"
const real* __restrict natural_bow = rest_bow.data + table - HALO;
EACH(k, HALO, count + HALO) {
    const int i = offset_of_block + k, local = i - wire_begin, last = wire_nodes - 1;
    const bool turns = closed || (local > 0 && local < last), goes_on = closed || local < last;
    tension_out.data[i] = tension[k];
    turning_out.data[i] = turns ? turn[k] : real(0);
    force_x_out.data[i] = goes_on ? nx[k] : real(0);
    force_y_out.data[i] = goes_on ? ny[k] : real(0);
    if (moment_out.shape[0]) {
        edge_x_out.data[i] = goes_on ? chord_x[k] : real(0);
        edge_y_out.data[i] = goes_on ? chord_y[k] : real(0);
        elastic_out.data[i] = turns ? bend[k] / (hinge_factor * share[k] * rb[k]) : real(0);
        moment_out.data[i] = turns ? moment[k] : real(0);
        bow_moment_out.data[i] = turns ? unbending[k] : real(0);
    }
    if (!strain_out.shape[0]) continue;
    real strain = 0;
    if (closed || (local >= gripped && local < last - gripped)) {
        // how often the squares of the angles at both ends count, and the bow at rest: both ends of a wire may change them
        real weight = 1, next_weight = 1, bow = -natural_bow[k], length = rl[k];
        for (int far = 0; gripped && far < 2; ++far) {
            const real* clamp = clamps + far * CLAMP_NUMBERS;
            const int from_clamp = far ? last - 2 - local : local - 1; // segments between this one and the clamp
            real& near = far ? next_weight : weight;
            real& beyond = far ? weight : next_weight;
            if (from_clamp == 0) {
                near += clamp[BOW_WEIGHT];
                beyond += clamp[NEXT_BOW_WEIGHT];
                length = clamp[LENGTH];
            }
            if (from_clamp == 1) near += clamp[BEYOND_BOW_WEIGHT];
            if (from_clamp == 0 || from_clamp == 1) bow -= clamp[BOW_CHANGE + from_clamp];
        }
        const real angle = turns ? angles[k] : real(0);
        const real next_angle = closed || local < last - 1 ? angles[k + 1] : real(0);
        bow += real(BOW) * (weight * angle * angle + next_weight * next_angle * next_angle);
        const real natural = length * length_factor, chord = sqrt(chord_x[k] * chord_x[k] + chord_y[k] * chord_y[k]);
        const real thermal_strain = real(wire_thermal_strain.data[wire][0] + wire_thermal_strain.data[wire][1] * local);
        strain = ((chord - natural) / natural - thermal_strain) / (real(1) + thermal_strain) + bow;
    }
    strain_out.data[i] = strain;
}
