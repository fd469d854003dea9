// `travel` [m] of segments i and j (kernels/wire_travel.py).
const double of_blocks = block_travel.data[node_block.data[i]] + block_travel.data[node_block.data[j]];
const double travel =
    block_travel.shape[0] == 1 ? control.data[TRAVEL] : control.data[TRAVEL] - control.data[STEP_TRAVEL] + 0.5 * of_blocks;
