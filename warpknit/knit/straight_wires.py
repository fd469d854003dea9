"""Least wire length of a strained repeat: shortest polygons through its hooks.

Two hooked wires stay together, so each runs from one place of hooking to the next, wherever these lie. No wire is shorter than
this polygon. With the places p of a repeat, the shift s to the copy of the next one, and the deformation gradient F, the least
length is

    min over p of the sum over pieces of |p_next - p + F s|

which is convex. Wires may slide through their hooks, and every wire may give length to any other: both make the bound smaller.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from .cloth import Cloth

ROUNDED = 1e-5  # of the width of a repeat: a piece this short is as good as none
STEPS = 5_000  # of the minimisation, at most


def least_length(cloth: Cloth, gradient: NDArray[np.float64], *, enough: float = 0.0) -> float:
    """Least length of a repeat's wires [m], hooked at points, under a deformation gradient (2, 2).

    Not minimised further where it is below `enough` [m] from the start.
    """
    begin, end, shift = _pieces(cloth)
    shift = shift @ gradient.T
    places = np.array([clasp.position for clasp in cloth.clasps]) @ gradient.T
    scale = float(cloth.size.max())

    def length(flat: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        way = (flat.reshape(places.shape)[end] - flat.reshape(places.shape)[begin]) + shift / scale
        size = np.sqrt(np.sum(way**2, axis=1) + ROUNDED**2)
        slope = np.zeros_like(places)
        np.add.at(slope, end, way / size[:, None])
        np.add.at(slope, begin, -way / size[:, None])
        return float(np.sum(size - ROUNDED)), slope.ravel()

    first = places.ravel() / scale
    if (affine := scale * length(first)[0]) <= enough:
        return affine
    return scale * float(minimize(length, first, jac=True, method="L-BFGS-B", options={"maxiter": STEPS}).fun)


def _pieces(cloth: Cloth) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Clasps at both ends of each piece [piece], and shift of the copies along it (piece, 2) [m]."""
    begin, end, shift = [], [], []
    for number, thread in enumerate(cloth.threads):
        along = []
        for clasp, place in enumerate(cloth.clasps):
            for arm in place.arms:
                if arm.thread == number:
                    row = math.floor(arm.arc / thread.length)
                    along.append((arm.arc - row * thread.length, clasp, np.array([-arm.column, -row])))
        along.sort(key=lambda stop: stop[0])
        for k, (_, clasp, copy) in enumerate(along):
            _, other, next_copy = along[(k + 1) % len(along)]
            begin.append(clasp)
            end.append(other)
            shift.append((next_copy - copy + [0, k + 1 == len(along)]) * cloth.size)
    return np.array(begin, dtype=np.int64), np.array(end, dtype=np.int64), np.array(shift, dtype=float).reshape(-1, 2)
