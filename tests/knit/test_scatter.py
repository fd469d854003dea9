"""Scatter of the loop proportions."""

from dataclasses import replace

import numpy as np
import pytest

from warpknit.knit.chain import KnitError
from warpknit.knit.cloth import knit_cloth
from warpknit.knit.loops import RANGES, LoopProportions
from warpknit.knit.scatter import MOST, scattered_proportions
from warpknit.model import build_model
from warpknit.scene import make_scene

DIAMETER = 15e-6


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
    first, again, other = (knit_cloth(knit(scatter=0.08, seed=seed), DIAMETER) for seed in (1, 1, 2))
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


def test_loops_that_hook_otherwise_are_refused():
    """Seed 3 at 15 % knits 13 clasps where 12 are meant."""
    with pytest.raises(KnitError, match="hook 13 times where 12 are meant"):
        build_model(make_scene({"knit": {"scatter": 0.15, "seed": 3}, "model": {"boundary": "periodic"}}))
