"""Whether the loops of a knit are tight: wires in space touch long before the lenses of the planar model close.

The share of the planar approach at the first touch is 0.88 on the double atlas cell, 0.44 on a single atlas and 0.70 on a tricot
(studies/condensation.md).
"""

from __future__ import annotations

from functools import lru_cache

from ..knit.cloth import same_cloth
from ..knit.lens_width import way_left
from ..scene import Scene
from ..scene.knit import Knit
from ..scene.presets import PRESETS

TIGHT = 0.8  # share of the planar approach at the first touch, below which loops are tight


def first_touch(scene: Scene) -> float:
    """Share of the planar approach at which wires of the scene's knit first touch in space; 1: not before the lenses close.

    Loops of the mean size stand for scattered ones. Raises `KnitError`.
    """
    wire = scene.wire
    return _first_touch(scene.knit.even, wire.thickness, wire.thickness + 2.0 * scene.model.body_radius)


def is_tight(scene: Scene) -> bool:
    """Whether loops are tight. Raises `KnitError`."""
    return first_touch(scene) < TIGHT


def tension_error(scene: Scene) -> float | None:
    """[%] known error of tensions at the preset in force, of tight knits against the reference preset; None if unknown."""
    name = scene.preset_in_force
    if name is None or not is_tight(scene):
        return scene.preset_error_percent
    return PRESETS[name].of(scene.model.kind, scene.solver.drive).tight_error_percent


@lru_cache(maxsize=64)
def _first_touch(knit: Knit, thickness: float, closing: float) -> float:
    """`first_touch` of one repeat; lengths in [m]."""
    cloth = same_cloth(knit, thickness)  # with nested lenses as one, however many bodies they get
    return way_left(cloth, thickness, closing)
