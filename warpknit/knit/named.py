"""Knits by name: the guide bars of common warp knits, in one table.

The last bar of a knit is the front guide bar, whose underlaps lie outermost. An underlap over n needles is the n x 1 movement of
the trade.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from dataclasses import dataclass

from ..base.text import either
from .lapping import KnitError


@dataclass(frozen=True)
class GuideBar:
    """A guide bar: chain, threading and shift [needles], as in `[knit] bars`."""

    chain: str
    threading: str = "|"
    shift: int = 0

    def __str__(self) -> str:
        """The chain, with threading and shift unless they are the defaults."""
        threading = f" {self.threading}" if self.threading != "|" else ""
        return f"{self.chain}{threading}{f' shift {self.shift}' if self.shift else ''}"


@dataclass(frozen=True)
class NamedKnit:
    """A warp knit: its bars from back to front, and the spacings and the strain at which scenes of it begin."""

    name: str  # as it is typed
    title: str  # in prose
    bars: tuple[GuideBar, ...]
    about: str  # in a line
    wales: int = 26  # an inch
    courses: int = 30  # an inch
    strain: int = 6  # [%] in weft and warp: some contacts close, and the draft and standard presets converge


def _threaded(name: str, chains: Iterable[str], about: str, title: str = "", **begin: int) -> NamedKnit:
    """A knit whose guides all have a wire; title: default its name."""
    return NamedKnit(name, title or name.replace("-", " "), tuple(GuideBar(chain) for chain in chains), about, **begin)


_ATLAS = ("1-0/1-2/2-3/2-1", "2-3/2-1/1-0/1-2")
_KNITS = (
    NamedKnit(
        "double-atlas",
        "half-set double atlas",
        (GuideBar(_ATLAS[0], "|."), GuideBar(_ATLAS[1], "|.", 1)),
        "an open net of two bars in opposition over three needles, every other guide threaded",
        wales=15,
        courses=25,
        strain=10,
    ),
    _threaded("full-double-atlas", _ATLAS, "two bars in opposition over three needles, every guide threaded"),
    _threaded("atlas", ("1-0/1-2/2-3/3-4/3-2/2-1",), "one bar, over four needles and back", "single atlas"),
    _threaded(
        "tricot", ("1-0/1-2", "1-2/1-0"), "two bars in opposition, underlaps over one needle, closed loops", "closed tricot"
    ),
    _threaded("open-tricot", ("0-1/2-1", "2-1/0-1"), "two bars in opposition, underlaps over one needle, open loops"),
    _threaded("locknit", ("1-0/1-2", "2-3/1-0"), "underlaps of the front bar over two needles, of the back bar over one"),
    _threaded("reverse-locknit", ("2-3/1-0", "1-0/1-2"), "underlaps of the front bar over one needle, of the back bar over two"),
    _threaded(
        "satin", ("1-0/1-2", "3-4/1-0"), "underlaps of the front bar over three needles, of the back bar over one", strain=5
    ),
    _threaded("sharkskin", ("3-4/1-0", "1-0/1-2"), "underlaps of the front bar over one needle, of the back bar over three"),
    _threaded(
        "queens-cord",
        ("3-4/1-0", "1-0/0-1"),
        "pillars of the front bar, underlaps of the back bar over three needles",
        "queen's cord",
    ),
    _threaded(
        "inlaid-pillar",
        ("0-0/2-2", "1-0/0-1"),
        "pillars of the front bar, tied by wires of the back bar that are laid in without loops",
    ),
)
NAMED_KNITS: dict[str, NamedKnit] = {knit.name: knit for knit in _KNITS}


def named_knit(text: str) -> NamedKnit:
    """The knit of a name or title, however it is spelled: "Queen's Cord" is queens-cord.

    Raises `KnitError` for another name.

    >>> named_knit("Queen's Cord").name
    'queens-cord'
    """
    wanted = _plain(text)
    known = {_plain(knit.title): knit for knit in NAMED_KNITS.values()} | NAMED_KNITS
    if wanted in known:
        return known[wanted]
    near = difflib.get_close_matches(wanted, list(known), n=1)
    instead = f"the nearest is {known[near[0]].name}" if near else f"write {either(list(NAMED_KNITS))}"
    raise KnitError("knit", f"{text!r} is no knit", instead)


def _plain(text: str) -> str:
    """A name in small letters, its words joined by hyphens."""
    return "-".join(text.lower().replace("'", "").replace("-", " ").replace("_", " ").split())
