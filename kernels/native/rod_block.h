// What functions on a block of nodes of rods begin with (kernels/rod_blocks.py), behind the type `real` of their numbers.
#include "sharing.h"
// loops run over whole vectors: PAD places behind the last node hold numbers that nothing uses
#ifdef __CUDA_ARCH__
enum { PAD = 1 };
#else
enum { PAD = 8 };
#endif
enum { HALO = 4, SPAN = ROD_BLOCK + 2 * HALO + PAD };
static_assert(PAD > 1 || ROD_LANES + 0 >= SPAN + 0, "a thread of a GPU has one place");
// numbers of places that no thread reads of another one: on a GPU in its registers
#ifdef __CUDA_ARCH__
struct Own {
    real value;
    __device__ real& operator[](int) { return value; }
};
#else
typedef real Own[SPAN];
#endif
const int first = block_first.data[block], count = block_count.data[block];
const int wire = block_wire.data[block];
const int wire_begin = wire_first.data[wire], wire_nodes = wire_count.data[wire], closed = wire_closed.data[wire];
const int wire_end = wire_begin + wire_nodes;
const int to_row = rest_row.data[wire_begin] - wire_begin; // rest data of node i of the wire are in row i + to_row
const double* steer = control.data;
