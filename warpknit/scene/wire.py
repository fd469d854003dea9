"""The wire: section, material, plating, and the stiffness and mass that follow."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated

from . import values
from .keys import Table, key
from .materials import MATERIALS
from .values import Integer, Quantity

ROOM_TEMPERATURE = 293.15  # [K]


@dataclass(frozen=True, kw_only=True)
class Plating(Table):
    """[wire] plating: a coating of another metal on each wire, outside its diameter."""

    material: values.MaterialName = key(
        'Metal of the coating. Write `plating = {material = "gold", thickness = "0.2 um"}`.', "gold"
    )
    thickness: values.Coating = key("Thickness of the coating, which adds stiffness, mass and diameter.")


@dataclass(frozen=True, kw_only=True)
class Wire(Table):
    """[wire]: the yarn of `ends` parallel round wires. Stiffness and mass include all ends and the plating."""

    material: values.MaterialName = key(
        "Default of Young's modulus, Poisson's ratio, density, expansion, yield stress and strength.", "tungsten"
    )
    youngs_modulus: Annotated[float, Quantity("stress", above=0.0)] = key("Young's modulus.", None, left_out="the material's")
    poissons_ratio: Annotated[float, Quantity("number", above=-1.0, most=0.5)] = key(
        "Poisson's ratio; sets the twist stiffness in the spatial model, not used in the planar model.",
        None,
        left_out="the material's",
    )
    density: values.Density = key('Density, for `drive = "ramp"` and the areal mass.', None, left_out="the material's")
    expansion: values.Expansion = key(
        "Thermal expansion coefficient; plating does not change it (0.2 um of gold on 15 um would add 2 %).",
        None,
        left_out="the material's",
    )
    yield_stress: values.Strength = key(
        "Elastic limit, for warnings and `yield_fraction`. Without `plastic` the wire stays elastic at any stress and takes no"
        " permanent set.",
        None,
        left_out="the material's",
    )
    tensile_strength: values.Strength = key("Tensile strength, for warnings.", None, left_out="the material's")
    hardness: Annotated[float, Quantity("stress", above=0.0, usual="0.7 GPa")] = key(
        "Hardness of the surface (the plating, if any). The contact resistance of a report is proportional to its square"
        " root. Soft plated gold has 0.2 to 0.9 GPa, hard plated gold 1.3 to 2 GPa.",
        None,
        left_out="the hardness of the surface metal",
    )
    diameter: Annotated[float, Quantity("length", above=0.0, most=0.01)] = key(
        "Diameter of one wire, without plating. Default with a file of wires that has widths: the diameter of the thickest wire"
        " (`wires.widths`).",
        15e-6,
    )
    ends: Annotated[int, Integer(1, 1000)] = key(
        "Number of parallel wires knitted as one yarn. Stiffness and mass add up; for contact the yarn is a round bundle of the"
        " same cross-section.",
        1,
    )
    plating: Plating | None = key("Coating of another metal.", None)
    plastic: values.Flag = key(
        'The wire yields in bending at `yield_stress`; `drive = "relax"` only. The state then depends on the load history.', False
    )
    hardening: values.Fraction = key("Tangent bending stiffness after yield, over the elastic stiffness.", 0.1)
    set_fraction: values.Fraction = key(
        "Natural (stress-free) curvature of the wire over its knitted curvature. It is not computed from yield. 1: the knitted"
        " shape is stress-free.",
        1.0,
    )
    reference_temperature: values.RoomTemperature = key(
        "Temperature of zero thermal strain, and default temperature of the mesh.", ROOM_TEMPERATURE
    )

    @property
    def radius(self) -> float:
        """Radius of one end without its plating [m]."""
        return self.diameter / 2

    def length_factor(self, temperature: float) -> float:
        """Length at a temperature [K] over that at the reference temperature."""
        return 1.0 + self.expansion * (temperature - self.reference_temperature)

    @property
    def thickness(self) -> float:
        """Thickness of the yarn at contacts [m]. Several wires side by side count as a round bundle of the same section."""
        plating = 0.0 if self.plating is None else self.plating.thickness
        return (self.diameter + 2 * plating) * math.sqrt(self.ends)

    def with_thickness(self, thickness: float) -> Wire:
        """The same with the diameter of a yarn of this thickness [m]; 0 or less where its plating alone is thicker."""
        plating = 0.0 if self.plating is None else self.plating.thickness
        return replace(self, diameter=thickness / math.sqrt(self.ends) - 2 * plating)

    @property
    def axial_stiffness(self) -> float:
        """EA of the yarn [N]."""
        return self._over_section("youngs_modulus", lambda r: math.pi * r**2)

    @property
    def bending_stiffness(self) -> float:
        """EI of the yarn [N m2]: its ends bend side by side, each about its own axis."""
        return self._over_section("youngs_modulus", lambda r: math.pi / 4 * r**4)

    @property
    def twist_stiffness(self) -> float:
        """GJ of the yarn [N m2]: its ends twist side by side, each about its own axis."""
        share = 1.0 / (1.0 + self.poissons_ratio)  # GJ of a round wire over its EI
        core = share * self.youngs_modulus * math.pi / 4 * self.radius**4
        if self.plating is None:
            return self.ends * core
        coat = MATERIALS[self.plating.material]
        annulus = math.pi / 4 * ((self.radius + self.plating.thickness) ** 4 - self.radius**4)
        return self.ends * (core + coat.youngs_modulus / (1.0 + coat.poissons_ratio) * annulus)

    @property
    def yield_curvature(self) -> float:
        """Change of curvature [1/m] at which the outermost fibres of the core yield."""
        return self.yield_stress / (self.youngs_modulus * self.radius)

    @property
    def linear_density(self) -> float:
        """Mass per length of the yarn [kg/m]."""
        return self._over_section("density", lambda r: math.pi * r**2)

    def _over_section(self, constant: str, disc: Callable[[float], float]) -> float:
        """Material constant times the integral `disc`(radius), over core, plating and ends."""
        total: float = getattr(self, constant) * disc(self.radius)
        if self.plating is not None:
            annulus = disc(self.radius + self.plating.thickness) - disc(self.radius)
            total += getattr(MATERIALS[self.plating.material], constant) * annulus
        return self.ends * total
