"""Waves from a mesh at many frequencies.

The matrices of `StoredEnergy` take nearly all of the time of a frequency, and are smooth below the first grating lobe: resonances
are in their inverse alone. So over a band they are interpolated between Chebyshev-Lobatto points, while every frequency has its
own currents. The points are doubled until the last interpolation predicts the waves at the new points within TOLERANCE. The
result has the new points as well, so its error is smaller.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from .currents import MeshCurrents, StoredEnergy
from .waves import LIGHT, Angles, Scattering

TOLERANCE = 1e-4  # of the amplitude of a wave: 0.001 dB of reflection loss
INTERVALS = 2  # of the first interpolation


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

    low, high = min(wave_numbers), max(wave_numbers)
    count, known = INTERVALS, [exact(k) for k in _points(low, high, INTERVALS)] if len(wave_numbers) > 2 * INTERVALS + 1 else []
    while known and 2 * count + 1 < len(wave_numbers):
        points = _points(low, high, 2 * count)
        new = {k: exact(k) for k in points[1::2]}
        error = max(_difference(waves(k, _between(_points(low, high, count), known, k)), waves(k, one)) for k, one in new.items())
        known = [one for pair in zip(known, [*new.values(), known[-1]], strict=True) for one in pair][:-1]
        count *= 2
        if error < TOLERANCE:
            return lambda k: _between(points, known, k)
    return exact


def _points(low: float, high: float, intervals: int) -> list[float]:
    """Chebyshev-Lobatto points; half as many intervals have every second one of them."""
    return (0.5 * (low + high) - 0.5 * (high - low) * np.cos(np.pi * np.arange(intervals + 1) / intervals)).tolist()


def _between(points: Sequence[float], known: Sequence[StoredEnergy], k: float) -> StoredEnergy:
    """Barycentric interpolation between Chebyshev-Lobatto points."""
    away = k - np.array(points)
    if (at := np.flatnonzero(np.abs(away) < 1e-12 * points[-1])).size:
        return known[at[0]]
    weight = (-1.0) ** np.arange(len(points)) / away
    weight[[0, -1]] *= 0.5
    weight /= weight.sum()
    inductance, potential = (sum(w * getattr(one, name) for w, one in zip(weight, known, strict=True)) for name in _MATRICES)
    return StoredEnergy(np.asarray(inductance), np.asarray(potential))


_MATRICES = ("inductance", "potential")


def _difference(some: Sequence[Scattering], others: Sequence[Scattering]) -> float:
    """Largest difference of amplitudes."""
    pairs = zip(some, others, strict=True)
    return max(float(np.abs(one.reflection - other.reflection).max()) for one, other in pairs)
