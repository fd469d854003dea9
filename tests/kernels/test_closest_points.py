"""Newton's method for the closest points of two curves."""

import numpy as np
import warp as wp

from warpknit.kernels.wire_curve import Nodes, Shape, curve_through, derivative_at, point_at
from warpknit.kernels.wire_minima import NEWTON_ACCURACY, closest_on_curves, distance_at

CURVES = 20_000
DIRECTIONS = 32
TURN = wp.constant(wp.float64(2.0 * np.pi / DIRECTIONS))
BESIDE = wp.constant(wp.float64(1.0e-4))  # of a segment


@wp.kernel
def closest(
    one: wp.array(dtype=Nodes),
    other: wp.array(dtype=Nodes),
    start: wp.array(dtype=wp.vec2d),
    # out: places with the last step and whether they are a saddle, distances at the start and at the places, slopes of the
    # distance there, and the least distance a little beside them
    place: wp.array(dtype=wp.vec4d),
    distance: wp.array(dtype=wp.vec2d),
    slope: wp.array(dtype=wp.vec2d),
    beside: wp.array(dtype=wp.float64),
):
    k = wp.tid()
    half = wp.vec4d(0.5, 0.5, 0.5, 0.5)
    p = curve_through(one[k], Shape(), half)
    q = curve_through(other[k], Shape(), half)
    place[k] = closest_on_curves(p, q, start[k])
    at = wp.vec2d(place[k][0], place[k][1])
    distance[k] = wp.vec2d(distance_at(p, q, start[k]), distance_at(p, q, at))
    n = wp.normalize(point_at(p, at[0]) - point_at(q, at[1]))
    slope[k] = wp.vec2d(wp.dot(n, derivative_at(p, at[0])), -wp.dot(n, derivative_at(q, at[1])))
    beside[k] = wp.float64(1.0e300)
    for turn in range(DIRECTIONS):
        angle = wp.float64(turn) * TURN
        beside[k] = wp.min(beside[k], distance_at(p, q, at + BESIDE * wp.vec2d(wp.cos(angle), wp.sin(angle))))


def bent(rng: np.random.Generator) -> np.ndarray:
    """(curve, 4, 3) nodes of segments of length 1 in all directions, whose neighbours turn by up to 2 rad."""
    along = rng.normal(size=(CURVES, 3))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = rng.normal(size=(2, CURVES, 3))
    across -= np.sum(across * along, axis=-1, keepdims=True) * along
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    turn = 2.0 * rng.random((2, CURVES, 1))
    before, after = np.cos(turn) * along + np.sin(turn) * across
    first = 0.5 * rng.normal(size=(CURVES, 3))
    return np.stack([first - before, first, first + along, first + along + after], axis=1)


def test_steps_lead_to_a_minimum_and_never_away_from_it() -> None:
    """From any start: a step may overshoot where curves bend as strongly as they are apart, but it is then halved."""
    rng = np.random.default_rng(1)
    one, other = (wp.array(bent(rng), dtype=Nodes, device="cpu") for _ in range(2))
    start = wp.array(rng.random((CURVES, 2)), dtype=wp.vec2d, device="cpu")
    kinds = wp.vec4d, wp.vec2d, wp.vec2d, wp.float64
    place, distance, slope, beside = (wp.zeros(CURVES, dtype=kind, device="cpu") for kind in kinds)
    wp.launch(closest, CURVES, [one, other, start, place, distance, slope, beside], device="cpu")
    at, last_step, slope = place.numpy()[:, :2], place.numpy()[:, 2], slope.numpy()
    from_start, reached = distance.numpy().T
    assert (reached <= from_start).all()
    is_bounded = ((at == 0.0) & (slope > 0.0)) | ((at == 1.0) & (slope < 0.0))
    has_converged = last_step < float(NEWTON_ACCURACY)
    assert has_converged.mean() > 0.999
    assert np.abs(np.where(is_bounded, 0.0, slope))[has_converged].max() < 1e-6
    # a minimum has nothing nearer beside it: second derivatives are told apart from rounding 1e-4 of a segment away
    is_inside = has_converged & ((at > 0.0) & (at < 1.0)).all(axis=1)
    is_saddle = place.numpy()[:, 3] == 1.0
    nearer = reached - beside.numpy()
    assert is_inside.sum() > 1000 and not is_saddle[~is_inside].any()
    assert nearer[is_inside & ~is_saddle].max() < 1e-12
    assert (nearer[is_inside & is_saddle] > 0.0).all()
