"""The wire: its section, its material and its plating, and what follows from them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

from warpknit.scene.materials import MATERIALS


@dataclass(frozen=True, kw_only=True)
class Plating:
    """A coat of another metal around each wire, outside its diameter."""

    material: str
    thickness: Annotated[float, "m"]


@dataclass(frozen=True, kw_only=True)
class Wire:
    """The yarn: `ends` parallel round wires. Stiffness and mass are those of all ends together, plating included."""

    material: str
    youngs_modulus: Annotated[float, "Pa"]
    poissons_ratio: float
    density: Annotated[float, "kg/m^3"]
    expansion: Annotated[float, "1/K"]
    yield_stress: Annotated[float, "Pa"]
    tensile_strength: Annotated[float, "Pa"]
    hardness: Annotated[float, "Pa"]  # of the metal at the surface, that of the plating where there is one
    diameter: Annotated[float, "m"]  # of one end, without its plating
    ends: int
    plating: Plating | None
    plastic: bool  # whether it yields in bending
    hardening: float  # bending stiffness of a wire that yields, over the elastic one
    set_fraction: float  # rest curvature over knitted curvature
    reference_temperature: Annotated[float, "K"]  # where thermal strain is zero

    @property
    def radius(self) -> float:
        """Radius of one end without its plating [m]."""
        return self.diameter / 2

    def length_factor(self, temperature: float) -> float:
        """Length at a temperature [K] over that at the reference temperature."""
        return 1.0 + self.expansion * (temperature - self.reference_temperature)

    @property
    def thickness(self) -> float:
        """Thickness of the yarn where it touches [m]: one wire with its plating, several side by side in the plane of the mesh
        count as a round bundle of the same section."""
        plating = 0.0 if self.plating is None else self.plating.thickness
        return (self.diameter + 2 * plating) * math.sqrt(self.ends)

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
        """[1/m] change of curvature at which the outermost fibres of the core reach the yield stress."""
        return self.yield_stress / (self.youngs_modulus * self.radius)

    @property
    def linear_density(self) -> float:
        """Mass per length of the yarn [kg/m]."""
        return self._over_section("density", lambda r: math.pi * r**2)

    def _over_section(self, constant: str, disc: Callable[[float], float]) -> float:
        """Sum of a material constant times the integral `disc`(radius) over core, plating and ends."""
        total: float = getattr(self, constant) * disc(self.radius)
        if self.plating is not None:
            annulus = disc(self.radius + self.plating.thickness) - disc(self.radius)
            total += getattr(MATERIALS[self.plating.material], constant) * annulus
        return self.ends * total
