"""Warnings where a planar result differs much from a spatial one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ..base.text import percent
from ..knit.cloth import Cloth
from ..mesh.tight_loops import TIGHT, first_touch, way_left
from ..results.finding import ResultWarning
from ..results.row import Row
from ..scene import Scene

SLID = 1.0  # diameters by which wires slide along each other: the double atlas cell has 1e-3, a queen's cord 3.5
INSTEAD = "use model.kind = 'spatial'"


def slid_wires(scene: Scene, rows: Sequence[Row]) -> Iterator[ResultWarning]:
    """Warning where wires slid along each other, which invalidates the result."""
    slid = max((row.get("slid_max_m") or 0.0 for row in rows), default=0.0) / scene.wire.diameter
    if slid > SLID:
        text = f"this planar result is not valid: wires slid along each other by {slid:.2g} wire diameters"
        yield ResultWarning("W01", text, INSTEAD, link="; ")


def tight_loops(scene: Scene, cloth: Cloth) -> Iterator[ResultWarning]:
    """Warning where wires in space touch long before the lenses of the plane close."""
    share, loops = first_touch(scene), "tight loops"
    if share >= TIGHT and scene.knit.scatter:
        wire, loops = scene.wire, "the tightest of the scattered loops"
        share = way_left(cloth, wire.thickness, wire.thickness + 2.0 * scene.model.body_radius)
    if share < TIGHT:
        yield ResultWarning(
            "W02",
            f"{loops}: the planar model closes contacts too late, and its tension is too small (first touch at"
            f" {percent(share, 0)} of the planar approach)",
            INSTEAD,
            link="; ",
        )
