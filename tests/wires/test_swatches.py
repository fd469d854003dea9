"""Machine-knit swatches as one wire (tools/studies/swatches.py): what they hook, how deep they overlap."""

from pathlib import Path

import numpy as np
import pytest
from swatches import DIAMETER, swatch

from warpknit.compute.host import fetch
from warpknit.kernels.rod_forces import find_rod_forces
from warpknit.scene import make_scene
from warpknit.solve.model import build_model, initial_state, mechanics_of
from warpknit.spatial import rod_step
from warpknit.wires.centre_lines import Wires
from warpknit.wires.hooks import find_crossings, find_places
from warpknit.wires.overlaps import find_overlaps

STITCHES, ROWS, LOOP_LENGTH = 12, 9, 18e-3  # [m]


def as_wire(points: np.ndarray) -> Wires:
    return Wires((points,), ("open",), np.zeros((1, 2), dtype=int), None, None, None)


@pytest.mark.parametrize(("kind", "overlap"), [("plain", 0.2), ("plain", 0.9), ("rib", 0.5), ("cable", 0.7)])
def test_a_swatch_overlaps_as_asked(kind: str, overlap: float) -> None:
    """Up to the last of 20 bisections of a height of a diameter, 1e-6; distances change by four times as much at most."""
    found = find_overlaps(as_wire(swatch(kind, STITCHES, ROWS, overlap)), DIAMETER)
    assert found.wires == (0, 0)
    assert 1.0 - found.closest / DIAMETER == pytest.approx(overlap, abs=4e-6)


@pytest.mark.parametrize("kind", ["plain", "rib"])
def test_each_stitch_hooks_the_one_below_with_both_legs(kind: str) -> None:
    """Four crossings of a stitch with the one below, two hooks, half a stitch from each other: their places repeat from stitch to
    stitch."""
    wire = as_wire(swatch(kind, STITCHES, ROWS, 0.5))
    below = STITCHES * (ROWS - 1)
    assert len(np.unique(find_crossings(wire).number)) == 4 * below
    places = find_places(wire, LOOP_LENGTH)
    assert places.hooks == 2 * below and (places.wire == 0).all()
    columns = np.unique(np.round(places.position[: places.hooks, 0], 5))
    assert len(columns) == 2 * STITCHES
    assert np.diff(columns[::2]) == pytest.approx(5e-3, abs=3e-5)


def test_threads_share_the_forces_of_a_single_wire(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same bits after 60 steps as with one thread; either thread finds the forces of half of the blocks."""
    monkeypatch.setattr(rod_step, "NODES_A_THREAD", 100)
    np.savez(tmp_path / "swatch.npz", wire=swatch("plain", 6, 5, 0.5))
    wires = {"file": "swatch.npz", "unit": "m", "loop_size": "5.5 mm"}
    tables = {"wires": wires, "wire": {"diameter": DIAMETER}, "contact": {"friction": 0.0}}
    scene = make_scene(tables, path=tmp_path / "scene.toml")
    moved = []
    for threads in ("1", "2"):
        monkeypatch.setenv("WARPKNIT_THREADS", threads)
        model = build_model(scene)
        mechanics = mechanics_of(model, initial_state(model))
        stepper = mechanics.stepper
        mechanics.group.prepare(np.array([0]))
        stepper.steering.set(travel_limit=np.inf)
        stepper.step(60)
        assert stepper.steering.step[0] == 60
        moved.append(fetch(stepper.state.displacement).copy())
        shares = [
            [one.threads for one in stepper.launches(part) if one.kernel is find_rod_forces] for part in range(stepper.parts)
        ]
        assert shares == [[-(-len(stepper.blocks) // stepper.parts)]] * stepper.parts  # of an even number of blocks
    assert np.abs(moved[0]).max() > 0.0
    assert np.array_equal(*moved)
