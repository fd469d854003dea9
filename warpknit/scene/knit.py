"""The tables [knit] with bars and loops, and [hook], as frozen objects in SI."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated

from pydantic import AfterValidator, Field

from ..knit.lapping import single_steps
from ..knit.loops import RANGES, LoopProportions
from . import values
from .keys import Table, key
from .values import Choice, Integer, Pair, Quantity


@dataclass(frozen=True, kw_only=True)
class Hook(Table):
    """[hook], in place of [knit]: two arcs of wire that hook each other."""

    radius: values.LoopLength = key("Radius of both arcs; at least four diameters of the wire.", 1e-3)
    length: values.LoopLength = key(
        "Arc length of each wire.", None, left_out="a third of a circle", allowed="half a radius to half a circle"
    )
    overlap: values.LoopLength = key(
        "Overlap of the two arcs at rest: the width of the lens between them.",
        None,
        left_out="a fifth of the radius",
        allowed="1.5 diameters of the wire to the rise of the arc",
    )
    crossing_distance: values.Length | None = key(
        "Spatial model: distance of the centre lines at their crossings at rest; from the thickness of the wire to `overlap`. Not"
        " used in the planar model.",
        None,
        left_out="1.3 thicknesses of the wire",
    )

    @property
    def height(self) -> float:
        """[m] of the upper ends above the lower ones, at rest."""
        return 2.0 * self.radius * math.sin(0.5 * self.length / self.radius)


MEAN = LoopProportions()  # what the loops are where a scene does not say


@dataclass(frozen=True, kw_only=True)
class Bar(Table):
    """One guide bar of [knit] bars: its chain of links a-b, its threading of '|' and '.', its shift in needles."""

    chain: values.Chain = key(
        "Links a-b of a guide bar, course by course: the overlap runs from gap a to gap b. a = b is an inlay without a loop."
        " `//` may end the chain. Where all numbers of all bars are even (0, 2, 4), they count half needles."
    )
    threading: values.Threading = key("Threaded (`|`) and empty (`.`) guides along the bar, repeated.", "|")
    shift: Annotated[int, Integer(-1000, 1000)] = key("Offset of the bar to the right, in needles.", 0)
    loop_scale: Annotated[float, Quantity("number", least=0.2, most=5.0)] = key(
        "Factor on the size of the loops of this bar (proportions of `[knit.loop]`), for bars of different run-in.",
        1.0,
    )


def _in_needles(bars: tuple[Bar, ...]) -> tuple[Bar, ...]:
    """The bars with their chains in steps of one needle."""
    return tuple(replace(bar, chain=chain) for bar, chain in zip(bars, single_steps([bar.chain for bar in bars]), strict=True))


def _proportion(name: str) -> Quantity:
    least, most = RANGES[name]
    return Quantity("number", least=least, most=most)


@dataclass(frozen=True, kw_only=True)
class Loop(Table):
    """[knit.loop]: proportions in units of the course spacing; `warpknit.knit.loops` says what they measure and their ranges."""

    shape: Annotated[str, Choice(("auto", "circular-oval", "general"))] = key(
        "`auto`: `circular-oval` for two bars in opposition, if each needle and course has one loop and closed and open courses"
        " alternate. Otherwise `general`.",
        MEAN.shape,
    )
    closed_radius: Annotated[float, _proportion("closed_radius")] = key(
        "Circular-oval: radius of a closed (circular) loop [C].", MEAN.closed_radius
    )
    closed_head: Annotated[float, _proportion("closed_head")] = key(
        "Circular-oval: top of a closed loop above the next course line [C].", MEAN.closed_head
    )
    open_head: Annotated[float, _proportion("open_head")] = key(
        "Circular-oval: top of an open (oval) loop above the next course line [C].", MEAN.open_head
    )
    open_half_width: Annotated[float, _proportion("open_half_width")] = key(
        "Circular-oval: half width of an open loop [C].", MEAN.open_half_width
    )
    closed_foot: Annotated[float, _proportion("closed_foot")] = key(
        "Circular-oval: half distance of the feet of a closed loop [C].", MEAN.closed_foot
    )
    open_foot: Annotated[float, _proportion("open_foot")] = key(
        "Circular-oval: half distance of the feet of an open loop [C].", MEAN.open_foot
    )
    foot_radius: Annotated[float, _proportion("foot_radius")] = key(
        "Circular-oval: radius of the bend at the exit foot [C].", MEAN.foot_radius
    )
    tilt: Annotated[float, _proportion("tilt")] = key("Circular-oval: lean of an open loop towards its overlap.", MEAN.tilt)
    lateral_shift: Annotated[float, _proportion("lateral_shift")] = key(
        "Circular-oval: shift of a closed loop towards its underlaps [W].", MEAN.lateral_shift
    )
    foot_half_width: Annotated[float, _proportion("foot_half_width")] = key(
        "General: half distance of the feet [W].", MEAN.foot_half_width
    )
    leg_half_width: Annotated[float, _proportion("leg_half_width")] = key(
        "General: half distance of the legs [W].", MEAN.leg_half_width
    )
    head_height: Annotated[float, _proportion("head_height")] = key(
        "General: top of the head above the next course line [C].", MEAN.head_height
    )


@dataclass(frozen=True, kw_only=True)
class Knit(Table):
    """[knit]: the pattern, its spacings, and how often it repeats; the double atlas net of the paper where a key is left out."""

    bars: Annotated[tuple[Bar, ...], Field(min_length=1), AfterValidator(_in_needles)] = key(
        "The guide bars. Default: the two of the double atlas.",
        (Bar(chain="1-0/1-2/2-3/2-1", threading="|.", shift=0), Bar(chain="2-3/2-1/1-0/1-2", threading="|.", shift=1)),
    )
    wale_spacing: values.LoopLength = key("Distance between wales (along weft, x).", 1.7e-3)
    course_spacing: values.LoopLength = key("Distance between courses (along warp, y).", 1.0e-3)
    repeats: Annotated[tuple[int, int], Pair(Integer(1, 10**9))] = key("Pattern repeats along weft and warp.", (1, 1))
    scatter: values.Scatter = key(
        "Relative standard deviation of the proportions in `[knit.loop]`, drawn for each needle and course of the mesh."
        " Deviations are limited to 2.5 times this value, and where wires would overlap. So the actual scatter is 5 % below"
        " this value, and in tight knits with a scatter of 0.1 up to 25 % below.",
        0.0,
    )
    seed: values.Seed = key("Random seed of the scatter.", 0)
    loop: Loop = key("The shape of the loops.", Loop())

    @property
    def repeat(self) -> tuple[float, float]:
        """Width and height of one repeat [m]: it spans the common period of the threadings and of the chains."""
        wales = math.lcm(*(len(bar.threading) for bar in self.bars))
        courses = math.lcm(*(bar.chain.count("/") + 1 for bar in self.bars))
        return (wales * self.wale_spacing, courses * self.course_spacing)

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of all repeats [m]."""
        return (self.repeats[0] * self.repeat[0], self.repeats[1] * self.repeat[1])

    @property
    def even(self) -> Knit:
        """One repeat of the knit, without scatter."""
        return replace(self, scatter=0.0, seed=0, repeats=(1, 1))


@dataclass(frozen=True, kw_only=True)
class KnitTable(Knit, one_of=(("wale_spacing", "wales"), ("course_spacing", "courses"))):
    """[knit] as written in a file, with its alternative keys."""

    wales: values.PerLength | None = key("Instead of `wale_spacing`: wales per length.", None)
    courses: values.PerLength | None = key("Instead of `course_spacing`: courses per length.", None)
