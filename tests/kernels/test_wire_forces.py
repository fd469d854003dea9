"""What the kernels evaluate of a state is what the formulas say, in NumPy (tests/reference/wire_forces.py).

Rest edges are differences of positions, and a block takes the edge before its first node from another place of the rest
table than the node before it: a position X is rounded by EPSILON X, an edge e by so much, an angle by EPSILON X/e, and what
follows from them by its stiffness.
"""

from dataclasses import dataclass

import numpy as np
import pytest

from reference.meshes import MESHES, Mesh, shaken
from reference.plane_wires import EPSILON
from reference.wire_forces import WireForces, wire_forces
from warpknit.planar.observables import read


@dataclass(frozen=True)
class Rounding:
    """What values may differ by: a few roundings."""

    edge: float  # [m]
    angle: float  # [rad]
    tension: float  # [N]
    moment: float  # [N m]
    bow_moment: float  # [N m]
    force: float  # [N]


def rounding(mesh: Mesh, expected: WireForces) -> Rounding:
    model = mesh.model
    length = np.hypot(*expected.edge.T)
    shortest, longest = length[length > 0.0].min(), float(model.table.rest_length.max())
    edge = 4 * EPSILON * float(np.abs(model.panel.size).max())
    angle = edge / shortest + 4 * EPSILON
    tension = float(mesh.state.wire_axial.numpy().max()) * edge / shortest
    # the slope of the moment takes the moments of three turns, each with at most one more (kernels/bend.py)
    moment = 6 * model.bending_stiffness * angle / float(model.table.hinge_length.min())
    bow = tension * longest + angle * longest * float(np.abs(expected.tension).max())
    return Rounding(edge, angle, tension, moment, bow, tension + 2 * (moment + bow) / shortest)


def loaded(mesh: str, bow: bool) -> tuple[Mesh, WireForces]:
    """Cooled and sheared, so that all of the load counts, and with arcs that keep their length."""
    made = shaken(mesh)
    made.state.steering.set(length_factor=0.995, gradient=((1.0, 0.02), (-0.01, 1.0)))
    if not bow:
        made.state.steering.set(bow_moment=0.0)
    return made, wire_forces(made.model, made.state)


@pytest.mark.parametrize("bow", [True, False])
@pytest.mark.parametrize("mesh", MESHES)
def test_readings_are_those_of_the_formulas(mesh: str, bow: bool) -> None:
    made, expected = loaded(mesh, bow)
    found, error = read(made.model, made.state), rounding(made, expected)
    assert found.edge == pytest.approx(expected.edge, rel=1e-12, abs=error.edge)
    assert found.tension == pytest.approx(expected.tension, rel=1e-12, abs=error.tension)
    assert found.turning == pytest.approx(expected.turning, rel=1e-12, abs=error.angle)
    assert found.elastic_turning == pytest.approx(expected.elastic, rel=1e-12, abs=2 * error.angle)
    assert found.moment == pytest.approx(expected.moment, rel=1e-12, abs=error.moment)
    assert found.bow_moment == pytest.approx(expected.bow_moment, rel=1e-12, abs=error.bow_moment)
    assert found.segment_force == pytest.approx(expected.segment_force, rel=1e-12, abs=error.force)
    for name in ("tension", "moment", "force"):
        of = {"force": expected.segment_force}.get(name, getattr(expected, name, None))
        assert getattr(error, name) < 1e-9 * np.abs(of).max()
    assert bow == (np.abs(expected.bow_moment).max() > 0.0)


@pytest.mark.parametrize("mesh", MESHES)
@pytest.mark.parametrize("by_pair", [True, False])
def test_a_step_takes_the_forces_of_the_formulas(mesh: str, by_pair: bool) -> None:
    """Differences of segment forces, without contact."""
    made, expected = loaded(mesh, bow=True)
    made.state.pair_offset.zero_()
    made.state.steering.set(contact_stiffness=0.0)
    probe = made.probe(by_pair)
    probe.probe(np.array([0]))
    panel, force = made.model.panel, expected.segment_force
    before = np.roll(force, 1, axis=0)
    before[panel.wire_first] = force[panel.wire_first + panel.wire_count - 1]
    mass = np.repeat(made.state.wire_mass.numpy(), panel.wire_count) / made.model.rest.inverse_mass.numpy()[panel.node_entry]
    free = np.ones(panel.node_count, dtype=bool)
    free[panel.held_node] = False
    found = np.stack([values.numpy() for values in probe.accelerations[0]], axis=1) * mass[:, None]
    assert found[free] == pytest.approx((force - before)[free], rel=1e-12, abs=2 * rounding(made, expected).force)
