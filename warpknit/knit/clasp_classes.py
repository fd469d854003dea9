"""Classes of contact: clasps of one shape, which by the symmetry of the knit carry the same load in a mesh of equal loops.

The shape of a clasp is that of its lens: on each of its two wires the clearance of the body and the arc of the lens. Clasps of
shapes within SAME_SHAPE of the wale spacing are of one class. Scattered loops have the classes of equal ones: a clasp is of
the class of the nearest clasp, in place and shape, of the knit without scatter.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .clasps import Clasp
from .cloth import same_cloth

CLASS_NAMES = "ABCDEFGHIJKL"  # the last one also takes further classes
SAME_SHAPE = 0.02  # of the wale spacing: centre lines are sampled, so that equal lenses differ a little


@lru_cache(maxsize=8)
def clasp_classes(knit: Any, diameter: float, merge_lenses: bool = True, tiles: tuple[int, int] = (1, 1)) -> NDArray[np.intp]:
    """[clasp] number of the class of each clasp of `knit_cloth`, from the tightest lens on. `knit` has `scatter` and `even`."""
    cloth = same_cloth(knit, diameter, merge_lenses, tiles)
    if not knit.scatter:
        return _classes_by_shape(_shapes(cloth.clasps), SAME_SHAPE * knit.wale_spacing)
    even = same_cloth(knit.even, diameter, merge_lenses)
    apart = _places(cloth.clasps)[:, None] - _places(even.clasps)
    apart -= np.round(apart / even.size) * even.size
    unlike = _shapes(cloth.clasps)[:, None] - _shapes(even.clasps)
    distance = np.linalg.norm(apart, axis=2) + np.linalg.norm(unlike, axis=2)
    return np.asarray(clasp_classes(knit.even, diameter, merge_lenses)[np.argmin(distance, axis=1)])


def _shapes(clasps: Sequence[Clasp]) -> NDArray[np.float64]:
    """(clasp, 4) [m] clearance and arc on the wire with the smaller ones, and on the other."""
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
