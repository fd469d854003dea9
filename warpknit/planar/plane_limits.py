"""Where a planar result may be far from that in space, and how that is seen without a run in space."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from ..knit.cloth import Cloth
from ..knit.lens_width import way_left
from ..scene import Scene

EARLY = 0.8  # share of the way to closing from which wires in space may touch first: the double atlas cell has 0.88
SLID = 0.5  # diameters by which wires may slide along each other: on the double atlas cell it is 1e-3
INSTEAD = "model.kind = 'spatial' says by how much"


def tight_loops(scene: Scene, cloth: Cloth) -> Iterator[str]:
    """A line where wires in space touch long before the lenses of the plane close."""
    wire = scene.wire
    share = way_left(cloth, wire.thickness, wire.thickness + 2.0 * scene.model.body_radius)
    if share < EARLY:
        yield (
            f"tight loops: moved together as knitted, wires touch in space after {share:.0%} of the way that they have to go in"
            f" the plane, so they hook sooner and carry more; {INSTEAD}"
        )


def slid_wires(scene: Scene, stages: Sequence[dict[str, Any]]) -> Iterator[str]:
    """A line where wires have slid along each other."""
    slid = max((stage["wire"]["slid_max_m"] for stage in stages), default=0.0) / scene.wire.diameter
    if slid > SLID:
        yield (
            f"wires have slid along each other by {slid:.2g} diameters: nothing holds them in the plane where in space they lie"
            f" on each other, so that they hook sooner and carry more; {INSTEAD}"
        )
