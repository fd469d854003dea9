"""The tangent of the card in the stress and strain measure of an FE code.

C of the card relates the second Piola-Kirchhoff stress to the Green-Lagrange strain. At the prestress s a code with another
pair of measures needs another tangent to return the same forces. For the strain (U^2m - 1)/2m and its conjugate stress,

    C_m = C + (1 - m) diag(2 s1, 2 s2, (s1 + s2)/2)        m = 1 Green-Lagrange, 1/2 engineering, 0 logarithmic.

m = 0 is also the rate form, true stress over rate of deformation, of a membrane that keeps its volume. If it keeps its thickness
instead, the true stress does not follow the area, and the tangent is that of m = 0 less s (1 1 0), of which the symmetric part

    C_true = C_0 - (s (1 1 0) + (1 1 0) s)/2

is written: an elastic law has no other. Heat changes the stress at constant strain by -C alpha in any measure,

    alpha_m = C_m^-1 C alpha.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..card import MaterialCard

THICKNESS = 1e-3  # [m] nominal; only products with it have a meaning: E t, density t, stress t
MPA, TONNE_PER_MM3 = 1e6, 1e12  # [Pa], [kg/m3]


@dataclass(frozen=True)
class Measure:
    """Pair of stress and strain in which an FE code states its material law."""

    exponent: float  # m of the strain
    keeps_thickness: bool
    text: str


GREEN = Measure(1.0, False, "second Piola-Kirchhoff stress over Green-Lagrange strain")
ENGINEERING = Measure(0.5, False, "engineering stress and strain that turn with the element")
LOGARITHMIC = Measure(0.0, False, "true stress over logarithmic strain, in a membrane that keeps its volume")
TRUE = Measure(0.0, True, "true stress over logarithmic strain, in a membrane that keeps its thickness")


class NoConstants(Exception):
    """The card has no constants of the form that a code asks for; the message says why."""


@dataclass(frozen=True)
class Orthotropic:
    """Engineering constants of a sheet of the nominal thickness, without coupling of shear and extension."""

    modulus: tuple[float, float]  # [MPa] E1, E2
    poissons_ratio: tuple[float, float]  # nu12, nu21: contraction in 2 (1) over extension in 1 (2)
    shear_modulus: float  # [MPa]
    expansion: tuple[float, float]  # [1/K]


def megapascal(tension: float) -> float:
    """Stress [MPa] of a force per width [N/m] in the nominal thickness."""
    return tension / THICKNESS / MPA


def density(areal_mass: float) -> float:
    """Density [tonne/mm3] of a mass per area [kg/m2] in the nominal thickness."""
    return areal_mass / THICKNESS / TONNE_PER_MM3


def tangent(card: MaterialCard, measure: Measure) -> np.ndarray:
    """(3, 3) [N/m] tangent in `measure`, symmetric."""
    s1, s2 = card.tension_weft, card.tension_warp
    stiffness = card.stiffness + (1.0 - measure.exponent) * np.diag([2.0 * s1, 2.0 * s2, 0.5 * (s1 + s2)])
    if measure.keeps_thickness:
        by_area = np.outer([s1, s2, 0.0], [1.0, 1.0, 0.0])
        stiffness -= 0.5 * (by_area + by_area.T)
    return np.asarray(stiffness)


def expansion(card: MaterialCard, measure: Measure) -> np.ndarray:
    """(3,) [1/K] thermal strain at constant stress in `measure`, shear as engineering strain."""
    return np.asarray(np.linalg.solve(tangent(card, measure), card.stiffness @ card.expansion))


def orthotropic(card: MaterialCard, measure: Measure) -> Orthotropic:
    """Constants of the tangent in `measure`. Raises `NoConstants` where it is not positive definite."""
    c = tangent(card, measure)
    plane, shear = c[:2, :2], float(c[2, 2])
    if min(float(np.linalg.eigvalsh(plane).min()), shear) <= 0.0:
        raise NoConstants(f"its stiffness for {measure.text} is not positive definite")
    compliance = np.linalg.inv(plane)
    alpha = compliance @ (card.stiffness @ card.expansion)[:2]
    return Orthotropic(
        modulus=(megapascal(1.0 / compliance[0, 0]), megapascal(1.0 / compliance[1, 1])),
        poissons_ratio=(float(-compliance[0, 1] / compliance[0, 0]), float(-compliance[0, 1] / compliance[1, 1])),
        shear_modulus=megapascal(shear),
        expansion=(float(alpha[0]), float(alpha[1])),
    )
