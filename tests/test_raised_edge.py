"""Spatial meshes whose edge is raised to a paraboloid: their height, the forces and the work of their clamps."""

import contextlib
import json
from pathlib import Path

import numpy as np
import pytest

from reference.flat_panel import flat_map, held_rim
from warpknit.measure.surface import find_surface
from warpknit.mesh.rim import build_rim
from warpknit.runner.summary import panel_of
from warpknit.scene import load_scene
from warpknit.scene.outline import regular
from warpknit.solve.membrane import LARGEST_FACTOR, LIFT_TOLERANCE
from warpknit.solve.model import build_model
from warpknit.solve.progress import Progress
from warpknit.solve.simulate import Record, Simulation
from warpknit.spatial.clamps import HEIGHT_ERROR

SCENE = """
[panel]
focal_length = "40 mm"
[output]
frames = 1
[contact]
friction = 0
"""
FOCAL = 0.04


def solved(folder: Path, *settings: str) -> Record:
    path = folder / "facet.toml"
    path.write_text(SCENE)
    *_, last = Simulation(build_model(load_scene(path, settings, "draft"))).run()
    return last


def heights_on_the_paraboloid(last: Record) -> np.ndarray:
    """[station] [m] r^2/(4 f) at the given stations under the strain of the record, from the middle of the panel."""
    model = last.observables.model
    rim, panel = build_rim(model.panel, model.scene), model.panel
    place = (rim.place - panel.low - 0.5 * panel.size) @ last.observables.gradient.T + last.stations[:, :2]
    return np.sum(place[rim.given] ** 2, axis=1) / (4.0 * model.scene.panel.focal_length)


@pytest.mark.parametrize("load", ["strain", "tension"])
def test_net_nodes_are_on_the_paraboloid_of_the_strained_panel(load: str, tmp_path: Path) -> None:
    """Under given tensions the strain is found on the way, and the net nodes follow it."""
    value = {"strain": 0.1, "tension": 0.05}[load]
    keys = ["panel.outline=triangle", "panel.size=9 mm", f"load.{load}_weft={value}", f"load.{load}_warp={value}"]
    pull = 'load.pull=[{at=["4.5 mm", "-2.6 mm"], by=["0.3 mm", "0 mm"], width="2 mm"}]'
    last = solved(tmp_path, *keys, pull, "output.frames=2")
    expected = heights_on_the_paraboloid(last)
    assert last.stations[:, 2] == pytest.approx(expected, abs=2.0 * HEIGHT_ERROR * 15e-6)
    assert np.ptp(expected) > 0.1e-3


def test_a_facet_hung_at_its_corners_is_flat(tmp_path: Path) -> None:
    """All corners of a hexagon of side s are at s^2/(4 f): cords and mesh lie in one plane under any tension.

    They miss the paraboloid by (s^2 - r^2)/(4 f). On the hexagon the means of r^2 and r^4 are 5/12 s^2 and 7/30 s^4, so that

        rms = s^2/(4 f) sqrt(1 - 5/6 + 7/30) = s^2/(4 f) sqrt(2/5)

    The cords draw the edge in by a few percent of s; this and the error of the height bound the difference. Clamps carry no more
    across the plane than the mesh is out of balance.
    """
    cord = ["panel.grip_pitch=10 mm", 'panel.cord={tension="50 mN", stiffness="50 N"}']
    last = solved(tmp_path, "panel.outline=hexagon", "panel.size=10 mm", *cord, "load.strain_weft=0.1", "load.strain_warp=0.1")
    (tables, summary), r = panel_of(last), last.observables
    assert summary is not None
    surface, depth = summary["surface"], 0.011**2 / (4.0 * FOCAL)
    error = 2.0 * LARGEST_FACTOR * LIFT_TOLERANCE  # at the edge, of an estimate by the mean tension
    assert tables["surface"]["height_m"] == pytest.approx(depth, abs=error * depth)
    drawn = float(np.linalg.norm(last.stations[:, :2], axis=1).max()) / 0.011
    assert drawn < 0.02
    assert surface["rms_deviation_m"] == pytest.approx(depth * np.sqrt(0.4), rel=2.0 * drawn + error)
    assert surface["pillowing_m"] == pytest.approx(depth, rel=error)
    left = np.abs(np.delete(r.force, r.model.wires.held_node, axis=0)[:, 2]).sum()
    assert abs(r.edge_force[:, 2].sum()) <= left < 0.02 * r.clamp_force.sum()


@pytest.mark.slow
def test_a_facet_held_along_its_edge_is_a_membrane(tmp_path: Path) -> None:
    """Its deviation u from the paraboloid obeys div(N grad u) = -tr N/(2 f), with u = 0 at the edge.

    Under even tension this is the torsion function of the hexagon, which the finite elements of a fine grid find. What differs is
    LIFT_TOLERANCE of the height, chords of the mesh between stations 3.4 mm apart, and stiff wires at the grips.
    """
    last = solved(tmp_path, "panel.outline=hexagon", "panel.size=10 mm", "load.strain_weft=0.2", "load.strain_warp=0.2")
    _, summary = panel_of(last)
    assert summary is not None
    surface = summary["surface"]
    tension = np.diag([summary["tension_median_weft_N_per_m"], summary["tension_median_warp_N_per_m"]])
    outline, spacing = regular(6, 0.012), 0.5e-3
    rim = held_rim(outline, spacing)
    grid = flat_map(outline, spacing, tension)
    expected = find_surface(grid, rim, np.eye(2), np.zeros((len(rim.arc), 2)), np.zeros(2), FOCAL)
    assert surface["pillowing_m"] == pytest.approx(expected.pillowing, rel=0.04)
    assert surface["rms_deviation_m"] == pytest.approx(expected.rms_deviation, rel=0.04)
    assert surface["rms_best_fit_m"] == pytest.approx(expected.rms_best_fit, rel=0.05)


def test_the_work_that_raises_a_mesh_is_stored_in_it(tmp_path: Path) -> None:
    """Without strain the clamps move across the plane alone. Energies grow at most as the fourth power of the height, whose work
    by the trapezoidal rule over n levels is too large by 1/n^2 at most."""
    keys = [
        "panel.outline=triangle",
        "panel.size=9 mm",
        "panel.focal_length=10 mm",
        "load.strain_weft=0.0",
        "load.strain_warp=0.0",
    ]
    last = solved(tmp_path, *keys, "output.frames=4", "model.nodes_per_loop=40")
    assert np.ptp(last.stations[:, 2]) > 0.5e-3
    assert last.edge_work == pytest.approx(last.observables.energies.stored, rel=1.0 / 4.0**2, abs=0.0)


def test_an_interrupted_run_goes_on_to_the_same_bits(tmp_path: Path) -> None:
    """A checkpoint has all that edge and corrections depend on."""
    path = tmp_path / "facet.toml"
    path.write_text(SCENE)
    keys = ["panel.outline=triangle", "panel.size=9 mm", "load.strain_weft=0.1", "load.strain_warp=0.1"]
    model = build_model(load_scene(path, keys, "draft"))
    kept: dict = {}

    def run(kept: dict, stop_at: int = 0) -> tuple[dict, int]:
        simulation, checks = Simulation(model, progress=Progress.from_dict(kept["progress"]) if kept else None), 0
        simulation.compile()
        if kept:
            simulation.drive.load_state_dict(kept["solver"])

        def monitor(progress: Progress) -> None:
            nonlocal checks
            checks += 1
            if checks == stop_at:
                raise KeyboardInterrupt

        simulation.monitor = monitor
        with contextlib.suppress(KeyboardInterrupt):
            list(simulation.run())
        progress = json.loads(json.dumps(simulation.progress.as_dict()))
        return {"solver": simulation.drive.state_dict(), "progress": progress, "state": simulation.state.arrays()}, checks

    expected, checks = run({})
    kept, _ = run({}, checks // 2)
    found, left = run(kept)
    assert 0 < left < checks
    for name, value in expected["state"].items():
        assert np.array_equal(value, found["state"][name]), name
