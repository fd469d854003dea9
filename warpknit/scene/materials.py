"""Metals that meshes are knitted from, at 20 degC.

Sources, by column:

- Young's modulus, Poisson's ratio, density, thermal expansion: textbook values of the pure metals. Tungsten's modulus
  and density: Guglielmini, Marotta and Salvini (2022).
- Tensile strength: tungsten 4.5 GPa is the upper end found for drawn wire of 16 to 150 um (Riesch et al., Phys. Scr.
  T170, 014032, 2017), thin wire being the stronger; molybdenum 0.8 GPa is the lower end of 0.8 to 1.2 GPa; gold
  0.13 GPa is annealed.
- Yield stress: no measured value of fine drawn wire was at hand, so these are assumptions on the safe side. Tungsten
  2.0 GPa is less than half of the drawn strength; molybdenum 0.6 GPa is three quarters of its strength. A scene that
  knows better sets `wire.yield_stress`.
- Resistivity: textbook values of the pure metals (gold 2.44e-8, tungsten 5.60e-8, molybdenum 5.34e-8 Ohm m).
- Hardness, for contact resistance, which goes with its root: gold 0.7 GPa, soft plated gold (ASTM B488 code A: at most 90 HK,
  0.88 GPa; hard gold, code C, has 130 to 200 HK, 1.3 to 2.0 GPa; annealed gold 0.2 GPa); molybdenum 2.7 GPa, the upper end of
  1.40 to 2.74 GPa Vickers (Wikipedia, "Hardnesses of the elements (data page)"), drawn wire being hard;
  tungsten 4.6 GPa, the upper end of 3.4 to 4.6 GPa, from memory. A scene that knows better sets `wire.hardness`. Oxide on
  bare tungsten and molybdenum adds a resistance that is not counted.
- Melting point: textbook values.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Material:
    """An isotropic elastic metal, in SI units."""

    youngs_modulus: float  # [Pa]
    poissons_ratio: float
    density: float  # [kg/m3]
    expansion: float  # [1/K]
    yield_stress: float  # [Pa]
    tensile_strength: float  # [Pa]
    resistivity: float  # [Ohm m]
    hardness: float  # [Pa]
    melting: float  # [K]


MATERIALS = {
    "tungsten": Material(400e9, 0.28, 19250.0, 4.5e-6, 2.0e9, 4.5e9, 5.60e-8, 4.6e9, 3695.0),
    "molybdenum": Material(320e9, 0.31, 10220.0, 5.0e-6, 0.6e9, 0.8e9, 5.34e-8, 2.7e9, 2896.0),
    "gold": Material(78e9, 0.42, 19300.0, 14.2e-6, 0.1e9, 0.13e9, 2.44e-8, 0.7e9, 1337.0),
}
