"""`warpknit view`: what is drawn of a record, what a click finds, and the page in a browser."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import warpknit
from warpknit.errors import ExportError
from warpknit.export.view import drawing as drawings
from warpknit.export.view.drawing import Drawing, drawing_of
from warpknit.frame import Frame, WireLayout

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
        start=np.array([0, points, 2 * points]),
        place=np.array([[0.0, 0.0, radius]]),
        force=np.array([3.0]),
        is_active=np.array([True]),
        number=np.array([0]),
        wires=np.array([[0, 1]]),
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
    """Two copies each way of every contact, and wires that go on at the edges."""
    frame = make_frame(0)
    drawing = drawing_of(layout, frame)
    if layout.wire_closed.any():
        assert np.bincount(drawing.number, minlength=layout.body_count).tolist() == [4] * layout.body_count
        size = 1e3 * np.abs(frame.deformation) @ (2.0 * layout.period)
        assert np.all(drawing.points[:, :2].min(axis=0) >= 0.0) and np.all(drawing.points[:, :2].max(axis=0) <= size)
    np.testing.assert_allclose(drawing.radius, 0.5e3 * layout.diameter)


def test_a_directory_without_records_is_refused(tmp_path: Path) -> None:
    viewer = pytest.importorskip("warpknit.export.view.viewer", reason="extra `view` is not installed")
    with pytest.raises(ExportError, match="allowed: that of a run that has begun"):
        viewer.Viewer(tmp_path)


@pytest.mark.slow
def test_the_page_in_a_browser(tmp_path: Path) -> None:
    """It draws, another record looks different, a click tells the numbers of a wire, and nothing is asked of another machine."""
    viewers = pytest.importorskip("warpknit.export.view.viewer", reason="extra `view` is not installed")
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    browser = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if browser is None:
        pytest.skip("no Chromium")
    settings = {"output.usd": False, "output.figures": False, "output.frames": 2}
    warpknit.run(warpknit.load_scene(CELL, settings, preset="draft"), tmp_path / "run", device="cpu", quiet=True)
    viewer = viewers.Viewer(tmp_path / "run", port=0)
    asked = []
    with playwright.sync_playwright() as session:
        arguments = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]
        chromium = session.chromium.launch(executable_path=browser, args=arguments)
        page = chromium.new_page(viewport={"width": 1000, "height": 600})
        page.on("request", lambda request: asked.append(request.url))
        page.goto(viewer.url)
        page.get_by_text("wire or a contact").wait_for(timeout=SETTLE)
        page.wait_for_timeout(5000)
        last = _pixels(page, tmp_path)
        assert np.count_nonzero(np.ptp(last, axis=(0, 1)) > 50) == 3  # not blank
        viewer.record.value = 0
        page.wait_for_timeout(3000)
        first = _pixels(page, tmp_path)
        assert np.count_nonzero(np.abs(first - last).max(axis=2) > 50) > 100
        drawn = np.argwhere(np.abs(first - 255.0).max(axis=2) > 100) + [TOP, 0]
        y, x = drawn[np.argmin(np.linalg.norm(drawn - [300, 350], axis=1))]
        page.mouse.click(int(x), int(y), delay=30)
        page.get_by_text("of the elastic limit").or_(page.get_by_text("force")).first.wait_for(timeout=SETTLE)
        chromium.close()
    viewer.stop()
    assert all(url.startswith((viewer.url, "data:", "blob:")) for url in asked)


def _pixels(page: object, folder: Path) -> np.ndarray:
    """(y, x, 3) 0 .. 255 of the part of the page beside its controls."""
    from matplotlib.image import imread

    page.screenshot(path=folder / "page.png", timeout=60_000)
    return 255.0 * imread(folder / "page.png")[TOP:, :680, :3]
