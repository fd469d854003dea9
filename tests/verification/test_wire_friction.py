"""Friction between round wires: what sticks, what slips, and the laws of Coulomb and Euler-Eytelwein."""

from dataclasses import replace

import numpy as np
import pytest

from reference.rods import SECTION, residual_of, set_masses, update
from reference.touching import STIFFNESS, line, plies, touching
from warpknit.kernels import control as c
from warpknit.spatial.rod_relaxation import RodRelaxation
from warpknit.spatial.rod_step import RodStepper
from warpknit.spatial.rods import rods_of, straight
from warpknit.spatial.step_bound import largest_rates, stable_step
from warpknit.spatial.wire_contact import STICK_SHARE, WireContact

ROUND_OFF = 1e-12


def test_contact_with_friction_has_no_net_force_and_moment() -> None:
    """Normal force, friction at the surfaces, its couples and torques: their sums vanish over both wires."""
    rng = np.random.default_rng(2)
    stepper, contact = touching([line([0, 0, 0], [2, 0, 0], 6), line([4.3, -4.2, 0.7], [0.5, 2, 0.1], 6)], friction=0.4)
    state = stepper.state
    state.velocity.assign(rng.normal(size=(12, 3)))
    state.spin.assign(rng.normal(size=12))
    stepper.set_time_step(1e-3)
    stepper.step(1)
    moved = stepper.rods.position + state.displacement.numpy()
    stepper.place(moved)
    touch = contact.read_contacts()
    assert 0.0 < np.linalg.norm(touch.friction) <= 0.4 * touch.force[0]
    force, torque = stepper.forces()
    tangent = state.tangent.numpy()
    has_segment = (stepper.rods.following >= 0)[:, None]
    moment = np.cross(moved, force).sum(axis=0) + np.where(has_segment, torque[:, None] * tangent, 0.0).sum(axis=0)
    assert np.abs(force.sum(axis=0)).max() < 1e3 * ROUND_OFF * touch.force[0]
    assert np.abs(moment).max() < 1e4 * ROUND_OFF * touch.force[0]


def test_what_sticks_is_remembered_over_searches() -> None:
    """A contact that has stuck half way to its limit pulls back as before, whatever else has come into the list since: to the
    bit, as nothing has moved."""
    far = line([0, 60, 0], [2, 0, 0], 6)
    stepper, contact = touching([line([0, 0, 0], [2, 0, 0], 6), line([4.3, -4.2, 0.9], [0, 2, 0], 6), far], friction=0.5)
    state = stepper.state
    state.velocity.assign(np.where(np.arange(18)[:, None] // 6 == 1, [1.0, 0.0, 0.0], 0.0))
    stepper.set_time_step(0.02)
    stepper.step(1)
    stepper.evaluate()
    before = contact.read_contacts()
    assert 0.0 < np.linalg.norm(before.friction) < 0.5 * before.force[0]
    moved = state.displacement.numpy().copy()
    for where in ([0.0, -60.0, 2.1], [0.0, 0.0, 0.0]):  # the third wire comes near, and goes again
        state.displacement.assign(moved + np.where(np.arange(18)[:, None] // 6 == 2, where, 0.0))
        contact.search()
        stepper.evaluate()
        after = contact.read_contacts()
        assert np.array_equal(after.friction, before.friction) and np.array_equal(after.force, before.force)


def test_friction_is_steady_from_segment_to_segment() -> None:
    """A wire too heavy to be slowed or to roll is drawn across another, over nodes of both: once the contact has given way by
    mu N/k_t, friction is mu N, along the way of the one over the other."""
    friction, overlap, speed = 0.4, 0.02, np.array([1.0, 0.35, 0.0])
    lower, upper = line([0, 0, 0], [2, 0, 0], 8), line([3.3, -5.2, 1 - overlap], [0.3, 1.7, 0], 8)
    stepper, contact = touching([lower, upper], friction=friction)
    state = stepper.state
    set_masses(stepper, 1e12, 1e12)
    state.velocity.assign(np.where(np.arange(16)[:, None] < 8, 0.0, speed))
    stepper.set_time_step(0.01)
    segments, pulls = set(), []
    for _ in range(500):
        contact.advance(1)
        stepper.evaluate()
        found = contact.read_contacts()
        segments.add((int(found.first[0]), int(found.second[0])))
        pulls.append(found.friction.sum(axis=0))
    steady = np.array(pulls)[20:]
    assert len(segments) >= 4
    assert len({first for first, _ in segments}) >= 3
    assert len({second for _, second in segments}) >= 2
    assert overlap * friction / STICK_SHARE < 20 * 0.01
    expected = friction * STIFFNESS * overlap * speed / np.linalg.norm(speed)
    assert np.abs(steady - expected).max() < 1e-6 * np.linalg.norm(expected)


@pytest.mark.parametrize("is_relaxation", [True, False])
def test_slip_to_and_fro_within_an_increment_cancels(is_relaxation: bool) -> None:
    """A heavy wire is drawn across another by s = 1, and back by s/2, thirty elastic slips mu N/k_t.

    Within an increment of a relaxation friction stays mu N against the whole slip since its beginning, s - s/2; in real time it
    turns. It turns in the next increment: back by s/4 is sixteen elastic slips.
    """
    friction, overlap, step, speed = 0.4, 0.02, 0.01, np.array([1.0, 0.0, 0.0])
    stepper, contact = touching(
        [line([0, 0, 0], [2, 0, 0], 8), line([3.3, -5.2, 1 - overlap], [0, 1.7, 0], 8)], friction=friction
    )
    state, upper = stepper.state, np.arange(16)[:, None] >= 8
    set_masses(stepper, 1e12, 1e12)
    stepper.set_time_step(step)
    unchanged = {begin + k: 1.0 for begin in (c.FROM, c.TO) for k in (0, 3, 4)}
    state.write_control(unchanged | {c.DRIVE: float(not is_relaxation)})
    assert friction * overlap / STICK_SHARE < 1.0 / 60

    def pull_after(way: float) -> np.ndarray:
        """Friction on the wire below, over mu N, after so much way."""
        state.velocity.assign(np.where(upper, np.sign(way) * speed, 0.0))
        contact.advance(round(abs(way) / step))
        stepper.evaluate()
        return contact.read_contacts().friction.sum(axis=0) / (friction * STIFFNESS * overlap)

    state.write_control({c.RAMP_STEP: 0.0, c.RAMP_STEPS: 500.0})
    assert pull_after(1.0) == pytest.approx(speed, abs=1e-6)
    assert pull_after(-0.5) == pytest.approx(speed if is_relaxation else -speed, abs=1e-6)
    state.write_control({c.RAMP_STEP: 0.0})
    assert pull_after(-0.25) == pytest.approx(-speed, abs=1e-6)


def test_wires_that_the_load_carries_over_each_other_stick_and_slip() -> None:
    """A wire has slid along another by a; then the load strains both by e along it, and nothing moves beside that. What the two
    have at one place are carried from places a/F apart, so they slip by a log(1 + e), to the square of the strain a step."""
    slid, strain, steps = 10.0, 5e-4, 100
    rods = rods_of(SECTION, [line([0, 0, 0], [2, 0, 0], 20), line([3.3, -5.2, 0.98], [0.3, 1.7, 0], 8)])
    stepper = RodStepper(rods.holding(range(28), range(28)))
    contact = WireContact(stepper, STIFFNESS, friction=0.4)
    state = stepper.state
    state.displacement.assign(np.where(np.arange(28)[:, None] < 20, 0.0, [slid, 0.0, 0.0]))
    stepper.set_time_step(0.01)
    ramp = {c.FROM: 1.0, c.FROM + 3: 1.0, c.FROM + 4: 1.0, c.TO: 1.0 + strain, c.TO + 3: 1.0, c.TO + 4: 1.0}
    state.write_control(ramp | {c.RAMP_STEPS: float(steps)})
    contact.search()
    contact.advance(steps + 20)
    stepper.evaluate()
    expected = [STICK_SHARE * STIFFNESS * slid * np.log(1.0 + strain), 0.0, 0.0]
    found = contact.read_contacts()
    assert np.linalg.norm(found.friction) < 0.4 * found.force[0]
    assert np.abs(np.abs(found.friction[0]) - expected).max() < strain * expected[0]
    assert found.friction[0, 0] < 0.0  # the wire below goes on ahead of the one on it


def test_sections_that_stick_to_a_hard_surface_come_to_rest() -> None:
    """Friction of 50 times the stiffness of bending turns the sections to and fro unless their inertia reckons with it; then 1e-5
    is left, against 2e-2."""
    contact, rest, _ = plies(1.0, hardness=100.0, friction=0.3)
    assert residual_of(rest) < 1e-4 * contact.read_contacts().force.sum()


def wire_on_rails(slope: float, friction: float, rolls: bool) -> tuple[RodStepper, WireContact]:
    """A stiff short wire across two held rails that are inclined by `slope` [rad], with its weight on it."""
    rails = [line([-1, y, 0], [2, 0, 0], 40) for y in (-2.0, 2.0)]
    weight = 1.0
    overlap = 0.5 * weight * np.cos(slope) / STIFFNESS
    wire = line([2.3, -3.0, 1.0 - overlap], [0, 2, 0], 4)
    rods = rods_of(SECTION, [*rails, wire])
    rods = rods.holding(range(80), range(80) if rolls else range(84))
    stepper = RodStepper(rods)
    contact = WireContact(stepper, STIFFNESS, friction=friction)
    load = np.zeros((84, 3))
    load[80:] = weight / 4 * np.array([np.sin(slope), 0.0, -np.cos(slope)])
    stepper.state.load_force.assign(load)
    state = stepper.state
    rates = largest_rates(rods, state.node_mass.numpy()[:, 0], state.spin_inertia.numpy(), contact_stiffness=STIFFNESS)
    stepper.set_time_step(0.5 * stable_step(rates))
    contact.search()
    return stepper, contact


@pytest.mark.parametrize("share", [0.97, 1.03])
def test_wire_on_an_incline_slips_at_the_friction_angle(share: float) -> None:
    """tan(slope) < mu: it comes to rest where friction carries W sin; above it slides with g (sin - mu cos).

    The load comes on at once: the contact first gives way by W sin/(2 k_t), which makes the wire late by less than twice the
    time that takes, and swings, which 0.2 of the critical damping takes out.
    """
    friction = 0.4
    slope = np.arctan(share * friction)
    stepper, contact = wire_on_rails(slope, friction, rolls=False)
    state = stepper.state
    step, count = float(state.read_control()[int(c.TIME_STEP)]), 4000
    mass = float(state.node_mass.numpy()[80:, 0].sum())
    if share < 1:
        stepper.set_time_step(step, damping=0.2 * np.sqrt(STICK_SHARE * STIFFNESS / mass))
        contact.advance(count)
        moved = state.displacement.numpy()[80:, 0].mean()
        contact.advance(count)
        assert state.displacement.numpy()[80:, 0].mean() == pytest.approx(moved, rel=1e-6, abs=0)
        along = -contact.read_contacts().friction[:, 0].sum()  # the rails are the first of each pair
        assert along == pytest.approx(-np.sin(slope), rel=1e-6, abs=0)
    else:
        contact.advance(count)
        expected = (np.sin(slope) - friction * np.cos(slope)) / mass * (step * count)
        late = np.sqrt(2 * np.sin(slope) / (2 * STICK_SHARE * STIFFNESS) / (np.sin(slope) / mass))
        speed = state.velocity.numpy()[80:, 0].mean()
        assert abs(speed - expected) < (np.sin(slope) / mass) * 2 * late + 0.02 * expected


def test_wire_rolls_down_rails_where_friction_holds_it() -> None:
    """Free to spin it rolls without slip: acceleration g sin/(1 + I/(m r^2)) with the spin of a solid cylinder, I = m r^2/2."""
    slope = 0.1
    stepper, contact = wire_on_rails(slope, 2.0, rolls=True)
    state = stepper.state
    mass = float(state.node_mass.numpy()[80:, 0].sum())
    inertia = float(state.spin_inertia.numpy()[80:83].sum())
    step, count = float(state.read_control()[int(c.TIME_STEP)]), 4000
    contact.advance(count)
    speed, spin = state.velocity.numpy()[80:, 0].mean(), np.abs(state.spin.numpy()[80:83]).mean()
    expected = np.sin(slope) / (mass + inertia / 0.5**2) * step * count
    assert inertia == pytest.approx(0.5 * mass * 0.5**2)
    assert speed == pytest.approx(expected, rel=0.03)
    assert spin * 0.5 == pytest.approx(speed, rel=0.05)


def capstan(share: float, friction: float, wrap: float) -> float:
    """How far a thin wire slides round a thick held one, `wrap` [rad], under end loads in the ratio exp(mu wrap share), in
    diameters of the thin one."""
    big, thin, spacing = 20.0, 1.0, 1.0
    section = replace(SECTION, bending_stiffness=1e-3 * SECTION.bending_stiffness, twist_stiffness=1e-3 * SECTION.twist_stiffness)
    core = line([0, 0, -150], [0, 0, 30], 11)
    radius = 0.5 * (big + thin)
    half = 0.5 * wrap * radius
    tail = 6.0
    arc = np.arange(-half - tail, half + tail, spacing)
    angle = np.clip(arc, -half, half) / radius
    beyond = arc - np.clip(arc, -half, half)
    x = radius * np.sin(angle) + beyond * np.cos(angle)
    y = radius * np.cos(angle) - beyond * np.sin(angle)
    wire = np.stack([x, y, 0 * x], axis=1)
    rods = straight(rods_of(section, [core, wire]))
    rods = replace(rods, thicker=np.array([0.5 * big, 0.5 * thin])).holding(range(11), range(11 + len(wire)))
    stepper = RodStepper(rods)
    stiffness = 200.0
    contact = WireContact(stepper, stiffness, friction=friction)
    pull = 1.0
    load = np.zeros((rods.node_count, 3))
    ends = (wire[0] - wire[1]) / spacing, (wire[-1] - wire[-2]) / spacing
    low, high = pull, pull * np.exp(friction * wrap * share)
    contact.search()
    rest = RodRelaxation(stepper)
    # both ends pulled alike first, then one more and more: a slow way to the ratio
    way = []
    for now in np.append(np.linspace(low, high, 12), [high, high]):
        load[11], load[-1] = low * ends[0], now * ends[1]
        stepper.state.load_force.assign(load)
        for _ in range(6):
            contact.advance(50)
            update(rest)
        way.append(float(stepper.state.displacement.numpy()[-1] @ ends[1]))
    return way[-1] - way[-2]


def test_capstan() -> None:
    """T2/T1 = exp(mu wrap) of a wire round a thicker one, short of it by the share r/R of the thin wire's own radius.

    Friction acts at r from the centre line that is bent to R, so its couple m = r f needs a shear force Q = -r f in a wire
    without bending stiffness, with which T' = f (1 - r/R) and f = mu (T/R + Q'): the exponent is mu (1 - r/R)/(1 + mu^2 r/R)
    to first order.
    """
    friction, wrap, lever = 0.3, np.pi, 0.5 / 10.5
    law = (1 - lever) / (1 + friction**2 * lever)
    assert law > 0.94
    stays, slides = (abs(capstan(share * law, friction, wrap)) for share in (0.97, 1.03))
    assert stays < 2e-4 < 2e-3 < slides
