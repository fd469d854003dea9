"""Picture of a panel: the colours of a quantity cover nine in ten of its tiles; the others are marked."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure

from warpknit.export import figures


def test_the_colours_cover_nine_in_ten_tiles(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Five by five tiles: 16 at the edge have ten times the stress, which is the last colour. A single tile with 30 times the
    tension is beyond it, and the label has its value. Equal values keep a range of 2 %."""
    drawn: list[Figure] = []
    monkeypatch.setattr(figures, "save_figure", lambda figure, _path: drawn.append(figure))
    weft, warp = (1e-3 * grid.ravel() for grid in np.meshgrid(np.arange(5.0), np.arange(5.0)))
    at_edge = (np.abs(weft - 2e-3) > 1.5e-3) | (np.abs(warp - 2e-3) > 1.5e-3)
    tension = np.where(weft + warp == 0.0, 0.9, np.where(at_edge, 0.09, 0.03))
    tiles = {
        "weft_m": weft, "warp_m": warp, "x_m": weft, "y_m": warp, "inside": np.ones(25),
        "active_percent": np.full(25, 60.0), "stress_max_Pa": np.where(at_edge, 1.4e9, 1.4e8),
        "tension_weft_N_per_m": tension, "tension_warp_N_per_m": np.full(25, 0.05),
    }  # fmt: skip
    square = 1e-3 * np.array([[-0.5, -0.5], [4.5, -0.5], [4.5, 4.5], [-0.5, 4.5]])
    edge = {"x_m": square[:, 0], "y_m": square[:, 1], "held": np.ones(4)}
    figures.panel_figure({"map": tiles, "edge": edge}, tmp_path / "panel.png", "")
    (figure,) = drawn
    images = [image for axes in figure.axes[:4] for image in axes.collections if isinstance(image, QuadMesh)]
    ranges = [(0.0, 100.0), (140.0, 1400.0), (30.0, 90.0), (50.0, 51.0)]
    assert [image.get_clim() for image in images] == [pytest.approx(of) for of in ranges]
    bars = [image.colorbar for image in images]
    assert [bar.extend for bar in bars if bar] == ["neither", "neither", "max", "neither"]
    assert [bar.ax.get_ylabel().endswith("30 to 900") for bar in bars if bar] == [False, False, True, False]
