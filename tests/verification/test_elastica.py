"""A cantilever under a dead end force: Euler's elastica.

    EI theta'' + P cos theta = 0,   theta(0) = 0,   theta'(L) = 0,   w = integral of sin theta
    P L^2/EI = 1, 5, 10:   w/L = 0.301721, 0.713792, 0.810609

A wire of twice the length is held at its middle node and pulled alike at both ends, so that either half is a cantilever. Its
segments keep the length of their arcs, as in a relaxation: the tension's multipliers are moved until they do. Then the error
falls with h^4. The wire is 40 mm long, so that it stretches by EI/(EA L^2) P L^2/EI < 1e-7.
"""

from functools import cache

import numpy as np
import pytest

from reference.elastica import DEFLECTION, elastica
from reference.plane_wires import Rig, panel_of_wires, straight, table_of_wires
from warpknit.kernels.bend import BOW

LENGTH = 40e-3
SOFTENING = 1e4
MULTIPLIER_MOVES = 6  # each leaves about a tenth of what was missing
BALANCE = 5e-12  # [N] over loads of 6e-7 N and more


@cache
def cantilever(load: float, segments: int) -> tuple[float, np.ndarray]:
    """w/L of either half, and the force of both halves on what holds them, in units of P."""
    h = LENGTH / segments
    table = table_of_wires([straight(2 * segments + 1, h)])
    rig = Rig(table, panel_of_wires(table, held=[segments]), axial_softening=SOFTENING)
    rig.control(bow_moment=2.0 * BOW)
    force = load * rig.model.bending_stiffness / LENGTH**2
    free = np.ones_like(rig.rest, dtype=bool)
    free[segments] = False
    end_load = np.zeros_like(rig.rest)
    x = rig.rest.copy()
    for share in (0.1, 0.3, 0.6, 1.0, *(1.0,) * MULTIPLIER_MOVES):
        end_load[[0, -1], 1] = share * force
        x = rig.rest_position(x, free, end_load, tolerance=BALANCE)
        # the softened stretch is to be none of the arc, which is longer than the chord by the bow
        reading = rig.observables(x)
        angle = np.append(reading.turning, 0.0)
        bow = BOW * (angle[:-1] ** 2 + angle[1:] ** 2)
        rig.state.tension_offset.assign(reading.tension + rig.model.axial_stiffness / SOFTENING * bow)
    on_clamp = rig.observables(x).held_forces
    return (x[-1, 1] - x[segments, 1]) / LENGTH, on_clamp.sum(axis=0) / force


@pytest.mark.parametrize("load", DEFLECTION)
def test_reference_is_the_published_one(load: float) -> None:
    assert elastica(load)[0] == pytest.approx(DEFLECTION[load], abs=5e-7)


@pytest.mark.parametrize("load", [load if load < 5.0 else pytest.param(load, marks=pytest.mark.slow) for load in DEFLECTION])
def test_deflection_converges_at_third_order(load: float) -> None:
    """A load at a node bends the moment there, which leaves an error of h^3 (test_contact_bodies.py has its size); to either
    side of it the scheme is of fourth order. So the error falls by 8 less a share of h, and Richardson's limit is the
    elastica to the h^4 that is left, at most h^4/L^4/10 here."""
    exact, _ = elastica(load)
    coarse, fine = (cantilever(load, n)[0] for n in (10, 20))
    assert 7.0 < (coarse - exact) / (fine - exact) < 8.0
    assert (8 * fine - coarse) / 7 == pytest.approx(exact, abs=1 / 10**4 / 10)


@pytest.mark.parametrize("load", DEFLECTION)
def test_clamp_carries_the_load(load: float) -> None:
    """The force on what holds the wire is that of both ends."""
    _, reaction = cantilever(load, 10)
    force = load * 9.9e-10 / LENGTH**2
    assert reaction == pytest.approx([0.0, 2.0], abs=20 * BALANCE / force)
