"""A straight wire held at both ends and cooled.

T = EA (1/(1 + alpha dT) - 1) = EA alpha |dT| (1 + alpha |dT| + ...)
"""

import numpy as np
import pytest

from reference.plane_wires import EPSILON, Rig, panel_of_wires, straight, strains, table_of_wires


@pytest.mark.parametrize("cooled_by", [10.0, 100.0, 210.0])
def test_cooled_wire_pulls_on_its_grips(cooled_by: float, device: str) -> None:
    """Exact up to round-off of the segments' lengths over their thermal strain; alpha of tungsten is 4.5e-6 /K."""
    table = table_of_wires([straight(30, 40e-6)])
    rig = Rig(table, panel_of_wires(table, held=[0, 1, 28, 29]), device)
    wire = rig.model.scene.wire
    rig.control(length_factor=1 - wire.expansion * cooled_by)
    strain = 4.5e-6 * cooled_by
    expected = rig.model.axial_stiffness * strain * (1 + strain)
    tolerance = strain**2 + 10 * EPSILON / strain
    r = rig.observables(rig.rest)
    assert r.tension[:-1] == pytest.approx(np.full(29, expected), rel=tolerance, abs=0)
    force = r.held_forces
    assert [force[:2, 0].sum(), force[2:, 0].sum()] == pytest.approx([expected, -expected], rel=tolerance, abs=0)


def test_warmth_works_against_the_tension_of_the_wire() -> None:
    """With the strain e of each segment less its warmth, E = sum EA e^2 L/2; its derivatives by the warmth at the first node and
    by its growth, by central differences, against `thermal_strain_force`. What that leaves out goes with the strain: 3e-3."""
    nodes, spacing, by = 24, 40e-6, 1e-6
    table = table_of_wires([straight(nodes, spacing), straight(nodes, spacing, y=1e-3)])
    rig = Rig(table, panel_of_wires(table))
    moved = rig.rest.copy()
    local = np.tile(np.arange(nodes), 2)
    moved[:, 0] += spacing * (1e-3 * local + 5e-5 * local**2) * np.repeat([1.0, -0.5], nodes)  # the second is compressed
    found = rig.observables(moved).thermal_strain_force
    natural = np.tile(np.append(np.full(nodes - 1, spacing), 0.0), 2)

    def energy(warmth: np.ndarray) -> float:
        rig.state.wire_thermal_strain.assign(warmth)
        return float(np.sum(0.5 * rig.model.axial_stiffness * strains(rig.model, rig.state) ** 2 * natural))

    expected = np.zeros((2, 2))
    for wire, number in np.ndindex(2, 2):
        step = np.zeros((2, 2))
        step[wire, number] = by
        expected[wire, number] = (energy(step) - energy(-step)) / (2.0 * by)
    assert np.all(expected[0] < 0.0) and np.all(expected[1] > 0.0)
    assert found == pytest.approx(expected, rel=2e-2)
