// Numbers of pairs (kernels/wire_contact_by_batch.py): several side by side in a vector of a CPU, those of one by QUAD threads
// on a GPU, where they stand in memory that its threads share. `lane` is the number of the thread among those of a pair.
//
// Numbers `real`, points `vec` of such numbers, and what to do with them. Masks hold the answers to comparisons: `mask ? one :
// other` chooses number by number. On a GPU a number is the same in the threads of a pair, and each of the first three has one
// component of its points.
#ifdef __CUDA_ARCH__
enum { LANES = 1 };
typedef double real;
typedef bool mask;
typedef real vec;
const unsigned quad = 0xfu << (threadIdx.x % 32 - lane);
const auto of_axis = [=](real a, int axis) { return __shfl_sync(quad, a, axis, 4); };
const int left = lane < 3 ? (lane + 1) % 3 : 3, right = lane < 3 ? (lane + 2) % 3 : 3;
auto plus = [](vec a, vec b) { return a + b; };
auto minus = [](vec a, vec b) { return a - b; };
auto times = [](real k, vec a) { return k * a; };
auto dot = [=](vec a, vec b) {
    real sum = lane < 3 ? a * b : 0.0;
    sum += __shfl_xor_sync(quad, sum, 1, 4);
    return sum + __shfl_xor_sync(quad, sum, 2, 4);
};
auto cross = [=](vec a, vec b) { return of_axis(a, left) * of_axis(b, right) - of_axis(a, right) * of_axis(b, left); };
auto no = [](mask m) { return !m; };
auto any = [](mask m) { return m; };
auto size = [](real square) { return sqrt(square); };
auto of_lane = [](auto numbers, int) { return numbers; };
auto set = [](real& numbers, int, double value) { numbers = value; };
// points, as rows of numbers and in memory
const int own = lane < 3 ? lane : 2;
auto vector = [=](const real* v, int row) -> vec { return v[row + own]; };
auto keep = [=](double* v, int row, double factor, const auto* point) { v[row + own] = factor * point[own]; };
auto add = [=](double* v, int row, double x, double y, double z) {
    if (lane < 3) v[row + lane] += lane == 0 ? x : (lane == 1 ? y : z);
};
auto put = [=](auto* point, vec a, int) {
    if (lane < 3) point[lane] = a;
};
auto together = [=]() { __syncwarp(quad); };
#define UNROLLED _Pragma("unroll")
#else
enum { LANES = CPU_LANES };
typedef double real __attribute__((ext_vector_type(LANES)));
typedef decltype(real() < real()) mask;
struct vec { real x, y, z; };
auto plus = [](vec a, vec b) { return vec{a.x + b.x, a.y + b.y, a.z + b.z}; };
auto minus = [](vec a, vec b) { return vec{a.x - b.x, a.y - b.y, a.z - b.z}; };
auto times = [](real k, vec a) { return vec{k * a.x, k * a.y, k * a.z}; };
auto dot = [](vec a, vec b) { return a.x * b.x + a.y * b.y + a.z * b.z; };
auto cross = [](vec a, vec b) { return vec{a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x}; };
auto no = [](mask m) { return ~m; };
auto any = [](mask m) {
    long long found = 0;
    for (int l = 0; l < LANES; ++l) found |= m[l];
    return found != 0;
};
auto size = [](real square) { return __builtin_elementwise_sqrt(square); };
auto of_lane = [](auto numbers, int l) { return numbers[l]; };
auto set = [](real& numbers, int l, double value) { numbers[l] = value; };
auto vector = [](const real* v, int row) { return vec{v[row], v[row + 1], v[row + 2]}; };
auto keep = [](double* v, int row, double factor, const auto* point) {
    for (int k = 0; k < 3; ++k) v[(row + k) * LANES] = factor * point[k];
};
auto add = [](double* v, int row, double x, double y, double z) {
    v[row * LANES] += x;
    v[(row + 1) * LANES] += y;
    v[(row + 2) * LANES] += z;
};
auto together = []() {};
#define UNROLLED
auto put = [](auto* point, vec a, int l) {
    point[0] = a.x[l];
    point[1] = a.y[l];
    point[2] = a.z[l];
};
#endif
auto least = [](real a, real b) { return a < b ? a : b; };
auto most = [](real a, real b) { return a > b ? a : b; };
const real zero = 0.0, one = 1.0;
const mask nowhere = one < zero;
