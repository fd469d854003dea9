"""Maps of a mesh in space: each pair of strains is what a run of it gives, whatever is solved beside it."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from warpknit import measure
from warpknit.commands.cli import main
from warpknit.runner.interrupts import Interrupts
from warpknit.scene import load_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation
from warpknit.studies import sweep
from warpknit.studies.load_path import ends_of, knitted_worlds, share_done
from warpknit.studies.sweep import run_map

SCENES = Path(__file__).parents[1] / "scenes"
SMALL = [
    "model.kind=spatial", "model.nodes_per_loop=40", "solver.preset=draft", "solver.residual_tolerance=0.05", "output.frames=1",
]  # fmt: skip
SWEEP = ["sweep.strain_weft=[0.0]", "sweep.strain_warp=[0.02, 0.0]"]
STRAINS = [(0.0, 0.0), (0.0, 0.02)]
THICKNESS = 15e-6  # [m] of the wire


def make_map(out: Path, *arguments: str):
    settings = [part for setting in SMALL + SWEEP for part in ("--set", setting)]
    command = ["map", str(SCENES / "contact_map.toml"), "--out", str(out), "--quiet", *settings, *arguments]
    return CliRunner().invoke(main, command, prog_name="warpknit")


def rows(path: Path) -> list[dict[str, str]]:
    with open(path, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def worlds(strains, levels=None) -> Simulation:
    scene = load_scene(SCENES / "contact_map.toml", SMALL)
    stages = [[replace(scene.stages[0], strain_weft=x, strain_warp=y)] for x, y in strains]
    return knitted_worlds([build_model(scene)] * len(stages), stages, levels or [scene.output.levels] * len(stages))


def test_every_state_is_the_same_whatever_is_beside_it(monkeypatch):
    """To the bit: side by side on one thread and on two, and alone. The records of a run are evaluations in between."""
    found = []
    for threads in ("1", "2"):
        monkeypatch.setenv("WARPKNIT_THREADS", threads)
        found.append(dict(ends_of(worlds(STRAINS))))
        assert set(found[-1]) == {0, 1}
    for index, (weft, warp) in enumerate(STRAINS):
        ((_, alone),) = ends_of(worlds([(weft, warp)]))
        for outcome in (found[0][index], found[1][index]):
            assert outcome.steps == alone.steps
            assert np.array_equal(outcome.observables.position, alone.observables.position)
            assert measure.mesh_tension(outcome.observables) == measure.mesh_tension(alone.observables)
        load = [f"load.strain_weft={weft}", f"load.strain_warp={warp}"]
        *_, last = Simulation(build_model(load_scene(SCENES / "contact_map.toml", SMALL + load))).run()
        assert alone.steps == last.steps
        assert alone.observables.position == pytest.approx(last.observables.position, rel=0, abs=1e-6 * THICKNESS)


def test_the_share_that_is_done_counts_load_levels():
    """Of loads with 1 level and 3: 1/4 when the first one is done, which has nothing to solve."""
    both = worlds(STRAINS, [1, 3])
    assert share_done(both, [1, 3]) == 0.0 and next(ends_of(both))[0] == 0
    assert share_done(both, [1, 3]) == pytest.approx(0.25)


def test_a_map_in_space_leaves_the_files_of_a_planar_one_and_goes_on_when_interrupted(tmp_path, monkeypatch):
    """Stopped as the first pair is done, and gone on with: the same rows, to the bit, as in one go."""
    monkeypatch.setenv("WARPKNIT_THREADS", "1")
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    plain = "--set", "output.figures=false"
    done = make_map(whole)
    assert done.exit_code == 0, done.output
    summary = json.loads((whole / "map.json").read_text())
    assert summary["cells"]["steady"] == summary["cells"]["wanted"] == 2
    assert summary["model"]["kind"] == "spatial"
    assert (whole / "figures" / "contact_map.png").stat().st_size > 0
    assert len((whole / "map.csv").read_text().splitlines()) == 3

    check, run, finished = Interrupts.check, sweep.ends_of, []

    def stop(self):
        if finished:
            self.request()
        check(self)

    def noting(simulation):
        for outcome in run(simulation):
            finished.append(outcome)
            yield outcome

    monkeypatch.setattr(sweep, "ends_of", noting)
    monkeypatch.setattr(Interrupts, "check", stop)
    stopped = make_map(cut, *plain)
    monkeypatch.undo()
    monkeypatch.setenv("WARPKNIT_THREADS", "1")
    assert stopped.exit_code == 130 and "--resume" in stopped.stderr
    assert len(rows(cut / "map.csv")) == 1
    assert run_map(load_scene(cut / "scene.toml"), out=cut, resume=True).exit_code == 0
    assert (cut / "map.csv").read_bytes() == (whole / "map.csv").read_bytes()


@pytest.mark.parametrize(("setting", "said"), [("contact.body_mass=0.3", "body_mass"), ("solver.drive=ramp", "solver.drive")])
def test_what_a_map_in_space_cannot_do_is_refused(tmp_path, setting, said):
    done = make_map(tmp_path / "m", "--set", setting)
    assert done.exit_code == 2 and said in done.stderr and len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "m").exists()
