"""Runs of the spatial model: what it refuses, and what it leaves."""

import json
from pathlib import Path

import numpy as np
import pytest

from warpknit.cli import main
from warpknit.errors import SceneError
from warpknit.frame import Frame, WireLayout
from warpknit.run.run import run_scene
from warpknit.scene import load_scene

SCENES = Path(__file__).parent.parent / "scenes"
CELL = SCENES / "atlas_cell_spatial.toml"
QUICK = ("model.nodes_per_loop=24", "solver.preset=draft", "output.frames=1", "load.strain_weft=0.01", "load.strain_warp=0.01")


@pytest.mark.parametrize(
    ("override", "line"),
    [
        ('load.pull=[{at=["1 mm", "0 mm"], by=["0 mm", "1 mm"], width="1 mm"}]', "load.pull: given "),
        ("solver.drive=ramp", "solver.drive: given 'ramp', allowed: 'relax'"),
        ("solver.precision=single", "solver.precision: given 'single', allowed: 'double'"),
        ("wire.plastic=true", "wire.plastic: given true, allowed: false"),
        ('load.tension_weft="2 N/m"', "load.tension_weft: given '2 N/m', allowed: strain_weft"),
    ],
)
def test_what_only_the_planar_model_does_is_refused(override: str, line: str) -> None:
    with pytest.raises(SceneError) as error:
        load_scene(CELL, [override])
    assert line in str(error.value) and str(error.value).endswith("with model.kind = 'spatial'")
    assert "\n" not in str(error.value)


def test_maps_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    with pytest.raises(SystemExit) as end:
        main(["map", str(SCENES / "contact_map.toml"), "--set", "model.kind=spatial", "--out", str(tmp_path / "m"), "--quiet"])
    assert end.value.code == 2
    assert "model.kind: given 'spatial', allowed for a map: 'planar'" in capsys.readouterr().err
    assert not (tmp_path / "m").exists()


def test_a_small_tile_with_long_segments_is_refused(tmp_path: Path) -> None:
    """A segment that would meet two copies of another cannot be run."""
    scene = load_scene(SCENES / "atlas_cell.toml", ["model.kind=spatial", "model.nodes_per_loop=8", "wire.diameter='200 um'"])
    with pytest.raises(Exception, match="so that no segment meets two copies of another"):
        run_scene(scene, out=tmp_path / "run", device="cpu")


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("spatial") / "run"
    assert run_scene(load_scene(CELL, QUICK), out=out, device="cpu").exit_code == 0
    return out


def keys_of(tree: dict, under: str = "") -> set[str]:
    found = set()
    for key, value in tree.items():
        found.add(f"{under}{key}")
        if isinstance(value, dict):
            found |= keys_of(value, f"{under}{key}.")
    return found


def test_summary_has_the_keys_of_a_planar_run(finished: Path, tmp_path: Path) -> None:
    planar = run_scene(load_scene(SCENES / "atlas_cell.toml", QUICK), out=tmp_path / "planar", device="cpu").summary
    summary = json.loads((finished / "summary.json").read_text())
    assert summary["model"]["kind"] == "spatial" and summary["stop_reason"] == "steady"
    assert keys_of(planar) <= keys_of(summary)
    assert {"near_percent", "elsewhere"} <= summary["contacts"].keys()
    for name in ("wires", "bodies", "pairs", "repeats"):
        assert summary["model"][name] == planar["model"][name]


def test_states_are_in_space_and_whole(finished: Path) -> None:
    layout = WireLayout.load(finished / "layout.npz")
    first, last = (Frame.load(finished / "states" / f"state_{k:06d}.npz") for k in (0, 1))
    last.require_layout(layout)
    assert np.ptp(first.node_position[:, 2]) > layout.diameter
    assert np.abs(last.node_position[:, 2] - first.node_position[:, 2]).max() > 1e-9
    assert last.strain_weft == pytest.approx(0.01)
    assert (finished / "scene.usda").exists() and (finished / "figures" / "mesh.png").exists()


def test_a_finished_run_is_not_replaced_unasked(finished: Path) -> None:
    with pytest.raises(Exception, match="holds a finished run"):
        run_scene(load_scene(CELL, QUICK), out=finished, device="cpu")
