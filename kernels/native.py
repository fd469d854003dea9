"""Common part of the native functions: C++ that Warp compiles, for both precisions.

Constants of kernels/control.py and columns of the partial sums are declared under their names.
"""

from . import control as c


def constants(**values: float) -> str:
    """C++ declarations of constants, to stand before the text of a native function."""
    whole = ", ".join(f"{name} = {int(value)}" for name, value in values.items() if float(value) == int(value))
    parts = [f"    enum {{ {whole} }};\n"] if whole else []
    return "".join(parts + [f"    const double {n} = {float(v)!r};\n" for n, v in values.items() if float(v) != int(v)])


# A function that many threads work on takes `lane`, its number among them. On a GPU they are the threads of a CUDA block: they
# share arrays that are SHARED, each takes an entry of a loop over EACH, and entries of others are read behind TOGETHER. On a CPU
# the first one takes all.
SHARING = r"""
    #ifdef __CUDA_ARCH__
    #define SHARED __shared__
    #define EACH(k, low, high) for (int k = lane; k < (high); k += blockDim.x) if (k >= (low))
    #define TOGETHER __syncthreads();
    TOGETHER
    #else
    #define SHARED
    #define EACH(k, low, high) for (int k = (low); k < (high); ++k)
    #define TOGETHER
    if (lane > 0) return;
    #endif
"""

# C++ that leaves the row `row` of partial sums from kinetic, fastest, strongest and square of all threads, in a fixed order
SUM_OF_LANES = r"""
    {
    double sums[PARTIAL_COUNT] = {};
    sums[KINETIC_PART] = kinetic;
    sums[SPEED_PART] = fastest;
    sums[STRONGEST_PART] = strongest;
    sums[FORCE_PART] = square;
    #ifdef __CUDA_ARCH__
    __shared__ double warps[32 * PARTIAL_COUNT];
    for (int c = 0; c < PARTIAL_COUNT; ++c) {
        const bool adds = c == KINETIC_PART || c == FORCE_PART;
        for (int step = 16; step > 0; step /= 2) {
            const double other = __shfl_down_sync(0xffffffffu, sums[c], step);
            sums[c] = adds ? sums[c] + other : (other > sums[c] ? other : sums[c]);
        }
        if (lane % 32 == 0) warps[PARTIAL_COUNT * (lane / 32) + c] = sums[c];
    }
    TOGETHER
    if (lane < PARTIAL_COUNT) {
        const bool adds = lane == KINETIC_PART || lane == FORCE_PART;
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
"""

STEERING = constants(
    VELOCITY_FACTOR=c.VELOCITY_FACTOR,
    FORCE_FACTOR=c.FORCE_FACTOR,
    TIME_STEP=c.TIME_STEP,
    GRADIENT=c.GRADIENT,
    LENGTH_FACTOR=c.LENGTH_FACTOR,
    LOOK_AHEAD=c.LOOK_AHEAD,
    CONTACT_STIFFNESS=c.CONTACT_STIFFNESS,
    BOW_MOMENT=c.BOW_MOMENT,
    BODY_INVERSE_MASS=c.BODY_INVERSE_MASS,
    TRAVEL=c.TRAVEL,
    STEP_TRAVEL=c.STEP_TRAVEL,
    SLOPE_FACTOR=c.SLOPE_FACTOR,
    KINETIC_PART=c.KINETIC_PART,
    SPEED_PART=c.SPEED_PART,
    STRONGEST_PART=c.STRONGEST_PART,
    FORCE_PART=c.FORCE_PART,
    PARTIAL_COUNT=c.PARTIAL_COUNT,
)
