"""The lapping table: who wraps which needle when, closed or open."""

import pytest

from reference.knits import BARS, PAPER
from warpknit.knit.lapping import lapping_table
from warpknit.knit.loops import LoopProportions, loop_shape


def test_double_atlas_turns_with_closed_laps_and_travels_with_open_ones():
    lapping = lapping_table(PAPER)
    assert (lapping.wales, lapping.courses, len(lapping.stitches)) == (2, 4, 8)
    first = lapping.threads[0]
    assert [s.needle for s in first] == [0, 1, 2, 1]
    assert [s.kind for s in first] == ["closed", "open", "closed", "open"]
    assert [s.direction for s in first] == [-1, 1, 1, -1]
    assert all(s.kind == ("closed" if s.course % 2 == 0 else "open") for s in lapping.stitches)


def test_double_atlas_has_one_wire_on_each_needle_bars_alternating():
    lapping = lapping_table(PAPER)
    bar = {(s.needle % 2, s.course): s.bar for s in lapping.stitches}
    assert len(bar) == 8
    assert all(bar[0, course] != bar[1, course] for course in range(4))


@pytest.mark.parametrize(
    ("name", "size", "kinds"),
    [
        ("pillar", (1, 2), {"open"}),
        ("closed pillar", (1, 1), {"closed"}),
        ("closed tricot", (1, 2), {"closed"}),
        ("open tricot", (1, 2), {"open"}),
        ("cord", (1, 2), {"closed"}),
        ("inlaid pillar", (1, 2), {"inlay", "open"}),
        ("long double atlas", (2, 6), {"closed", "open"}),
    ],
)
def test_known_knits(name, size, kinds):
    lapping = lapping_table(BARS[name])
    assert (lapping.wales, lapping.courses) == size
    assert {s.kind for s in lapping.stitches} == kinds


def test_bars_that_share_a_needle_nest():
    lapping = lapping_table(BARS["reverse locknit"])
    assert {(s.bar, s.layer) for s in lapping.stitches} == {(0, 0), (1, 1)}


def test_tiles_repeat_the_pattern():
    lapping = lapping_table(PAPER, tiles=(3, 2))
    assert (lapping.wales, lapping.courses, len(lapping.stitches)) == (6, 8, 48)


def test_only_the_double_atlas_net_is_circular_and_oval():
    shapes = {name: loop_shape(lapping_table(bars), LoopProportions()) for name, bars in BARS.items()}
    assert {name for name, shape in shapes.items() if shape == "circular-oval"} == {"paper"}
