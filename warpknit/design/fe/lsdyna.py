"""LS-DYNA: *MAT_FABRIC (034), linear (FORM 0) and with curves (FORM 14), in fields of 10 columns."""

from __future__ import annotations

import numpy as np

from .fe_card import FABRIC, LINEAR, FeCard, fabric_note, heading, number
from .tangent import THICKNESS, TRUE, density, megapascal, orthotropic, tangent
from .yarn_curves import YarnCurve

WIDTH = 10


def text(fe: FeCard) -> str:
    """Keywords to include in a model. Raises `NoConstants`."""
    card, o = fe.card, orthotropic(fe.card, TRUE)
    built = np.exp(-np.linalg.solve(tangent(card, TRUE)[:2, :2], [card.tension_weft, card.tension_warp]))
    notes = [
        f"{LINEAR} (1), FORM 0 with ISTUPD = 0: {TRUE.text}.",
        f"{LINEAR} is exact for equal tensions. Else C12 of the true stress differs between weft and warp by the difference of"
        " the tensions, and the mean is written. Coupling of shear and extension is not carried.",
        f"Prestress of {LINEAR} by a preload: build the elements with their size times {number(built[0])} along a and"
        f" {number(built[1])} along b, with RO = {number(density(card.areal_mass) / built.prod())}, and stretch them to size."
        " *INITIAL_STRESS_SHELL may have no effect on *MAT_FABRIC: check it before you use it instead.",
        f"Expansion of {LINEAR} by *MAT_ADD_THERMAL_EXPANSION: {number(o.expansion[0])} and {number(o.expansion[1])} 1/K along a"
        f" and b, from {number(card.temperature)} K.",
        fabric_note(fe, "(2), FORM 14, second Piola-Kirchhoff stress over Green-Lagrange strain", "*AIRBAG_REFERENCE_GEOMETRY"),
        "The a axis of the materials is the global x (AOPT = 2).",
    ]
    lines = ["*KEYWORD", "*SECTION_SHELL", _row(1, 5), _row(*4 * [1e3 * THICKNESS])]
    nu12, nu21 = o.poissons_ratio
    lines += _material(1, LINEAR, density(card.areal_mass), o.modulus, (nu21, nu12), o.shear_modulus, form=0)
    if fe.curves:
        slopes = megapascal(fe.curves[0].slope), megapascal(fe.curves[1].slope)
        area = (1.0 + card.strain_weft) * (1.0 + card.strain_warp)
        shear = megapascal(card.stiffness[2, 2] / area)  # of the same measure, over the mesh as knitted
        lines += [*_material(2, FABRIC, density(fe.areal_mass_knitted), slopes, (0.0, 0.0), shear, form=14), _row(1, 2)]
        for identity, curve in enumerate(fe.curves, start=1):
            lines += _curve(identity, curve)
    return "\n".join([*heading(fe, "LS-DYNA", "$", notes), *lines, "*END", ""])


def _material(
    identity: int,
    title: str,
    rho: float,
    modulus: tuple[float, float],
    poissons_ratio: tuple[float, float],
    shear: float,
    form: int,
) -> list[str]:
    """*MAT_FABRIC without its curves; poissons_ratio: of a by stress along b, and of b by stress along a."""
    return [
        "*MAT_FABRIC_TITLE",
        title,
        _row(identity, rho, *modulus, None, *poissons_ratio),
        _row(shear, None, None, 0.0),
        _row(2.0, None, None, None, None, form),
        _row(None, None, None, 1.0, 0.0, 0.0),
        _row(0.0, 0.0, 0.0),
    ]


def _curve(identity: int, curve: YarnCurve) -> list[str]:
    """*DEFINE_CURVE of second Piola-Kirchhoff stress over Green-Lagrange strain."""
    strain, stress = 0.5 * (curve.stretch**2 - 1.0), megapascal(1.0) * curve.nominal / curve.stretch
    points = [f"{x:20.12E}{y:20.12E}" for x, y in zip(strain, stress, strict=True)]
    return ["*DEFINE_CURVE", _row(identity), *points]


def _row(*values: float | None) -> str:
    """A line of fields of ten columns."""
    return "".join(" " * WIDTH if value is None else f"{_field(value):>{WIDTH}}" for value in values).rstrip()


def _field(value: float) -> str:
    """`value` with all the digits that ten columns hold."""
    if isinstance(value, int):
        return str(value)
    texts = [f"{value:.{digits}E}".replace("E-0", "E-").replace("E+0", "E+") for digits in range(8, 0, -1)]
    return next(text for text in (str(value), *texts) if len(text) <= WIDTH)
