// Leaves in `row` the partial sums of kinetic, fastest, strongest, square and stress[4] of all threads, in a fixed order
// (sharing.h).
{
    double sums[PARTIAL_COUNT] = {};
#ifdef __CUDA_ARCH__
    __shared__ double warps[32 * PARTIAL_COUNT];
    double energy = kinetic, squares = square;
    for (int step = 16; step > 0; step /= 2) {
        energy += __shfl_down_sync(0xffffffffu, energy, step);
        squares += __shfl_down_sync(0xffffffffu, squares, step);
        for (int c = 0; c < 4; ++c) stress[c] += __shfl_down_sync(0xffffffffu, stress[c], step);
        const auto faster = __shfl_down_sync(0xffffffffu, fastest, step);
        const auto stronger = __shfl_down_sync(0xffffffffu, strongest, step);
        fastest = faster > fastest ? faster : fastest;
        strongest = stronger > strongest ? stronger : strongest;
    }
#else
    const double energy = kinetic, squares = square;
#endif
    sums[KINETIC_PART] = energy;
    sums[SPEED_PART] = fastest;
    sums[STRONGEST_PART] = strongest;
    sums[FORCE_PART] = squares;
    for (int c = 0; c < 4; ++c) sums[STRESS_PART + c] = stress[c];
#ifdef __CUDA_ARCH__
    for (int c = 0; c < PARTIAL_COUNT && lane % 32 == 0; ++c) warps[PARTIAL_COUNT * (lane / 32) + c] = sums[c];
    TOGETHER
    if (lane < PARTIAL_COUNT) {
        const bool adds = lane == KINETIC_PART || lane >= FORCE_PART;
        double total = warps[lane];
        for (int w = 1; w < blockDim.x / 32; ++w) {
            const double other = warps[PARTIAL_COUNT * w + lane];
            total = adds ? total + other : (other > total ? other : total);
        }
        row[lane] = total;
    }
#else
    for (int c = 0; c < PARTIAL_COUNT; ++c) row[c] = sums[c];
#endif
}
