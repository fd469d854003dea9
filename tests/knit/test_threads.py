"""Centre lines: even, periodic, smooth, knitted through each other, never touching."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

import warpknit
from reference.knits import BARS, COARSE, FINE, PAPER, Knit, cloth
from warpknit.base.errors import SceneError
from warpknit.knit.cloth import knit_cloth
from warpknit.knit.lapping import KnitError
from warpknit.knit.loops import RANGES, LoopProportions
from warpknit.mesh.layout import knit_scene
from warpknit.scene import make_scene


def closed_line(thread, height):
    return np.concatenate([thread.points, thread.points[:1] + [0.0, height, 0.0]])


@pytest.mark.parametrize("name", BARS)
def test_samples_are_even_in_arc_length_and_close_the_period(name):
    """Chord over arc is 1 - (kappa s)^2 / 24: 0.5 % at the sharpest bend, 0.04 mm, and s = 14 um."""
    knitted = cloth(name)
    for thread in knitted.threads:
        step = np.diff(closed_line(thread, knitted.size[1])[:, :2], axis=0)
        chord = np.hypot(step[:, 0], step[:, 1]) / thread.spacing
        assert chord.max() < 1.0 + 1e-4 and chord.min() > 1.0 - 5e-3
        per_stitch = len(thread.points) / knitted.courses
        assert per_stitch >= 400
        assert set(thread.stitch) == set(range(thread.stitch.min(), thread.stitch.min() + knitted.courses))


def test_wire_of_a_stitch():
    """5.47 C of wire a stitch was found for these proportions; one per cent covers another choice of heights."""
    assert cloth("paper").stitch_length == pytest.approx(5.47e-3, rel=0.01)


def test_no_bend_is_a_cusp():
    """The exit foot is rounded: no plan radius below a fifth of the foot radius of 0.1 C."""
    knitted = cloth("paper")
    for thread in knitted.threads:
        line = closed_line(thread, knitted.size[1])[:, :2]
        tangent = np.diff(line, axis=0) / thread.spacing
        turn = np.abs(tangent[1:, 0] * tangent[:-1, 1] - tangent[1:, 1] * tangent[:-1, 0])
        assert turn.max() / thread.spacing < 1.0 / 0.02e-3


def test_glide_symmetry():
    """Half a repeat up and mirrored at the wale between its turns, a thread of the double atlas is itself."""
    knitted = cloth("paper")
    for thread in knitted.threads:
        half = len(thread.points) // 2
        mirrored = thread.points[:half] * [-1.0, 1.0, 1.0] + [
            2.0 * thread.points[:, 0].mean(),
            0.5 * knitted.size[1],
            0.0,
        ]
        assert np.abs(mirrored - thread.points[half:]).max() < 1e-3 * FINE


def test_the_two_bars_mirror_each_other():
    first, second = (thread.points[:, 0] for thread in cloth("paper").threads)
    assert np.abs((first - first.mean()) + (second - second.mean())).max() < 1e-3 * FINE


def smallest_distance(knitted, diameter):
    """Smallest distance of centre lines over all copies, arcs within 6 d on the same wire left out."""
    points = np.concatenate([t.points for t in knitted.threads])
    thread = np.concatenate([np.full(len(t.points), i) for i, t in enumerate(knitted.threads)])
    number = np.concatenate([np.arange(len(t.points)) for t in knitted.threads])
    count = np.array([len(t.points) for t in knitted.threads])
    spacing = np.array([t.spacing for t in knitted.threads])
    tree = cKDTree(points)
    reach = np.ceil(np.ptp(points[:, :2], axis=0) / knitted.size).astype(int)
    smallest = np.inf
    for column in range(reach[0] + 1):
        for row in range(-reach[1] if column else 0, reach[1] + 1):
            other = cKDTree(points + [column * knitted.size[0], row * knitted.size[1], 0.0])
            found = tree.sparse_distance_matrix(other, 1.5 * diameter, output_type="ndarray")
            i, j, distance = found["i"], found["j"], found["v"]
            apart = np.abs(number[i] - number[j] - row * count[thread[j]]) * spacing[thread[i]]
            far = (thread[i] != thread[j]) | (column != 0) | (apart > 6.0 * diameter)
            smallest = min(smallest, distance[far].min(initial=np.inf))
    return smallest


@pytest.mark.parametrize("diameter", [FINE, COARSE])
@pytest.mark.parametrize("name", BARS)
def test_wires_never_touch(name, diameter):
    """Heights are chosen a step of 1.3 d apart; slopes where wires cross take up to 0.1 d of it."""
    assert smallest_distance(cloth(name, diameter), diameter) > 1.2 * diameter


@pytest.mark.parametrize("name", ["reverse locknit", "full double atlas", "closed tricot", "paper"])
def test_wires_never_touch_at_the_spacing_of_a_fine_mesh(name):
    knitted = knit_cloth(Knit(BARS[name], wale_spacing=0.9e-3, course_spacing=0.7e-3), FINE)
    assert smallest_distance(knitted, FINE) > 1.2 * FINE


@pytest.mark.parametrize("end", [0, 1])
@pytest.mark.parametrize("name", [name for name in RANGES if not name.endswith(("foot_half_width", "leg_half_width"))])
def test_wires_never_touch_within_the_range_of_a_proportion(name, end):
    loop = LoopProportions(**{name: RANGES[name][end]})
    assert smallest_distance(knit_cloth(Knit(PAPER, loop=loop), FINE), FINE) > 0.99 * FINE


def piercings(loop, wire):
    """Signs, in order along `wire` (m, 3), of its passes through a fan over the closed polygon `loop` (k, 3)."""
    centre = loop.mean(axis=0)
    a, b = loop, np.roll(loop, -1, axis=0)
    start, step = wire[:-1, None], np.diff(wire, axis=0)[:, None]
    ab, ac = a - centre, b - centre
    normal = np.cross(ab, ac)
    along = np.sum(step * normal, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.sum((centre - start) * normal, axis=-1) / along
        hit = start + t[..., None] * step - centre
        area = np.sum(normal * normal, axis=-1)
        v = np.sum(np.cross(hit, ac) * normal, axis=-1) / area
        w = np.sum(np.cross(ab, hit) * normal, axis=-1) / area
    inside = (t >= 0) & (t < 1) & (v >= 0) & (w >= 0) & (v + w < 1)
    return [int(np.sign(along[i, j])) for i, j in zip(*np.nonzero(inside), strict=True)]


@pytest.mark.parametrize("diameter", [FINE, COARSE])
@pytest.mark.parametrize("name", BARS)
def test_every_loop_is_pierced_once_each_way_by_the_loop_above(name, diameter):
    knitted = cloth(name, diameter)
    course = knitted.size[1] / knitted.courses
    pairs = 0
    for k, stitch in enumerate(knitted.stitches):
        if stitch.kind == "inlay":
            continue
        loop = loop_of(knitted, k)
        for other, above in enumerate(knitted.stitches):
            same_needle = (above.needle - stitch.needle) % knitted.wales == 0
            if above.kind == "inlay" or not same_needle or (above.course - stitch.course - 1) % knitted.courses:
                continue
            wire = body_of(knitted, other)
            shift = [
                (stitch.needle - above.needle) / knitted.wales * knitted.size[0],
                (stitch.course + 1 - above.course) * course,
                0.0,
            ]
            signs = piercings(loop, wire + shift)
            assert signs in ([1, -1], [-1, 1]), (stitch, above, signs)
            pairs += 1
    assert pairs >= sum(s.kind != "inlay" for s in knitted.stitches)


def body_of(knitted, k):
    """Points (m, 3) of a stitch with half of the underlap before it and half of that after it, in one piece."""
    thread = knitted.threads[knitted.stitches[k].thread]
    index = np.nonzero(thread.stitch == k)[0]
    gap = np.nonzero(np.diff(index) > 1)[0]
    points = thread.points[index]
    if len(gap):
        cut = gap[0] + 1
        points = np.concatenate([points[cut:] - [0.0, knitted.size[1], 0.0], points[:cut]])
    elif len(index) == len(thread.points):  # one course: the stitch is the whole period, from the middle of its underlap
        first = int(np.argmin(np.abs(points[:, 1] - points[:, 1].min())))
        points = np.concatenate([points[first:], points[:first] + [0.0, knitted.size[1], 0.0]])
    return points


def loop_of(knitted, k):
    """Legs and head (m, 3) of a stitch: what lies between its lowest points on both legs 0.35 C above its feet."""
    points = body_of(knitted, k)
    course = knitted.size[1] / knitted.courses
    line = knitted.stitches[k].course * course + 0.35 * course
    top = int(np.argmax(points[:, 1]))
    before = np.nonzero(points[:top, 1] < line)[0]
    after = np.nonzero(points[top:, 1] < line)[0]
    return points[before[-1] + 1 : top + after[0]][::4]


def test_loops_wider_than_a_wale_are_refused():
    with pytest.raises(KnitError) as caught:
        knit_cloth(Knit(PAPER, wale_spacing=1.0e-3), FINE)
    assert caught.value.key == "knit.loop.closed_radius"


@pytest.mark.parametrize("field", [*RANGES, "shape"])
def test_proportions_have_ranges(field):
    for value in (None, "x", 1e9, -1e9, float("nan")):
        with pytest.raises(SceneError) as caught:
            make_scene({"knit": {"loop": {field: value}}})
        assert caught.value.key == f"knit.loop.{field}"


def test_feet_are_closer_than_legs():
    with pytest.raises(KnitError) as caught:
        LoopProportions(foot_half_width=0.18, leg_half_width=0.17)
    assert caught.value.key == "knit.loop.foot_half_width"


def test_the_wire_of_a_loop_is_as_long_as_the_rods_of_the_model_in_space() -> None:
    """Sum of the natural lengths of the rods, over the loops; samples and nodes differ by a thousandth."""
    knit = {"bars": [{"chain": "1-0/1-2"}, {"chain": "1-2/1-0"}], "wales": "26 /inch", "courses": "30 /inch"}
    wire = {"material": "molybdenum", "diameter": "30 um"}
    model = {"kind": "spatial", "boundary": "periodic"}
    scene = warpknit.load_scene({"wire": wire, "knit": {**knit, "repeats": [1, 1]}, "model": model})
    knitted, rods = knit_scene(scene), warpknit.build_model(scene).rods
    assert knitted.wire_length == pytest.approx(float(rods.node_length.sum()) / len(knitted.stitches), rel=1e-3)
    assert knitted.wire_length > 1.05 * knitted.stitch_length
