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
    """Two pairs of contacts at two places 1.2 spacings apart, joined by a third between them, and one far away, which stays."""
    bodies = np.array([[0.0, 0.0], [0.0, 0.0], [1.2, 0.0], [1.2, 0.0], [0.6, 0.0], [9.0, 0.0]])
    classes = np.array([0, 1, 0, 1, 0, 1])
    places = np.concatenate(_places(bodies, classes, 1.0))
    apart = np.linalg.norm(places[:, None] - places, axis=2)
    assert apart[~np.eye(len(places), dtype=bool)].min() == pytest.approx(1.0)
    assert places[-1] == pytest.approx([9.0, 0.0]) and places[:-1].mean(axis=0) == pytest.approx([0.6, 0.0])
