// Strain of the arc of a segment that its tension leaves (kernels/rod_checks.py).
const double* turn = (const double*)curvature.data;
const double* weight = (const double*)(bow_weight.data + i);
double strain = length.data[i] / (natural_length.data[i] * control.data[LENGTH_FACTOR]) - 1;
const double tension = tension_offset.data[i] + stretch_stiffness.data[i] * strain;
if (keeps_arc_length) {
    const int j = following.data[i];
    const double own = turn[2 * i] * turn[2 * i] + turn[2 * i + 1] * turn[2 * i + 1];
    const double next = turn[2 * j] * turn[2 * j] + turn[2 * j + 1] * turn[2 * j + 1];
    strain += BOW * (weight[0] * own + weight[1] * next) - bow_at_rest.data[i];
}
const double longer = 1 + half_in_clamp.data[i] / natural_length.data[i], heated = thermal_strain.data[i];
return (strain - heated * longer) / ((1 + heated) * longer) - tension / axial_stiffness;
