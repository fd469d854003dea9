"""CalculiX: *ELASTIC, TYPE=ENGINEERING CONSTANTS for its M3D elements, which are solids in plane stress."""

from __future__ import annotations

from .fe_card import LINEAR, FeCard, heading, initial_temperature, number
from .tangent import GREEN, THICKNESS, density, orthotropic


def text(fe: FeCard) -> str:
    """A material to include in a model. Raises `NoConstants`."""
    o, (s1, s2) = orthotropic(fe.card, GREEN), fe.prestress
    (e1, e2), shear = o.modulus, o.shear_modulus
    constants = [e1, e2, e1, o.poissons_ratio[0], 0.0, 0.0, shear, shear]
    notes = [
        f"{LINEAR}, for M3D elements with NLGEOM: {GREEN.text}.",
        f"E3, nu13, nu23, G13 and G23 of {LINEAR} keep the thickness out of it. Coupling of shear and extension is not carried.",
        "To be used with, for elements and an orientation of the model (stress: a line for each element and integration point):",
    ]
    use = [
        f"** *MEMBRANE SECTION, ELSET=..., MATERIAL={LINEAR}, ORIENTATION=...",
        f"** {1e3 * THICKNESS:g}",
        "** *INITIAL CONDITIONS, TYPE=STRESS",
        f"** ..., {number(s1)}, {number(s2)}, 0., 0., 0., 0.",
        *initial_temperature(fe),
    ]
    lines = [
        f"*MATERIAL, NAME={LINEAR}",
        "*DENSITY",
        number(density(fe.card.areal_mass)),
        "*ELASTIC, TYPE=ENGINEERING CONSTANTS",
        ", ".join(map(number, constants)) + ",",
        number(shear),
        f"*EXPANSION, TYPE=ORTHO, ZERO={number(fe.card.temperature)}",
        ", ".join(map(number, [*o.expansion, 0.0])),
    ]
    return "\n".join([*heading(fe, "CalculiX", "**", notes), *use, *lines, ""])
