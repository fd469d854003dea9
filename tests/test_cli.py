"""The command line: exit statuses, one line for an error, what reaches the modules behind it."""

import errno
import itertools
import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest
from click.testing import CliRunner

from reference.in_words import options, quantities
from warpknit import errors
from warpknit.commands.cli import main
from warpknit.knit.lapping import KnitError
from warpknit.results.finding import Finding, ResultTable, ResultWarning
from warpknit.results.row import Row, Values
from warpknit.runner import progress_display
from warpknit.runner.progress_display import Display, NotebookBar, StageLines, TerminalBar, progress_for
from warpknit.runner.run_directory import CommandResult
from warpknit.runner.summary import Summary

ROOT = Path(__file__).parent.parent
CELL = str(ROOT / "scenes" / "atlas_cell.toml")

END = Row(
    stage="load", pairs=24, active=16, active_percent=66.7, force_max_N=3.1e-5,
    stress_max_Pa=1.48e8, stress_interior_max_Pa=1.48e8,
    stress_max_so_far_Pa=1.48e8, yield_stress_Pa=2.0e9, yield_stress_assumed=False, yield_fraction=0.0,
    tension_weft_N_per_m=0.019, tension_warp_N_per_m=0.018, strain_weft=0.1, strain_warp=0.1, temperature_K=293.15,
)  # fmt: skip
WHY = "wire 3 is caught"
SUMMARY = Summary(
    scene=Values(name="atlas_cell", load="strain 10 %", by_tension=[False, False]),
    stop_reason="steady",
    model=Values(kind="planar", kind_reason="the default", source="knit", boundary="periodic", nodes=216),
    solver=Values(steps=12345, wall_s=3.21, compile_s=0.0),
    warnings=(ResultWarning("W04", "The wire yields."),),
    stages=(END,),
)


def invoke(*arguments):
    return CliRunner().invoke(main, list(arguments), prog_name="warpknit")


@pytest.fixture
def behind(monkeypatch):
    """Stands in for the modules that run and plan; `calls` holds what reached them, `outcome` is returned or raised."""
    stand_in = SimpleNamespace(calls=[], outcome=SimpleNamespace(exit_code=0, summary=SUMMARY, message="steady"))

    def answer(*arguments, **options):
        stand_in.calls.append((arguments, options))
        if isinstance(stand_in.outcome, BaseException):
            raise stand_in.outcome
        return stand_in.outcome

    monkeypatch.setattr("warpknit.commands.run.run_command", answer)
    monkeypatch.setattr("warpknit.commands.plan.make_plan", answer)
    module = ModuleType("warpknit.export")
    module.export_run, module.FORMATS = answer, ("usd",)
    monkeypatch.setitem(sys.modules, "warpknit.export", module)
    return stand_in


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["run"], "Missing argument 'SCENE'"),
        (["run", CELL, "--fast"], "See 'warpknit run --help'"),
        (["run", CELL, "--set"], "requires an argument"),
        (["run", CELL, "extra"], "unexpected extra argument"),
        (["walk"], "No such command 'walk'"),
        (["plan", "no/such.toml"], "no/such.toml: "),
        (["plan", str(ROOT)], f"{ROOT}: a directory; "),
        (["run", CELL, "--set", "wire.diameter=15 kg"], "wire.diameter: '15 kg'"),
        (["plan", CELL, "--set", "wire.diamter=1"], " wire.diameter\n"),
        (["run", CELL, "--preset", "fast"], "solver.preset: 'fast'"),
        (["export"], "Missing argument 'RUN_DIR'"),
        (["export", "runs/x"], "Missing option '--to'"),
        (["export", "runs/x", "--to", "pdf"], "--to: 'pdf' is unknown; give usd, vtk, csv or png"),
    ],
)
def test_bad_input_is_status_2_and_one_line(arguments, said):
    result = invoke(*arguments)
    assert result.exit_code == 2
    assert said in result.stderr
    assert result.stderr.startswith("warpknit: ")
    assert result.stderr.count("\n") == 1
    assert result.stdout == ""


@pytest.mark.parametrize("arguments", [[], ["--help"], ["run", "--help"], ["plan", "-h"], ["export", "--help"]])
def test_help_is_status_0(arguments):
    result = invoke(*arguments)
    assert result.exit_code == 0
    assert result.stdout.startswith("Usage: warpknit")


@pytest.mark.parametrize(
    ("error", "status", "said"),
    [
        (errors.ModelError("no clasp"), 2, f"{CELL}: no clasp"),
        (errors.MemoryNeeded("needs 8 GiB"), 2, f"{CELL}: needs 8 GiB"),
        (errors.DeviceError("no cuda:7"), 2, "no cuda:7"),
        (errors.RunDirectoryError("a finished run"), 2, "a finished run"),
        (
            KnitError("knit.bars[0].chain", "no link", "write one"),
            2,
            f"{CELL}: knit.bars[0].chain: no link; write one",
        ),
        (PermissionError(errno.EACCES, "Permission denied", "/root/x"), 2, "/root/x: permission denied; "),
        (errors.Diverged("wire 3, node 7"), 3, "wire 3, node 7"),
        (errors.OutOfResources("8 GiB of 4"), 4, "8 GiB of 4"),
        (MemoryError("8 GiB"), 4, "memory ran out: 8 GiB"),
        (RuntimeError("Failed to allocate 8 bytes on device 'cpu'"), 4, "memory ran out"),
        (OSError(errno.ENOSPC, "No space left on device", "summary.json"), 4, "disk ran out: summary.json"),
        (KeyboardInterrupt(), 130, "interrupted"),
        (KeyboardInterrupt("interrupted; the map is kept"), 130, "interrupted; the map is kept"),
    ],
)
def test_every_way_to_end_has_its_status_and_one_line(behind, error, status, said):
    behind.outcome = error
    result = invoke("run", CELL, "--quiet")
    assert result.exit_code == status
    assert said in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1


INTERRUPTED_EXIT = """
import os, signal
class Last:
    def __del__(self, kill=os.kill, own=os.getpid(), number=signal.SIGINT):
        kill(own, number)
last = Last()
from warpknit.commands.cli import main
main()
"""


@pytest.mark.parametrize(("arguments", "status"), [(["--version"], 0), (["walk"], 2)])
def test_ctrl_c_while_python_exits_does_not_change_the_status(arguments, status):
    """Modules are cleared when Python no longer handles signals."""
    done = subprocess.run([sys.executable, "-c", INTERRUPTED_EXIT, *arguments], check=False, capture_output=True, timeout=60)
    assert done.returncode == status


def test_a_fault_of_the_program_is_not_hidden(behind):
    behind.outcome = ZeroDivisionError()
    result = invoke("run", CELL)
    assert result.exit_code == 1
    assert isinstance(result.exception, ZeroDivisionError)


@pytest.mark.parametrize("status", [3, 4])
def test_a_run_that_ends_early_gives_its_status_and_message(behind, status):
    behind.outcome = SimpleNamespace(exit_code=status, summary=replace(SUMMARY, stages=()), message=WHY)
    result = invoke("run", CELL, "--quiet")
    assert result.exit_code == status
    assert result.stderr == f"warpknit: {WHY}\n"
    assert result.stdout == ""


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ([], {"--resume"}),
        (["--out", "a b/"], {"--resume"}),
        (["--resume"], set()),
        (["--force"], {"--resume", "--force"}),
    ],
)
def test_an_interrupted_run_names_the_options_that_were_not_given(behind, given, said):
    """The same command has the same directory, whether it names one or not; --force beside --resume is refused."""
    behind.outcome = CommandResult(130, SUMMARY, "interrupted")
    line = invoke("run", CELL, "--quiet", *given).stderr
    assert line.startswith("warpknit: interrupted") and line.count("\n") == 1 and options(line) == said


def test_a_run_that_diverged_prints_the_table_of_its_records(behind):
    """The table and where the results are stand on stdout; the reason stays the one line of stderr."""
    summary = replace(SUMMARY, stop_reason="diverged", stages=(END, END.changed(stage="four")))
    behind.outcome = SimpleNamespace(exit_code=3, summary=summary, message=WHY)
    result = invoke("run", CELL, "--out", "somewhere")
    assert result.exit_code == 3 and result.stderr == f"warpknit: {WHY}\n"
    assert "did not converge" in result.stdout and "four, the last of 2" in result.stdout
    assert "148 MPa" in result.stdout and "W04  " in result.stdout and "somewhere" in result.stdout


def test_a_finished_run_prints_a_short_table(behind):
    result = invoke("run", CELL, "--out", "somewhere")
    assert result.exit_code == 0
    texts = ("66.7 %  (16 of 24 pairs", "19 mN/m weft, 18 mN/m warp", "148 MPa, 7 % of yield", "12,345", "3.21 s", "converged")
    assert all(text in result.stdout for text in texts) and "somewhere" in result.stdout
    assert result.stdout.count("\n") == 7 and "W04  " in result.stdout
    every = invoke("run", CELL, "--out", "somewhere", "--verbose").stdout
    assert "10.00 % weft, 10.00 % warp" in every and "10.00 % weft" not in result.stdout


def test_a_quiet_run_prints_nothing(behind):
    assert invoke("run", CELL, "--quiet").output == ""
    assert invoke("run", CELL, "--quiet", "--verbose").exit_code == 2


def test_options_reach_the_run(behind):
    invoke("run", CELL, "--set", "load.shear=0.1", "--preset", "draft", "--device", "cpu", "--resume")
    ((scene, out), options) = behind.calls[0]
    assert scene.stages[0].shear == 0.1
    assert scene.solver.preset == "draft"
    assert isinstance(options.pop("progress"), Display)
    assert options.pop("ranks").count == 1
    assert (out, options) == (Path("runs/atlas_cell"), {"device": "cpu", "error": None, "resume": True, "force": False})


def test_plan_prints_text_or_one_json_object(behind):
    table = ResultTable((Finding("nodes", "216", short=True), Finding("pairs", "24")))
    behind.outcome = SimpleNamespace(as_dict=lambda: {"nodes": 216}, table=lambda: table)
    assert invoke("plan", CELL).stdout == "nodes  216\n"
    assert invoke("plan", CELL, "--verbose").stdout == "nodes  216\npairs  24\n"
    assert json.loads(invoke("plan", CELL, "--json").stdout) == {"nodes": 216}
    assert behind.calls[0][0][1] is None


def test_export_prints_what_it_wrote(behind):
    behind.outcome = [Path("runs/x/scene.usda")]
    result = invoke("export", "runs/x", "--to", "usd")
    assert (result.exit_code, result.stdout) == (0, "runs/x/scene.usda\n")
    assert behind.calls == [((Path("runs/x"), "usd"), {})]


def test_python_m_is_the_same_program():
    """In a process of its own: the status reaches the shell and no traceback appears."""
    command = [sys.executable, "-m", "warpknit", "plan", "missing.toml"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith("warpknit: missing.toml: ")
    assert done.stderr.count("\n") == 1


def test_help_imports_nothing_heavy():
    code = "import sys, warpknit.commands.cli; print([name for name in ('warp', 'numpy', 'pydantic') if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_progress_is_silent_when_quiet_and_lines_without_a_terminal(monkeypatch, caplog):
    assert type(progress_for(quiet=True)) is Display
    monkeypatch.setattr(sys.stderr, "isatty", lambda: False)
    with caplog.at_level("INFO", logger="warpknit.runner.progress_display"), progress_for(quiet=False) as progress:
        assert isinstance(progress, StageLines)
        progress.stage("cold", number=2, of=3)
        progress.update(done=0.5, load_factor=0.5)
    assert caplog.messages == ["cold (2 of 3)"]


def test_the_bar_goes_through_stages(capsys):
    with TerminalBar() as bar:
        bar.update(done=0.0, load_factor=0.0)
        for number in (1, 2):
            bar.stage("load", number=number, of=2)
            bar.update(done=1.5, load_factor=1.0, node_steps_per_s=3.2e8)
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize("command", ["run", "map"])
def test_resume_and_force_are_not_both_possible(command):
    result = invoke(command, CELL, "--resume", "--force")
    assert result.exit_code == 2
    assert "--resume" in result.stderr and "--force" in result.stderr


def test_a_notebook_shows_a_bar_that_goes(monkeypatch):
    """What the cell of a notebook shows is updated in one place, and empty at the end; it names a smaller mesh that is solved."""
    shown = []
    kernel = SimpleNamespace(IPKernelApp=SimpleNamespace(initialized=lambda: True))
    place = SimpleNamespace(update=shown.append)
    display = SimpleNamespace(HTML=str, display=lambda html, display_id: place)
    monkeypatch.setitem(sys.modules, "ipykernel.kernelapp", kernel)
    monkeypatch.setitem(sys.modules, "IPython", ModuleType("IPython"))
    monkeypatch.setitem(sys.modules, "IPython.display", display)
    with progress_for(quiet=False) as progress:
        assert isinstance(progress, NotebookBar)
        progress.stage("<load>", number=1, of=2)
        progress.update(done=0.25, load_factor=0.5)
        progress.update(done=0.251, load_factor=0.5)
        progress.update(done=0.251, load_factor=0.5, now="smaller mesh of 2 x 2 repeats 30 % done")
        progress.update(done=0.251, load_factor=0.5, now="smaller mesh of 2 x 2 repeats 30 % done")
        progress.update(done=0.251, load_factor=0.5)
    bar = '&lt;load&gt; (1 of 2) <progress value="{}" max="1"></progress> load 50 %, {}0 s so far'
    smaller = "smaller mesh of 2 x 2 repeats 30 % done, "
    assert shown == [bar.format("0.250", ""), bar.format("0.251", smaller), bar.format("0.251", ""), ""]


def lines_of(monkeypatch, caplog, of_updates):
    """The lines of a stage with these updates, 100 s apart: done, load factor."""
    clock = itertools.count(0.0, 100.0)
    monkeypatch.setattr(progress_display.time, "monotonic", lambda: next(clock))
    lines = StageLines()
    with caplog.at_level("INFO", logger="warpknit.runner.progress_display"):
        lines.stage("load", number=1, of=1)
        for done, load in of_updates:
            lines.update(done=done, load_factor=load)
    return caplog.messages[1:]


def test_the_time_left_is_told_when_a_tenth_is_done(monkeypatch, caplog):
    """Half in 200 s leaves 200 s; before, the time so far."""
    told = lines_of(monkeypatch, caplog, [(0.0, 0.05), (0.02, 0.05), (0.5, 0.05)])
    assert [line.rpartition(", ")[2] for line in told] == ["0 s so far", "100 s so far", "3.3 min left"]


def test_progress_never_runs_backwards(monkeypatch, caplog):
    """An increment that is halved begins anew: what was shown stays."""
    told = lines_of(monkeypatch, caplog, [(0.5, 0.5), (0.65, 0.7), (0.5, 0.6), (0.7, 0.7)])
    shown = [[int(number) for number in re.findall(r"(\d+) %", line)] for line in told]
    assert shown == [[50, 50], [65, 70], [65, 70], [70, 70]]


def test_a_search_shows_the_time_so_far_and_none_that_is_left(monkeypatch, caplog):
    """How many equilibria a tension takes is not known: neither a share of the work nor the time left."""
    told = lines_of(monkeypatch, caplog, [(None, 0.2), (None, 0.5), (None, 0.4)])
    assert [quantities(line) for line in told] == [["20 %", "0 s"], ["50 %", "100 s"], ["50 %", "3.3 min"]]
