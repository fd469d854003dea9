"""Warnings where a planar result may differ much from a spatial one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from ..knit.cloth import Cloth
from ..knit.lens_width import way_left
from ..scene import Scene
from ..scene.model_choice import PLANE_IS_GOOD, first_touch
from ..text import percent

SLID = 0.5  # diameters of sliding between wires: the double atlas cell has 1e-3
CHECK = "compare with model.kind = 'spatial'"


def tight_loops(scene: Scene, cloth: Cloth) -> Iterator[str]:
    """Warning where wires in space touch long before the lenses of the plane close."""
    share, loops = first_touch(scene), "tight loops"
    if share >= PLANE_IS_GOOD and scene.knit.scatter:
        wire, loops = scene.wire, "the tightest of the scattered loops"
        share = way_left(cloth, wire.thickness, wire.thickness + 2.0 * scene.model.body_radius)
    if share < PLANE_IS_GOOD:
        yield (
            f"{loops}: wires in space touch after {percent(share, 0)} of the planar approach, so they hook earlier and carry"
            f" more; {CHECK}"
        )


def slid_wires(scene: Scene, stages: Sequence[dict[str, Any]]) -> Iterator[str]:
    """Warning where wires have slid along each other."""
    slid = max((stage["wire"]["slid_max_m"] for stage in stages), default=0.0) / scene.wire.diameter
    if slid > SLID:
        yield (
            f"wires slid along each other by {slid:.2g} diameters: in space their contact would limit this, so they hook"
            f" earlier and carry more; {CHECK}"
        )
