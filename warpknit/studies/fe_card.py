"""Common parts of cards for FE codes: content, heading, numbers.

In laws of woven fabrics the tension in each direction depends on the strain in this direction alone. The tensions of a mesh
depend on both strains. So the curves are valid on one path, from the mesh as knitted to the card. On this path they give both
tensions, at the card its prestress.

The tangent of a card belongs to the stress and strain of its FE code. C of the card relates the second Piola-Kirchhoff stress to
the Green-Lagrange strain. At the prestress s another pair of measures needs another tangent for the same forces. For the strain
(U^2m - 1)/2m and its conjugate stress,

    C_m = C + (1 - m) diag(2 s1, 2 s2, (s1 + s2)/2)        m = 1 Green-Lagrange, 1/2 engineering, 0 logarithmic.

m = 0 is also the rate form, true stress over rate of deformation, of a membrane that keeps its volume. If it keeps its thickness
instead, the true stress does not follow the area. The tangent is then the one for m = 0 less s (1 1 0), and the symmetric part

    C_true = C_0 - (s (1 1 0) + (1 1 0) s)/2

is written: an elastic law has no other. Heat changes the stress at constant strain by -C alpha in any measure,

    alpha_m = C_m^-1 C alpha.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..base.text import alike, celsius, percent
from ..results.finding import ResultWarning
from ..results.row import Row
from .card import MaterialCard

THICKNESS = 1e-3  # [m] nominal; only products with it have a meaning: E t, density t, stress t
MPA, TONNE_PER_MM3 = 1e6, 1e12  # [Pa], [kg/m3]


@dataclass(frozen=True)
class StressMeasure:
    """Stress and strain of the material law of an FE code."""

    exponent: float  # m of the strain
    keeps_thickness: bool
    text: str


GREEN = StressMeasure(1.0, False, "second Piola-Kirchhoff stress over Green-Lagrange strain")
ENGINEERING = StressMeasure(0.5, False, "engineering stress and strain that turn with the element")
LOGARITHMIC = StressMeasure(0.0, False, "true stress over logarithmic strain, in a membrane that keeps its volume")
TRUE = StressMeasure(0.0, True, "true stress over logarithmic strain, in a membrane that keeps its thickness")


class NoConstants(Exception):
    """The card has no such constants; the message says why."""


@dataclass(frozen=True)
class Orthotropic:
    """Engineering constants of a sheet of nominal thickness, without coupling of shear and extension."""

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


def tangent(card: MaterialCard, measure: StressMeasure) -> np.ndarray:
    """(3, 3) [N/m] tangent in `measure`, symmetric."""
    s1, s2 = card.tension_weft, card.tension_warp
    stiffness = card.stiffness + (1.0 - measure.exponent) * np.diag([2.0 * s1, 2.0 * s2, 0.5 * (s1 + s2)])
    if measure.keeps_thickness:
        by_area = np.outer([s1, s2, 0.0], [1.0, 1.0, 0.0])
        stiffness -= 0.5 * (by_area + by_area.T)
    return np.asarray(stiffness)


def expansion(card: MaterialCard, measure: StressMeasure) -> np.ndarray:
    """(3,) [1/K] thermal strain at constant stress in `measure`, shear as engineering strain."""
    return np.asarray(np.linalg.solve(tangent(card, measure), card.stiffness @ card.expansion))


def orthotropic(card: MaterialCard, measure: StressMeasure) -> Orthotropic:
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


APART = 0.02  # of a tension: nearer states repeat the card, less exactly
FIRST = 0.05  # of the strain of the card: points nearer to the mesh as knitted, of one that contracted before, are left out
MISFIT = 0.1  # of the tension of the card: largest difference of a curve from a state on the way to the card


@dataclass(frozen=True)
class YarnCurve:
    """Tension along one direction, rising; the first point is the mesh as knitted, without tension."""

    stretch: np.ndarray  # (point,) over the length as knitted
    nominal: np.ndarray  # (point,) [N/m] force over the width as knitted

    @property
    def slope(self) -> float:
        """[N/m] largest of the curve."""
        return float((np.diff(self.nominal) / np.diff(self.stretch)).max())


def yarn_curves(card: MaterialCard, path: Sequence[Row]) -> tuple[YarnCurve, YarnCurve]:
    """Curves along weft and warp. path: states on the way to the card, and beyond, up to the first snap-through.

    Raises `NoConstants` where a direction is not stretched or carries no tension, where the mesh resists no shear or snaps
    through before the card, and where a tension does not rise with the strain along it.
    """
    if min(card.strain_weft, card.strain_warp, card.tension_weft, card.tension_warp) <= 0.0:
        strains, tensions = (card.strain_weft, card.strain_warp), (card.tension_weft, card.tension_warp)
        sides = zip(("weft", "warp"), map(percent, strains), alike(tensions, "N/m"), strict=True)
        values = "; ".join(f"{side} strain {one}, tension {other}" for side, one, other in sides)
        raise NoConstants(f"a direction of the mesh is not stretched or carries no tension ({values})")
    if card.stiffness[2, 2] <= 0.0:
        raise NoConstants("its shear stiffness is not positive")
    if card.jumps:
        raise NoConstants("the mesh snaps through to another equilibrium on the way to the card")
    kept = (card.strain_weft, card.strain_warp, card.tension_weft, card.tension_warp)
    rows = [kept]
    for row in path:
        tension = (row.tension_weft_N_per_m, row.tension_warp_N_per_m)
        if max(abs(one / other - 1.0) for one, other in zip(tension, kept[2:], strict=True)) > APART:
            rows.append((row.strain_weft, row.strain_warp, *tension))
    strain_weft, strain_warp, weft, warp = np.array(rows).T
    along_weft, along_warp = 1.0 + strain_weft, 1.0 + strain_warp
    return _rising("weft", along_weft, weft * along_warp), _rising("warp", along_warp, warp * along_weft)


def _rising(side: str, stretch: np.ndarray, nominal: np.ndarray) -> YarnCurve:
    """Rising curve by stretch, from the mesh as knitted through the first point.

    Raises `NoConstants` where points with less tension than the first point are far off the curve.
    """
    points = [(stretch[0], nominal[0])]
    order, least = np.argsort(stretch), 1.0 + FIRST * (stretch[0] - 1.0)
    for i in order[::-1]:
        if least < stretch[i] < points[0][0] and 0.0 < nominal[i] < points[0][1]:
            points.insert(0, (stretch[i], nominal[i]))
    for i in order:
        if stretch[i] > points[-1][0] and nominal[i] > points[-1][1]:
            points.append((stretch[i], nominal[i]))
    curve = YarnCurve(*np.array([(1.0, 0.0), *points]).T)
    before = nominal < nominal[0]
    off = np.abs(np.interp(stretch[before], curve.stretch, curve.nominal) - nominal[before])
    if off.max(initial=0.0) > MISFIT * nominal[0]:
        raise NoConstants(f"the tension in {side} does not rise with the strain in {side} on the way to the card")
    return curve


LINE = 72  # characters of a comment; Nastran and LS-DYNA read 80
LINEAR, FABRIC = "MESH", "FABRIC"  # names of the two materials of a file


@dataclass(frozen=True)
class FeCard:
    """The card, with notes for a file of an FE code."""

    mesh: str  # name
    state: str  # of the card, in words
    card: MaterialCard
    curves: tuple[YarnCurve, YarnCurve] | str  # weft, warp; or why there are none
    warnings: Sequence[ResultWarning]
    made_of: Mapping[str, str]  # wire, knit and preset, in words

    @property
    def prestress(self) -> tuple[float, float]:
        """[MPa] along weft and warp."""
        return megapascal(self.card.tension_weft), megapascal(self.card.tension_warp)

    @property
    def area_ratio(self) -> float:
        """Area of the tensioned mesh over that as knitted."""
        return (1.0 + self.card.strain_weft) * (1.0 + self.card.strain_warp)

    @property
    def areal_mass_knitted(self) -> float:
        """[kg/m2] of the mesh as knitted, to which the curves refer."""
        return self.card.areal_mass * self.area_ratio


def number(value: float) -> str:
    """A value for a file without columns."""
    return f"{value:.9g}"


def heading(fe: FeCard, code: str, mark: str, notes: Sequence[str]) -> list[str]:
    """Comment lines, each after `mark`: state, units, prestress, a check value, the warnings, and `notes`."""
    card, (s1, s2) = fe.card, fe.prestress
    along, across = 1e-3 * float(card.stiffness[0, 0] + card.tension_weft), 1e-3 * float(card.stiffness[0, 1])  # [N/mm]
    paragraphs = [
        f"Material card of {fe.mesh} for {code}, written by warpknit. State: {fe.state}, at {celsius(card.temperature)}.",
        "Units: mm, N, tonne, s, MPa, K. For m, N, kg, Pa: stresses and moduli x 1e6, densities x 1e12, thickness x 1e-3.",
        f"Membrane of nominal thickness {1e3 * THICKNESS:g} mm: 1 MPa is a tension of {1e3 * THICKNESS:g} N/mm."
        f" Mass {number(card.areal_mass)} kg/m2. Axis 1 is weft (x), 2 is warp (y).",
        f"The geometry is the mesh under its tension. Prestress: {number(s1)} MPa in weft, {number(s2)} MPa in warp.",
        "Check: an element under this prestress, stretched by a small strain e along weft with the warp held. The force per mm"
        f" of edge (its length before) grows by {number(along)} e N/mm along weft and {number(across)} e N/mm along warp.",
        f"Wire: {fe.made_of['wire']}. Knit: {fe.made_of['knit']}. Preset: {fe.made_of['preset']}.",
        *(f"Warning: {warning}." for warning in fe.warnings),
        *notes,  # the last one may announce lines that follow
    ]
    texts = (text.encode("ascii", "replace").decode("ascii") for text in paragraphs)
    return [f"{mark} {line}" for text in texts for line in textwrap.wrap(text, LINE)]


def fabric_note(fe: FeCard, measure: str, reference: str) -> str:
    """Paragraph on the material with curves. reference: the input that places the nodes as knitted."""
    if isinstance(fe.curves, str):
        return f"{FABRIC}: none, {fe.curves}."
    return (
        f"{FABRIC}: {measure} from the mesh as knitted, on the load path of the card, up to the first snap-through. It has no"
        f" initial stress: give the nodes as knitted by {reference}. Weft and warp are independent in it, and it has no"
        " expansion: its tangent differs from the card."
    )
