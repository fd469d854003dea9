"""A swatch of one wire whose two ends lie on one side of it."""

from pathlib import Path

import numpy as np
import pytest
from swatches import swatch

from warpknit.scene import make_scene
from warpknit.solve.model import build_model


def test_ends_on_one_side_hold_no_width(tmp_path: Path) -> None:
    """A swatch of an even number of rows begins and ends on its left side: tensions in weft are then those over its own width."""
    np.savez(tmp_path / "swatch.npz", wire=swatch("plain", 6, 4, 0.5))
    wires = {"file": "swatch.npz", "unit": "m", "loop_size": "5.5 mm"}
    tables = {"wires": wires, "wire": {"diameter": "1 mm"}, "contact": {"friction": 0.0}}
    model = build_model(make_scene(tables, path=tmp_path / "swatch.toml"))
    clamps = model.panel.clamp_position
    assert np.ptp(clamps[:, 0]) < 1e-3
    assert model.panel.clamp_share == pytest.approx([1.0, np.ptp(clamps[:, 1]) / model.panel.size[1]])
