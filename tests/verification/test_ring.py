"""A ring pulled apart along a diameter.

    P/dD = EI / ((pi/4 - 2/pi) R^3 (1 + a)),   pi/4 - 2/pi = 0.1488,   a = 5.28 (d/4R)^2 for what the wire stretches

The ring of N nodes has its own exact answer, the sum over its hinges and segments of the virtual work of a unit load:

    dD/P = l/EI v.(1 - delta^2/6)^-1 v + l N/(8 EA),   v = R (|c| - m)/2,   m = (2/N) cot(pi/N) = mean |c|,   l = 2 R sin(pi/N)

with c the cosine at the nodes (delta^2/6: kernels/bend.py). It tends to the first as -8.22/N^2: segments keep their chords here
and not their arcs.
"""

import numpy as np
import pytest

from reference.plane_wires import DIAMETER, Rig, circle, panel_of_wires, table_of_wires

RADIUS = 1e-3
PULL = 1e-4 * RADIUS  # pulled and pushed by this much, the mean stiffness is linear up to (PULL/R)^2
BALANCE = 2e-12  # [N] largest force left on a node


def ring_stiffness(nodes: int) -> tuple[Rig, float]:
    """Force on a node held at either end of the diameter over the change of the diameter [N/m]."""
    table = table_of_wires([circle(RADIUS, nodes)], closed=True)
    rig = Rig(table, panel_of_wires(table, closed=True))
    free = np.ones((nodes, 2), dtype=bool)
    free[[0, nodes // 2]] = False
    forces = []
    for pull in (PULL, -PULL):
        start = rig.rest.copy()
        start[[0, nodes // 2], 0] += [pull, -pull]
        forces.append(rig.forces(rig.rest_position(start, free, tolerance=BALANCE))[0, 0])
    return rig, -(forces[0] - forces[1]) / (4 * PULL)


def discrete_stiffness(rig: Rig, nodes: int) -> float:
    chord = 2 * RADIUS * np.sin(np.pi / nodes)
    mean = 2 / nodes / np.tan(np.pi / nodes)
    moment = RADIUS * (np.abs(np.cos(2 * np.pi * np.arange(nodes) / nodes + np.pi / 2)) - mean) / 2
    second = np.roll(np.eye(nodes), 1, axis=0) + np.roll(np.eye(nodes), -1, axis=0) - 2 * np.eye(nodes)
    bend = chord / rig.model.bending_stiffness * moment @ np.linalg.solve(np.eye(nodes) - second / 6, moment)
    return 1.0 / (bend + chord * nodes / (8 * rig.model.axial_stiffness))


@pytest.mark.parametrize("nodes", [16, 32, 64])
def test_ring_of_hinges_has_its_exact_stiffness(nodes: int) -> None:
    """Tolerance: what is left out of balance over the force of the pull, and (PULL/R)^2 from linearity times 10."""
    rig, stiffness = ring_stiffness(nodes)
    tolerance = BALANCE / (stiffness * 2 * PULL) + 10 * (PULL / RADIUS) ** 2
    assert stiffness == pytest.approx(discrete_stiffness(rig, nodes), rel=tolerance, abs=0)


def test_ring_converges_to_the_curved_beam() -> None:
    """Error -8.225/N^2 + 71.8/N^3 up to N^-4, here bounded by 400/N^4. Over q = 1/2 - 4/pi^2 the first is
    8/3 (the mean of |c|) - pi^2/3 (slopes), less pi^2/6 for chords instead of arcs; the second, 32 pi^2 sqrt(3/5)/36, is what
    the kinks of |c| at both loads leave."""
    found = {nodes: ring_stiffness(nodes)[1] for nodes in (32, 64)}
    rig, _ = ring_stiffness(16)
    bend_only = rig.model.bending_stiffness / ((np.pi / 4 - 2 / np.pi) * RADIUS**3)
    axial_share = (np.pi / 4) / (np.pi / 4 - 2 / np.pi) * (DIAMETER / (4 * RADIUS)) ** 2
    expected = bend_only / (1 + axial_share)
    for nodes, stiffness in found.items():
        assert abs(expected / stiffness - 1 + 8.225 / nodes**2 - 71.8 / nodes**3) < 400 / nodes**4
    assert rig.model.bending_stiffness == pytest.approx(400e9 * np.pi / 64 * DIAMETER**4, rel=1e-12, abs=0)
    assert bend_only == pytest.approx(6.68, abs=0.005)
    assert axial_share == pytest.approx(5.28 * (DIAMETER / (4 * RADIUS)) ** 2, rel=1e-3, abs=0)
