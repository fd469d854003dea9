"""Closest points of wires: which pairs of segments a step looks at, and the minima of their distance (wire_minima.py).

Wires that hook at a small angle touch on both sides of their crossing, and the two contacts may be closer to each other than a
segment is long. Minima are therefore searched from both ends of a segment; the nearest of a grid of places leads to a nearer one
that both miss. Two different minima have a saddle of the distance between them. One of them may be in the next segment, with the
saddle on this side of the node: the nearest place at the node then stands for it.

Steps look at the pairs alone that may touch soon (`mark_near_pairs`); a pair is evaluated only where the distance of its chords,
less the sag of the curves, is below the contact distance; one that does not touch sleeps until the travel has used up its gap.
A step starts from the closest points of the step before, and searches anew after a travel of RENEWAL_TRAVEL. A closest point
that goes over into another in one step was gone: the other one had appeared unseen. Such a pair is searched in every step from
then on, as wires that vibrate there would gain energy each time.
"""

from typing import Any

import warp as wp

from .control import EVALUATED_GAP, LENGTH_FACTOR, NEAR_GAP, STATUS, STATUS_RUNNING, STATUS_WAITING, is_halted
from .rod_frames import affine_map
from .wire_curve import (
    CLOSING_RATE,
    Bump,
    Nodes,
    closest_on_chords,
    curve_distance,
    curve_of_segment,
    row,
    sag,
    stencil,
)  # fmt: skip
from .wire_minima import (
    NEWTON_ACCURACY,
    are_distinct,
    beyond_saddle,
    closest_on_curves,
    distance_at,
    followed_saddle,
    is_beside,
    nearest_sample,
    projected_end,
    saddle_of,
)  # fmt: skip
from .wire_near import first_of_nodes, first_of_part, first_of_share
from .wire_travel import travel_of_pair

MIN_BARRIER = wp.constant(wp.float64(1.0e-11))  # between two minima, of the contact distance: ten times NEWTON_ACCURACY squared
MISSED = wp.constant(wp.float64(0.01))  # of the contact distance, by which a third minimum has to be nearer than two others
RENEWAL_TRAVEL = wp.constant(wp.float64(0.01))  # of the contact distance
RUNNING_TRAVEL = wp.constant(wp.float64(0.04))  # of the contact distance, beyond that while steps follow each other
SPLIT = wp.constant(wp.float64(0.05))  # of a segment, by which a minimum moves in a step only where it has gone over into another
SPLIT_PAIR = wp.constant(wp.float64(-2.0))  # [m] travel of renewal of a pair that is searched in every step since then
PLACES = 3  # of a pair: two minima and the saddle between them

NOT_NEAR = wp.constant(0)  # minima of a pair; negative where the wires do not touch
ONE_PLACE = wp.constant(1)
TWO_PLACES = wp.constant(2)

# what of a pair that goes on from the step before is found (wire_contact_by_batch.py); 0: nothing
FOLLOWED_PLACE = wp.constant(1)
FOLLOWED_FORCE = wp.constant(2)


@wp.func
def least_distance(
    p: Nodes, q: Nodes, chords: wp.vec2d, bulge_p: wp.float64, bulge_q: wp.float64, weight_p: wp.vec4d, weight_q: wp.vec4d
) -> wp.float64:
    """Bound on the distance of two curves [m]: chord distance at the places `chords`, less both sags."""
    r = row(p, 1) + chords[0] * (row(p, 2) - row(p, 1)) - row(q, 1) - chords[1] * (row(q, 2) - row(q, 1))
    return wp.length(r) - sag(p, bulge_p, weight_p) - sag(q, bulge_q, weight_q)


@wp.func
def offset_of_pair(i: int, j: int, following: wp.array(dtype=wp.int32), contact_offset: wp.array(dtype=wp.float64)) -> wp.float64:
    """[m] bound on what pushes the curves of two segments apart."""
    found = wp.max(contact_offset[i], contact_offset[following[i]])
    return found + wp.max(contact_offset[j], contact_offset[following[j]])


@wp.kernel
def mark_near_pairs(
    # in: pairs
    pair_count: wp.array(dtype=wp.int32),
    first_node: int,
    end_node: int,
    part: int,
    parts: int,
    threads: int,
    pair_start: wp.array(dtype=wp.int32),
    pair_first: wp.array(dtype=wp.int32),
    pair_second: wp.array(dtype=wp.int32),
    pair_shift: wp.array(dtype=wp.vec3d),
    # in: wires
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    node_radius: wp.array(dtype=wp.float64),
    natural_length: wp.array(dtype=wp.float64),
    rest_row: wp.array(dtype=wp.int32),
    rest_slope: wp.array(dtype=wp.vec2d),
    rest_bump: wp.array(dtype=Bump),
    rest_bulge: wp.array(dtype=wp.float64),
    slope_weight: wp.array(dtype=wp.vec4d),
    contact_offset: wp.array(dtype=wp.float64),
    node_block: wp.array(dtype=wp.int32),
    # in: what steers the step; [m] travel of blocks
    world_nodes: int,
    control: wp.array2d(dtype=wp.float64),
    block_travel: wp.array(dtype=wp.float64),
    # state in
    position: wp.array(dtype=wp.vec3d),
    length: wp.array(dtype=wp.float64),
    tangent: wp.array(dtype=Any),
    director: wp.array(dtype=Any),
    # in and out: [m] travel at which the pair may touch, by its gap when last measured and without what pushes it apart
    pair_wake_travel: wp.array(dtype=wp.float64),
    pair_found: wp.array(dtype=wp.int32),
    # out
    pair_is_near: wp.array(dtype=wp.int32),
):
    """The threads of a part share its pairs: whether their wires may be nearer than NEAR_GAP.

    By chords and sag where these suffice; else by `curve_distance`, unless they touched before.
    """
    begin = first_of_nodes(pair_start, pair_count, first_node)
    count = first_of_nodes(pair_start, pair_count, end_node) - begin
    end = begin + first_of_part(count, part + 1, parts)
    for pair in range(begin + first_of_part(count, part, parts) + wp.tid(), end, threads):
        i = pair_first[pair]
        own = control[i / world_nodes]
        if own[STATUS] == STATUS_WAITING:
            continue
        j = pair_second[pair]
        travel = travel_of_pair(i, j, node_block, block_travel, own)
        offset = offset_of_pair(i, j, following, contact_offset)
        gap = CLOSING_RATE * (pair_wake_travel[pair] - travel) - offset
        if gap <= own[NEAR_GAP]:
            p = stencil(i, previous, following, position, length, tangent)
            q = stencil(j, previous, following, position, length, tangent)
            shift = affine_map(pair_shift[pair], own)
            q = q + wp.matrix_from_rows(shift, shift, shift, shift)
            chords = closest_on_chords(row(p, 1), row(p, 2), row(q, 1), row(q, 2))
            length_factor = own[LENGTH_FACTOR]
            of_p = rest_row[i]
            of_q = rest_row[j]
            bulge_p = length_factor * rest_bulge[of_p]
            bulge_q = length_factor * rest_bulge[of_q]
            radii = length_factor * (node_radius[i] + node_radius[j])
            weight_p = slope_weight[of_p]
            weight_q = slope_weight[of_q]
            bound = least_distance(p, q, chords, bulge_p, bulge_q, weight_p, weight_q) - radii
            if bound - offset <= own[NEAR_GAP] and pair_found[pair] == NOT_NEAR:
                curve_p = curve_of_segment(i, p, length_factor, previous, following, natural_length, rest_row, rest_slope,
                                           rest_bump, slope_weight, tangent, director)  # fmt: skip
                curve_q = curve_of_segment(j, q, length_factor, previous, following, natural_length, rest_row, rest_slope,
                                           rest_bump, slope_weight, tangent, director)  # fmt: skip
                bound = wp.max(bound, curve_distance(curve_p, curve_q) - radii)
            pair_wake_travel[pair] = wp.max(pair_wake_travel[pair], travel + bound / CLOSING_RATE)
            gap = wp.max(gap, bound - offset)
        if gap <= own[NEAR_GAP]:
            pair_is_near[pair] = 1
        else:
            pair_is_near[pair] = 0
            pair_found[pair] = NOT_NEAR


@wp.func
def evaluated_gap(control: wp.array(dtype=wp.float64)) -> wp.float64:
    """[m] up to which closest points are found."""
    return wp.where(control[STATUS] == STATUS_RUNNING, wp.float64(0.0), control[EVALUATED_GAP])


@wp.kernel
def empty_pair_lists(
    # out
    touch_awake_count: wp.array(dtype=wp.int32),
    touch_left_count: wp.array(dtype=wp.int32),
    touch_found_count: wp.array(dtype=wp.int32),
):
    touch_awake_count[0] = 0
    touch_left_count[0] = 0
    touch_found_count[0] = 0


@wp.kernel
def list_awake_pairs(
    # in: the pairs that may touch, and all pairs
    touch_pair: wp.array(dtype=wp.int32),
    touch_count: wp.array(dtype=wp.int32),
    threads: int,
    pair_first: wp.array(dtype=wp.int32),
    pair_second: wp.array(dtype=wp.int32),
    pair_wake_travel: wp.array(dtype=wp.float64),
    # in: wires
    following: wp.array(dtype=wp.int32),
    contact_offset: wp.array(dtype=wp.float64),
    node_block: wp.array(dtype=wp.int32),
    # in: what steers the step; [m] travel of blocks
    world_nodes: int,
    control: wp.array2d(dtype=wp.float64),
    block_travel: wp.array(dtype=wp.float64),
    # in and out: places of pairs that sleep are kept
    pair_found: wp.array(dtype=wp.int32),
    # out: pairs that do not sleep, in any order; the others have no force
    touch_loaded: wp.array(dtype=wp.int32),
    touch_awake: wp.array(dtype=wp.int32),
    touch_awake_count: wp.array(dtype=wp.int32),
):
    """On a GPU, where threads of pairs that sleep would wait for the others."""
    for touch in range(wp.tid(), touch_count[0], threads):
        pair = touch_pair[touch]
        i = pair_first[pair]
        own = control[i / world_nodes]
        if is_halted(own):
            continue
        j = pair_second[pair]
        offset = offset_of_pair(i, j, following, contact_offset)
        travel = travel_of_pair(i, j, node_block, block_travel, own)
        if CLOSING_RATE * (pair_wake_travel[pair] - travel) > offset + evaluated_gap(own):
            pair_found[pair] = -wp.abs(pair_found[pair])
            touch_loaded[touch] = 0
        else:
            touch_awake[wp.atomic_add(touch_awake_count, 0, 1)] = touch


@wp.kernel
def find_closest_places(
    # in: the pairs that may touch, the ones to look at, and all pairs
    touch_pair: wp.array(dtype=wp.int32),
    touch_followed: wp.array(dtype=wp.int32),
    touch_left: wp.array(dtype=wp.int32),
    touch_left_count: wp.array(dtype=wp.int32),
    touch_first_start: wp.array(dtype=wp.int32),
    first_node: int,
    end_node: int,
    part: int,
    parts: int,
    threads: int,
    pair_first: wp.array(dtype=wp.int32),
    pair_second: wp.array(dtype=wp.int32),
    pair_shift: wp.array(dtype=wp.vec3d),
    # in: wires
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    node_radius: wp.array(dtype=wp.float64),
    natural_length: wp.array(dtype=wp.float64),
    rest_row: wp.array(dtype=wp.int32),
    rest_slope: wp.array(dtype=wp.vec2d),
    rest_bump: wp.array(dtype=Bump),
    rest_bulge: wp.array(dtype=wp.float64),
    slope_weight: wp.array(dtype=wp.vec4d),
    contact_offset: wp.array(dtype=wp.float64),
    node_block: wp.array(dtype=wp.int32),
    # in: what steers the step; [m] travel of blocks
    world_nodes: int,
    control: wp.array2d(dtype=wp.float64),
    block_travel: wp.array(dtype=wp.float64),
    # state in
    position: wp.array(dtype=wp.vec3d),
    length: wp.array(dtype=wp.float64),
    tangent: wp.array(dtype=Any),
    director: wp.array(dtype=Any),
    # in and out: [m] travel at which a pair may touch, and up to which its places are followed; minima and places
    pair_wake_travel: wp.array(dtype=wp.float64),
    pair_renewal_travel: wp.array(dtype=wp.float64),
    pair_found: wp.array(dtype=wp.int32),
    pair_place: wp.array(dtype=wp.vec2d),
    # out: pairs whose wires touch, in any order, where they are listed; no others have a force
    touch_is_listed: int,
    touch_found: wp.array(dtype=wp.int32),
    touch_found_count: wp.array(dtype=wp.int32),
    touch_loaded: wp.array(dtype=wp.int32),
):
    """Closest places of a part's pairs, shared by its threads. Except pairs continued from the previous step.

    A step evaluates pairs whose curves may touch; an evaluation without a step those whose gap may be below EVALUATED_GAP.
    """
    first = first_of_share(touch_is_listed, touch_left_count, touch_first_start, first_node, end_node, part, parts)
    end = first_of_share(touch_is_listed, touch_left_count, touch_first_start, first_node, end_node, part + 1, parts)
    for k in range(first + wp.tid(), end, threads):
        touch = touch_left[k]
        if touch_followed[touch] != 0:
            continue
        pair = touch_pair[touch]
        i = pair_first[pair]
        own = control[i / world_nodes]
        if is_halted(own):
            continue
        touch_loaded[touch] = 0
        is_running = own[STATUS] == STATUS_RUNNING
        most = evaluated_gap(own)
        found = pair_found[pair]
        j = pair_second[pair]
        travel = travel_of_pair(i, j, node_block, block_travel, own)
        offset = offset_of_pair(i, j, following, contact_offset)
        if CLOSING_RATE * (pair_wake_travel[pair] - travel) > offset + most:
            pair_found[pair] = -wp.abs(found)
            continue
        pair_found[pair] = NOT_NEAR
        p = stencil(i, previous, following, position, length, tangent)
        q = stencil(j, previous, following, position, length, tangent)
        shift = affine_map(pair_shift[pair], own)
        q = q + wp.matrix_from_rows(shift, shift, shift, shift)
        length_factor = own[LENGTH_FACTOR]
        contact_distance = length_factor * (node_radius[i] + node_radius[j]) + offset
        of_p = rest_row[i]
        of_q = rest_row[j]
        weight_p = slope_weight[of_p]
        weight_q = slope_weight[of_q]
        gap = wp.float64(0.0)
        if found <= NOT_NEAR:  # wires that touched may still do so
            chords = closest_on_chords(row(p, 1), row(p, 2), row(q, 1), row(q, 2))
            bulge_p = length_factor * rest_bulge[of_p]
            bulge_q = length_factor * rest_bulge[of_q]
            gap = least_distance(p, q, chords, bulge_p, bulge_q, weight_p, weight_q)
            gap = gap - contact_distance
            if gap > most:
                pair_wake_travel[pair] = travel + (gap + offset) / CLOSING_RATE
                continue
        curve_p = curve_of_segment(i, p, length_factor, previous, following, natural_length, rest_row, rest_slope,
                                   rest_bump, slope_weight, tangent, director)  # fmt: skip
        curve_q = curve_of_segment(j, q, length_factor, previous, following, natural_length, rest_row, rest_slope,
                                   rest_bump, slope_weight, tangent, director)  # fmt: skip
        one = wp.vec2d()
        other = wp.vec2d()
        from_one = wp.vec4d()
        from_other = wp.vec4d()
        place = 3 * pair
        was_two = wp.abs(found) == TWO_PLACES
        is_due = travel > pair_renewal_travel[pair] + wp.where(is_running, RUNNING_TRAVEL, wp.float64(0.0)) * contact_distance
        # of three minima a new search may find another two: two that are known are kept, unless they miss the nearest
        is_followed = found != NOT_NEAR and (was_two or not is_due)
        is_split = pair_renewal_travel[pair] == SPLIT_PAIR
        if is_followed:
            from_one = closest_on_curves(curve_p, curve_q, pair_place[place])
            from_other = from_one
            if was_two:
                from_other = closest_on_curves(curve_p, curve_q, pair_place[place + 1])
            one = wp.vec2d(from_one[0], from_one[1])
            other = wp.vec2d(from_other[0], from_other[1])
            is_followed = wp.max(from_one[2], from_other[2]) < NEWTON_ACCURACY and from_one[3] == wp.float64(0.0)
            is_followed = is_followed and was_two == are_distinct(one, other)
            if is_followed and is_running and not was_two:
                is_split = wp.abs(one[0] - pair_place[place][0]) + wp.abs(one[1] - pair_place[place][1]) > SPLIT
        if not is_followed:
            from_one = closest_on_curves(curve_p, curve_q, projected_end(curve_p, curve_q, wp.float64(0.0)))
            from_other = closest_on_curves(curve_p, curve_q, projected_end(curve_p, curve_q, wp.float64(1.0)))
            one = wp.vec2d(from_one[0], from_one[1])
            other = wp.vec2d(from_other[0], from_other[1])
        if is_due or not is_followed:
            sample = nearest_sample(curve_p, curve_q)
            if not is_beside(sample, one) and not is_beside(sample, other):
                from_sample = closest_on_curves(curve_p, curve_q, sample)
                sample = wp.vec2d(from_sample[0], from_sample[1])
                distance_of_one = distance_at(curve_p, curve_q, one)
                distance_of_other = distance_at(curve_p, curve_q, other)
                missed = wp.min(distance_of_one, distance_of_other) - distance_at(curve_p, curve_q, sample)
                if missed > MISSED * contact_distance:
                    if distance_of_one > distance_of_other:
                        from_one = from_sample
                        one = sample
                    else:
                        from_other = from_sample
                        other = sample
            if not is_split:
                pair_renewal_travel[pair] = travel + RENEWAL_TRAVEL * contact_distance
        if is_split:
            pair_renewal_travel[pair] = SPLIT_PAIR
        minima = ONE_PLACE
        nearest = distance_at(curve_p, curve_q, one)
        other_distance = distance_at(curve_p, curve_q, other)
        is_saddle_known = bool(is_followed)
        touching = wp.vec2d(one)
        if other_distance < nearest:
            touching = wp.vec2d(other)
        is_alone = not are_distinct(one, other) or wp.max(nearest, other_distance) >= contact_distance
        if is_alone and wp.min(nearest, other_distance) < contact_distance:
            from_end = beyond_saddle(curve_p, curve_q, touching)
            if are_distinct(touching, wp.vec2d(from_end[0], from_end[1])):
                from_other = from_end
                one = touching
                other = wp.vec2d(from_end[0], from_end[1])
                nearest = distance_at(curve_p, curve_q, one)
                other_distance = distance_at(curve_p, curve_q, other)
                is_saddle_known = False
        if are_distinct(one, other):
            from_saddle = wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(1.0))
            if is_saddle_known:
                from_saddle = followed_saddle(curve_p, curve_q, pair_place[place + 2])
            saddle = wp.vec2d(from_saddle[0], from_saddle[1])
            if from_saddle[2] >= NEWTON_ACCURACY:
                saddle = saddle_of(curve_p, curve_q, one, other)
            barrier = MIN_BARRIER * contact_distance
            if distance_at(curve_p, curve_q, saddle) > wp.max(nearest, other_distance) + barrier:
                minima = TWO_PLACES
                pair_place[place + 2] = saddle
            elif wp.abs(nearest - other_distance) < barrier:  # along a line
                middle = closest_on_chords(row(p, 1), row(p, 2), row(q, 1), row(q, 2))
                from_one = closest_on_curves(curve_p, curve_q, middle)
                one = wp.vec2d(from_one[0], from_one[1])
            elif other_distance < nearest:
                one = other
            nearest = wp.min(nearest, other_distance)
        if wp.max(from_one[2], from_other[2]) >= NEWTON_ACCURACY:
            pair_renewal_travel[pair] = -wp.float64(1.0)
        pair_place[place] = one
        pair_place[place + 1] = other
        if wp.max(from_one[2], from_other[2]) < NEWTON_ACCURACY:
            gap = nearest - contact_distance
        wake = travel + (gap + offset) / CLOSING_RATE
        # a place that was followed may no longer be the nearest
        pair_wake_travel[pair] = wp.where(is_followed, wp.min(wake, pair_renewal_travel[pair]), wake)
        if is_running and nearest >= contact_distance:
            minima = -minima
        pair_found[pair] = minima
        if touch_is_listed != 0 and minima > NOT_NEAR:
            touch_found[wp.atomic_add(touch_found_count, 0, 1)] = touch
