"""Wires over and under each other, and copies of a tile."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_rgba_array

from reference.histories import history
from warpknit.export import curves_figure, mesh_figure
from warpknit.export.plots import EDGE, copied, over_under, tile_copies
from warpknit.results.frame import Frame, WireLayout
from warpknit.results.row import columns_of

pytestmark = pytest.mark.usefixtures("pictures")


def test_the_higher_wire_is_drawn_later_on_a_white_edge() -> None:
    """Two wires that cross at heights 1 and -1: white and wire of the lower one, then of the higher one, 2 EDGE wider."""
    high, low = [[-1.0, 0.0, 1.0], [1.0, 0.0, 1.0]], [[0.0, -1.0, -1.0], [0.0, 1.0, -1.0]]
    lines = over_under(np.array([high, low]), to_rgba_array(["red", "blue"]), width=3.0, points_per_mm=100.0)
    assert np.array_equal(lines.get_colors(), to_rgba_array(["white", "blue", "white", "red"]))
    assert np.allclose(lines.get_linewidths(), [3.0 + 2.0 * EDGE, 3.0] * 2)


@pytest.mark.parametrize("shear", [0.0, 0.4])
def test_copies_fill_the_picture(shear: float) -> None:
    """A tile that winds over three widths: at every place of the window as many wires as the tile has over one width."""
    period = np.array([[2.0, shear], [0.0, 3.0]])
    place = np.linspace(0.0, 1.0, 61)
    wire = np.stack(
        [np.array([x, y, 0.0]) for x, y in np.outer(place, [0.0, 1.0]) @ period.T + np.outer(np.sin(np.pi * place), [6.0, 0])]
    )
    pieces = np.stack([wire[:-1], wire[1:]], axis=1)
    low, high = np.zeros(2), np.array([4.0, 6.0])
    shown, number = copied(pieces, tile_copies(wire[:, :2], period, low, high), low, high)
    assert len(shown) == len(number) and np.all(shown[:, :, :2].max(axis=1) > low) and np.all(shown[:, :, :2].min(axis=1) < high)
    many = np.stack(np.meshgrid(np.arange(-9, 10), np.arange(-9, 10)), axis=-1).reshape(-1, 2) @ period.T
    expected, _ = copied(pieces, many, low, high)
    assert sorted(map(tuple, shown.reshape(-1, 6).round(9))) == sorted(map(tuple, expected.reshape(-1, 6).round(9)))


def test_pictures_of_a_gripped_mesh_count_from_its_corner(
    tmp_path: Path, layout: WireLayout, make_frame: Callable[..., Frame], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Axes of the wires and of the map of a mesh go from its corner, as places in tables do; and those of a tile."""
    limits: list[np.ndarray] = []
    monkeypatch.setattr(mesh_figure, "frame_plan_axes", lambda axes, low, high: limits.append(np.stack([low, high])))
    gripped = replace(layout, wire_closed=np.zeros(layout.wire_count, bool), wire_closing=np.zeros((0, 2)))
    frame = make_frame(0, strain=0.0)
    mesh_figure.mesh_figure(gripped, frame, tmp_path / "wires.png", "")
    monkeypatch.setattr(mesh_figure, "SEGMENTS_DRAWN", 100)
    mesh_figure.mesh_figure(gripped, frame, tmp_path / "map.png", "")
    low, high = frame.node_position[:, :2].min(axis=0), frame.node_position[:, :2].max(axis=0)
    expected = 1e3 * np.stack([low, high])
    assert len(limits) == 3 and all(np.allclose(found, expected, atol=0.02) for found in limits)
    monkeypatch.undo()
    monkeypatch.setattr(mesh_figure, "frame_plan_axes", lambda axes, low, high: limits.append(np.stack([low, high])))
    mesh_figure.mesh_figure(layout, frame, tmp_path / "tile.png", "")
    assert np.allclose(limits[-1], [[0.0, 0.0], 2e3 * layout.period])


def test_equal_curves_both_show(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The one drawn first is wider than the one that covers it, by more than the width of the second."""
    drawn: list[object] = []
    monkeypatch.setattr(curves_figure, "save_figure", lambda figure, path: drawn.append(figure))
    rows = [row | {"tension_warp_N_per_m": row["tension_weft_N_per_m"]} for row in history(5)]
    curves_figure.curves_figure(columns_of(rows), tmp_path / "curves.png")
    first, second = drawn[0].axes[1].lines
    assert np.array_equal(first.get_ydata(), second.get_ydata()) and first.get_color() != second.get_color()
    assert first.get_linewidth() > 2.0 * second.get_linewidth()
