"""The strains at which a mesh carries the same tension in weft and warp, read from its contact map."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import least_squares

from .. import measure
from ..errors import Diverged
from ..model.model import Model
from ..sweep.contact_map import MapRow, grid
from .states import states_at

SERVICE_TENSIONS = (2.0, 3.4, 4.9)  # [N/m] of meshes in orbit (VSOP-2, ASP Conf. Ser. 402, 66)
FINER = 9  # strains a side at which a map is looked at more closely
SIDES = ("weft", "warp")
INSIDE = 1e-6  # of a tension: how well the bilinear map must meet it


def strains_at_tension(rows: Sequence[MapRow], tension: float) -> tuple[float, float] | None:
    """Weft and warp strain at which the map, bilinear between its points, carries `tension` [N/m] both ways; None where it
    nowhere does. Of several the one of least strain."""
    weft = sorted({row.cell.strain_weft for row in rows})
    warp = sorted({row.cell.strain_warp for row in rows})
    return strains_on_grid(weft, warp, np.stack([grid(rows, f"tension_{side}_N_per_m", weft, warp) for side in SIDES]), tension)


def strains_on_grid(weft: Sequence[float], warp: Sequence[float], both: np.ndarray, tension: float) -> tuple[float, float] | None:
    """The same of tensions (direction, warp, weft) [N/m] on a grid of strains, nan where they are unknown."""
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


def strains_seen_closely(
    model: Model, rows: Sequence[MapRow], tension: float, about: tuple[float, float]
) -> tuple[float, float] | None:
    """The same from states of `model` on a finer grid, up to one step of the map away from the strains `about`."""
    axes = []
    for side, middle in enumerate(about):
        strains = np.unique([row.strains[side] for row in rows])
        step = float(np.diff(strains).max())
        axes.append(np.linspace(max(strains[0], middle - step), min(strains[-1], middle + step), FINER))
    weft, warp = axes
    states = states_at(model, [np.diag([1.0 + x, 1.0 + y]) for y in warp for x in weft])
    tensions = [(np.nan, np.nan) if isinstance(state, Diverged) else measure.mesh_tension(state) for state in states]
    return strains_on_grid(weft.tolist(), warp.tolist(), np.array(tensions).T.reshape(2, FINER, FINER), tension)


def largest_common_tension(rows: Sequence[MapRow]) -> float:
    """The largest tension [N/m] that some strains of the map carry in both directions at least."""
    carried = [
        min(row.cell.tension_weft_N_per_m, row.cell.tension_warp_N_per_m)
        for row in rows
        if row.cell.tension_weft_N_per_m is not None and row.cell.tension_warp_N_per_m is not None
    ]
    return max(carried, default=0.0)
