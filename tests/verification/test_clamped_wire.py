"""A straight wire between two clamps, in space: it stretches between them by what they move, or by what it would contract."""

from pathlib import Path

import numpy as np
import pytest

from warpknit.scene import make_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation

DIAMETER, LENGTH = 20e-6, 2e-3  # [m]
STRAIN, COOLED = 7.5e-4, 150.0  # [K]
TOLERANCE = 1e-6  # of the residual; the strain of a softened segment is right to AXIAL_ERROR times what that allows


@pytest.mark.parametrize("spacing", [1.0, 2.0, 4.0])
@pytest.mark.parametrize("load", ["pulled", "cooled"])
def test_the_strain_of_a_straight_wire_does_not_depend_on_its_nodes(load: str, spacing: float, tmp_path: Path) -> None:
    """Half a segment is inside each clamp: without it the strain is too large by 1/(n - 2), 1 to 4 % here."""
    file = tmp_path / "wire.csv"
    np.savetxt(file, np.linspace([0.0, 0.0, 0.0], [LENGTH, 0.0, 0.0], 81), delimiter=",", header="x [m],y [m],z [m]", comments="")
    loads = {"pulled": {"strain_weft": STRAIN}, "cooled": {"temperature": 293.15 - COOLED}}
    scene = make_scene({
        "wire": {"material": "molybdenum", "diameter": DIAMETER},
        "wires": {"file": str(file), "node_spacing": spacing * DIAMETER},
        "load": loads[load],
        "output": {"frames": 1},
        "model": {"kind": "spatial", "boundary": "gripped"},
        "contact": {"friction": 0.0},
        "solver": {"residual_tolerance": TOLERANCE},
    })  # fmt: skip
    *_, record = Simulation(build_model(scene)).run()
    observed = record.observables
    strain = observed.axial_strain[observed.axial_strain != 0.0]
    expected = {"pulled": STRAIN, "cooled": 1.0 / (1.0 - scene.wire.expansion * COOLED) - 1.0}[load]
    assert strain == pytest.approx(expected, rel=1e-3)
    section = np.pi * DIAMETER**2 / 4
    pull = scene.wire.youngs_modulus * section * expected
    assert np.abs(observed.edge_force).max() == pytest.approx(pull, rel=1e-3)
    assert observed.wire_stress.node == pytest.approx(pull / section, rel=1e-3)  # in its clamps, too
    between = LENGTH - spacing * DIAMETER  # the clamps end half a segment inside the file's ends
    assert observed.energies.stored == pytest.approx(0.5 * pull * expected * between, rel=2e-3)
