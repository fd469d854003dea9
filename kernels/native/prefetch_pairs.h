// Prefetch of the data of pairs that a thread will reach soon, behind `touch`. The segments of successive pairs lie far apart in
// memory: a pair reads some forty cache lines, in three turns, as what is read first gives the places of the rest. `stored` is
// the type of the numbers of forces.
enum { AHEAD = 4 }; // pairs
const int count = touch_count.data[0];
if (touch + 3 * AHEAD < count) {
    const int pair = touch_pair.data[touch + 3 * AHEAD];
    fetch(pair_first.data + pair, pair_second.data + pair, pair_shift.data + pair, pair_found.data + pair);
    fetch(pair_arc_separation.data + pair, pair_wake_travel.data + pair, pair_renewal_travel.data + pair,
          pair_place.data + 3 * pair);
}
if (touch + 2 * AHEAD < count) {
    const int pair = touch_pair.data[touch + 2 * AHEAD];
    for (int side = 0; side < 2 && pair_found.data[pair] != 0; ++side) {
        const int i = side ? pair_second.data[pair] : pair_first.data[pair];
        fetch(previous.data + i, following.data + i, rest_row.data + i, node_block.data + i);
        fetch(position.data + i, position.data + i + 1, length.data + i, tangent.data + i, tangent.data + i + 1);
        fetch(director.data + i, director.data + i + 1, natural_length.data + i);
        fetch(contact_offset.data + i, contact_penalty.data + i, node_radius.data + i);
    }
}
if (touch + AHEAD < count) {
    char* force = (char*)(touch_force.data + 8 * (touch + AHEAD));
    char* couple = (char*)(touch_couple.data + 6 * (touch + AHEAD));
    for (int b = 0; b < 8 * 3 * sizeof(stored); b += 64) fetch_to_write(force + b);
    for (int b = 0; b < 6 * 3 * sizeof(stored); b += 64) fetch_to_write(couple + b);
    const int pair = touch_pair.data[touch + AHEAD];
    for (int side = 0; side < 2 && pair_found.data[pair] != 0; ++side) {
        const int row = rest_row.data[side ? pair_second.data[pair] : pair_first.data[pair]];
        fetch(rest_slope.data + row, rest_bump.data + row, slope_weight.data + row);
    }
}
