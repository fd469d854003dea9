"""Openings, the rhombus, and the deepest point of a lens."""

import itertools

import numpy as np
import pytest

from reference.knits import BARS, cloth
from warpknit.knit.clasps import deepest_point, is_inside, polygon_area
from warpknit.knit.openings import find_openings

CONNECTED = [name for name in BARS if name not in ("pillar", "closed pillar")]


@pytest.mark.parametrize("name", CONNECTED)
def test_openings_tile_the_cloth(name):
    """Euler on a torus: crossings - edges + openings = 0, two edges a crossing; areas add up to the repeat."""
    knitted = cloth(name)
    openings = find_openings(knitted.threads, knitted.crossings, knitted.size)
    assert len(openings) == len(knitted.crossings)
    assert sum(opening.area for opening in openings) == pytest.approx(np.prod(knitted.size), rel=1e-9)


def test_repeat_of_the_double_atlas_has_two_large_openings():
    knitted = cloth("paper")
    first, second, third, *_ = find_openings(knitted.threads, knitted.crossings, knitted.size)
    assert first.area == pytest.approx(second.area, rel=1e-6)
    assert third.area < 0.5 * first.area
    apart = first.centre - second.centre
    apart -= np.round(apart / knitted.size) * knitted.size
    assert np.abs(apart) == pytest.approx(0.5 * knitted.size, rel=1e-3)  # staggered: half a repeat across and up


@pytest.mark.parametrize(("merge", "bodies"), [(True, 12), (False, 16)])
def test_rhombus_of_the_double_atlas(merge, bodies):
    """4 primary portions with 3 bodies each: 12 bodies, 24 pairs, all different, all on the edge of one opening."""
    knitted = cloth("paper", merge_lenses=merge)
    rhombus = knitted.rhombus
    assert rhombus.clasps.shape == (bodies, 3)
    pairs = set()
    for index, column, row in rhombus.clasps:
        for arm in knitted.clasps[index].arms:
            lift = int(row) * knitted.threads[arm.thread].length
            pairs.add((arm.thread, arm.column + int(column), round(arm.arc + lift, 9)))
        position = knitted.clasps[index].position + [column, row] * knitted.size
        assert np.all(np.abs(position - rhombus.opening.centre) < 0.6 * knitted.size)
    assert len(pairs) == 2 * bodies
    assert is_inside(rhombus.opening.centre[None], rhombus.opening.outline)[0]
    assert np.all((rhombus.opening.centre >= 0.0) & (rhombus.opening.centre < knitted.size))


def test_rhombus_of_a_longer_atlas_has_two_open_laps_an_edge():
    """4 edges of two open laps each, on four wales; every body of an edge has an arm on one of these laps."""
    knitted = cloth("long double atlas")
    laps = [s for s in knitted.rhombus.opening.stitches if knitted.stitches[s[0]].kind == "open"]
    assert len({knitted.stitches[s].thread for s, _, _ in laps}) == 2
    assert len(knitted.rhombus.clasps) == 20


@pytest.mark.parametrize("name", ["pillar", "closed tricot", "open tricot", "cord", "reverse locknit"])
def test_no_rhombus_where_no_opening_has_four_portions(name):
    assert cloth(name).rhombus is None


def test_deepest_point_of_a_rectangle_lies_on_its_middle_line():
    """Depth of a 3 x 1 rectangle is 1/2, all along its middle third."""
    t = np.linspace(0.0, 1.0, 41)[:-1]
    corners = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 1.0], [0.0, 1.0], [0.0, 0.0]])
    outline = np.concatenate([a + t[:, None] * (b - a) for a, b in itertools.pairwise(corners)])
    assert polygon_area(outline) == pytest.approx(3.0)
    point = deepest_point([outline])
    assert point[1] == pytest.approx(0.5, abs=0.01) and 0.49 < point[0] < 2.51


def test_deepest_point_of_two_discs_lies_in_their_overlap():
    """Unit discs one apart overlap in a lens about (1/2, 0); discs three apart have no common point."""
    angle = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    disc = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    assert deepest_point([disc, disc + [1.0, 0.0]]) == pytest.approx(np.array([0.5, 0.0]), abs=0.02)
    assert deepest_point([disc, disc + [3.0, 0.0]]) is None
