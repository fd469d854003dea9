"""A cantilever in space under a dead end force: Euler's elastica, in whatever plane the force bends it.

A rod of twice the length is held at its middle node and pulled alike at both ends, so that either half is a cantilever. It turns
at its nodes only; with the slopes of the moments the error falls with h^3, that of forces at nodes.
"""

from functools import cache

import numpy as np
import pytest

from reference.elastica import DEFLECTION
from reference.rods import SECTION, relaxed
from warpknit.spatial.rod_relaxation import RodRelaxation
from warpknit.spatial.rod_step import RodStepper
from warpknit.spatial.rods import rods_of

LENGTH = 1000.0  # [m] for a thickness of 1 m, so that the stretch by P/EA, 10 (d/4L)^2 and less, does not show
SOFTENING = 1e4  # of the stretch; multipliers bring the arcs to their lengths
BALANCE = 1e-7  # residual over the load


@cache
def deflection(load: float, segments: int, angle: float) -> np.ndarray:
    """Where the end has moved to (3,), over the length, under P L^2/EI = `load` across the rod at `angle` [rad]."""
    points = LENGTH / segments * np.arange(2 * segments + 1)[:, None] * [1.0, 0.0, 0.0]
    stepper = RodStepper(rods_of(SECTION, [points]).holding([segments], [segments]))
    force = load * SECTION.bending_stiffness / LENGTH**2
    forces = np.zeros_like(points)
    forces[[0, -1]] = force * np.array([0.0, np.cos(angle), np.sin(angle)])
    stepper.state.set_load(forces)
    relaxed(RodRelaxation(stepper, softening=SOFTENING), BALANCE * force, strain_tolerance=1e-9)
    moved = stepper.state.displacement.numpy()
    return (moved[-1] - moved[segments]) / LENGTH


@pytest.mark.parametrize("load", DEFLECTION)
def test_deflection_converges_at_third_order(load: float) -> None:
    """Twice the segments, an eighth of the error, give or take the next order; ten segments miss the elastica by less than
    1e-4."""
    coarse, fine = (float(np.linalg.norm(deflection(load, n, 0.3)[1:])) for n in (5, 10))
    exact = DEFLECTION[load]
    assert (coarse - exact) / (fine - exact) == pytest.approx(8.0, rel=0.1)
    assert fine == pytest.approx(exact, rel=1 / 10**4, abs=0)


@pytest.mark.parametrize("angle", [1.2, 2.9])
def test_a_round_rod_bends_alike_in_every_plane(angle: float) -> None:
    """The end moves in the plane of the force, as far as in any other; what is left out of balance is the tolerance."""
    moved, other = deflection(5.0, 10, angle), deflection(5.0, 10, 0.3)
    across = np.array([0.0, np.cos(angle), np.sin(angle)])
    allowed = 100 * BALANCE
    assert moved[0] == pytest.approx(other[0], rel=0, abs=allowed)
    assert moved @ across == pytest.approx(np.linalg.norm(other[1:]), rel=0, abs=allowed)
    assert abs(moved @ [0.0, -across[2], across[1]]) < allowed


def test_the_energy_of_an_equilibrium_does_not_depend_on_its_softening() -> None:
    """Arcs are longer than their chords, which the multipliers carry: what is stored is T^2 L/2EA and that of bending."""
    stored = []
    for softening in (1e2, 1e4):
        points = LENGTH / 10 * np.arange(11)[:, None] * [1.0, 0.0, 0.0]
        stepper = RodStepper(rods_of(SECTION, [points]).holding([0], [0]))
        force = 5.0 * SECTION.bending_stiffness / LENGTH**2
        forces = np.zeros_like(points)
        forces[-1] = force * np.array([2.0, 1.0, 0.0])
        stepper.state.set_load(forces)
        relaxation = RodRelaxation(stepper, softening=softening)
        relaxed(relaxation, BALANCE * force, strain_tolerance=1e-9)
        stored.append(relaxation.sums(of_mean=False).energy)
    assert stored[0] == pytest.approx(stored[1], rel=100 * BALANCE, abs=0)
