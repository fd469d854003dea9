"""A body between wires: the law of its force, which side it belongs to, and how it runs along an arc.

gap = side n.(c - p) - reach,    F = max(0, -k gap),    reach = d/2 + r_b = 0.625 d
"""

import numpy as np
import pytest

from reference.oscillator import step_matrix
from reference.plane_wires import (
    CLOSEST_POINT_TOLERANCE,
    DIAMETER,
    EPSILON,
    Rig,
    panel_of_wires,
    straight,
    table_of_circle,
    table_of_wires,
)
from warpknit.kernels.bodies import FREE_FLIGHT
from warpknit.mechanics.numerics import LOOK_AHEAD

SEGMENTS = 40
SPACING = 50e-6
REACH = 0.625 * DIAMETER
BALANCE = 1e-14  # [N] over a force of 6e-9 N
BELOW, ABOVE = (0, SEGMENTS // 2, 1), (1, SEGMENTS // 2, -1)  # pairs of a body with the wire under and over it


def body_between(
    distance: float, offset: float = 0.0, held: bool = True, device: str = "cpu", softening: float = 1.0, drive: str = "ramp"
) -> Rig:
    """Two straight wires, `distance` apart, and a body over the middle node of the lower, `offset` above the middle."""
    table = table_of_wires([straight(SEGMENTS + 1, SPACING), straight(SEGMENTS + 1, SPACING, distance)])
    body = np.array([[SEGMENTS // 2 * SPACING, distance / 2 + offset]])
    nodes = range(2 * (SEGMENTS + 1)) if held else ()
    panel = panel_of_wires(table, held=nodes, bodies=body, pairs=[BELOW, ABOVE])
    rig = Rig(table, panel, device, axial_softening=softening, drive=drive)
    rig.forces()
    return rig


def settle_body(rig: Rig, stiffness: float, steps: int = 2000) -> None:
    """Let a body come to rest, critically damped: it loses a factor of e every ten steps."""
    step = 0.1 / np.sqrt(stiffness / rig.mass[-1])
    rig.set_time_step(step, damping=2 * 0.1 / step)
    rig.step(steps)


def test_pair_closes_when_the_wires_are_nearer_than_1_25_diameters(device: str) -> None:
    """Both pairs of a body half way are closed for D < 1.25 d and open beyond; to a millionth of d."""
    for sign, closed in ((-1, True), (1, False)):
        rig = body_between(1.25 * DIAMETER + sign * 1e-6 * DIAMETER, device=device)
        assert np.array_equal(rig.state.pair_force.numpy() > 0, [closed, closed])


def test_body_squeezed_by_rigid_wires_settles_half_way(device: str) -> None:
    """F = k (reach - D/2) on either side; round-off of positions of 1 mm against the squeeze of 0.025 d."""
    rig = body_between(1.2 * DIAMETER, offset=0.1 * DIAMETER, device=device)
    k = rig.model.contact_stiffness
    settle_body(rig, 2 * k)
    r = rig.observables()
    squeeze = REACH - 0.6 * DIAMETER
    noise = 100 * EPSILON * 1e-3 / squeeze
    assert rig.position()[-1, 1] == pytest.approx(0.6 * DIAMETER, rel=noise, abs=0)
    assert r.pair_force == pytest.approx([k * squeeze] * 2, rel=noise, abs=0)
    assert r.pair_gap == pytest.approx([-squeeze] * 2, rel=noise, abs=0)


@pytest.mark.parametrize("look_ahead", [0.0, LOOK_AHEAD])
def test_squeezed_body_swings_as_its_step_says(look_ahead: float, device: str) -> None:
    """Two closed pairs are one spring of 2 k, so w^2 = 2 k/m, and n steps are the n-th power of one.

    The swing of 0.01 d in a squeeze of 0.1 d opens neither; round-off of positions of 1 mm.
    """
    swing = 0.01 * DIAMETER
    rig = body_between(1.05 * DIAMETER, offset=swing, device=device)
    rig.control(look_ahead=look_ahead)
    rig.set_time_step(0.5 / np.sqrt(2 * rig.model.contact_stiffness / rig.mass[-1]))
    steps = 50
    rig.step(steps)
    expected = np.linalg.matrix_power(step_matrix(0.5, look_ahead), steps) @ [swing, 0.0]
    assert rig.position()[-1, 1] - 0.525 * DIAMETER == pytest.approx(expected[0], abs=100 * EPSILON * 1e-3)


@pytest.mark.parametrize("drive", ["relax", "ramp"])
def test_body_that_is_let_go_does_not_fly_far(drive: str, device: str) -> None:
    """In a relaxation it keeps the share r of its speed v a step, and so comes v r/(1 - r) far; in a ramp it flies on, v n.

    Round-off of positions of 1 mm.
    """
    speed, steps = 0.01 * DIAMETER, 400
    rig = body_between(100 * DIAMETER, device=device, drive=drive)
    start = rig.position()[-1]
    rig.set_time_step(1.0)
    rig.set_velocity(np.concatenate([np.zeros((rig.nodes, 2)), [[speed, 0.0]]]))
    rig.step(steps)
    far = speed * (FREE_FLIGHT / (1 - FREE_FLIGHT) if drive == "relax" else steps)
    assert rig.position()[-1] - start == pytest.approx([far, 0.0], abs=100 * EPSILON * 1e-3)


def test_body_squeezed_by_pinned_wires_bends_them() -> None:
    """F = (reach - D/2) / (1/k + b), with b the deflection of a pinned wire per force in its middle:

        b = L^3/(48 EI) (1 + (4/3) sqrt(3/5)/n^3)

    and each end carries F/2. The squeeze of 1e-4 d is linear to (w/d)^2 = 1e-8; the balance of Newton's method is
    1e-14 N, which a wire as stiff as tungsten would drown in round-off: EA, which nothing here depends on, is
    softened.
    """
    squeeze = 1e-4 * DIAMETER
    rig = body_between(2 * (REACH - squeeze), held=False, softening=1e4)
    penalty = 10.0
    rig.control(contact_stiffness=penalty)
    hinges = np.arange(1, SEGMENTS)
    bend = SPACING**3 / rig.model.bending_stiffness * quadratic_of_moments(np.minimum(hinges, SEGMENTS - hinges) / 2)
    length = SEGMENTS * SPACING
    assert bend == pytest.approx(
        length**3 / (48 * rig.model.bending_stiffness) * (1 + 4 / 3 * np.sqrt(0.6) / SEGMENTS**3), rel=EPSILON * 100, abs=0
    )
    ends = [0, SEGMENTS, SEGMENTS + 1, 2 * SEGMENTS + 1]
    free = np.ones_like(rig.rest, dtype=bool)
    free[ends] = False
    free[-1, 0] = False  # nothing holds the body along the wires
    x = rig.rest_position(rig.rest, free, tolerance=BALANCE)
    force = squeeze / (1 / penalty + bend)
    at_ends = rig.forces(x)[ends, 1]
    assert rig.observables().pair_force == pytest.approx([force] * 2, abs=10 * BALANCE)
    assert at_ends == pytest.approx(force / 2 * np.array([-1, -1, 1, 1]), abs=10 * BALANCE)


def quadratic_of_moments(m: np.ndarray) -> float:
    """m . (1 - delta^2/6)^-1 m of moments at hinges that are 0 at both ends: twice the energy, in l/EI (kernels/bend.py).

    A kink of 1 in m makes it sum(m^2) - sum(step^2)/6 + 1/36 of the inverse at the kink, 1/sqrt(1 + 4/6) = sqrt(3/5).
    """
    second = np.diag(np.full(len(m), -2.0)) + np.diag(np.ones(len(m) - 1), 1) + np.diag(np.ones(len(m) - 1), -1)
    return float(m @ np.linalg.solve(np.eye(len(m)) - second / 6, m))


@pytest.mark.parametrize("beyond", [0.3, 2.0, 6.0])
def test_body_on_the_wrong_side_is_pushed_back(beyond: float, device: str) -> None:
    """A body `beyond` d behind the upper wire feels k (reach + beyond d) back, and comes to rest where it belongs.

    At rest only the upper wire holds it, on its own side, to within round-off of the way back.
    """
    distance = 20 * DIAMETER
    rig = body_between(distance, offset=distance / 2 + beyond * DIAMETER, device=device)
    k = rig.model.contact_stiffness
    noise = 100 * EPSILON * 1e-3 / DIAMETER
    assert rig.forces()[-1] == pytest.approx([0.0, -k * (REACH + beyond * DIAMETER)], rel=noise, abs=k * 1e-15)
    settle_body(rig, k)
    assert rig.position()[-1, 1] == pytest.approx(distance - REACH, rel=noise, abs=0)


RADIUS = 0.6e-3
ARC_NODES = 19
DEPTH = 0.01 * DIAMETER  # of the running body in the wire


def run_along_arc(with_curve: bool) -> tuple[np.ndarray, float, Rig]:
    """Contact forces [N] of a body that runs once around inside a rigid circle, and what holds it on a perfect circle.

    Both pairs of the body are with the same wire, so each carries half. The start is the orbit of central differences:
    F = 2 m r (1 - cos q)/dt^2 with q the angle of a step.
    """
    table = table_of_circle(RADIUS, ARC_NODES, with_curve=with_curve)
    r = RADIUS - REACH + DEPTH
    body = np.array([[r * np.cos(0.1), r * np.sin(0.1)]])
    pairs = [(0, 0, 1), (0, 0, 1)]
    rig = Rig(table, panel_of_wires(table, closed=True, held=range(ARC_NODES), bodies=body, pairs=pairs))
    k = rig.model.contact_stiffness
    step = 0.1 / np.sqrt(2 * k / rig.mass[-1])
    rig.set_time_step(step)
    force = 2 * k * DEPTH
    turn = np.arccos(1 - force * step**2 / (2 * rig.mass[-1] * r))
    before = r * np.array([np.cos(0.1 - turn), np.sin(0.1 - turn)])
    velocity = np.zeros_like(rig.rest)
    velocity[-1] = (body[0] - before) / step
    rig.set_velocity(velocity)
    forces = []
    for _ in range(round(2 * np.pi / turn) // 5):
        rig.step(5)
        forces.append(rig.state.pair_force.numpy().sum())
    return np.array(forces), force, rig


def test_body_runs_along_an_arc_as_if_it_were_smooth() -> None:
    """m v^2/r all the way round, with the rest-shape table: the curve misses the arc by `curve_error`, so the force
    by k times that, twice where it meets the body's own swing; and forces are off their lines by the tolerance of the
    contact point, CLOSEST_POINT_TOLERANCE h/reach of them along the way of 2 pi r, which feeds (v^2 and so) F at 2 a
    radian.

    On the polyline F would vary by k h^2/(8 R) = 55 F.
    """
    forces, expected, rig = run_along_arc(with_curve=True)
    spacing = 2 * np.pi * RADIUS / ARC_NODES
    miss = 2 * rig.model.table.curve_error / DEPTH
    off_line = 2 * CLOSEST_POINT_TOLERANCE * spacing / REACH * 2 * np.pi
    assert np.max(np.abs(forces / expected - 1)) < 2 * miss + off_line < 0.02
    position = rig.position()[-1]
    assert np.hypot(*position) == pytest.approx(RADIUS - REACH + DEPTH, abs=0.02 * DEPTH)


def test_coarse_curve_without_its_table_shows() -> None:
    """The same run on Catmull-Rom alone, which misses the arc by about h^4/(80 R^3) between nodes: it leaves F by
    over half."""
    forces, expected, _ = run_along_arc(with_curve=False)
    assert np.ptp(forces) > 0.5 * expected
