"""The strains at which a mesh carries the same tension in weft and warp, read from its contact map."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import least_squares

from ..contact_map import MapRow, grid

SERVICE_TENSIONS = (2.0, 3.4, 4.9)  # [N/m] of meshes in orbit (VSOP-2, ASP Conf. Ser. 402, 66)
INSIDE = 1e-6  # of a tension: how well the bilinear map must meet it


def strains_at_tension(rows: Sequence[MapRow], tension: float) -> tuple[float, float] | None:
    """Weft and warp strain at which the map, bilinear between its points, carries `tension` [N/m] both ways; None where it
    nowhere does. Of several the one of least strain."""
    weft = sorted({row.cell.strain_weft for row in rows})
    warp = sorted({row.cell.strain_warp for row in rows})
    both = np.stack([grid(rows, f"tension_{side}_N_per_m", weft, warp) for side in ("weft", "warp")])
    found = []
    for j, i in np.ndindex(len(warp) - 1, len(weft) - 1):
        corners = both[:, j : j + 2, i : i + 2] / tension - 1.0  # (direction, warp, weft)
        if not np.all((corners.min(axis=(1, 2)) <= 0.0) & (corners.max(axis=(1, 2)) >= 0.0)):
            continue  # also where a corner is unknown

        def missed(place: np.ndarray, corners: np.ndarray = corners) -> np.ndarray:
            x, y = place
            return np.einsum("dji,j,i->d", corners, [1.0 - y, y], [1.0 - x, x])

        met = least_squares(missed, [0.5, 0.5], bounds=([0.0, 0.0], [1.0, 1.0]))
        if np.abs(met.fun).max() < INSIDE:
            x, y = met.x
            found.append((weft[i] + x * (weft[i + 1] - weft[i]), warp[j] + y * (warp[j + 1] - warp[j])))
    return min(found, key=sum, default=None)


def largest_common_tension(rows: Sequence[MapRow]) -> float:
    """The largest tension [N/m] that some strains of the map carry in both directions at least."""
    carried = [
        min(row.cell.tension_weft_N_per_m, row.cell.tension_warp_N_per_m)
        for row in rows
        if row.cell.tension_weft_N_per_m is not None and row.cell.tension_warp_N_per_m is not None
    ]
    return max(carried, default=0.0)
