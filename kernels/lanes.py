"""Numbers of LANES pairs side by side, in vectors of the processor, for native functions on a CPU.

A Warp kernel has no such vectors. Masks hold the answers to comparisons: `mask ? one : other` chooses number by number.
"""

LANES = 4  # numbers of a vector; with eight they do not fit the registers of AVX2

# numbers `real`, points `vec` of such numbers, and what to do with them; it opens a block, which the text behind it closes
NUMBERS = r"""
    {
    #pragma clang fp reassociate(on) contract(fast)
    typedef double real __attribute__((ext_vector_type(LANES)));
    typedef decltype(real() < real()) mask;
    struct vec { real x, y, z; };
    auto plus = [](vec a, vec b) { return vec{a.x + b.x, a.y + b.y, a.z + b.z}; };
    auto minus = [](vec a, vec b) { return vec{a.x - b.x, a.y - b.y, a.z - b.z}; };
    auto times = [](real k, vec a) { return vec{k * a.x, k * a.y, k * a.z}; };
    auto dot = [](vec a, vec b) { return a.x * b.x + a.y * b.y + a.z * b.z; };
    auto cross = [](vec a, vec b) { return vec{a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x}; };
    auto any = [](mask m) {
        long long found = 0;
        for (int l = 0; l < LANES; ++l) found |= m[l];
        return found != 0;
    };
    auto size = [](real square) { return __builtin_elementwise_sqrt(square); };
    auto least = [](real a, real b) { return a < b ? a : b; };
    auto most = [](real a, real b) { return a > b ? a : b; };
    const real zero = 0.0, one = 1.0;
    const mask nowhere = one < zero;
"""
