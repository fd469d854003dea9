"""[hook] of a scene: two arcs of wire in place of a knit."""

from __future__ import annotations

import math
from dataclasses import dataclass

from warpknit.scene.keys import Table, key
from warpknit.scene.values import Length, LoopLength


@dataclass(frozen=True, kw_only=True)
class Hook(Table):
    """[hook], in place of [knit]: two arcs of wire that hook each other."""

    radius: LoopLength = key("Radius of both arcs; at least four diameters of the wire.", 1e-3)
    length: LoopLength = key(
        "Arc length of each wire.", None, left_out="a third of a circle", allowed="half a radius to half a circle"
    )
    overlap: LoopLength = key(
        "Overlap of the two arcs at rest: the width of the lens between them.",
        None,
        left_out="a fifth of the radius",
        allowed="1.5 diameters of the wire to the rise of the arc",
    )
    crossing_distance: Length | None = key(
        "Spatial model: distance of the centre lines at their crossings at rest; from the thickness of the wire to `overlap`. Not"
        " used in the planar model.",
        None,
        left_out="1.3 thicknesses of the wire",
    )

    @property
    def height(self) -> float:
        """[m] of the upper ends above the lower ones, at rest."""
        return 2.0 * self.radius * math.sin(0.5 * self.length / self.radius)
