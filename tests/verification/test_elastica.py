"""A cantilever under a dead end force: Euler's elastica.

    EI theta'' + P cos theta = 0,   theta(0) = 0,   theta'(L) = 0,   w = integral of sin theta
    P L^2/EI = 1, 5, 10:   w/L = 0.301721, 0.713792, 0.810609

The clamp holds the first two nodes and sits half way between them, where the first segment has its angle; every other
angle sits in the middle of its segment and every moment at its node, so the discrete equations are midpoint rules of
the above and the error falls with h^2. The wire is 40 mm long, so that it stretches by EI/(EA L^2) P L^2/EI < 1e-7.
"""

from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_bvp
from verification.wires import Rig, panel_of_wires, straight, table_of_wires

from warpknit import measure

LENGTH = 40e-3
DEFLECTION = {1.0: 0.301721, 5.0: 0.713792, 10.0: 0.810609}
BALANCE = 5e-12  # [N] over loads of 6e-7 N and more


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


@cache
def cantilever(load: float, segments: int) -> tuple[float, np.ndarray]:
    """w/L of the wire, and the force and moment of the wire on its clamp in units of P and P L."""
    h = LENGTH / (segments - 0.5)
    table = table_of_wires([straight(segments + 1, h) - [h / 2, 0]])
    rig = Rig(table, panel_of_wires(table, held=[0, 1]))
    force = load * rig.model.bending_stiffness / LENGTH**2
    free = np.ones_like(rig.rest, dtype=bool)
    free[:2] = False
    end_load = np.zeros_like(rig.rest)
    x = rig.rest.copy()
    for share in (0.1, 0.3, 0.6, 1.0) if segments < 40 else (0.05, 0.1, 0.2, 0.3, 0.45, 0.6, 0.8, 1.0):
        end_load[-1, 1] = share * force
        x = rig.rest_position(x, free, end_load, tolerance=BALANCE)
    on_clamp = measure.held_forces(rig.reading(x))
    moment = np.sum(rig.rest[:2, 0] * on_clamp[:, 1])
    return x[-1, 1] / LENGTH, np.array([*on_clamp.sum(axis=0) / force, moment / (force * x[-1, 0])])


@pytest.mark.parametrize("load", DEFLECTION)
def test_reference_is_the_published_one(load: float) -> None:
    assert elastica(load)[0] == pytest.approx(DEFLECTION[load], abs=5e-7)


@pytest.mark.parametrize("load", DEFLECTION)
def test_deflection_converges_at_second_order(load: float) -> None:
    """The error goes with h^2 to a relative h^2/L^2; so Richardson's limit is the elastica to an error (here 0.003 ..
    0.005) times that, h^4/L^4/5 being the share that is left."""
    exact, _ = elastica(load)
    coarse, fine = (cantilever(load, n)[0] for n in (10, 20))
    assert abs((coarse - exact) / (fine - exact) * (9.5 / 19.5) ** 2 - 1) < 1 / 9.5**2
    assert (fine * 19.5**2 - coarse * 9.5**2) / (19.5**2 - 9.5**2) == pytest.approx(exact, abs=1 / 9.5**4 / 5)


@pytest.mark.parametrize("load", DEFLECTION)
def test_clamp_carries_the_load(load: float) -> None:
    """Sum of the held nodes' forces = P, their moment about the clamp = P times the arm at which P ended up."""
    _, reaction = cantilever(load, 20)
    force = load * 9.9e-10 / LENGTH**2
    assert reaction == pytest.approx([0.0, 1.0, 1.0], abs=20 * BALANCE / force)
