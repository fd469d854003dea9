"""Blocks of nodes of rods: what the native functions on them begin with, behind the type `real` of their numbers.

A block holds at most ROD_BLOCK consecutive nodes of one wire. A thread works on a block, or, on a GPU, ROD_LANES threads share it
(native.py).
"""

from warpknit.kernels.native import SHARING, STEERING, constants

ROD_BLOCK = 50  # with the three nodes on either side that take part a multiple of 8 numbers, without a remainder in vectors
ROD_LANES = 64  # whole warps for the nodes of a block and those around it

BLOCK = (
    STEERING
    + SHARING
    + constants(ROD_BLOCK=ROD_BLOCK, ROD_LANES=ROD_LANES)
    + r"""
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
"""
)

# for BLOCK: local node k is node first - HALO + k of the wire, unrolled around a closed one; segment k joins nodes k and k + 1
AROUND = r"""
    const int nodes = count + 2 * HALO, whole = 1 + (nodes - 2 + PAD - 1) / PAD * PAD;
    SHARED int at[SPAN];
    SHARED real has[SPAN], inner[SPAN];
    const bool inside = first - HALO > wire_begin && first + count + HALO < wire_end;
    EACH(k, 0, whole) {
        int i = first - HALO + (k < nodes ? k : nodes - 1);
        if (inside) {
            has[k] = inner[k] = 1;
        } else if (closed) {
            while (i < wire_begin) i += wire_nodes;
            while (i >= wire_end) i -= wire_nodes;
            has[k] = inner[k] = 1;
        } else {
            has[k] = i >= wire_begin && i < wire_end - 1 ? 1 : 0;
            inner[k] = i > wire_begin && i < wire_end - 1 ? 1 : 0;
            i = i < wire_begin ? wire_begin : (i >= wire_end ? wire_end - 1 : i);
        }
        at[k] = i;
    }
"""
