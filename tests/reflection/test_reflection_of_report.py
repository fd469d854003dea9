"""The reflection loss of a report: the values of its map in page and summary."""

import base64
import json
import re

import pytest
from click.testing import CliRunner

from warpknit.commands.cli import main
from warpknit.reflection.table import LossRow, least_tension
from warpknit.results.row import read_rows
from warpknit.scene import load_scene
from warpknit.studies import curves

SCENE = """
[wire]
diameter = "15 um"
[model]
kind = "planar"
boundary = "periodic"
[solver]
preset = "draft"
[output]
usd = false
[reflection]
frequencies = ["3 GHz"]
branch_length = "250 um"
[sweep]
strain_weft = [0.08, 0.12, 0.14]
strain_warp = [0.12]
"""


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """The directory of a report."""
    out = tmp_path_factory.mktemp("report")
    (out / "cell.toml").write_text(SCENE, encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(curves, "POINTS", 2)
        done = CliRunner().invoke(main, ["report", str(out / "cell.toml"), "--out", str(out / "report"), "--quiet"])
    assert done.exit_code == 0, done.output
    return out / "report"


@pytest.fixture(scope="module")
def states(report):
    """Rows of the state of least tension, by their state of the contacts."""
    rows = read_rows(report / "reflection.csv", LossRow)
    least = least_tension(
        [row for row in rows if row.contacts == "computed"], load_scene(report / "scene.toml").wire.yield_stress
    )
    return {row.contacts: row for row in rows if row.record == least.record}


def test_the_page_has_the_losses_of_the_map(report, states):
    """Rows of the table: the loss and the least tension; the losses open and closed; the loss at the least tension."""
    page = (report / "report.html").read_text(encoding="utf-8")
    section = page.partition("<h2>Reflection loss</h2>")[2].partition("<h2>")[0]
    rows = [[float(number) for number in re.findall(r"\d[\d.]*", line)] for line in re.findall("<td>(.*?)</td>", section)]
    computed, opened, closed = (
        [states[name][f"loss_{side}_dB"] for side in ("te", "tm")] for name in ("computed", "open", "closed")
    )
    given = states["computed"]
    tensions = [1e3 * given.tension_weft_N_per_m, 1e3 * given.tension_warp_N_per_m]
    for row, expected in zip(rows, ([*computed, *tensions], opened, closed, [given.loss]), strict=True):
        assert row[: len(expected)] == pytest.approx(expected, rel=5e-3, abs=5e-4)
    assert base64.b64encode((report / "figures" / "reflection_map_3_GHz.png").read_bytes()).decode() in section


def test_the_summary_keeps_them(report, states):
    summary, given = json.loads((report / "map.json").read_text()), states["computed"]
    (loss,), (least,) = summary["reflection"], summary["answers"]["reflection"]
    assert summary["report"]["wall_s"] > 0.0
    assert (loss["loss_te_dB"], loss["loss_open_tm_dB"]) == (given.loss_te_dB, states["open"].loss_tm_dB)
    assert tuple(least.values()) == (3e9, *given.tension, given.loss)
