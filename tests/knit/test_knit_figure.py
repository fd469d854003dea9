"""The plan view is drawn: a PNG of the expected size, whole or absent."""

import numpy as np
import pytest

from reference.knits import FINE, cloth
from warpknit.export.knit_figure import _places, knit_figure


@pytest.mark.parametrize("name", ["paper", "pillar", "inlaid pillar"])
def test_figure_is_written(name, tmp_path):
    path = knit_figure(cloth(name), FINE, tmp_path / "figures" / "knit.png", columns=2, rows=1)
    assert path.read_bytes().startswith(b"\x89PNG")
    assert [file.name for file in path.parent.iterdir()] == ["knit.png"]


def test_marks_of_contacts_near_each_other_stand_side_by_side():
    """Two pairs of contacts at two places 1.2 spacings apart, joined by a third between them, and one far away, which stays. The
    same where the places lie on both sides of the seam between two repeats."""
    bodies = np.array([[0.0, 0.0], [0.0, 0.0], [1.2, 0.0], [1.2, 0.0], [0.6, 0.0], [9.0, 0.0]])
    classes = np.array([0, 1, 0, 1, 0, 1])
    period = np.diag([20.0, 20.0])
    for seam in (0.0, 19.0):  # the second place and the third one are then in the next repeat
        moved = (bodies + [seam, 0.0]) % 20.0
        marks = np.concatenate(_places(moved, classes, 1.0, period))
        between = marks[:, None] - marks
        apart = np.linalg.norm(between - 20.0 * np.round(between / 20.0), axis=2)
        assert apart[~np.eye(len(marks), dtype=bool)].min() == pytest.approx(1.0)
        places = (marks - [seam, 0.0] + [10.0, 0.0]) % 20.0 - [10.0, 0.0]  # each beside the first
        assert places[-1] == pytest.approx([9.0, 0.0]) and places[:-1, 0].mean() == pytest.approx(0.6)
