"""Maps as a user makes them: what is left, refusals, interrupts, resumption."""

import csv
import json
import math
from pathlib import Path

import pytest
from click.testing import CliRunner

from reference.cases import slow
from reference.in_words import options, quantities
from warpknit.commands.cli import main
from warpknit.runner.interrupts import Interrupted, Interrupts
from warpknit.scene import load_scene
from warpknit.studies import contact_map, sweep
from warpknit.studies.sweep import run_map

SCENES = Path(__file__).parents[1] / "scenes"
SMALL = ["solver.preset=draft", "output.frames=2", "sweep.strain_weft=[0.0, 0.1]", "sweep.strain_warp=[0.1, 0.0]"]


def make_map(out: Path, *arguments: str, scene: str = "contact_map.toml"):
    settings = [part for setting in SMALL for part in ("--set", setting)]
    command = ["map", str(SCENES / scene), "--out", str(out), *settings, *arguments]
    return CliRunner().invoke(main, command, prog_name="warpknit")


def rows(path: Path) -> list[dict[str, str]]:
    with open(path, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def whole_map(tmp_path_factory):
    """A map made in one go, and what the program said."""
    out = tmp_path_factory.mktemp("map") / "m"
    done = make_map(out)
    assert done.exit_code == 0, done.output
    return out, done


def test_a_map_leaves_its_files_and_is_not_overwritten(whole_map):
    """map.csv has a row for each pair of strains; a finished map is refused, kept by --resume, replaced by --force."""
    out, done = whole_map
    assert "optimum at strain" in done.stdout and {"4"} <= set(quantities(done.stdout))
    assert [(r["strain_weft"], r["strain_warp"]) for r in rows(out / "map.csv")] == [
        ("0.0", "0.0"), ("0.1", "0.0"), ("0.0", "0.1"), ("0.1", "0.1")
    ]  # fmt: skip
    assert all(r["stop_reason"] == "steady" for r in rows(out / "map.csv"))
    for name in ("contact_map", "stress_map", "yield_map", "tension_weft_map", "tension_warp_map"):
        assert (out / "figures" / f"{name}.png").stat().st_size > 0
    summary = json.loads((out / "map.json").read_text())
    assert summary["stop_reason"] == "finished" and summary["optimum"]["active_percent"] > 0
    before = (out / "map.csv").read_bytes()
    refused = make_map(out)
    assert refused.exit_code == 2 and options(refused.stderr) == {"--out", "--force"}
    assert make_map(out, "--resume").exit_code == 0
    assert make_map(out, "--force").exit_code == 0
    assert (out / "map.csv").read_bytes() == before


def test_a_scene_without_a_sweep_is_refused(tmp_path):
    done = CliRunner().invoke(main, ["map", str(SCENES / "atlas_cell.toml"), "--out", str(tmp_path / "m")])
    assert done.exit_code == 2 and not (tmp_path / "m").exists()
    assert len(done.stderr.splitlines()) == 1 and ": sweep: " in done.stderr


def test_what_a_map_cannot_do_is_refused(tmp_path):
    """A ramp has no steady levels."""
    done = make_map(tmp_path / "m", "--set", "solver.drive=ramp")
    assert done.exit_code == 2 and "solver.drive" in done.stderr and len(done.stderr.splitlines()) == 1


def test_an_interrupted_map_keeps_its_cells_and_goes_on_to_the_same_map(whole_map, tmp_path, monkeypatch):
    whole, cut = whole_map[0], tmp_path / "cut"

    def stop(self):
        if finished:
            self.request()
        check(self)

    check, finished = Interrupts.check, []
    map_row = contact_map.map_row
    monkeypatch.setattr(contact_map, "map_row", lambda pair, *end, **more: finished.append(pair) or map_row(pair, *end, **more))
    monkeypatch.setattr(Interrupts, "check", stop)
    stopped = make_map(cut)
    monkeypatch.undo()
    assert stopped.exit_code == 130 and options(stopped.stderr) == {"--resume"}
    assert 0 < len(rows(cut / "map.csv")) < 4
    warnings = json.loads((cut / "map.json").read_text())["warnings"]
    assert any(warning.startswith(f"W42 The map is incomplete: {len(rows(cut / 'map.csv'))} of 4 pairs") for warning in warnings)
    assert not any("W42" in warning for warning in json.loads((whole / "map.json").read_text())["warnings"])
    assert make_map(cut).exit_code == 2
    assert make_map(cut, "--resume").exit_code == 0
    assert (cut / "map.csv").read_bytes() == (whole / "map.csv").read_bytes()


def test_cells_that_do_not_come_to_rest_are_blank(tmp_path):
    """With 600 steps a level the unloaded cell comes to rest and the stretched ones do not."""
    done = make_map(tmp_path / "m", "--set", "solver.max_steps=600")
    assert done.exit_code == 0, done.output
    found = {(r["strain_weft"], r["strain_warp"]): r for r in rows(tmp_path / "m" / "map.csv")}
    failed = found["0.1", "0.1"]
    assert failed["stop_reason"] == "diverged" and failed["active_percent"] == failed["stress_max_Pa"] == ""
    assert found["0.0", "0.0"]["stop_reason"] == "steady"
    for name in ("map.csv", "map_details.csv", "map.json"):
        assert "nan" not in (tmp_path / "m" / name).read_text().lower()


def several(count: int, standard_error: float) -> list[str]:
    values = {"scatter": 0.08, "count": count, "standard_error": standard_error}
    return [word for name, value in values.items() for word in ("--set", f"variants.{name}={value}")]


def test_pairs_of_a_map_have_as_many_meshes_as_their_means_need(tmp_path):
    """Half of them where these are enough; the error of each tension is measured by a tenth of the largest at least."""
    out = tmp_path / "m"
    assert make_map(out, *several(8, 0.1)).exit_code == 0
    found = [row | more for row, more in zip(rows(out / "map.csv"), rows(out / "map_details.csv"), strict=True)]
    sides = ("weft", "warp")
    largest = max(abs(float(row[f"tension_{side}_N_per_m"])) for row in found for side in sides)
    counts = set()
    for row in found:
        count = int(row["variants"])
        scale = max(0.1 * largest, *(abs(float(row[f"tension_{side}_N_per_m"])) for side in sides))
        deviations = [float(row[f"std_tension_{side}_N_per_m"]) / scale for side in sides]
        deviations += [float(row["std_active_percent"]) / 100.0]
        assert count in (4, 8)
        assert count == 8 or max(deviations) / math.sqrt(count) <= 0.4 * 0.1
        counts.add(count)
    assert len(counts) > 1


@pytest.mark.parametrize("stop", [*slow(3), 5])
def test_a_map_of_several_meshes_goes_on_after_an_interrupt_as_if_it_had_not_been(stop, tmp_path, monkeypatch):
    """In space they run side by side, and those of a pair come to rest in any order, here the third or fifth of 8."""
    scene = load_scene({
        "wire": {"material": "molybdenum", "diameter": "30 um"},
        "knit": {"bars": [{"chain": "1-0/1-2"}, {"chain": "1-2/1-0"}], "wales": "26 /inch", "courses": "30 /inch"},
        "model": {"boundary": "periodic"},
        "contact": {"friction": 0.0},
        "solver": {"preset": "draft"},
        "output": {"frames": 2, "figures": False},
        "sweep": {"strain_weft": [0.02, 0.04], "strain_warp": [0.02]},
        "variants": {"count": 4, "standard_error": 0.1},
    })  # fmt: skip
    run, found = sweep.ends_of, []

    def interrupted(own):
        for outcome in run(own):
            found.append(outcome)
            yield outcome
            if len(found) == stop:
                raise Interrupted

    monkeypatch.setattr(sweep, "ends_of", interrupted)
    assert run_map(scene, out=tmp_path / "cut").exit_code == 130
    monkeypatch.undo()
    assert run_map(scene, out=tmp_path / "cut", resume=True).exit_code == 0
    assert run_map(scene, out=tmp_path / "whole").exit_code == 0
    written = [path.relative_to(tmp_path / "whole") for path in (tmp_path / "whole").rglob("*.csv")]
    assert len(written) > 8
    assert all((tmp_path / "cut" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes() for name in written)


def test_seeds_scatter_and_the_map_is_their_mean(tmp_path):
    """Two meshes of scattered loops: their maps differ, and map.csv holds the mean."""
    out = tmp_path / "m"
    assert make_map(out, *several(2, 0.0)).exit_code == 0
    first, second = (rows(out / "variants" / f"map_{seed:02d}.csv")[-1] for seed in (0, 1))
    mean = rows(out / "map.csv")[-1]
    tensions = [float(r["tension_weft_N_per_m"]) for r in (first, second, mean)]
    assert tensions[0] != tensions[1]
    assert tensions[2] == pytest.approx(0.5 * (tensions[0] + tensions[1]), rel=1e-12)
    assert (out / "figures" / "contact_spread_map.png").exists()
