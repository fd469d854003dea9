"""Impedances of wires and contacts.

Wire with skin effect: a plating is flat on the core, thin against the radius. A yarn of n wires counts as one round wire with the
geometric mean of their distances as radius, on the tightest circle on which they touch (conductor bundle, as in power lines):

    r = (n a rho^(n-1))^(1/n),      rho = a / sin(pi / n)        1.41 a, 1.59 a, 1.83 a for two, three and four wires

Contact: Holm's constriction and a film in series, and beside them the capacitance of two crossed wires at the gap g,

    C = 2 pi eps0 a ln(1 + a / (2 g)).
"""

from __future__ import annotations

import numpy as np
from scipy.special import ive

from ..scene import Wire
from ..scene.materials import MATERIALS
from .waves import EPS0, MU0

LEAST_GAP = 10e-9  # [m] of wires that touch: an assumed film; the capacitance goes with its logarithm


def surface_radius(wire: Wire) -> float:
    """[m] radius of one wire with its plating."""
    return wire.radius + (0.0 if wire.plating is None else wire.plating.thickness)


def yarn_radius(wire: Wire) -> float:
    """[m] equivalent radius of the yarn: of one wire, or the geometric mean distance of several."""
    a, n = surface_radius(wire), wire.ends
    return a if n == 1 else float((n * a * (a / np.sin(np.pi / n)) ** (n - 1)) ** (1.0 / n))


def wire_impedance(wire: Wire, frequency: float) -> complex:
    """[Ohm/m] of the yarn at a frequency [Hz], with skin effect; its wires share the current.

    The plating is a line of depth t at its middle radius, which ends in the core.
    """
    core, g = _wave_impedance(frequency, MATERIALS[wire.material].resistivity)
    line = core * ive(0, g * wire.radius) / ive(1, g * wire.radius) / (2.0 * np.pi * wire.radius)
    if wire.plating is not None:
        depth = wire.plating.thickness
        coat, g = _wave_impedance(frequency, MATERIALS[wire.plating.material].resistivity)
        coat, tanh = coat / (2.0 * np.pi * (wire.radius + 0.5 * depth)), np.tanh(g * depth)
        line = coat * (line + coat * tanh) / (coat + line * tanh)
    return complex(line / wire.ends)


def _wave_impedance(frequency: float, resistivity: float) -> tuple[complex, complex]:
    """[Ohm] wave impedance of a metal, and [1/m] decay with depth."""
    decay = np.sqrt(2j * np.pi * frequency * MU0 / resistivity)
    return decay * resistivity, decay


def gap_capacitance(radius: float, gap: np.ndarray) -> np.ndarray:
    """[F] of two crossed wires at a gap [m] between their surfaces."""
    return np.asarray(2.0 * np.pi * EPS0 * radius * np.log1p(radius / (2.0 * np.maximum(gap, LEAST_GAP))))
