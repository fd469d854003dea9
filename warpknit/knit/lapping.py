"""Chain notation and threading, and the lapping table: which wire wraps which needle in which course of one repeat.

The repeat is as wide as the least common multiple of the threadings [wales] and as high as the least common multiple of the
chains [courses]. A chain such as ``1-0/1-2/2-3/2-1`` lists one link a course; gap g lies left of needle g (docs/theory/knit.md).
A threading such as ``|.`` repeats along the guide bar: ``|`` is a guide with a wire, ``.`` an empty one.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import lcm
from typing import Any, Literal

import numpy as np

from ..base.errors import BadValue


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


def parse_chain(text: str, key: str = "chain") -> tuple[Link, ...]:
    """Links of a chain such as ``1-0/1-2/2-3/2-1``.

    Raises `KnitError` for an overlap of more than one needle, and laps that do not return: the underlap that closes the repeat
    may not be longer than the longest one within the chain (or one needle).

    >>> [(link.needle, link.direction) for link in parse_chain("1-0/1-2/2-3/2-1")]
    [(0, -1), (1, 1), (2, 1), (1, -1)]
    """
    links = [Link(*map(int, word.split("-"))) for word in text.split("/")]
    for number, link in enumerate(links, start=1):
        if abs(link.end - link.start) > 1:
            wrong = f"{text!r} has '{link.start}-{link.end}' at place {number}"
            raise KnitError(key, wrong, "write numbers that differ by at most one")
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

    @cached_property
    def _loops(self) -> dict[tuple[int, int], list[int]]:
        """Numbers of the loops on each needle in each course, by layer."""
        found: dict[tuple[int, int], list[int]] = defaultdict(list)
        for number, stitch in enumerate(self.stitches):
            if stitch.kind != "inlay":
                found[stitch.needle % self.wales, stitch.course].append(number)
        return found

    @property
    def formed_together(self) -> tuple[int, ...]:
        """[stitch] number of the first loop on its needle in its course; an inlay has its own."""
        loops = self._loops
        return tuple(n if s.kind == "inlay" else loops[s.needle % self.wales, s.course][0] for n, s in enumerate(self.stitches))

    @cached_property
    def heads_below(self) -> tuple[int, ...]:
        """Number of the loop [stitch] whose head it is drawn through: in its layer, or the last there; its own for an inlay."""
        found = []
        for number, stitch in enumerate(self.stitches):
            below = self._loops.get((stitch.needle % self.wales, (stitch.course - 1) % self.courses), [])
            found.append(number if stitch.kind == "inlay" else below[min(stitch.layer, len(below) - 1)])
        return tuple(found)


def lapping_table(bars: Sequence[Any], tiles: tuple[int, int] = (1, 1)) -> Lapping:
    """Lapping of one repeat of any number of guide bars.

    bars: objects with `chain` (str), `threading` (str), `shift` (int). The first bar lies nearest the technical face; the
    underlaps of later bars run behind those before. tiles: pattern repeats (along weft, along warp) taken as one repeat. Raises
    `KnitError` where a chain does not return or a needle receives no loop in some course.
    """
    chains = [parse_chain(bar.chain, f"knit.bars[{i}].chain") for i, bar in enumerate(bars)]
    wales = lcm(*(len(bar.threading) for bar in bars)) * tiles[0]
    courses = lcm(*map(len, chains)) * tiles[1]

    loops = np.zeros((wales, courses), dtype=int)
    stitches = []
    thread = 0
    for number, (bar, chain) in enumerate(zip(bars, chains, strict=True)):
        before = loops.copy()
        for guide in range(wales):
            if bar.threading[guide % len(bar.threading)] != "|":
                continue
            for course in range(courses):
                link, after = chain[course % len(chain)], chain[(course + 1) % len(chain)]
                needle = link.needle + bar.shift + guide
                underlap, layer = (after.start > link.end) - (after.start < link.end), 0
                kind: Kind = "inlay" if link.direction == 0 else "closed" if underlap == -link.direction else "open"
                if kind != "inlay":
                    layer = int(before[needle % wales, course])
                    loops[needle % wales, course] += 1
                stitches.append(Stitch(thread, course, needle, number, kind, link.direction, layer))
            thread += 1
    for needle, course in np.argwhere(loops == 0)[:1]:
        given = " ".join(bar.threading for bar in bars)
        wrong = f"with {given!r} needle {needle} of {wales} has no loop in course {course}"
        raise KnitError("knit.bars.threading", wrong, "write bars that knit on every needle in every course")
    return Lapping(wales, courses, len(bars), tuple(stitches))
