"""Shape and proportions of the loops.

Two shapes are known.  `circular-oval`: closed laps are circles whose top lies `closed_head` above the next course
line, open laps half ellipses leaning by `tilt`.  It is the mesh of Guglielmini, Marotta, Salvini 2022, section 2.5,
figure 5; the paper gives no sizes, and the proportions here are our own.  `general`: feet, legs and head of one
slim loop for every lap of any knit.  Within the ranges, one proportion changed at a time, wires of 15 um at
W = 1.7 mm, C = 1 mm stay at least a diameter apart.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import Any, Literal

from ..base.text import at_least, at_most
from .lapping import KnitError, Lapping

Shape = Literal["circular-oval", "general"]

SIZES: dict[str, tuple[str, ...]] = {  # the proportions that make a loop large, by shape
    "circular-oval": ("closed_radius", "closed_head", "open_head", "open_half_width"),
    "general": ("foot_half_width", "leg_half_width", "head_height"),
}


def _within(least: float, most: float, default: float) -> float:
    """A proportion with its range."""
    one: float = field(default=default, metadata={"range": (least, most)})
    return one


@dataclass(frozen=True)
class LoopProportions:
    """Proportions of the loops; every one has a range, which the scene checks."""

    closed_radius: float = _within(0.40, 0.78, 0.60)  # radius of a circular loop [C]
    closed_head: float = _within(0.30, 0.75, 0.55)  # top of a circular loop above the next course line [C]
    open_head: float = _within(0.35, 0.80, 0.50)  # top of an oval loop above the next course line [C]
    open_half_width: float = _within(0.22, 0.50, 0.26)  # half width of an oval loop [C]
    closed_foot: float = _within(0.03, 0.16, 0.10)  # half distance of the feet of a circular loop [C]
    open_foot: float = _within(0.05, 0.35, 0.19)  # half distance of the feet of an oval loop [C]
    foot_radius: float = _within(0.03, 0.20, 0.10)  # radius of the bend at an exit foot [C]
    tilt: float = _within(0.00, 0.16, 0.10)  # lean of an oval loop towards its overlap [-]
    lateral_shift: float = _within(0.00, 0.06, 0.02)  # shift of a circular loop towards its underlaps [W]
    foot_half_width: float = _within(0.06, 0.18, 0.12)  # general shape: half distance of the feet [W]
    leg_half_width: float = _within(0.16, 0.35, 0.24)  # general shape: half distance of the legs [W]
    head_height: float = _within(0.12, 0.45, 0.22)  # general shape: top above the next course line [C]
    shape: str = "auto"  # "auto" | "circular-oval" | "general"

    def __post_init__(self) -> None:
        if self.foot_half_width >= self.leg_half_width:
            wrong = f"{self.foot_half_width!r} is not below leg_half_width"
            raise KnitError("knit.loop.foot_half_width", wrong, f"write less than {self.leg_half_width:g}")

    def sized(self, size: float, shape: Shape, key: str) -> LoopProportions:
        """Proportions of large loops of this shape times `size`, the value of `key`."""
        if size == 1.0:
            return self
        names = SIZES[shape]
        least, most = (pick(RANGES[name][end] / getattr(self, name) for name in names) for end, pick in ((0, max), (1, min)))
        if not least <= size <= most:
            wrong = f"{size!r} takes proportions of knit.loop out of their ranges"
            raise KnitError(key, wrong, f"write {at_least(least, '')} to {at_most(most, '')}")
        return replace(self, **{name: size * getattr(self, name) for name in names})

    @classmethod
    def of(cls, loop: Any) -> LoopProportions:
        """Proportions from any object with these names."""
        return cls(**{one.name: getattr(loop, one.name) for one in fields(cls)})


RANGES: dict[str, tuple[float, float]] = {
    one.name: one.metadata["range"] for one in fields(LoopProportions) if "range" in one.metadata
}


def loop_shape(lapping: Lapping, proportions: LoopProportions) -> Shape:
    """Shape of the loops of a cloth.

    "auto" means circular-oval where exactly one loop is on each needle and course, there are no inlays, two bars lap
    in opposition (at every course their overlaps run against each other and are both closed or both open), and closed
    and open courses alternate; else general.
    """
    if proportions.shape != "auto":
        if proportions.shape == "circular-oval" and any(s.kind == "inlay" or s.layer for s in lapping.stitches):
            wrong = "'circular-oval' requires one loop on each needle and course"
            raise KnitError("knit.loop.shape", wrong, "write 'general'")
        return proportions.shape  # type: ignore[return-value]
    if lapping.bars != 2 or any(s.kind == "inlay" or s.layer for s in lapping.stitches):
        return "general"
    kinds = []
    for course in range(lapping.courses):
        row = [s for s in lapping.stitches if s.course == course]
        first, second = ({(s.direction, s.kind) for s in row if s.bar == bar} for bar in (0, 1))
        ((direction, kind),) = first
        if second != {(-direction, kind)}:
            return "general"
        kinds.append(kind)
    alternate = all(kind != before for kind, before in zip(kinds, kinds[-1:] + kinds[:-1], strict=True))
    return "circular-oval" if alternate else "general"
