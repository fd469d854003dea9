"""The mesh at equal tensions in weft and warp: service points, and the largest equal tension of a contact map."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..base.text import engineering, exact, of_sides, percent
from ..results.row import Row
from ..studies.contact_map import STEADY, MapRow, axes_of, grid
from .card import MaterialCard

REFINED = 16  # times finer than the map on each side, for the search of equal tensions
SIDES = ("weft", "warp")


@dataclass(frozen=True)
class ServicePoint:
    """The mesh at a tension in both directions: the one source for card, table and marker."""

    tension: float  # [N/m]
    strains: tuple[float, float] | None = None  # weft and warp; None where no state is known
    active_percent: float = 0.0
    stress_max: float = 0.0  # [Pa]
    why: str = ""  # there is no state, or what limits it
    stage: str = ""  # of the state
    resolved: bool = True  # whether the path under equal tensions has the same state
    ranges: Row = field(default_factory=Row)  # of eight in ten meshes: p10_NAME and p90_NAME of the figures; of one mesh none

    @property
    def name(self) -> str:
        """The tension, as text."""
        return exact(self.tension, "N/m")

    @property
    def strain(self) -> str:
        """Strain in weft and warp, as text; or why there is none."""
        return self.why if self.strains is None else " / ".join(percent(strain) for strain in self.strains)

    @property
    def range_texts(self) -> tuple[str, str, str] | None:
        """Ranges of eight in ten meshes of strain, active contacts and stress, as texts; None of one mesh."""
        if "p10_stress_max_Pa" not in self.ranges:
            return None

        def of(name: str, shown: Callable[[float], str]) -> str:
            return " to ".join(shown(self.ranges[f"{end}_{name}"]) for end in ("p10", "p90"))

        strains = " / ".join(of(f"strain_{side}", percent) for side in SIDES)
        return strains, of("active_percent", lambda share: percent(0.01 * share)), of("stress_max_Pa", _stress_text)

    @property
    def active(self) -> str:
        """Share of active contacts, as text."""
        return "-" if self.strains is None else percent(0.01 * self.active_percent)

    @property
    def stress(self) -> str:
        """Largest wire stress, as text."""
        return "-" if self.strains is None else engineering(self.stress_max, "Pa") + (f", {self.why}" if self.why else "")


def _stress_text(stress: float) -> str:
    return engineering(stress, "Pa")


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
    """Bilinear interpolation of a grid on REFINED times the points a side."""
    for axis in range(2):
        count = values.shape[axis]
        if count < 2:
            continue
        place = np.linspace(0.0, count - 1.0, REFINED * (count - 1) + 1)
        low = np.minimum(place.astype(int), count - 2)
        share = (place - low).reshape((-1, 1) if axis == 0 else (1, -1))
        values = (1.0 - share) * np.take(values, low, axis) + share * np.take(values, low + 1, axis)
    return values


SAME_STRESS, SAME_STRAIN = 0.05, 0.003  # largest differences of one equilibrium found twice: relative, and strain


def is_other(one: Row | MapRow, other: Row | MapRow) -> bool:
    """Whether two states under one load are different equilibria."""
    stress = one.stress_max_Pa / max(other.stress_max_Pa, 1e-300)
    strain = max(abs(one.strain_weft - other.strain_weft), abs(one.strain_warp - other.strain_warp))
    return bool(abs(stress - 1.0) > SAME_STRESS or strain > SAME_STRAIN)


def two_equilibria(load: str, one: Row | MapRow, of_one: str, other: Row | MapRow, of_other: str) -> str:
    """Sentence on two equilibria under one `load`, with their places on the page; or nothing."""
    if not is_other(one, other):
        return ""

    def text(row: Row | MapRow, where: str) -> str:
        strains = of_sides((percent(row.strain_weft), percent(row.strain_warp)))
        return f"strain {strains}, {percent(0.01 * row.active_percent)} active, {engineering(row.stress_max_Pa, 'Pa')} {where}"

    return f"The mesh has two equilibria at {load}: {text(one, of_one)}; {text(other, of_other)}."


def map_cell(cells: Sequence[MapRow], tension: float | None) -> MapRow | None:
    """Converged state of a map at one `tension` [N/m]; None for means of several meshes."""
    found = (one for one in cells if one.by_tension and one.load == (tension, tension))
    return next((one for one in found if one.stop_reason == STEADY and one.variants == 1), None)


def branches_at(tension: float, row: Row | None, cells: Sequence[MapRow], card: MaterialCard | None = None) -> str:
    """Sentence on two equilibria of the page at one `tension` [N/m]; empty where it shows one. row: under equal tensions."""
    load, cell = exact(tension, "N/m"), map_cell(cells, tension)
    shown = row if card is None else card.row
    where = "under equal tensions" if card is None else "on the card" if row is None else "on the card and under equal tensions"
    if card is not None and row is not None and is_other(card.row, row):
        return two_equilibria(load, card.row, "on the card", row, "under equal tensions")
    return "" if shown is None or cell is None else two_equilibria(load, shown, where, cell, "in the map")
