"""The similarity law of a mesh without friction: at the same strain and the same d/L,

    T = EI/L^3 g(strain, d/L)

so that a mesh of another metal and another size lies on the same curve. E cancels with EA/EI = 16/d^2.
"""

from pathlib import Path

import numpy as np

from warpknit import measure
from warpknit.planar.state import initial_state
from warpknit.scene import load_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation

CELL = Path(__file__).parents[2] / "scenes" / "atlas_cell.toml"
OTHER = [
    "wire.material='molybdenum'",
    "wire.diameter='30 um'",
    "knit.wale_spacing='3.4 mm'",
    "knit.course_spacing='2 mm'",
]


def tensions(overrides: list[str]) -> np.ndarray:
    """T L^3/EI (level, weft and warp) of the periodic cell at 0, 5 and 10 %."""
    scene = load_scene(CELL, ["output.frames=2", *overrides], preset="draft")
    model = build_model(scene)
    records = Simulation(model, initial_state(model)).run()
    found = [measure.mesh_tension(record.observables) for record in records]
    return np.array(found) * scene.knit.course_spacing**3 / scene.wire.bending_stiffness


def test_tension_scales_with_bending_stiffness_over_length_cubed() -> None:
    """Both runs stop within the residual tolerance of the contact forces, which is what their tensions may differ
    by."""
    scene = load_scene(CELL, preset="draft")
    one, other = tensions([]), tensions(OTHER)
    assert one[-1].min() > 0.005
    assert np.max(np.abs(one - other)) < 2 * scene.solver.residual_tolerance * np.max(one)
    assert np.max(np.abs(one[0])) < scene.solver.residual_tolerance * np.max(one)


def test_tension_depends_on_the_slenderness() -> None:
    """The law holds at one d/L only: a wire twice as thick in the same mesh closes its contacts earlier."""
    one, thicker = tensions([]), tensions(["wire.diameter='30 um'"])
    assert thicker[-1].sum() > 1.2 * one[-1].sum()
