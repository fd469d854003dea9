"""The plan view is drawn: a PNG of the expected size, whole or absent."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from reference.knits import FINE, cloth
from warpknit.export import knit_figure as module
from warpknit.export.knit_figure import _places, knit_figure

pytestmark = pytest.mark.usefixtures("pictures")


@pytest.mark.parametrize("name", ["paper", "pillar", "inlaid pillar"])
def test_figure_is_written(name, tmp_path):
    path = knit_figure(cloth(name), FINE, tmp_path / "figures" / "knit.png")
    assert path.read_bytes().startswith(b"\x89PNG")
    assert [file.name for file in path.parent.iterdir()] == ["knit.png"]


def test_marks_of_contacts_near_each_other_stand_one_above_the_other():
    """Two pairs of contacts at two places 1.2 spacings apart, joined by a third between them, and one far away, which stays. The
    same where the places lie on both sides of the seam between two repeats."""
    bodies = np.array([[0.0, 0.0], [0.0, 0.0], [1.2, 0.0], [1.2, 0.0], [0.6, 0.0], [9.0, 0.0]])
    classes = np.array([0, 1, 0, 1, 0, 1])
    period = np.diag([20.0, 20.0])
    for seam in (0.0, 19.0):  # the second place and the third one are then in the next repeat
        moved = (bodies + [seam, 0.0]) % 20.0
        marks, stack = _places(moved, classes, 1.0, period)
        between = marks[:, None] - marks
        apart = np.linalg.norm(between - 20.0 * np.round(between / 20.0), axis=2)
        assert apart[~np.eye(len(marks), dtype=bool)].min() == pytest.approx(1.0)
        places = (marks - [seam, 0.0] + 10.0) % 20.0 - 10.0  # each beside the first
        assert places[-1] == pytest.approx([9.0, 0.0]) and places[:-1].mean(axis=0) == pytest.approx([0.6, 0.0])
        assert places[:-1, 0] == pytest.approx(0.6) and np.all(stack[:-1] == stack[0]) and stack[-1] != stack[0]


@pytest.mark.parametrize("name", ["reverse locknit", "full double atlas", "atlas", "paper"])
def test_marks_of_contacts_are_whole_and_the_legend_is_under_the_picture(name, tmp_path, monkeypatch):
    """Two contacts of each place have a class of their own: both letters of a place are drawn, in the picture, over no other."""
    kept = []
    monkeypatch.setattr(module, "save_figure", lambda figure, path: kept.append(figure))
    classes = np.arange(len(cloth(name).clasps)) % 2
    knit_figure(replace(cloth(name), classes=classes), FINE, tmp_path / "knit.png")
    [figure] = kept
    figure.draw_without_rendering()
    [axes], [legend] = figure.axes, figure.legends
    letters = [line for line in axes.lines if "mathbf" in str(line.get_marker())]
    points = np.concatenate([axes.transData.transform(line.get_xydata()) for line in letters]) * 72.0 / figure.dpi
    assert cKDTree(points).query(points, 2)[0][:, 1].min() > 0.99 * module.MARK_SPACING
    room = 72.0 / figure.dpi * np.array([axes.bbox.min, axes.bbox.max])
    assert np.all(points > room[0] + 0.5 * module.MARK_SIZE) and np.all(points < room[1] - 0.5 * module.MARK_SIZE)
    frame = legend.get_window_extent()
    assert frame.y1 < axes.bbox.y0 and figure.bbox.x0 <= frame.x0 and frame.x1 <= figure.bbox.x1 and not axes.get_title()
