"""Pictures of contact maps: read back from the file."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from warpknit.export.map_figure import Marks, map_figure

STRAINS = [0.0, 0.05, 0.1]
RISING = np.add.outer(np.arange(3.0), np.arange(3.0)) * 20.0
LIMIT = (0xD5 / 255, 0x5E / 255, 0.0)
BLANK = (0xE8 / 255, 0xE8 / 255, 0xE8 / 255)


def share_of(colour: tuple[float, float, float], path: Path) -> float:
    """Share of the picture in a colour."""
    picture = imread(path)[..., :3]
    return float(np.mean(np.all(np.abs(picture - colour) < 1 / 255, axis=2)))


def draw(path: Path, values: np.ndarray, limit: float = 1e9, optimum: tuple[float, float] | None = None) -> Path:
    marks = Marks(stress=np.where(np.isnan(values), np.nan, RISING * 1e6), yield_stress=limit, optimum=optimum)
    strains = STRAINS[: values.shape[0]]
    return map_figure(path, STRAINS, strains, values, title="a mesh", label="share [%]", percent=True, marks=marks)


def test_the_elastic_limit_is_drawn_where_it_runs_through_the_map(tmp_path):
    """Stress goes from 0 to 80 MPa: a limit of 30 MPa is a line on the map, one of 1 GPa is nowhere."""
    assert share_of(LIMIT, draw(tmp_path / "a.png", RISING, limit=30e6)) > 1e-3
    assert share_of(LIMIT, draw(tmp_path / "b.png", RISING, limit=1e9)) == 0.0


def test_cells_without_a_value_stay_blank(tmp_path):
    """The middle cell of nine, those at the edges being shown by half: a quarter of the map, about 0.55 of the picture."""
    holed = RISING.copy()
    holed[1, 1] = np.nan
    assert share_of(BLANK, draw(tmp_path / "a.png", RISING)) < 1e-4  # edges of letters
    assert share_of(BLANK, draw(tmp_path / "b.png", holed)) == pytest.approx(0.55 / 4, rel=0.25)


@pytest.mark.parametrize("values", [np.zeros((3, 3)), np.full((3, 3), np.nan)])
def test_maps_without_contrast_are_drawn(tmp_path, values):
    assert draw(tmp_path / "a.png", values, optimum=(0.05, 0.05)).stat().st_size > 0
