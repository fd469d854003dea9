"""An equilibrium that a small disturbance leaves is not reported (spatial/convergence.py)."""

import math
from pathlib import Path

import numpy as np
import pytest

from warpknit.measure import mesh_tension
from warpknit.scene import load_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation

DIAMETER, LENGTH, SPACING, APART = 0.1e-3, 2e-3, 0.1e-3, 1e-3  # [m]
TIGHT = """
[wire]
material = "molybdenum"
diameter = "30 um"
[knit]
bars = [{chain = "2-3/1-0"}, {chain = "1-0/1-2"}]
wales = "26/inch"
courses = "30/inch"
[model]
kind = "spatial"
boundary = "periodic"
[contact]
friction = 0
[load]
strain_weft = "6 %"
strain_warp = "6 %"
"""


def compressed(tmp_path: Path, strain: float) -> Simulation:
    """Two straight wires along the weft between clamps, compressed."""
    points = [(wire, SPACING * i, APART * wire, 0.0) for wire in range(2) for i in range(round(LENGTH / SPACING) + 1)]
    rows = ["wire,x [mm],y [mm],z [mm]", *(f"{w},{1e3 * x:.6f},{1e3 * y},{z}" for w, x, y, z in points)]
    (tmp_path / "straight.csv").write_text("\n".join(rows))
    scene = {
        "wires": {"file": str(tmp_path / "straight.csv"), "node_spacing": SPACING},
        "wire": {"diameter": DIAMETER},
        "model": {"boundary": "gripped"},
        "contact": {"friction": 0.0},
        "load": {"strain_weft": strain},
        "output": {"frames": 1, "usd": False},
    }
    return Simulation(build_model(load_scene(scene)))


@pytest.mark.parametrize(("strain", "buckles"), [(-0.005, False), (-0.008, True)])
def test_a_compressed_wire_buckles_at_eulers_load(tmp_path: Path, strain: float, buckles: bool) -> None:
    """4 pi^2 EI/l^2 between clamps: at a strain of 0.68 % for the wire between them, of the length l. They end in the middle of
    the first and the last segment.

    A straight wire is in equilibrium at any load. Beyond Euler's its force hardly grows, and it bends out by a (1 - cos)/2, whose
    arc is longer by a^2 pi^2/(4 l).
    """
    simulation = compressed(tmp_path, strain)
    *_, last = simulation.run()
    section, between = simulation.model.rods.section, LENGTH - SPACING
    force = -mesh_tension(last.observables)[0] * APART / 2.0
    euler = 4.0 * math.pi**2 * section.bending_stiffness / between**2
    moved = last.observables.position[:, 1:] - simulation.model.rods.position[:, 1:]
    off = np.linalg.norm(moved, axis=1).max()  # in whatever plane
    assert any("unstable" in note for note in simulation.notes) == buckles
    if buckles:
        assert force == pytest.approx(euler, rel=0.02)
        shortened = -strain - euler / section.axial_stiffness
        assert off == pytest.approx(2.0 / math.pi * between * math.sqrt(shortened), rel=0.05)
    else:
        assert force == pytest.approx(-strain * section.axial_stiffness, rel=0.01)
        assert off < 1e-3 * DIAMETER


@pytest.mark.slow
def test_a_tight_knit_leaves_an_equilibrium_that_is_not_stable(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """What it ends in has less energy and is stable: disturbed three hundred times as much it carries the same tension."""
    levels = 3
    scene = load_scene(TIGHT, [f"output.frames={levels}", "output.usd=false"])
    with monkeypatch.context() as without:
        without.setattr("warpknit.spatial.convergence.Stability.begin", lambda self, world: None)
        *_, symmetric = Simulation(build_model(scene)).run()
    simulation = Simulation(build_model(scene))
    *_, found = simulation.run()
    assert sum("unstable" in note for note in simulation.notes) == 1
    assert found.observables.bend_energy < 0.95 * symmetric.observables.bend_energy
    monkeypatch.setattr("warpknit.spatial.convergence.DISTURBANCE", 9.0)
    again = load_scene(TIGHT + '[[path]]\nname = "again"\n', [f"output.frames={levels}", "output.usd=false"])
    simulation = Simulation(build_model(again))
    records = list(simulation.run())
    tensions = [mesh_tension(record.observables) for record in records[levels:]]
    assert np.allclose(tensions[1:], tensions[0], rtol=0.01)
