"""Clasps by the alternating-lens rule."""

import numpy as np
import pytest

from reference.cases import slow
from reference.knits import BARS, COARSE, FINE, PAPER, Bar, Knit, cloth
from warpknit.knit.cloth import knit_cloth
from warpknit.knit.loops import RANGES, LoopProportions


def stitches_of(knitted, clasp):
    """The stitches, told apart by copies, that the two arms of a clasp lie on."""
    found = []
    for arm in clasp.arms:
        thread = knitted.threads[arm.thread]
        found.append((thread.stitch_at(arm.arc), arm.column, int(np.floor(arm.arc / thread.length))))
    return found


@pytest.mark.parametrize("diameter", [FINE, COARSE])
def test_double_atlas_has_16_lenses_and_12_clasps(diameter):
    """Each open lap hooks the closed loop below twice, each closed lap the open loop below by two nested lenses."""
    single, merged = cloth("paper", diameter, False), cloth("paper", diameter, True)
    assert len(single.stitches) == 8
    assert len(single.clasps) == 16 and all(clasp.lenses == 1 for clasp in single.clasps)
    assert len(merged.clasps) == 12
    assert sorted(clasp.lenses for clasp in merged.clasps) == [1] * 8 + [2] * 4


def test_every_circular_loop_has_three_clasps_and_every_clasp_one_circular_loop():
    knitted = cloth("paper")
    circular = dict.fromkeys([k for k, s in enumerate(knitted.stitches) if s.kind == "closed"], 0)
    for clasp in knitted.clasps:
        kinds = sorted(knitted.stitches[s].kind for s, _, _ in stitches_of(knitted, clasp))
        assert kinds == ["closed", "open"]
        for stitch, _, _ in stitches_of(knitted, clasp):
            if stitch in circular:
                circular[stitch] += 1
    assert set(circular.values()) == {3} and len(circular) == 4


@pytest.mark.parametrize("name", BARS)
def test_every_loop_is_clasped_by_a_loop_next_to_it(name):
    """Every loop hooks one that is a course above or below it on the same needle."""
    knitted = cloth(name)
    hooked = set()
    for clasp in knitted.clasps:
        (first, *where), (second, *other) = stitches_of(knitted, clasp)
        a, b = knitted.stitches[first], knitted.stitches[second]
        course_a, course_b = a.course + where[1] * knitted.courses, b.course + other[1] * knitted.courses
        needle_a, needle_b = a.needle + where[0] * knitted.wales, b.needle + other[0] * knitted.wales
        if needle_a == needle_b and abs(course_a - course_b) == 1:
            hooked.update((first, second))
    assert hooked >= {k for k, s in enumerate(knitted.stitches) if s.kind != "inlay"}


@pytest.mark.parametrize("merge", [False, True])
@pytest.mark.parametrize("name", BARS)
def test_body_lies_between_its_arms(name, merge):
    """Arc, side and clearance of an arm agree with the centre line; bodies are over 0.625 d from both wires."""
    knitted = cloth(name, FINE, merge)
    for clasp in knitted.clasps:
        assert np.all((clasp.position >= -1e-9) & (clasp.position < knitted.size))
        for arm in clasp.arms:
            thread = knitted.threads[arm.thread]
            near = thread.at(np.array([arm.arc - 1e-7, arm.arc, arm.arc + 1e-7]), knitted.size[1])[:, :2]
            near += [arm.column * knitted.size[0], 0.0]
            tangent, away = near[2] - near[0], clasp.position - near[1]
            assert np.hypot(*away) == pytest.approx(arm.clearance, abs=1e-9)
            assert np.sign(tangent[0] * away[1] - tangent[1] * away[0]) == arm.side
            assert arm.arc_low <= arm.arc <= arm.arc_high
            assert arm.arc_high - arm.arc_low < knitted.stitch_length
            assert arm.clearance > 0.625 * FINE


def test_glide_maps_bodies_onto_bodies():
    """Half a repeat up and mirrored, clasps are clasps; the deepest point is found to 1e-3 of a lens."""
    knitted = cloth("paper")
    middle = knitted.threads[0].points[:, 0].mean()
    position = np.array([clasp.position for clasp in knitted.clasps])
    image = position * [-1.0, 1.0] + [2.0 * middle, 0.5 * knitted.size[1]]
    apart = image[:, None] - position
    apart -= np.round(apart / knitted.size) * knitted.size
    assert np.hypot(apart[..., 0], apart[..., 1]).min(axis=1).max() < 0.2 * FINE


@pytest.mark.parametrize("courses_per_inch", [14, 17, 18, 20, 23])
def test_two_bar_tricot_has_its_symmetry_at_any_spacing(courses_per_inch):
    """Half a repeat up, mirrored, it is the same knit: each clasp has one of the same wires there. Near heads are not merged."""
    bars = (Bar("1-0/1-2"), Bar("1-2/1-0"))
    knitted = knit_cloth(Knit(bars, wale_spacing=0.0254 / 14, course_spacing=0.0254 / courses_per_inch), 25e-6)
    heights = {}
    for clasp in knitted.clasps:
        threads = tuple(sorted(arm.thread for arm in clasp.arms))
        heights.setdefault((threads, clasp.lenses), []).append(clasp.position[1] / knitted.size[1])
    for found in heights.values():
        apart = np.abs(np.subtract.outer(found, np.array(found) + 0.5))
        apart = np.minimum(apart % 1.0, -apart % 1.0)
        assert apart.min(axis=1).max() < 5e-3 and len(found) % 2 == 0


@pytest.mark.parametrize("seed", [*range(4), *slow(*range(4, 12))])
def test_structure_holds_when_proportions_vary_by_five_percent(seed):
    source = np.random.default_rng(seed)
    standard = LoopProportions()
    varied = {name: getattr(standard, name) * (1.0 + 0.05 * source.uniform(-1.0, 1.0)) for name in RANGES}
    knit = Knit(PAPER, loop=LoopProportions(**varied))
    assert len(knit_cloth(knit, FINE, merge_lenses=False).clasps) == 16
    knitted = knit_cloth(knit, FINE)
    assert len(knitted.clasps) == 12 and len(knitted.rhombus.clasps) == 12


@pytest.mark.parametrize(("wale", "course"), [(0.9e-3, 0.7e-3), (1.5e-3, 1.0e-3), (2.2e-3, 1.0e-3)])
def test_structure_holds_at_other_spacings(wale, course):
    knitted = knit_cloth(Knit(PAPER, wale_spacing=wale, course_spacing=course), FINE)
    assert len(knitted.clasps) == 12 and len(knitted.rhombus.clasps) == 12


def test_structure_does_not_depend_on_the_scale():
    """Every length ten times larger: the same clasps, ten times larger."""
    small = cloth("paper")
    large = knit_cloth(Knit(PAPER, wale_spacing=17e-3, course_spacing=10e-3), 10 * FINE)
    assert large.stitch_length == pytest.approx(10.0 * small.stitch_length, rel=1e-9)
    for a, b in zip(small.clasps, large.clasps, strict=True):
        assert b.position == pytest.approx(10.0 * a.position, rel=1e-6, abs=1e-9)
