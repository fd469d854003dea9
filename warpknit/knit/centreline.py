"""Centre line of a thread: a smooth curve through its key points, sampled evenly.

Plan view: a periodic cubic spline on the centripetal parameter u, du = sqrt(chord), which neither overshoots nor cusps
at uneven spacing.  Height: a monotone (PCHIP) interpolant on the same parameter, so that a wire never bulges past its
key heights. Samples are evenly spaced in plan arc length.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline, PchipInterpolator

from ..base.text import short_repr
from .keypoints import LoopFrame, loop_keys
from .lapping import Stitch

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


def thread_line(first_stitch: int, stitches: tuple[Stitch, ...], courses: int, frame: LoopFrame) -> Thread:
    """Centre line of one thread.

    first_stitch: index of its first stitch among all stitches of the repeat; courses: height of the repeat.
    """
    height = courses * frame.course
    keys = _thread_keys(stitches, height, frame)
    plan_keys = np.concatenate([keys.plan, keys.plan[:1] + [0.0, height]])
    chord = np.diff(plan_keys, axis=0)
    knots = np.concatenate([[0.0], np.cumsum(np.sqrt(np.hypot(chord[:, 0], chord[:, 1])))])
    drift = height / knots[-1]
    plan_keys[:, 1] -= drift * knots
    plan_keys[-1] = plan_keys[0]
    plan = CubicSpline(knots, plan_keys, bc_type="periodic")
    wrap = 3
    z_knots = np.interp(keys.place, np.arange(len(knots)), knots)
    z_knots = np.concatenate([z_knots[-wrap:] - knots[-1], z_knots, z_knots[:wrap] + knots[-1]])
    rise = PchipInterpolator(z_knots, np.concatenate([keys.height[-wrap:], keys.height, keys.height[:wrap]]))

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
    belongs = keys.owner[np.searchsorted(knots, parameter, side="right") - 1]
    return Thread(points, float(arc[-1]), first_stitch + belongs, stitches[0].bar)


class _ThreadKeys(NamedTuple):
    plan: NDArray[np.float64]  # (k, 2) [m] key points of one period
    owner: NDArray[np.intp]  # (k,) stitch of the thread that the curve after each key point belongs to
    place: NDArray[np.float64]  # (m,) places of the heights, as indices into plan
    height: NDArray[np.float64]  # (m,) [m]


def _thread_keys(stitches: tuple[Stitch, ...], height: float, frame: LoopFrame) -> _ThreadKeys:
    """Key points of one period: the stitches with one point in the middle of each underlap."""
    feet = [_feet(stitch, frame) for stitch in stitches]
    loops = []
    for index, stitch in enumerate(stitches):
        onward = stitch.direction * (feet[(index + 1) % len(stitches)][0] - feet[index][1]) / frame.wale
        turn = int(onward > 1e-9) - int(onward < -1e-9)
        loops.append(loop_keys(stitch, turn, frame))
    plan: list[ArrayLike] = []
    owner: list[ArrayLike] = []
    place: list[ArrayLike] = []
    heights: list[ArrayLike] = []
    count = 0
    for index, (stitch, loop) in enumerate(zip(stitches, loops, strict=True)):
        after = (index + 1) % len(loops)
        start = loops[after].plan[0] + [0.0, height if after == 0 else 0.0]
        bridge, bridge_place = _underlap(loop.plan[-1], start, stitch, stitches[after], frame)
        level = frame.heights.underlap(stitch, frame.layers) * frame.diameter
        plan += [loop.plan, bridge]
        owner += [np.full(len(loop.plan) + len(bridge) // 2, index), np.full((len(bridge) + 1) // 2, after)]
        place += [count + loop.place, count + len(loop.plan) + bridge_place]
        heights += [loop.height, np.full(len(bridge_place), level)]
        count += len(loop.plan) + len(bridge)
    return _ThreadKeys(*map(np.concatenate, (plan, owner, place, heights)))


def _underlap(
    leave: NDArray[np.float64], enter: NDArray[np.float64], stitch: Stitch, after: Stitch, frame: LoopFrame
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Key points (k, 2) of an underlap between two feet and the places (m,) of its height, counted from the first.

    An underlap runs straight from foot to foot.  Where loops share needles it keeps to the wales of its loops first
    and last and changes over between, behind legs that are well in front: there is room for any number of bars.
    """
    if frame.layers == 1 or "inlay" in (stitch.kind, after.kind):
        return 0.5 * (leave + enter)[None], np.array([-0.6, 0.6])
    base, rise = stitch.course * frame.course, enter[1] - stitch.course * frame.course
    low, high = base + 0.3 * rise, base + 0.7 * rise
    return np.array([[leave[0], low], [enter[0], high]]), np.array([0.0, 1.0])


def _feet(stitch: Stitch, frame: LoopFrame) -> tuple[float, float]:
    """x of the entry and exit feet [m], to tell on which side of the loop its underlap leaves."""
    if stitch.kind == "inlay":
        return (stitch.needle - 0.5) * frame.wale, (stitch.needle - 0.5) * frame.wale
    half = stitch.direction * frame.proportions.foot_half_width
    return (stitch.needle - half) * frame.wale, (stitch.needle + half) * frame.wale
