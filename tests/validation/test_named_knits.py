"""Every knit of `warpknit new`, of three wires, under a small tension and one of a mesh in orbit: endless cloth carries it."""

from dataclasses import asdict

import numpy as np
import pytest

from warpknit.knit.named import NAMED_KNITS
from warpknit.measure import mesh_tension, tension_scale
from warpknit.scene import make_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation

INCH = 25.4e-3  # [m]
WIRES = {
    "tungsten, 15 um": {"material": "tungsten", "diameter": "15 um"},
    "molybdenum, 30 um": {"material": "molybdenum", "diameter": "30 um"},
    "tungsten, 3 x 17 um": {"material": "tungsten", "diameter": "17 um", "ends": 3},
}


@pytest.mark.slow
@pytest.mark.parametrize("tension", [0.02, 1.0])
@pytest.mark.parametrize("wire", WIRES)
@pytest.mark.parametrize("name", NAMED_KNITS)
def test_a_named_knit_carries_the_tension_that_is_asked_for(name: str, wire: str, tension: float) -> None:
    """Some are slack in one direction up to strains of 10 to 100 %, and become taut within a small strain."""
    knit = NAMED_KNITS[name]
    spacing = {"wale_spacing": INCH / knit.wales, "course_spacing": INCH / knit.courses}
    scene = make_scene({
        "wire": WIRES[wire],
        "knit": {"bars": [asdict(bar) for bar in knit.bars], "repeats": [1, 1], **spacing},
        "model": {"boundary": "periodic"},
        "contact": {"friction": 0.0},
        "variants": {"count": 1},
        "load": {"tension_weft": tension, "tension_warp": tension},
    })  # fmt: skip
    model = build_model(scene)
    *_, record = Simulation(model).run()
    tolerance = max(2e-3, scene.solver.residual_tolerance)  # of a search, after many equilibria
    assert record.load_factor == 1.0
    assert np.array(mesh_tension(record.observables)) == pytest.approx(
        tension, rel=tolerance, abs=tolerance * 0.01 * tension_scale(model)
    )
