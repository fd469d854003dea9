"""`run`, `run_map`, `load_run` and what they return: states, tables and observables of a directory as arrays."""

import csv
import json
import math
import pickle
import re
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

import warpknit
from reference.in_words import quantities
from warpknit.base.errors import DeviceError, Diverged, ExportError, InputError, MissingExtra, RunDirectoryError
from warpknit.commands import report
from warpknit.commands.cli import main
from warpknit.commands.run import percentage
from warpknit.results.frame import Frame
from warpknit.results.row import Row, read_rows
from warpknit.results.run import Run, Series, States
from warpknit.results.table import Table
from warpknit.runner.history import probe_value
from warpknit.runner.monitor import Monitor
from warpknit.runner.run_directory import CommandResult
from warpknit.scene import Scene
from warpknit.studies.findings import DEFAULT_SWEEP

CELL = Path(__file__).parents[1] / "scenes" / "atlas_cell.toml"
SMALL = {"output.usd": False, "output.frames": 3, "load.strain_weft": 0.02, "load.strain_warp": 0.02}


def cell(**more: object) -> Scene:
    return warpknit.load_scene(CELL, SMALL | more, preset="draft")


def height(record: object) -> np.floating:
    return np.ptp(record.observables.node_position[:, 2])


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Run:
    out = tmp_path_factory.mktemp("results") / "cell"
    return warpknit.run(cell(), str(out), device="cpu", probes={"height_m": height}, quiet=True)


def test_what_run_returns_is_what_load_run_reads(finished: Run) -> None:
    again = warpknit.load_run(str(finished.directory))
    assert again.summary == finished.summary == json.loads((finished.directory / "summary.json").read_text())
    assert again.scene == cell() and (again.name, again.stop_reason) == ("atlas_cell", "steady")


def test_the_history_has_the_columns_of_the_file(finished: Run) -> None:
    rows = read_rows(finished.directory / "history.csv", Row)
    assert list(finished.history) == list(vars(rows[0])) and finished.history.rows == len(rows) == 4
    for name, column in finished.history.items():
        assert column.tolist() == [vars(row)[name] for row in rows]


def test_states_and_observables_are_arrays_over_the_records(finished: Run) -> None:
    nodes, pairs = finished.layout.node_count, 2 * finished.layout.body_count
    assert len(finished.states) == 4 and all(isinstance(state, Frame) for state in finished.states)
    assert finished.states[-1].index == 3 and [state.index for state in finished.states[1:3]] == [1, 2]
    assert finished.observables["node_position"].shape == (4, nodes, 3)
    assert finished.observables["pair_force"].shape == finished.observables["pair_active"].shape == (4, pairs)
    active = finished.observables["pair_active"].sum(axis=1)
    np.testing.assert_array_equal(active, finished.observables["active_pairs"])
    assert set(finished.observables) > set(finished.history)
    assert len(list(finished.observables)) == len(finished.observables)


def test_an_unknown_name_is_told_the_nearest(finished: Run) -> None:
    for items in (finished.history, finished.observables):
        with pytest.raises(KeyError, match="tension_weft_N_per_m"):
            _ = items["tension_weft"]
    with pytest.raises(KeyError, match="history"):
        _ = finished.tables["map"]
    with pytest.raises(KeyError, match="0"):
        _ = finished.history[0]
    assert "tension_weft" not in finished.history and finished.tables.get("map") is None


def test_columns_are_read_only(finished: Run) -> None:
    """They are kept for the next time that they are asked for."""
    for column in (finished.history["stress_max_Pa"], finished.observables["stress_max_Pa"], finished.tables["history"]["stage"]):
        with pytest.raises(ValueError, match="read-only"):
            column[0] = column[1]


def test_an_export_in_another_format_names_the_argument(finished: Run) -> None:
    with pytest.raises(ExportError, match="^to: 'stl'"):
        finished.export("stl")


def test_answers_are_those_of_a_report_or_of_a_run(finished: Run, tmp_path: Path) -> None:
    assert finished.answers is not None and finished.answers == finished.summary["answers"]
    for text, answers in (('{"best": 1}', {"best": 1}), ("null", None)):
        (tmp_path / "answers.json").write_text(text)
        assert Run(tmp_path, {"answers": {}}).answers == answers


@pytest.mark.parametrize("value", [2, 2.0, np.float32(2.0), np.array(2.0), np.array([2.0]), np.int64(2)])
def test_a_probe_gives_a_number_of_any_kind(value: object) -> None:
    assert probe_value("mine", lambda record: value, SimpleNamespace(index=0)) == 2.0


def test_a_probe_is_a_column_and_a_key_of_the_summary(finished: Run) -> None:
    """The wires of the planar model keep their height."""
    column = finished.history["height_m"]
    assert column.shape == (4,) and column[0] > 0.0
    assert finished.summary["probes"] == {"height_m": column[-1]} == finished.summary["stages"][-1]["probes"]
    np.testing.assert_array_equal(column, np.ptp(finished.observables["node_position"][:, :, 2], axis=1))


@pytest.mark.parametrize(
    ("probes", "line"),
    [
        ({"steps": height}, "probes: 'steps' "),
        ({"mine": 3}, "probes: mine: 3 "),
        ({"mine": lambda record: "high"}, "probes: mine: 'high' at record 0"),
        ({"mine": lambda record: record.observables.pair_force}, " at record 0 "),
    ],
)
def test_probes_that_cannot_be_written_are_refused(tmp_path: Path, probes: dict, line: str) -> None:
    with pytest.raises(InputError) as error:
        warpknit.run(cell(), tmp_path / "r", device="cpu", probes=probes, quiet=True)
    assert line in str(error.value)


def test_a_probe_may_have_no_value(tmp_path: Path) -> None:
    """None, nan and infinity are empty cells, null in the summary, and survive a resume; no file holds a nan."""
    values = [None, math.nan, math.inf, 3.0]
    run = warpknit.run(cell(), tmp_path / "r", device="cpu", probes={"mine": lambda record: values[record.index]}, quiet=True)
    np.testing.assert_array_equal(run.history["mine"], [np.nan, np.nan, np.nan, 3.0])
    assert [row.mine for row in read_rows(tmp_path / "r" / "history.csv", Row)] == [None, None, None, 3.0]
    last = warpknit.run(cell(), tmp_path / "s", device="cpu", probes={"mine": lambda record: math.nan}, quiet=True)
    assert last.summary["probes"] == {"mine": None} and np.isnan(last.history["mine"]).all()


def test_a_finished_run_has_the_probes_that_are_asked_for(finished: Run) -> None:
    """With others it would have to run again."""
    again = warpknit.run(finished.scene, finished.directory, resume=True, quiet=True)
    assert again.summary == finished.summary
    with pytest.raises(RunDirectoryError, match="other.*force=True"):
        warpknit.run(finished.scene, finished.directory, resume=True, probes={"height_m": height, "other": height}, quiet=True)


def test_a_map_is_a_grid_over_its_strains(tmp_path: Path) -> None:
    path = tmp_path / "map.csv"
    path.write_text("strain_weft,strain_warp,active_percent,why\n0.2,0.0,1,a\n0.1,0.0,2,b\n0.1,0.5,3,c\n")
    table = Table.read(path)
    np.testing.assert_array_equal(table.grid("active_percent", "strain_warp", "strain_weft"), [[2, 1], [3, np.nan]])
    with pytest.raises(InputError, match="^grid: 'why' "):
        table.grid("why", "strain_warp", "strain_weft")
    pytest.importorskip("xarray", reason="extra `notebooks` is not installed")
    pytest.importorskip("pandas", reason="extra `notebooks` is not installed")
    cells = table.to_xarray("strain_warp", "strain_weft")
    assert cells.active_percent.dims == ("strain_warp", "strain_weft") and cells.why.sel(strain_weft=0.1, strain_warp=0.5) == "c"
    assert cells.active_percent.attrs["units"] == "%"
    assert table.to_xarray().sizes == {"row": 3}


@pytest.mark.parametrize(("package", "method"), [("pandas", "to_pandas"), ("xarray", "to_xarray")])
def test_a_package_that_is_missing_is_named_with_its_extra(package: str, method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """An ImportError still, for those who catch that."""
    monkeypatch.setitem(sys.modules, package, None)
    line = f'{method}() needs the package {package} (extra "notebooks"); install it: pip install -e ".[notebooks]"'
    table = Table({"strain_weft": np.zeros(1)})
    for source in [table] if method == "to_pandas" else [table, Series(table, States(None))]:
        with pytest.raises(MissingExtra, match=f"^{re.escape(line)}$") as raised:
            getattr(source, method)()
        assert isinstance(raised.value, ImportError) and isinstance(raised.value, InputError)


def test_a_run_is_shown_short_and_as_a_page(finished: Run) -> None:
    assert repr(finished) == f"<Run 'atlas_cell': steady, 4 records, in {finished.directory}>"
    page = finished._repr_html_()
    assert "<td>tension</td>" in page and "data:image/png;base64," in page
    assert quantities(repr(finished.history))[:1] == ["4"]
    assert "<th>tension_weft_N_per_m</th>" in finished.history._repr_html_()
    for item in (finished.states[0], finished.layout, finished.observables, finished.tables, finished.states):
        assert "\n" not in repr(item) and len(repr(item)) < 400


def test_a_run_survives_another_process(finished: Run) -> None:
    assert pickle.loads(pickle.dumps(finished)).history["steps"].tolist() == finished.history["steps"].tolist()


def test_a_map_has_its_tables(tmp_path: Path) -> None:
    sweep = {"sweep.strain_weft": [0.0, 0.02], "sweep.strain_warp": [0.0, 0.02]}
    run = warpknit.run_map(cell(**sweep), str(tmp_path / "map"), quiet=True)
    table = run.tables["map"]
    with open(tmp_path / "map" / "map.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert table["strain_warp"].tolist() == [float(row["strain_warp"]) for row in rows]
    assert table["stop_reason"].tolist() == [row["stop_reason"] for row in rows]
    assert (len(run.states), len(run.history), run.card) == (0, 0, None)
    assert "<table" in run._repr_html_() and "map_details" in repr(run)


def test_a_table_has_numbers_truths_and_texts(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("count,length_m,steady,name,empty\n1,0.5,True,a,\n2,,False,,\n")
    table = Table.read(path)
    assert table["count"].dtype.kind == "i" and table["steady"].tolist() == [True, False]
    np.testing.assert_array_equal(table["length_m"], [0.5, np.nan])
    assert table["name"].tolist() == ["a", ""] and np.isnan(table["empty"]).all()
    path.write_text("count\n")
    assert Table.read(path).rows == 0


def test_faults_are_exceptions_that_name_arguments(finished: Run, tmp_path: Path) -> None:
    with pytest.raises(RunDirectoryError, match="out=.*force=True"):
        warpknit.run(cell(), finished.directory, quiet=True)
    again = warpknit.run(cell(), finished.directory, resume=True, quiet=True)
    assert again.summary == finished.summary
    with pytest.raises(RunDirectoryError, match="none: "):
        warpknit.load_run(tmp_path / "none")
    with pytest.raises(RunDirectoryError, match="no results"):
        warpknit.load_run(tmp_path)
    with pytest.raises(DeviceError):
        warpknit.run(cell(), tmp_path / "r", device="cuda:99", quiet=True)
    with pytest.raises(InputError, match="^fit_curve: .*fit_loop_length"):
        warpknit.make_report(CELL, tmp_path / "r", fit_curve="a.csv", fit_loop_length="5 mm", quiet=True)
    with pytest.raises(InputError, match="tension: '2 kg' "):
        warpknit.make_report(CELL, tmp_path / "r", tension="2 kg", quiet=True)
    for error, said in ((0.0, "0"), ("2 N", "'2 N'"), ("most", "'most'"), ([2], r"\[2\]"), (True, "true"), ("200 %", "'200 %'")):
        with pytest.raises(InputError, match=f"^error: {said}"):
            warpknit.run(cell(), tmp_path / "r", error=error, quiet=True)


@pytest.mark.parametrize("given", [2, 2.0, np.float32(2.0), "2", "2 %", "2%", " 2.0 % "])
def test_an_error_may_have_its_percent_sign(given: object) -> None:
    assert percentage(given) == 2.0


def damaged(finished: Run, to: Path, name: str, spoil: Callable[[bytes], bytes] | None) -> Run:
    """The run of a copy of a directory whose file `name` is spoiled, or missing."""
    path = Path(shutil.copytree(finished.directory, to)) / name
    if spoil is None:
        path.unlink()
    else:
        path.write_bytes(spoil(path.read_bytes()))
    return warpknit.load_run(to)


def all_of(run: Run) -> None:
    list(run.states)
    dict(run.observables)
    dict(run.tables)


@pytest.mark.parametrize(
    ("name", "spoil", "read", "said"),
    [
        ("history.csv", lambda data: data[:-200], lambda run: run.history, " row 4"),
        ("history.csv", lambda data: data.replace(b"\r\n1,load,", b"\r\n1,load,x"), lambda run: run.tables["history"],
         "load_factor: 'x0.3333333333333333' in row 2"),
        ("history.csv", lambda data: data[: data.index(b"\n3,load")], lambda run: run.observables, "3 rows for 4"),
        ("history.csv", lambda data: b"", lambda run: run.history, ": "),
        ("history.csv", lambda data: data + b"\xff", lambda run: run.observables, ": "),
        ("history.csv", None, lambda run: run.history, ": "),
        ("states/state_000001.npz", lambda data: data[:100], lambda run: run.states[1], "Frame"),
        ("states/state_000001.npz", lambda data: b"", lambda run: run.observables["pair_force"], "Frame"),
        ("states/state_000001.npz", None, lambda run: run.states[0], ": "),
        ("states/state_000003.npz", None, lambda run: run.states[-1], ": "),
        ("layout.npz", lambda data: data[1:], lambda run: run.layout, "WireLayout"),
    ],
)  # fmt: skip
def test_a_damaged_file_is_named_in_one_line(
    finished: Run, tmp_path: Path, name: str, spoil: Callable | None, read: Callable, said: str
) -> None:
    run = damaged(finished, tmp_path / "run", name, spoil)
    assert repr(run).startswith("<Run 'atlas_cell'")
    for reads in (read, all_of):
        with pytest.raises(RunDirectoryError) as error:
            reads(run)
        assert str(error.value).startswith(f"{tmp_path / 'run' / name}: ") and said in str(error.value)
        assert "\n" not in str(error.value)


def test_a_state_that_is_not_there_is_told_the_range(finished: Run) -> None:
    for which in (4, -5):
        with pytest.raises(IndexError, match=f"^states: {which}"):
            _ = finished.states[which]
    with pytest.raises(IndexError, match="^states: 0 .* 0 "):
        _ = States(None)[0]


@pytest.mark.parametrize("given", [None, 3, b"runs/cell", ""])
def test_a_directory_is_a_path(given: object) -> None:
    with pytest.raises(RunDirectoryError, match=r"^load_run: .*"):
        warpknit.load_run(given)
    if given is not None:  # the default
        with pytest.raises(RunDirectoryError, match=r"^out: .*"):
            warpknit.run(cell(), given, quiet=True)


def test_arrays_for_xarray_have_coordinates_and_units(finished: Run) -> None:
    pytest.importorskip("xarray", reason="extra `notebooks` is not installed")
    data = finished.observables.to_xarray()
    assert (
        data.sizes["record"] == 4 and data.record.values.tolist() == [0, 1, 2, 3] and data.axis.values.tolist() == ["x", "y", "z"]
    )
    assert set(data.coords) == {"record", "axis", "stage", "load_factor"}
    np.testing.assert_array_equal(data.node_position.sel(axis="z", record=3), finished.states[3].node_position[:, 2])
    table = finished.history.to_xarray()
    expected = {
        "tension_weft_N_per_m": "N/m", "stress_max_Pa": "Pa", "temperature_K": "K", "active_percent": "%", "force_A_N": "N",
        "energy_bend_J": "J", "stress_max_x_m": "m", "height_m": "m", "strain_weft": None, "steps": None, "stage": None,
    }  # fmt: skip
    for name, unit in expected.items():
        assert data[name].attrs.get("units") == table[name].attrs.get("units") == unit
    assert data.node_stress.attrs["units"] == "Pa" and table.row.values.tolist() == [0, 1, 2, 3]
    with pytest.raises(KeyError, match="tension_weft_N_per_m"):
        finished.history.to_xarray("tension_weft")
    assert set(finished.observables.to_xarray(["tension_weft_N_per_m"]).data_vars) == {"tension_weft_N_per_m"}


def test_a_run_that_diverges_raises_and_keeps_what_it_found(tmp_path: Path) -> None:
    with pytest.raises(Diverged, match="200 steps"):
        warpknit.run(cell(**{"solver.max_steps": 200}), tmp_path / "r", device="cpu", quiet=True)
    assert warpknit.load_run(tmp_path / "r").stop_reason == "diverged"


def test_an_interrupted_run_raises_and_goes_on_with_the_same_probes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    original, checks = Monitor._check, iter(range(10**6))

    def interrupt_once(self: Monitor, progress: object) -> None:
        if next(checks) == 12:
            self.interrupts.request()
        original(self, progress)

    probes, scene = {"height_m": height}, cell(**{"output.frames": 8})
    whole = warpknit.run(scene, tmp_path / "whole", device="cpu", probes=probes, quiet=True)
    monkeypatch.setattr(Monitor, "_check", interrupt_once)
    with pytest.raises(KeyboardInterrupt, match="^interrupted.* resume=True$"):
        warpknit.run(scene, tmp_path / "parts", device="cpu", probes=probes, quiet=True)
    assert 0 < warpknit.load_run(tmp_path / "parts").history.rows < whole.history.rows
    with pytest.raises(RunDirectoryError, match="height_m"):
        warpknit.run(scene, tmp_path / "parts", device="cpu", resume=True, quiet=True)
    parts = warpknit.run(scene, tmp_path / "parts", device="cpu", probes=probes, resume=True, quiet=True)
    for name, column in whole.history.items():
        np.testing.assert_array_equal(parts.history[name], column)


@pytest.mark.parametrize(("force", "said"), [(False, ""), (True, " without force=True")])
def test_an_interrupted_report_says_how_the_call_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, force: bool, said: str
) -> None:
    """A report continues its map of itself, unless it replaces it; what the command line says has its own options."""

    def stop(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    finished = CommandResult(0, {"stop_reason": "finished"})
    sweeps: list[object] = []
    monkeypatch.setattr(report, "sweep_scene", lambda scene, **_: sweeps.append(scene.sweep) or finished)
    monkeypatch.setattr(report, "read_map", lambda *_: [])
    monkeypatch.setattr(report, "write_report", stop)
    kept = f"interrupted; the map is kept in {tmp_path / 'r'}; continue with the same"
    with pytest.raises(KeyboardInterrupt, match=f"^{re.escape(kept)} call{said}$"):
        warpknit.make_report(cell(), tmp_path / "r", force=force, quiet=True)
    options = ["--out", str(tmp_path / "r"), "--quiet", *(["--force"] if force else [])]
    done = CliRunner().invoke(main, ["report", str(CELL), *options])
    assert sweeps == 2 * [DEFAULT_SWEEP], "a scene without [sweep] has that of a report, on both ways"
    assert done.exit_code == 130 and done.stderr == f"warpknit: {kept} command{said.replace('force=True', '--force')}\n"
