"""Pictures of the mesh are whole images, for every kind of run; what they look like is for people to see."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from matplotlib.figure import Figure

from reference.images import check_image
from reference.in_words import quantities
from warpknit.export import mesh_figure
from warpknit.export.plots import BLUE, GREEN
from warpknit.mechanics.driven_strain import TOLERANCE
from warpknit.results.frame import Frame, WireLayout

pytestmark = pytest.mark.usefixtures("pictures")


@pytest.mark.parametrize("yield_stress", [None, 3e8, 3e9])
def test_mesh_figure(tmp_path: Path, layout: WireLayout, make_frame: Callable[..., Frame], yield_stress: float | None) -> None:
    frame = replace(make_frame(4, shear=0.05), temperature=83.15)
    path = mesh_figure.mesh_figure(layout, frame, tmp_path / "mesh.png", "a mesh", yield_stress=yield_stress)
    image = check_image(path)[..., :3]
    is_cyan = np.all(np.abs(image - (0.0, 0xCF / 255, 1.0)) < 0.02, axis=-1)
    assert is_cyan.any() == (yield_stress == 3e8)  # the largest stress is 400 MPa


@pytest.mark.parametrize("room", [0.0, 1e6])
def test_the_legend_says_which_contacts_are_not_drawn(
    room: float, tmp_path: Path, layout: WireLayout, make_frame: Callable[..., Frame], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Open contacts of small loops, without a mark; all marks of the legend are drawn."""
    monkeypatch.setattr(mesh_figure, "LEAST_ROOM", room)
    figures: list[Figure] = []
    monkeypatch.setattr(mesh_figure, "save_figure", lambda figure, path: figures.append(figure) or path)
    mesh_figure.mesh_figure(layout, make_frame(2), tmp_path / "mesh.png", "a mesh")
    [figure] = figures
    [legend] = figure.legends
    _, open_label, *_ = [text.get_text() for text in legend.get_texts()]
    circles = [line for line in figure.axes[0].lines if line.get_marker() == "o" and line.get_markerfacecolor() == "none"]
    blue = [line for line in circles if line.get_markeredgecolor() == BLUE]
    assert open_label.startswith("open ") and open_label.endswith(", not drawn") == (room > 0.0) == (not blue)
    assert (legend.get_lines()[1].get_marker() == "o") == bool(blue)


def test_mesh_figure_without_bodies(tmp_path: Path, layout: WireLayout, make_frame: Callable[..., Frame]) -> None:
    bare = replace(layout, body_wires=np.empty((0, 2)), rhombus_bodies=np.empty(0))
    empty = {"body_position": np.empty((0, 3)), "pair_force": np.empty(0), "pair_active": np.empty(0, bool)}
    check_image(mesh_figure.mesh_figure(bare, replace(make_frame(0, strain=0.0), **empty), tmp_path / "mesh.png", "a mesh"))


def test_big_mesh_is_drawn_as_a_map(
    tmp_path: Path, layout: WireLayout, make_frame: Callable[..., Frame], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mesh_figure, "SEGMENTS_DRAWN", 100)
    image = check_image(mesh_figure.mesh_figure(layout, make_frame(4), tmp_path / "map.png", "a mesh", yield_stress=1e9))
    assert image.shape[1] > image.shape[0]  # two panels


def test_cells_hold_every_point() -> None:
    """Each point lies in the cell that its coordinates name: column floor(x / width), row floor(y / height)."""
    position = np.array([[0.0, 0.0], [0.9, 0.1], [3.9, 1.9], [4.0, 2.0], [1.1, 1.1]])
    assert mesh_figure._cell_of(position, np.zeros(2), np.array([4.0, 2.0]), (2, 4)).tolist() == [0, 0, 7, 7, 5]
    assert mesh_figure._cells(np.array([4.0, 2.0]), 8.0, 100) == (2, 4)


def test_the_colours_of_stress_end_at_the_elastic_limit() -> None:
    """Equal stresses have equal colours in the pictures of two runs."""
    scales = [mesh_figure.stress_colours(np.array([highest]), 6e8)[1] for highest in (50.0, 300.0, 900.0)]
    assert [scale.vmax for scale in scales] == [600.0] * 3


def test_the_largest_stress_is_written_without_an_exponent() -> None:
    figure = Figure()
    axes = figure.subplots()
    drawn = axes.scatter([0.0, 1.0], [0.0, 1.0], c=[12.0, 1273.4], norm=mesh_figure.stress_colours(np.zeros(1), 2e9)[1])
    mesh_figure._stress_bar(figure, axes, drawn, 2e9)
    assert quantities(figure.axes[1].get_ylabel())[-2:] == ["1270", "2000"]


def test_the_largest_stress_of_a_picture_is_that_of_a_node(
    tmp_path: Path, layout: WireLayout, make_frame: Callable[..., Frame], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Pieces of wire between two nodes are drawn in the stress at their middle."""
    kept: list[Figure] = []
    monkeypatch.setattr(mesh_figure, "save_figure", lambda figure, path: kept.append(figure) or path)
    peak = np.zeros(layout.node_count)
    peak[7] = 4e8
    mesh_figure.mesh_figure(layout, replace(make_frame(4), node_stress=peak), tmp_path / "mesh.png", "a mesh")
    assert "400" in quantities(kept[0].axes[1].get_ylabel())


def test_the_largest_stress_is_marked_at_its_place_from_the_corner(
    tmp_path: Path, layout: WireLayout, make_frame: Callable[..., Frame], monkeypatch: pytest.MonkeyPatch
) -> None:
    """In pictures of single wires and in maps, with the value of the table; positions of the frame count from the corner."""
    kept: list[Figure] = []
    monkeypatch.setattr(mesh_figure, "save_figure", lambda figure, path: kept.append(figure) or path)
    frame = make_frame(4)
    x, y = np.asarray(frame.node_position)[7, :2]
    for drawn in (10**9, 1):
        monkeypatch.setattr(mesh_figure, "SEGMENTS_DRAWN", drawn)
        mesh_figure.mesh_figure(layout, frame, tmp_path / "mesh.png", "", peak=(2.64e8, x, y))
        (star,) = [line for line in kept[-1].axes[0].lines if line.get_marker() == "*"]
        assert np.ravel(star.get_data()) == pytest.approx([1e3 * x, 1e3 * y])
        assert ["264 MPa"] in [quantities(text.get_text()) for text in kept[-1].legends[0].get_texts()]


@pytest.mark.parametrize(
    ("tension", "text"),
    [((3.0, 2.99), ["3 N/m"]), ((3.0, 2.95), ["3.00 N/m", "2.95 N/m"])],
)
def test_a_title_has_one_tension_where_a_search_finds_one(
    tension: tuple[float, float], text: list[str], make_frame: Callable[..., Frame]
) -> None:
    """As tables have: what a search leaves between weft and warp is twice its tolerance."""
    assert mesh_figure.ONE_TENSION == 2.0 * TOLERANCE
    assert quantities(mesh_figure.state_title(make_frame(0), tension).splitlines()[1])[: len(text)] == text


def test_a_contact_under_the_largest_stress_shows(
    tmp_path: Path, layout: WireLayout, make_frame: Callable[..., Frame], monkeypatch: pytest.MonkeyPatch
) -> None:
    """At least a quarter of the blue of an active contact remains where the star stands on it."""
    monkeypatch.setattr(mesh_figure, "LEAST_ROOM", 0.0)
    one = make_frame(4)
    there = 1e3 * np.asarray(one.body_position)[np.argmax(one.body_active), :2]
    kept: list[Figure] = []
    save = mesh_figure.save_figure
    monkeypatch.setattr(mesh_figure, "save_figure", lambda figure, path: kept.append(figure) or save(figure, path))
    blue = []
    for name, peak in (("bare", None), ("star", (1e8, *(1e-3 * there)))):
        image = matplotlib.image.imread(mesh_figure.mesh_figure(layout, one, tmp_path / f"{name}.png", "", peak=peak))
        across, up = kept[-1].axes[0].transData.transform(there).astype(int)
        near = image[::-1][up - 9 : up + 10, across - 9 : across + 10, :3]
        blue.append(np.count_nonzero(np.abs(near - (0.0, 0x72 / 255, 0xB2 / 255)).max(axis=2) < 0.1))
    assert blue[1] > blue[0] / 4 > 0


@pytest.mark.parametrize("count", [0, 5])
@pytest.mark.parametrize("bodies", [True, False])
def test_contacts_elsewhere_are_diamonds_where_there_are_some(
    count: int, bodies: bool, tmp_path: Path, space_layout: WireLayout, make_space_frame: Callable[..., Frame],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    """At their places [mm], once in a mesh without copies, and in the legend; also where no wires hook at all. They hide no
    active contact: its dot is filled, over a hollow diamond, and the circle of an open one is beneath both."""
    layout, frame = replace(space_layout, wire_closed=np.zeros(7, dtype=bool)), make_space_frame(2, count)
    if not bodies:
        layout = replace(layout, body_wires=np.empty((0, 2)), rhombus_bodies=np.empty(0))
        frame = replace(frame, body_position=np.empty((0, 3)), pair_force=np.empty(0), pair_active=np.empty(0, bool))
    figures: list[Figure] = []
    monkeypatch.setattr(mesh_figure, "save_figure", lambda figure, path: figures.append(figure) or path)
    mesh_figure.mesh_figure(layout, frame, tmp_path / "mesh.png", "a mesh")
    monkeypatch.setattr(mesh_figure, "SEGMENTS_DRAWN", 100)
    mesh_figure.mesh_figure(layout, frame, tmp_path / "map.png", "a mesh")
    lines = figures[0].axes[0].lines
    [diamonds] = [line for line in lines if line.get_marker() == "D"]
    assert np.allclose(diamonds.get_xydata(), 1e3 * frame.elsewhere_position[:, :2], rtol=1e-12)
    assert diamonds.get_markerfacecolor() == "none"
    dots = [line for line in lines if line.get_marker() == "o" and line.get_markeredgecolor() != GREEN]
    assert len(dots) == 2 * bodies  # active, and open
    for line in dots:
        assert (line.get_markerfacecolor() != "none") == (line.get_zorder() > diamonds.get_zorder())
    told = [[text.get_text() for legend in figure.legends for text in legend.get_texts()] for figure in figures]
    for texts, not_drawn in zip(told, ("", ", not drawn"), strict=True):
        assert (f"active contacts between stitches: {count}{not_drawn}" in texts) == (count > 0)


@pytest.mark.parametrize("count", [40, 1000, 4000])
def test_marks_shrink_with_their_number_until_maps_are_drawn(
    count: int, tmp_path: Path, space_layout: WireLayout, make_space_frame: Callable[..., Frame], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A mark is a fifth of the mean distance of the drawn ones, and its dark edge a part of it: n of them cover at most
    n (pi/4) 0.2^2 A/n, 3 % of the mesh A. Where they had to be smaller than SMALLEST_MARK to do so, there are none."""
    layout = replace(space_layout, wire_closed=np.zeros(7, dtype=bool))
    figures: list[Figure] = []
    monkeypatch.setattr(mesh_figure, "save_figure", lambda figure, path: figures.append(figure) or path)
    frame = make_space_frame(4, count)
    mesh_figure.mesh_figure(layout, frame, tmp_path / "mesh.png", "a mesh")
    marks = [line for line in figures[0].axes[0].lines if line.get_marker() == "D"]
    size = np.prod(np.ptp(frame.node_position[:, :2], axis=0))
    distance = 72.0 * mesh_figure.PLAN_SIZE * np.sqrt(size / count) / np.ptp(frame.node_position[:, :2], axis=0).max()  # [pt]
    is_map = mesh_figure.MARK * distance < mesh_figure.SMALLEST_MARK
    assert is_map == (count == 4000) == (not marks)
    assert len([axes for axes in figures[0].axes if axes.get_xlabel()]) == 1 + is_map
    for line in marks:
        assert line.get_markersize() <= max(mesh_figure.MARK * distance, mesh_figure.SMALLEST_MARK)
        (stroke,) = line.get_path_effects()
        assert stroke._gc["linewidth"] < 0.4 * line.get_markersize()
