"""Lengths, natural curvature and twist of a .pyp pattern: energies of the wires as they come, against closed forms."""

import numpy as np
import pytest

from reference.rods import SECTION, energy
from warpknit import Simulation, build_model
from warpknit.commands.plan import overview_of
from warpknit.scene import SceneError, load_scene
from warpknit.spatial.from_file import panel_of_wires
from warpknit.spatial.rod_step import RodStepper
from warpknit.wires.centre_lines import even_directors, twist
from warpknit.wires.read import read_wires

TURNS, POINTS = 2, 48  # of a helix, and of each turn
RADIUS, PITCH = 0.3, 1.0  # [mm]
CURVATURE = RADIUS * (2 * np.pi / PITCH) ** 2 / (1 + (2 * np.pi * RADIUS / PITCH) ** 2)  # [1/mm]
TORSION = (2 * np.pi / PITCH) / (1 + (2 * np.pi * RADIUS / PITCH) ** 2)
LENGTH = TURNS * PITCH * np.hypot(1.0, 2 * np.pi * RADIUS / PITCH)  # [mm]
# turns between chords, and turns over arcs, differ from those of the helix by h^2 (curvature^2 + torsion^2)/12 of themselves
ERROR = 2.0 * (LENGTH / TURNS / POINTS) ** 2 * (CURVATURE**2 + TORSION**2) / 12.0


def helix() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (n, 3) of a helix along x [mm], the directions of its edges, and a director of each without twist."""
    angle = 2 * np.pi * np.arange(TURNS * POINTS) / POINTS
    points = np.stack([PITCH * angle / (2 * np.pi), RADIUS * np.cos(angle), RADIUS * np.sin(angle)], axis=1)
    following = np.concatenate([points[1:], points[:1] + [TURNS * PITCH, 0.0, 0.0]])
    edge = following - points
    tangent = edge / np.linalg.norm(edge, axis=1)[:, None]
    return points, tangent, even_directors(tangent, np.array([0]), np.array([len(points)]), np.array([True]))


def write(path, blocks, *, shuffled=False) -> None:
    """The helix with these blocks, and "t", whose lines stand in the order of its points; shuffled: the lines of *E."""
    points, _, _ = helix()
    n = len(points)
    edges = np.column_stack([np.arange(n), (np.arange(n) + 1) % n, np.append(np.zeros(n - 1), 1), np.zeros(n)])
    whole = {
        "*pattern": [[TURNS * PITCH, 2.0, 0.01, n]],
        "*Q": np.column_stack([points, blocks.get("t", np.zeros(n))]),
        "*E": np.random.default_rng(0).permutation(edges) if shuffled else edges,
        **{name: np.reshape(values, (n, -1)) for name, values in blocks.items() if name != "t"},
    }
    lines = [line for name, rows in whole.items() for line in (name, *(" ".join(f"{x:.17g}" for x in row) for row in rows), "")]
    path.write_text("\n".join(lines), encoding="utf-8")


def energy_of_file(path) -> float:
    """Energy of the wires of a file as they come, with the natural shape of the file; lengths in its unit."""
    wires = read_wires(path, node_spacing=LENGTH / (TURNS * POINTS), unit=1.0)
    _, _, rods = panel_of_wires([SECTION] * len(wires.points), wires, LENGTH)
    stepper = RodStepper(rods)
    stepper.evaluate()
    return energy(stepper)


def curvatures(tangent: np.ndarray, d1: np.ndarray) -> np.ndarray:
    """(point, 2) k1 = d2 . kb, k2 = - d1 . kb with the mean directors, of discrete elastic rods."""
    before, d2 = np.roll(tangent, 1, axis=0), np.cross(tangent, d1)
    kb = 2.0 * np.cross(before, tangent) / (1.0 + np.sum(before * tangent, axis=1))[:, None]
    first, second = (0.5 * (d + np.roll(d, 1, axis=0)) for d in (d1, d2))
    return np.stack([np.sum(second * kb, axis=1), -np.sum(first * kb, axis=1)], axis=1)


def test_natural_curvature_and_twist_of_zero_are_those_of_a_straight_wire(tmp_path):
    """E = EI kappa^2 L/2: a helix of a wire that is straight and without twist when free, as its directors have no twist."""
    path, n = tmp_path / "zero.pyp", TURNS * POINTS
    write(path, {"*RK": np.zeros((n, 2)), "*RT": np.zeros(n)})
    closing = 2 * np.pi * TURNS * np.sin(np.arctan2(PITCH, 2 * np.pi * RADIUS))  # the twist-free frame turns back by the torsion
    evenly = SECTION.twist_stiffness * ((closing - 2 * np.pi * np.round(closing / (2 * np.pi))) / LENGTH) ** 2 * LENGTH / 2
    assert energy_of_file(path) == pytest.approx(SECTION.bending_stiffness * CURVATURE**2 * LENGTH / 2 + evenly, rel=ERROR)


@pytest.mark.parametrize("share", [1.0, 0.5, -0.5])
@pytest.mark.parametrize("strain", [0.0, 0.2])
def test_natural_curvature_and_twist_along_any_directors(tmp_path, share, strain):
    """E = (1 - share)^2 EI kappa^2 L/2 + GJ strain^2 L/2, with a natural curvature of `share` of that of the helix and a natural
    twist that is `strain` [1/mm] less; the reference directors of the edges point anywhere, and *RefT says by how much."""
    points, tangent, d1 = helix()
    turned = np.random.default_rng(1).uniform(-1.0, 1.0, len(points))
    reference = np.cos(turned)[:, None] * d1 - np.sin(turned)[:, None] * np.cross(tangent, d1)
    before = np.roll(tangent, 1, axis=0)
    own = twist(np.roll(d1, 1, axis=0), d1, before, tangent)
    blocks = {
        "t": turned,
        "*RK": share * curvatures(tangent, d1),
        "*RT": own - strain * LENGTH / len(points),
        "*RefD1": reference,
        "*RefT": own - turned + np.roll(turned, 1),
    }
    path = tmp_path / "natural.pyp"
    write(path, blocks, shuffled=True)
    bent = SECTION.bending_stiffness * CURVATURE**2 * LENGTH / 2
    expected = (1.0 - share) ** 2 * bent + SECTION.twist_stiffness * strain**2 * LENGTH / 2
    assert energy_of_file(path) == pytest.approx(expected, rel=ERROR, abs=ERROR * bent)
    del blocks["*RefT"]  # is that of the reference directors
    write(path, blocks)
    assert energy_of_file(path) == pytest.approx(expected, rel=ERROR, abs=ERROR * bent)


def test_a_wire_free_of_stress_in_its_file_is_so_with_half_as_many_nodes(tmp_path):
    """Nodes between the points: natural turns are interpolated and transported, to second order in the distance of points."""
    points, tangent, d1 = helix()
    path = tmp_path / "free.pyp"
    write(path, {"*RK": curvatures(tangent, d1), "*RefD1": d1})
    wires = read_wires(path, node_spacing=1.7 * LENGTH / len(points), unit=1.0)
    _, _, rods = panel_of_wires([SECTION], wires, LENGTH)
    stepper = RodStepper(rods)
    stepper.evaluate()
    spacing = LENGTH / rods.node_count
    off = spacing**2 * (CURVATURE**2 + TORSION**2) / 6.0  # of the curvature
    assert energy(stepper) < off**2 * SECTION.bending_stiffness * CURVATURE**2 * LENGTH / 2


def test_values_of_edges_stand_by_the_points_that_they_leave(tmp_path):
    """With edges in any order, lengths free of stress that differ from edge to edge stay with their edges."""
    points, _, _ = helix()
    longer = 1.0 + 0.1 * np.sin(np.arange(len(points)))
    chord = LENGTH / len(points) * (1.0 - (LENGTH / len(points) * CURVATURE) ** 2 / 24.0)
    found = []
    for shuffled in (False, True):
        path = tmp_path / f"{shuffled}.pyp"
        write(path, {"*RL": chord * longer}, shuffled=shuffled)
        wires = read_wires(path, node_spacing=LENGTH / len(points), unit=1.0)
        assert wires.rest_lengths is not None
        begin, end = wires.ends(0)
        found.append(wires.rest_lengths[0] / np.linalg.norm(end - begin, axis=1))
    assert found[0] == pytest.approx(longer, rel=2e-4)  # the chord, to fourth order
    assert np.array_equal(found[0], found[1])


def test_a_given_set_fraction_takes_the_place_of_the_natural_shape(tmp_path):
    """Named in a plan; as with the file without the blocks."""
    path, n = tmp_path / "zero.pyp", TURNS * POINTS
    write(path, {"*RK": np.zeros((n, 2)), "*Colour": np.zeros(n)})
    table = {
        "wires": {"file": str(path), "unit": "mm", "node_spacing": "0.05 mm"},
        "wire": {"diameter": "20 um", "set_fraction": 0.5}, "model": {"boundary": "periodic"}, "load": {"strain_weft": 0.01},
    }  # fmt: skip
    file = overview_of(load_scene(table)).file
    assert file is not None and file.wires.natural_turns is None
    assert file.wires.notes[:2] == (
        "blocks that are not read: *Colour",
        "natural curvature and twist of zero.pyp (*RK, *RT) are not used: wire.set_fraction = 0.5 sets them",
    )
    assert [warning.code for warning in file.warnings[:2]] == ["W03", "W03"]
    whole = overview_of(load_scene(table, {"wire.set_fraction": 1})).file
    assert whole is not None and whole.wires.natural_turns is not None and not np.any(whole.wires.natural_turns[0])


def test_curvature_without_directors_is_refused(tmp_path):
    path = tmp_path / "bad.pyp"
    write(path, {"*RK": np.ones((TURNS * POINTS, 2))})
    with pytest.raises(SceneError, match=r"\*RK without \*RefD1"):
        read_wires(path, node_spacing=0.1)


def test_a_wire_that_is_twisted_as_it_lies_untwists(tmp_path):
    """A straight wire with natural twist of its own, and no natural curvature: its sections turn until no energy is left."""
    count = 24
    x = 2.0 * np.arange(count) / count
    rows = {
        "*pattern": [[2.0, 2.0, 0.01, count]],
        "*Q": np.column_stack([x, np.zeros((count, 3))]),
        "*E": np.column_stack([np.arange(count), (np.arange(count) + 1) % count, np.arange(count) == count - 1, np.zeros(count)]),
        "*RT": 0.3 * np.sin(np.pi * x)[:, None],
    }
    text = "\n".join(
        line for name, block in rows.items() for line in (name, *(" ".join(f"{v:.17g}" for v in row) for row in block), "")
    )
    (tmp_path / "twisted.pyp").write_text(text, encoding="utf-8")
    wires = {"file": tmp_path / "twisted.pyp", "unit": "1 mm", "node_spacing": f"{2.0 / count} mm"}
    scene = {"wires": wires, "wire": {"diameter": "0.05 mm"}}
    scene |= {
        "model": {"boundary": "periodic"},
        "contact": {"friction": 0.0},
        "load": {"strain_weft": 1e-3},
        "output": {"frames": 1},
    }
    before, *_ = Simulation(build_model(load_scene(scene))).run()
    twist = 0.3 * np.sin(np.pi * x) / (2e-3 / count)  # [1/m] as it lies
    assert before.steps > 0 and np.abs(before.observables.twist_change).max() < 1e-3 * twist.max()
