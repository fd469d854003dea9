"""The plan view is drawn: a PNG of the expected size, whole or absent."""

import pytest

from reference.knits import FINE, cloth
from warpknit.export.knit_figure import knit_figure


@pytest.mark.parametrize("name", ["paper", "pillar", "inlaid pillar"])
def test_figure_is_written(name, tmp_path):
    path = knit_figure(cloth(name), FINE, tmp_path / "figures" / "knit.png", columns=2, rows=1)
    assert path.read_bytes().startswith(b"\x89PNG")
    assert [file.name for file in path.parent.iterdir()] == ["knit.png"]
