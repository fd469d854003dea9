"""The braid of a loose knot: its contact force and its part of the energy, in the limit of a thin rod.

A knot of n turns in a straight rod of radius h and bending stiffness B, pulled by F, is a loop of radius R, two straight tails
and a braid: two strands that wind round each other by N = 2n + 1 half-turns. Let e^2 = h/R. For small e the loop is a circle and
the braid is short, l = sqrt(2 h R), so the difference of its strands, 2 h u(s/l) across the braid, is a beam:

    minimize  1/2 int |u''|^2 - [m u'] over all u with |u| >= 1 that wind by N half-turns;   m = -y on the left, y on the right

The couples m are the loop's, B/R, on one strand at either end. With Q the sum of the contact forces and P the smallest value, in
excess of a loop whose strands cross at a point, it follows that

    contact force   q h^2/B = sigma e^3,    sigma = Q/sqrt(8)
    energy          E = pi B/R (1 + c e),    c = P/(sqrt(2) pi)

The end-to-end shortening is S = 2 pi R, so without friction F = -dE/dS. As S changes, the strands slide along each other as far:

    F h^2/B = e^4/2 (1 + 3/2 c e) + mu sigma e^3   when the knot is tightened; - when it is loosened

to first order in e and mu. Of a long braid of slope w, P = (w^3 + 1/w) N pi/2 and Q = w^3 N pi with w = 3^(-1/4): one more turn
adds 0.975 to sigma and 1.241 to c.

Source: Audoly, Clauvelin and Neukirch (PRL 99, 164301) give F h^2/B = e^4/2 + mu sigma e^3 with sigma = 0.492 of one turn, as
quoted by others (knot_long.py). The braid, c and more turns were derived here.

Each step replaces |u| >= 1 by the half-planes that touch the circle at the present directions. They lie in the permitted region,
so the energy falls in every step and strands cannot pass through each other.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy import sparse
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import nnls

SPACING = 0.1  # of nodes; sigma and c err in proportion to it, by one per cent here
CLOSE_TO = 0.02  # weight of the change in a step: the braid may slide along the rod and would otherwise drift
NEAR = 1.5  # distance below which a node may touch
TOLERANCE, MOST_STEPS = 1e-6, 500


@dataclass(frozen=True)
class Braid:
    """Solution for a knot of `turns`."""

    turns: int
    sigma: float  # contact force h^2/B over e^3
    c: float  # first correction of the energy
    place: np.ndarray  # [contact] along one half of the braid, from its middle, in l
    share: np.ndarray  # [contact] of the contact force of that half

    def elastic(self, e: np.ndarray) -> np.ndarray:
        """F h^2/B without friction."""
        return 0.5 * e**4 * (1.0 + 1.5 * self.c * e)

    def force(self, e: np.ndarray, friction: float) -> np.ndarray:
        """F h^2/B of a knot that is tightened; a negative friction coefficient: loosened."""
        return self.elastic(e) + friction * self.sigma * e**3


@cache
def braid(turns: int, spacing: float = SPACING) -> Braid:
    """The braid of a knot of `turns` turns; one half is computed, the other its mirror image."""
    half_turns = 2 * turns + 1
    length = 1.75 * half_turns + 2.0
    k = round(length / spacing) + 1
    s = np.arange(k) * spacing
    stiffness, load, weight = _beam(k, spacing)
    u = _start(s, half_turns)
    matrix = stiffness + CLOSE_TO * np.diag(weight)
    matrix[k], matrix[:, k], matrix[k, k] = 0.0, 0.0, 1.0  # u_y = 0 in the middle
    inverse = np.linalg.inv(matrix)
    for _ in range(MOST_STEPS):
        distance = np.hypot(u[:k], u[k:])
        near = np.flatnonzero(distance < NEAR)
        outward = np.zeros((2 * k, len(near)))
        outward[near, range(len(near))] = (u[:k] / distance)[near]
        outward[k + near, range(len(near))] = (u[k:] / distance)[near]
        right = CLOSE_TO * weight * u - load
        outward[k], right[k] = 0.0, 0.0
        push = _contact_forces(outward.T @ inverse @ outward, 1.0 - outward.T @ (inverse @ right))
        before, u = u, inverse @ (right + outward @ push)
        if np.abs(u - before).max() < TOLERANCE:
            break
    else:
        raise ArithmeticError(f"braid of {turns} turns: no convergence in {MOST_STEPS} steps")
    excess = 2.0 * (0.5 * u @ stiffness @ u + load @ u) + s[-1]
    which = push > 1e-3 * push.max()
    sigma = float(2.0 * push.sum() / np.sqrt(8.0))
    return Braid(turns, sigma, float(excess / (np.sqrt(2.0) * np.pi)), s[near][which], push[which] / push.sum())


def _beam(k: int, spacing: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stiffness (2k, 2k), load [2k] of the couple at the end and lengths [2k] of the nodes; x is even about the middle, y odd."""
    difference = sparse.lil_matrix((k - 1, k))
    for i in range(1, k - 1):
        difference[i, i - 1 : i + 2] = [1.0, -2.0, 1.0]
    even = difference.copy()
    even[0, 0], even[0, 1] = -2.0, 2.0
    length = np.full(k, spacing)
    length[0] *= 0.5
    scale = sparse.diags(length[:-1] / spacing**4)
    stiffness = sparse.block_diag([d.T @ scale @ d for d in (even, difference)]).toarray()
    load = np.zeros(2 * k)
    load[-2:] = 1.0 / spacing, -1.0 / spacing
    return stiffness, load, np.tile(length, 2)


def _start(s: np.ndarray, half_turns: int) -> np.ndarray:
    """A helix in contact and the parabola of the loop beyond it."""
    wound = 1.4 * half_turns
    angle = 0.5 * np.pi * (1.0 - half_turns + half_turns * np.clip(s / wound, 0.0, 1.0))
    radius = 1.0 + 0.5 * np.maximum(s - wound, 0.0) ** 2
    u = np.concatenate([radius * np.cos(angle), radius * np.sin(angle)])
    u[len(s)] = 0.0
    return u


def _contact_forces(compliance: np.ndarray, gap: np.ndarray) -> np.ndarray:
    """Forces >= 0 that close the overlaps `gap` of nodes, by non-negative least squares."""
    count = len(gap)
    factor = cholesky(compliance + 1e-10 * np.trace(compliance) / count * np.eye(count))
    return nnls(factor, solve_triangular(factor.T, gap, lower=True), maxiter=20 * count)[0]
