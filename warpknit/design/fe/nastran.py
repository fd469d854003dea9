"""Nastran: MAT2 and MAT8 with a PSHELL without bending, in fields of 16 columns.

Whether the differential stiffness of a solver has the stretches of an element or only its turns decides which tangent returns
that of the card, so there is a pair of each.
"""

from __future__ import annotations

import numpy as np

from .fe_card import FeCard, heading
from .tangent import ENGINEERING, GREEN, THICKNESS, NoConstants, density, expansion, megapascal, orthotropic, tangent

MAT2 = {1: GREEN, 2: ENGINEERING}  # measure of each material and property
MAT8 = {11: GREEN, 12: ENGINEERING}
STATEMENT = {
    GREEN: "for a differential stiffness with all gradients of the displacement",
    ENGINEERING: "for a differential stiffness with rotations only, and for large rotations with small strains (SOL 106)",
}


def text(fe: FeCard) -> str:
    """Bulk data entries; a card with a MAT8 that does not exist says so."""
    card, notes, lines = fe.card, [], []
    rho, temperature = density(card.areal_mass), card.temperature
    for number, measure in MAT2.items():
        notes.append(f"MAT2 {number}, {STATEMENT[measure]}: {measure.text}.")
        c = megapascal(1.0) * tangent(card, measure)
        alpha = expansion(card, measure)
        lines += _entry("MAT2", number, *c[0], *c[1, 1:], c[2, 2], rho, *alpha, temperature)
        lines += _shell(number)
    for number, measure in MAT8.items():
        try:
            o = orthotropic(card, measure)
        except NoConstants as error:
            notes.append(f"MAT8 {number}: none, {error}.")
            continue
        nu12, shear = o.poissons_ratio[0], o.shear_modulus
        notes.append(f"MAT8 {number}: as MAT2 {number - 10}, without coupling of shear and extension.")
        lines += _entry("MAT8", number, *o.modulus, nu12, shear, None, None, rho, *o.expansion, temperature)
        lines += _shell(number)
    notes.append(
        "Apply the prestress by a preload (edge forces or SPCD): there is no entry for it. Include this file in the bulk data."
    )
    return "\n".join([*heading(fe, "Nastran", "$", notes), *lines, ""])


def _entry(name: str, number: int, *values: float | np.floating | None) -> list[str]:
    """An entry of four fields of 16 columns a line."""
    fields = [f"{number:16d}", *(" " * 16 if value is None else f"{value:16.9E}" for value in values)]
    rows = ["".join(fields[i : i + 4]).rstrip() for i in range(0, len(fields), 4)]
    return [f"{name + '*':8}{rows[0]}", *(f"{'*':8}{row}" for row in rows[1:])]


def _shell(number: int) -> list[str]:
    """A property without bending (MID2 blank)."""
    return [f"{'PSHELL':8}{number:8d}{number:8d}{1e3 * THICKNESS:8.4f}"]
