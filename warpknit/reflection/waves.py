"""Plane waves above and below a mesh: polarisations, heights of modes, and the waves that leave.

Time factor exp(+j w t), phase exp(-j k . r). Waves come down; a wave has the transverse wave vector kt = k sin(theta) (cos(phi),
sin(phi)). TE has its field along z x kt, TM along TE x k. At normal incidence and phi = 0, TE is along the warp and TM along the
weft.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

LIGHT = 299_792_458.0  # [m/s]
MU0 = 4e-7 * np.pi  # [H/m]
EPS0 = 1.0 / (MU0 * LIGHT**2)  # [F/m]
Z0 = MU0 * LIGHT  # [Ohm]
DOWN, UP = -1.0, 1.0
NORMAL = 1e-9  # kt over k below which incidence is normal
SMALLEST = 1e-30  # power below which a loss in dB has no meaning


@dataclass(frozen=True)
class Angles:
    """Direction of the incident wave [rad]: `theta` from the normal, `phi` from the weft towards the warp."""

    theta: float = 0.0
    phi: float = 0.0

    def transverse(self, k: float) -> np.ndarray:
        """(2,) [1/m] transverse wave vector."""
        return k * np.sin(self.theta) * np.array([np.cos(self.phi), np.sin(self.phi)])


@dataclass(frozen=True)
class Scattering:
    """Waves that leave a mesh, for an incident wave of unit amplitude. Amplitudes are (out, in) over TE, TM."""

    reflection: np.ndarray  # (2, 2)
    transmission: np.ndarray  # (2, 2)
    lobes: np.ndarray  # [in] power in grating lobes; 0 below the first Wood anomaly

    @property
    def reflected(self) -> np.ndarray:
        """[in] reflected power, of both polarisations."""
        return np.asarray((np.abs(self.reflection) ** 2).sum(axis=0))

    @property
    def transmitted(self) -> np.ndarray:
        """[in] transmitted power, of both polarisations."""
        return np.asarray((np.abs(self.transmission) ** 2).sum(axis=0))

    @property
    def crossed(self) -> np.ndarray:
        """[in] reflected power of the other polarisation."""
        return np.asarray((np.abs(self.reflection) ** 2)[[1, 0], [0, 1]])

    @property
    def absorbed(self) -> np.ndarray:
        """[in] power that becomes heat in wires and contacts."""
        return np.asarray(1.0 - self.reflected - self.transmitted - self.lobes)

    @property
    def loss(self) -> np.ndarray:
        """[in] [dB] reflection loss."""
        return np.asarray(-10.0 * np.log10(np.maximum(self.reflected, SMALLEST)))


def mode_decay(k: float, transverse: np.ndarray) -> np.ndarray:
    """[mode] [1/m] j kz of modes with transverse wave vectors (mode, 2): real for modes that decay with height."""
    square = (transverse**2).sum(axis=1) - k**2
    root = np.sqrt(np.abs(square))
    return np.where(square >= 0.0, root + 0j, 1j * root)


def polarisations(k: float, transverse: np.ndarray, direction: float, phi: float) -> np.ndarray:
    """Unit vectors (2, 3) of TE and TM of a wave up or down; `phi` decides at normal incidence."""
    length = float(np.hypot(*transverse))
    x, y = (np.cos(phi), np.sin(phi)) if length < NORMAL * k else transverse / length
    te = np.array([-y, x, 0.0])
    along = np.array([*transverse, direction * np.sqrt(max(k**2 - length**2, 0.0))]) / k
    return np.stack([te, np.cross(te, along)])


def first_lobe(cell: np.ndarray, angles: Angles) -> float:
    """Frequency of the first Wood anomaly [Hz]: grating lobes begin there; cell: periods (rows [m]).

    A lobe g leaves where |kt + g| = k: k^2 cos^2(theta) - 2 k s . g - |g|^2 = 0 with kt = k s.
    """
    steps = np.arange(-2, 3)
    i, j = (axis.ravel() for axis in np.meshgrid(steps, steps))
    g = (np.stack([i, j], axis=1) @ (2.0 * np.pi * np.linalg.inv(cell).T))[(i != 0) | (j != 0)]
    s, square = g @ angles.transverse(1.0), (g**2).sum(axis=1)
    cos2 = np.cos(angles.theta) ** 2
    return float(((s + np.sqrt(s**2 + cos2 * square)) / cos2).min() * LIGHT / (2.0 * np.pi))
