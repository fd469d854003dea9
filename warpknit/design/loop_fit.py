"""Loops of a given length of wire: one factor on the proportions that make them large (SIZES), for all loops or for each bar.

Lengths are those of the wire in space, as they are measured, in both models.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq

from ..base.text import at_least, at_most, exact
from ..errors import InputError
from ..knit.chain import KnitError
from ..knit.lapping import lapping_table
from ..knit.loops import RANGES, SIZES, LoopProportions, loop_shape
from ..mesh.layout import knit_scene
from ..scene import Scene
from ..scene.knit import Bar

FIT_TOLERANCE = 2e-3  # of the factor
EDGE, SHORTER = 1e-9, 0.8  # distance of a factor from the end of its range; reduction of one that cannot be knitted


@dataclass(frozen=True)
class LoopFit:
    """A fit of the loops by factors on their proportions."""

    to: str  # "loop length", "run-in", or the name of the file of a biaxial test
    factor: float | None  # of all loops
    proportions: dict[str, float]  # of knit.loop, that were fitted
    rms_error: float | None = None  # over the tensions of the test
    bar_factors: tuple[float, ...] | None = None  # of the loops of each bar, where these were fitted


@dataclass(frozen=True)
class Fitted:
    """A fitted scene, sentences on how it was fitted, and the fit of its loops if there was one."""

    scene: Scene
    notes: tuple[str, ...] = ()
    loops: LoopFit | None = None

    def then(self, other: Fitted) -> Fitted:
        """`other`, which was fitted from this scene, with the notes and the fit of both."""
        return Fitted(other.scene, self.notes + other.notes, other.loops or self.loops)


def fit_loop_length(scene: Scene, wanted: float) -> Fitted:
    """Loops with a wire length of `wanted` [m] each. Raises `InputError` if it cannot be reached."""
    low, high = factors(scene)

    def missing(factor: float) -> float:
        return knit_scene(scaled(scene, factor)).wire_length - wanted

    factor = _factor(scene, missing, low, high, wanted)
    return fitted_by(scene, factor, "the wire length per loop", "loop length")


def fit_run_in(scene: Scene, wanted: tuple[float, ...]) -> Fitted:
    """Loops of each bar with the wire length [m] that it takes a course: `wanted`, in the order of `knit.bars`.

    Raises `InputError` if a length cannot be reached.
    """
    bars = scene.knit.bars
    if len(wanted) != len(bars):
        given = ", ".join(exact(length, "m") for length in wanted)
        wrong = f"{given} are {len(wanted)} lengths for {len(bars)} bars"
        raise InputError(f"{scene.path}: --fit-loop-length: {wrong}; give one length, or one for each bar")
    fit, found = scene, []
    for bar, length in enumerate(wanted):
        factor = _bar_factor(fit, bar, length)
        fit = _with_bar(fit, bar, factor)
        found.append(factor)
    text = ", ".join(f"bar {bar + 1}: {factor:.3f}" for bar, factor in enumerate(found))
    note = f"loop proportions of each bar times a factor fitted to its run-in ({text})"
    meant, hooks = len(knit_scene(scene).clasps), len(knit_scene(fit).clasps)
    if hooks != meant:
        note += f"; wires then hook {hooks} times per repeat in plan view, with loops of one size {meant} times"
    return Fitted(fit, (note,), LoopFit("run-in", None, {}, bar_factors=tuple(found)))


def _bar_factor(scene: Scene, bar: int, wanted: float) -> float:
    """Factor on the loops of a bar at which it takes `wanted` [m] a course."""

    def missing(factor: float) -> float:
        return knit_scene(_with_bar(scene, bar, factor)).run_in(bar) - wanted

    low, high = _bounded(scene, scene.knit.bars[bar : bar + 1], lambda factor: _with_bar(scene, bar, factor))
    return _factor(scene, missing, low, high, wanted, of=f" for bar {bar + 1}")


def _factor(scene: Scene, missing: Callable[[float], float], low: float, high: float, wanted: float, of: str = "") -> float:
    """The factor between `low` and `high` at which no length [m] is `missing` from the wanted one. Raises `InputError`."""
    ends = missing(low), missing(high)
    if not min(ends) <= 0.0 <= max(ends):
        raise InputError(
            f"{scene.path}: --fit-loop-length: {exact(wanted, 'm')}{of} takes proportions of knit.loop out of their ranges;"
            f" give {at_least(wanted + min(ends), 'm')} to {at_most(wanted + max(ends), 'm')} with these spacings"
        )
    return float(brentq(missing, low, high, xtol=FIT_TOLERANCE / 10))


def _with_bar(scene: Scene, bar: int, factor: float) -> Scene:
    """The scene with the loops of one bar larger by a factor."""
    bars = list(scene.knit.bars)
    bars[bar] = replace(bars[bar], loop_scale=factor * bars[bar].loop_scale)
    return replace(scene, knit=replace(scene.knit, bars=tuple(bars)))


def scaled(scene: Scene, factor: float) -> Scene:
    """The scene with all loops larger by a factor."""
    loop = scene.knit.loop
    larger = {name: factor * getattr(loop, name) for name in _names(scene)}
    return replace(scene, knit=replace(scene.knit, loop=replace(loop, **larger)))


def fitted_by(scene: Scene, factor: float, how: str, to: str, rms_error: float | None = None) -> Fitted:
    """The scene scaled by `factor`. Raises `InputError` if its wires hook differently."""
    larger = scaled(scene, factor)
    meant, found = len(knit_scene(scene).clasps), len(knit_scene(larger).clasps)
    if found != meant:
        wrong = f"the fitted loops hook {found} times per repeat, those of the scene {meant} times"
        raise InputError(f"{scene.path}: {how}: {wrong}; use a value nearer to that of the scene")
    loops = LoopFit(to, factor, {name: getattr(larger.knit.loop, name) for name in _names(scene)}, rms_error)
    return Fitted(larger, (f"loop proportions times {factor:.3f}, fitted to {how}",), loops)


def _names(scene: Scene) -> tuple[str, ...]:
    return SIZES[loop_shape(lapping_table(scene.knit.bars, (1, 1)), LoopProportions.of(scene.knit.loop))]


def factors(scene: Scene) -> tuple[float, float]:
    """Smallest and largest factor that keep all proportions in range and the loops of neighbouring wales separate."""
    return _bounded(scene, scene.knit.bars, lambda factor: scaled(scene, factor))


def _bounded(scene: Scene, bars: Sequence[Bar], larger: Callable[[float], Scene]) -> tuple[float, float]:
    """The same for the loops of some bars, with the scene that a factor makes."""
    sizes = [bar.loop_scale for bar in bars]
    ranges = [np.array(RANGES[name]) / (getattr(scene.knit.loop, name) * size) for name in _names(scene) for size in sizes]
    low, high = max(float(r[0]) for r in ranges) + EDGE, min(float(r[1]) for r in ranges) - EDGE
    while high > 1.0:
        try:
            knit_scene(larger(high))
        except KnitError:
            high = 1.0 + SHORTER * (high - 1.0) if high - 1.0 > FIT_TOLERANCE else 1.0
        else:
            break
    return low, high
