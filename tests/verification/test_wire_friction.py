"""Friction between round wires: what sticks, what slips, and the laws of Coulomb and Euler-Eytelwein."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from reference.cases import slow
from reference.rods import SECTION, residual_of, set_masses, straight, update
from reference.touching import STIFFNESS, advance, line, plies, touching
from warpknit.results.row import Row, read_rows
from warpknit.runner.run import run_scene
from warpknit.scene import load_scene
from warpknit.scene.presets import HISTORY_INCREMENTS
from warpknit.spatial.rod_relaxation import RodRelaxation
from warpknit.spatial.rod_step import RodStepper
from warpknit.spatial.rods import rods_of
from warpknit.spatial.step_bound import largest_rates, stable_step
from warpknit.spatial.wire_contact import STICK_SHARE, WireContact

CELL = Path(__file__).parents[2] / "scenes" / "atlas_cell_spatial.toml"
ROUND_OFF = 1e-12
FRICTION, OVERLAP = 0.4, 0.02
ALONG = np.array([1.0, 0.0, 0.0])


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
        advance(contact, 1)
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


def drawn_across(is_relaxation: bool) -> tuple[WireContact, Callable[[float, float], np.ndarray]]:
    """A contact of overlap 0.02, and a function that moves the upper wire by a way along x and up by a height, and returns the
    friction on the lower one, over mu N of overlap 0.02."""
    lower, upper = line([0, 0, 0], [2, 0, 0], 8), line([3.3, -5.2, 1 - OVERLAP], [0, 1.7, 0], 8)
    stepper, contact = touching([lower, upper], friction=FRICTION)
    state, is_upper, step = stepper.state, np.arange(16)[:, None] >= 8, 0.01
    set_masses(stepper, 1e12, 1e12)
    stepper.set_time_step(step)
    state.steering.set(drive=float(not is_relaxation))

    def friction_after(way: float, height: float = 0.0) -> np.ndarray:
        steps = max(round(abs(way) / step), 1)
        state.velocity.assign(np.where(is_upper, np.array([way, 0.0, height]) / (steps * step), 0.0))
        advance(contact, steps)
        stepper.evaluate()
        return contact.read_contacts().friction.sum(axis=0) / (FRICTION * STIFFNESS * OVERLAP)

    return contact, friction_after


@pytest.mark.parametrize("is_relaxation", [True, False])
def test_slip_to_and_fro_within_an_increment_cancels(is_relaxation: bool) -> None:
    """A heavy wire is drawn across another by s = 1, lifted off, drawn back by s/2 and let down; s/60 is above mu N/k_t.

    Within an increment of a relaxation friction is mu N against the whole slip since its beginning, s - s/2. In real time slip is
    that since the wires touch again, here none.
    """
    contact, friction_after = drawn_across(is_relaxation)
    assert FRICTION * OVERLAP / STICK_SHARE < 1.0 / 60
    assert friction_after(1.0) == pytest.approx(ALONG, abs=1e-6)
    for way, height in ((0.01, 2 * OVERLAP), (-0.51, 0.0), (0.0, -2 * OVERLAP)):
        friction = friction_after(way, height)
    assert friction == pytest.approx(ALONG if is_relaxation else np.zeros(3), abs=1e-6)
    assert friction_after(-0.25) == pytest.approx(ALONG if is_relaxation else -ALONG, abs=1e-6)
    contact.advance_history()
    assert friction_after(-0.1) == pytest.approx(-ALONG, abs=1e-6)


def test_an_increment_begins_with_the_elastic_slip_of_the_equilibrium_before() -> None:
    """Return mapping: a wire drawn across another under 2 N and accepted under N is held by mu N. Back by x it is held by
    mu N - k_t x, whatever way and height it came by, lifted off or not, and by -mu N from 2 mu N/k_t on."""
    contact, friction_after = drawn_across(True)
    friction_after(1.0, -OVERLAP)
    assert friction_after(0.0, OVERLAP) == pytest.approx(ALONG, abs=1e-6)
    contact.advance_history()
    elastic = FRICTION * OVERLAP / STICK_SHARE
    assert friction_after(0.0, 2 * OVERLAP) == pytest.approx(np.zeros(3))
    assert friction_after(0.0, -2 * OVERLAP) == pytest.approx(ALONG, abs=1e-6)
    assert friction_after(0.5) == pytest.approx(ALONG, abs=1e-6)
    for back in (0.0, 0.5, 1.0, 1.5, 2.5):
        friction = friction_after(-0.5 - back * elastic if back == 0.0 else -0.5 * elastic if back < 2.0 else -elastic)
        assert friction == pytest.approx(max(1.0 - back, -1.0) * ALONG, abs=1e-6)


@pytest.mark.parametrize("is_searched", [True, False])
@pytest.mark.parametrize("slip", [0.5, 5.0])  # of mu N/k_t: sticks, and slips
def test_friction_turns_with_wires_that_turn_about_their_contact(slip: float, is_searched: bool) -> None:
    """Wires that turn as one by 70 degrees about the contact normal turn their friction, in any number of increments."""
    contact, friction_after = drawn_across(True)
    friction = friction_after(slip * FRICTION * OVERLAP / STICK_SHARE)
    stepper, angle, center = contact.stepper, np.radians(7.0), np.array([4.0, 1.0, 0.0])
    turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    start, unit = stepper.rods.position + stepper.state.displacement.numpy() - center, FRICTION * STIFFNESS * OVERLAP
    for increment in range(1, 11):
        contact.advance_history()
        stepper.place(start @ np.linalg.matrix_power(turn, increment).T + center)
        if is_searched:  # the other one of the two kernels of contact forces
            contact.search()
        stepper.evaluate()
        friction = turn @ friction
        assert contact.read_contacts().friction.sum(axis=0) / unit == pytest.approx(friction, abs=1e-6)


def test_friction_dissipates_what_slips_beyond_the_limit() -> None:
    """mu N times the way less mu N/k_t: the first way from rest leaves that much elastic slip, one that goes on from there none,
    one back takes it up twice; a way that sticks dissipates nothing."""
    contact, friction_after = drawn_across(True)
    force, elastic = FRICTION * STIFFNESS * OVERLAP, FRICTION * OVERLAP / STICK_SHARE
    expected = 0.0
    for way, slips in ((1.0, 1.0 - elastic), (0.5, 0.5), (-0.7, 0.7 - 2 * elastic), (0.5 * elastic, 0.0)):
        friction_after(way)
        contact.advance_history()
        expected += force * slips
        assert contact.dissipated == pytest.approx(expected, rel=1e-6)
    kept = contact.state_dict()
    contact.dissipated[:] = 0.0
    contact.load_state_dict(kept)
    assert contact.dissipated == pytest.approx(expected, rel=1e-6)


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
    to = (1.0 + strain, 0.0, 0.0, 1.0, 1.0)
    state.steering.set(ramp_from=(1.0, 0.0, 0.0, 1.0, 1.0), ramp_to=to, ramp_steps=float(steps))
    contact.search()
    advance(contact, steps + 20)
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
    stepper.state.set_load(load)
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
    step, count = state.steering.time_step, 4000
    mass = float(state.node_mass.numpy()[80:, 0].sum())
    if share < 1:
        stepper.set_time_step(step, damping=0.2 * np.sqrt(STICK_SHARE * STIFFNESS / mass))
        advance(contact, count)
        moved = state.displacement.numpy()[80:, 0].mean()
        advance(contact, count)
        assert state.displacement.numpy()[80:, 0].mean() == pytest.approx(moved, rel=1e-6, abs=0)
        along = -contact.read_contacts().friction[:, 0].sum()  # the rails are the first of each pair
        assert along == pytest.approx(-np.sin(slope), rel=1e-6, abs=0)
    else:
        advance(contact, count)
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
    step, count = state.steering.time_step, 4000
    advance(contact, count)
    speed, spin = state.velocity.numpy()[80:, 0].mean(), np.abs(state.spin.numpy()[80:83]).mean()
    expected = np.sin(slope) / (mass + inertia / 0.5**2) * step * count
    assert inertia == pytest.approx(0.5 * mass * 0.5**2)
    assert speed == pytest.approx(expected, rel=0.03)
    assert spin * 0.5 == pytest.approx(speed, rel=0.05)


FRICTION_ROUND, BIG, THIN, LOW, CAPSTAN_STIFFNESS = 0.3, 20.0, 1.0, 1.0, 200.0
CAPSTAN_RADIUS = 0.5 * (BIG + THIN)


def capstan(*, is_drawn: bool) -> tuple[RodStepper, WireContact, float, float]:
    """A wire half round a thicker one, its first end under LOW, its last end held where it is drawn; the exponent of T2/T1 and
    its error.

    T2/T1 = exp(mu wrap), short of it by the share r/R of the thin wire's own radius: friction acts at r from the centre line that
    is bent to R, so its couple m = r f needs a shear force Q = -r f in a wire without bending stiffness, with which
    T' = f (1 - r/R) and f = mu (T/R + Q'): the exponent is mu (1 - r/R)/(1 + mu^2 r/R) to first order in r/R. Bending takes
    B/2R^2 from the tension where the wire begins to bend.
    """
    section = replace(SECTION, bending_stiffness=1e-3 * SECTION.bending_stiffness, twist_stiffness=1e-3 * SECTION.twist_stiffness)
    half, tail = 0.5 * np.pi * CAPSTAN_RADIUS, 6.0
    arc = np.arange(-half - tail, half + tail)
    angle = np.clip(arc, -half, half) / CAPSTAN_RADIUS
    beyond = arc - np.clip(arc, -half, half)
    x = CAPSTAN_RADIUS * np.sin(angle) + beyond * np.cos(angle)
    y = CAPSTAN_RADIUS * np.cos(angle) - beyond * np.sin(angle)
    wire = np.stack([x, y, 0 * x], axis=1)
    rods = straight(rods_of(section, [line([0, 0, -150], [0, 0, 30], 11), wire]))
    held = [*range(11), *([10 + len(wire)] if is_drawn else [])]
    rods = rods.holding(held, range(11 + len(wire)))
    vars(rods)["wire_radius"] = np.array([0.5 * BIG, 0.5 * THIN])  # masses allow for contacts of wires as thin as the thin one
    stepper = RodStepper(rods)
    contact = WireContact(stepper, CAPSTAN_STIFFNESS, friction=FRICTION_ROUND)
    lever, bent = 0.5 * THIN / CAPSTAN_RADIUS, 0.5 * section.bending_stiffness / CAPSTAN_RADIUS**2
    law = FRICTION_ROUND * np.pi * (1 - lever) / (1 + FRICTION_ROUND**2 * lever)
    return stepper, contact, law, law * lever**2 + bent / LOW * (1 - np.exp(-law))


def pull_ends(stepper: RodStepper, high: float) -> None:
    """Put LOW on the first end of the wire of a capstan, and `high` on the last one."""
    wire = stepper.rods.position[11:]
    load = np.zeros((stepper.rods.node_count, 3))
    load[11], load[-1] = LOW * (wire[0] - wire[1]), high * (wire[-1] - wire[-2])
    stepper.state.set_load(load)


def relaxed(rest: RodRelaxation, contact: WireContact, checks: int = 100) -> bool:
    """Whether a capstan comes to rest within so many checks of 25 steps."""
    for _ in range(checks):
        advance(contact, 25)
        update(rest)
        rest.masses.renew()
        rest.damping.keep_motion(rest.stepper.rows)
        if residual_of(rest) < 1e-4 * LOW:
            return True
    return False


@pytest.mark.parametrize("increments", [1, *slow(4)])
def test_capstan(increments: int) -> None:
    """T2/T1 = exp(mu wrap), see `capstan`.

    One end bears T1, the other is drawn out, and then let back, by more than the wire stretches and contacts give way. Each
    increment goes twice as far at first and comes back: friction is that of the whole slip.
    """
    stepper, contact, law, error = capstan(is_drawn=True)
    state, wire = stepper.state, stepper.rods.position[11:]
    pull_ends(stepper, 0.0)
    contact.search()
    rest = RodRelaxation(stepper)

    def drawn_by(way: float) -> float:
        """Tension at the end that is drawn out so far, after an increment."""
        rest.stop_motion()
        for part in [0.1 * way] * 20 + [-0.1 * way] * 10:
            displacement = state.displacement.numpy()
            displacement[-1] += part * (wire[-1] - wire[-2])
            state.displacement.assign(displacement)
            contact.search()
            advance(contact, 10)
        assert relaxed(rest, contact)
        contact.advance_history()
        return float(np.linalg.norm(stepper.state.edge_force.numpy()[-2]))

    most = LOW * np.exp(law)
    stretch = most * (len(wire) / SECTION.axial_stiffness + FRICTION_ROUND / (STICK_SHARE * CAPSTAN_STIFFNESS))
    assert stretch < 0.1 / increments
    drawn_by(0.0)
    for way, sign in ((0.1, 1.0), (-0.1, -1.0)):
        for _ in range(increments):
            high = drawn_by(way / increments)
            assert np.log(high / LOW) == pytest.approx(sign * law, abs=error)


@pytest.mark.parametrize("share", [0.95, 1.05])
def test_a_capstan_holds_up_to_its_law_and_runs_off_beyond(share: float) -> None:
    """Both ends bear weights. Of a wire that holds they rest where it has stretched; of one that slips the heavier runs off."""
    stepper, contact, law, error = capstan(is_drawn=False)
    assert error < 0.04 * law
    contact.search()
    rest = RodRelaxation(stepper)
    for part in (0.0, 0.5, 0.9):
        pull_ends(stepper, LOW * np.exp(part * law))
        assert relaxed(rest, contact)
        contact.advance_history()
    pull_ends(stepper, LOW * np.exp(share * law))
    assert relaxed(rest, contact) == (share < 1.0)
    moved = np.linalg.norm(stepper.state.displacement.numpy()[-1])
    assert moved < 0.02 if share < 1.0 else moved > 0.1


@pytest.mark.slow
def test_what_a_mesh_does_not_store_is_dissipated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A double atlas is stretched by 10 %, let back to 5 % and stretched again: the work of the cycle is what contacts lose, a
    third of the largest stored energy. Forces at the end of an increment act on all of its slip, an error of first order."""
    monkeypatch.setitem(HISTORY_INCREMENTS, "draft", 0.005)
    balance = []
    for frames in (10, 40):
        options = [
            "contact.friction=0.3", "path=[{strain_weft=0.05, strain_warp=0.05}, {strain_weft=0.1, strain_warp=0.1}]",
            f"output.frames={frames}", "output.usd=false", "output.figures=false",
        ]  # fmt: skip
        out = tmp_path / str(frames)
        balance.append(run_scene(load_scene(CELL, options, "draft"), out=out, device="cpu").summary.json()["quality"])
        rows = read_rows(out / "history.csv", Row)
        assert rows[-1].dissipated_J > 0.25 * max(row.stored for row in rows)
    coarse, fine = (abs(one["energy_balance_of_stored"]) for one in balance)
    assert coarse < 0.03
    assert fine < 0.7 * coarse
