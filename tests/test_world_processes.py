"""Worlds in processes (warpknit/solve/side_by_side.py)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import psutil
import pytest

from warpknit import build_model, load_scene
from warpknit.base.errors import OutOfResources
from warpknit.runner.history import row_of
from warpknit.scene import Scene
from warpknit.solve import side_by_side, simulate
from warpknit.solve.side_by_side import WorldProcesses
from warpknit.solve.simulate import SideBySide, Simulation
from warpknit.solve.variant_models import VariantModels
from warpknit.studies.load_path import LoadPath, under_strain


def scene_of(**tables: dict) -> Scene:
    return load_scene(
        {
            "wire": {"material": "molybdenum", "diameter": "30 um"},
            "knit": {"bars": [{"chain": "1-0/1-2"}, {"chain": "1-2/1-0"}], "wales": "26 /inch", "courses": "30 /inch"},
            "model": {"kind": "spatial", "boundary": "periodic"},
            "contact": {"friction": 0.0},
            "load": {"strain_weft": 0.02, "strain_warp": 0.02},
            "solver": {"preset": "draft", "precision": "double"},
            "output": {"frames": 2},
        }
        | tables
    )


@pytest.fixture
def two_processes(monkeypatch) -> None:
    for module in (simulate, side_by_side):
        monkeypatch.setattr(module, "processes_of", lambda _models: 2)


def found_by(scenes: list[Scene], monitor: Callable[[Any], None] | None = None, *, spread: bool) -> tuple[Simulation, list]:
    simulation = Simulation(build_model(scenes[0]), worlds=scenes, spread=spread, monitor=monitor)
    rows = sorted((record.world, record.index, row_of(record)) for record in simulation.run())
    return simulation, rows


def test_worlds_have_the_same_results_in_processes(two_processes) -> None:
    """Records, errors and steps, to the bit."""
    pillars = {"bars": [{"chain": "1-0/0-1"}], "wales": "26 /inch", "courses": "30 /inch"}  # which nothing holds in weft
    scene = scene_of(knit=pillars)
    pulled = scene_of(knit=pillars, load={"tension_weft": "1 N/m", "tension_warp": "1 N/m"})
    scenes = [scene, pulled, scene.changed(["load.strain_warp=0.03"])]
    here, expected = found_by(scenes, spread=False)
    spread, found = found_by(scenes, spread=True)
    assert isinstance(here.worlds, SideBySide)
    assert isinstance(spread.worlds, WorldProcesses)
    assert found == expected
    assert {0, 2} <= {world for world, *_ in found}
    assert {world: str(error) for world, error in spread.failures.items()} == {1: str(here.failures[1])}
    assert spread.steps == here.steps


def test_planar_worlds_have_the_same_results_in_processes(two_processes) -> None:
    """Their models have device arrays."""
    scene = scene_of(model={"kind": "planar", "boundary": "periodic"})
    scenes = [scene, scene.changed(["load.strain_warp=0.03"])]
    _, expected = found_by(scenes, spread=False)
    _, found = found_by(scenes, spread=True)
    assert found == expected and {world for world, *_ in found} == {0, 1}


def test_a_path_of_meshes_goes_on_in_processes(two_processes, monkeypatch) -> None:
    meshes, scene = VariantModels(scene_of()), scene_of()
    models = [meshes.of_place(place) for place in (0, 1)]
    first, second = (under_strain(scene, np.diag([1.0 + e, 1.0])) for e in (0.01, 0.02))
    rows = {}
    for spread in (True, False):
        if not spread:
            monkeypatch.setattr(simulate, "processes_of", lambda _models: 1)
        path = LoadPath(models)
        rows[spread] = [*path.rows(first, levels=1), *path.rows(second, levels=1)]
    assert rows[True] == rows[False]


def test_an_interrupt_ends_the_processes(two_processes) -> None:
    before, begun = set(psutil.Process().children()), []

    def stop(_progress: Any) -> None:
        begun.extend(set(psutil.Process().children()) - before)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        found_by([scene_of()] * 2, stop, spread=True)
    assert len(begun) == 2
    assert not any(process.is_running() for process in begun)


def test_a_killed_process_is_an_error(two_processes) -> None:
    before = set(psutil.Process().children())

    def kill(_progress: Any) -> None:
        for child in set(psutil.Process().children()) - before:
            child.kill()

    with pytest.raises(OutOfResources):
        found_by([scene_of()] * 2, kill, spread=True)
