"""Runs on a GPU from end to end, beside the CPU: the same figures within what convergence leaves open.

Without a GPU: tests/kernels/test_emulated_gpu.py runs them on a device that is the CPU.
"""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp

from reference.gpu_cases import CASES, SHARED, scene_of
from reference.thread_ranks import run_ranks
from warpknit import measure
from warpknit.base.errors import SceneError
from warpknit.compute.host import LEAST_BYTES, fetch, store
from warpknit.compute.ranks import Ranks
from warpknit.runner.run import run_scene
from warpknit.scene import Scene, load_scene
from warpknit.solve.model import build_model
from warpknit.solve.multilevel import MultilevelRelaxation
from warpknit.solve.simulate import Simulation
from warpknit.studies.sweep import run_map

MAP = Path(__file__).parents[1] / "scenes" / "contact_map.toml"
on_gpu = pytest.mark.parametrize("device", [pytest.param("cuda:0", marks=pytest.mark.gpu)], indirect=True)


def last_of(scene: Scene, device: str, ranks: Ranks | None = None) -> tuple[Simulation, Any]:
    """A run, and its last record."""
    simulation = Simulation(build_model(scene, device, ranks))
    *_, last = simulation.run()
    return simulation, last


@on_gpu
@pytest.mark.parametrize("name", CASES)
def test_a_run_has_the_figures_of_the_cpu(name: str, device: str) -> None:
    """Tensions and strains within twice the residual tolerance, either of which may be off by it. Active contacts but for those
    that just touch."""
    scene = scene_of(name)
    found, expected = (last_of(scene, place)[1].observables for place in (device, "cpu"))
    tolerance = 2.0 * scene.solver.residual_tolerance
    scale = max(np.abs(measure.mesh_tension(expected)))
    assert measure.mesh_tension(found) == pytest.approx(measure.mesh_tension(expected), rel=tolerance, abs=tolerance * scale)
    assert found.stretch == pytest.approx(expected.stretch, rel=0, abs=tolerance * np.abs(expected.stretch - np.eye(2)).max())
    assert measure.contacts(found).active_percent == pytest.approx(measure.contacts(expected).active_percent, abs=2.0)


@on_gpu
@pytest.mark.parametrize("name", ["planar panel, from a smaller mesh", "spatial panel, from a smaller mesh"])
def test_small_meshes_of_a_large_start_run_on_the_cpu(name: str, device: str) -> None:
    """Only what is carried over lies on the GPU: kernels that take the response of the cloth are launched there."""
    simulation = Simulation(build_model(scene_of(name), device))
    drive = simulation.drive
    assert isinstance(drive, MultilevelRelaxation) and drive.smaller is not None and drive.cell is not None
    assert [part.model.device for part in (drive, drive.smaller, drive.cell)] == [device, "cpu", "cpu"]
    for _ in range(2):  # as built, then compiled
        response = drive._response
        arrays = (response.cell_node, response.no_change, *response.change.values())
        assert {str(array.device) for array in arrays} == {device}
        simulation.compile()


@on_gpu
@pytest.mark.parametrize("name", ["planar patch, yield", "spatial patch, friction, yield", "tight tricot"])
def test_a_run_repeats_to_the_bit(name: str, device: str) -> None:
    """No sum depends on the order of the threads."""
    one, other = (last_of(scene_of(name), device)[0].state.arrays() for _ in range(2))
    assert {key for key in one if not np.array_equal(one[key], other[key], equal_nan=True)} == set()


@on_gpu
def test_a_run_leaves_files_and_resumes(device: str, tmp_path: Path) -> None:
    """The command as a user gives it; a finished run is returned as it is."""
    done = run_scene(scene_of("planar cell"), out=tmp_path / "run", device=device)
    assert done.exit_code == 0
    with open(tmp_path / "run" / "history.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert float(rows[-1]["tension_weft_N_per_m"]) > 0.0
    assert (
        run_scene(scene_of("planar cell"), out=tmp_path / "run", device=device, resume=True).summary.json() == done.summary.json()
    )


@on_gpu
def test_copies_on_the_host_take_the_same_memory_in_turn(device: str) -> None:
    """A copy does not follow its array, and its memory is used again once no view of it is left."""
    values = np.arange(2.0 * LEAST_BYTES / 8.0)
    array: wp.array = wp.array(values, dtype=wp.float64, device=device)
    first = fetch(array)
    store(array, 0.0)
    assert np.array_equal(first, values)
    address = first.ctypes.data
    part = first[-3:]
    del first
    second = fetch(array)
    assert not second.any() and second.ctypes.data != address
    assert np.array_equal(part, values[-3:])
    del part
    assert fetch(array).ctypes.data == address


@on_gpu
@pytest.mark.parametrize("name", SHARED)
def test_ranks_that_share_a_mesh_have_the_bits_of_one(name: str, device: str) -> None:
    def variables(ranks: Ranks) -> dict[str, np.ndarray]:
        simulation, _last = last_of(scene_of(name), device, ranks)
        return simulation.mechanics.state_variables()

    alone = variables(Ranks())
    for shared in run_ranks(2, variables):
        assert {name for name in alone if not np.array_equal(alone[name], shared[name])} == set()


@on_gpu
def test_a_map_runs_on_the_cpu_and_agrees_with_the_gpu(device: str, tmp_path: Path) -> None:
    """A map refuses the GPU by name; without, its last pair has the tensions of a run of these strains on the GPU."""
    pair = ["solver.preset=draft", "output.frames=1", "sweep.strain_weft=[0.0, 0.1]", "sweep.strain_warp=[0.0, 0.1]"]
    scene = load_scene(MAP, pair)
    with pytest.raises(SceneError, match="device"):
        run_map(scene, out=tmp_path / "refused", device=device)
    assert run_map(scene, out=tmp_path / "map").exit_code == 0
    with open(tmp_path / "map" / "map.csv", newline="", encoding="utf-8") as file:
        last = list(csv.DictReader(file))[-1]
    _, record = last_of(load_scene(MAP, [*pair, "load.strain_weft=0.1", "load.strain_warp=0.1"]), device)
    expected = [float(last[f"tension_{way}_N_per_m"]) for way in ("weft", "warp")]
    assert measure.mesh_tension(record.observables) == pytest.approx(expected, rel=2.0 * scene.solver.residual_tolerance)
