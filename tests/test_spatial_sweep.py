"""Maps of a mesh in space: each pair of strains is what a run of it gives, whichever process brings it to rest."""

import csv
import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from warpknit import measure
from warpknit.base.processes import start_process
from warpknit.commands.cli import main
from warpknit.errors import OutOfResources
from warpknit.runner.interrupts import Interrupts
from warpknit.scene import load_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation
from warpknit.studies import state_processes
from warpknit.studies.state_processes import StateProcesses
from warpknit.studies.sweep import run_map

SCENES = Path(__file__).parents[1] / "scenes"
SMALL = [
    "model.kind=spatial", "model.nodes_per_loop=40", "solver.preset=draft", "solver.residual_tolerance=0.05", "output.frames=1",
]  # fmt: skip
SWEEP = ["sweep.strain_weft=[0.0]", "sweep.strain_warp=[0.02, 0.0]"]
STRAINS = [(0.0, 0.0), (0.0, 0.02)]


def make_map(out: Path, *arguments: str):
    settings = [part for setting in SMALL + SWEEP for part in ("--set", setting)]
    command = ["map", str(SCENES / "contact_map.toml"), "--out", str(out), "--quiet", *settings, *arguments]
    return CliRunner().invoke(main, command, prog_name="warpknit")


def rows(path: Path) -> list[dict[str, str]]:
    with open(path, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def states(processes: int, **more):
    scene = load_scene(SCENES / "contact_map.toml", SMALL)
    stages = [replace(scene.stages[0], strain_weft=x, strain_warp=y) for x, y in STRAINS]
    return StateProcesses(build_model(scene), stages, processes=processes, **more)


def test_every_state_is_that_of_a_run_whichever_process_has_it():
    """To the bit: here, in two processes, and as Simulation takes the load alone."""
    here, there = ({outcome.index: outcome for outcome in states(processes).run()} for processes in (1, 2))
    assert set(here) == set(there) == {0, 1}
    for index, (weft, warp) in enumerate(STRAINS):
        load = [f"load.strain_weft={weft}", f"load.strain_warp={warp}"]
        relaxation = Simulation(build_model(load_scene(SCENES / "contact_map.toml", SMALL + load)))
        relaxation.compile()
        *_, last = relaxation.run()
        for outcome in (here[index], there[index]):
            assert outcome.observables is not None and outcome.steps == last.steps
            assert np.array_equal(outcome.observables.position, last.observables.position)
            assert measure.mesh_tension(outcome.observables) == measure.mesh_tension(last.observables)


def test_the_share_that_is_done_counts_load_levels():
    """Of loads with 3 levels and 1, the last one first: 1/4 when it is done."""
    both = states(1, levels=[3, 1])
    both._loads.reverse()
    assert both.done == 0.0 and next(both.run()).index == 1 and both.done == pytest.approx(0.25)


def test_a_map_in_space_leaves_the_files_of_a_planar_one_and_goes_on_when_interrupted(tmp_path, monkeypatch):
    """Stopped as the first pair is done, and gone on with: the same rows, to the bit, as in one go."""
    monkeypatch.setenv("WARPKNIT_THREADS", "1")
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    plain = "--set", "output.figures=false"
    done = make_map(whole)
    assert done.exit_code == 0 and "2 of 2 converged" in done.stdout, done.output
    assert json.loads((whole / "map.json").read_text())["model"]["kind"] == "spatial"
    assert (whole / "figures" / "contact_map.png").stat().st_size > 0
    assert len((whole / "map.csv").read_text().splitlines()) == 3

    check, run, finished = Interrupts.check, StateProcesses.run, []

    def stop(self):
        if finished:
            self.request()
        check(self)

    def noting(self):
        for outcome in run(self):
            finished.append(outcome)
            yield outcome

    monkeypatch.setattr(StateProcesses, "run", noting)
    monkeypatch.setattr(Interrupts, "check", stop)
    stopped = make_map(cut, *plain)
    monkeypatch.undo()
    monkeypatch.setenv("WARPKNIT_THREADS", "1")
    assert stopped.exit_code == 130 and "--resume" in stopped.stderr
    assert len(rows(cut / "map.csv")) == 1
    assert run_map(load_scene(cut / "scene.toml"), out=cut, resume=True).exit_code == 0
    assert (cut / "map.csv").read_bytes() == (whole / "map.csv").read_bytes()


def test_a_process_that_is_gone_is_said(monkeypatch):
    """As where memory ran out and the system ended it: exit status 4, and nothing waits for it."""
    started = []

    def starting(module, *descriptors, **more):
        found = start_process(module, *descriptors, **more)
        started.append(found[0])
        return found

    monkeypatch.setattr(state_processes, "start_process", starting)

    def end(_states):
        os.kill(started[0].pid, 9)

    with pytest.raises(OutOfResources, match="ended by signal 9"):
        list(states(2, watch=end).run())
    assert all(process.returncode is not None for process in started)


@pytest.mark.parametrize(("setting", "said"), [("wire.plastic=true", "wire.plastic"), ("solver.drive=ramp", "solver.drive")])
def test_what_a_map_in_space_cannot_do_is_refused(tmp_path, setting, said):
    done = make_map(tmp_path / "m", "--set", setting)
    assert done.exit_code == 2 and said in done.stderr and len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "m").exists()
