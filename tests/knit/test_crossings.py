"""Crossings of synthetic wires where the answer is known by hand, and their invariants on knits."""

import numpy as np
import pytest

from reference.knits import BARS, PAPER, Knit, cloth
from warpknit.knit.centreline import Thread
from warpknit.knit.cloth import knit_cloth
from warpknit.knit.crossings import find_crossings


def wave(amplitude, phase, height, x=0.0, count=480):
    """A thread x + amplitude sin(2 pi (y + phase)) of period 1 at z = height."""
    y = np.arange(count) / count
    points = np.stack([x + amplitude * np.sin(2 * np.pi * (y + phase)), y, np.full(count, height)], axis=1)
    step = np.diff(np.concatenate([points, points[:1] + [0.0, 1.0, 0.0]])[:, :2], axis=0)
    return Thread(points, float(np.hypot(step[:, 0], step[:, 1]).sum()), np.zeros(count, dtype=int), 0)


def test_two_waves_in_antiphase_cross_twice_a_period():
    """x = a sin and x = -a sin cross at y = 0 and 1/2, the second wire to the left of the first and to the right."""
    found = find_crossings([wave(0.1, 0.0, 1.0), wave(0.1, 0.5, 0.0)], np.array([1.0, 1.0]))
    assert len(found) == 2
    order = np.argsort(found.position[:, 1])
    assert found.position[order] == pytest.approx(np.array([[0.0, 0.0], [0.0, 0.5]]), abs=1e-9)
    assert list(found.over) == [1, 1] and list(found.turn[order]) == [1, -1]
    assert found.gap == pytest.approx([1.0, 1.0])


def test_wire_crosses_copies_of_itself():
    """Copies of one wave are parallel; waves in antiphase cross where 1.6 sin(2 pi y) = k for each column k."""
    assert len(find_crossings([wave(0.8, 0.0, 1.0)], np.array([1.0, 1.0]))) == 0
    both = find_crossings([wave(0.8, 0.0, 1.0), wave(0.8, 0.5, 0.0)], np.array([1.0, 1.0]))
    assert len(both) == 6 and set(both.column[:, 1] - both.column[:, 0]) == {-1, 0, 1}


@pytest.mark.parametrize("name", BARS)
def test_arcs_lead_to_the_crossing_on_both_wires(name):
    knitted = cloth(name)
    found = knitted.crossings
    for role in (0, 1):
        for k in range(len(found)):
            thread = knitted.threads[found.thread[k, role]]
            point = thread.at(found.arc[k, role], knitted.size[1])[:2] + [found.column[k, role] * knitted.size[0], 0.0]
            assert point == pytest.approx(found.position[k], abs=1e-9)
    assert np.all((found.position > -1e-9) & (found.position < knitted.size + 1e-9))
    assert found.gap.min() > 1.25 * 15e-6


def test_against_brute_force():
    """Every segment against every other of a coarse copy of the threads, all shifts: the same crossings."""
    knitted = cloth("closed tricot")
    thread = knitted.threads[0]
    sparse = Thread(thread.points[::8], thread.length, thread.stitch[::8], 0)
    found = find_crossings([sparse], knitted.size)
    start = sparse.points[:, :2]
    end = np.concatenate([start[1:], start[:1] + [0.0, knitted.size[1]]])
    count = 0
    for column in range(-3, 4):
        for row in range(-3, 4):
            shift = np.array([column, row]) * knitted.size
            u, v = (end - start)[:, None], (end - start)[None]
            offset = start[None] + shift - start[:, None]
            cross = u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]
            with np.errstate(all="ignore"):
                t = (offset[..., 0] * v[..., 1] - offset[..., 1] * v[..., 0]) / cross
                s = (offset[..., 0] * u[..., 1] - offset[..., 1] * u[..., 0]) / cross
            hit = (t >= 0) & (t < 1) & (s >= 0) & (s < 1)
            i, j = np.nonzero(hit)
            if column == 0:
                near = np.abs(i - j - row * len(start)) <= 1
                i = i[~near]
            count += len(i)
    assert len(found) == count // 2 > 0


def test_tiles_repeat_crossings_and_clasps():
    """Two by two repeats taken as one hold four times what one repeat holds."""
    one, four = cloth("paper"), knit_cloth(Knit(PAPER), 15e-6, tiles=(2, 2))
    assert len(four.crossings) == 4 * len(one.crossings)
    assert len(four.clasps) == 4 * len(one.clasps)
    assert len(four.rhombus.clasps) == len(one.rhombus.clasps)
