"""The bound on the highest frequency against closed forms and against the stiffness matrix itself.

straight wire of even nodes:  w^2 = 4 K/(h m), or 80/3 EI/(h^3 m) where that is more
any mesh:                     largest eigenvalue of M^-1 K <= bound
"""

import numpy as np
import pytest

from reference.plane_wires import Rig, panel_of_wires, straight, table_of_wires
from reference.rings import DEPTH, SPACING, deformed, two_rings
from warpknit.planar.time_step import frequency_square, largest_step


@pytest.mark.parametrize("softening", [1.0, 1e6])
def test_bound_of_a_straight_wire_is_exact(softening: float) -> None:
    """The ends weigh half and stretch one segment only, so they do not rule; the second pass takes off less than 1 %."""
    h = 40e-6
    table = table_of_wires([straight(60, h)])
    rig = Rig(table, panel_of_wires(table), axial_softening=softening)
    wire = rig.model.scene.wire
    mass = wire.linear_density * h
    expected = max(4 * wire.axial_stiffness / softening / (h * mass), 80 / 3 * wire.bending_stiffness / (h**3 * mass))
    assert 0.99 * expected < frequency_square(rig.observables(rig.rest)) <= expected * (1 + 1e-12)


@pytest.mark.parametrize(("bodies", "softening"), [(0, 1.0), (20, 50.0), (7, 1e4)])
def test_bound_is_just_above_the_largest_eigenvalue(bodies: int, softening: float) -> None:
    """Rings stretched at random by 1 %, with bodies pressed between them. The stiffness that a change of direction adds, of the
    order of the contact force over the radius, is not in the bound: it is the depth over the reach of the penalty."""
    rig = two_rings(bodies, axial_softening=softening)
    x = deformed(rig)
    stiffness = rig.stiffness(x, 1e-5 * SPACING)
    mass = np.repeat(rig.mass, 2)
    largest = np.max(np.linalg.eigvals(stiffness / mass[:, None]).real)
    reading = rig.observables(x)
    assert bodies == 0 or np.count_nonzero(reading.pair_force) > bodies
    allowed = DEPTH / rig.model.treatment.reach if bodies else 1e-6
    bound = frequency_square(reading)
    assert largest < bound * (1 + allowed)
    assert bound < 1.25 * largest  # the slope of the moment counts for a mode that alternates, which contacts are not alone in


def test_contacts_about_to_close_count_as_closed() -> None:
    """A body out of touch does not change the bound, unless it may come near; then it is that of the touching one to a tenth."""
    rig = two_rings(7, axial_softening=1e4)
    touching = frequency_square(rig.observables(rig.rest))
    apart = rig.rest.copy()
    apart[rig.nodes :] *= 1 + 4 * DEPTH / np.hypot(*apart[rig.nodes :].T)[:, None]
    reading = rig.observables(apart)
    inner = reading.pair_force.reshape(-1, 2)[:, 0]
    assert np.all(inner == 0.0)
    without = frequency_square(reading)
    with_all = frequency_square(reading, approach=8 * DEPTH)
    assert without < 0.9 * with_all
    assert with_all == pytest.approx(touching, rel=0.1)


def test_a_light_body_rules_by_its_own_frequency() -> None:
    """w_body dt <= 1 with w_body^2 = 2 k/m_body."""
    rig = two_rings(7, axial_softening=1e4)
    rig.control(body_inverse_mass=1e3 * rig.state.steering.body_inverse_mass)
    reading = rig.observables(rig.rest)
    body = 2 * reading.control.contact_stiffness * reading.control.body_inverse_mass
    assert largest_step(reading, 0) * np.sqrt(body) == pytest.approx(1.0, rel=1e-12)
