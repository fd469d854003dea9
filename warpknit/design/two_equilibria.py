"""States under one load that a report finds on different ways: whether they are one equilibrium, and both in words."""

from __future__ import annotations

from collections.abc import Sequence

from ..base.text import engineering, exact, percent
from ..runner.history import Row
from ..studies.contact_map import STEADY, MapRow
from .card import MaterialCard

SAME_STRESS, SAME_STRAIN = 0.05, 0.003  # largest differences of one equilibrium found twice: relative, and strain


def is_other(one: Row | MapRow, other: Row | MapRow) -> bool:
    """Whether two states under one load are different equilibria."""
    stress = one.stress_max_Pa / max(other.stress_max_Pa, 1e-300)
    strain = max(abs(one.strain_weft - other.strain_weft), abs(one.strain_warp - other.strain_warp))
    return bool(abs(stress - 1.0) > SAME_STRESS or strain > SAME_STRAIN)


def two_equilibria(load: str, one: Row | MapRow, of_one: str, other: Row | MapRow, of_other: str) -> str:
    """Sentence on two equilibria under one `load`, each with its strains, and the places of the page that show it; or nothing."""
    if not is_other(one, other):
        return ""

    def text(row: Row | MapRow, where: str) -> str:
        strains = f"{percent(row.strain_weft)} / {percent(row.strain_warp)}"
        return f"strain {strains}, {percent(0.01 * row.active_percent)} active, {engineering(row.stress_max_Pa, 'Pa')} {where}"

    return f"the mesh has two equilibria at {load}: {text(one, of_one)}; {text(other, of_other)}"


def map_cell(cells: Sequence[MapRow], tension: float | None) -> MapRow | None:
    """The converged state of a map at one `tension` [N/m] in weft and warp; None without one, or of several meshes."""
    found = (one for one in cells if one.by_tension and one.load == (tension, tension))
    return next((one for one in found if one.stop_reason == STEADY and one.seeds == 1), None)


def branches_at(tension: float, row: Row | None, cells: Sequence[MapRow], card: MaterialCard | None = None) -> str:
    """Sentence on two equilibria of the page at one `tension` [N/m]; empty where it shows one. row: under equal tensions."""
    load, cell = exact(tension, "N/m"), map_cell(cells, tension)
    shown = row if card is None else card.row
    where = "under equal tensions" if card is None else "on the card" if row is None else "on the card and under equal tensions"
    if card is not None and row is not None and is_other(card.row, row):
        return two_equilibria(load, card.row, "on the card", row, "under equal tensions")
    return "" if shown is None or cell is None else two_equilibria(load, shown, where, cell, "in the map")
