"""Common part of the native functions: C++ that Warp compiles, for both precisions.

Constants of kernels/control.py and columns of the partial sums are declared under their names.
"""

from warpknit.kernels import control as c


def constants(**values: float) -> str:
    """C++ declarations of constants, to stand before the text of a native function."""
    whole = ", ".join(f"{name} = {int(value)}" for name, value in values.items() if float(value) == int(value))
    parts = [f"    enum {{ {whole} }};\n"] if whole else []
    return "".join(parts + [f"    const double {n} = {float(v)!r};\n" for n, v in values.items() if float(v) != int(v)])


# A function that many threads work on takes `lane`, its number among them. On a GPU they are the threads of a CUDA block: they
# share arrays that are SHARED (`with_shared`), each takes at most one entry of a loop over EACH, which has no more than they are,
# and some of one over EVERY; entries of others are read behind TOGETHER. On a CPU the first one takes all.
SHARING = r"""
    #ifdef __CUDA_ARCH__
    #define EACH(k, low, high) for (int k = lane, goes = k >= (low) && k < (high); goes; goes = 0)
    #define EVERY(k, low, high) for (int k = (low) + lane; k < (high); k += blockDim.x)
    #define TOGETHER __syncthreads();
    TOGETHER
    #else
    #define EACH(k, low, high) for (int k = (low); k < (high); ++k)
    #define EVERY(k, low, high) EACH(k, low, high)
    #define TOGETHER
    if (lane > 0) return;
    #endif
"""


def with_shared(text: str, in_place_of: dict[str, str] | None = None) -> str:
    """A text with declarations `SHARED type name[size], ...;` of arrays: on a GPU they are members of one shared object, whose
    address a thread computes once for all; on a CPU arrays of their own.

    in_place_of: arrays that take the memory of another one on a GPU, which is not read afterwards.
    """
    others = in_place_of or {}
    head, *parts = text.split("SHARED ")
    members, texts = [], []
    for part in parts:
        kind, declared = part.split(" ", 1)
        declared, behind = declared.split(";", 1)
        names = {array: array.split("[")[0] for array in declared.split(", ")}
        members += [f"{kind} {array};" for array, name in names.items() if name not in others]
        on_gpu = " ".join(f"auto& {name} = shared_by_all.{others.get(name, name)};" for name in names.values())
        texts.append(f"\n    #ifdef __CUDA_ARCH__\n    {on_gpu}\n    #else\n    {kind} {declared};\n    #endif\n{behind}")
    shared = f"\n    #ifdef __CUDA_ARCH__\n    __shared__ struct {{ {' '.join(members)} }} shared_by_all;\n    #endif\n    "
    return "".join([head, shared, *texts]) if parts else text


# C++ that leaves the row `row` of partial sums from kinetic, fastest, strongest and square of all threads, in a fixed order
SUM_OF_LANES = r"""
    {
    double sums[PARTIAL_COUNT] = {};
    #ifdef __CUDA_ARCH__
    __shared__ double warps[32 * PARTIAL_COUNT];
    double energy = kinetic, squares = square;
    for (int step = 16; step > 0; step /= 2) {
        energy += __shfl_down_sync(0xffffffffu, energy, step);
        squares += __shfl_down_sync(0xffffffffu, squares, step);
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
    #ifdef __CUDA_ARCH__
    for (int c = 0; c < PARTIAL_COUNT && lane % 32 == 0; ++c) warps[PARTIAL_COUNT * (lane / 32) + c] = sums[c];
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
