"""Contact in tiles narrower than the reach of a segment: with several periodic images of a wire, and with images of itself."""

import itertools

import numpy as np
import pytest

from reference.rods import SECTION, set_masses
from reference.touching import STIFFNESS, advance, line
from warpknit.spatial.pair_search import MAX_SAG, search_cells
from warpknit.spatial.rest_curve import catmull_rom
from warpknit.spatial.rod_step import RodStepper
from warpknit.spatial.rods import Rods, rods_of
from warpknit.spatial.wire_contact import MIN_ARC_SEPARATION, STICK_SHARE, WireContact
from warpknit.wires.overlaps import segment_distances

ROUND_OFF = 1e-12
GRADIENT = np.array([[1.1, 0.15], [0.0, 0.9]])
NARROW = {
    "a segment wide": (2.6, 4.0),
    "two cells wide": (11.0, 4.0),
    "as wide as the wire": (1.05, 2.1),
}
POINTS = 33  # of a curve
Pair = tuple[int, int, int, int]


def tangle(tile: tuple[float, float], repeats: tuple[int, int] = (1, 1)) -> Rods:
    """Two helices in a tile, one of them going up at a slant, and a tilted ring; in so many repeats of the tile."""
    width, height = tile
    points, periods, rounds = [], [], []
    for slant, nodes, begin in ((0, 4, [0.7, -2.2, 0.2]), (1, 5, [-1.3, 0.4, -0.5])):
        up = np.arange(nodes)[:, None] / nodes
        turn = 2 * np.pi * up + slant
        period = np.array([slant * width, height, 0.0])
        points.append(begin + up * period + 0.3 * np.concatenate([np.sin(turn), 0.0 * turn, np.cos(turn)], axis=1))
        periods.append(period)
        rounds.append(True)
    angle = 2 * np.pi * np.arange(8) / 8
    points.append(1.5 * np.stack([np.cos(angle), np.sin(angle), 0.5 * np.cos(angle) + 0.3 * np.sin(angle)], axis=1))
    periods.append(np.zeros(3))
    rounds.append(False)
    many, shifts = [], []
    columns, rows = repeats
    for (wire, period, goes_on), column in itertools.product(zip(points, periods, rounds, strict=True), range(columns)):
        if goes_on:
            many.append(np.concatenate([wire + [column * width, 0.0, 0.0] + row * period for row in range(rows)]))
            shifts.append(rows * period)
        else:
            many += [wire + [column * width, row * height, 0.0] for row in range(rows)]
            shifts += [period] * rows
    return rods_of(SECTION, many, shifts, tile=np.array([columns * width, rows * height, 0.0]))


def curve_points(rods: Rods, begin: np.ndarray, edge: np.ndarray) -> np.ndarray:
    """(segment, POINTS, 3) on the Catmull-Rom curves of closed wires, from the begins and edges (node, 3) of their segments."""
    s = np.linspace(0.0, 1.0, POINTS)[:, None]
    here, before, behind = (edge[nodes][:, None] for nodes in (slice(None), rods.previous, rods.following))
    slopes = s * (1 - s) ** 2 * 0.5 * (before + here) - s**2 * (1 - s) * 0.5 * (here + behind)
    return np.asarray(begin[:, None] + s**2 * (3 - 2 * s) * here + slopes)


def searched(rods: Rods, **options: float) -> tuple[RodStepper, WireContact]:
    stepper = RodStepper(rods)
    stepper.state.steering.set(gradient=GRADIENT)
    contact = WireContact(stepper, STIFFNESS, **options)
    contact.search()
    stepper.evaluate()
    return stepper, contact


def pairs_of(contact: WireContact, tile: np.ndarray) -> list[Pair]:
    pairs, count = contact.pairs, contact.pair_count
    image = np.rint(pairs.pair_shift.numpy()[:count, :2] / tile[:2]).astype(int)
    return [
        (int(i), int(j), int(a), int(b))
        for i, j, (a, b) in zip(pairs.pair_first.numpy()[:count], pairs.pair_second.numpy()[:count], image, strict=True)
    ]


@pytest.mark.parametrize("tile", NARROW.values(), ids=NARROW)
def test_pairs_are_those_of_a_search_by_all_images(tile: tuple[float, float]) -> None:
    """Each once: every image whose curve is nearer than the margin, and no other.

    Of the images of a segment itself one of each two that are opposite. Neighbours on a wire and segments within four radii along
    it are left out, also where it continues.
    """
    rods = tangle(tile)
    stepper, contact = searched(rods)
    listed = pairs_of(contact, rods.tile)
    found = set(listed)
    assert len(found) == len(listed)
    assert np.floor(rods.tile / search_cells(rods, catmull_rom(rods)).radius).max() < 3
    begin = stepper.state.position.numpy()
    edge = stepper.state.length.numpy()[:, None] * stepper.state.tangent.numpy()
    curves = curve_points(rods, begin, edge)
    i, j = (a.ravel() for a in np.meshgrid(np.arange(rods.node_count), np.arange(rods.node_count), indexing="ij"))
    wire, arc, size = rods.wire_of, rods.arc, np.linalg.norm(edge, axis=1)
    several = 0
    for a, b in itertools.product(range(-12, 13), range(-8, 9)):
        shift = rods.tile * [a, b, 0.0]
        moved = begin + np.append(GRADIENT @ shift[:2], 0.0)
        distance, _, _ = segment_distances(begin[i], begin[i] + edge[i], moved[j], moved[j] + edge[j])
        turns = np.select([wire[i] == 0, wire[i] == 1], [b, b], 0)
        is_same = (wire[i] == wire[j]) & (np.abs(shift - turns[:, None] * rods.wire_period[wire[i]]).max(axis=1) < 1e-9)
        along = np.abs(arc[j] - arc[i] + turns * rods.wire_length[wire[i]])
        along = np.where(wire[i] == 2, np.minimum(along, rods.wire_length[2] - along), along)
        after, before = rods.following, rods.previous
        spacing = np.where(after[i] == j, rods.natural_arc[i], np.where(before[i] == j, rods.natural_arc[j], -1.0))
        left_out = is_same & (
            (np.abs(along - spacing) < 1e-9) | (along + np.maximum(size[i], size[j]) < 0.5 * MIN_ARC_SEPARATION)
        )
        counts = (i < j) | ((i == j) & ((a > 0) | ((a == 0) & (b > 0))))
        reachable = distance < 1.0 + contact.cells.margin + 2.0 * MAX_SAG * size.max()
        allowed = set()
        for k in np.flatnonzero(counts & ~left_out & reachable):
            pair, other = (int(i[k]), int(j[k]), a, b), curves[j[k]] + moved[j[k]] - begin[j[k]]
            gap = np.linalg.norm(curves[i[k]][:, None] - other, axis=2).min() - 1.0 - contact.cells.margin
            assert gap > -1e-9 or pair in found
            if gap < 2.0 * size.max() / POINTS:  # what points in between may be nearer
                allowed.add(pair)
        here = {pair for pair in found if pair[2:] == (a, b)}
        assert here <= allowed
        several += len(here)
    assert several == len(found)
    assert len({pair[:2] for pair in found}) < len(found)
    assert tile[0] > 4.0 or any(pair[0] == pair[1] for pair in found)


@pytest.mark.parametrize("tile", NARROW.values(), ids=NARROW)
def test_pairs_of_a_tile_are_those_of_many_repeats(tile: tuple[float, float]) -> None:
    """7 x 7 repeats have each pair of the tile 49 times."""
    rods, large = tangle(tile), tangle(tile, (7, 7))
    listed = pairs_of(searched(rods)[1], rods.tile)
    width, height, _ = rods.tile
    # of each node of the large tile: node of the small one, and the tile that it was moved by
    place = np.zeros((large.node_count, 3), dtype=int)
    for wire, (first, count) in enumerate(zip(large.wire_first, large.wire_count, strict=True)):
        kind, column = (wire // 7, wire % 7) if wire < 14 else (2, (wire - 14) // 7)
        number = np.arange(count)
        if kind < 2:
            row = number // rods.wire_count[kind]
            place[first + number] = np.stack(
                [rods.wire_first[kind] + number % rods.wire_count[kind], column + kind * row, row], axis=1
            )
        else:
            place[first + number] = np.stack([rods.wire_first[2] + number, 0 * number + column, 0 * number + wire % 7], axis=1)
    assert np.abs(large.position - rods.position[place[:, 0]] - place[:, 1:] @ [[width, 0, 0], [0, height, 0]]).max() < 1e-9
    many: dict[Pair, int] = {}
    for i, j, a, b in pairs_of(searched(large)[1], large.tile):
        first, second = place[i], place[j] + [0, 7 * a, 7 * b]
        image = second[1:] - first[1:]
        if second[0] < first[0] or (second[0] == first[0] and tuple(image) < (0, 0)):
            first, second, image = second, first, -image
        key = (int(first[0]), int(second[0]), int(image[0]), int(image[1]))
        many[key] = many.get(key, 0) + 1
    assert many == dict.fromkeys(listed, 49)


@pytest.mark.parametrize("friction", [0.0, 0.4])
def test_contact_with_images_has_no_net_force(friction: float) -> None:
    """What a tile does to its images they do to it: the sum of all forces vanishes."""
    rng = np.random.default_rng(3)
    rods = tangle(NARROW["as wide as the wire"])
    stepper, contact = searched(rods, friction=friction)
    stepper.state.velocity.assign(rng.normal(size=(rods.node_count, 3)))
    stepper.state.spin.assign(rng.normal(size=rods.node_count))
    stepper.set_time_step(1e-3)
    stepper.step(1)
    force, _ = stepper.forces()
    touching = contact.read_contacts()
    assert len(touching.force) > 10 and (touching.first == touching.second).any()
    assert (np.linalg.norm(touching.friction, axis=1).max() > 0.0) == (friction > 0.0)
    assert np.abs(force.sum(axis=0)).max() < 1e3 * ROUND_OFF * np.abs(force).max()


def test_wire_beside_its_own_image() -> None:
    """A straight wire in a tile of width w < d touches its images all along: each node pushes with k (d - w) to either side."""
    width, nodes = 0.98, 4
    rods = rods_of(SECTION, [line([0, 0, 0], [0, 2, 0], nodes)], [np.array([0.0, 8.0, 0.0])], tile=np.array([width, 8.0, 0.0]))
    stepper = RodStepper(rods)
    contact = WireContact(stepper, STIFFNESS)
    contact.search()
    stepper.evaluate()
    found = contact.read_contacts()
    overlap = 1.0 - width
    assert found.force.sum() == pytest.approx(nodes * STIFFNESS * overlap, rel=1e-9, abs=0)
    assert found.overlap == pytest.approx(np.full(len(found.overlap), overlap), rel=1e-9, abs=0)
    assert found.shift == pytest.approx(np.tile([width, 0.0, 0.0], (len(found.force), 1)), abs=0)
    assert found.normal == pytest.approx(np.tile([-1.0, 0.0, 0.0], (len(found.force), 1)), abs=ROUND_OFF)
    assert np.abs(stepper.forces()[0]).max() < 1e2 * ROUND_OFF * STIFFNESS


@pytest.mark.parametrize("tile", [(6.0, 6.0), (60.0, 60.0)], ids=["three segments", "thirty segments"])
def test_friction_is_steady_where_a_wire_continues(tile: tuple[float, float]) -> None:
    """A wire too heavy to be slowed or to roll is drawn across another over nodes of both and over the seams, where they continue
    at their first nodes: friction is mu N, as between open wires."""
    friction, overlap, speed, spacing = 0.4, 0.02, np.array([1.0, 0.35, 0.0]), 2.0
    width, height = tile
    count = round(width / spacing)
    lower = line([-1.1, 0, 0], [spacing, 0, 0], count)
    upper = line([-0.4037, -1.3019, 1.0 - overlap], [0, spacing, 0], count)
    rods = rods_of(
        SECTION, [lower, upper], [np.array([width, 0, 0]), np.array([0, height, 0])], tile=np.array([width, height, 0.0])
    )
    stepper = RodStepper(rods)
    contact = WireContact(stepper, STIFFNESS, friction=friction)
    contact.search()
    state = stepper.state
    set_masses(stepper, 1e12, 1e12)
    state.velocity.assign(np.where(np.arange(2 * count)[:, None] < count, 0.0, speed))
    stepper.set_time_step(0.01)
    where, pulls = [], []
    for _ in range(800):
        advance(contact, 1)
        stepper.evaluate()
        found = contact.read_contacts()
        where.append((int(found.first[0]), int(found.second[0]), *np.rint(found.shift[0, :2] / tile).astype(int).tolist()))
        pulls.append(found.friction.sum(axis=0))
    assert len(set(where)) >= 5
    if count == 3:
        assert len({pair[2:] for pair in where}) >= 2
    steady = np.array(pulls)[20:]
    assert overlap * friction / STICK_SHARE < 20 * 0.01
    expected = friction * STIFFNESS * overlap * speed / np.linalg.norm(speed)
    assert np.abs(steady - expected).max() < 1e-6 * np.linalg.norm(expected)
