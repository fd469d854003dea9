"""A facet of a tight knit starts from one repeat of endless cloth; where it cannot, from its own state."""

import numpy as np
import pytest

from warpknit.scene import load_scene
from warpknit.solve.model import build_model
from warpknit.solve.multilevel import MultilevelRelaxation
from warpknit.solve.simulate import Record, Simulation

TRICOT, ATLAS = [{"chain": "1-0/1-2"}, {"chain": "1-2/1-0"}], [{"chain": "1-0/1-2/2-3/3-4/3-2/2-1"}]
FACET = {
    "wire": {"material": "molybdenum", "diameter": "30 um"},
    "knit": {"wales": "26 /inch", "courses": "30 /inch"},
    "model": {"kind": "spatial", "boundary": "gripped"},
    "panel": {
        "outline": "hexagon",
        "size": "6 mm",
        "grip_pitch": "3 mm",
        "cord": {"tension": "5 N", "stiffness": "5 kN"},
        "focal_length": "3 m",
    },
    "contact": {"friction": 0},
}


def solved(knit: list[dict[str, str]], strain: tuple[float, float], levels: int) -> tuple[Simulation, Record]:
    scene = load_scene(FACET, {"knit.bars": knit, "load.strain_weft": strain[0], "load.strain_warp": strain[1],
                               "output.frames": levels}, "draft")  # fmt: skip
    simulation = Simulation(build_model(scene, "cpu"))
    *_, last = simulation.run()
    return simulation, last


def tension(simulation: Simulation, record: Record) -> np.ndarray:
    return simulation.drive.mesh_tension(record.observables)


@pytest.mark.parametrize(("knit", "strain", "starts"), [(TRICOT, (0.096, 0.014), True), (ATLAS, (0.06, 0.06), False)])
def test_the_start_does_not_change_the_equilibrium(
    knit: list[dict[str, str]], strain: tuple[float, float], starts: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same tensions as without it, to a tenth of the tolerance of the residual. A tricot takes a start of 10 % strain, in a
    quarter of the steps; wires of the atlas would pass each other, so that it is loaded from its own state."""
    simulation, last = solved(knit, strain, 1)
    drive = simulation.drive
    assert isinstance(drive, MultilevelRelaxation)
    monkeypatch.setattr("warpknit.solve.simulate.smaller_scene", lambda _: None)
    alone, expected = solved(knit, strain, 7 if starts else 1)
    assert isinstance(alone.drive, MultilevelRelaxation) and alone.drive.smaller is None
    tolerance = drive.scene.solver.residual_tolerance
    assert tension(simulation, last) == pytest.approx(tension(alone, expected), rel=0.1 * tolerance)
    assert len(simulation.notes) == int(not starts)
    if starts:
        assert last.steps < 0.25 * expected.steps
