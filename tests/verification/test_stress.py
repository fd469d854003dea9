"""Stress of a wire under stretch, bending and the push of a body, and what heat does to its energy."""

import numpy as np
import pytest

from reference.plane_wires import DIAMETER, EPSILON, Rig, panel_of_wires, straight, table_of_wires
from reference.rings import deformed, two_rings
from warpknit import measure

SEGMENTS, SPACING = 16, 50e-6
BALANCE = 1e-14  # [N] over a force of 9e-8 N


def test_stretch_counts_on_either_side_of_a_node() -> None:
    """sigma = E e with the larger strain of the two segments at a node, tensile or not; one where a wire ends. Nodes beyond the
    yield stress of 2 GPa, strains of 5e-3, are the share that is said, by the length that they stand for."""
    table = table_of_wires([straight(SEGMENTS + 1, SPACING)])
    rig = Rig(table, panel_of_wires(table))
    wire = rig.model.scene.wire
    strain = np.linspace(-3e-3, 7.1e-3, SEGMENTS)
    x = rig.rest.copy()
    x[:, 0] = SPACING * np.concatenate([[0.0], np.cumsum(1.0 + strain)])
    reading = rig.observables(x)
    sides = np.abs(np.concatenate([strain[:1], strain, strain[-1:]]))
    expected = wire.youngs_modulus * np.maximum(sides[:-1], sides[1:])
    noise = 100 * EPSILON * SEGMENTS / 3e-3
    assert reading.wire_stress.node == pytest.approx(expected, rel=noise)
    largest, _, above = measure.stress_extremes(reading)
    assert largest == pytest.approx(2.84e9, rel=noise)
    length = np.r_[0.5, np.ones(SEGMENTS - 1), 0.5] / SEGMENTS  # nodes stand for half of the segments beside them
    assert above == pytest.approx(np.sum(length[expected > wire.yield_stress]), rel=1e-12) and 0.2 < above < 0.4


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_bending_stresses_the_outermost_fibre(side: float) -> None:
    """A straight wire on an arc of radius R, its chords as long as its segments h: sigma = E (d/2) theta/h with
    theta = 2 asin(h/(2 R)). At the ends nothing bends, and the nodes next to them see the moment drop to 0 there: by 1/6 of
    its second difference (kernels/bend.py)."""
    table = table_of_wires([straight(SEGMENTS + 1, SPACING)])
    rig = Rig(table, panel_of_wires(table))
    radius = 1e-3
    angle = 2.0 * np.arcsin(0.5 * SPACING / radius)
    turn = angle * np.arange(SEGMENTS + 1)
    stress = rig.observables(radius * np.stack([np.sin(turn), side * (1.0 - np.cos(turn))], axis=1)).wire_stress.node
    expected = rig.model.scene.wire.youngs_modulus * 0.5 * DIAMETER * angle / SPACING
    # rounding of edges against their length, over the turning and over the strain that makes as much stress
    noise = 1e3 * EPSILON / (angle * DIAMETER / SPACING)
    assert stress[2:-2] == pytest.approx(np.full(SEGMENTS - 3, expected), rel=noise)
    assert stress[[1, -2]] == pytest.approx(np.full(2, 7.0 / 6.0 * expected), rel=noise)
    assert stress[[0, -1]] == pytest.approx([0.0, 0.0], abs=noise * expected)


@pytest.mark.parametrize("u", [0.5, 0.25])
def test_a_wire_is_stressed_most_under_a_body(u: float) -> None:
    """A pinned wire pushed by F at a from one end and b from the other bends by M = F a b/L there, between two nodes, and by
    F a/2 at a distance a from the end that is nearer to it, whatever nodes the push is shared out to."""
    squeeze = 1e-4 * DIAMETER
    distance = 2.0 * (0.625 * DIAMETER - squeeze)
    table = table_of_wires([straight(SEGMENTS + 1, SPACING), straight(SEGMENTS + 1, SPACING, distance)])
    segment = SEGMENTS // 2
    place = (segment + u) * SPACING
    pairs = [(0, segment, 1), (1, segment, -1)]
    rig = Rig(table, panel_of_wires(table, bodies=np.array([[place, distance / 2]]), pairs=pairs), axial_softening=1e4)
    rig.control(contact_stiffness=10.0)
    free = np.ones_like(rig.rest, dtype=bool)
    free[[0, SEGMENTS, SEGMENTS + 1, 2 * SEGMENTS + 1]] = False
    free[-1, 0] = False
    reading = rig.observables(rig.rest_position(rig.rest, free, tolerance=BALANCE))
    force, length = reading.pair_force, SEGMENTS * SPACING
    moment = force * place * (length - place) / length
    over = rig.model.scene.wire.youngs_modulus * 0.5 * DIAMETER / rig.model.bending_stiffness
    found = reading.wire_stress.contact / over
    # the contact point is found to 1e-5 of a segment; the ends of the wires are pulled towards each other, and hardly
    noise = 1e-4
    assert found == pytest.approx(moment, rel=noise)
    at_nodes = reading.wire_stress.node.reshape(2, -1) / over
    along = SPACING * np.arange(SEGMENTS + 1)
    by_hand = np.where(along <= place, along / place, (length - along) / (length - place)) * moment[:, None]
    assert at_nodes == pytest.approx(by_hand, abs=noise * moment.max())
    assert measure.stress_extremes(reading)[0] == pytest.approx(over * found.max())


def test_heat_works_against_stretch_bending_and_contact() -> None:
    """`thermal_force` is the derivative of the stored energy by the length factor, which lengthens segments and hinges
    and widens the reach of contacts; by central differences of 2e-6, to their square and to round-off over them."""
    rig, by = two_rings(7), 1e-6
    x = deformed(rig)
    found = rig.observables(x).thermal_force
    energies = []
    for sign in (1.0, -1.0):
        rig.control(length_factor=1.0 + sign * by)
        energies.append(rig.stored_energy(x))
    slope = (energies[0] - energies[1]) / (2.0 * by)
    widened = float(np.sum(rig.observables(x).pair_force)) * rig.model.treatment.reach
    assert slope == pytest.approx(found, abs=1e-4 * abs(widened))
    assert abs(found) > 0.0 and widened > 0.0
