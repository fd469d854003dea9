"""Bounds of a pulled strip that need no simulation: the wires that cross a line, and the strain at which wire is straight."""

from __future__ import annotations

import numpy as np
from strip_pull import WARP, section_area

from warpknit.knit.lapping import lapping_table
from warpknit.mesh.layout import knit_scene
from warpknit.scene import Scene

LINES = 360  # across a repeat


def yarns_across(scene: Scene, axis: int) -> float:
    """[1/m] yarns that cross a line across the pull, over its length, as knitted; of all such lines the one with the fewest."""
    cloth = knit_scene(scene)
    period, count = cloth.size[axis], np.zeros(LINES, dtype=int)
    for thread in cloth.threads:
        onward = thread.points[0] + [0.0, cloth.size[1], 0.0]
        place = np.append(thread.points[:, axis], onward[axis]) / period
        for number in range(LINES):
            count[number] += np.abs(np.diff(np.floor(place - (number + 0.5) / LINES))).astype(int).sum()
    return float(count.min() / cloth.size[1 - axis])


def strongest(scene: Scene, axis: int, strength: float) -> float:
    """Upper bound of the force [N/m] over the knitted width: every wire across a line at its strength [Pa]."""
    return yarns_across(scene, axis) * section_area(scene.wire) * strength


def straight_strain(scene: Scene, axis: int) -> float:
    """Strain at which a bar of thin wire is straight: its wire of a course is then all along the pull.

    Along the wales a loop is two legs a course long, and the underlap a third: L = 3 C'. Along the courses it is the underlap, as
    long as the needles between two loops: L = k W'. The bar that is straight first counts. L is the spatial length.
    """
    knit, cloth, lapping = scene.knit, knit_scene(scene), lapping_table(scene.knit.bars)
    strains = []
    for bar in range(lapping.bars):
        if axis == WARP:
            there = 3.0 * knit.course_spacing
        else:
            needles = [[s.needle for s in stitches] for stitches in lapping.threads if stitches[0].bar == bar]
            steps = [abs(b - a) for row in needles for a, b in zip(row, row[1:] + row[:1], strict=True)]
            there = knit.wale_spacing * float(np.mean(steps))
        strains.append(cloth.run_in(bar) / there - 1.0)
    return min(strains)
