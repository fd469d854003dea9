"""Resistance: networks with a closed form, and the constriction of a contact."""

import numpy as np
import pytest

from warpknit.measure import pair_active, positions
from warpknit.measure.network import contact_resistances, holm_resistance, sheet_conductance, sheet_resistance, wire_resistance
from warpknit.planar.observables import PlanarObservables
from warpknit.scene import make_scene
from warpknit.scene.materials import MATERIALS
from warpknit.solve.model import build_model
from warpknit.studies.load_path import states_at


def square_grid(n: int, pitch: float, segment: float, contact: float):
    """n x n crossings of wires along x and along y, joined by contacts: ends, reach, conductance, count, area.

    Points 2k and 2k + 1 are those on the wire along x and along y at crossing k.
    """
    ends, reach, conductance = [], [], []
    for i, j in np.ndindex(n, n):
        here, right, above = i * n + j, (i + 1) % n * n + j, i * n + (j + 1) % n
        ends += [(2 * here, 2 * here + 1), (2 * here, 2 * right), (2 * here + 1, 2 * above + 1)]
        reach += [(0.0, 0.0), (pitch, 0.0), (0.0, pitch)]
        conductance += [1.0 / contact, 1.0 / segment, 1.0 / segment]
    return np.array(ends), np.array(reach), np.array(conductance), 2 * n * n, (n * pitch) ** 2


@pytest.mark.parametrize(("n", "pitch"), [(1, 1e-3), (3, 1e-3), (8, 2e-4)])
def test_a_square_grid_has_the_sheet_resistance_of_one_segment(n, pitch):
    """Each wire carries its own current past contacts at equal potential: R = r a segment per square, whatever the size of the
    repeat, the pitch and the contacts."""
    found = sheet_conductance(*square_grid(n, pitch, segment=0.7, contact=3.0))
    assert np.allclose(found, np.eye(2) / 0.7, rtol=1e-12, atol=1e-12)


def test_a_grid_of_fine_pitch_is_a_homogeneous_sheet():
    """Wires of r [Ohm/m] at pitch p in both directions: R = r p; half the pitch is half the resistance."""
    per_length = 300.0
    for pitch in (1e-3, 5e-4):
        found = sheet_conductance(*square_grid(2, pitch, segment=per_length * pitch, contact=1.0))
        assert np.allclose(np.diag(found), 1.0 / (per_length * pitch), rtol=1e-12)


def test_current_across_wires_goes_through_contacts():
    """Wires along y, r a period b; each touches its neighbour at a distance a once a period, half a period higher up than the
    neighbour touches the next. Current passes Rc and then the two halves of a period side by side: (Rc + r/4) b/a across."""
    a, b, r, contact = 2e-3, 3e-3, 0.8, 0.5
    ends = np.array([(0, 1), (1, 0), (0, 1)])  # half, half, and the contact from point 0 to point 1 of the next wire
    reach = np.array([(0.0, b / 2), (0.0, b / 2), (a, b / 2)])
    conductance = np.array([2.0 / r, 2.0 / r, 1.0 / contact])
    found = sheet_conductance(ends, reach, conductance, 2, a * b)
    # the contact also reaches b/2 along the wire; turned onto pure weft that is the slant of the repeat
    assert found[0, 0] == pytest.approx(a / b / (contact + r / 4), rel=1e-12)
    assert np.allclose(found, found.T)


def test_loose_wires_conduct_along_themselves_only():
    found = sheet_conductance(np.array([(0, 0)]), np.array([(0.0, 2e-3)]), np.array([0.5]), 1, 6e-6)
    assert np.allclose(found, [[0.0, 0.0], [0.0, 0.5 * 4e-6 / 6e-6]])


def test_the_constriction_of_gold_on_gold():
    """(rho/2) sqrt(pi H/F) with rho = 2.44e-8 Ohm m, H = 0.7 GPa: 18 mOhm at 1 mN, 181 mOhm at 10 uN."""
    assert 1e3 * holm_resistance(MATERIALS["gold"], np.array([1e-3, 1e-5])) == pytest.approx([18.1, 180.9], abs=0.1)


def test_ends_and_plating_conduct_side_by_side():
    """1/R = ends [pi r^2/rho + pi ((r + t)^2 - r^2)/rho_gold]."""
    scene = make_scene({"wire": {"diameter": 20e-6, "ends": 3, "plating": {"thickness": 1e-6}}})
    siemens = 3 * np.pi * (1e-10 / MATERIALS["tungsten"].resistivity + (1.21e-10 - 1e-10) / MATERIALS["gold"].resistivity)
    assert wire_resistance(scene.wire) == pytest.approx(1.0 / siemens, rel=1e-12)


def hooked(repeats: list[int], **wire: object):
    """A periodic mesh with active contacts at rest."""
    table = {"knit": {"repeats": repeats}, "model": {"kind": "planar", "boundary": "periodic"}, "solver": {"preset": "draft"}}
    model = build_model(make_scene({**table, "wire": wire, "output": {"frames": 3}}))
    (state,) = states_at(model, [np.diag([1.16, 1.16])])
    return state


def test_sheet_resistance_does_not_depend_on_the_tile():
    """Endless cloth in tiles of one repeat and of six, to what the residual tolerance of 1e-2 leaves of contact forces, half
    of it in their resistances."""
    one, six = hooked([1, 1]), hooked([3, 2])
    assert len(contact_resistances(six)) == 6 * len(contact_resistances(one)) > 0
    assert sheet_resistance(six) == pytest.approx(sheet_resistance(one), rel=5e-3)


def test_a_surface_twice_as_hard_makes_contacts_of_root_two_the_resistance():
    """R = (rho/2) sqrt(pi H/F). The default is that of the plating, where there is one."""
    gold = MATERIALS["gold"].hardness
    plain, hard = (hooked([1, 1], plating={"thickness": 2e-7}, **more) for more in ({}, {"hardness": 2.0 * gold}))
    assert plain.model.scene.wire.hardness == gold
    assert contact_resistances(hard) == pytest.approx(np.sqrt(2.0) * contact_resistances(plain), rel=1e-9)
    assert make_scene({}).wire.hardness == MATERIALS["tungsten"].hardness


def every_segment(r: PlanarObservables):
    """The same network from where everything stands: each stretch between two nodes a resistor of its own, cut where a contact
    touches it, and each body with active contacts on either wire one between the two places."""
    panel, wire = r.model.panel, r.model.scene.wire
    periods = r.gradient @ np.diag(panel.size)
    place = list(positions(r)[0][:, :2])
    of_wire = panel.wire_length / np.add.reduceat(r.natural_length, panel.wire_first)  # arcs over chords
    lengths = r.natural_length * np.repeat(of_wire, panel.wire_count) * r.length_factor
    resistance = lengths * (4.0 * MATERIALS[wire.material].resistivity / (np.pi * wire.diameter**2))
    both = np.repeat(pair_active(r).reshape(-1, 2).all(axis=1), 2)
    ends, reach, ohms, touching = [], [], [], {}
    for first, count in zip(panel.wire_first, panel.wire_count, strict=True):
        for node in range(first, first + count):
            following, beyond = (node + 1, 0.0) if node + 1 < first + count else (first, periods[:, 1])
            way = place[following] + beyond - place[node]
            here, at = node, 0.0
            for pair in sorted(np.flatnonzero(both & (r.pair_node == node)), key=lambda pair: r.pair_u[pair]):
                touching[pair] = len(place)
                place.append(place[node] + r.pair_u[pair] * way)
                ends.append((here, touching[pair]))
                reach.append((r.pair_u[pair] - at) * way)
                ohms.append((r.pair_u[pair] - at) * resistance[node])
                here, at = touching[pair], r.pair_u[pair]
            ends.append((here, following))
            reach.append((1.0 - at) * way)
            ohms.append((1.0 - at) * resistance[node])
    for body in range(panel.body_count):
        if 2 * body in touching:
            one, other = touching[2 * body], touching[2 * body + 1]
            across = np.linalg.solve(periods, place[other] - place[one])
            ends.append((one, other))
            reach.append(periods @ (across - np.rint(across)))
            force = 0.5 * (r.pair_force[2 * body] + r.pair_force[2 * body + 1])
            ohms.append(0.5 * MATERIALS[wire.material].resistivity * np.sqrt(np.pi * wire.hardness / force))
    area = abs(np.linalg.det(periods))
    return np.array(ends), np.array(reach), 1.0 / np.array(ohms), len(place), area


def test_a_mesh_is_the_network_of_its_segments():
    """Wires between contacts are their segments in series, and where in a repeat a point stands does not matter."""
    state = hooked([1, 1])
    assert state.contact_places.wire_length == pytest.approx(state.model.panel.wire_length * state.length_factor, rel=1e-12)
    expected = sheet_conductance(*every_segment(state))
    weft, warp = sheet_resistance(state)
    assert (1.0 / weft, 1.0 / warp) == pytest.approx(np.diag(expected), rel=1e-9)
