// Nodes around those of rod_block.h: local node k is node first - HALO + k of the wire, unrolled around a closed one; segment k
// joins nodes k and k + 1.
const int nodes = count + 2 * HALO, whole = 1 + (nodes - 2 + PAD - 1) / PAD * PAD;
SHARED int at[SPAN];
SHARED real has[SPAN], inner[SPAN];
const bool inside = wire_begin < first - HALO && first + count + HALO < wire_end;
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
