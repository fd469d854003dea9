"""Waves from grids of straight wires, against closed forms and values of an independent solver.

Values are of a wire of 30 um, 40 openings an inch, at 30 GHz. Bonded and stacked grids at 60 degrees: rooftops, Galerkin's method
and a direct sum over Floquet modes (Imbriale, Galindo-Israel and Rahmat-Samii, IEEE Trans. AP 39 (1991) 1). Casey's 0.267 and
0.286 dB of a bonded grid (Electromagnetic shielding by wire-mesh screens, 1988) hold ln(1/(1 - exp(-2 pi a/d))) in place of
ln(d/(2 pi a)); the values here are those of thin wires.
"""

import numpy as np
import pytest

from reference.wire_grids import (
    bonded_grid,
    parallel_reflection,
    parallel_wires,
    repeated,
    sheet_impedance,
    solve,
    stacked_grid,
    wavy_wire,
)
from warpknit.reflection.currents import MeshCurrents
from warpknit.reflection.green import PieceKernel
from warpknit.reflection.waves import LIGHT, Angles, first_lobe, mode_decay

SPACING, RADIUS, FREQUENCY = 0.635e-3, 15e-6, 30e9
OPEN, PERFECT, NO_CONTACT = np.zeros(1), np.array([np.inf]), np.zeros(0)
NORMAL = Angles()


def degrees(theta, phi=0.0):
    return Angles(np.radians(theta), np.radians(phi))


def waves(wires, frequency=FREQUENCY, angles=NORMAL, contact=NO_CONTACT, wire=0.0):
    return solve(MeshCurrents(wires), frequency, angles, wire, [contact])[0]


def through(ohm):
    """[contact] [S] one contact of so many ohms."""
    return np.array([1.0 / ohm])


@pytest.fixture(scope="module")
def gold():
    """[Ohm/m] of a solid gold wire of 41 MS/m at 30 GHz."""
    from scipy.special import ive

    decay = np.sqrt(2j * np.pi * FREQUENCY * 4e-7 * np.pi * 4.1e7)
    return complex(decay / 4.1e7 * ive(0, decay * RADIUS) / ive(1, decay * RADIUS) / (2.0 * np.pi * RADIUS))


# --- against closed forms


def test_parallel_wires_at_normal_incidence():
    k = 2.0 * np.pi * FREQUENCY / LIGHT
    expected = -20.0 * np.log10(abs(parallel_reflection(k, np.zeros(2), SPACING, RADIUS)[1, 1]))
    assert expected == pytest.approx(0.2484, abs=5e-5)
    assert waves(parallel_wires(SPACING, RADIUS, 16)).loss[1] == pytest.approx(expected, rel=5e-3)


@pytest.mark.parametrize(
    ("frequency", "phi", "value"), [(30e9, 90.0, 0.9927), (30e9, 0.0, 0.9927), (100e9, 90.0, 0.9221), (100e9, 0.0, 0.9268)]
)
def test_parallel_wires_at_60_degrees(frequency, phi, value):
    found = waves(parallel_wires(SPACING, RADIUS, 16), frequency, degrees(60.0, phi)).reflection
    k, angles = 2.0 * np.pi * frequency / LIGHT, degrees(60.0, phi)
    expected = parallel_reflection(k, angles.transverse(k), SPACING, RADIUS)
    assert np.abs(expected).max() == pytest.approx(value, abs=5e-5)
    assert np.abs(found).max() == pytest.approx(value, rel=5e-3)
    assert found == pytest.approx(expected, abs=5e-3)


@pytest.mark.parametrize(("ohm", "value"), [(10.0, 0.4516), (100.0, 3.6999)])
def test_a_cut_wire_with_a_resistor_in_the_gap(ohm, value):
    """At low frequency the gap is a resistance Z/p per length in series (Wait 1977)."""
    k = 2.0 * np.pi * 3e9 / LIGHT
    expected = -20.0 * np.log10(abs(parallel_reflection(k, np.zeros(2), SPACING, RADIUS, ohm / SPACING)[1, 1]))
    assert expected == pytest.approx(value, abs=5e-5)
    found = waves(parallel_wires(SPACING, RADIUS, 16, cut=True), 3e9, contact=through(ohm))
    assert found.loss[1] == pytest.approx(value, rel=5e-3)


def test_sheet_resistance_of_a_grid():
    """At low frequency r = -Z0/(Z0 + 2 z d): a sheet of z d, z being the resistance of the wire per length."""
    sheet = sheet_impedance(waves(bonded_grid(SPACING, RADIUS, 8), 1e6, wire=37.0))
    assert np.diag(sheet).real == pytest.approx(37.0 * SPACING, rel=1e-4)


# --- against an independent solver


def test_bonded_grid_at_normal_incidence(gold):
    grid = bonded_grid(SPACING, RADIUS, 16)
    assert waves(grid).loss == pytest.approx(0.248, rel=5e-3)
    assert waves(grid, wire=gold).loss == pytest.approx(0.268, rel=5e-3)


def test_bonded_grid_at_60_degrees():
    assert waves(bonded_grid(SPACING, RADIUS, 24), angles=degrees(60.0)).loss == pytest.approx([0.0636, 0.4459], rel=5e-3)


def test_stacked_grid_at_60_degrees_without_contact():
    found = waves(stacked_grid(SPACING, RADIUS, 24), angles=degrees(60.0), contact=OPEN).loss
    assert found == pytest.approx([0.0636, 0.1056], rel=1e-2)


def test_a_perfect_contact_joins_the_layers():
    """All but the length of the contact: two radii against the spacing, 5 % of the inductance."""
    joined = waves(stacked_grid(SPACING, RADIUS, 16), angles=degrees(60.0), contact=PERFECT).loss
    assert joined[1] == pytest.approx(0.4459, rel=2e-2)


# --- Green's function


def test_greens_function_against_the_sum_over_modes():
    """Two short pieces at different heights: sum over g of exp(-j kg . rho - u h)/(2 u A), of modes that travel the even part."""
    cell, size = SPACING * np.array([[1.0, 0.0], [0.3, 0.8]]), 1e-4 * SPACING
    middle = SPACING * np.array([[0.1, 0.2, 0.0], [0.6, 0.45, 0.15]])
    vector = np.array([[size, 0.0, 0.0], [0.0, size, 0.0]])
    k, angles = 2.0 * np.pi * FREQUENCY / LIGHT, degrees(50.0, 20.0)
    kt = angles.transverse(k)
    found = PieceKernel(cell, RADIUS, middle, vector).regular(k, kt)[1, 0] / size**2
    i, j = (n.ravel() for n in np.meshgrid(np.arange(-40, 41), np.arange(-40, 41)))
    kg = kt + np.stack([i, j], axis=1) @ (2.0 * np.pi * np.linalg.inv(cell).T)
    u, h = mode_decay(k, kg), np.hypot(RADIUS, middle[1, 2])
    term = np.where(u.real == 0.0, -np.sin(u.imag * h) / np.where(u.real == 0.0, u.imag, 1.0), (np.exp(-u * h) / u).real)
    area = abs(np.linalg.det(cell))
    expected = (np.exp(-1j * kg @ (middle[1] - middle[0])[:2]) * term).sum() / (2.0 * area)
    assert abs(found - expected) < 1e-6 * abs(expected)


# --- invariances


def test_skew_periods_of_the_same_lattice():
    skew = SPACING * np.array([[1.0, 0.0], [1.0, 1.0]])
    angles, contact = Angles(0.7, 0.4), through(5.0)
    one, other = (waves(stacked_grid(SPACING, RADIUS, 12, cell), angles=angles, contact=contact) for cell in (None, skew))
    assert np.abs(one.reflection - other.reflection).max() < 1e-8


def test_three_repeats_as_one():
    angles, grid = Angles(0.7, 0.4), stacked_grid(SPACING, RADIUS, 12)
    one = waves(grid, angles=angles, contact=through(5.0))
    three = waves(repeated(grid, 3), angles=angles, contact=np.full(3, 0.2))
    assert np.abs(one.reflection - three.reflection).max() < 2e-5


def test_energy_without_resistance():
    """Powers of the waves that leave add up to that of the incident one, also with grating lobes."""
    assert np.abs(waves(wavy_wire(SPACING, RADIUS), 60e9, Angles(0.8, 0.5)).absorbed).max() < 1e-9
    lobes = waves(bonded_grid(8.0 * SPACING, RADIUS, 64), 90e9, Angles(0.3, 0.2))
    assert lobes.lobes.min() > 0.01
    assert np.abs(lobes.absorbed).max() < 1e-9


def test_reciprocity():
    """The reflection from one direction to another is that back, transposed."""
    wire = wavy_wire(SPACING, RADIUS)
    there, back = (waves(wire, 60e9, Angles(0.8, 0.5 + turn)).reflection for turn in (0.0, np.pi))
    assert np.abs(there) == pytest.approx(np.abs(back).T, abs=1e-8)


def test_first_lobe_of_a_square_cell():
    """At normal incidence a lobe leaves where the wavelength is the period; along x at theta where d (1 + sin(theta)) is."""
    cell = np.eye(2) * SPACING
    assert first_lobe(cell, NORMAL) == pytest.approx(LIGHT / SPACING)
    assert first_lobe(cell, degrees(30.0)) == pytest.approx(LIGHT / (1.5 * SPACING))
