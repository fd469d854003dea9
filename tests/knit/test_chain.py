"""Chain notation is read, and what is wrong with it is said in one line."""

import random

import pytest

from reference.knits import PAPER, Bar
from warpknit.base.errors import SceneError
from warpknit.knit.lapping import KnitError, Link, lapping_table, parse_chain
from warpknit.scene import make_scene


def test_links_name_needle_and_direction():
    assert parse_chain("1-0/1-2/2-2") == (Link(1, 0), Link(1, 2), Link(2, 2))
    assert [(link.needle, link.direction) for link in parse_chain("1-0/1-2/2-2")] == [(0, -1), (1, 1), (2, 0)]


def test_an_overlap_of_two_needles_is_refused():
    with pytest.raises(KnitError) as caught:
        parse_chain("1-0/0-2", "knit.bars[0].chain")
    assert caught.value.key == "knit.bars[0].chain" and "'0-2' at place 2" in caught.value.wrong and caught.value.instead


@pytest.mark.parametrize(
    "text",
    ["", "  ", None, 10, "1-0/", "/1-0", "1-0//1-2", "1-0/1", "1-x", "1.5-0", "1--0", "-1-0", "1-0,1-2", "1-0 1-2"],
)
def test_a_scene_refuses_a_malformed_chain(text):
    with pytest.raises(SceneError) as caught:
        make_scene({"knit": {"bars": [{"chain": text}]}})
    assert caught.value.key == "knit.bars[0].chain" and "\n" not in str(caught.value)


def test_laps_that_do_not_return_are_refused():
    """After 2-3 the wire would have to jump back 3 - 1 = 2 needles, where it moved at most 1 before."""
    with pytest.raises(KnitError, match="laps"):
        parse_chain("1-0/1-2/2-3")
    assert len(parse_chain("1-0/2-3")) == 2  # cord: every underlap spans two needles


@pytest.mark.parametrize(
    ("name", "value"),
    [*(("threading", text) for text in ("", None, "x", "| .", "..", 1)), *(("shift", n) for n in (0.5, "1", True))],
)
def test_a_scene_refuses_a_malformed_bar(name, value):
    with pytest.raises(SceneError) as caught:
        make_scene({"knit": {"bars": [{"chain": "1-0/1-2", name: value}]}})
    assert caught.value.key == f"knit.bars[0].{name}"


def test_empty_needles_are_refused():
    with pytest.raises(KnitError, match="needle 1 of 2 .* course 0"):
        lapping_table([Bar("1-0/0-1", "|.")])
    with pytest.raises(KnitError):
        lapping_table([PAPER[0], Bar(PAPER[1].chain, "|.", 0)])
    with pytest.raises(SceneError):
        make_scene({"knit": {"bars": []}})


@pytest.mark.parametrize("seed", range(20))
def test_any_text_is_read_or_refused_by_key(seed):
    """Whatever stands in a chain, the answer is a scene, or an error with the key of the chain or of the knit."""
    source = random.Random(seed)
    for _ in range(50):
        text = "".join(source.choice("123-/ |x") for _ in range(source.randint(0, 9)))
        try:
            (bar,) = make_scene({"knit": {"bars": [{"chain": text}]}}).knit.bars
            lapping_table([bar])
        except (SceneError, KnitError) as error:
            assert error.key.startswith("knit.bars")
