"""Forces are minus the gradient of one energy, which knows no place and no direction.

    f = -dE/dx,    d f_i/d x_j = d f_j/d x_i,    sum f = 0,    sum x cross f = 0,    f(Q x + t) = Q f(x)

A contact point is only found to CLOSEST_POINT_TOLERANCE of a segment h, so the force of a body is turned out of the line to
its contact point by that times h/reach: the tolerance of contacts. Bodies sit in all phases of a segment.
"""

import numpy as np
import pytest
from verification.wires import CLOSEST_POINT_TOLERANCE, EPSILON, Rig, circle, panel_of_wires, table_of_wires

from warpknit.kernels import control as c
from warpknit.table import Table

NODES = 40
RADIUS = 0.4e-3
SPACING = 2 * np.pi * RADIUS / NODES
DEPTH = 1e-6  # [m] of the bodies in either wire
PENALTY = 1e5  # [N/m]


def two_rings(bodies: int, device: str = "cpu", **solver: object) -> Rig:
    """Two concentric rings with bodies squeezed between them, and contact curves bent at random by 0.1 um."""
    random = np.random.default_rng(1)
    reach = 0.625 * 15e-6
    gap = 2 * (reach - DEPTH)
    table = table_of_wires([circle(RADIUS, NODES), circle(RADIUS + gap, NODES)], closed=True)
    bend = random.uniform(-5e-7, 5e-7, (2 * NODES, 2, 2))  # no slope at either end of a segment, so no kinks
    curve = np.stack([0 * bend[..., 0], bend[..., 0], bend[..., 1], -bend.sum(axis=2)], axis=2).reshape(2 * NODES, 8)
    period = [np.mod(np.arange(-table.lead, NODES + table.lead), NODES) + w * NODES for w in range(2)]
    table = Table(**{**vars(table), "curve": curve[np.concatenate(period)]})
    turn = 2 * np.pi * (np.arange(bodies) / max(bodies, 1) + 0.013 * np.arange(bodies))
    place = (RADIUS + gap / 2) * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    segment = np.floor(turn / (2 * np.pi) * NODES).astype(int)
    pairs = [pair for s in segment for pair in ((0, int(s), -1), (1, int(s), 1))]
    rig = Rig(table, panel_of_wires(table, closed=True, bodies=place, pairs=pairs), device, **solver)
    rig.control({c.CONTACT_STIFFNESS: PENALTY})
    return rig


def deformed(rig: Rig) -> np.ndarray:
    """A state with random stretches of 1 % and turnings of 0.02."""
    random = np.random.default_rng(2)
    move = np.concatenate([np.full(rig.nodes, 0.01 * SPACING), np.full(len(rig.rest) - rig.nodes, 0.3 * DEPTH)])
    return rig.rest + move[:, None] * random.uniform(-1, 1, rig.rest.shape)


def contact_error(rig: Rig) -> float:
    """[N] what the tolerance of the contact point does to the force of a body."""
    return float(rig.state.pair_force.numpy().max()) * CLOSEST_POINT_TOLERANCE * SPACING / rig.model.contact_reach


def scale(force: np.ndarray) -> float:
    return float(np.abs(force).max())


@pytest.mark.parametrize("bodies", [0, 7])
def test_force_is_minus_the_gradient_of_the_energy(bodies: int) -> None:
    """Differences over 2 s: s^2/h^2 of the force from the third derivative, EPSILON f h/s from round-off; s = 1e-10 m."""
    rig = two_rings(bodies)
    x, s = deformed(rig), 1e-10
    force = rig.forces(x)
    assert bodies == 0 or np.count_nonzero(rig.state.pair_force.numpy()) > bodies
    error = contact_error(rig) if bodies else 0.0
    random = np.random.default_rng(3)
    for _ in range(10):
        way = random.choice([-1.0, 0.0, 1.0], x.shape)
        slope = (rig.stored_energy(x + s * way) - rig.stored_energy(x - s * way)) / (2 * s)
        tolerance = (EPSILON * SPACING / s + (s / SPACING) ** 2) * np.abs(force).sum() + 2 * bodies * error
        assert abs(slope + np.sum(force * way)) < tolerance < 1e-3 * scale(force)


@pytest.mark.parametrize("bodies", [0, 3])
def test_stiffness_is_symmetric(bodies: int) -> None:
    """Differences over 2 s: s^2/h^2 of EA/h and EPSILON h EA/h / s; with bodies s^2/reach^2 of the penalty, and the tolerance
    of the contact point over s, which has to be seen by the search: s = 5e-4 h."""
    rig = two_rings(bodies)
    x = deformed(rig)
    s = 5e-4 * SPACING if bodies else 1e-5 * SPACING
    hessian = rig.stiffness(x, s)
    axial = rig.model.axial_stiffness / SPACING
    tolerance = axial * ((s / SPACING) ** 2 + 100 * EPSILON * SPACING / s)
    if bodies:
        rig.forces(x)
        geometric = float(rig.state.pair_force.numpy().max()) / rig.model.contact_reach
        tolerance += PENALTY * (s / rig.model.contact_reach) ** 2 + contact_error(rig) / s
        assert tolerance < 0.1 * geometric
    assert scale(hessian - hessian.T) < tolerance


@pytest.mark.parametrize("bodies", [0, 7])
def test_forces_sum_to_nothing(bodies: int, device: str) -> None:
    """Round-off of EA/h times the radius; the contact points' tolerance turns bodies, but pulls nothing."""
    rig = two_rings(bodies, device)
    x = deformed(rig)
    force = rig.forces(x)
    moment = x[:, 0] * force[:, 1] - x[:, 1] * force[:, 0]
    noise = EPSILON * np.abs(force).sum() + EPSILON * rig.model.axial_stiffness * 2 * NODES
    assert scale(force) > 0.01
    assert scale(force.sum(axis=0)) < noise
    turned = 2 * bodies * contact_error(rig) * rig.model.contact_reach if bodies else 0.0
    assert abs(moment.sum()) < noise * RADIUS + turned


@pytest.mark.parametrize("bodies", [0, 7])
def test_forces_turn_with_the_mesh(bodies: int, device: str) -> None:
    """Round-off of positions 2 mm off, EPSILON x EA/h; the contact points' tolerance at most twice."""
    rig = two_rings(bodies, device)
    x = deformed(rig)
    force = rig.forces(x)
    error = 2 * contact_error(rig) if bodies else 0.0
    for angle in (0.3, 2.0, -2.9):
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        moved = rig.forces(x @ turn.T + [1.3e-3, -0.7e-3])
        noise = 8 * EPSILON * 2e-3 * (rig.model.axial_stiffness / SPACING + PENALTY)
        assert scale(moved - force @ turn.T) < noise + error


def free_flight(rig: Rig, steps: int, look: int) -> dict[str, np.ndarray]:
    """Momentum [N s] and angular momentum [N m s] of the half step, and the energy [J], every `look` steps of `steps`.

    The velocity stands half a step behind: x(t) and v(t - dt/2) make the angular momentum, which kicks and drifts both
    keep; the kinetic energy of a moment is the mean of the half steps around it.
    """
    rows: dict[str, list] = {"momentum": [], "angular": [], "energy": [], "kept": []}
    mass = rig.mass[:, None]
    for _ in range(steps // look):
        rig.step(look - 1)
        x, v = rig.position(), rig.velocity()
        stored = rig.stored_energy(x)
        rows["momentum"].append((mass * v).sum(axis=0))
        rows["angular"].append(np.sum(mass[:, 0] * (x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0])))
        rig.step(1)
        after = rig.velocity()
        rows["energy"].append(stored + 0.25 * np.sum(mass * (v**2 + after**2)))
        rows["kept"].append(stored + 0.5 * np.sum(mass * v * after))
    return {name: np.array(values) for name, values in rows.items()}


def flying_rings(step_share: float, device: str = "cpu") -> tuple[Rig, float, float]:
    """Rings with bodies under way, their largest w dt, and their typical speed [m/s].

    `step_share` is the time step over the model's own, which is 0.9 of the limit or less.
    """
    rig = two_rings(7, device)
    penalty = 1e4
    rig.control({c.CONTACT_STIFFNESS: penalty})
    body_mass = 5.0 * rig.mass[0]
    rig.control({c.BODY_INVERSE_MASS: 1 / body_mass})
    rig.mass[rig.nodes :] = body_mass
    speed = 0.2
    rig.set_velocity(speed * np.random.default_rng(4).normal(size=rig.rest.shape) + [0.3, -0.1])
    stretch = 4 * rig.model.axial_stiffness / SPACING
    largest = np.sqrt((stretch + 2 * penalty) / rig.mass[0])
    rig.set_time_step(step_share * 1.8 / largest)
    return rig, step_share * 1.8, speed


def test_flight_keeps_its_momentum() -> None:
    """10^4 steps: round-off grows by EPSILON m v a node and step; contact points' tolerance may turn a body by F h 1e-5."""
    rig, _, speed = flying_rings(0.5)
    steps = 10_000
    seen = free_flight(rig, steps, 500)
    of_all = np.abs(rig.mass).sum() * (speed + 0.3)
    round_off = EPSILON * of_all * steps
    time = steps * rig.time_step
    force = 1e4 * 3 * DEPTH
    assert scale(seen["momentum"] - seen["momentum"][0]) < round_off
    turned = 14 * force * CLOSEST_POINT_TOLERANCE * SPACING * time
    assert scale(seen["angular"] - seen["angular"][0]) < round_off * RADIUS + turned
    assert turned < 1e-2 * of_all * RADIUS


def test_energy_of_a_flight_only_ripples() -> None:
    """E(t) = E* + dt^2/4 sum m a^2 + O(dt^4) with E* kept: a ripple of at most (w dt)^2/4 of the energy, and no drift beyond.

    A quarter of the step has a sixteenth of the ripple, up to (w dt)^2/4 again.
    """
    ripple = {}
    for share, steps in ((0.2, 2000), (0.05, 8000)):
        rig, phase, _ = flying_rings(share)
        drift = 0.5 * np.sum(rig.mass) * (0.3**2 + 0.1**2)  # of the mesh as a whole
        energy = free_flight(rig, steps, steps // 200)["energy"]
        inner = energy[0] - drift
        ripple[share] = np.std(energy)
        assert np.ptp(energy) < phase**2 / 4 * inner
        assert abs(energy[-50:].mean() - energy[:50].mean()) < ripple[share]
    assert ripple[0.2] / ripple[0.05] == pytest.approx(16, rel=0.5)
