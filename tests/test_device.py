"""On which device a mesh runs, what the help says of it, and how much memory it has there."""

from __future__ import annotations

import logging
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import warp as wp
from click.testing import CliRunner

from warpknit.base.errors import MemoryNeeded, OutOfResources
from warpknit.commands.cli import main
from warpknit.commands.plan import overview_of
from warpknit.commands.run import run
from warpknit.compute import DEFAULT_DEVICE, LEAST_NODES, device, device_of_mesh, memory
from warpknit.compute.ranks import Ranks
from warpknit.mesh.layout import knit_scene
from warpknit.runner import run as runner
from warpknit.scene import Scene, load_scene
from warpknit.spatial import wire_contact
from warpknit.studies import trade

CELL = Path(__file__).parents[1] / "scenes" / "atlas_cell.toml"
PATCH = ["model.boundary=gripped", "knit.repeats=[8, 8]"]


class Reached(Exception):
    """A fake has been called, and the test ends there."""


class Pair(Ranks):
    """One of two ranks, alone."""

    count = 2


@pytest.fixture
def graphics(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two devices by name that nothing can run on."""
    monkeypatch.setattr(device, "devices", lambda: ["cpu", "cuda:0", "cuda:1"])


def small_gpu(monkeypatch: pytest.MonkeyPatch, free: int) -> None:
    """Have the device cuda:0 say that so many bytes are free."""
    real = wp.get_device
    fake: Any = SimpleNamespace(free_memory=free)
    monkeypatch.setattr(wp, "get_device", lambda name=None: fake if name == "cuda:0" else real(name))


def ends(*_given: object, **_named: object) -> None:
    raise Reached


def test_a_mesh_of_few_nodes_is_computed_on_the_cpu() -> None:
    assert device_of_mesh(LEAST_NODES - 1, "cuda:1") == "cpu"
    assert device_of_mesh(LEAST_NODES, "cuda:1") == "cuda:1"
    assert device_of_mesh(LEAST_NODES, "cpu") == "cpu"


@pytest.mark.parametrize("command", ["run", "plan", "map", "trade", "report"])
def test_the_help_says_from_which_size_on_a_gpu_is_taken(command: str) -> None:
    said = " ".join(CliRunner().invoke(main, [command, "--help"]).output.split())
    assert f"Default: {DEFAULT_DEVICE}." in said
    assert DEFAULT_DEVICE in " ".join((run.__doc__ or "").split())
    assert f" {LEAST_NODES:,} nodes " in (Path(__file__).parents[1] / "docs/how-to/gpu.md").read_text()


@pytest.mark.parametrize(("asked", "warns"), [(None, False), ("cuda:0", True)])
def test_ranks_that_take_gpus_in_turn_are_not_warned(
    asked: str | None,
    warns: bool,
    graphics: None,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    tmp_path: Path,
) -> None:
    caplog.set_level(logging.WARNING, logger="warpknit")
    monkeypatch.setattr(runner, "mesh_nodes", lambda _scene: LEAST_NODES)
    monkeypatch.setattr(runner, "build_model", ends)
    with pytest.raises(Reached):
        runner.run_scene(load_scene(CELL), out=tmp_path / "run", device=asked, ranks=Pair())
    assert bool(caplog.messages) is warns


def test_a_study_of_a_small_mesh_takes_the_cpu(graphics: None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    taken = []

    def build(_scene: Scene, name: str) -> None:
        taken.append(name)
        raise Reached

    monkeypatch.setattr(trade, "build_model", build)
    with pytest.raises(Reached):
        trade.run_trade(lambda more, preset: load_scene(CELL, more, preset), out=tmp_path / "trade")
    assert taken == ["cpu"]


def test_a_plan_compares_with_the_memory_that_is_free_on_the_gpu(graphics: None, monkeypatch: pytest.MonkeyPatch) -> None:
    small_gpu(monkeypatch, 2**28)
    assert overview_of(load_scene(CELL), "cuda:0").available_bytes == 2**28
    small_gpu(monkeypatch, 2**60)
    monkeypatch.setattr("warpknit.commands.plan.available_memory", lambda name="cpu": 2**30 if name == "cpu" else 2**60)
    assert overview_of(load_scene(CELL), "cuda:0").available_bytes == 2**30


def test_a_mesh_that_the_gpu_has_no_room_for_is_refused(graphics: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is laid out in main memory first, so that it needs room there, too."""
    small_gpu(monkeypatch, 2**20)
    for ask in (overview_of, knit_scene):
        with pytest.raises(MemoryNeeded, match=r"knit.repeats = \[8, 8\]: 8.19e\+03 .* 1 MiB"):
            ask(load_scene(CELL, PATCH), "cuda:0")
    assert overview_of(load_scene(CELL, PATCH), "cpu").device == "cpu"
    small_gpu(monkeypatch, 2**60)
    monkeypatch.setattr(memory, "available_memory", lambda name="cpu": 2**20 if name == "cpu" else 2**60)
    with pytest.raises(MemoryNeeded):
        knit_scene(load_scene(CELL, PATCH), "cuda:0")


def test_a_list_of_pairs_is_limited_by_the_memory_of_its_device(monkeypatch: pytest.MonkeyPatch) -> None:
    small_gpu(monkeypatch, 1000)
    contact = object.__new__(wire_contact.WireContact)
    contact.stepper = SimpleNamespace(device="cuda:0")  # type: ignore[assignment]
    with pytest.raises(OutOfResources, match="100 .* MiB"):
        contact._capacity(100, 60)
    contact.stepper = SimpleNamespace(device="cpu")  # type: ignore[assignment]
    assert contact._capacity(100, 60) >= 100
