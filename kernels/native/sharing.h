// For a function that many threads work on; `lane` is the number of a thread among them. On a GPU they are the threads of a CUDA
// block: each takes at most one entry of a loop over EACH, which has no more than they are, and some of one over EVERY; entries
// of others are read behind TOGETHER. On a CPU the first one takes all.
//
// Arrays of all threads are marked as SHARED: on a GPU native_text.py makes them members of one shared object, whose address a
// thread computes once. SHARED_AGAIN declares an array that takes the place of another one there, which is not read afterwards.
#ifdef __CUDA_ARCH__
#define EACH(k, low, high) for (int k = lane, goes = k >= (low) && k < (high); goes; goes = 0)
#define EVERY(k, low, high) for (int k = (low) + lane; k < (high); k += blockDim.x)
#define TOGETHER __syncthreads();
#define SHARED_AGAIN(array, other) auto& array = other;
#define VECTORISED
TOGETHER
#else
#define EACH(k, low, high) for (int k = (low); k < (high); ++k)
#define EVERY(k, low, high) EACH(k, low, high)
#define TOGETHER
#define SHARED_AGAIN(array, other) decltype(other) array;
#define VECTORISED _Pragma("clang fp reassociate(on) contract(fast)") _Pragma("clang loop vectorize(enable)")
if (lane > 0) return;
#endif
