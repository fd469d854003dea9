"""Cloth: one repeat of endless knitted cloth, from chain notation to clasps.

x is weft (wales side by side), y is warp (courses), z > 0 the technical face; SI units.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..text import short_repr
from .centreline import Thread, thread_line
from .chain import KnitError
from .clasps import Clasp, find_lenses, make_clasps
from .crossings import Crossings, find_crossings
from .keypoints import LoopFrame
from .lapping import Stitch, lapping_table
from .loops import LoopProportions, Shape, loop_shape
from .openings import Rhombus, find_rhombus
from .scatter import scattered_proportions

ALIKE = 0.999  # of the largest opening's area: openings that count as equal
SCATTERED_ALIKE = 0.5  # the same where loops differ


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

    @property
    def stitch_length(self) -> float:
        """Mean plan wire length of a stitch [m]."""
        return sum(thread.length for thread in self.threads) / len(self.stitches)

    @property
    def wire_length(self) -> float:
        """Mean wire length of a stitch in space [m], its rises and falls included: the run-in of a loop."""
        return sum(map(self._length_in_space, self.threads)) / len(self.stitches)

    def run_in(self, bar: int) -> float:
        """[m] wire in space that a guide bar takes a course."""
        lengths = [self._length_in_space(thread) for thread in self.threads if thread.bar == bar]
        return sum(lengths) / len(lengths) / self.courses

    def _length_in_space(self, thread: Thread) -> float:
        """[m] of a period."""
        steps = np.diff(thread.stretch(0.0, thread.length, float(self.size[1])), axis=0)
        return float(np.linalg.norm(steps, axis=1).sum())

    @property
    def wire_per_area(self) -> float:
        """Plan wire length in an area [1/m]: of all bars, however many of them lay a loop on each needle and course."""
        return sum(thread.length for thread in self.threads) / float(np.prod(self.size))


@lru_cache(maxsize=8)
def same_cloth(knit: Any, diameter: float, merge_lenses: bool = True, tiles: tuple[int, int] = (1, 1)) -> Cloth:
    """`knit_cloth` of a knit that can be hashed, made once; its arrays must not be changed."""
    return knit_cloth(knit, diameter, merge_lenses, tiles)


def knit_cloth(knit: Any, diameter: float, merge_lenses: bool = True, tiles: tuple[int, int] = (1, 1)) -> Cloth:
    """Knit one repeat of endless cloth.

    knit: `bars` (each with `chain`, `threading`, `shift`, and `loop_scale` where loops differ by bar), `wale_spacing` [m],
    `course_spacing` [m], `loop` (`LoopProportions` or any object with its names, None for the defaults), and, where loops
    differ at random, `scatter` and `seed`.
    diameter: of the wire, or thickness of the yarn [m].
    merge_lenses: one clasp for nested lenses of the same wires.
    tiles: pattern repeats (weft, warp) taken as one repeat.
    Raises `KnitError` for a knit that cannot be made.
    """
    proportions = LoopProportions.of(knit.loop)
    wale, course = float(knit.wale_spacing), float(knit.course_spacing)
    for key, value in (("knit.wale_spacing", wale), ("knit.course_spacing", course), ("wire.diameter", diameter)):
        if not 0.0 < value < np.inf:
            raise KnitError(key, f"{value!r} is not above 0", "write a length above 0 m")
    lapping = lapping_table(knit.bars, tiles)
    shape = loop_shape(lapping, proportions)
    layers = 1 + max(stitch.layer for stitch in lapping.stitches)
    scatter = float(getattr(knit, "scatter", 0.0))
    sizes = [float(getattr(bar, "loop_scale", 1.0)) for bar in knit.bars]
    by_bar = [proportions.sized(size, shape, f"knit.bars[{bar}].loop_scale") for bar, size in enumerate(sizes)]
    loops: tuple[LoopProportions, ...] = ()
    if scatter or any(size != 1.0 for size in sizes):
        loops = tuple(by_bar[stitch.bar] for stitch in lapping.stitches)
    if scatter:
        loops = scattered_proportions(loops, scatter, knit.seed)
    frame = LoopFrame(shape, proportions, wale, course, diameter, layers, loops, lapping.courses)
    frame.check()
    threads = tuple(
        thread_line(number * lapping.courses, stitches, lapping.courses, frame) for number, stitches in enumerate(lapping.threads)
    )
    size = np.array([lapping.wales * wale, lapping.courses * course])
    crossings = find_crossings(threads, size)
    stitch_length = sum(thread.length for thread in threads) / len(lapping.stitches)
    lenses = find_lenses(threads, crossings, size, stitch_length)
    clasps = make_clasps(threads, lenses, size, merge_lenses)
    rhombus = find_rhombus(threads, lapping.stitches, crossings, clasps, size, SCATTERED_ALIKE if scatter else ALIKE)
    return Cloth(size, lapping.wales, lapping.courses, shape, threads, lapping.stitches, crossings, clasps, rhombus)
