"""The mesh at equal tensions in weft and warp: service points, computed, and what the contact map interpolates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from .. import measure
from ..errors import Diverged
from ..measure import Observables
from ..runner.answers import SERVICE_TENSIONS
from ..scene import Scene
from ..solve.simulate import Simulation
from ..sweep.contact_map import MapRow, axes_of, grid
from ..sweep.states import mesh_of
from ..text import engineering, exact, percent
from .card import MaterialCard

REFINED = 16  # times finer than the map on each side, for the search of equal tensions
SIDES = ("weft", "warp")
INSIDE = 1e-6  # tolerance of a solution: of the tension, and of a cell of the map outside it
ROOM = 0.1  # of a cell of the map, allowed outside it during the search, which converges badly at a bound


def strains_at_tension(rows: Sequence[MapRow], tension: float) -> tuple[float, float] | None:
    """Load of the map (strains, or tensions) at which the bilinear map reaches `tension` [N/m] in both directions, or None.

    Of several solutions, the one of least strain.
    """
    weft, warp = axes_of(rows)
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


@dataclass(frozen=True)
class ServicePoint:
    """The mesh at a tension in both directions: the one source for card, table and marker."""

    tension: float  # [N/m]
    strains: tuple[float, float] | None = None  # weft and warp; None where no state is known
    active_percent: float = 0.0
    stress_max: float = 0.0  # [Pa]
    why: str = "not reached in the map"  # there is no state

    @property
    def name(self) -> str:
        """The tension, as text."""
        return exact(self.tension, "N/m")

    @property
    def strain(self) -> str:
        """Strain in weft and warp, as text; or why there is none."""
        return self.why if self.strains is None else " / ".join(percent(strain) for strain in self.strains)

    @property
    def active(self) -> str:
        """Share of active contacts, as text."""
        return "-" if self.strains is None else percent(0.01 * self.active_percent)

    @property
    def stress(self) -> str:
        """Largest wire stress, as text."""
        return "-" if self.strains is None else engineering(self.stress_max, "Pa")


def point_of_card(card: MaterialCard, tension: float) -> ServicePoint:
    """The service point of a card that was made for `tension` [N/m] in both directions."""
    return ServicePoint(tension, (card.strain_weft, card.strain_warp), card.active_percent, card.stress_max)


def service_points(
    scene: Scene,
    rows: Sequence[MapRow],
    requested: float | None,
    card: MaterialCard | None,
    watch: Callable[[float], None] = lambda _: None,
) -> list[ServicePoint]:
    """The SERVICE_TENSIONS, that of the scene, and the `requested` one [N/m], whose `card` is its point.

    The others are equilibria of runs under their tension, made where the map reaches it: interpolated between its cells, strains
    and contacts would differ from theirs. `watch` is called with the share that is done.
    """
    points = []
    tensions = sorted({*SERVICE_TENSIONS, *(one for one in (scene.output.service_tension, requested) if one is not None)})
    for number, tension in enumerate(tensions):
        if tension == requested:
            points.append(
                ServicePoint(tension, why="no equilibrium found: no card") if card is None else point_of_card(card, tension)
            )
        elif strains_at_tension(rows, tension) is None:
            points.append(ServicePoint(tension))
        else:
            points.append(_point(scene, tension))
        watch((number + 1) / len(tensions))
    return points


def _point(scene: Scene, tension: float) -> ServicePoint:
    try:
        r, _ = _run_under_tension(scene, tension)
    except Diverged:
        return ServicePoint(tension, why="did not converge")
    weft, warp = _strains(r)
    return ServicePoint(tension, (weft, warp), measure.contacts(r).active_percent, measure.stress_extremes(r)[0])


def strains_under_tension(
    scene: Scene, tension: float, watch: Callable[[float], None] = lambda _: None
) -> tuple[tuple[float, float], list[list[float]]]:
    """Weft and warp strain at which a run under `tension` [N/m] in both directions ends, and its tangent (2, 2) [N/m].

    Raises `Diverged`.
    """
    r, tangent = _run_under_tension(scene, tension, watch)
    return _strains(r), tangent


def _strains(r: Observables) -> tuple[float, float]:
    weft, warp = np.diag(r.stretch) - 1.0
    return float(weft), float(warp)


def _run_under_tension(
    scene: Scene, tension: float, watch: Callable[[float], None] = lambda _: None
) -> tuple[Observables, list[list[float]]]:
    """The mesh at the end of a run under `tension` [N/m] in both directions, and its tangent (2, 2) [N/m].

    In `output.frames` levels from the mesh as knitted; `watch` is called with the share of the load. Raises `Diverged`.
    """
    stage = replace(scene.stages[0], strain_weft=None, strain_warp=None, tension_weft=tension, tension_warp=tension, shear=0.0)
    simulation = Simulation(mesh_of(replace(scene, stages=(stage,), sweep=None)))
    for last in simulation.run():
        watch(last.load_factor)
    return last.observables, simulation.progress.search.stiffness


@dataclass(frozen=True)
class EqualTension:
    """The largest equal tensions in weft and warp [N/m] within a map; 0 where there is none."""

    largest: float
    elastic: float  # with all wires below their elastic limit
    limit: float  # [Pa]

    def text(self) -> str:
        """Sentence for the report."""
        if self.largest == 0.0:
            return "The map has no strains with equal tension in both directions; try other loads in [sweep]."
        up_to = f"Within the map, the largest equal tension is {engineering(self.largest, 'N/m')}"
        if self.elastic == self.largest:
            return f"{up_to}; larger ones need a wider [sweep]."
        beyond = f", and {engineering(self.elastic, 'N/m')} with" if self.elastic > 0.0 else ", but none with"
        return f"{up_to}{beyond} the wire below its elastic limit of {engineering(self.limit, 'Pa')}."


def equal_tension(rows: Sequence[MapRow], limit: float) -> EqualTension:
    """The largest equal tensions of the bilinear map. limit [Pa]: elastic limit of the wire."""
    weft, warp = axes_of(rows)
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
