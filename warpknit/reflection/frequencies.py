"""Waves from a mesh at many frequencies.

The matrices of `StoredEnergy` take nearly all of the time of a frequency, and are smooth below the first grating lobe: resonances
are in their inverse alone. So over a band they are interpolated between Chebyshev-Lobatto points, while every frequency has its
own currents. The points are doubled until the last interpolation predicts the waves at the new points within TOLERANCE. The
result has the new points as well, so its error is smaller.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from .currents import MeshCurrents, StoredEnergy
from .waves import LIGHT, Angles, Scattering

TOLERANCE = 1e-4  # of the amplitude of a wave: 0.001 dB of reflection loss
INTERVALS = 2  # of the first interpolation
SAME = 1e-12  # of a wave number: round-off


def scattering_at(
    mesh: MeshCurrents,
    frequencies: Sequence[float],
    angles: Angles,
    wire: Callable[[float], complex],
    contacts: Callable[[float], list[np.ndarray]],
) -> list[list[Scattering]]:
    """Waves at frequencies [Hz], for each state of the contacts.

    wire: [Ohm/m] impedance of the wire at a frequency. contacts: admittances [contact] [S] of each state at a frequency.
    """

    def waves(k: float, stored: StoredEnergy) -> list[Scattering]:
        frequency = k * LIGHT / (2.0 * np.pi)
        return mesh.scattering(k, angles, stored, wire(frequency), contacts(frequency))

    wave_numbers = [2.0 * np.pi * frequency / LIGHT for frequency in frequencies]
    matrices = stored_over(mesh, wave_numbers, angles, waves)
    return [waves(k, matrices(k)) for k in wave_numbers]


def stored_over(
    mesh: MeshCurrents, wave_numbers: Sequence[float], angles: Angles, waves: Callable[[float, StoredEnergy], list[Scattering]]
) -> Callable[[float], StoredEnergy]:
    """The matrices as a function of the wave number [1/m]: interpolated if that takes fewer points than there are numbers."""

    def exact(k: float) -> StoredEnergy:
        return mesh.stored(k, angles)

    if 2 * INTERVALS + 1 >= len(wave_numbers):
        return exact
    points = _points(min(wave_numbers), max(wave_numbers), INTERVALS)
    band = _Band(points, np.array([exact(k) for k in points]))
    while 2 * len(band.points) - 1 < len(wave_numbers):
        band, error = band.refined(exact, waves)
        if error < TOLERANCE:
            return band
    return exact


@dataclass(frozen=True, eq=False)
class _Band:
    """Matrices at Chebyshev-Lobatto points [1/m], and between them."""

    points: Sequence[float]
    known: np.ndarray  # (point, 2, current, current) inductance and potential

    def __call__(self, k: float) -> StoredEnergy:
        """Barycentric interpolation."""
        away = k - np.array(self.points)
        if (at := np.flatnonzero(np.abs(away) < SAME * self.points[-1])).size:
            return StoredEnergy(*self.known[at[0]])
        weight = (-1.0) ** np.arange(len(self.points)) / away
        weight[[0, -1]] *= 0.5
        return StoredEnergy(*np.tensordot(weight / weight.sum(), self.known, 1))

    def refined(
        self, exact: Callable[[float], StoredEnergy], waves: Callable[[float, StoredEnergy], list[Scattering]]
    ) -> tuple[_Band, float]:
        """Twice the intervals, and the largest error between the points of this one."""
        points = _points(self.points[0], self.points[-1], 2 * len(self.points) - 2)
        new = [exact(k) for k in points[1::2]]
        error = max(_difference(waves(k, self(k)), waves(k, one)) for k, one in zip(points[1::2], new, strict=True))
        return _Band(points, np.insert(self.known, range(1, len(self.points)), new, axis=0)), error


def _points(low: float, high: float, intervals: int) -> list[float]:
    """Chebyshev-Lobatto points; half the intervals have every second point."""
    return (0.5 * (low + high) - 0.5 * (high - low) * np.cos(np.pi * np.arange(intervals + 1) / intervals)).tolist()


def _difference(some: Sequence[Scattering], others: Sequence[Scattering]) -> float:
    """Largest difference of amplitudes."""
    pairs = zip(some, others, strict=True)
    return max(float(np.abs(one.reflection - other.reflection).max()) for one, other in pairs)
