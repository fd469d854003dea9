"""Cloth: one repeat of endless knitted cloth, from chain notation to clasps.

x is weft (wales side by side), y is warp (courses), z > 0 the technical face; SI units.

Clasps of one shape form a class of contacts: by the symmetry of the knit they carry the same load in a mesh of equal loops. The
shape of a clasp is the shape of its lens: on each of its two wires the clearance of the body and the arc of the lens. Shapes
within SAME_SHAPE of the wale spacing belong to one class. Scattered loops have the classes of equal loops: a clasp belongs to the
class of the nearest clasp, in place and shape, of the knit without scatter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.text import short_repr
from .centreline import LoopFrame, Thread, thread_line
from .clasps import Clasp, Lens, find_lenses, make_clasps, nested_lenses
from .crossings import Crossings, find_crossings
from .lapping import KnitError, Lapping, Stitch, lapping_table
from .loops import LoopProportions, Shape, loop_shape
from .openings import Rhombus, find_rhombus
from .scatter import Knitted, lenses_of_scattered, near_wires, scattered_proportions

ALIKE = 0.999  # of the largest opening's area: openings that count as equal
SCATTERED_ALIKE = 0.5  # the same where loops differ
NEARER = 0.1  # of the thickness: wires of scattered loops may be nearer by it than overlapping equal loops
LEAST_SHARE = 0.1  # of the deviation of a loop, below which the loop is a mean one


@dataclass(frozen=True)
class Cloth:
    """One repeat; the cloth goes on with period size[0] along x and size[1] along y."""

    __repr__ = short_repr

    size: NDArray[np.float64]  # (2,) [m] width and height of one repeat
    wales: int
    courses: int
    shape: Shape  # of the loops
    threads: tuple[Thread, ...]
    stitches: tuple[Stitch, ...]
    crossings: Crossings
    clasps: tuple[Clasp, ...]
    rhombus: Rhombus | None
    classes: NDArray[np.intp]  # [clasp] from the tightest lens on

    @property
    def stitch_length(self) -> float:
        """Mean plan wire length of a stitch [m]."""
        return sum(thread.length for thread in self.threads) / len(self.stitches)

    @property
    def wire_length(self) -> float:
        """Mean wire length of a stitch [m], rises and falls included: the run-in of a loop."""
        return sum(map(self._length_in_space, self.threads)) / len(self.stitches)

    def run_in(self, bar: int) -> float:
        """Wire length of a guide bar a course [m], along the spatial curve."""
        lengths = [self._length_in_space(thread) for thread in self.threads if thread.bar == bar]
        return sum(lengths) / len(lengths) / self.courses

    @property
    def mean_curvature(self) -> float:
        """[1/m] of the wires in plan view: all angles by which they turn, either way, over their length."""
        turned = 0.0
        for thread in self.threads:
            steps = np.diff(thread.stretch(0.0, thread.length + thread.spacing, float(self.size[1]))[:, :2], axis=0)
            angles = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
            turned += float(np.abs(np.diff(angles)).sum())
        return turned / sum(thread.length for thread in self.threads)

    def _length_in_space(self, thread: Thread) -> float:
        """[m] of a period."""
        steps = np.diff(thread.stretch(0.0, thread.length, float(self.size[1])), axis=0)
        return float(np.linalg.norm(steps, axis=1).sum())

    @property
    def wire_per_area(self) -> float:
        """Plan wire length in an area [1/m]: of all bars, however many of them lay a loop on each needle and course."""
        return sum(thread.length for thread in self.threads) / float(np.prod(self.size))


@lru_cache(maxsize=8)
def knit_cloth(knit: Any, diameter: float, merge_lenses: bool = True, tiles: tuple[int, int] = (1, 1)) -> Cloth:
    """Knit one repeat of endless cloth. It is cached: its arrays must not be changed.

    knit: hashable, with `bars` (each with `chain`, `threading`, `shift`, and `loop_scale` where loops differ by bar),
    `wale_spacing` [m], `course_spacing` [m], `loop` (`LoopProportions` or any object with its names), and, where loops differ at
    random, `scatter`, `seed` and `even`, the same without scatter.
    diameter: of the wire, or thickness of the yarn [m].
    merge_lenses: one clasp for nested lenses of the same wires.
    tiles: pattern repeats (weft, warp) taken as one repeat.
    Raises `KnitError` for a knit that cannot be made.
    """
    proportions = LoopProportions.of(knit.loop)
    wale, course = float(knit.wale_spacing), float(knit.course_spacing)
    lapping = lapping_table(knit.bars, tiles)
    shape = loop_shape(lapping, proportions)
    scatter = float(getattr(knit, "scatter", 0.0))
    sizes = [float(getattr(bar, "loop_scale", 1.0)) for bar in knit.bars]
    by_bar = [proportions.sized(size, shape, f"knit.bars[{bar}].loop_scale") for bar, size in enumerate(sizes)]

    def frame_of(lapping: Lapping) -> LoopFrame:
        loops = tuple(by_bar[stitch.bar] for stitch in lapping.stitches)
        return LoopFrame(shape, proportions, wale, course, diameter, lapping, loops)

    frame = frame_of(lapping)
    frame.check()
    if scatter:
        repeat, lenses = _repeat(frame_of(lapping_table(knit.bars)), merge_lenses)
        knitted = _knitted(_scattered(frame, scatter, knit.seed, repeat))
        found = lenses_of_scattered(knitted, repeat, lenses)
        if found is None:
            wrong = f"{scatter!r} with knit.seed = {knit.seed} changes which loops hook"
            raise KnitError("knit.scatter", wrong, "write a smaller knit.scatter, or another knit.seed")
    else:
        knitted, found = _repeat(frame, merge_lenses)
    threads, crossings, size = knitted.threads, knitted.crossings, knitted.size
    clasps = make_clasps(threads, found, size)
    rhombus = find_rhombus(threads, lapping.stitches, crossings, clasps, size, SCATTERED_ALIKE if scatter else ALIKE)
    if scatter:
        classes = _classes_of_nearest(clasps, knit_cloth(knit.even, diameter, merge_lenses))
    else:
        classes = _classes_by_shape(_shapes(clasps), SAME_SHAPE * knit.wale_spacing)
    return Cloth(size, lapping.wales, lapping.courses, shape, threads, lapping.stitches, crossings, clasps, rhombus, classes)


@lru_cache(maxsize=8)
def _repeat(frame: LoopFrame, merge_lenses: bool) -> tuple[Knitted, list[list[Lens]]]:
    """One repeat of equal loops, and the lenses of each clasp: one, or all that are nested. They must not be changed."""
    knitted = _knitted(frame)
    threads, size = knitted.threads, knitted.size
    lenses = find_lenses(threads, knitted.crossings, size, knitted.lengths.sum() / len(frame.lapping.stitches))
    return knitted, nested_lenses(threads, lenses, size) if merge_lenses else [[lens] for lens in lenses]


def _knitted(frame: LoopFrame) -> Knitted:
    """The wires of one repeat and their crossings."""
    threads = _threads(frame)
    return Knitted(frame.lapping, threads, frame.size, find_crossings(threads, frame.size))


def _threads(frame: LoopFrame) -> tuple[Thread, ...]:
    return tuple(thread_line(number, frame) for number in range(len(frame.lapping.threads)))


def _scattered(frame: LoopFrame, scatter: float, seed: int, repeat: Knitted) -> LoopFrame:
    """The frame with scattered loops; repeat: one repeat of equal loops.

    Where wires would lie in each other, the deviations of both loops are halved until they do not.
    """
    share = np.ones(len(frame.loops))
    together = np.array(frame.lapping.formed_together)
    closest = near_wires(repeat.threads, repeat.size, (1.0 + NEARER) * frame.diameter)[0].min(initial=np.inf)
    reach = min(frame.diameter, closest - NEARER * frame.diameter)
    while True:
        loops = scattered_proportions(frame.loops, share[together] * scatter, seed, together)
        scattered = frame.with_room(loops)
        crowded = np.unique(together[near_wires(_threads(scattered), frame.size, reach)[1]])
        if not share[crowded].any():
            return scattered
        share[crowded] *= np.where(share[crowded] > LEAST_SHARE, 0.5, 0.0)


CLASS_NAMES = "ABCDEFGHIJKL"  # the last one also takes further classes
SAME_SHAPE = 0.02  # of the wale spacing: centre lines are sampled, so that equal lenses differ a little


def _classes_of_nearest(clasps: Sequence[Clasp], even: Cloth) -> NDArray[np.intp]:
    """Class of each clasp [clasp] of scattered loops: of the nearest and most similar clasp of equal loops."""
    apart = _places(clasps)[:, None] - _places(even.clasps)
    apart -= np.round(apart / even.size) * even.size
    unlike = _shapes(clasps)[:, None] - _shapes(even.clasps)
    distance = np.linalg.norm(apart, axis=2) + np.linalg.norm(unlike, axis=2)
    return np.asarray(even.classes[np.argmin(distance, axis=1)])


def _shapes(clasps: Sequence[Clasp]) -> NDArray[np.float64]:
    """Clearance and arc (clasp, 4) [m] on the wire with the smaller ones, and on the other."""
    arms = [sorted((arm.clearance, arm.arc_high - arm.arc_low) for arm in clasp.arms) for clasp in clasps]
    return np.array(arms).reshape(-1, 4)


def _places(clasps: Sequence[Clasp]) -> NDArray[np.float64]:
    """(clasp, 2) [m]"""
    return np.array([clasp.position for clasp in clasps]).reshape(-1, 2)


def _classes_by_shape(shapes: NDArray[np.float64], tolerance: float) -> NDArray[np.intp]:
    """[clasp] number of its class, in the order of clearance; each class stands about its first clasp."""
    found = np.zeros(len(shapes), dtype=np.intp)
    examples: list[NDArray[np.float64]] = []
    for clasp in np.lexsort(np.round(shapes / tolerance).T[::-1]):
        near = [number for number, example in enumerate(examples) if np.abs(shapes[clasp] - example).max() < tolerance]
        if not near:
            near = [len(examples)]
            examples.append(shapes[clasp])
        found[clasp] = min(near[0], len(CLASS_NAMES) - 1)
    return found
