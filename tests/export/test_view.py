"""`warpknit view`: what is drawn of a record, what a click finds, and the page in a browser."""

import json
import re
import shutil
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.colorbar import Colorbar

import warpknit
from warpknit.base.errors import InputError, RunDirectoryError
from warpknit.base.text import engineering
from warpknit.export.view import drawing as drawings
from warpknit.export.view import open_viewer
from warpknit.export.view.drawing import Drawing, drawing_of
from warpknit.results.frame import Frame, WireLayout
from warpknit.results.run import Run

pytestmark = pytest.mark.usefixtures("pictures")

CELL = Path(__file__).parents[2] / "scenes" / "atlas_cell.toml"
TOP = 160  # [pixels] of the page that tell about the renderer
SETTLE = 20_000  # [ms] at most, until the page has drawn


def straight(points: int = 11, radius: float = 0.1) -> Drawing:
    """A wire along x from -5 to 5 mm and one along y above it, with a contact between them."""
    x = np.linspace(-5.0, 5.0, points)
    zero = np.zeros(points)
    return Drawing(
        radius=radius,
        points=np.concatenate([np.stack([x, zero, zero], axis=1), np.stack([zero, x, zero + 2.0 * radius], axis=1)]),
        stress=np.concatenate([np.full(points, 10.0), np.full(points, 20.0)]),
        wire=np.repeat([0, 1], points),
        index=np.arange(2 * points),
        start=np.array([0, points, 2 * points]),
        place=np.array([[0.0, 0.0, radius]]),
        force=np.array([3.0]),
        is_active=np.array([True]),
        number=np.array([0]),
    )


def test_tubes_are_as_thick_as_the_wires_and_do_not_join_them() -> None:
    drawing = straight()
    vertices, faces = drawing.tubes(8)
    around = vertices.reshape(len(drawing.points), 8, 3) - drawing.points[:, None]
    np.testing.assert_allclose(np.linalg.norm(around, axis=2), drawing.radius, rtol=1e-12)
    np.testing.assert_allclose(around[:11, :, 0], 0.0, atol=1e-15)  # circles across the wire
    assert len(faces) == 2 * 8 * 20 and np.all(drawing.wire[faces // 8] == drawing.wire[faces // 8][:, :1])
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    shared = np.unique(edges, axis=0, return_counts=True)[1]
    assert set(shared.tolist()) == {1, 2} and np.count_nonzero(shared == 1) == 4 * 8  # open at the four ends alone


def test_a_steep_wire_has_a_tube() -> None:
    drawing = straight()
    upright = replace(drawing, points=drawing.points[:, [2, 1, 0]])
    around = upright.tubes(6)[0].reshape(len(upright.points), 6, 3) - upright.points[:, None]
    np.testing.assert_allclose(np.linalg.norm(around, axis=2), upright.radius, rtol=1e-12)


def test_a_part_begins_new_pieces_where_wires_enter_it() -> None:
    drawing = straight()
    bent = replace(drawing, points=np.where(np.arange(22)[:, None] == 5, [[0.0, 9.0, 0.0]], drawing.points))
    part = bent.within(np.array([-2.5, -2.5]), np.array([2.5, 2.5]))
    assert part.wire.tolist() == [0] * 4 + [1] * 5 and part.start.tolist() == [0, 2, 4, 9]
    assert part.segment.tolist() == [0, 2, 4, 5, 6, 7] and part.number.tolist() == [0]


def test_large_meshes_are_lines_with_fewer_points(monkeypatch: pytest.MonkeyPatch) -> None:
    drawing = straight(points=10)
    assert drawing.sides == drawings.SIDES[0]
    monkeypatch.setattr(drawings, "TUBE_VERTICES", 20 * drawings.SIDES[-1])
    assert drawing.sides == drawings.SIDES[-1]
    monkeypatch.setattr(drawings, "TUBE_VERTICES", 20 * drawings.SIDES[-1] - 1)
    assert drawing.sides == 0
    monkeypatch.setattr(drawings, "LINES", 5)
    thin = drawing.thinned()
    assert len(thin.segment) <= 6 and thin.start.tolist() == [0, 4, 8]
    np.testing.assert_array_equal(thin.points[thin.start[1:] - 1], drawing.points[[9, 19]])


def test_a_ray_finds_the_contact_then_the_upper_wire() -> None:
    drawing, down = straight(), np.array([0.0, 0.0, -1.0])
    assert drawing.pick(np.array([0.05, 0.0, 9.0]), down, 0.0) == (0, None)
    contact, point = drawing.pick(np.array([0.05, 3.0, 9.0]), down, 0.0)
    assert contact is None and drawing.wire[point] == 1 and drawing.points[point][1] == 3.0
    contact, point = drawing.pick(np.array([3.0, 0.05, 9.0]), down, 0.0)
    assert contact is None and drawing.wire[point] == 0
    assert drawing.pick(np.array([3.0, 3.0, 9.0]), down, 0.0) == (None, None)
    assert drawing.pick(np.array([3.0, 0.0, -9.0]), down, 0.0) == (None, None)  # behind the eye


def test_a_tile_is_drawn_in_copies(layout: WireLayout, make_frame: Callable[..., Frame]) -> None:
    """Every contact as often as there are copies, which make the part about square, and wires that go on at the edges."""
    for shape, copies in (([1.0, 1.0], [3, 2]), ([1.0, 4.0], [8, 2]), ([4.0, 1.0], [2, 6]), ([40.0, 1.0], [2, 8])):
        tile, frame = replace(layout, period=layout.period * shape), make_frame(0)
        drawing = drawing_of(tile, replace(frame, body_position=np.ones((layout.body_count, 1)) * [[1e-3, 1e-3, 0.0]]))
        assert np.bincount(drawing.number).tolist() == [np.prod(copies)] * layout.body_count
        size = 1e3 * tile.period * copies
        assert np.all(drawing.points[:, :2] >= 0.0) and np.all(drawing.points[:, :2] <= size)
    np.testing.assert_allclose(drawing.radius, 0.5e3 * layout.diameter)


def test_a_drawing_knows_where_its_points_are_in_the_run(layout: WireLayout, make_frame: Callable[..., Frame]) -> None:
    """In copies, in a part, with fewer points: index and wire belong to the stress of the run."""
    frame = make_frame(3)
    drawing = drawing_of(layout, frame)
    stress = 1e-6 * frame.node_stress[layout.curve_node]
    wire = np.repeat(np.arange(layout.wire_count), np.diff(layout.curve_start))
    for part in (drawing, drawing.within(np.array([1.0, 1.0]), np.array([3.0, 5.0])), drawing.thinned()):
        np.testing.assert_array_equal(part.stress, stress[part.index])
        np.testing.assert_array_equal(part.wire, wire[part.index])


def write_run(directory: Path, layout: WireLayout, frames: list[Frame], **tree: object) -> Path:
    """A run that has these records; without `tree`, of its summary, it is not finished."""
    layout.save(directory / "layout.npz")
    (directory / "states").mkdir(exist_ok=True)
    for frame in frames:
        frame.save(directory / "states" / f"state_{frame.index:06d}.npz")
    if tree:
        (directory / "summary.json").write_text(json.dumps({"scene": {"name": "made-up"}, **tree}), encoding="utf-8")
    return directory


@pytest.fixture
def open_view() -> Iterator[Callable[[Path], Any]]:
    """Viewers without a browser, closed at the end."""
    pytest.importorskip("viser", reason="extra `view` is not installed")
    opened: list[Any] = []

    def opening(directory: Path) -> Any:
        opened.append(open_viewer(directory, port=0))
        return opened[-1]

    yield opening
    for viewer in opened:
        viewer.stop()


def above(viewer: Any, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A ray of sight from above through a place [mm] of the run."""
    return place - viewer.middle + [0.0, 0.0, 30.0], np.array([0.0, 0.0, -1.0])


def test_a_click_tells_numbers_that_follow_the_record(
    layout: WireLayout, make_frame: Callable[..., Frame], tmp_path: Path, open_view: Callable[[Path], Any]
) -> None:
    layout = replace(layout, body_class=np.arange(layout.body_count) % 3)
    frames = [make_frame(index) for index in range(3)]
    viewer = open_view(write_run(tmp_path, layout, frames, wire={"yield_stress_Pa": 2e9}))
    drawing = viewer.drawing
    number = int(np.argmax(frames[-1].body_force))
    contact = drawing.place[np.flatnonzero(drawing.number == number)[0]]
    viewer.pick(*above(viewer, contact))
    a, b = layout.body_wires[number]
    text = viewer.picked.content
    assert f"**contact {number}**, active, class {'ABC'[number % 3]}" in text and f"wires {a} and {b}" in text
    assert f"force {engineering(frames[-1].body_force[number], 'N')}" in text
    viewer.record.value = 0
    viewer.show(0)
    assert f"**contact {number}**, open" in viewer.picked.content and "strain weft 0.0 %" in viewer.title.content

    viewer.show(2)
    point = int(np.argmax(viewer.drawing.points[:, 1]))  # at the edge, away from contacts
    index, wire = viewer.drawing.index[point], viewer.drawing.wire[point]
    viewer.pick(*above(viewer, viewer.drawing.points[point]))
    stress = 1e-6 * frames[2].node_stress[layout.curve_node][index]
    assert f"**wire {wire}**" in viewer.picked.content and f"stress {engineering(1e6 * stress, 'Pa')}," in viewer.picked.content
    assert f" {100 * stress / 2000:.0f} % " in viewer.picked.content
    viewer.pick(np.array([0.0, 0.0, 90.0]), np.array([0.0, 0.0, 1.0]))  # away from it
    assert viewer.picked.content == viewers().ASK


def test_a_click_tells_a_contact_elsewhere_and_follows_its_wires(
    space_layout: WireLayout, make_space_frame: Callable[..., Frame], tmp_path: Path, open_view: Callable[[Path], Any]
) -> None:
    """Numbers of the record that is shown; in one where these wires do not touch elsewhere, none. The scale reaches its force."""
    layout = replace(space_layout, wire_closed=np.zeros(7, dtype=bool), body_class=np.zeros(space_layout.body_count))
    frames = [
        make_space_frame(0, 2),
        make_space_frame(1, 0),
        replace(make_space_frame(2, 4), elsewhere_force=np.arange(4) * 1e-2),
    ]
    viewer = open_view(write_run(tmp_path, layout, frames))
    viewer.pick(*above(viewer, 1e3 * frames[2].elsewhere_position[1]))
    assert "**contact between stitches**, active  \nforce 10 mN  \nwires 1 and 2  \n" in viewer.picked.content
    assert "4 contacts between stitches" in viewer.title.content and viewer.largest_force == pytest.approx(3e4)
    viewer.show(1)
    assert viewer.picked.content == viewers().ASK and "between stitches" not in viewer.title.content
    viewer.show(0)
    assert "force 20 uN  \nwires 1 and 2" in viewer.picked.content


def test_colours_are_those_of_the_bars(
    layout: WireLayout, make_frame: Callable[..., Frame], tmp_path: Path, open_view: Callable[[Path], Any]
) -> None:
    """Open contacts are grey, the largest force and stress have the colours at the end, yield is cyan."""
    frame = make_frame(2)
    yields = 0.5 * float(frame.node_stress.max())
    viewer = open_view(write_run(tmp_path, layout, [frame], wire={"yield_stress_Pa": yields}))
    force = viewer._force_colours(viewer.drawing)
    assert np.all(force[~viewer.drawing.is_active] == viewers().OPEN)
    assert force[np.argmax(viewer.drawing.force)].tolist() == [0, 255, 127]
    stress = viewer._stress_colours(viewer.drawing)
    beyond = viewer.drawing.stress > 1e-6 * yields
    assert np.all(stress[beyond] == [0, 0xCF, 0xFF]) and np.all(stress[~beyond][:, 2] < 0xFF)
    assert f"{np.count_nonzero(frame.body_active)} of {layout.body_count} contacts active" in viewer.title.content


@pytest.mark.parametrize(("factor", "unit"), [(0.0, "nN"), (1e-3, "nN"), (1.0, "µN"), (1e3, "mN")])
def test_the_bar_of_forces_has_a_fitting_prefix(
    factor: float, unit: str, layout: WireLayout, make_frame: Callable[..., Frame], tmp_path: Path,
    open_view: Callable[[Path], Any], monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    """That of pictures, by the largest force of the run; forces of the fixture are some uN."""
    labels: list[str] = []
    monkeypatch.setattr(Colorbar, "set_label", lambda self, label: labels.append(label))
    frame = make_frame(2)
    largest = float(np.max(frame.body_force))
    open_view(write_run(tmp_path, layout, [replace(frame, pair_force=frame.pair_force * factor * 2e-6 / largest)]))
    assert f"[{unit}]" in labels[-1]


def test_a_run_that_goes_on_is_followed(
    layout: WireLayout, make_frame: Callable[..., Frame], tmp_path: Path, open_view: Callable[[Path], Any]
) -> None:
    """It has no summary; its second record has a slider, is shown and widens the scales."""
    viewer = open_view(write_run(tmp_path, layout, [make_frame(0)]))
    assert viewer.record.disabled and viewer.yield_stress is None and viewer.highest < 1e-6
    write_run(tmp_path, layout, [make_frame(1)])
    viewer.update()
    assert viewer.record.max == viewer.record.value == 1 and not viewer.record.disabled
    assert viewer.highest == pytest.approx(1e-6 * np.percentile(make_frame(1).node_stress, 99.5))
    viewer._follow()
    assert viewer.frame.index == 1


def test_a_large_mesh_says_what_is_left_out(
    layout: WireLayout, make_frame: Callable[..., Frame], tmp_path: Path, open_view: Callable[[Path], Any],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    """Lines without contacts that are too many; tubes about the place of a click; then all of it again."""
    monkeypatch.setattr(drawings, "TUBE_VERTICES", 20)
    monkeypatch.setattr(drawings, "LINES", 100)
    monkeypatch.setattr(viewers(), "SPHERES", 3)
    layout = replace(layout, repeats=np.array([6, 4]), wire_closed=np.zeros(7, dtype=bool))
    viewer = open_view(write_run(tmp_path, layout, [make_frame(1)]))
    assert viewer.note.content and not viewer.whole.visible
    assert len(viewer.shown.segment) < 120 < len(viewer.drawing.segment)
    viewer.pick(*above(viewer, viewer.shown.points[60]))
    assert " 3 mm" in viewer.note.content and viewer.whole.visible
    assert viewer.picked.content.startswith("**")
    viewer._move_to(None)
    assert " 3 mm" not in viewer.note.content and not viewer.whole.visible


def test_a_notebook_shows_the_page(
    layout: WireLayout, make_frame: Callable[..., Frame], tmp_path: Path, open_view: Callable[[Path], Any]
) -> None:
    pytest.importorskip("viser", reason="extra `view` is not installed")
    run = Run(write_run(tmp_path, layout, [make_frame(0)]), {})
    viewer = run.view(port=0)
    assert f'<iframe src="{viewer.url}"' in viewer._repr_html_() and viewer.url in repr(viewer)
    viewer.stop()


def test_without_the_extra_one_line_tells_how_to_install_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "warpknit.export.view.viewer", raising=False)
    monkeypatch.setitem(sys.modules, "trimesh", None)
    with pytest.raises(InputError, match=r'trimesh.*pip install .*\[view\]"$'):
        open_viewer(tmp_path)


def test_what_is_no_run_is_refused(layout: WireLayout, make_frame: Callable[..., Frame], tmp_path: Path) -> None:
    pytest.importorskip("viser", reason="extra `view` is not installed")
    for directory, said in ((tmp_path / "none", "no such directory"), (tmp_path, "not the directory of a run")):
        with pytest.raises(RunDirectoryError, match=said):
            open_viewer(directory)
    write_run(tmp_path, layout, [])
    with pytest.raises(RunDirectoryError, match=str(tmp_path)):
        open_viewer(tmp_path)
    write_run(tmp_path, layout, [make_frame(0)])
    for name, said in (("states/state_000000.npz", "not a saved Frame"), ("layout.npz", "not a saved WireLayout")):
        (tmp_path / name).write_text("torn")
        with pytest.raises(RunDirectoryError, match=said):
            open_viewer(tmp_path)


def test_a_host_that_is_not_this_machine_is_refused(layout: WireLayout, make_frame: Callable[..., Frame], tmp_path: Path) -> None:
    pytest.importorskip("viser", reason="extra `view` is not installed")
    write_run(tmp_path, layout, [make_frame(0)])
    with pytest.raises(InputError, match=r"^--host: '192\.0\.2\.1' "):
        open_viewer(tmp_path, host="192.0.2.1")


def viewers() -> Any:
    """The module of the page."""
    return pytest.importorskip("warpknit.export.view.viewer", reason="extra `view` is not installed")


@pytest.mark.slow
def test_the_page_in_a_browser(tmp_path: Path) -> None:
    """It draws, the slider changes the picture, a click tells the numbers of a wire, and nothing is asked of another machine."""
    viewers()
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    browser = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if browser is None:
        pytest.skip("no Chromium")
    settings = {"output.usd": False, "output.figures": False, "output.frames": 2}
    run = warpknit.run(warpknit.load_scene(CELL, settings, preset="draft"), tmp_path / "run", device="cpu", quiet=True)
    viewer, asked = run.view(port=0), []
    with playwright.sync_playwright() as session:
        arguments = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]
        chromium = session.chromium.launch(executable_path=browser, args=arguments)
        page = chromium.new_page(viewport={"width": 1000, "height": 600})
        page.on("request", lambda request: asked.append(request.url))
        page.goto(viewer.url)
        page.get_by_text("wire or a contact").wait_for(timeout=SETTLE)
        page.get_by_text("strain weft 10.0 %").wait_for(timeout=SETTLE)
        page.wait_for_timeout(5000)
        last = _pixels(page, tmp_path)
        assert np.count_nonzero(np.ptp(last, axis=(0, 1)) > 50) == 3  # not blank
        page.get_by_role("slider").press("Home")
        page.get_by_text("strain weft 0.0 %").wait_for(timeout=SETTLE)
        page.wait_for_timeout(3000)
        first = _pixels(page, tmp_path)
        assert np.count_nonzero(np.abs(first - last).max(axis=2) > 50) > 100
        page.get_by_role("checkbox").click()  # wires alone
        page.get_by_role("slider").press("End")
        page.get_by_text("strain weft 10.0 %").wait_for(timeout=SETTLE)
        page.wait_for_timeout(3000)
        drawn = np.argwhere(np.abs(_pixels(page, tmp_path) - 255.0).max(axis=2) > 100) + [TOP, 0]
        y, x = drawn[np.argmin(np.linalg.norm(drawn - [300, 350], axis=1))]
        page.mouse.click(int(x), int(y), delay=30)
        page.get_by_text("of the elastic limit").wait_for(timeout=SETTLE)
        told = viewer.picked.content
        chromium.close()
    viewer.stop()
    wire, stress = re.match(r"\*\*wire ([01])\*\*  \nstress ([0-9.]+) MPa", told).groups()
    first, end = run.layout.wire_start[int(wire) :][:2]
    assert 0.0 < 1e6 * float(stress) <= 1.01 * run.states[-1].node_stress[first:end].max()
    assert all(url.startswith((viewer.url, "data:", "blob:")) for url in asked)


def _pixels(page: object, folder: Path) -> np.ndarray:
    """(y, x, 3) 0 .. 255 of the part of the page beside its controls."""
    from matplotlib.image import imread

    page.screenshot(path=folder / "page.png", timeout=60_000)
    return 255.0 * imread(folder / "page.png")[TOP:, :680, :3]
