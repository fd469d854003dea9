"""Tight loops: round wires touch long before the lenses of the planar model close.

The share of the planar approach at the first touch is 0.88 on the double atlas cell, 0.44 on a single atlas and 0.70 on a tricot
(studies/condensation.md).

A planar model lets two hooked wires approach until their lens is as wide as its body. Spatial wires pass over each other at one
end of the lens and under at the other, and touch there first: the more abrupt the change of height and the shorter the lens, the
earlier. Here one wire is moved towards the other as both are knitted, without bending.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ..knit.clasps import Arm, Clasp
from ..knit.cloth import Cloth, knit_cloth
from ..scene import Scene
from ..scene.knit import Knit

PARTS = 4  # of the diameter, between the points that are compared
MOST_POINTS = 20_000  # of an arm: wires of a ten-thousandth of their loops


def lens_widths(cloth: Cloth, diameter: float) -> NDArray[np.float64]:
    """Plan distance of both wires of each clasp (clasp, 2) [m]: as knitted, and where wires of a diameter [m] first touch. One
    diameter where they would slide past each other.
    """
    return np.array([_widths(cloth, clasp, diameter) for clasp in cloth.clasps]).reshape(-1, 2)


def approach_at_touch(cloth: Cloth, diameter: float, closing: float) -> float:
    """Share of the approach at the first touch, least over all clasps.

    The approach ends at a lens of width `closing` [m]. 1 without touch before; 0
    if wires overlap in plan view as knitted.
    """
    width, touching = lens_widths(cloth, diameter).T
    early = (touching > closing) & (width > touching)
    if not early.any() and np.any(width < diameter):
        return 0.0
    return float(np.min((width - touching)[early] / (width - closing)[early], initial=1.0))


def _widths(cloth: Cloth, clasp: Clasp, diameter: float) -> tuple[float, float]:
    one, two = (_points(cloth, arm, diameter) for arm in clasp.arms)
    nearest = [points[np.argmin(np.hypot(*(points[:, :2] - clasp.position).T))] for points in (one, two)]
    way = (nearest[0] - nearest[1]) * [1.0, 1.0, 0.0]
    width = float(np.linalg.norm(way))
    if width <= diameter:
        return width, diameter
    # moved by t along the way, a point of the second wire is within a diameter of one of the first where |along - t| < root
    direction = way / width
    across = np.array([[-direction[1], direction[0], 0.0], [0.0, 0.0, 1.0]]).T
    near = cKDTree(one @ across).sparse_distance_matrix(cKDTree(two @ across), diameter, output_type="ndarray")
    along = (one[near["i"]] - two[near["j"]]) @ direction
    root = np.sqrt((diameter**2 - near["v"] ** 2).clip(0.0))
    ahead = (root > 0.0) & (along > 0.0)
    moved = np.min((along - root)[ahead].clip(0.0), initial=width - diameter)
    return width, width - float(moved)


def _points(cloth: Cloth, arm: Arm, diameter: float) -> NDArray[np.float64]:
    """(k, 3) [m] of the wire of an arm along its lens."""
    points = cloth.threads[arm.thread].stretch(arm.arc_low, arm.arc_high, cloth.size[1])
    points = points + [arm.column * cloth.size[0], 0.0, 0.0]
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    even = np.linspace(0.0, length[-1], 2 + min(int(PARTS * length[-1] / diameter), MOST_POINTS))
    return np.stack([np.interp(even, length, points[:, k]) for k in range(3)], axis=1)


TIGHT = 0.8  # share of the planar approach at the first touch, below which loops are tight


def first_touch(scene: Scene) -> float:
    """Share of the planar approach at which wires first touch; 1: not before the lenses close.

    Loops of the mean size stand for scattered ones. Raises `KnitError`.
    """
    thickness = scene.wire.thickness
    return _first_touch(scene.knit.even, thickness, thickness + 2.0 * scene.model.body_radius)


@lru_cache(maxsize=64)
def _first_touch(knit: Knit, thickness: float, closing: float) -> float:
    """`first_touch` of one repeat; lengths in [m]."""
    cloth = knit_cloth(knit, thickness)  # with nested lenses as one, however many bodies they get
    return approach_at_touch(cloth, thickness, closing)


def is_tight(scene: Scene) -> bool:
    """Whether loops are tight. Raises `KnitError`."""
    return first_touch(scene) < TIGHT


def tension_error(scene: Scene) -> float | None:
    """Known error of tensions of tight knits at the preset in force [%]; None if unknown. Relative to the reference preset."""
    measured = scene.preset_measured
    if measured is None:
        return None
    return measured.tight_error_percent if is_tight(scene) else measured.error_percent
