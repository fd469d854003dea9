"""Overlaps of wires against distances that are known: of straight wires, rings and coils, and through the borders of a repeat."""

import numpy as np
import pytest
from scipy.optimize import minimize

from reference.in_words import quantities
from warpknit.wires.centre_lines import Wires
from warpknit.wires.overlaps import find_overlaps, segment_distances

RNG = np.random.default_rng(3)


def make(*wires, kinds=None, shifts=None, period=None) -> Wires:
    return Wires(
        points=tuple(np.asarray(points, dtype=float) for points in wires),
        kinds=kinds or ("open",) * len(wires),
        shifts=np.array(shifts or [(0, 0)] * len(wires)),
        period=None if period is None else np.array(period, dtype=float),
        radius=None,
        rest_lengths=None,
    )


def straight(start, end, count=21):
    return np.asarray(start) + np.linspace(0.0, 1.0, count)[:, None] * (np.asarray(end, dtype=float) - start)


def test_distances_of_segments_are_the_least_there_are():
    """Of 40 random pairs, against a minimiser; and of parallel, crossing and pointlike ones."""
    ends = RNG.normal(size=(4, 40, 3))
    found, on_a, on_b = segment_distances(*ends)

    def apart(place, pair):
        a, b, c, d = ends[:, pair]
        return float(np.sum((a + place[0] * (b - a) - c - place[1] * (d - c)) ** 2))

    for pair in range(40):
        least = min(
            minimize(apart, start, args=(pair,), bounds=[(0, 1)] * 2, tol=1e-14).fun for start in ([0.5, 0.5], [0, 1], [1, 0])
        )
        assert found[pair] == pytest.approx(np.sqrt(least), abs=1e-6)
        assert apart((on_a[pair], on_b[pair]), pair) == pytest.approx(found[pair] ** 2, abs=1e-12)
    x, y = np.eye(3)[:2]
    special = segment_distances(
        np.array([0 * x, -x, 0 * x, x]), np.array([x, x, 0 * x, x]), np.array([y, -y, y, 3 * x]), np.array([x + y, y, y, 3 * x])
    )[0]
    assert special == pytest.approx([1.0, 0.0, 1.0, 2.0], abs=1e-15)


@pytest.mark.parametrize("gap", [0.7, 0.998, 0.9995, 1.0001, 1.5, 1.99])
def test_two_wires_that_cross(gap):
    """At right angles, `gap` diameters apart, 0.53 along the one and 0.21 along the other. An overlap of 0.1 % is none."""
    d = 0.05
    found = find_overlaps(make(straight([0, 0, 0], [1, 0, 0]), straight([0.53, -0.21, gap * d], [0.53, 0.79, gap * d])), d)
    assert found.closest == pytest.approx(gap * d, rel=1e-12)
    assert found.wires == (0, 1) and found.arcs == pytest.approx((0.53, 0.21))
    assert found.places == (gap < 0.999)
    assert not found.crowded


def test_wires_far_apart():
    found = find_overlaps(make(straight([0, 0, 0], [1, 0, 0]), straight([0, 0.2, 0], [1, 0.2, 0])), 0.05)
    assert found.closest is None and found.places == 0
    assert quantities(found.line()) == ["2", "50 mm"]


@pytest.mark.parametrize("spacing", [0.2, 1.0, 5.0])
def test_a_bent_wire_does_not_overlap_itself_whatever_its_nodes(spacing):
    """A ring with a radius of 1.5 diameters, and nodes from a fifth of a diameter to five diameters apart."""
    d = 0.1
    count = max(6, round(2.0 * np.pi * 1.5 / spacing))
    angle = 2.0 * np.pi * np.arange(count) / count
    ring = 1.5 * d * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    found = find_overlaps(make(ring, kinds=("closed",)), d)
    assert found.places == 0


def test_a_coil_overlaps_itself_where_its_turns_are_close():
    """Three turns with a pitch of 0.8 diameters: neighbouring turns overlap all along, as one place."""
    d = 0.1
    angle = np.linspace(0.0, 6.0 * np.pi, 300)
    coil = np.stack([np.cos(angle), np.sin(angle), 0.8 * d * angle / (2.0 * np.pi)], axis=1)
    found = find_overlaps(make(coil), d)
    # the centre lines of two turns of a helix are nearest across its slope
    assert found.closest == pytest.approx(0.8 * d, rel=1e-3)
    assert found.places == 1 and found.wires == (0, 0)


def test_wires_meet_through_the_border_of_a_repeat():
    """A wire along x at the lower border and one at the upper, 0.02 below it: 0.02 + 0.01 apart in the next repeat."""
    wires = make(
        straight([0, 0.01, 0], [1, 0.01, 0])[:-1],
        straight([0, 0.98, 0], [1, 0.98, 0])[:-1],
        kinds=("periodic",) * 2,
        shifts=[(1, 0)] * 2,
        period=(1.0, 1.0),
    )
    found = find_overlaps(wires, 0.02)
    assert found.closest == pytest.approx(0.03, rel=1e-12) and found.places == 0
    assert find_overlaps(wires, 0.04).places == 1


def test_a_wire_meets_itself_in_the_next_repeat():
    """A straight wire that repeats 0.05 on: its copies lie beside it; along itself it goes on and does not overlap."""
    alone = make(straight([0.5, 0, 0], [0.5, 1, 0])[:-1], kinds=("periodic",), shifts=[(0, 1)], period=(0.05, 1.0))
    found = find_overlaps(alone, 0.06)
    assert found.closest == pytest.approx(0.05, rel=1e-12) and found.wires == (0, 0)
    assert found.places == 1
    assert find_overlaps(alone, 0.04).places == 0


@pytest.mark.parametrize("start", [0.0, 0.25, 0.31, 0.99])
def test_what_is_found_does_not_depend_on_where_a_wire_begins(start):
    """Two waves that cross twice a period, wherever the first begins and in whichever repeat it is drawn."""

    def wave(begin, phase, height):
        x = begin + np.arange(60) / 60.0
        return np.stack([x, 0.3 * np.sin(2.0 * np.pi * x + phase), np.full(60, height)], axis=1)

    options = {"kinds": ("periodic",) * 2, "shifts": [(1, 0)] * 2, "period": (1.0, 1.0)}
    found = find_overlaps(make(wave(start + 3.0, 0.0, 0.0), wave(0.1, 2.0, 0.02), **options), 0.03)
    assert found.places == 2
    assert found.closest == pytest.approx(0.02, rel=0.02)


def test_a_wrong_unit_is_said_and_not_computed():
    points = RNG.uniform(size=(20_000, 3))
    found = find_overlaps(make(*points.reshape(200, 100, 3)), 100.0)
    assert found.crowded and found.line().endswith("?")
    alone = make(straight([0, 0, 0], [1e-6, 0, 0])[:-1], kinds=("periodic",), shifts=[(1, 0)], period=(1e-6, 1e-6))
    assert find_overlaps(alone, 1.0).crowded


@pytest.mark.parametrize("start", [0, 1, 20, 99])
def test_nor_on_where_a_ring_begins(start):
    """Two rings side by side, 1.2 radii apart and one a little above the other, cross twice, at (0.6, +-0.8)."""
    angle = 2.0 * np.pi * (np.arange(100) + start + 0.2) / 100
    ring = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    found = find_overlaps(make(ring, ring + [1.2, 0.0, 0.02], kinds=("closed",) * 2), 0.03)
    assert found.places == 2
    assert found.closest == pytest.approx(0.02, abs=1e-3 * 0.02)
