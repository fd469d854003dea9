"""Forces are minus the gradient of one energy, which knows no place and no direction.

    f = -dE/dx,    d f_i/d x_j = d f_j/d x_i,    sum f = 0,    sum x cross f = 0,    f(Q x + t) = Q f(x)

A contact point is only found to CLOSEST_POINT_TOLERANCE of a segment h, so the force of a body is turned out of the
line to its contact point by that times h/reach: the tolerance of contacts. Bodies sit in all phases of a segment.
"""

import numpy as np
import pytest

from reference.plane_wires import CLOSEST_POINT_TOLERANCE, EPSILON, Rig
from reference.rings import DEPTH, NODES, PENALTY, RADIUS, SPACING, deformed, two_rings

SPEED = 0.2  # [m/s] of nodes and bodies in flight


def contact_error(rig: Rig) -> float:
    """[N] what the tolerance of the contact point does to the force of a body."""
    return float(rig.state.pair_force.numpy().max()) * CLOSEST_POINT_TOLERANCE * SPACING / rig.model.treatment.reach


def scale(force: np.ndarray) -> float:
    return float(np.abs(force).max())


@pytest.mark.parametrize(("bodies", "softening"), [(0, 1.0), (7, 1.0), (0, 1e6)])
def test_force_is_minus_the_gradient_of_the_energy(bodies: int, softening: float) -> None:
    """Differences over 2 s = 2e-10 m: (s/h)^2 of the forces from the third derivative, and EPSILON f h/s from
    round-off of lengths, EPSILON EI/h/s of angles. Softened by 1e6, the wires show their bending."""
    rig = two_rings(bodies, axial_softening=softening)
    x, s = deformed(rig), 1e-10
    force = rig.forces(x)
    assert bodies == 0 or np.count_nonzero(rig.state.pair_force.numpy()) > bodies
    error = contact_error(rig) if bodies else 0.0
    rounded = EPSILON * (SPACING * np.abs(force).sum() + rig.nodes * rig.model.bending_stiffness / SPACING) / s
    random = np.random.default_rng(3)
    for _ in range(10):
        way = random.choice([-1.0, 0.0, 1.0], x.shape)
        slope = (rig.stored_energy(x + s * way) - rig.stored_energy(x - s * way)) / (2 * s)
        tolerance = rounded + (s / SPACING) ** 2 * np.abs(force).sum() + 2 * bodies * error
        assert abs(slope + np.sum(force * way)) < tolerance < 1e-3 * scale(force)


@pytest.mark.parametrize("bodies", [0, 3])
def test_stiffness_is_symmetric(bodies: int) -> None:
    """Differences over 2 s: s^2/h^2 of EA/h and EPSILON h EA/h / s; with bodies s^2/reach^2 of the penalty, and the
    tolerance of the contact point over s, which has to be seen by the search: s = 5e-4 h."""
    rig = two_rings(bodies)
    x = deformed(rig)
    s = 5e-4 * SPACING if bodies else 1e-5 * SPACING
    hessian = rig.stiffness(x, s)
    axial = rig.model.axial_stiffness / SPACING
    tolerance = axial * ((s / SPACING) ** 2 + 100 * EPSILON * SPACING / s)
    if bodies:
        rig.forces(x)
        geometric = float(rig.state.pair_force.numpy().max()) / rig.model.treatment.reach
        tolerance += PENALTY * (s / rig.model.treatment.reach) ** 2 + contact_error(rig) / s
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
    turned = 2 * bodies * contact_error(rig) * rig.model.treatment.reach if bodies else 0.0
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


def flying_rings(bodies: int, phase: float) -> Rig:
    """Rings and bodies under way at 0.2 m/s; `phase` is a bound on w dt."""
    rig = two_rings(bodies)
    penalty = 1e4
    rig.mass[rig.nodes :] = 5.0 * rig.mass[0]
    rig.control(contact_stiffness=penalty, body_inverse_mass=1 / (5.0 * rig.mass[0]))
    rig.set_velocity(SPEED * np.random.default_rng(4).normal(size=rig.rest.shape) + [0.3, -0.1])
    stretch = 4 * rig.model.axial_stiffness / SPACING
    rig.set_time_step(phase / np.sqrt((stretch + 2 * penalty) / rig.mass[0]))
    return rig


def turned_by_contacts(rig: Rig, bodies: int, steps: int) -> float:
    """[N s] of all contacts over a flight, off their lines by the tolerance of the contact point, times its h."""
    force = 1e4 * 2 * DEPTH
    return 2 * bodies * force * steps * rig.time_step * CLOSEST_POINT_TOLERANCE * SPACING


@pytest.mark.parametrize("bodies", [0, 7])
def test_flight_keeps_its_momentum(bodies: int) -> None:
    """10^4 steps: round-off EPSILON m v a node and step; the contact points' tolerance turns a body by F h 1e-5 at
    most."""
    rig = flying_rings(bodies, phase=0.9)
    steps = 10_000
    seen = free_flight(rig, steps, 500)
    round_off = EPSILON * np.sum(rig.mass) * (SPEED + 0.3) * steps
    assert scale(seen["momentum"][0]) > 1e6 * round_off
    assert scale(seen["momentum"] - seen["momentum"][0]) < round_off
    turned = turned_by_contacts(rig, bodies, steps)
    assert scale(seen["angular"] - seen["angular"][0]) < round_off * RADIUS + turned
    assert turned < 0.2 * scale(seen["angular"])


def test_energy_only_ripples() -> None:
    """E = K + U with K the mean of the half steps around: E - E* = dt^2/4 sum m a^2, where E* = U + m v.v'/2 is kept to
    the next order. So E ripples by at most (w dt)^2/4, a quarter of it at half the step, and E* within 1 % of it."""
    ripple = []
    for phase, steps in ((0.4, 2000), (0.2, 4000)):
        rig = flying_rings(0, phase)
        seen = free_flight(rig, steps, steps // 200)
        inner = seen["energy"][0] - 0.5 * np.sum(rig.mass) * (0.3**2 + 0.1**2)  # without the flight of the whole
        assert np.ptp(seen["energy"]) < phase**2 / 4 * inner
        assert np.ptp(seen["kept"]) < 0.01 * np.ptp(seen["energy"])
        ripple.append(np.mean(seen["energy"] - seen["kept"]))
    assert ripple[0] / ripple[1] == pytest.approx(4, rel=0.4**2, abs=0)


def test_contacts_keep_the_energy() -> None:
    """10^4 steps of bodies that touch and part: the ripple (w dt)^2/4 of what they store, and what forces off their
    line to the contact point, by its tolerance over the reach, do along the way at the speed of a body."""
    rig = flying_rings(7, phase=0.2)
    steps = 10_000
    kept = free_flight(rig, steps, 100)["kept"]
    stored = 14 * 0.5 * 1e4 * DEPTH**2
    off_line = turned_by_contacts(rig, 7, steps) / rig.model.treatment.reach * SPEED
    assert np.ptp(kept) < 0.2**2 / 4 * stored + off_line < 0.02 * stored


def test_force_on_a_body_is_continuous_where_it_passes_a_node() -> None:
    """The curve has one tangent at a node, in a deformed state with any coefficients: from 1e-3 h before a node to as
    much behind it, the force changes by as much as along the next 1e-3 h on either side, to second order in those and
    to the tolerance of the contact point."""
    rig = two_rings(1)
    x = deformed(rig)
    apart = 1e-3 * SPACING
    for node in range(NODES):
        back, here, ahead = x[NODES + np.mod(node + np.arange(-1, 2), NODES)]
        along = (ahead - back) / np.hypot(*(ahead - back))
        inward = np.array([-along[1], along[0]])
        forces = []
        for share in (-100, -50, -3, -1, 1, 3):  # the first ones lead the contact point there
            y = x.copy()
            y[-1] = here + inward * (rig.model.treatment.reach - DEPTH) + share * apart * along
            forces.append(rig.forces(y)[-1])
        before, across, behind = np.diff(forces[2:], axis=0)
        kink = np.hypot(*(across - 0.5 * (before + behind)))
        assert kink < 0.6 * (np.hypot(*before) + np.hypot(*behind)) + 2 * contact_error(rig)
