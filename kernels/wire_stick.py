"""What contacts stick to: how far the surfaces have slipped since, kept from step to step, from segment to segment as a contact
slides along its wires, and from one list of pairs to the next.

A contact of step n leaves n + 1, its place and its slip in the half of the arrays that step n + 1 reads. There a contact takes
the slip of the one nearest to it of the step before, in its own pair or else in one next to it. So none is read while it is
written.
"""

import warp as wp

HANDED = wp.constant(wp.float64(0.5))  # segments between the places of a contact in one step and the next, at most


@wp.func
def neighbour(i: int, way: int, previous: wp.array(dtype=wp.int32), following: wp.array(dtype=wp.int32)) -> int:
    """The segment that is `way` (-1, 0, 1) on from segment i; -1 where there is none."""
    if way < 0:
        return previous[i]
    if way == 0:
        return i
    after = following[i]
    if following[after] < 0:
        return -1
    return after


@wp.func
def pair_of(
    i: int,
    j: int,
    start: wp.array(dtype=wp.int32),
    count: wp.array(dtype=wp.int32),
    second: wp.array(dtype=wp.int32),
) -> int:
    """The pair of segments i < j in the list; -1 where it has none."""
    for k in range(start[i], start[i] + count[i]):
        if second[k] == j:
            return k
    return -1


@wp.func
def stuck_slip(
    pair: int,
    i: int,
    j: int,
    place: wp.vec2d,
    step: int,
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    pair_start: wp.array(dtype=wp.int32),
    pair_count_of: wp.array(dtype=wp.int32),
    pair_second: wp.array(dtype=wp.int32),
    stuck_step: wp.array2d(dtype=wp.int32),
    stuck_place: wp.array2d(dtype=wp.vec2d),
    stuck_by: wp.array2d(dtype=wp.vec3d),
) -> wp.vec3d:
    """[m] slip of the first wire over the second that a contact at these places on segments i and j goes on from."""
    half = step % 2
    slip = wp.vec3d()
    nearest = wp.float64(3.0)
    for k in range(2 * pair, 2 * pair + 2):
        if stuck_step[half, k] == step:
            off = wp.abs(stuck_place[half, k][0] - place[0]) + wp.abs(stuck_place[half, k][1] - place[1])
            if off < nearest:
                nearest = off
                slip = stuck_by[half, k]
    if nearest < wp.float64(3.0):
        return slip
    nearest = HANDED
    for turn in range(9):
        ahead = turn / 3 - 1
        beyond = turn % 3 - 1
        first = neighbour(i, ahead, previous, following)
        second = neighbour(j, beyond, previous, following)
        if turn != 4 and first >= 0 and second >= 0 and first != second:
            other = pair_of(wp.min(first, second), wp.max(first, second), pair_start, pair_count_of, pair_second)
            if other >= 0:
                for k in range(2 * other, 2 * other + 2):
                    if stuck_step[half, k] == step:
                        at = stuck_place[half, k]
                        by = stuck_by[half, k]
                        if first > second:
                            at = wp.vec2d(at[1], at[0])
                            by = -by
                        off = wp.abs(at[0] + wp.float64(ahead) - place[0]) + wp.abs(at[1] + wp.float64(beyond) - place[1])
                        if off < nearest:
                            nearest = off
                            slip = by
    return slip


@wp.kernel
def keep_slips(
    # what steers the step
    step: int,
    # in: the pairs before
    old_start: wp.array(dtype=wp.int32),
    old_count: wp.array(dtype=wp.int32),
    old_second: wp.array(dtype=wp.int32),
    old_shift: wp.array(dtype=wp.vec3d),
    old_step: wp.array2d(dtype=wp.int32),
    old_place: wp.array2d(dtype=wp.vec2d),
    old_slip: wp.array2d(dtype=wp.vec3d),
    # in: the pairs now
    pair_count: wp.array(dtype=wp.int32),
    pair_first: wp.array(dtype=wp.int32),
    pair_second: wp.array(dtype=wp.int32),
    pair_shift: wp.array(dtype=wp.vec3d),
    # out
    stuck_step: wp.array2d(dtype=wp.int32),
    stuck_place: wp.array2d(dtype=wp.vec2d),
    stuck_by: wp.array2d(dtype=wp.vec3d),
):
    """What sticks is remembered from one search to the next; one thread a pair, which has two contacts."""
    pair = wp.tid()
    half = step % 2
    for k in range(2 * pair, 2 * pair + 2):
        stuck_step[half, k] = -1
        stuck_step[1 - half, k] = -1
    if pair >= pair_count[0]:
        return
    i = pair_first[pair]
    for old in range(old_start[i], old_start[i] + old_count[i]):
        if old_second[old] == pair_second[pair] and wp.length(old_shift[old] - pair_shift[pair]) == wp.float64(0.0):
            for a in range(2):
                stuck_step[half, 2 * pair + a] = old_step[half, 2 * old + a]
                stuck_place[half, 2 * pair + a] = old_place[half, 2 * old + a]
                stuck_by[half, 2 * pair + a] = old_slip[half, 2 * old + a]
