"""Strains of equal tension in weft and warp, interpolated in the contact map."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from ..scene import Scene
from ..solve.simulate import Simulation
from ..sweep.contact_map import MapRow, grid
from ..sweep.states import mesh_of
from ..text import engineering

SERVICE_TENSIONS = (2.0, 3.4, 4.9)  # [N/m] of meshes in orbit (VSOP-2, ASP Conf. Ser. 402, 66)
REFINED = 16  # times finer than the map on each side, for the search of equal tensions
SIDES = ("weft", "warp")
INSIDE = 1e-6  # tolerance of a solution: of the tension, and of a cell of the map outside it
ROOM = 0.1  # of a cell of the map, allowed outside it during the search, which converges badly at a bound


def strains_at_tension(rows: Sequence[MapRow], tension: float) -> tuple[float, float] | None:
    """Weft and warp strain at which the bilinear map reaches `tension` [N/m] in both directions; None if it does not.

    Of several solutions, the one of least strain.
    """
    weft = sorted({row.strain_weft for row in rows})
    warp = sorted({row.strain_warp for row in rows})
    return strains_on_grid(weft, warp, np.stack([grid(rows, f"tension_{side}_N_per_m", weft, warp) for side in SIDES]), tension)


def strains_on_grid(weft: Sequence[float], warp: Sequence[float], both: np.ndarray, tension: float) -> tuple[float, float] | None:
    """Strains of equal tension, from tensions (direction, warp, weft) [N/m] on a grid; nan where unknown.

    A cell with three known corners is interpolated linearly.
    """
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
                continue  # on the side of the unknown corner
            found.append((weft[i] + x * (weft[i + 1] - weft[i]), warp[j] + y * (warp[j + 1] - warp[j])))
    return min(found, key=sum, default=None)


def strains_under_tension(
    scene: Scene, tension: float, watch: Callable[[float], None] = lambda _: None
) -> tuple[tuple[float, float], list[list[float]]]:
    """Weft and warp strain at which a run under `tension` [N/m] in both directions ends, and its tangent (2, 2) [N/m].

    In `output.frames` levels from the mesh as knitted; `watch` is called with the share of the load. Raises `Diverged`.
    """
    stage = replace(scene.stages[0], tension_weft=tension, tension_warp=tension, shear=0.0)
    simulation = Simulation(mesh_of(replace(scene, stages=(stage,), sweep=None)))
    for last in simulation.run():
        watch(last.load_factor)
    weft, warp = np.diag(last.observables.stretch) - 1.0
    return (float(weft), float(warp)), simulation.progress.search.stiffness


@dataclass(frozen=True)
class EqualTension:
    """The largest equal tensions in weft and warp [N/m] within a map; 0 where there is none."""

    largest: float
    elastic: float  # with all wires below their elastic limit
    limit: float  # [Pa]

    def text(self) -> str:
        """Sentence for the report."""
        if self.largest == 0.0:
            return "The map has no strains with equal tension in both directions; try other strains in [sweep]."
        up_to = f"Within the map, the largest equal tension is {engineering(self.largest, 'N/m')}"
        if self.elastic == self.largest:
            return f"{up_to}; larger ones need larger strains in [sweep]."
        beyond = f", and {engineering(self.elastic, 'N/m')} with" if self.elastic > 0.0 else ", but none with"
        return f"{up_to}{beyond} the wire below its elastic limit of {engineering(self.limit, 'Pa')}."


def equal_tension(rows: Sequence[MapRow], limit: float) -> EqualTension:
    """The largest equal tensions of the bilinear map. limit [Pa]: elastic limit of the wire."""
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
    """Bilinear interpolation of a grid on REFINED times as many points a side."""
    for axis in range(2):
        count = values.shape[axis]
        if count < 2:
            continue
        place = np.linspace(0.0, count - 1.0, REFINED * (count - 1) + 1)
        low = np.minimum(place.astype(int), count - 2)
        share = (place - low).reshape((-1, 1) if axis == 0 else (1, -1))
        values = (1.0 - share) * np.take(values, low, axis) + share * np.take(values, low + 1, axis)
    return values
