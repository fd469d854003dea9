"""Scatter of the loop proportions."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from warpknit.knit.centreline import LoopFrame, Thread
from warpknit.knit.cloth import knit_cloth
from warpknit.knit.lapping import KnitError, lapping_table
from warpknit.knit.loops import RANGES, LoopProportions
from warpknit.knit.named import NAMED_KNITS
from warpknit.knit.scatter import MOST, near_wires, scattered_proportions
from warpknit.scene import make_scene
from warpknit.solve.model import build_model

DIAMETER = 15e-6
INCH = 0.0254


def knit(**values):
    return replace(make_scene({}).knit, **values)


def test_proportions_scatter_by_what_is_asked():
    """Relative deviation of 4000 draws: that of a normal distribution cut off at MOST deviations, 0.954, within 5 %."""
    mean = LoopProportions()
    loops = scattered_proportions([mean] * 4000, 0.05, seed=1)
    share = np.array([loop.closed_radius for loop in loops]) / mean.closed_radius - 1.0
    assert abs(share.mean()) < 4 * 0.05 / np.sqrt(4000)
    assert share.std() == pytest.approx(0.954 * 0.05, rel=0.05)
    assert np.abs(share).max() <= MOST * 0.05
    assert all(low <= getattr(loop, name) <= high for loop in loops for name, (low, high) in RANGES.items())


def test_a_seed_gives_the_same_mesh_and_another_seed_another():
    first, again, other = (knit_cloth.__wrapped__(knit(scatter=0.08, seed=seed), DIAMETER) for seed in (1, 1, 2))
    assert np.array_equal(first.threads[0].points, again.threads[0].points)
    assert not np.allclose(first.threads[0].points, other.threads[0].points, atol=1e-6)


def test_each_loop_of_a_patch_has_its_own_proportions():
    """Two repeats side by side are alike without scatter and differ with it; threads stay whole, clasps are all there."""
    even, uneven = (knit_cloth(knit(scatter=s, seed=3), DIAMETER, tiles=(2, 1)) for s in (0.0, 0.08))

    def difference(cloth):
        a, b = cloth.threads[0], cloth.threads[1]
        return abs(a.length / b.length - 1.0)

    assert difference(even) < 1e-12
    assert difference(uneven) > 1e-3
    assert len(uneven.clasps) == len(even.clasps) == 24
    for thread in uneven.threads:
        steps = np.hypot(*np.diff(thread.points[:, :2], axis=0).T)
        assert np.allclose(steps, thread.spacing, rtol=2e-3)


def test_a_scattered_mesh_is_knitted_as_one_repeat():
    """All loops of a 2 x 2 tile have rest data of their own, those of an even one share them."""
    even, uneven = (
        build_model(make_scene({"knit": {"repeats": [2, 2], "scatter": scatter}, "model": {"boundary": "periodic"}}))
        for scatter in (0.0, 0.08)
    )
    assert uneven.panel.node_count == even.panel.node_count
    assert uneven.panel.body_count == even.panel.body_count == 48
    assert sum(uneven.table.nodes) == 4 * sum(even.table.nodes)
    assert len(uneven.panel.rhombus_bodies) == 12


def named(name, scatter, seed, wales=26, courses=30):
    spacings = {"wale_spacing": INCH / wales, "course_spacing": INCH / courses}
    return knit(bars=tuple(NAMED_KNITS[name].bars), scatter=scatter, seed=seed, **spacings)


def hooks(cloth):
    """Number of clasps, and how often each two wires hook, by the lenses of a clasp."""
    return Counter((*(arm.thread for arm in c.arms), c.arms[1].column - c.arms[0].column, c.lenses) for c in cloth.clasps)


@pytest.mark.parametrize(
    ("name", "diameter", "seed"),
    [
        ("full-double-atlas", 30e-6, 8),
        ("atlas", 30e-6, 5),
        ("tricot", DIAMETER, 0),
        ("tricot", 34e-6, 2),
        ("open-tricot", 30e-6, 8),
        ("locknit", DIAMETER, 3),
        ("reverse-locknit", DIAMETER, 3),
        ("satin", 34e-6, 8),
        ("sharkskin", 34e-6, 5),
        ("queens-cord", 30e-6, 1),
        ("inlaid-pillar", 30e-6, 11),
    ],
)
def test_scattered_loops_hook_as_equal_ones_and_do_not_lie_in_each_other(name, diameter, seed):
    """The same wires hook by as many lenses at 10 %, and centre lines are a thickness apart, or as far as those of equal loops
    less a tenth of it (samples: plus 2 %). With free deviations of each loop all of these differ."""
    even, uneven = (knit_cloth(named(name, scatter, seed), diameter) for scatter in (0.0, 0.1))
    assert hooks(uneven) == hooks(even)
    closest = [near_wires(c.threads, c.size, 2.0 * diameter)[0].min() / diameter for c in (even, uneven)]
    assert closest[1] >= min(1.0, closest[0] / 1.02 - 0.1)


def test_a_tile_of_scattered_loops_hooks_as_often_as_its_repeats():
    """2 x 2 repeats of the tricot, whose wires are copies of the two of a repeat: four times its lenses."""
    even, uneven = knit_cloth(named("tricot", 0.0, 0), DIAMETER), knit_cloth(named("tricot", 0.1, 2), DIAMETER, tiles=(2, 2))
    assert sorted(c.lenses for c in uneven.clasps) == sorted(4 * [c.lenses for c in even.clasps])


def test_loops_of_one_needle_and_course_share_their_deviations():
    """Both bars of a tricot lap needle 0 in course 0: one factor for every proportion of both, another one in course 1."""
    lapping = lapping_table(NAMED_KNITS["tricot"].bars)
    means = [LoopProportions(head_height=0.2), LoopProportions(head_height=0.2), *[LoopProportions(head_height=0.25)] * 2]
    first, second, third, fourth = scattered_proportions(means, 0.05, 1, np.array(lapping.formed_together))
    assert lapping.formed_together == (0, 1, 0, 1)
    assert third.head_height / first.head_height == pytest.approx(1.25) == fourth.head_height / second.head_height
    assert first.head_height != second.head_height


def test_scattered_loops_stay_clear_of_the_next_wale():
    """1.2 courses to a wale: a circle of 0.6 C has room up to (1/2 - shift) W/C less half a wire; larger ones end there."""
    narrow = knit(wale_spacing=1.28e-3, scatter=0.1)
    lapping = lapping_table(narrow.bars)
    frame = LoopFrame(
        "circular-oval", LoopProportions(), 1.28e-3, 1e-3, DIAMETER, lapping, (LoopProportions(),) * len(lapping.stitches)
    )
    limited = frame.with_room([LoopProportions(closed_radius=radius) for radius in (0.5, 0.7)])
    largest = (0.5 - 0.02) * 1.28 - 0.5 * 0.015
    assert [loop.closed_radius for loop in limited.loops] == pytest.approx([0.5, largest])
    assert len(knit_cloth(narrow, DIAMETER).clasps) == 12


def test_near_wires_are_found_through_the_borders():
    """Two straight wires along y at x = 0.01 and 0.97 of a repeat 1 wide: 0.04 apart through its side, 0.05 with 0.03 in z."""
    y = np.arange(200) / 200
    threads = [
        Thread(np.stack([0 * y + x, y, 0 * y + z], axis=1), 1.0, np.full(200, n), 0)
        for n, x, z in ((0, 0.01, 0.0), (1, 0.97, 0.03))
    ]
    distance, stitches = near_wires(threads, np.ones(2), 0.06)
    assert distance.min() == pytest.approx(0.05) and {tuple(sorted(pair)) for pair in stitches.tolist()} == {(0, 1)}
    assert not len(near_wires(threads, np.ones(2), 0.049)[0])


def test_loops_that_hook_otherwise_are_refused():
    """Seed 1 at 20 %: an inlay and a pillar have no crossing with the signs of a corner of their lens."""
    with pytest.raises(KnitError, match="knit.seed = 1 "):
        knit_cloth(named("inlaid-pillar", 0.2, 1), DIAMETER)
