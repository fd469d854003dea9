"""A straight wire held at both ends and cooled.

T = EA (1/(1 + alpha dT) - 1) = EA alpha |dT| (1 + alpha |dT| + ...)
"""

import numpy as np
import pytest
from verification.wires import EPSILON, Rig, panel_of_wires, straight, table_of_wires

from warpknit import measure
from warpknit.kernels import control as c


@pytest.mark.parametrize("cooled_by", [10.0, 100.0, 210.0])
def test_cooled_wire_pulls_on_its_grips(cooled_by: float, device: str) -> None:
    """Exact up to round-off of the segments' lengths over their thermal strain; alpha of tungsten is 4.5e-6 /K."""
    table = table_of_wires([straight(30, 40e-6)])
    rig = Rig(table, panel_of_wires(table, held=[0, 1, 28, 29]), device)
    wire = rig.model.scene.wire
    rig.control({c.LENGTH_FACTOR: 1 - wire.expansion * cooled_by})
    strain = 4.5e-6 * cooled_by
    expected = rig.model.axial_stiffness * strain * (1 + strain)
    tolerance = strain**2 + 10 * EPSILON / strain
    r = rig.reading(rig.rest)
    assert r.tension[:-1] == pytest.approx(np.full(29, expected), rel=tolerance, abs=0)
    force = measure.held_forces(r)
    assert [force[:2, 0].sum(), force[2:, 0].sum()] == pytest.approx([expected, -expected], rel=tolerance, abs=0)
