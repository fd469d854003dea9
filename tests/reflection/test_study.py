"""The command: the states of a run and of a map, files, the table, and what is refused in one line."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from reference.in_words import key_of, options, quantities
from warpknit.commands.cli import main
from warpknit.reflection.table import COLUMNS, OF_STATE, LossRow, least_tension, loss_row
from warpknit.reflection.waves import Angles, Scattering
from warpknit.results.row import Row, read_rows

SCENE = """
[wire]
diameter = "15 um"
[model]
kind = "planar"
boundary = "periodic"
[load]
strain_weft = 0.12
strain_warp = 0.12
[solver]
preset = "draft"
[output]
frames = 2
usd = false
[reflection]
frequencies = ["1 GHz", "3 GHz"]
branch_length = "400 um"
"""
SWEEP = "[sweep]\nstrain_weft = [0.08, 0.12]\nstrain_warp = [0.12]\n"


def invoke(*arguments):
    return CliRunner().invoke(main, [str(one) for one in arguments])


def refusal(*arguments):
    """The one line of a command that was refused."""
    done = invoke(*arguments)
    assert done.exit_code == 2, done.output
    (line,) = done.stderr.splitlines()[-1:]
    assert line.startswith("warpknit: ")
    return line


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    path = tmp_path_factory.mktemp("reflection") / "cell.toml"
    path.write_text(SCENE, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def run(scene):
    """The directory of a run, and what was printed."""
    out = scene.parent / "run"
    done = invoke("run", scene, "--out", out)
    assert done.exit_code == 0, done.output
    return out, done.stdout


def test_a_run_reflects(run):
    out, printed = run
    assert "reflection 3 GHz" in printed and "dB warp" in printed
    rows = read_rows(out / "reflection.csv", LossRow)
    assert list(vars(rows[0])) == list(COLUMNS)
    assert len(rows) == 3 * 2 * 3  # records, frequencies, states of the contacts
    summary = json.loads((out / "summary.json").read_text())
    assert [entry["frequency_Hz"] for entry in summary["reflection"]] == [1e9, 3e9]
    assert all(entry["loss_closed_te_dB"] < entry["loss_open_tm_dB"] for entry in summary["reflection"])
    for entry in summary["answers"]["reflection"]:
        here = [row for row in rows if row.frequency_Hz == entry["frequency_Hz"] and row.contacts == "computed"]
        least = least_tension(here, summary["wire"]["yield_stress_Pa"])
        assert (entry["tension_weft_N_per_m"], entry["loss_dB"]) == (least and least.tension_weft_N_per_m, least and least.loss)
    assert summary["answers"]["contacts"]
    with np.load(out / "reflection.npz") as file:
        assert file["reflection"].shape == file["transmission"].shape == (3, 2, 3, 2, 2)
        assert file["contacts"].tolist() == ["computed", "open", "closed"]
        powers = (np.abs(file["reflection"]) ** 2 + np.abs(file["transmission"]) ** 2).sum(axis=-2)
    assert (powers <= 1.0).all()
    assert {"reflection_tension.png", "reflection_frequency.png"} <= {path.name for path in (out / "figures").iterdir()}


def test_other_frequencies_of_a_finished_run(run):
    out, _ = run
    before = (out / "reflection.csv").read_text()
    done = invoke("reflect", out, "--set", "reflection.frequencies=['1 GHz']", "--set", "reflection.contacts='open'")
    assert done.exit_code == 0, done.output
    rows = {(row.record, row.frequency_Hz): row for row in read_rows(out / "reflection.csv", LossRow)}
    assert {row.contacts for row in rows.values()} == {"open"} and {key[1] for key in rows} == {1e9}
    assert invoke("reflect", out, "--quiet").exit_code == 0
    assert (out / "reflection.csv").read_text() == before


def test_a_map_reflects(scene):
    out = scene.parent / "map"
    path = scene.with_name("map.toml")
    path.write_text(SCENE + SWEEP, encoding="utf-8")
    done = invoke("map", path, "--out", out, "--set", "reflection.frequencies=['3 GHz']")
    assert done.exit_code == 0, done.output
    assert (out / "figures" / "reflection_map_3_GHz.png").exists()
    assert [row.strain_weft for row in read_rows(out / "reflection.csv", LossRow)][::3] == pytest.approx([0.08, 0.12])
    assert len(json.loads((out / "map.json").read_text())["reflection"]) == 1


@pytest.mark.parametrize(
    ("key", "wrong"),
    [
        ("reflection.frequencies=['80 GHz']", "reflection.frequencies: 80 GHz"),
        ("reflection.frequencies=['100 kHz']", "1 MHz"),
        ("reflection.branch_length='10 um'", "write 15 um"),
        ("knit.repeats=[12, 10]", "GiB"),
        ("model.boundary='gripped'", "reflection: cannot be combined with model.boundary = 'gripped'"),
    ],
)
def test_what_is_refused(scene, key, wrong):
    assert wrong in refusal("run", scene, "--out", scene.parent / "refused", "--set", key)
    assert not (scene.parent / "refused").exists()


def test_wires_of_a_file_are_refused():
    """They may be unequal."""
    path = Path(__file__).parents[2] / "scenes" / "wires" / "plain_knit_cell.toml"
    assert key_of(refusal("plan", path, "--set", "reflection.frequencies=['10 GHz']")) == "reflection"


def test_a_plan_counts_branches(scene):
    done = invoke("plan", scene)
    (line,) = [line for line in done.stdout.splitlines() if line.startswith("reflection ")]
    assert quantities(line)[:2] == ["2", "3 GHz"]


def test_other_keys_need_a_new_run(run):
    assert key_of(refusal("reflect", run[0], "--set", "wire.ends=2")) == "--set"


def test_states_without_contacts_are_refused(run, tmp_path):
    """Those of an earlier version: all contacts would be open."""
    out = tmp_path / "run"
    shutil.copytree(run[0], out)
    for path in (out / "states").glob("*.npz"):
        with np.load(path) as file:
            arrays = {name: file[name] for name in file.files if not name.startswith("contact_")}
        np.savez(path, **arrays)
    said = refusal("reflect", out)
    assert ".npz: " in said and options(said) == {"--force"}


def test_no_results(tmp_path):
    assert f"{tmp_path}: " in refusal("reflect", tmp_path)


# --- rows


def row(tension, *losses, stress=0.0):
    reflection = np.diag([10.0 ** (-loss / 20.0) for loss in losses])
    weft, warp = tension if isinstance(tension, tuple) else (tension, tension)
    state = Row(**dict(zip(OF_STATE, (0.0, 0.0, weft, warp, stress), strict=True)))
    return loss_row(0, state, 1e10, Angles(), "computed", Scattering(reflection, np.zeros((2, 2)), np.zeros(2)))


LIMIT = 6e8  # [Pa]


def test_from_the_least_tension_on_the_loss_stays():
    """Within 0.02 dB, by the worse polarisation; a better state below a worse one, without tension or alone does not count."""
    rows = [row(-0.1, 0.01, 0.06), row(0.5, 0.01, 0.02), row(0.8, 0.2, 0.01)]
    rows += [row(1.0, 0.01, 0.065), row(2.0, 0.01, 0.05), row(3.0, 0.01, 0.06)]
    assert least_tension(rows, LIMIT) is rows[3]
    assert least_tension(rows[::-1], LIMIT) is rows[3]
    assert least_tension([*rows, row(4.0, 0.01, 0.09)], LIMIT) is None
    assert least_tension(rows[:1], LIMIT) is least_tension([], LIMIT) is None


def test_the_least_tension_is_below_the_elastic_limit():
    rows = [
        row(1.0, 0.5, 0.5),
        row(2.0, 0.06, 0.06),
        row(3.0, 0.05, 0.05),
        row(4.0, 0.9, 0.9, stress=7e8),
        row(5.0, 0.9, 0.9, stress=8e8),
    ]
    assert least_tension(rows, LIMIT) is rows[1]
    assert least_tension(rows, 6e9) is rows[3]


def test_greater_tensions_are_greater_in_weft_and_warp():
    """Of a map; tensions that two searches found count as the same within 0.1 %."""
    rows = [row((1.0, 4.0), 0.3, 0.3), row((2.0, 2.0), 0.05, 0.05), row((1.999, 4.0), 0.06, 0.06), row((4.0, 1.0), 0.3, 0.3)]
    assert least_tension(rows, LIMIT) is rows[1]
    assert least_tension([*rows, row((2.0, 1.999), 0.5, 0.5)], LIMIT) is None


def test_the_noise_is_that_of_the_heat():
    """All that is missing here is absorbed: 290 K times the share."""
    found = row(1.0, 0.1, 0.0)
    share = 1.0 - 10.0 ** (-0.01)
    assert (found.noise_te_K, found.ohmic_share_te) == pytest.approx((290.0 * share, 1.0))
    assert (found.noise_tm_K, found.ohmic_share_tm) == pytest.approx((0.0, 0.0), abs=1e-9)
