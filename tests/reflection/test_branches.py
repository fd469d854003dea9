"""From a recorded state to branches and contacts: nodes, gaps, yarns, and the network of resistors at low frequency."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from reference.cases import slow
from reference.wire_grids import parallel_wires, sheet_impedance, solve, stacked_grid
from warpknit import measure
from warpknit.measure.network import holm_resistance, sheet_resistance, surface
from warpknit.reflection.currents import MeshCurrents, scattering_at
from warpknit.reflection.impedance import gap_capacitance, wire_impedance, yarn_radius
from warpknit.reflection.repeat import CLOSED, COMPUTED, OPEN, repeat_of
from warpknit.reflection.study import branch_length
from warpknit.reflection.waves import EPS0, Angles
from warpknit.results.frame import Frame, WireLayout
from warpknit.scene import load_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation

SPACING, DIAMETER = 0.635e-3, 30e-6
SCENE = load_scene(Path(__file__).parents[2] / "scenes" / "ka_band.toml", {"load.strain_weft": 0.06, "load.strain_warp": 0.06})
WIRE = SCENE.wire
BARE = replace(WIRE, plating=None)


def crossed(gap=0.0, start=(0.0, 0.0), force=(1e-4,), share=((0.0, 0.0),)):
    """Two wires that cross, as a recorded state; the second one lies above, at a gap. start: shares of a period."""
    count = 8
    step = SPACING * np.arange(count)[:, None] / count
    along, up = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    one = step * along + SPACING * start[0] * along
    other = step * up + SPACING * start[1] * up + [0.0, 0.0, DIAMETER + gap]
    layout = WireLayout(
        wire_start=[0, count, 2 * count], wire_closed=[True, True], wire_closing=[[SPACING, 0.0], [0.0, SPACING]],
        period=[SPACING, SPACING], diameter=DIAMETER, body_radius=0.0, body_wires=np.zeros((0, 2)), rhombus_bodies=[],
    )  # fmt: skip
    frame = Frame(
        index=0, stage="load", load_factor=1.0, strain_weft=0.0, strain_warp=0.0, shear=0.0, temperature=293.15,
        node_position=np.concatenate([one, other]), node_stress=np.zeros(2 * count), body_position=np.zeros((0, 3)),
        pair_force=np.zeros(0), pair_active=np.zeros(0, dtype=bool), contact_force=np.array(force),
        contact_wires=np.tile([0, 1], (len(force), 1)), contact_share=np.array(share).reshape(-1, 2),
    )  # fmt: skip
    return layout, frame


def loss(repeat, contacts, frequency=30e9, wire=BARE):
    mesh = MeshCurrents(repeat.wires)
    return solve(mesh, frequency, Angles(np.radians(60.0)), wire_impedance(wire, frequency), [contacts])[0].loss


# --- nodes and contacts


def test_a_crossing_is_that_of_a_grid():
    repeat = repeat_of(*crossed(), BARE, SPACING / 16)
    grid = stacked_grid(SPACING, DIAMETER / 2, 16)
    assert len(repeat.wires.node) == len(grid.node) and len(repeat.wires.contact_node) == 1
    resistance = holm_resistance(surface(BARE), 1e-4)
    contacts = repeat.contacts(BARE, 30e9, COMPUTED)
    assert contacts.real == pytest.approx(1.0 / resistance)
    expected = solve(MeshCurrents(grid), 30e9, Angles(np.radians(60.0)), wire_impedance(BARE, 30e9), [contacts])[0].loss
    assert loss(repeat, contacts) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("start", [(0.3, -0.4), (-2.7, 1.6), (0.97, 0.99)])
def test_wires_may_be_drawn_in_any_repeat(start):
    """The place of a contact along a wire, and the repeat of its second wire, follow from where the wires are drawn."""
    share = [(-start[0] % 1.0, -start[1] % 1.0)]
    moved, still = (repeat_of(*crossed(start=place, share=there), BARE, SPACING / 16) for place, there in
                    ((start, share), ((0.0, 0.0), [(0.0, 0.0)])))  # fmt: skip
    assert np.linalg.norm(moved.wires.contacts, axis=1) == pytest.approx(DIAMETER)
    contacts = still.contacts(BARE, 30e9, COMPUTED)
    assert loss(moved, contacts) == pytest.approx(loss(still, contacts), rel=2e-3)  # other nodes on the same wires


def test_contacts_within_a_diameter_share_a_node():
    """Also across the end of a wire; their admittances add up."""
    near = 0.4 * DIAMETER / SPACING
    repeat = repeat_of(*crossed(force=(1e-4, 4e-4), share=((1.0 - near, 0.0), (near, 0.0))), BARE, SPACING / 16)
    assert len(repeat.wires.contact_node) == 1
    expected = sum(1.0 / holm_resistance(surface(BARE), force) for force in (1e-4, 4e-4))
    assert repeat.contacts(BARE, 1e6, COMPUTED)[0].real == pytest.approx(expected)


def test_a_gap_is_a_capacitor():
    gap = 5e-6
    repeat = repeat_of(*crossed(gap, force=(), share=()), BARE, SPACING / 16)
    assert repeat.gap == pytest.approx([gap]) and repeat.force.tolist() == [0.0]
    capacitance = 2.0 * np.pi * EPS0 * 15e-6 * np.log(1.0 + 15e-6 / (2.0 * gap))
    assert repeat.contacts(BARE, 30e9, COMPUTED) == pytest.approx([2j * np.pi * 30e9 * capacitance])
    assert repeat.contacts(BARE, 30e9, OPEN).tolist() == [0.0]
    assert repeat.contacts(BARE, 30e9, CLOSED).tolist() == [np.inf]


@pytest.mark.parametrize("gap", [16e-6, 100e-6])
def test_a_gap_beyond_the_radius_does_not_count(gap):
    assert len(repeat_of(*crossed(gap, force=(), share=()), BARE, SPACING / 16).gap) == 0


def test_a_film_that_does_not_conduct_leaves_a_capacitor():
    repeat = repeat_of(*crossed(), BARE, SPACING / 16)
    assert repeat.contacts(BARE, 30e9, COMPUTED, np.inf) == pytest.approx(2j * np.pi * 30e9 * gap_capacitance(15e-6, np.zeros(1)))


# --- yarns


def test_the_radius_of_a_yarn_is_a_geometric_mean():
    """Two wires that touch: sqrt(a 2a); three: cbrt(a 2a 2a).

    The loss lies between those of one wire and of the circle round all of them.
    """
    a = BARE.radius
    assert yarn_radius(replace(BARE, ends=2)) == pytest.approx(np.sqrt(2.0) * a)
    assert yarn_radius(replace(BARE, ends=3)) == pytest.approx(np.cbrt(4.0) * a)
    radii = (a, yarn_radius(replace(BARE, ends=3)), a * (1.0 + 2.0 / np.sqrt(3.0)))
    one, yarn, circle = (
        solve(MeshCurrents(parallel_wires(SPACING, radius, 16)), 30e9, Angles(), 0.0, [np.zeros(0)])[0].loss[1]
        for radius in radii
    )
    assert circle < yarn < one
    assert wire_impedance(replace(BARE, ends=3), 30e9) == pytest.approx(wire_impedance(BARE, 30e9) / 3.0)


# --- an equilibrium


@pytest.fixture(scope="module")
def tricot():
    """Records of a tight tricot up to 6 % strain in both directions."""
    simulation = Simulation(build_model(SCENE))
    return simulation.model.layout(), list(simulation.run())


def frame_of(record):
    return measure.frame(record.observables, index=record.index, stage="load", load_factor=1.0, temperature=293.15)


def test_low_frequency_is_the_network_of_resistors(tricot):
    """At 1 MHz the sheet resistance is that of wires and contacts (measure/network.py), within 1 %."""
    layout, records = tricot
    wires = repeat_of(layout, frame_of(records[-1]), WIRE, 75e-6)
    contacts = [wires.contacts(WIRE, 1e6, COMPUTED)]
    waves = solve(MeshCurrents(wires.wires), 1e6, Angles(), wire_impedance(WIRE, 1e6), contacts)[0]
    sheet = sheet_impedance(waves)
    warp, weft = (1.0 / np.diag(np.linalg.inv(sheet))).real
    assert (weft, warp) == pytest.approx(sheet_resistance(records[-1].observables), rel=1e-2)


@pytest.mark.parametrize("frequency", [*slow(10e9), 30e9])
def test_branches_of_the_default_length_have_converged(tricot, frequency):
    """Half the length changes the loss by less than 0.2 %."""
    layout, records = tricot
    frame, longest = frame_of(records[-1]), branch_length(SCENE)
    coarse, fine = (repeat_of(layout, frame, WIRE, length) for length in (longest, 0.5 * longest))
    found, expected = (
        solve(
            MeshCurrents(repeat.wires), frequency, Angles(), wire_impedance(WIRE, frequency),
            [repeat.contacts(WIRE, frequency, COMPUTED)],
        )[0].loss
        for repeat in (coarse, fine)
    )  # fmt: skip
    assert found == pytest.approx(expected, rel=2e-3)


def test_a_tricot_keeps_energy_and_reciprocity(tricot):
    """Without resistance; in the direction of incidence and back."""
    layout, records = tricot
    repeat = repeat_of(layout, frame_of(records[-1]), WIRE, 120e-6)
    contacts = [repeat.contacts(WIRE, 30e9, CLOSED)]
    there, back = (solve(MeshCurrents(repeat.wires), 30e9, Angles(0.5, 0.3 + turn), 0.0, contacts)[0] for turn in (0.0, np.pi))
    assert np.abs(there.absorbed).max() < 1e-9
    assert np.abs(there.reflection) == pytest.approx(np.abs(back.reflection).T, abs=1e-8)


def test_interpolated_frequencies(tricot):
    """Matrices between Chebyshev points give the waves of each frequency, through a resonance too."""
    layout, records = tricot
    partly_closed = next(frame for record in records if len((frame := frame_of(record)).contact_force))
    repeat = repeat_of(layout, partly_closed, WIRE, 180e-6)
    mesh, frequencies, angles = MeshCurrents(repeat.wires), np.linspace(1e9, 40e9, 14), Angles(0.5, 0.3)
    states = (COMPUTED, OPEN, CLOSED)

    def contacts(frequency):
        return [repeat.contacts(WIRE, frequency, state) for state in states]

    found = scattering_at(mesh, frequencies, angles, lambda frequency: wire_impedance(WIRE, frequency), contacts)
    for frequency, waves in list(zip(frequencies, found, strict=True))[2::5]:
        expected = solve(mesh, frequency, angles, wire_impedance(WIRE, frequency), contacts(frequency))
        for one, other in zip(waves, expected, strict=True):
            assert np.abs(one.reflection - other.reflection).max() < 1e-4
