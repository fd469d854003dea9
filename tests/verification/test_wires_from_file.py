"""Wires from a file, run as rods: closed forms of straight wires, overlaps pushed apart, energy and work of a knit."""

from pathlib import Path

import numpy as np
import pytest

from reference.in_words import quantities
from warpknit.base.errors import ModelError, SceneError
from warpknit.measure import mesh_tension, positions
from warpknit.mechanics.numerics import AXIAL_ERROR
from warpknit.scene import Scene, load_scene
from warpknit.scene.scene_loader import make_scene
from warpknit.solve.model import build_model, initial_state, mechanics_of
from warpknit.solve.simulate import Simulation

SCENES = Path(__file__).parents[2] / "scenes" / "wires"
KNIT = SCENES / "plain_knit_spatial.toml"
DIAMETER, PERIOD = 1e-4, 2e-3  # [m]


def crossing(folder: Path, height: float, **tables) -> Scene:
    """A wire along weft and one along warp, `height` [m] above it, that repeat every PERIOD."""
    along = np.linspace(0.0, PERIOD, 41)
    weft = np.stack([along, np.full(41, 0.25 * PERIOD), np.zeros(41)], axis=1)
    warp = np.stack([np.full(41, 0.5 * PERIOD), along, np.full(41, height)], axis=1)
    np.savez(folder / "wires.npz", weft, warp)
    wires = {"file": "wires.npz", "unit": "m", "period": [PERIOD, PERIOD], "node_spacing": DIAMETER}
    table = {"wires": wires, "wire": {"diameter": DIAMETER}, "model": {"kind": "spatial", "boundary": "periodic"}}
    table |= {"contact": {"friction": 0.0}}
    return make_scene(table | {"output": {"frames": 1}} | tables, path=folder / "scene.toml")


def settled(scene: Scene) -> tuple[list, Simulation]:
    relaxation = Simulation(build_model(scene))
    return list(relaxation.run()), relaxation


def test_straight_wires_carry_ea_times_strain(tmp_path):
    """Of a wire every P: tension EA e/P in weft, and twice that at twice the strain in warp. A steady state may hide a strain
    of AXIAL_ERROR behind the softening of the wires."""
    scene = crossing(tmp_path, 3.0 * DIAMETER, load={"strain_weft": 0.01, "strain_warp": 0.02})
    records, relaxation = settled(scene)
    stress = records[-1].observables.nominal_stress
    stiffness = scene.wire.axial_stiffness / PERIOD
    assert np.diag(stress) == pytest.approx(stiffness * np.array([0.01, 0.02]), rel=0, abs=stiffness * AXIAL_ERROR)
    assert relaxation.notes == []


def test_open_wires_are_clamped_in_the_middle_of_their_end_segments(tmp_path):
    """The clamps of a wire of length L are L - h apart, in the middle of the segments of length h that they hold: a load e
    stretches the wire between them by e (L - h). So it stores EA e^2 (L - h)/2, whose derivative by e over the area of the box
    of L x L around both wires is the nominal stress. The tension is the force over the width of this box, EA e/(L (1 + e'))."""
    wires = {"file": "wires.npz", "unit": "m", "node_spacing": DIAMETER}
    model = {"kind": "spatial", "boundary": "gripped"}
    scene = crossing(tmp_path, 3.0 * DIAMETER, wires=wires, model=model, load={"strain_weft": 0.01, "strain_warp": 0.02})
    records, relaxation = settled(scene)
    apart = PERIOD - DIAMETER
    stiffness = scene.wire.axial_stiffness * apart / PERIOD**2
    stress = np.diag(records[-1].observables.nominal_stress)
    strain = np.array([0.01, 0.02])
    assert stress == pytest.approx(stiffness * strain, rel=0, abs=stiffness * AXIAL_ERROR)
    stiffness = scene.wire.axial_stiffness / PERIOD
    tension = stiffness * strain / (1.0 + strain[::-1])
    assert mesh_tension(records[-1].observables) == pytest.approx(tension, rel=0, abs=stiffness * AXIAL_ERROR)
    assert len(relaxation.model.wires.held_node) == 8


def test_places_of_open_wires_count_from_the_corner_of_their_box():
    """Wires whose loops reach beyond their ends: the period is the size of the box of all nodes."""
    model = build_model(load_scene(SCENES / "plain_knit_patch.toml"))
    node, _ = positions(mechanics_of(model, initial_state(model)).observe())
    low, high = node[:, :2].min(axis=0), node[:, :2].max(axis=0)
    assert low == pytest.approx(0.0, abs=1e-12) and high == pytest.approx(model.layout().period, rel=1e-9)


def test_wires_that_nothing_holds_are_refused(tmp_path):
    angle = 2.0 * np.pi * np.arange(24) / 24
    np.savez(tmp_path / "ring.npz", 1e-3 * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1))
    wires = {"file": "ring.npz", "unit": "m", "closed": True}
    with pytest.raises(ModelError, match="closed rings"):
        build_model(make_scene({"wires": wires, "model": {"kind": "spatial"}}, path=tmp_path / "scene.toml"))


def test_wires_that_overlap_are_pushed_apart_and_said(tmp_path):
    scene = crossing(tmp_path, 0.8 * DIAMETER)
    records, relaxation = settled(scene)
    [note] = relaxation.notes
    assert quantities(note)[:2] == ["1", "20 %"]
    rods, position = relaxation.model.rods, records[0].observables.position
    weft, warp = np.split(position, rods.wire_first[1:])
    # they are far from each other but at the crossing, where the gap is their difference in height
    gap = np.interp(0.25 * PERIOD, warp[:, 1], warp[:, 2]) - np.interp(0.5 * PERIOD, weft[:, 0], weft[:, 2])
    assert gap >= DIAMETER * (1.0 - 1e-3)


@pytest.mark.parametrize("height", [0.0, 1e-5])
def test_wires_that_pass_through_each_other_are_refused(tmp_path, height):
    """Which of them lies over the other is not for round-off to say."""
    relaxation = Simulation(build_model(crossing(tmp_path, height * DIAMETER)))
    with pytest.raises(ModelError, match=r"wires 1 and 2 .*\(1, 0.5\) mm"):
        relaxation.compile()


def test_a_knit_from_a_file_stores_the_work_done_on_it():
    """Plain knit drawn by 2 % in weft; energy over work within a per cent, the spline of the work through three states
    being exact for a quadratic energy, which it nearly is."""
    records, relaxation = settled(load_scene(KNIT, ["load.strain_weft=0.02", "load.strain_warp=0.0", "output.frames=2"]))
    area = relaxation.model.panel.area
    force = [area * record.observables.nominal_stress[0, 0] for record in records]
    work = 0.01 * (force[0] + 4.0 * force[1] + force[2]) / 3.0
    assert records[-1].observables.energies.stored - records[0].observables.energies.stored == pytest.approx(work, rel=0.01)
    assert force[2] > force[1] > 0.0


def test_nodes_finer_than_half_a_diameter_are_refused():
    with pytest.raises(SceneError, match="wires.node_spacing: 40 um "):
        build_model(load_scene(KNIT, ["wires.node_spacing=40 um"]))
