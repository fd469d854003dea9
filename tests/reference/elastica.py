"""Euler's elastica: a cantilever under a dead end force.

EI theta'' + P cos theta = 0,   theta(0) = 0,   theta'(L) = 0,   w = integral of sin theta
"""

import numpy as np
from scipy.integrate import solve_bvp

DEFLECTION = {1.0: 0.301721, 5.0: 0.713792, 10.0: 0.810609}  # w/L by P L^2/EI, as published


def elastica(load: float) -> tuple[float, float]:
    """w/L and the end's angle from the boundary value problem."""

    def slope(_s: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.stack([y[1], -load * np.cos(y[0]), np.sin(y[0])])

    def ends(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.array([a[0], a[2], b[1]])

    s = np.linspace(0, 1, 200)
    guess = np.stack([s * (2 - s), 2 - 2 * s, 0.5 * s])
    solution = solve_bvp(slope, ends, s, guess, tol=1e-10, max_nodes=20000)
    assert solution.success
    return float(solution.y[2, -1]), float(solution.y[0, -1])
