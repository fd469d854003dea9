"""Stretching of a wire segment.

    e = F E0 + (u_next - u)      T = offset + (EA/s) (|e|/L - 1)

| symbol | argument | unit |
|---|---|---|
| E0 | rest_x, rest_y: rest edge from the node to the next one | m |
| F | deformation gradient that carries the mesh with its boundary | - |
| u | displacement from the affinely mapped rest shape, in counts of `unit` | m |
| L | natural length, thermal expansion included | m |
| EA/s | axial stiffness over its softening s | N |
| offset | augmented Lagrangian multiplier, corrects the softening | N |
"""

from typing import Any

import warp as wp


@wp.func
def edge_component(row_x: Any, row_y: Any, rest_x: Any, rest_y: Any, u_next: Any, u: Any, unit: Any):
    """One component of the deformed edge [m]; the difference is taken before the conversion, so it is exact."""
    return row_x * rest_x + row_y * rest_y + unit * type(unit)(u_next - u)
