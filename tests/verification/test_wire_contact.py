"""Contact between round wires: forces, which pairs are found, and that nothing passes through."""

import numpy as np
import pytest

from reference.rods import SECTION, energy, residual_of
from reference.touching import STIFFNESS, advance, line, plies, touching
from warpknit.base.errors import OutOfResources
from warpknit.compute.host import fetch, store
from warpknit.kernels.wire_curve import CLOSING_RATE
from warpknit.kernels.wire_pairs import SEARCHED
from warpknit.spatial.pair_search import DUE, MOVED
from warpknit.spatial.rod_relaxation import RodRelaxation
from warpknit.spatial.rod_step import RodStepper
from warpknit.spatial.rods import Rods, joined, rods_of
from warpknit.spatial.step_bound import largest_rates, stable_step
from warpknit.spatial.wire_contact import WireContact


@pytest.mark.parametrize("at", [3.0, 3.9, 3.999, 4.0, 4.001, 4.3, 5.0])
def test_crossing_wires_push_once_with_the_prescribed_stiffness(at: float) -> None:
    """N = k o wherever two straight wires cross, between nodes and over them: one contact, its force on the two wires alone."""
    overlap = 0.02
    stepper, contact = touching([line([0, 0, 0], [2, 0, 0], 6), line([at, -4.2, 1 - overlap], [0, 2, 0], 6)])
    force, _ = stepper.forces()
    assert contact.read_contacts().force == pytest.approx([STIFFNESS * overlap], rel=1e-9, abs=0)
    assert force[6:].sum(axis=0) == pytest.approx([0, 0, STIFFNESS * overlap], rel=1e-9, abs=1e-12)


def test_contact_force_is_the_gradient_of_its_energy() -> None:
    """E = k o^2/2 at the closest points of two curves; central differences are off by (step)^2 and round-off/step."""
    angle = np.linspace(-1.0, 1.0, 7)
    bow = np.stack([6 * np.sin(angle), np.zeros(7), 6 * np.cos(angle) - 6], axis=1)
    other = np.stack([0.3 + 0.2 * np.sin(3 * angle), 5 * np.sin(angle), 6.95 - 6 * np.cos(angle)], axis=1)
    stepper, contact = touching([bow, other])
    start, step = stepper.rods.position.copy(), 1e-5

    def energy(position: np.ndarray) -> float:
        stepper.place(position)
        return float(0.5 * STIFFNESS * np.sum(contact.read_contacts().overlap ** 2))

    stepper.place(start)
    assert len(contact.read_contacts().force) == 1
    stepper.state.contact_penalty.fill_(0.0)
    elastic, _ = stepper.forces()
    stepper.state.contact_penalty.fill_(STIFFNESS)
    pushed = stepper.forces()[0] - elastic
    found = np.zeros_like(start)
    for k in np.ndindex(start.shape):
        way = np.zeros_like(start)
        way[k] = step
        found[k] = -(energy(start + way) - energy(start - way)) / (2 * step)
    assert np.abs(pushed).max() > 0.1
    assert np.abs(pushed - found).max() < 1e3 * step**2 * STIFFNESS


@pytest.mark.parametrize("spacing", [1.0, 0.5])
def test_two_plies_come_to_rest(spacing: float) -> None:
    """They touch along a line though they stand at an angle of 34 degrees to each other, so each segment has its contact, and
    what is out of balance falls below a millionth of what they press with."""
    contact, rest, nodes = plies(spacing)
    assert (contact.read_contacts().force > 0.0).sum() >= nodes - 1
    assert residual_of(rest) < 1e-6 * contact.read_contacts().force.sum()


def tangle(seed: int, wires: int, nodes: int, is_tiled: bool = True) -> Rods:
    """Wavy wires without order in a tile that repeats in x and y, each going on into the next tile up; or once."""
    rng = np.random.default_rng(seed)
    tile = np.array([14.0, 16.0, 0.0])
    up = np.arange(nodes) / nodes
    points = []
    for _ in range(wires):
        phase, size = rng.uniform(0, 2 * np.pi, (2, 3)), rng.uniform(0.3, 1.0, (2, 3))
        x, z = (sum(s * np.sin(2 * np.pi * (k + 1) * up + p) for k, (s, p) in enumerate(zip(*a, strict=True)))
                for a in zip(size, phase, strict=True))  # fmt: skip
        points.append(np.stack([rng.uniform(-20, 20) + 2 * x, rng.uniform(-20, 20) + 16 * up, 0.8 * z], axis=1))
    if not is_tiled:
        return rods_of(SECTION, [0.5 * one for one in points])
    return rods_of(SECTION, points, [np.array([0.0, 16.0, 0.0])] * wires, tile=tile)


def test_every_contact_is_found() -> None:
    """In a tangle over the borders of its tile, strained and sheared, the pairs near each other are those of a search by all
    images of all segments, however many: the list grows with them."""
    rods = tangle(3, 12, 60)
    stepper = RodStepper(rods)
    gradient = np.array([[1.1, 0.15], [0.0, 0.9]])
    stepper.state.steering.set(gradient=gradient)
    contact = WireContact(stepper, STIFFNESS)
    contact.search()
    assert contact.pair_count > 1000
    state = stepper.state
    begin = state.position.numpy()
    middle = begin + 0.5 * state.length.numpy()[:, None] * state.tangent.numpy()
    pairs = contact.pairs
    found = set()
    for i, j, shift in zip(pairs.pair_first.numpy(), pairs.pair_second.numpy(), pairs.pair_shift.numpy(), strict=True):
        if i != j:
            found.add((int(i), int(j), *np.rint(shift[:2] / rods.tile[:2]).astype(int).tolist()))
    wire = rods.wire_of
    for a in range(-4, 5):
        for b in range(-4, 5):
            moved = middle + np.append(gradient @ (rods.tile[:2] * [a, b]), 0.0)
            apart = np.linalg.norm(middle[:, None] - moved[None], axis=2)
            for i, j in np.argwhere(apart < 1.0 + contact.cells.margin):
                # neighbours on one wire do not count; those who do are all far along it, in this tangle
                if i < j and wire[i] != wire[j]:
                    assert (int(i), int(j), a, b) in found


def keys_of(contact: WireContact) -> np.ndarray:
    """(pair, 5) segments and shift of the pairs in the list."""
    pairs, count = contact.pairs, contact.pair_count
    first, second, shift = (fetch(x)[:count] for x in (pairs.pair_first, pairs.pair_second, pairs.pair_shift))
    return np.column_stack([first, second, np.rint(shift)])


def test_a_search_around_moved_nodes_finds_all_pairs() -> None:
    """Some nodes move in each of several rounds. Pairs that may touch before the next search are then those of a new search; what
    is known of pairs is kept."""
    rods = tangle(5, 30, 60)
    stepper = RodStepper(rods)
    contact = WireContact(stepper, STIFFNESS, friction=0.2)  # whose list before is kept
    contact.search()
    search, rows, rng = contact._search, np.array([0]), np.random.default_rng(2)
    shares, new = [], 0
    for _ in range(12):
        before = keys_of(contact)
        move = np.zeros((rods.node_count, 3))
        some = rng.integers(0, rods.node_count - 20) + np.arange(20)
        move[some] = 0.9 * search.allowed * rng.standard_normal((1, 3))
        store(stepper.state.displacement, fetch(stepper.state.displacement) + move)
        contact.refresh(float(np.linalg.norm(move, axis=1).max()))
        shares.append((fetch(search.searched) == int(SEARCHED)).mean())
        now, left = {tuple(key) for key in keys_of(contact)}, contact.cells.margin - float(CLOSING_RATE) * search.motion(rows)[0]
        new += len(now - {tuple(key) for key in before})
        beside = RodStepper(rods)
        store(beside.state.displacement, fetch(stepper.state.displacement))
        other = WireContact(beside, STIFFNESS, cells=contact.cells)
        other.search()
        gap = float(CLOSING_RATE) * fetch(other.pairs.pair_wake_travel)[: other.pair_count]
        may_touch = {tuple(key) for key in keys_of(other)[gap < left]}
        assert len(may_touch) > 100
        assert may_touch <= now
        assert np.all(np.diff(keys_of(contact)[:, 0]) >= 0)
    assert 0.0 < max(shares) < 0.5
    assert new > 0


def test_pairs_hold_while_nodes_follow_a_smooth_motion() -> None:
    """Nodes move by many thicknesses, but by little from one to the next. Without another search the list then has all pairs of
    wires that may touch, and forces are those of a new search; the strain counts until the next one."""
    rods = tangle(5, 60, 30, is_tiled=False)
    stepper = RodStepper(rods)
    contact = WireContact(stepper, STIFFNESS, friction=0.2)
    contact.search()
    search, rows, number = contact._search, np.array([0]), contact.pairs.number
    slope = np.array([[0.3, -0.2], [0.1, 0.05], [-0.2, 0.15]])
    strain = 0.3 * search.allowed / float(stepper.steering.pair_reach[0])
    smooth = np.array([7.0, -5.0, 3.0]) + strain * rods.position[:, :2] @ slope.T
    rest = 0.05 * search.allowed * np.random.default_rng(4).uniform(-1.0, 1.0, size=smooth.shape)
    for times in (1, 2):
        stepper.shift(smooth + rest, None, smooth, strain)
        contact.list_near_pairs()
        stepper.evaluate()
        assert contact.pairs.number == number
        assert search.motion(rows)[0] >= 0.3 * times * search.allowed
        beside = RodStepper(rods)
        store(beside.state.displacement, fetch(stepper.state.displacement))
        other = WireContact(beside, STIFFNESS, cells=contact.cells)
        other.search()
        beside.evaluate()
        left = contact.cells.margin - float(CLOSING_RATE) * search.motion(rows)[0]
        gap = float(CLOSING_RATE) * fetch(other.pairs.pair_wake_travel)[: other.pair_count]
        wire = rods.wire_of[keys_of(other)[:, :2].astype(int)]
        may_touch = {tuple(key) for key in keys_of(other)[(gap < left) & (wire[:, 0] != wire[:, 1])]}
        assert len(may_touch) > 100
        assert may_touch <= {tuple(key) for key in keys_of(contact)}
        if times == 1:  # later on, wires this deep in each other are followed to other minima than those of a new search
            largest = np.abs(fetch(beside.state.force)).max()
            assert fetch(stepper.state.force) == pytest.approx(fetch(beside.state.force), abs=1e-9 * largest)
    stepper.shift(smooth, None, smooth, strain)
    assert contact.pairs.number != number


def test_wires_that_go_apart_and_come_back_are_listed_before_they_touch() -> None:
    """Two wires go apart by less than is searched around; beside them a third moves, and their pair is left out. Without another
    search they come no nearer to each other than what multipliers push apart."""
    wires = [line([0, 0, 0], [2, 0, 0], 8), line([0, 0, 20], [2, 0, 0], 8), line([6.3, -5, -3], [0, 2, 0], 8)]
    stepper = RodStepper(rods_of(SECTION, wires))
    contact = WireContact(stepper, STIFFNESS, friction=0.2)
    cells, allowed = contact.cells, contact._search.allowed
    rng, place = np.arange(24) // 8, stepper.rods.position[:, 2].copy()

    def move_to(height: list[float], along: float = 0.0) -> float:
        move = np.stack([along * (rng == 2), 0.0 * rng, np.array(height)[rng] - place], axis=1)
        before = fetch(stepper.state.displacement).copy()
        store(stepper.state.displacement, move)
        contact.refresh(float(np.linalg.norm(move - before, axis=1).max()))
        return height[1] - height[0] - 1.0

    def is_listed() -> bool:
        return [3, 11] in keys_of(contact)[:, :2].tolist()  # of segments beside the third wire

    apart, back = 0.99 * MOVED * allowed, 0.99 * DUE * allowed
    above, third = 1.0 + cells.margin - 1.8 * apart, -2.0
    contact.search()
    move_to([0.0, above, third])
    contact.search()
    assert is_listed()
    assert move_to([-apart, above + apart, third], 1.1 * DUE * allowed) < cells.margin + apart
    was_left_out = not is_listed()
    gap = move_to([back, above - back, third], 1.1 * DUE * allowed)
    assert was_left_out
    assert is_listed() or gap > cells.margin - 2.0 * cells.approach / float(CLOSING_RATE)  # for wires that stay straight


def test_a_list_that_memory_has_no_room_for_ends_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """The list is counted first and never overflows: it grows, or says what it needs (exit status 4)."""
    contact = WireContact(RodStepper(tangle(3, 12, 60)), STIFFNESS)
    monkeypatch.setattr("warpknit.spatial.wire_contact.available_memory", lambda device: 1000)
    with pytest.raises(OutOfResources, match="MiB"):
        contact.search()
    monkeypatch.undo()
    contact.search()
    assert contact.pair_count > 1000


def test_a_wire_of_short_segments_does_not_push_itself_apart() -> None:
    """Segments of a quarter of the thickness: excluded by arc length, so a straight wire and a bend of radius 2 d are at rest."""
    angle = np.arange(40) / 8.0
    bend = 2.0 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    stepper, contact = touching([line([0, 0, 5], [0.25, 0, 0], 30), bend])
    assert len(contact.read_contacts().force) == 0
    assert np.abs(stepper.forces()[0]).max() < 1e-9 * SECTION.axial_stiffness


def test_a_wire_touches_itself() -> None:
    """A coil of pitch 0.9 d and radius 3 d overlaps with its next turn by 0.1 d all along."""
    angle = 2 * np.pi * np.arange(60) / 24
    coil = np.stack([3 * np.cos(angle), 3 * np.sin(angle), 0.9 * angle / (2 * np.pi)], axis=1)
    _, contact = touching([coil])
    overlap = contact.read_contacts().overlap
    pitch_angle = np.arctan(0.9 / (2 * np.pi * 3))
    assert len(overlap) >= 30
    assert overlap == pytest.approx(np.full(len(overlap), 1 - 0.9 * np.cos(pitch_angle)), abs=5e-3)


def energy_of(stepper: RodStepper, contact: WireContact) -> float:
    """Stored, contact and kinetic energy, the velocity being half a step behind: the mean of two kinetic energies."""
    state = stepper.state
    mass = state.node_mass.numpy()
    before = state.velocity.numpy().copy()
    stepper.evaluate()
    near = contact.read_contacts()
    stored = energy(stepper) + 0.5 * STIFFNESS * float(np.sum(np.sign(near.force) * near.overlap**2))
    after = before + state.steering.time_step * state.force.numpy() / mass
    return stored + 0.25 * float(np.sum(mass * (before**2 + after**2)))


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_energy_goes_by_friction_alone(friction: float) -> None:
    """Two wires fly into each other, bounce and swing: without friction the energy of leapfrog stays within (w dt)^2/4 of what
    moves, with friction it only falls, but for that."""
    lower, upper = line([0, 0, 0], [2, 0, 0], 8), line([7.2, -6.7, 1.3], [0.2, 2, 0], 8)
    stepper, contact = touching([lower, upper], friction=friction)
    state = stepper.state
    mass, inertia = state.node_mass.numpy()[:, 0], state.spin_inertia.numpy()
    share = 0.1
    stepper.set_time_step(share * stable_step(largest_rates(stepper.rods, mass, inertia, contact_stiffness=STIFFNESS)))
    state.velocity.assign(np.where(np.arange(16)[:, None] < 8, [0.5, 0.0, 1.0], [0.0, 0.0, -1.0]))
    start = energy_of(stepper, contact)
    energies, hits = [start], 0
    for _ in range(150):
        advance(contact, 20)
        energies.append(energy_of(stepper, contact))
        hits += len(contact.read_contacts().force) > 0
    assert hits > 3
    error = share**2 * start
    if friction == 0.0:
        assert np.abs(np.array(energies) - start).max() < error
    else:
        assert np.diff(energies).max() < error
        assert energies[-1] < start - 3 * error


def test_nothing_passes_through_at_the_speed_limit() -> None:
    """Two wires driven together at the largest move a step that a relaxation permits stay on their sides."""
    lower, upper = line([0, 0, 0], [2, 0, 0], 8), line([7.2, -6.7, 1.5], [0, 2, 0], 8)
    stepper, contact = touching([lower, upper])
    rest = RodRelaxation(stepper)
    limit = rest.stepper.state.steering.speed_limit
    stepper.state.velocity.assign(np.where(np.arange(16)[:, None] < 8, [0.0, 0.0, limit], [0.0, 0.0, -limit]))
    rest.stepper.set_time_step(1.0)  # undamped: worse than any relaxation
    lowest = np.inf
    for _ in range(400):
        advance(contact, 1)
        z = (stepper.rods.position + stepper.state.displacement.numpy())[:, 2]
        lowest = min(lowest, float(z[11] - z[3]))
    assert 0.0 < lowest < 1.0


def test_a_world_that_has_failed_is_not_searched_with_others() -> None:
    """The state of a world that has failed may not be finite. A search of another world leaves its pairs as they are."""
    rods = tangle(3, 12, 60)
    stepper = RodStepper(joined([rods, rods]), worlds=2)
    contact = WireContact(stepper, STIFFNESS, friction=0.2)
    contact.search()
    before, failed = keys_of(contact), np.arange(2 * rods.node_count)[:, None] >= rods.node_count
    store(stepper.state.displacement, np.where(failed, np.nan, 0.0))
    contact.refresh(2.0 * contact.cells.approach, np.array([0]))
    store(stepper.state.position, np.where(failed, np.nan, fetch(stepper.state.position)))
    contact.search(np.array([0]))
    assert np.array_equal(keys_of(contact), before)
