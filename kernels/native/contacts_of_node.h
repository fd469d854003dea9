// The contacts of the segments on whose curve node i has a weight: as the node before them (role 0), as their first and second
// node, and as the node behind them. `of_contact` takes role, segment, pair, number of the contact, its force, overlap and place
// on the segment.
const int after_node = following.data[i], before_node = previous.data[i];
const int segments[4] = {after_node, i, before_node, before_node >= 0 ? previous.data[before_node] : -1};
const double* places = (const double*)pair_place.data;
const int* start_of_first = touch_first_start.data;
const int* start_of_second = touch_second_start.data;
const auto for_each_contact = [&](const auto& of_contact) {
    for (int role = 0; role < 4; ++role) {
        const int segment = segments[role];
        if (segment < 0 || following.data[segment] < 0) continue;
        for (int side = 0; side < 2; ++side) {
            const int* start = (side ? start_of_second : start_of_first) + segment;
            for (int q = start[0]; q < start[1]; ++q) {
                const int touch = side ? touch_of_second.data[q] : q;
                const int pair = touch_pair.data[touch], found = pair_found.data[pair];
                for (int a = 0; a < (found == ONE_PLACE ? 1 : PLACES) && found > NOT_NEAR; ++a) {
                    const double push = touch_normal_force.data[PLACES * touch + a];
                    const double overlap = touch_overlap.data[PLACES * touch + a];
                    const double place = places[2 * (PLACES * pair + a) + side];
                    of_contact(role, segment, pair, PLACES * touch + a, push, overlap, place);
                }
            }
        }
    }
};
