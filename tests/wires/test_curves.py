"""Curves of a file as cubic pieces, and nodes on them: what each basis and wrap means, and how near the curve the nodes are."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

from warpknit.wires.bases import BadFile, cubic, polyline
from warpknit.wires.read import ArcLength, resample, segment_count

RNG = np.random.default_rng(1)
POINTS = RNG.normal(size=(7, 3))


def ring(count: int, radius: float = 1.0) -> np.ndarray:
    angle = 2.0 * np.pi * np.arange(count) / count
    return radius * np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)


def at(pieces: np.ndarray, t: float) -> np.ndarray:
    """(piece, 3) by Bernstein's polynomials."""
    weights = np.array([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3])
    return np.einsum("b,nbk->nk", weights, pieces)


@pytest.mark.parametrize("t", [0.0, 0.3, 1.0])
def test_a_b_spline_is_that_of_scipy(t):
    """A uniform cubic B-spline with knots -3, -2, ... has its first piece between knots 0 and 1."""
    spline = BSpline(np.arange(-3.0, len(POINTS) + 1.0), POINTS, 3)
    pieces = cubic(POINTS, "bspline", "nonperiodic").pieces
    assert np.allclose(at(pieces, t), spline(np.arange(len(pieces)) + t), atol=1e-14)


def test_a_catmull_rom_curve_meets_its_points_with_the_slope_of_their_neighbours():
    pieces = cubic(POINTS, "catmullRom", "nonperiodic").pieces
    assert np.allclose(pieces[:, 0], POINTS[1:-2], atol=0) and np.allclose(pieces[:, 3], POINTS[2:-1], atol=0)
    assert np.allclose(3.0 * (pieces[:, 1] - pieces[:, 0]), 0.5 * (POINTS[2:-1] - POINTS[:-3]), atol=1e-14)
    assert np.allclose(3.0 * (pieces[:, 3] - pieces[:, 2]), 0.5 * (POINTS[3:] - POINTS[1:-2]), atol=1e-14)


@pytest.mark.parametrize(
    ("basis", "wrap", "count", "segments"),
    [  # the table in the documentation of UsdGeomBasisCurves
        ("bezier", "nonperiodic", 4, 1),
        ("bezier", "nonperiodic", 7, 2),
        ("bezier", "nonperiodic", 10, 3),
        ("bspline", "nonperiodic", 5, 2),
        ("bspline", "nonperiodic", 4, 1),
        ("catmullRom", "nonperiodic", 7, 4),
        ("bezier", "periodic", 6, 2),
        ("bezier", "periodic", 9, 3),
        ("bspline", "periodic", 5, 5),
        ("catmullRom", "pinned", 2, 1),
        ("bspline", "pinned", 5, 4),
    ],
)
def test_usd_counts_segments_so(basis, wrap, count, segments):
    curve = cubic(RNG.normal(size=(count, 3)), basis, wrap)
    assert len(curve.pieces) == segments
    assert curve.kind == ("closed" if wrap == "periodic" else "open")
    assert np.allclose(curve.pieces[1:, 0], curve.pieces[:-1, 3], atol=1e-14)
    if wrap == "periodic":
        assert np.allclose(curve.pieces[-1, 3], curve.pieces[0, 0], atol=1e-14)


@pytest.mark.parametrize("basis", ["catmullRom", "bspline"])
def test_a_pinned_curve_begins_and_ends_at_its_end_points(basis):
    pieces = cubic(POINTS, basis, "pinned").pieces
    assert np.allclose(pieces[0, 0], POINTS[0], atol=1e-14) and np.allclose(pieces[-1, 3], POINTS[-1], atol=1e-14)


@pytest.mark.parametrize(
    ("basis", "wrap", "count"),
    [("bezier", "nonperiodic", 5), ("bezier", "periodic", 7), ("bspline", "nonperiodic", 3), ("catmullRom", "pinned", 1)],
)
def test_other_counts_are_no_curves(basis, wrap, count):
    with pytest.raises(BadFile, match=f"a {wrap} {basis} curve of {count} points"):
        cubic(RNG.normal(size=(count, 3)), basis, wrap)


@pytest.mark.parametrize("count", [12, 24, 48])
def test_nodes_of_a_ring_lie_on_the_circle(count):
    """A periodic cubic spline errs by at most 5/384 h^4 max|d4 f| (Hall and Meyer 1976): 5/384 (2 pi/n)^4 R of a circle.

    Here the parameter is the chord, by which the angle runs faster by pi/n over sin(pi/n), and h is shorter by as much.
    """
    curve = polyline(ring(count), "spline", closed=True)
    arc = ArcLength(curve)
    nodes, _ = resample(curve, arc, 100)
    bound = 5.0 / 384.0 * (2.0 * np.pi / count) ** 4
    assert np.abs(np.linalg.norm(nodes[:, :2], axis=1) - 1.0).max() <= bound
    assert abs(arc.length - 2.0 * np.pi) <= 2.0 * np.pi * bound
    step = np.linalg.norm(np.roll(nodes, -1, axis=0) - nodes, axis=1)
    assert np.ptp(step) <= 2.0 * bound * step.mean()


def test_nodes_of_a_helix_converge_with_the_fourth_power_up_to_its_free_ends():
    """Error over error at half the distance: 2^4, less what the ends, which are half as far along, do to so few points."""
    errors = []
    for count in (60, 120):
        t = np.linspace(0.0, 6.0 * np.pi, count)
        curve = polyline(np.stack([np.cos(t), np.sin(t), 0.2 * t], axis=1), "spline")
        arc = ArcLength(curve)
        nodes, _ = resample(curve, arc, 1000)
        angle = nodes[:, 2] / 0.2
        errors.append(np.hypot(nodes[:, 0] - np.cos(angle), nodes[:, 1] - np.sin(angle)).max())
        assert arc.length == pytest.approx(6.0 * np.pi * np.hypot(1.0, 0.2), rel=1e-4)
    assert errors[0] / errors[1] > 2.0**4 * 0.8
    assert errors[1] < 1e-4


def test_nodes_stand_at_equal_arc_length():
    """x = t, y = t^2 as one Bezier piece: its arc length is t/2 sqrt(1 + 4 t^2) + asinh(2 t)/4."""
    points = np.array([[0.0, 0.0, 0.0], [1.0 / 3.0, 0.0, 0.0], [2.0 / 3.0, 1.0 / 3.0, 0.0], [1.0, 1.0, 0.0]])
    curve = cubic(points, "bezier", "nonperiodic")
    arc = ArcLength(curve)
    nodes, _ = resample(curve, arc, 17)
    t = nodes[:, 0]
    length = 0.5 * t * np.sqrt(1.0 + 4.0 * t**2) + 0.25 * np.arcsinh(2.0 * t)
    assert np.allclose(nodes[:, 1], t**2, atol=1e-15)
    # 8 Gauss points on a quarter of the piece leave less than 1e-12
    assert np.allclose(length, np.arange(18) / 17 * length[-1], atol=1e-12)
    assert arc.length == pytest.approx(np.sqrt(5.0) / 2.0 + np.arcsinh(2.0) / 4.0, abs=1e-12)


@pytest.mark.parametrize("interpolation", ["spline", "linear"])
def test_ends_stay_and_straight_wires_stay_straight(interpolation):
    points = np.array([0.0, 0.1, 0.7, 1.0])[:, None] * [3.0, -2.0, 1.0] + [1.0, 1.0, 1.0]
    curve = polyline(points, interpolation)
    nodes, _ = resample(curve, ArcLength(curve), 10)
    assert (nodes[0] == points[0]).all() and (nodes[-1] == points[-1]).all()
    assert np.allclose(nodes, points[0] + np.linspace(0.0, 1.0, 11)[:, None] * (points[-1] - points[0]), atol=1e-12)


def test_straight_interpolation_keeps_corners():
    curve = polyline(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0]]), "linear")
    nodes, _ = resample(curve, ArcLength(curve), 4)
    assert np.allclose(nodes, [[0, 0, 0], [0.5, 0, 0], [1, 0, 0], [1, 0.5, 0], [1, 1, 0]], atol=1e-14)


def test_a_polyline_that_comes_back_to_its_first_point_is_closed():
    points = ring(9)
    back = polyline(np.concatenate([points, points[:1]]), "spline")
    assert back.kind == "closed"
    assert np.allclose(back.pieces, polyline(points, "spline", closed=True).pieces, atol=1e-14)


def test_a_periodic_wire_goes_on_smoothly_into_the_next_repeat():
    """A sine over one period, from an odd place: value and slope at its end are those at its beginning, one repeat on."""
    x = 0.3 + np.arange(40) / 40.0
    points = np.stack([x, 0.2 * np.sin(2.0 * np.pi * x), np.zeros(40)], axis=1)
    curve = polyline(points, "spline", shift=(1, 0), closing=np.array([1.0, 0.0, 0.0]))
    first, last = curve.pieces[0], curve.pieces[-1]
    assert curve.kind == "periodic"
    assert np.allclose(last[3], first[0] + [1.0, 0.0, 0.0], atol=1e-14)
    slopes = [(last[3] - last[2]), (first[1] - first[0])]
    slopes = [slope / np.linalg.norm(slope) for slope in slopes]
    assert np.allclose(*slopes, atol=1e-12)
    nodes, _ = resample(curve, ArcLength(curve), 100)
    assert len(nodes) == 100
    assert np.abs(nodes[:, 1] - 0.2 * np.sin(2.0 * np.pi * nodes[:, 0])).max() < 5.0 / 384.0 * (2.0 * np.pi / 40) ** 4


def test_lengths_free_of_stress_are_carried_along():
    """Edges of rest lengths 0.9 and 0.8 of their own: so much of the wire on either, whatever the nodes."""
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [3.0, 0.0, 0.0]])
    curve = polyline(points, "linear", rest=np.array([0.9, 1.6]))
    _, rest = resample(curve, ArcLength(curve), 6)
    assert np.allclose(rest, [0.45, 0.45, 0.4, 0.4, 0.4, 0.4], atol=1e-12)


@pytest.mark.parametrize(
    ("points", "closed"), [(np.zeros((5, 3)), False), (np.zeros((0, 3)), False), (POINTS[:1], False), (POINTS[:2], True)]
)
def test_points_that_make_no_wire(points, closed):
    with pytest.raises(BadFile, match="[23] points"):
        polyline(points, "spline", closed=closed)


def test_the_number_of_segments():
    assert [segment_count(1.0, "open", spacing) for spacing in (0.1, 0.26, 10.0)] == [10, 4, 2]
    assert segment_count(1.0, "closed", 10.0) == segment_count(1.0, "periodic", 10.0) == 4
