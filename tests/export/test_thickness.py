"""Wires are drawn as thick as the yarn: three wires of 30 um with 0.2 um of gold are 30.4 sqrt(3) um as a round bundle."""

import math

import pytest

from reference.meshes import SCENES
from warpknit.scene import load_scene
from warpknit.solve.model import build_model

YARN = ("wire.diameter='30 um'", "wire.ends=3", "wire.plating={material='gold', thickness='0.2 um'}")


@pytest.mark.parametrize("kind", ["planar", "spatial"])
def test_a_yarn_is_drawn_with_its_plating_and_all_its_ends(kind: str) -> None:
    layout = build_model(load_scene(SCENES / "atlas_cell.toml", [*YARN, f"model.kind={kind}"])).layout()
    assert layout.diameter == pytest.approx(math.sqrt(3.0) * 30.4e-6, rel=1e-12)
