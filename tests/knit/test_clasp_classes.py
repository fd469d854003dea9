"""Classes of contact, and the parts of a loop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from warpknit.knit.cloth import Cloth, knit_cloth
from warpknit.measure import part_of_loop
from warpknit.scene.knit import Knit
from warpknit.scene.scene_loader import make_scene

DIAMETER = 15e-6  # [m]


def atlas() -> Knit:
    return make_scene({}).knit


def cloth_of(knit: Knit) -> Cloth:
    return knit_cloth(knit, DIAMETER)


def test_the_double_atlas_has_three_classes_of_four_clasps() -> None:
    """Its glide symmetry leaves three of the twelve clasps different; copies by it are half a repeat apart in warp."""
    classes = cloth_of(atlas()).classes
    assert np.bincount(classes).tolist() == [4, 4, 4]
    assert classes[:6].tolist() == classes[6:].tolist()


@pytest.mark.parametrize("seed", range(3))
def test_scattered_loops_keep_the_classes_of_equal_ones(seed: int) -> None:
    knit = replace(atlas(), scatter=0.1, seed=seed)
    assert cloth_of(knit).classes.tolist() == cloth_of(knit.even).classes.tolist()
    assert np.bincount(knit_cloth(knit, DIAMETER, True, (2, 2)).classes).tolist() == [16, 16, 16]


def test_the_highest_point_of_a_loop_is_its_head_and_the_lowest_its_foot() -> None:
    """The wire of a stitch passes underlap, foot, leg, head, leg, foot, underlap, in either direction of its thread."""
    cloth = cloth_of(atlas())
    thread = cloth.threads[0]
    arcs = np.arange(len(thread.points)) * thread.spacing
    parts = [part_of_loop(cloth, 0, float(arc)) for arc in arcs[::8]]
    kinds = [part for k, part in enumerate(parts) if k == 0 or part != parts[k - 1]]
    start = next(k for k, part in enumerate(kinds) if part.startswith("underlap of a closed") and "closed" in kinds[k + 1])
    words = [part.split()[0] for part in kinds[start : start + 7]]
    assert words == ["underlap", "foot", "leg", "head", "leg", "foot", "underlap"]
    assert all(part.endswith("closed loop") for part in kinds[start : start + 7])
