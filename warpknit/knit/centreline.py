"""Centre line of a thread: a smooth curve through its key points, sampled evenly.

Plan view: a periodic cubic spline on the centripetal parameter u, du = sqrt(chord), which neither overshoots nor cusps
at uneven spacing.  Height: a monotone (PCHIP) interpolant on the same parameter, so that a wire never bulges past its
key heights. Samples are evenly spaced in plan arc length.

Key points are in the frame of a loop: xi = s (x - x_needle) along its overlap (direction s), eta = y - n C upwards from the
foot line of course n, z towards the technical face.  The wire enters at -xi, runs up, over the head and down at +xi; its head
lies in course n + 1, where the next loop on the needle comes through it from behind: its feet pass behind the head, its waist
in front. Lengths along the cloth scale with the wale spacing W or the course spacing C, heights z with the wire diameter d.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, PchipInterpolator

from ..base.text import at_most, engineering, short_repr
from .lapping import KnitError, Lapping, Stitch
from .loops import RANGES, LoopProportions, Shape

EXIT_ARC = np.radians([200.0, 245.0, 290.0, 325.0])  # angles of the points that round an exit foot
UPRIGHT_EXIT_ARC = np.radians([195.0, 245.0, 295.0, 345.0])  # where the underlap then leaves straight up
SAME = 1e-9  # of a thickness: round-off
NEST_STEP = 1.5  # growth of a loop from layer to layer where several share a needle [d]


@dataclass(frozen=True)
class Heights:
    """Height z of the parts of a loop, in wire diameters.

    With one loop on each needle the feet of all bars lie level and the underlaps of bar 0, 1, ... lie 1, 2, ... steps
    behind them.  Where loops share needles, every layer lies wholly in front of the next: legs and heads one step
    apart, feet with their underlaps two.
    """

    foot: float
    waist: float
    leg: float
    shoulder: float
    head: float
    step: float

    def front(self, height: float, stitch: Stitch, layers: int) -> float:
        """Height of a waist or leg: above the heads of all layers below it."""
        return height + self.step * (layers - 1 - stitch.layer)

    def back(self, height: float, stitch: Stitch) -> float:
        """Height of a shoulder or head."""
        return height - self.step * stitch.layer

    def entry_foot(self, stitch: Stitch, layers: int) -> float:
        """Height of the feet of an onward lap: behind all heads."""
        return self.foot - self.step * (layers - 1) - 2.0 * self.step * stitch.layer

    def underlap(self, stitch: Stitch, layers: int) -> float:
        """Height of the underlap that follows a stitch."""
        if layers == 1:
            return self.foot - self.step * (stitch.bar + 1)
        return self.foot - self.step * (layers + 2 * stitch.bar)

    def exit_foot(self, stitch: Stitch, layers: int, turn: int) -> float:
        """Height of the exit foot; a returning lap crosses its own entry foot one step behind."""
        return self.entry_foot(stitch, layers) - (self.step if turn < 0 else 0.0)


HEIGHTS: dict[str, Heights] = {
    "circular-oval": Heights(foot=-2.3, waist=1.0, leg=0.8, shoulder=-0.15, head=-1.0, step=1.4),
    "general": Heights(foot=-1.95, waist=0.65, leg=0.52, shoulder=-0.15, head=-0.65, step=1.3),
}


@dataclass(frozen=True)
class LoopFrame:
    """The loops of one cloth, and all that they have in common."""

    shape: Shape
    proportions: LoopProportions  # that decide on which side of its loop an underlap leaves
    wale: float  # wale spacing [m]
    course: float  # course spacing [m]
    diameter: float  # wire diameter [m]
    lapping: Lapping
    loops: tuple[LoopProportions, ...]  # of each stitch

    @property
    def size(self) -> NDArray[np.float64]:
        """(2,) [m] width and height of the repeat."""
        return np.array([self.lapping.wales * self.wale, self.lapping.courses * self.course])

    @cached_property
    def layers(self) -> int:
        """Largest number of loops on one needle and course."""
        return 1 + max(stitch.layer for stitch in self.lapping.stitches)

    def proportions_of(self, stitch: Stitch, *, below: bool = False) -> LoopProportions:
        """Proportions of a loop; below: of the loop whose head it is drawn through."""
        number = stitch.thread * self.lapping.courses + stitch.course
        return self.loops[self.lapping.heads_below[number] if below else number]

    @property
    def heights(self) -> Heights:
        """Heights of the parts of a loop [d]."""
        return HEIGHTS[self.shape]

    def check(self) -> None:
        """Raise `KnitError` if loops of neighbouring wales, or feet of a loop, would overlap."""
        name, spacing, half, share = self._room(self.loops)
        given, least = max(getattr(loop, name) for loop in self.loops), RANGES[name][0]
        is_general = self.shape == "general"
        feet = 2.0 * min(loop.foot_half_width for loop in self.loops) * self.wale if is_general else np.inf
        meet = "loops of neighbouring wales run into each other"

        def thickest(proportion: float) -> float:
            """Thickness of wire [m] for which loops of a proportion have room; not above 0: none."""
            return (half - proportion * spacing) / share

        if 0.0 < (1.0 + SAME) * min(feet, thickest(least)) < self.diameter:  # too thick for loops of any proportion
            works = thickest(given) if thickest(given) > 0.0 else thickest(least)
            wrong = f"with a wire {engineering(self.diameter, 'm')} thick "
            wrong += "the feet of a loop run into each other" if self.diameter > feet else meet
            instead = f"use a thickness of at most {at_most(min(feet, works), 'm')} with these wales, courses and loops"
            raise KnitError("wire.diameter", wrong, instead)
        if self.diameter > (1.0 + SAME) * thickest(given):
            unit, largest = "wale spacings" if is_general else "course spacings", (half - share * self.diameter) / spacing
            raise KnitError(f"knit.loop.{name}", f"at {given!r}, {meet}", f"write at most {at_most(largest, unit)}")

    def with_room(self, loops: Sequence[LoopProportions]) -> LoopFrame:
        """The frame with other loops, no wider than neighbouring wales allow."""
        name, spacing, half, share = self._room(loops)
        largest = (half - share * self.diameter) / spacing
        return replace(self, loops=tuple(replace(loop, **{name: min(getattr(loop, name), largest)}) for loop in loops))

    def _room(self, loops: Sequence[LoopProportions]) -> tuple[str, float, float, float]:
        """Proportion that makes a loop wide: name, unit [m], half the room of a loop [m], wires in it."""
        if self.shape == "circular-oval":
            shift = max(abs(loop.lateral_shift) for loop in loops)
            return "closed_radius", self.course, (0.5 - shift) * self.wale, 0.5
        return "leg_half_width", self.wale, 0.5 * self.wale, 0.5 + NEST_STEP * (self.layers - 1)


class LoopKeys(NamedTuple):
    """Key points of the wire of one stitch, with heights. From entry foot to exit foot."""

    plan: NDArray[np.float64]  # (k, 2) [m] key points of the plan curve
    place: NDArray[np.float64]  # (m,) places of the heights, as (fractional) indices into plan
    height: NDArray[np.float64]  # (m,) [m]


def loop_keys(stitch: Stitch, turn: int, frame: LoopFrame) -> LoopKeys:
    """Key points of one stitch.

    turn: side on which the underlap leaves, in the loop's frame: +1 onwards along the overlap, -1 back, 0 straight up.
    """
    if stitch.kind == "inlay":  # no lap: the wire passes the gap left of the needle, behind the feet
        height = frame.heights.underlap(stitch, frame.layers)
        keys = LoopKeys(np.array([[-0.5 * frame.wale, 0.0]]), np.zeros(1), np.array([height]))
    elif frame.shape == "general":
        keys = _general_loop(stitch, turn, frame)
    elif stitch.kind == "closed":
        keys = _circular_loop(stitch, frame)
    else:
        keys = _oval_loop(stitch, frame)
    plan = keys.plan * [stitch.direction or 1, 1.0] + [stitch.needle * frame.wale, stitch.course * frame.course]
    return LoopKeys(plan, keys.place, keys.height * frame.diameter)


def _circular_loop(stitch: Stitch, frame: LoopFrame) -> LoopKeys:
    """Closed lap: foot, 13 points of a circle, foot.  The exit leg stays in front until it is inside the head below."""
    proportions, heights = frame.proportions_of(stitch), frame.heights
    radius, foot = proportions.closed_radius, proportions.closed_foot
    angle = np.radians(np.linspace(245.0, -65.0, 13))
    xi = np.concatenate([[-foot], radius * np.cos(angle), [foot]]) * frame.course
    eta = np.concatenate([[0.0], 1.0 + proportions.closed_head - radius + radius * np.sin(angle), [0.0]])
    entry, leave = heights.entry_foot(stitch, 1), heights.exit_foot(stitch, 1, turn=-1)
    z = np.concatenate([[entry], _round_loop_height(eta[1:-1], heights), [heights.waist, leave]])
    place = np.concatenate([np.arange(14.0), [13.62, 14.0]])
    plan = np.stack([xi - proportions.lateral_shift * frame.wale, eta * frame.course], axis=1)
    return LoopKeys(plan, place, z)


def _oval_loop(stitch: Stitch, frame: LoopFrame) -> LoopKeys:
    """Open lap: foot, 9 points of an ellipse, exit foot rounded by an arc of 4 points."""
    proportions, heights = frame.proportions_of(stitch), frame.heights
    foot, bend = proportions.open_foot, proportions.foot_radius
    angle = np.radians(np.linspace(230.0, -50.0, 9))
    eta_oval = 0.5 * (1.0 + proportions.open_head) * (1.0 + np.sin(angle))
    xi_oval = proportions.open_half_width * np.cos(angle) + proportions.tilt * (eta_oval - 0.5)
    xi = np.concatenate([[-foot], xi_oval, foot + bend * (1.0 + np.cos(EXIT_ARC))])
    eta = np.concatenate([[0.0], eta_oval, bend * (1.0 + np.sin(EXIT_ARC))])
    entry = heights.entry_foot(stitch, 1)
    z = np.concatenate([[entry], _round_loop_height(eta_oval, heights), np.full(4, entry)])
    return LoopKeys(np.stack([xi, eta], axis=1) * frame.course, np.arange(14.0), z)


def _round_loop_height(eta: NDArray[np.float64], heights: Heights) -> NDArray[np.float64]:
    """Height z [d] over eta [C], feet excepted: in front of the head below, behind the legs above."""
    return np.interp(eta, [0.60, 0.80, 1.10], [heights.waist, heights.leg, heights.head])


def _general_loop(stitch: Stitch, turn: int, frame: LoopFrame) -> LoopKeys:
    """Any lap: feet, waist, legs, shoulders, head, and an exit foot rounded by an arc of 4 points."""
    proportions, heights, course = frame.proportions_of(stitch), frame.heights, frame.course
    grow = NEST_STEP * frame.diameter * stitch.layer
    a = proportions.foot_half_width * frame.wale + grow
    b = proportions.leg_half_width * frame.wale + grow
    h = proportions.head_height * course + grow
    waist = frame.proportions_of(stitch, below=True).head_height * course + grow  # in front of that head
    half = np.array(
        [
            [a, 0.0, heights.entry_foot(stitch, frame.layers)],
            [a, waist, heights.front(heights.waist, stitch, frame.layers)],
            [b, 0.55 * course + 0.45 * waist, heights.front(heights.leg, stitch, frame.layers)],
            [b, course, heights.back(heights.shoulder, stitch)],
            [b, course + 0.55 * h, heights.back(heights.head, stitch)],
            [a, course + h, heights.back(heights.head, stitch)],
        ]
    )
    top = np.array([[0.0, course + h + 0.1 * frame.diameter, heights.back(heights.head, stitch)]])
    bend = proportions.foot_radius * course
    arc = UPRIGHT_EXIT_ARC if turn == 0 or frame.layers > 1 else EXIT_ARC
    exit_foot = np.stack(
        [
            a + (-1 if turn < 0 else 1) * bend * (1.0 + np.cos(arc)),
            bend * (1.0 + np.sin(arc)),
            np.full(4, heights.exit_foot(stitch, frame.layers, turn)),
        ],
        axis=1,
    )
    points = np.concatenate([half * [-1.0, 1.0, 1.0], top, half[:0:-1], exit_foot])
    place, height = np.arange(float(len(points))), points[:, 2]
    if frame.layers > 1:
        exit_waist = 2 * len(half) - 1
        place = np.insert(place, [1, 1, exit_waist + 1], [0.2, 0.5, exit_waist + 0.6])
        height = np.insert(height, [1, 1, exit_waist + 1], height[[0, 1, exit_waist]])
    return LoopKeys(points[:, :2], place, height)


SAMPLES_PER_STITCH = 480


@dataclass(frozen=True)
class Thread:
    """One wire of the repeat; it goes on periodically with (0, height of the repeat)."""

    __repr__ = short_repr

    points: NDArray[np.float64]  # (n, 3) [m] centre line; point n would be points[0] + (0, size[1], 0)
    length: float  # plan arc length of one period [m]
    stitch: NDArray[np.intp]  # (n,) stitch (index into the cloth's stitches) that each sample belongs to
    bar: int

    @property
    def spacing(self) -> float:
        """Plan arc length between samples [m]."""
        return self.length / len(self.points)

    def at(self, arc: NDArray[np.float64] | float, height: float) -> NDArray[np.float64]:
        """Points (..., 3) [m] at unwrapped plan arc lengths; height: of the repeat [m]."""
        position = np.asarray(arc) / self.spacing
        lower = np.floor(position).astype(int)
        fraction = (position - lower)[..., None]
        return (1.0 - fraction) * self._sample(lower, height) + fraction * self._sample(lower + 1, height)

    def stretch(self, arc_low: float, arc_high: float, height: float) -> NDArray[np.float64]:
        """Points (k, 3) [m] from arc_low to arc_high: both ends and every sample between."""
        first, last = int(np.floor(arc_low / self.spacing)) + 1, int(np.ceil(arc_high / self.spacing)) - 1
        inner = self._sample(np.arange(first, last + 1), height)
        return np.concatenate([self.at(np.array([arc_low]), height), inner, self.at(np.array([arc_high]), height)])

    def stitch_at(self, arc: float) -> int:
        """Index of the stitch at an unwrapped plan arc length."""
        return int(self.stitch[int(np.floor(arc / self.spacing)) % len(self.stitch)])

    def _sample(self, index: NDArray[np.intp], height: float) -> NDArray[np.float64]:
        period, within = np.divmod(index, len(self.points))
        points = self.points[within].copy()
        points[..., 1] += period * height
        return points


def thread_line(number: int, frame: LoopFrame) -> Thread:
    """Centre line of one thread."""
    stitches, courses = frame.lapping.threads[number], frame.lapping.courses
    height = courses * frame.course
    plan_keys, owner, place, heights = _thread_keys(stitches, height, frame)
    plan_keys = np.concatenate([plan_keys, plan_keys[:1] + [0.0, height]])
    chord = np.diff(plan_keys, axis=0)
    knots = np.concatenate([[0.0], np.cumsum(np.sqrt(np.hypot(chord[:, 0], chord[:, 1])))])
    drift = height / knots[-1]
    plan_keys[:, 1] -= drift * knots
    plan_keys[-1] = plan_keys[0]
    plan = CubicSpline(knots, plan_keys, bc_type="periodic")
    wrap = 3
    z_knots = np.interp(place, np.arange(len(knots)), knots)
    z_knots = np.concatenate([z_knots[-wrap:] - knots[-1], z_knots, z_knots[:wrap] + knots[-1]])
    rise = PchipInterpolator(z_knots, np.concatenate([heights[-wrap:], heights, heights[:wrap]]))

    count = SAMPLES_PER_STITCH * len(stitches)
    fine = np.linspace(0.0, knots[-1], 16 * count + 1)
    slope = plan(fine, 1) + [0.0, drift]
    speed = np.hypot(slope[:, 0], slope[:, 1])
    arc = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(fine))])
    parameter = np.interp(np.arange(count) * (arc[-1] / count), arc, fine)
    points = np.empty((count, 3))
    points[:, :2] = plan(parameter)
    points[:, 1] += drift * parameter
    points[:, 2] = rise(parameter)
    belongs = owner[np.searchsorted(knots, parameter, side="right") - 1]
    return Thread(points, float(arc[-1]), number * courses + belongs, stitches[0].bar)


def _thread_keys(stitches: tuple[Stitch, ...], height: float, frame: LoopFrame) -> tuple[NDArray[Any], ...]:
    """Key points of one period: the stitches with one point in the middle of each underlap.

    plan (k, 2) [m]; owner (k,), stitch of the thread that the curve after each key point belongs to; places (m,) of the heights,
    as indices into plan; heights (m,) [m].
    """
    feet = [_feet(stitch, frame) for stitch in stitches]
    loops = []
    for index, stitch in enumerate(stitches):
        onward = stitch.direction * (feet[(index + 1) % len(stitches)][0] - feet[index][1]) / frame.wale
        turn = int(onward > 1e-9) - int(onward < -1e-9)
        loops.append(loop_keys(stitch, turn, frame))
    parts: list[tuple[NDArray[Any], ...]] = []
    count = 0
    for index, (stitch, loop) in enumerate(zip(stitches, loops, strict=True)):
        after = (index + 1) % len(loops)
        start = loops[after].plan[0] + [0.0, height if after == 0 else 0.0]
        bridge, bridge_place = _underlap(loop.plan[-1], start, stitch, stitches[after], frame)
        level = np.full(len(bridge_place), frame.heights.underlap(stitch, frame.layers) * frame.diameter)
        owner = np.repeat([index, after], [len(loop.plan) + len(bridge) // 2, (len(bridge) + 1) // 2])
        parts += [(loop.plan, owner, count + loop.place, loop.height)]
        count += len(loop.plan)
        parts += [(bridge, owner[:0], count + bridge_place, level)]
        count += len(bridge)
    return tuple(np.concatenate(part) for part in zip(*parts, strict=True))


def _underlap(
    leave: NDArray[np.float64], enter: NDArray[np.float64], stitch: Stitch, after: Stitch, frame: LoopFrame
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Key points (k, 2) of an underlap between two feet; places (m,) of its height, counted from the first.

    An underlap runs straight from foot to foot.  Where loops share needles it keeps to the wales of its loops first
    and last and changes over between, behind legs that are well in front: there is room for any number of bars.
    """
    if frame.layers == 1 or "inlay" in (stitch.kind, after.kind):
        return 0.5 * (leave + enter)[None], np.array([-0.6, 0.6])
    base, rise = stitch.course * frame.course, enter[1] - stitch.course * frame.course
    low, high = base + 0.3 * rise, base + 0.7 * rise
    return np.array([[leave[0], low], [enter[0], high]]), np.array([0.0, 1.0])


def _feet(stitch: Stitch, frame: LoopFrame) -> tuple[float, float]:
    """x of the entry and exit feet [m], for the side of the underlap."""
    if stitch.kind == "inlay":
        return (stitch.needle - 0.5) * frame.wale, (stitch.needle - 0.5) * frame.wale
    half = stitch.direction * frame.proportions.foot_half_width
    return (stitch.needle - half) * frame.wale, (stitch.needle + half) * frame.wale
