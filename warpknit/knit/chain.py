"""Chain notation and threading, read and checked.

A chain such as ``1-0/1-2/2-3/2-1`` lists one link a course.  The numbers are the gaps between needles: gap g lies left
of needle g.  A link ``a-b`` carries the guide across needle min(a, b) in front of the hooks (the overlap); between
links the guide returns behind the needles (the underlap).  ``a-a`` is an inlay: the wire is laid in without a loop.  A
threading such as ``|.`` repeats along the guide bar: ``|`` is a guide with a wire, ``.`` an empty one.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from ..errors import BadValue

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
        """+1 when the overlap runs towards larger needle numbers, -1 towards smaller, 0 for an inlay."""
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
            raise KnitError(key, f"{text!r} has {word!r} at place {number}", "write an overlap of one needle")
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
    """Chains of all bars in steps of one needle, from chains that may be in even numbers (0, 2, 4).

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
