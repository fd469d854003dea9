"""What a run says of its own result because of what was asked for; odd constants and loads are in test_extremes.py."""

from pathlib import Path

import pytest

from warpknit.model import build_model
from warpknit.run.cautions import cautions
from warpknit.scene import load_scene

SCENE = Path(__file__).parents[1] / "scenes" / "friction_cycle.toml"  # to 16 % and back


@pytest.mark.parametrize(("friction", "frames", "says"), [(0.4, 32, True), (0.4, 511, True), (0.4, 512, False), (0.1, 32, False)])
def test_friction_that_holds_asks_for_states_near_each_other(friction: float, frames: int, says: bool) -> None:
    """Above a coefficient of 0.1, steady states must be 0.16/512 of strain apart or less (docs/physics.md, Paths)."""
    model = build_model(load_scene(SCENE, (f"contact.friction={friction}", f"output.frames={frames}")))
    found = [line for line in cautions(model, []) if "friction" in line]
    assert bool(found) == says
    assert all("output.frames = 512" in line for line in found)


@pytest.mark.parametrize(("nodes", "says"), [(8, True), (12, False)])
def test_few_nodes_are_named(nodes: int, says: bool) -> None:
    model = build_model(load_scene(SCENE, (f"model.nodes_per_loop={nodes}",)))
    assert any("nodes a loop are few" in line for line in cautions(model, [])) == says
