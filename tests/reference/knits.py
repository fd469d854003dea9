"""Knits that the tests of this folder share."""

from dataclasses import dataclass, field
from functools import cache

from warpknit.knit.cloth import Cloth, knit_cloth
from warpknit.knit.loops import LoopProportions


@dataclass(frozen=True)
class Bar:
    chain: str
    threading: str = "|"
    shift: int = 0


@dataclass(frozen=True)
class Knit:
    bars: tuple[Bar, ...]
    wale_spacing: float = 1.7e-3
    course_spacing: float = 1.0e-3
    loop: LoopProportions = field(default_factory=LoopProportions)


PAPER = (Bar("1-0/1-2/2-3/2-1", "|.", 0), Bar("2-3/2-1/1-0/1-2", "|.", 1))
BARS = {
    "paper": PAPER,
    "pillar": (Bar("0-1/1-0"),),
    "closed pillar": (Bar("1-0"),),
    "closed tricot": (Bar("1-0/1-2"),),
    "open tricot": (Bar("0-1/2-1"),),
    "cord": (Bar("1-0/2-3"),),
    "atlas": (Bar("1-0/1-2/2-3/2-1"),),
    "full double atlas": (Bar("1-0/1-2/2-3/2-1"), Bar("2-3/2-1/1-0/1-2")),
    "reverse locknit": (Bar("1-0/1-2"), Bar("2-3/1-0")),
    "long double atlas": (Bar("1-0/1-2/2-3/3-4/3-2/2-1", "|."), Bar("3-4/3-2/2-1/1-0/1-2/2-3", "|.")),
    "inlaid pillar": (Bar("0-0/2-2"), Bar("0-1/1-0")),
}
FINE, COARSE = 15e-6, 30e-6


@cache
def cloth(name: str, diameter: float = FINE, merge_lenses: bool = True) -> Cloth:
    return knit_cloth(Knit(BARS[name]), diameter, merge_lenses)
