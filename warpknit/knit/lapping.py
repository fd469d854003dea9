"""Chain notation and threading, and the lapping table: which wire wraps which needle in which course of one repeat.

The repeat is as wide as the least common multiple of the threadings [wales] and as high as the least common multiple of the
chains [courses]. A lap of direction s that ends in gap b is closed when the underlap to the next lap (from gap b to a_next) runs
back, sign(a_next - b) = -s, and open otherwise; a = b is an inlay.

A chain such as ``1-0/1-2/2-3/2-1`` lists one link a course.  The numbers are the gaps between needles: gap g lies left
of needle g.  A link ``a-b`` carries the guide across needle min(a, b) in front of the hooks (the overlap); between
links the guide returns behind the needles (the underlap).  ``a-a`` is an inlay: the wire is laid in without a loop.  A
threading such as ``|.`` repeats along the guide bar: ``|`` is a guide with a wire, ``.`` an empty one.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import lcm
from typing import Any, Literal

from ..base.errors import BadValue

_LINK = re.compile(r"(\d+)-(\d+)")


class KnitError(BadValue, ValueError):
    """A knit that cannot be read or made."""


@dataclass(frozen=True)
class Link:
    """One course of a chain: the guide swings from gap `start` to gap `end`."""

    start: int
    end: int

    @property
    def needle(self) -> int:
        """Needle the lap wraps (for an inlay: the needle right of the gap)."""
        return min(self.start, self.end)

    @property
    def direction(self) -> int:
        """Direction of the overlap: +1 towards larger needle numbers, -1 towards smaller, 0 for an inlay."""
        return (self.end > self.start) - (self.end < self.start)


def parse_chain(text: object, key: str = "chain") -> tuple[Link, ...]:
    """Links of a chain such as ``1-0/1-2/2-3/2-1``.

    Raises `KnitError` for an empty chain, a missing link, characters or numbers that are not gaps, an overlap of more
    than one needle, and laps that do not return: the underlap that closes the repeat may not be longer than the
    longest one within the chain (or one needle).

    >>> [(link.needle, link.direction) for link in parse_chain("1-0/1-2/2-3/2-1")]
    [(0, -1), (1, 1), (2, 1), (1, -1)]
    """
    if not isinstance(text, str):
        raise KnitError(key, f"{text!r} is not text", "write links a-b joined by '/', such as '1-0/1-2'")
    if not text.strip():
        raise KnitError(key, f"{text!r} has no link", "write at least one, such as '1-0/1-2'")
    links = []
    for number, word in enumerate(text.split("/"), start=1):
        word = word.strip()
        if not word:
            raise KnitError(key, f"{text!r} has no link at place {number}", "write links a-b joined by '/'")
        match = _LINK.fullmatch(word)
        if match is None:
            raise KnitError(key, f"{text!r} has {word!r} at place {number}", "write two whole numbers a-b")
        link = Link(int(match[1]), int(match[2]))
        if abs(link.end - link.start) > 1:
            raise KnitError(key, f"{text!r} has {word!r} at place {number}", "write numbers that differ by at most one")
        links.append(link)
    underlaps = [abs(after.start - link.end) for link, after in zip(links, links[1:] + links[:1], strict=True)]
    longest = max([1, *underlaps[:-1]])
    if underlaps[-1] > longest:
        raise KnitError(
            key,
            f"the laps of {text!r} do not return: the last underlap spans {underlaps[-1]} needles, the others at most {longest}",
            "write laps that end where they begin",
        )
    return tuple(links)


def single_steps(chains: Sequence[str]) -> list[str]:
    """Chains of all bars in steps of one needle; even numbers (0, 2, 4) are halved.

    In even numbers a lap spans two; in steps of one needle a lap has an odd number.

    >>> single_steps(["4-6/2-0", "2-0/2-4"])
    ['2-3/1-0', '1-0/1-2']
    """
    numbers = [int(number) for chain in chains for number in re.findall(r"\d+", chain)]
    laps = any(int(link[1]) != int(link[2]) for chain in chains for link in re.finditer(r"(\d+)-(\d+)", chain))
    if not laps or any(number % 2 for number in numbers):
        return list(chains)
    return [re.sub(r"\d+", lambda number: str(int(number[0]) // 2), chain) for chain in chains]


def parse_threading(text: object, key: str = "threading") -> tuple[bool, ...]:
    """Guides of a threading such as ``|.``: True where a guide carries a wire.

    >>> parse_threading("|.")
    (True, False)
    """
    if not isinstance(text, str) or not text or set(text) - {"|", "."}:
        raise KnitError(key, f"{text!r} is no threading", "write '|' for a wire and '.' for none, such as '|.'")
    if "|" not in text:
        raise KnitError(key, f"{text!r} has no wire", "write at least one '|'")
    return tuple(character == "|" for character in text)


def parse_shift(value: object, key: str = "shift") -> int:
    """Needles by which a guide bar starts to the right."""
    if isinstance(value, bool) or not isinstance(value, int):
        raise KnitError(key, f"{value!r} is not a whole number", "write a number of needles")
    return value


Kind = Literal["closed", "open", "inlay"]


@dataclass(frozen=True)
class Stitch:
    """One course of one thread."""

    thread: int
    course: int
    needle: int  # needle in the thread's own copy, may lie outside 0..wales - 1; for an inlay: the needle right of the gap
    bar: int
    kind: Kind
    direction: int  # of the overlap: +1 towards larger needle numbers, -1 towards smaller, 0 inlay
    layer: int  # 0 for the only loop on its needle and course, 0, 1, ... by bar where several share it


@dataclass(frozen=True)
class Lapping:
    """Stitches of one repeat, thread by thread, courses in order."""

    wales: int
    courses: int
    bars: int
    stitches: tuple[Stitch, ...]

    @property
    def threads(self) -> tuple[tuple[Stitch, ...], ...]:
        """Stitches of each thread, course by course."""
        count = len(self.stitches) // self.courses
        return tuple(self.stitches[t * self.courses : (t + 1) * self.courses] for t in range(count))

    @property
    def formed_together(self) -> tuple[int, ...]:
        """[stitch] number of the first loop on its needle in its course; an inlay has its own."""
        return tuple(n if s.kind == "inlay" else self._loop_at[self._place(s, layer=0)] for n, s in enumerate(self.stitches))

    @cached_property
    def heads_below(self) -> tuple[int, ...]:
        """Number of the loop [stitch] whose head it is drawn through: in its layer, or the last there; its own for an inlay."""
        return tuple(n if s.kind == "inlay" else self._head_below(s) for n, s in enumerate(self.stitches))

    def _head_below(self, stitch: Stitch) -> int:
        places = (self._place(stitch, layer, course=stitch.course - 1) for layer in range(stitch.layer, -1, -1))
        return next(self._loop_at[place] for place in places if place in self._loop_at)

    def _place(self, stitch: Stitch, layer: int, course: int | None = None) -> tuple[int, int, int]:
        """Needle in the repeat, course in the repeat, layer."""
        return stitch.needle % self.wales, (stitch.course if course is None else course) % self.courses, layer

    @cached_property
    def _loop_at(self) -> dict[tuple[int, int, int], int]:
        """Number of the loop of each place."""
        return {self._place(s, s.layer): n for n, s in enumerate(self.stitches) if s.kind != "inlay"}


def lap_kind(link: Link, after: Link) -> Kind:
    """Kind of the lap `link` that is followed by the lap `after`."""
    if link.direction == 0:
        return "inlay"
    back = (after.start > link.end) - (after.start < link.end) == -link.direction
    return "closed" if back else "open"


def lapping_table(bars: Sequence[Any], tiles: tuple[int, int] = (1, 1)) -> Lapping:
    """Lapping of one repeat of any number of guide bars.

    bars: objects with `chain` (str), `threading` (str), `shift` (int). The first bar lies nearest the technical face; the
    underlaps of later bars run behind those before. tiles: pattern repeats (along weft, along warp) taken as one repeat. Raises
    `KnitError` where a bar is malformed or a needle receives no loop in some course.
    """
    if not bars:
        raise KnitError("knit.bars", "a knit without bars", "write at least one guide bar")
    chains = [parse_chain(bar.chain, f"knit.bars[{i}].chain") for i, bar in enumerate(bars)]
    threadings = [parse_threading(bar.threading, f"knit.bars[{i}].threading") for i, bar in enumerate(bars)]
    shifts = [parse_shift(bar.shift, f"knit.bars[{i}].shift") for i, bar in enumerate(bars)]
    wales = lcm(*map(len, threadings)) * tiles[0]
    courses = lcm(*map(len, chains)) * tiles[1]

    loops = [[0] * courses for _ in range(wales)]
    stitches = []
    thread = 0
    for bar, (chain, threading, shift) in enumerate(zip(chains, threadings, shifts, strict=True)):
        bar_loops = []
        for guide in range(wales):
            if not threading[guide % len(threading)]:
                continue
            for course in range(courses):
                link, after = chain[course % len(chain)], chain[(course + 1) % len(chain)]
                needle = link.needle + shift + guide
                kind = lap_kind(link, after)
                layer = 0 if kind == "inlay" else loops[needle % wales][course]
                stitches.append(Stitch(thread, course, needle, bar, kind, link.direction, layer))
                if kind != "inlay":
                    bar_loops.append((needle % wales, course))
            thread += 1
        for needle, course in bar_loops:
            loops[needle][course] += 1

    for needle in range(wales):
        for course in range(courses):
            if loops[needle][course] == 0:
                given = " ".join(bar.threading for bar in bars)
                wrong = f"with {given!r} needle {needle} of {wales} has no loop in course {course}"
                raise KnitError("knit.bars.threading", wrong, "write bars that knit on every needle in every course")
    return Lapping(wales, courses, len(bars), tuple(stitches))
