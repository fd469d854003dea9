"""What all cards for FE codes have in common: content, heading, numbers."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ...base.text import celsius
from ..card import MaterialCard
from .tangent import THICKNESS, megapascal
from .yarn_curves import YarnCurve

LINE = 72  # characters of a comment; Nastran and LS-DYNA read 80
LINEAR, FABRIC = "MESH", "FABRIC"  # names of the two materials of a file


@dataclass(frozen=True)
class FeCard:
    """The card with what a file for an FE code says of it."""

    mesh: str  # name
    state: str  # of the card, in words
    card: MaterialCard
    curves: tuple[YarnCurve, YarnCurve] | None  # weft, warp
    no_curves: str  # why there are none
    warnings: Sequence[str]
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
        f"The geometry is that of the mesh under its tension. Prestress: {number(s1)} MPa in weft, {number(s2)} MPa in warp.",
        "Check: an element under this prestress, stretched by a small strain e along weft with the warp held. The force per mm"
        f" of edge (its length before) grows by {number(along)} e N/mm along weft and {number(across)} e N/mm along warp.",
        f"Wire: {fe.made_of['wire']}. Knit: {fe.made_of['knit']}. Preset: {fe.made_of['preset']}.",
        *(f"Warning: {warning}." for warning in fe.warnings),
        *notes,  # the last one may announce lines that follow
    ]
    return [f"{mark} {line}" for text in paragraphs for line in textwrap.wrap(_ascii(text), LINE)]


def fabric_note(fe: FeCard, measure: str, reference: str) -> str:
    """Paragraph on the material with curves. reference: the input that places the nodes as knitted."""
    if fe.curves is None:
        return f"{FABRIC}: none, {fe.no_curves}."
    return (
        f"{FABRIC}: {measure} from the mesh as knitted, on one path, that of the card, up to the first jump to another"
        f" equilibrium. It takes no initial stress: give the nodes as knitted by {reference}. Weft and warp are independent in it"
        " and it has no expansion, so that its tangent is not that of the card."
    )


def initial_temperature(fe: FeCard) -> list[str]:
    """Comment lines of Abaqus and CalculiX, which count thermal strain from the initial temperature."""
    return ["** *INITIAL CONDITIONS, TYPE=TEMPERATURE", f"** ..., {number(fe.card.temperature)}"]


def _ascii(text: str) -> str:
    return text.encode("ascii", "replace").decode("ascii")
