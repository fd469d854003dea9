"""Chain notation is read, and what is wrong with it is said in one line."""

import random

import pytest

from reference.knits import PAPER, Bar
from warpknit.knit.lapping import KnitError, Link, lapping_table, parse_chain, parse_shift, parse_threading


def test_links_name_needle_and_direction():
    assert parse_chain("1-0/1-2/2-2") == (Link(1, 0), Link(1, 2), Link(2, 2))
    assert [(link.needle, link.direction) for link in parse_chain(" 1-0 / 1-2 /2-2")] == [(0, -1), (1, 1), (2, 0)]


@pytest.mark.parametrize(
    "text",
    [
        "",
        "  ",
        None,
        10,
        "1-0/",
        "/1-0",
        "1-0//1-2",
        "1-0/1",
        "1-x",
        "1.5-0",
        "1--0",
        "-1-0",
        "1-0,1-2",
        "0-2",
        "1-0 1-2",
    ],
)
def test_malformed_chain_is_refused(text):
    with pytest.raises(KnitError) as caught:
        parse_chain(text, "knit.bars[0].chain")
    assert caught.value.key == "knit.bars[0].chain" and repr(text) in caught.value.wrong
    assert "\n" not in str(caught.value) and caught.value.instead


def test_laps_that_do_not_return_are_refused():
    """After 2-3 the wire would have to jump back 3 - 1 = 2 needles, where it moved at most 1 before."""
    with pytest.raises(KnitError, match="laps"):
        parse_chain("1-0/1-2/2-3")
    assert len(parse_chain("1-0/2-3")) == 2  # cord: every underlap spans two needles


@pytest.mark.parametrize("text", ["", None, "x", "| .", "..", 1])
def test_malformed_threading_is_refused(text):
    with pytest.raises(KnitError):
        parse_threading(text)


@pytest.mark.parametrize("value", [0.5, "1", None, True])
def test_shift_is_a_whole_number(value):
    with pytest.raises(KnitError):
        parse_shift(value)


def test_empty_needles_are_refused():
    with pytest.raises(KnitError, match="needle 1 of 2 .* course 0"):
        lapping_table([Bar("1-0/0-1", "|.")])
    with pytest.raises(KnitError):
        lapping_table([PAPER[0], Bar(PAPER[1].chain, "|.", 0)])
    with pytest.raises(KnitError):
        lapping_table([])


@pytest.mark.parametrize("seed", range(20))
def test_any_text_is_read_or_refused_by_key(seed):
    """Whatever stands in a chain, the answer is links that render to the same text or a KnitError: nothing else."""
    source = random.Random(seed)
    for _ in range(200):
        text = "".join(source.choice("123-/ |x") for _ in range(source.randint(0, 9)))
        try:
            links = parse_chain(text)
        except KnitError:
            continue
        assert "/".join(f"{link.start}-{link.end}" for link in links) == "/".join(w.strip() for w in text.split("/"))
