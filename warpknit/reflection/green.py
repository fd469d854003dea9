"""Green's function of a doubly periodic sheet, integrated over pairs of straight pieces. By Ewald's sum.

A source repeats at R = i cell[0] + j cell[1] with the phase exp(-j kt . R). Its potential is the sum over R of

    G = exp(-j kt . R) exp(-j k d) / (4 pi d),      d = sqrt(|r - r'|^2 + a^2)

with the radius a of the wire: the distance from its axis (reduced kernel). Two sums of few terms give it (Jordan, Richter, Sheng,
J. Comput. Phys. 63 (1986) 222), here with the splitting parameter eta:

    images   exp(-j kt . R) Re[exp(j k d) erfc(eta d + j k / (2 eta))] / (4 pi d)
    modes    exp(-j kg . rho) f / (4 A),    f = [exp(u h) erfc(u / (2 eta) + eta h) + exp(-u h) erfc(u / (2 eta) - eta h)] / u

kg = kt + g, u = sqrt(|kg|^2 - k^2), h^2 = (z - z')^2 + a^2, A the area of the cell. For a mode that travels, u = j kz and

    f = (real even function of u) - 2 j cos(kz h) / kz.

Only the real part is in `regular`. The other part carries the power that leaves; `currents` adds it mode by mode, taken on the
axes, so that powers add up exactly. f is even in h and is interpolated by a polynomial in h^2.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.special import wofz

from .curves import near_images
from .waves import mode_decay

NEGLIGIBLE = 3.6  # erfc(3.6) = 4e-7: both sums end there
REACH = 0.5  # range of the images, in square roots of the area of a cell
HEIGHTS = 5  # points of the interpolation in h^2
FLAT = 1e-6  # relative range of h^2 below which one point is enough
GAUSS = 5  # points towards each end of a piece beside another
BESIDE = 5.0  # lengths: pieces nearer than that are integrated, others are taken at their middles
SHORTEST = 1e-15  # [m] length below which a piece has no direction


class PieceKernel:
    """Double integrals of the Green's function over straight pieces; the geometry and the static integrals are found once.

    cell: (2, 2) [m], rows are the periods. radius: [m]. middle, vector: (piece, 3) [m], a piece from end to end.
    """

    def __init__(self, cell: np.ndarray, radius: float, middle: np.ndarray, vector: np.ndarray) -> None:
        self.cell, self.radius, self.middle, self.vector = cell, radius, middle, vector
        self.area = abs(float(np.linalg.det(cell)))
        self.length = np.linalg.norm(vector, axis=1)
        self.splitting = NEGLIGIBLE / (REACH * np.sqrt(self.area))
        self.modes = _modes(cell, 2.0 * self.splitting * NEGLIGIBLE)
        self._find_images()
        self._place_heights()

    def regular(self, k: float, transverse: np.ndarray) -> np.ndarray:
        """(piece, piece) [m] double integrals of G without the waves that leave; Hermitian, real where kt is 0."""
        total, is_real = self._image_sum(k, transverse), not transverse.any()
        kg = self._half_modes if is_real else self.modes + transverse
        u = mode_decay(k, kg)
        wave = self._transforms(kg)
        for height2, share in zip(self.height2, self.shares, strict=True):
            strength = _mode_term(u, np.sqrt(height2), self.splitting).real / (4.0 * self.area)
            total += share * (_real_product(wave, strength) if is_real else (wave * strength) @ wave.conj().T)
        return total

    @property
    def _half_modes(self) -> np.ndarray:
        """(mode, 2) [1/m] one mode of each pair g, -g, and g = 0 first."""
        kept = (self.modes[:, 0] > 0.0) | ((self.modes[:, 0] == 0.0) & (self.modes[:, 1] > 0.0))
        return np.concatenate([np.zeros((1, 2)), self.modes[kept]])

    def _image_sum(self, k: float, transverse: np.ndarray) -> np.ndarray:
        """(piece, piece) the sum over images; a pair and its opposite are conjugate."""
        d, eta, count = self.distance, self.splitting, len(self.length)
        term = np.exp(-((eta * d) ** 2) + (k / (2.0 * eta)) ** 2) * wofz(1j * eta * d - k / (2.0 * eta)).real / d
        value = (term * self.weight + self.static) / (4.0 * np.pi)
        if transverse.any():
            value = value * np.exp(-1j * (self.image @ self.cell) @ transverse)
        once = sparse.coo_array((value, (self.first, self.second)), shape=(count, count)).toarray()
        return np.asarray(once + once.conj().T)

    def _transforms(self, kg: np.ndarray) -> np.ndarray:
        """(piece, mode) [m] integrals of exp(-j kg . r) along the pieces."""
        phase = self.middle[:, :2] @ kg.T
        size = self.length[:, None] * np.sinc(self.vector[:, :2] @ kg.T / (2.0 * np.pi))
        return np.asarray(size * np.exp(-1j * phase))

    def _find_images(self) -> None:
        """Find pairs (first, second + image) within range, each once, and static corrections of neighbours.

        The correction is the integral of 1/d less its value at the middles; the rest of the image term is smooth.
        """
        reach = NEGLIGIBLE / self.splitting
        self.first, self.second, self.image, apart = near_images(self.middle, self.cell, reach)
        self.distance = np.hypot(apart, self.radius)
        is_itself = (self.first == self.second) & ~self.image.any(axis=1)
        self.weight = np.where(is_itself, 0.5, 1.0) * self.length[self.first] * self.length[self.second]
        near = self.distance < BESIDE * (self.length[self.first] + self.length[self.second]) + 4.0 * self.radius
        first, second = self.first[near], self.second[near]
        other = self.middle[second].copy()
        other[:, :2] += self.image[near] @ self.cell
        exact = static_integral(self.middle[first], self.vector[first], other, self.vector[second], self.radius)
        self.static = np.zeros(len(self.first))
        self.static[near] = np.where(is_itself[near], 0.5, 1.0) * exact - self.weight[near] / self.distance[near]

    def _place_heights(self) -> None:
        """Chebyshev points in h^2, and the Lagrange polynomials (piece, piece) of each."""
        z, low = self.middle[:, 2], self.radius**2
        high = low + np.ptp(z) ** 2
        count = HEIGHTS if high > low * (1.0 + FLAT) else 1
        self.height2 = 0.5 * (low + high) + 0.5 * (high - low) * np.cos(np.pi * (np.arange(count) + 0.5) / count)
        square = (z[:, None] - z) ** 2 + low
        self.shares = [
            np.prod([(square - other) / (value - other) for other in np.delete(self.height2, place)], axis=0)
            for place, value in enumerate(self.height2)
        ]


def _modes(cell: np.ndarray, most: float) -> np.ndarray:
    """Reciprocal lattice vectors (mode, 2) [1/m] up to a length [1/m], and one more each way."""
    reciprocal = 2.0 * np.pi * np.linalg.inv(cell).T
    most = most + np.linalg.norm(reciprocal, axis=1).max()
    count = np.ceil(most * np.linalg.norm(cell, axis=1) / (2.0 * np.pi)).astype(int)
    i, j = np.meshgrid(*(np.arange(-n, n + 1) for n in count))
    vectors = np.stack([i.ravel(), j.ravel()], axis=1) @ reciprocal
    return np.asarray(vectors[np.linalg.norm(vectors, axis=1) < most])


def _real_product(wave: np.ndarray, strength: np.ndarray) -> np.ndarray:
    """Sum over `_half_modes` and their opposites of strength wave wave^H, which is real."""
    twice = np.concatenate([strength[:1], 2.0 * strength[1:]])
    return np.asarray((wave.real * twice) @ wave.real.T + (wave.imag * twice) @ wave.imag.T)


def _mode_term(u: np.ndarray, height: float, splitting: float) -> np.ndarray:
    """[mode] [m] f of the docstring above, with erfc(x) = exp(-x^2) w(j x)."""
    half, rise = u / (2.0 * splitting), height * splitting
    envelope = np.exp(-(half**2) - rise**2)
    less = half - rise
    turned = less.real < 0.0  # erfc(x) = 2 - erfc(-x)
    second = envelope * wofz(1j * np.where(turned, -less, less))
    second = np.where(turned, 2.0 * np.exp(-u * height) - second, second)
    return np.asarray((envelope * wofz(1j * (half + rise)) + second) / u)


def static_integral(p: np.ndarray, u: np.ndarray, q: np.ndarray, v: np.ndarray, radius: float) -> np.ndarray:
    """Double integrals [pair] [m] of 1/sqrt(|r - r'|^2 + radius^2). Over pieces u and v (pair, 3) with middles p and q.

    The inner integral is closed. The outer one is Gauss's rule on each half, with its points dense at the ends of the piece.
    """
    points, weights = np.polynomial.legendre.leggauss(GAUSS)
    length = np.linalg.norm(v, axis=1)
    tangent = v / np.maximum(length, SHORTEST)[:, None]
    total = np.zeros(len(p))
    for sign in (-1.0, 1.0):
        for x, weight in zip(0.5 * (points + 1.0), 0.5 * weights, strict=True):
            r = p + sign * 0.5 * (1.0 - x**3) * u - q
            along = (r * tangent).sum(axis=1)
            across = np.sqrt(np.maximum((r * r).sum(axis=1) - along**2, 0.0) + radius**2)
            inner = np.arcsinh((0.5 * length - along) / across) + np.arcsinh((0.5 * length + along) / across)
            total += 1.5 * x**2 * weight * inner
    return np.asarray(total * np.linalg.norm(u, axis=1))
