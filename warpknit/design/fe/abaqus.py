"""Abaqus: *ELASTIC, TYPE=LAMINA for membranes, and *FABRIC with curves for Abaqus/Explicit."""

from __future__ import annotations

from .fe_card import FABRIC, LINEAR, FeCard, fabric_note, heading, initial_temperature, number
from .tangent import LOGARITHMIC, THICKNESS, density, megapascal, orthotropic


def text(fe: FeCard) -> str:
    """Materials to include in a model. Raises `NoConstants`."""
    o, (s1, s2) = orthotropic(fe.card, LOGARITHMIC), fe.prestress
    notes = [
        f"{LINEAR}, for M3D elements with NLGEOM: {LOGARITHMIC.text}.",
        f"G13 and G23 of {LINEAR} are not used by a membrane. Coupling of shear and extension is not carried.",
        fabric_note(fe, "for Abaqus/Explicit, nominal stress over nominal strain", "*INITIAL CONDITIONS, TYPE=REF COORDINATE"),
        "To be used with, for elements and an orientation of the model:",
    ]
    use = [
        f"** *MEMBRANE SECTION, ELSET=..., MATERIAL={LINEAR}, ORIENTATION=..., POISSON=0.5",
        f"** {1e3 * THICKNESS:g}",
        "** *INITIAL CONDITIONS, TYPE=STRESS",
        f"** ..., {number(s1)}, {number(s2)}, 0.",
        *initial_temperature(fe),
    ]
    lines = [
        f"*MATERIAL, NAME={LINEAR}",
        "*DENSITY",
        number(density(fe.card.areal_mass)),
        "*ELASTIC, TYPE=LAMINA",
        ", ".join(map(number, [*o.modulus, o.poissons_ratio[0], *3 * [o.shear_modulus]])),
        "*EXPANSION, TYPE=ORTHO",
        ", ".join(map(number, [*o.expansion, 0.0])),
    ]
    if fe.curves:
        lines += [f"*MATERIAL, NAME={FABRIC}", "*DENSITY", number(density(fe.areal_mass_knitted)), "*FABRIC"]
        for component, curve in zip("12", fe.curves, strict=True):
            lines += [f"*UNIAXIAL, COMPONENT={component}", "*LOADING DATA, DIRECTION=TENSION, TYPE=ELASTIC, EXTRAPOLATION=LINEAR"]
            strain, stress = curve.stretch - 1.0, megapascal(1.0) * curve.nominal
            lines += [f"{number(y)}, {number(x)}" for x, y in zip(strain, stress, strict=True)]
        shear = megapascal(fe.card.stiffness[2, 2] * fe.area_ratio)  # conjugate to the shear angle, in the volume as knitted
        lines += [
            "*UNIAXIAL, COMPONENT=SHEAR",
            "*LOADING DATA, TYPE=ELASTIC, EXTRAPOLATION=LINEAR",
            "0., 0.",
            f"{number(shear)}, 1.",
        ]
    return "\n".join([*heading(fe, "Abaqus", "**", notes), *use, *lines, ""])
