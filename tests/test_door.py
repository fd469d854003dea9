"""The public door: `load_scene`, `build_model`, `initial_state`, `Simulation` give on every scene what `warpknit run` gives."""

from pathlib import Path

import pytest

import warpknit
from warpknit.model import build_model, mechanics_of
from warpknit.runner.history import read_history, row_of
from warpknit.runner.run import run_scene

SCENES = Path(__file__).parents[1] / "scenes"
SMALL = ["output.usd=false", "output.figures=false"]
COARSE = [*SMALL, "solver.preset=draft", "model.nodes_per_loop=40", "load.strain_weft=0.02", "load.strain_warp=0.02"]


@pytest.mark.parametrize(
    ("scene", "settings"),
    [
        ("atlas_cell.toml", [*SMALL, "solver.preset=draft", "output.frames=2"]),
        ("atlas_cell.toml", [*SMALL, "solver.preset=draft", "output.frames=2", "solver.drive=ramp"]),
        ("atlas_patch.toml", [*SMALL, "solver.preset=draft", "output.frames=1", "knit.repeats=[2, 2]"]),
        ("hook_free_body.toml", [*SMALL, "output.frames=2"]),
        ("atlas_cell_spatial.toml", [*COARSE, "output.frames=1"]),
        ("atlas_cell_spatial.toml", [*COARSE, "output.frames=1", "solver.drive=ramp", "solver.loading_time='1 ms'"]),
        ("hook_spatial.toml", [*SMALL, "output.frames=1", "load.displacement='0.2 mm'"]),
    ],
    ids=lambda value: value if isinstance(value, str) else next((o for o in value if "drive" in o), ""),
)
def test_a_simulation_gives_what_run_gives(tmp_path: Path, scene: str, settings: list[str]) -> None:
    """To the bit, in all columns of history.csv that come from one state alone."""
    loaded = warpknit.load_scene(SCENES / scene, settings)
    model = warpknit.build_model(loaded)
    records = list(warpknit.Simulation(model, warpknit.initial_state(model)).run())
    ending = run_scene(loaded, out=tmp_path / "run", device="cpu")
    rows = read_history(tmp_path / "run" / "history.csv")
    assert ending.exit_code == 0 and ending.summary["model"]["kind"] == loaded.model.kind
    assert len(rows) == len(records)
    accounted = {"work_J", "slide_left_m", "slide_right_m"}  # from row to row
    for row, record in zip(rows, records, strict=True):
        found = vars(row_of(record))
        assert {k: v for k, v in vars(row).items() if k not in accounted} == {
            k: v for k, v in found.items() if k not in accounted
        }


def test_the_model_is_of_the_kind_that_the_scene_asks_for() -> None:
    for kind in ("planar", "spatial"):
        model = build_model(warpknit.load_scene(SCENES / "atlas_cell.toml", [f"model.kind={kind}", "solver.precision=double"]))
        assert type(model).__module__.split(".")[1] == kind
        assert type(mechanics_of(model, warpknit.initial_state(model))).__module__.split(".")[1] == kind
