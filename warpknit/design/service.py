"""The strains at which a mesh carries the same tension in weft and warp, read from its contact map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from .. import measure
from ..errors import Diverged
from ..sweep.contact_map import MapRow, grid
from ..sweep.states import Mesh
from ..text import engineering
from .fine_states import states_at

SERVICE_TENSIONS = (2.0, 3.4, 4.9)  # [N/m] of meshes in orbit (VSOP-2, ASP Conf. Ser. 402, 66)
REFINED = 16  # times the strains of a map a side, where equal tensions are looked for
FINER = 9  # strains a side at which a map is looked at more closely
SIDES = ("weft", "warp")
INSIDE = 1e-6  # of a tension: how well the bilinear map must meet it; of a step of the map: how far outside one a place may be
ROOM = 0.1  # of a step around it, where it is looked for: next to a bound the search hardly converges


def strains_at_tension(rows: Sequence[MapRow], tension: float) -> tuple[float, float] | None:
    """Weft and warp strain at which the map, bilinear between its points, carries `tension` [N/m] both ways; None where it
    nowhere does. Of several the one of least strain."""
    weft = sorted({row.strain_weft for row in rows})
    warp = sorted({row.strain_warp for row in rows})
    return strains_on_grid(weft, warp, np.stack([grid(rows, f"tension_{side}_N_per_m", weft, warp) for side in SIDES]), tension)


def strains_on_grid(weft: Sequence[float], warp: Sequence[float], both: np.ndarray, tension: float) -> tuple[float, float] | None:
    """The same of tensions (direction, warp, weft) [N/m] on a grid of strains, nan where they are unknown; between three known
    corners they are linear."""
    found = []
    for j, i in np.ndindex(len(warp) - 1, len(weft) - 1):
        corners = both[:, j : j + 2, i : i + 2] / tension - 1.0  # (direction, warp, weft)
        unknown = np.argwhere(np.isnan(corners).any(axis=0))
        if len(unknown) == 1:
            b, a = unknown[0]
            corners[:, b, a] = corners[:, b, 1 - a] + corners[:, 1 - b, a] - corners[:, 1 - b, 1 - a]
        if not np.all((corners.min(axis=(1, 2)) <= 0.0) & (corners.max(axis=(1, 2)) >= 0.0)):
            continue  # also where more corners are unknown

        def missed(place: np.ndarray, corners: np.ndarray = corners) -> np.ndarray:
            x, y = place
            return np.einsum("dji,j,i->d", corners, [1.0 - y, y], [1.0 - x, x])

        met = least_squares(missed, [0.5, 0.5], bounds=([-ROOM, -ROOM], [1.0 + ROOM, 1.0 + ROOM]))
        x, y = met.x
        if np.abs(met.fun).max() < INSIDE and np.all(np.abs(met.x - 0.5) < 0.5 + INSIDE):
            if len(unknown) == 1 and abs(x - a) + abs(y - b) < 1.0:
                continue  # nearer to the unknown corner than the line between its neighbours
            found.append((weft[i] + x * (weft[i + 1] - weft[i]), warp[j] + y * (warp[j + 1] - warp[j])))
    return min(found, key=sum, default=None)


def strains_seen_closely(
    model: Mesh, rows: Sequence[MapRow], tension: float, about: tuple[float, float]
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


@dataclass(frozen=True)
class EqualTension:
    """The largest tensions [N/m] that some strains of a map carry in weft and warp alike; 0 where none does."""

    largest: float
    elastic: float  # with no wire beyond its elastic limit
    limit: float  # [Pa]

    def text(self) -> str:
        """What a designer is told."""
        if self.largest == 0.0:
            return "No strains of the map carry the same tension both ways: other strains in [sweep] may."
        up_to = f"Within the strains of the map, equal tensions go up to {engineering(self.largest, 'N/m')}"
        if self.elastic == self.largest:
            return f"{up_to}; more takes larger strains in [sweep]."
        beyond = f", and up to {engineering(self.elastic, 'N/m')} with" if self.elastic > 0.0 else ", none of them with"
        return f"{up_to}{beyond} the wire below its elastic limit of {engineering(self.limit, 'Pa')}."


def equal_tension(rows: Sequence[MapRow], limit: float) -> EqualTension:
    """Read from the map, bilinear between its points. limit: elastic limit of the wire [Pa]."""
    weft, warp = (sorted({row.strains[side] for row in rows}) for side in (0, 1))
    names = [*(f"tension_{side}_N_per_m" for side in SIDES), "stress_max_Pa"]
    first, second, stress = (_refined(grid(rows, name, weft, warp)) for name in names)
    apart = first - second
    largest = elastic = 0.0
    for axis in range(2):
        before, after = (np.take(apart, range(k, apart.shape[axis] - 1 + k), axis) for k in (0, 1))
        crossing = before * after <= 0.0  # not where it is unknown
        with np.errstate(invalid="ignore", divide="ignore"):
            share = np.where(before == after, 0.0, before / (before - after))
        tension, there = (
            (1.0 - share) * np.take(values, range(values.shape[axis] - 1), axis)
            + share * np.take(values, range(1, values.shape[axis]), axis)
            for values in (first, stress)
        )
        largest = max(largest, float(np.max(tension[crossing], initial=0.0)))
        elastic = max(elastic, float(np.max(tension[crossing & (there <= limit)], initial=0.0)))
    return EqualTension(largest, elastic, limit)


def _refined(values: np.ndarray) -> np.ndarray:
    """Values on a grid, and bilinear between them on REFINED times as many points."""
    for axis in range(2):
        count = values.shape[axis]
        if count < 2:
            continue
        place = np.linspace(0.0, count - 1.0, REFINED * (count - 1) + 1)
        low = np.minimum(place.astype(int), count - 2)
        share = (place - low).reshape((-1, 1) if axis == 0 else (1, -1))
        values = (1.0 - share) * np.take(values, low, axis) + share * np.take(values, low + 1, axis)
    return values
