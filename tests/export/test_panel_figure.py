"""Picture of a panel: the colours of every quantity cover all of its tiles."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure

from warpknit.export import figures


def test_the_colours_cover_all_tiles(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Five by five tiles, those at the edge under ten times the stress and thrice the tension: the first and the last colour
    are the least and the largest value. Equal values keep a range of 2 %."""
    drawn: list[Figure] = []
    monkeypatch.setattr(figures, "save_figure", lambda figure, _path: drawn.append(figure))
    weft, warp = (1e-3 * grid.ravel() for grid in np.meshgrid(np.arange(5.0), np.arange(5.0)))
    at_edge = (np.abs(weft - 2e-3) > 1.5e-3) | (np.abs(warp - 2e-3) > 1.5e-3)
    tiles = {
        "weft_m": weft, "warp_m": warp, "x_m": weft, "y_m": warp, "inside": np.ones(25),
        "active_percent": np.full(25, 60.0), "stress_max_Pa": np.where(at_edge, 1.4e9, 1.4e8),
        "tension_weft_N_per_m": np.where(at_edge, 0.09, 0.03), "tension_warp_N_per_m": np.full(25, 0.05),
    }  # fmt: skip
    square = 1e-3 * np.array([[-0.5, -0.5], [4.5, -0.5], [4.5, 4.5], [-0.5, 4.5]])
    edge = {"x_m": square[:, 0], "y_m": square[:, 1], "held": np.ones(4)}
    figures.panel_figure({"map": tiles, "edge": edge}, tmp_path / "panel.png", "")
    (figure,) = drawn
    ranges = [image.get_clim() for axes in figure.axes for image in axes.collections if isinstance(image, QuadMesh)]
    assert ranges[:4] == [pytest.approx(of) for of in ((0.0, 100.0), (140.0, 1400.0), (30.0, 90.0), (50.0, 51.0))]
