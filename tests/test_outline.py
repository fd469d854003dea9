"""Outlines as polygons, and what a mesh cut along them is."""

from pathlib import Path

import numpy as np
import pytest

from warpknit.base.errors import SceneError
from warpknit.knit.cloth import knit_cloth
from warpknit.mesh.rest_table import ThreadCurve
from warpknit.mesh.strands import cut_strands
from warpknit.scene import load_scene, make_scene, resolved_toml
from warpknit.scene.outline import Outline, disc, is_simple, rectangle, regular, turned
from warpknit.solve.model import build_model

SHAPES = {
    "rectangle": (rectangle(3e-2, 2e-2), 6e-4),
    "hexagon": (regular(6, 1e-2), 1.5 * np.sqrt(3.0) * 1e-4),
    "triangle": (regular(3, 1e-2), 0.25 * np.sqrt(3.0) * 1e-4),
    "disc": (disc(2e-2), np.pi * 1e-4),
}


@pytest.mark.parametrize("name", SHAPES)
def test_areas(name: str) -> None:
    outline, area = SHAPES[name]
    assert outline.area == pytest.approx(area, rel=1e-12)
    assert turned(outline, 0.7).area == pytest.approx(area, rel=1e-12)


def test_places_and_nearest_points_agree() -> None:
    outline = Outline(np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 1.0], [2.0, 1.0], [2.0, 3.0], [0.0, 3.0]]))
    arc = np.linspace(0.0, outline.length, 57, endpoint=False)
    found, distance = outline.nearest(outline.place(arc))
    assert found == pytest.approx(arc, abs=1e-12)
    assert distance == pytest.approx(0.0, abs=1e-12)
    assert outline.contains(np.array([[1.0, 2.0], [3.0, 2.0]])).tolist() == [True, False]
    assert is_simple(outline.corners)
    assert not is_simple(outline.corners[[0, 2, 1, 3, 4, 5]])


@pytest.mark.parametrize("name", [*SHAPES, "notched"])
def test_every_wire_begins_and_ends_on_the_outline_and_stays_inside(name: str) -> None:
    """And nothing inside is left out: the wire inside is the area times the wire per area of endless cloth, but for what one
    more or less crossing of the edge makes."""
    scene = make_scene({})
    cloth = knit_cloth(scene.knit, scene.wire.diameter)
    outline = outline_of(name)
    cut = cut_strands(cloth, np.array([thread.spacing for thread in cloth.threads]), outline)
    total = 0.0
    for t, thread in enumerate(cloth.threads):
        curve = ThreadCurve(thread, cloth.size[1])
        here = cut.thread == t
        shift = np.stack([cut.column[here] * cloth.size[0], np.zeros(here.sum())], axis=1)
        for arc in (cut.arc_begin[here], cut.arc_end[here]):
            assert outline.nearest(curve(arc)[:, :2] + shift)[1] == pytest.approx(0.0, abs=1e-11)
        for share in np.linspace(0.02, 0.98, 40):
            arc = cut.arc_begin[here] + share * (cut.arc_end[here] - cut.arc_begin[here])
            place = curve(arc)[:, :2] + shift
            outside = ~outline.contains(place)
            # the samples that find crossings are a hundredth of a loop apart
            assert np.all(outline.nearest(place[outside])[1] < 1e-2 * cloth.stitch_length)
        total += float(np.sum(cut.arc_end[here] - cut.arc_begin[here]))
    density = sum(thread.length for thread in cloth.threads) / np.prod(cloth.size)
    assert total == pytest.approx(density * outline.area, rel=0.5 * outline.length * max(cloth.size) / outline.area / 4)


@pytest.mark.parametrize("name", [*SHAPES, "notched"])
def test_every_stretch_of_wire_inside_is_a_wire_of_the_cut(name: str) -> None:
    """Against the threads looked at every 4 um, wherever one may pass: what of them lies inside, from where to where. A stretch
    between two looks may be missed, so wires and stretches of up to two looks need no partner; all others agree to a look."""
    scene = make_scene({})
    cloth = knit_cloth(scene.knit, scene.wire.diameter)
    outline = outline_of(name)
    cut = cut_strands(cloth, np.array([thread.spacing for thread in cloth.threads]), outline)
    for t, thread in enumerate(cloth.threads):
        curve = ThreadCurve(thread, cloth.size[1])
        looks = round(curve.length / 4e-6)
        step = curve.length / looks
        place = curve(step * np.arange(looks))[:, :2]
        below, above = outline.low[1] / cloth.size[1], (outline.low + outline.size)[1] / cloth.size[1]
        rows = np.arange(np.floor(below) - 2, np.ceil(above) + 3)
        for column in range(cut.columns[0] - 1, cut.columns[-1] + 2):
            strand = np.concatenate([place + [column * cloth.size[0], row * cloth.size[1]] for row in rows])
            there = np.diff(np.concatenate([[0], outline.contains(strand).astype(int), [0]]))
            stretches = rows[0] * curve.length + step * np.stack([np.flatnonzero(there == 1), np.flatnonzero(there == -1) - 1])
            here = (cut.thread == t) & (cut.column == column)
            wires = np.stack([cut.arc_begin[here], cut.arc_end[here]])
            long = [ends[:, ends[1] - ends[0] > 2.0 * step] for ends in (stretches, wires)]
            for ends, others in ((long[0], wires), (long[1], stretches)):
                missed = np.abs(ends[:, :, None] - others[:, None, :]).max(axis=0).min(axis=1, initial=np.inf)
                assert np.all(missed <= step)


def outline_of(name: str) -> Outline:
    """One of SHAPES, turned where it is no rectangle, or one with a notch."""
    if name == "notched":
        return Outline(1e-2 * np.array([[-2.0, -1.5], [2.0, -1.5], [2.0, 1.5], [0.3, 0.1], [-2.0, 1.4]]))
    return turned(SHAPES[name][0], 0.0 if name == "rectangle" else 0.3)


def test_the_mesh_of_a_polygon_that_is_a_rectangle_is_that_of_the_rectangle() -> None:
    width, height = make_scene({"knit": {"repeats": [3, 2]}}).knit.size
    half = [0.5 * width, 0.5 * height]
    corners = [[-half[0], -half[1]], [half[0], -half[1]], [half[0], half[1]], [-half[0], half[1]]]
    one = build_model(make_scene({"knit": {"repeats": [3, 2]}})).panel
    other = build_model(make_scene({"panel": {"outline": "polygon", "corners": corners}})).panel
    assert other.node_count == one.node_count
    assert np.array_equal(other.pair_seed, one.pair_seed)
    assert other.clamp_position == pytest.approx(one.clamp_position, abs=1e-15)
    assert other.area == pytest.approx(one.area)


def test_corners_from_a_file(tmp_path: Path) -> None:
    (tmp_path / "facet.csv").write_text("x [mm], y [mm]\n-10, -8\n10, -8\n\n10, 8\n-10, 8\n-10, -8\n")
    (tmp_path / "scene.toml").write_text('[panel]\noutline = "polygon"\nfile = "facet.csv"\n')
    scene = load_scene(tmp_path / "scene.toml")
    assert scene.panel.corners == ((-0.01, -0.008), (0.01, -0.008), (0.01, 0.008), (-0.01, 0.008))
    assert scene.knit.repeats == (6, 4)
    (tmp_path / "again.toml").write_text(resolved_toml(scene))
    assert load_scene(tmp_path / "again.toml") == scene
    (tmp_path / "facet.csv").write_text("10 mm, 8 mm\n-10 mm, 8 mm\n-10 mm, -8 mm\n")
    assert load_scene(tmp_path / "scene.toml").panel.corners == ((0.01, 0.008), (-0.01, 0.008), (-0.01, -0.008))


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (None, "'facet.csv'"),
        ("x,y\n1,2\n3\n", "'3' in line 3"),
        ("x,y\n1,2 kg\n", "line 2"),
        ("1,2\n3,4\n", "2 corners"),
        ("0,0\n1,1\n1,0\n0,1\n", "outline"),
        (b"\xff\xfe\x00", "not text"),
    ],
)
def test_a_bad_file_of_corners_is_one_clear_line(tmp_path: Path, content: str | bytes | None, said: str) -> None:
    if content is not None:
        (tmp_path / "facet.csv").write_bytes(content if isinstance(content, bytes) else content.encode())
    (tmp_path / "scene.toml").write_text('[panel]\noutline = "polygon"\nfile = "facet.csv"\n')
    with pytest.raises(SceneError) as error:
        load_scene(tmp_path / "scene.toml")
    assert "panel.file" in str(error.value)
    assert said in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("table", "key"),
    [
        ({"panel": {"outline": "hexagon"}}, "panel.size"),
        ({"panel": {"size": 0.1}}, "panel.size"),
        ({"panel": {"outline": "hexagon", "size": 0.02}, "knit": {"repeats": [50, 50]}}, "knit.repeats"),
        ({"panel": {"corners": [[0, 0], [1, 0], [0, 1]]}}, "panel.corners"),
        ({"panel": {"grip_pitch": 0.01}}, "panel.cord"),
        ({"panel": {"cord": {"tension": 1, "stiffness": 1}}}, "panel.grip_pitch"),
        ({"panel": {"outline": "hexagon", "size": 0.02}, "model": {"boundary": "periodic"}}, "model.boundary"),
        ({"panel": {"rotation": 1.0}}, "panel.rotation"),
        ({"load": {"pull": [{"at": [0, 0], "by": [0, 0]}]}}, "load.pull[0].at"),
        ({"load": {"pull": [{"at": [1.7e-3, 0], "by": [0, 0]}]}}, "load.pull[0].width"),
        ({"load": {"pull": [{"at": [1.7e-3, 0], "by": [1, 0], "width": 1e-3}]}}, "load.pull[0].by"),
        ({"load": {"temperature_gradient": [1e6, 0]}}, "load.temperature_gradient"),
        ({"panel": {"outline": "polygon", "corners": [[0, 0], [1, 1], [2, 2]]}}, "panel.corners"),
        ({"load": {"pull": [{"at": [0, 0, 0], "by": [0, 0]}]}}, "load.pull[0].at"),
        ({"load": {"temperature_gradient": [1, 1]}, "model": {"boundary": "periodic"}}, "load.temperature_gradient"),
        ({"load": {"temperature_gradient": [1, 1]}, "solver": {"drive": "ramp"}}, "load.temperature_gradient"),
        ({"panel": {"grip_pitch": 0.01, "cord": {"tension": 1, "stiffness": 1}}, "solver": {"drive": "ramp"}}, "panel.cord"),
        ({"load": {"pull": [{"at": [1.7e-3, 0], "by": [0, 0], "width": 1e-3}]}, "solver": {"drive": "ramp"}}, "load.pull"),
    ],
)
def test_keys_that_clash_are_named(table: dict, key: str) -> None:
    with pytest.raises(SceneError) as error:
        make_scene(table)
    assert f" {key}: " in str(error.value)


def test_an_outline_that_holds_no_wire_is_refused() -> None:
    from warpknit.base.errors import ModelError

    with pytest.raises(ModelError, match=r"panel\.size"):
        build_model(make_scene({"panel": {"outline": "triangle", "size": 1e-4}}))
