"""ANSYS Mechanical APDL: MP constants with SHELL181 as a membrane.

SHELL181 takes true stress and logarithmic strain, and updates its thickness. The Poisson's ratios through the thickness are those
of a constant volume, PRXZ = 1 - PRXY and PRYZ = 1 - PRXY EY/EX, so that the thickness follows the area. EZ keeps the material
stable.
"""

from __future__ import annotations

from .fe_card import FeCard, heading, number
from .tangent import LOGARITHMIC, THICKNESS, density, orthotropic


def text(fe: FeCard) -> str:
    """Commands that define material, section and element type 1. Raises `NoConstants`."""
    o, (s1, s2) = orthotropic(fe.card, LOGARITHMIC), fe.prestress
    (ex, ey), (nu12, nu21), shear = o.modulus, o.poissons_ratio, o.shear_modulus
    constants = {
        "DENS": density(fe.card.areal_mass),
        "EX": ex,
        "EY": ey,
        "EZ": 0.5 / ((1.0 - nu12) / ex + (1.0 - nu21) / ey),
        "PRXY": nu12,
        "PRXZ": 1.0 - nu12,
        "PRYZ": 1.0 - nu21,
        "GXY": shear,
        "GXZ": shear,
        "GYZ": shear,
        "REFT": fe.card.temperature,
        "ALPX": o.expansion[0],
        "ALPY": o.expansion[1],
        "ALPZ": 0.0,
    }
    notes = [
        f"Material 1, for SHELL181 as a membrane with NLGEOM,ON: {LOGARITHMIC.text}.",
        "EZ, PRXZ and PRYZ only rule the thickness; GXZ and GYZ are not used. Coupling of shear and extension is not carried.",
        "The x axis of the element coordinate system is weft. Prestress, for the elements selected, before SOLVE:",
    ]
    use = ["! INISTATE,SET,DTYP,STRE", f"! INISTATE,DEFINE,,,,,{number(s1)},{number(s2)},0,0,0,0"]
    lines = [f"MP,{name},1,{number(value)}" for name, value in constants.items()]
    lines += ["ET,1,SHELL181", "KEYOPT,1,1,1", "SECTYPE,1,SHELL", f"SECDATA,{1e3 * THICKNESS:g},1"]
    return "\n".join([*heading(fe, "ANSYS Mechanical APDL", "!", notes), *use, *lines, ""])
