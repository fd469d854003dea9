"""The curve on which wires touch: where it is at rest, its forces, and two contacts of one pair of segments."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import minimize

from reference.cases import slow
from reference.rods import SECTION, Pose, set_masses
from reference.touching import advance
from warpknit.spatial.contact_arrays import Contacts
from warpknit.spatial.rest_curve import FIT_PLACES, CentreLine, fit_rest_curve
from warpknit.spatial.rods import Rods, rods_of
from warpknit.spatial.wire_contact import WireContact

STIFFNESS = 100.0  # [N/m]


def looped(s: np.ndarray) -> np.ndarray:
    """A wire that turns sharply, in the plane and out of it, after every few of its nodes."""
    return np.stack([s + 1.5 * np.sin(0.9 * s), 2.0 * np.cos(0.7 * s), 0.8 * np.sin(1.1 * s)], axis=-1)


def across(s: np.ndarray) -> np.ndarray:
    """Another that passes over the middle of the first, a little nearer than wires of diameter 1 are thick."""
    return np.stack([8.7 + 0.5 * np.sin(0.8 * s) - 0.5, s - 8.3 + 0.4 * np.cos(s), 1.65 + 0.1 * s * np.sin(s)], axis=-1)


def line_of(*curves: np.ndarray, nodes: int, step: float) -> tuple[Rods, CentreLine]:
    """Rods along curves, with nodes at multiples of `step`, and their true centre lines."""
    s = np.arange(nodes) * step
    slope = np.concatenate([(f(s + 1e-5) - f(s - 1e-5)) / 2e-5 for f in curves])
    between = np.concatenate([f(s[:, None] + FIT_PLACES * step) - f(s)[:, None] for f in curves])
    return rods_of(SECTION, [f(s) for f in curves]), CentreLine(slope, between, np.full(len(slope), step))


def hooked(
    angle: float, bow: float, gap: float, *, lean: float = 0.0, along: float = 0.0, off: float = 0.0
) -> tuple[Rods, CentreLine]:
    """Two wires that hook each other as in a knit: side by side at the distance `gap`, bowed towards each other's ends with the
    curvature `bow`, and crossing over and under with the slopes +- `angle`, `along` from the middle of a segment of length 3 of
    each, and `off` farther on the second. Where they `lean`, they are nearer to each other on one side of that than on the
    other."""

    def wire(side: float) -> Callable[[np.ndarray], np.ndarray]:
        def at(s: np.ndarray) -> np.ndarray:
            x = s - 7.5 - along - (off if side > 0.0 else 0.0)
            return np.stack([x, side * 0.5 * (gap + lean * x - bow * x**2), side * np.tan(angle) * x], axis=-1)

        return at

    return line_of(wire(-1.0), wire(1.0), nodes=6, step=3.0)


def contact_of(rods: Rods, line: CentreLine | None) -> tuple[Pose, WireContact]:
    pose = Pose(rods)
    contact = WireContact(pose.stepper, STIFFNESS, curve=None if line is None else fit_rest_curve(rods, line))
    contact.search()
    pose.stepper.evaluate()
    return pose, contact


def test_the_curve_is_the_centre_line_at_rest() -> None:
    """The distance that contact sees between two wires is that of their true centre lines, within what the fit says it misses,
    and the error goes down with the sixth power of the spacing; through the nodes alone it is off by far more."""
    true = min(
        float(minimize(lambda u: np.linalg.norm(looped(u[:1])[0] - across(u[1:])[0]), [s, t]).fun)
        for s in np.arange(4, 14, 1.0)
        for t in np.arange(4, 12, 1.0)
    )
    errors = []
    for step, nodes in ((1.3, 14), (0.65, 28)):
        rods, line = line_of(looped, across, nodes=nodes, step=step)
        nearest = [1.0 - contact_of(rods, given)[1].read_contacts(0.5).overlap.max() for given in (line, None)]
        errors.append(abs(nearest[0] - true))
        assert errors[-1] < fit_rest_curve(rods, line).fit_error
        assert errors[-1] < abs(nearest[1] - true) / 20
    assert errors[1] < errors[0] / 2**4


def gradient_error(pose: Pose, contact: WireContact) -> tuple[float, float]:
    """Largest difference between the forces and torques of contact at a pose and central differences of its energy, over the
    largest of them, and the largest torque over that."""
    nodes, torques = pose.rods.node_count, int(pose.has_segment.sum())

    def contact_energy(move: np.ndarray, turn: np.ndarray) -> float:
        pose.at(move, turn)
        found = contact.read_contacts()
        return float(0.5 * np.sum(found.force * found.overlap))

    still, none = np.zeros((nodes, 3)), np.zeros(nodes)
    pushed, turned = pose.at(still, none)[1:]
    pose.stepper.state.contact_penalty.fill_(0.0)
    free, free_turned = pose.at(still, none)[1:]
    pose.stepper.state.contact_penalty.fill_(STIFFNESS)
    wanted = pose.join(pushed - free, turned - free_turned)
    step, found = 1e-5, np.zeros(pose.unknowns())
    for k in range(len(found)):
        way = np.zeros(len(found))
        way[k] = step
        found[k] = -(contact_energy(*pose.split(way)) - contact_energy(*pose.split(-way))) / (2 * step)
    size = np.abs(wanted).max()
    return float(np.abs(wanted - found).max() / size), float(np.abs(wanted[-torques:]).max() / size)


def test_contact_on_the_curve_is_the_gradient_of_its_energy() -> None:
    """Forces on nodes and torques on sections of a bent and twisted pose, by central differences of k o^2/2."""
    rods, line = line_of(looped, across, nodes=14, step=1.3)
    pose, contact = contact_of(replace(rods, sections=(replace(SECTION, thickness=1.2),) * 2), line)
    rng = np.random.default_rng(5)
    pose.bend_by(0.02 * rng.normal(size=(28, 3)), np.where(pose.has_segment, 0.2 * rng.normal(size=28), 0.0))
    pose.at(np.zeros((28, 3)), np.zeros(28))
    assert contact.read_contacts().force.max() > 0.05 * STIFFNESS
    error, torque = gradient_error(pose, contact)
    assert error < 1e-6
    assert torque > 1e-3  # sections feel it


def test_two_contacts_and_the_saddle_between_them_are_the_gradient_of_their_energy() -> None:
    """k (o_a^2 + o_b^2 - o_c^2)/2, shortly before they become one: the distance between them goes with the root of what is left,
    which makes the differences ten times as wrong as those of one contact."""
    pose, contact = contact_of(*hooked(float(np.arctan(0.99 * np.sqrt(0.4 * 0.9))), 0.8, 0.9))
    assert (contact.read_contacts().force > 0.0).sum() == 2
    assert (contact.read_contacts().force < 0.0).sum() == 1
    assert gradient_error(pose, contact)[0] < 1e-5


def touch(angle: float, bow: float, gap: float, **where: float) -> Contacts:
    """Contacts of two wires of diameter 1 that hook each other."""
    return contact_of(*hooked(angle, bow, gap, **where))[1].read_contacts()


@pytest.mark.parametrize(
    ("share", "along"), [(0.3, 0.0), (0.6, 0.0), (0.9, 0.0), (0.6, -0.5), (0.6, 0.5), (0.9, -0.9), (0.9, 0.9)]
)
def test_wires_that_hook_at_a_small_angle_touch_twice_within_a_segment(share: float, along: float) -> None:
    """The distance of y = +-(gap - bow x^2)/2, z = +-tan(angle) x is least at two places, where gap - bow x^2 =
    2 tan(angle)^2/bow, while that is less than the gap: wherever on a segment both of them are."""
    bow, overlap = 0.8, 0.02
    level = share * 0.9
    tangent = np.sqrt(0.5 * bow * level)
    beside = ((1.0 - overlap) ** 2 - level**2) / (4 * tangent**2)  # x^2 at which they are that near
    found = touch(float(np.arctan(tangent)), bow, level + bow * beside, along=along)
    pushes = found.force > 0.0
    assert pushes.sum() == 2
    assert found.overlap[pushes] == pytest.approx(np.full(2, overlap), rel=1e-4)
    assert (3.0 * found.place[pushes, 0] - 1.5 - along) ** 2 == pytest.approx(np.full(2, beside), rel=1e-3)


def push(found: Contacts) -> np.ndarray:
    """(3,) what the first wire has of the second."""
    return (found.force[:, None] * found.normal).sum(axis=0)


def test_two_contacts_become_one_without_a_jump() -> None:
    """As the angle grows the two closest points run together, with the root of what is left of it, and the force of both goes
    over into that of one: steps of the angle a hundred times smaller make those of the force ten times smaller."""
    bow, gap = 0.8, 0.98
    last = np.sqrt(0.5 * bow * gap)  # tangent of the angle from which on they touch at one place
    jumps = []
    for width in (0.1, 0.001):
        pushes, count = [], []
        for share in np.linspace(1.0 - width, 1.0 + 0.2 * width, 31):
            found = touch(float(np.arctan(share * last)), bow, gap)
            pushes.append(float(np.linalg.norm(push(found))))
            count.append(int((found.force > 0.0).sum()))
        assert count[0] == 2
        assert count[-1] == 1
        assert pushes[-1] == pytest.approx(STIFFNESS * (1.0 - gap), rel=1e-6)
        jumps.append(np.abs(np.diff(pushes)).max())
    assert jumps[1] < 0.2 * jumps[0]


@pytest.mark.parametrize("along", [0.0, 1.35])
@pytest.mark.parametrize("share", [0.95, 0.99, 1.01])
def test_two_contacts_near_each_other_rub_as_what_both_press_with(share: float, along: float) -> None:
    """Drawn along each other by more than the contacts give way: two alike with a saddle between them are rubbed by mu times
    their forces less that of the saddle, as one of that force would be; also with one of them beyond a node."""
    bow, gap, friction, way = 0.8, 0.98, 0.01, 2e-3
    rods, line = hooked(float(np.arctan(share * np.sqrt(0.5 * bow * gap))), bow, gap, along=along)
    pose = Pose(rods)
    contact = WireContact(pose.stepper, STIFFNESS, friction=friction, curve=fit_rest_curve(rods, line))
    state = pose.stepper.state
    set_masses(pose.stepper, 1e15, 1e15)
    state.displacement.assign(np.where(np.arange(12)[:, None] < 6, [-0.5 * way, 0.0, 0.0], 0.0))
    state.velocity.assign(np.where(np.arange(12)[:, None] < 6, [way, 0.0, 0.0], 0.0))
    pose.stepper.set_time_step(0.025)
    contact.search()
    advance(contact, 20)
    pose.stepper.evaluate()
    found = contact.read_contacts()
    assert (found.force > 0.0).sum() == (2 if share < 1.0 else 1)
    assert -found.friction[:, 0].sum() == pytest.approx(friction * found.force.sum(), rel=0.02)


def test_a_curve_that_turns_onto_a_wire_touches_it() -> None:
    """The sections of an arc turn by half a turn while its nodes rest: what is fitted to the arc turns towards the chord.

    There is a wire, a tenth of the thickness away at the start.
    """
    bow, steps = 0.8, 200

    def arc(s: np.ndarray) -> np.ndarray:
        x = s - 7.5
        return np.stack([x, -0.5 * bow * x**2, 0.0 * x], axis=-1)

    def straight(s: np.ndarray) -> np.ndarray:
        return np.stack([0.0 * s, 0.0 * s - 1.1, s - 7.5], axis=-1)

    rods, line = line_of(arc, straight, nodes=6, step=3.0)
    pose = Pose(rods)
    contact = WireContact(pose.stepper, STIFFNESS, curve=fit_rest_curve(rods, line))
    set_masses(pose.stepper, 1e15, 1e15)
    pose.stepper.set_time_step(0.025)
    pose.stepper.state.spin.assign(np.where(np.arange(12) < 6, np.pi / (steps * 0.025), 0.0))
    contact.search()
    pose.stepper.evaluate()
    assert len(contact.read_contacts().overlap) == 0
    advance(contact, steps)
    found = contact.read_contacts().overlap
    contact.search()
    pose.stepper.evaluate()
    assert found.tolist() == pytest.approx(contact.read_contacts().overlap.tolist(), rel=0.01)


@pytest.mark.parametrize("along", [*slow(-0.5, 0.0), 0.5])
def test_a_contact_goes_without_a_jump_while_another_stays(along: float) -> None:
    """Of wires that lean, one closest point meets the saddle of the distance, away from the other point, and both are gone. There
    the force on the wires changes with the root of the angle, and not by that of the contact: that a barrier of less than 1e-11
    counts as none leaves a jump of the order of its third root."""
    bow, gap, lean = 0.8, 0.9, 0.02

    def at(share: float) -> Contacts:
        return touch(float(np.arctan(share * np.sqrt(0.5 * bow * gap))), bow, gap, lean=lean, along=along)

    low, high = 0.8, 1.0
    assert (at(low).force > 0.0).sum() == 2
    assert (at(high).force > 0.0).sum() == 1
    while high - low > 1e-9:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if (at(middle).force > 0.0).sum() == 2 else (low, middle)
    before, after = at(low), at(high)
    assert before.force.max() > 0.05 * STIFFNESS  # both of them are pressed together
    assert np.sort(before.force)[1] > 0.05 * STIFFNESS
    assert np.ptp(before.place[before.force > 0.0, 0]) > 0.1  # and stand apart
    assert np.linalg.norm(push(before) - push(after)) < 5e-3 * np.sort(before.force)[1]


# share of the angle, lean: two contacts apart and near each other, one that goes, and one alone
HOOKS = [*slow((0.6, 0.0), (0.9, 0.0), (0.7, 0.1)), (0.97, 0.0), (0.9, 0.02), (1.05, 0.0)]


@pytest.mark.parametrize("off", [*slow(0.0), 1.3])
@pytest.mark.parametrize(("share", "lean"), HOOKS)
def test_contacts_and_their_saddle_pass_nodes(share: float, lean: float, off: float) -> None:
    """The same wires with their nodes elsewhere, over the length of a segment: the push does not depend on where the nodes are.
    The saddle counts less where the closest points are 0.2 segments from it, with w = 0.95 for 1 at a node."""
    bow, gap = 0.8, 0.97
    angle = float(np.arctan(share * np.sqrt(0.5 * bow * gap)))
    found = [touch(angle, bow, gap, lean=lean, along=along, off=off) for along in np.linspace(-1.499, 1.499, 41)]
    pushes = np.array([np.linalg.norm(push(contacts)) for contacts in found])
    saddle = max(-float(contacts.force.min(initial=0.0)) for contacts in found)
    assert len({tuple(contacts.first) for contacts in found}) > 1 or share > 1.0  # they do pass nodes
    assert np.ptp(pushes) < 0.06 * saddle + 1e-3 * pushes.mean()


@pytest.mark.parametrize("off", [*slow(0.0), 1.3])
@pytest.mark.parametrize(("share", "lean"), HOOKS)
def test_contacts_that_are_followed_are_those_of_a_new_search(share: float, lean: float, off: float) -> None:
    """The nodes move along two hooked wires by the length of a segment, in steps of a hundredth: closest points are followed from
    step to step, and a saddle that comes in over a node is found in the same step as by a search."""
    bow, gap = 0.8, 0.97

    def rods_at(along: float) -> Rods:
        return hooked(float(np.arctan(share * np.sqrt(0.5 * bow * gap))), bow, gap, lean=lean, along=along, off=off)[0]

    ways = np.linspace(-1.499, 1.499, 101)
    rods = rods_at(ways[0])
    followed, contact = contact_of(rods, None)
    still, pushes = np.zeros(rods.node_count), []
    for along in ways:
        move = rods_at(along).position - rods.position
        followed.at(move, still)
        anew, searched = Pose(rods), None
        searched = WireContact(anew.stepper, STIFFNESS)
        anew.at(move, still)
        searched.search()
        anew.stepper.evaluate()
        pushes.append([push(contacts.read_contacts()) for contacts in (contact, searched)])
    one, other = np.array(pushes).transpose(1, 0, 2)
    assert np.linalg.norm(one, axis=1).min() > 0.5
    assert one == pytest.approx(other, abs=1e-4 * np.abs(other).max())


def test_a_closest_point_that_appears_anew_is_found_at_once() -> None:
    """Hooked wires rock to and fro, by less than calls for a search. Leaning one way they have one closest point, upright two,
    and leaning the other way one: the first one, which is followed, is gone there. On the way back it appears beside the other
    one, and the push is that of a search in every step."""
    bow, gap, share, steps = 0.8, 0.97, 0.988, 40

    def rods_at(lean: float) -> Rods:
        return hooked(float(np.arctan(share * np.sqrt(0.5 * bow * gap))), bow, gap, lean=lean)[0]

    def searched(lean: float) -> Contacts:
        return contact_of(rods_at(lean), None)[1].read_contacts()

    low, high = 0.0, 0.05  # lean from which on there is one closest point
    for _halving in range(12):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if (searched(middle).force > 0.0).sum() == 2 else (low, middle)
    leans = 1.3 * high * np.cos(np.linspace(0.0, 2.0 * np.pi, 2 * steps + 1))
    rods = rods_at(leans[0])
    pose, contact = contact_of(rods, None)
    state, count = pose.stepper.state, []
    set_masses(pose.stepper, 1e15, 1e15)
    pose.stepper.set_time_step(1.0)
    contact.search = lambda rows=None: pytest.fail("searched again")  # type: ignore[method-assign]
    for lean, following in pairwise(leans):
        state.velocity.assign(rods_at(following).position - rods_at(lean).position)
        advance(contact, 1)
        found, other = contact.read_contacts(), searched(lean)
        count.append(int((found.force > 0.0).sum()))
        if len(count) > steps:
            assert push(found) == pytest.approx(push(other), abs=1e-5 * np.linalg.norm(push(other)))
    assert (count[0], count[steps], count[3 * steps // 2], count[-1]) == (1, 1, 2, 1)


@pytest.mark.parametrize("seed", [0, 1])
def test_pairs_wake_before_they_touch(seed: int) -> None:
    """Wires on curved rest shapes, too heavy to turn aside, fly through each other while their sections spin: with pairs that
    sleep until things have travelled far enough, every contact is found in the same step as with pairs that never sleep."""
    nodes = 14
    rods, line = line_of(looped, across, nodes=nodes, step=1.2)
    found = []
    for is_awake in (False, True):
        rng = np.random.default_rng(seed)
        pose, contact = contact_of(rods, line)
        state = pose.stepper.state
        set_masses(pose.stepper, 1e15, 1e15)
        upper = np.where(np.arange(2 * nodes)[:, None] < nodes, 0.0, [0.0, 0.0, 1.0])
        state.displacement.assign(1.5 * upper)
        state.velocity.assign(rng.normal(size=(2 * nodes, 3)) * 0.3 - upper)
        state.spin.assign(3.0 * rng.normal(size=2 * nodes))
        pose.stepper.set_time_step(0.005)
        contact.search()
        overlaps = []
        for _ in range(300):
            if is_awake:
                contact.search()
            advance(contact, 1)
            pose.stepper.evaluate(0.0)  # a search after the step forgets the contacts
            overlaps.append(contact.read_contacts().overlap.max(initial=0.0))
        found.append(np.array(overlaps))
    assert (found[1] > 0.0).sum() > 50
    assert np.array_equal(found[0] > 0.0, found[1] > 0.0)
    assert found[0] == pytest.approx(found[1], abs=1e-9)


def test_wires_that_the_load_brings_together_touch() -> None:
    """Two wires side by side come together by the load alone, which a sleeping pair knows of only as it counts as travel."""
    up = np.arange(6)[:, None] * [0.0, 2.0, 0.0]
    rods = rods_of(SECTION, [up, up + [1.3, 0.3, 0.0]])
    pose, contact = contact_of(rods, None)
    state = pose.stepper.state
    set_masses(pose.stepper, 1e15, 1e15)
    pose.stepper.set_time_step(0.005)
    state.steering.set(ramp_from=(1.0, 0.0, 0.0, 1.0, 1.0), ramp_to=(0.7, 0.0, 0.0, 1.0, 1.0), ramp_steps=100.0)
    contact.search()
    advance(contact, 100)
    assert contact.read_contacts().overlap.max(initial=0.0) == pytest.approx(1.0 - 0.7 * 1.3, rel=1e-2, abs=0)
