"""A report of several meshes has means: of the path under equal tensions, of curves, and on the page."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from reference.in_words import quantities
from warpknit.base.errors import Diverged
from warpknit.commands.cli import main
from warpknit.runner.history import row_of
from warpknit.runner.other_model import FIGURES
from warpknit.scene import Scene, load_scene
from warpknit.studies import curves
from warpknit.studies.curves import tension_strain
from warpknit.studies.equal_tension import load_equally, service_points
from warpknit.studies.load_path import LoadPath, Meshes, meshes_of, under_tension
from warpknit.studies.report import read_states, write_states

TABLES: dict = {
    "wire": {"material": "molybdenum", "diameter": "30 um"},
    "knit": {"bars": [{"chain": "1-0/1-2"}, {"chain": "1-2/1-0"}], "wales": "26 /inch", "courses": "30 /inch"},
    "model": {"kind": "spatial", "boundary": "periodic"},
    "contact": {"friction": 0.2},
    "load": {"tension_weft": "2 N/m", "tension_warp": "2 N/m"},
    "solver": {"preset": "draft"},
    "output": {"frames": 2},
    "variants": {"count": 2, "standard_error": 0.0},
}


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene(TABLES)


@pytest.fixture(scope="module")
def meshes(scene: Scene) -> Meshes:
    """Two meshes, and both with half and twice the friction."""
    return meshes_of(scene)


def test_rows_of_meshes_are_the_means_of_their_paths_to_the_bit(scene, meshes):
    """With another friction they change by the mean of the changes of the same meshes."""
    frictions = [mesh.scene.contact.friction for mesh in meshes.models.values()]
    base = frictions[:2]
    assert frictions[2:] == pytest.approx([0.5 * base[0], 0.5 * base[1], 2.0 * base[0], 2.0 * base[1]])
    means, ways = LoadPath(meshes), [LoadPath(mesh) for mesh in meshes.models.values()]
    for tension in (1.0, 2.0):  # the second load step begins where the first one ends
        stage = under_tension(scene, tension)
        rows = list(means.rows(stage, 2))
        single = [list(way.rows(stage, 2)) for way in ways]
        assert len(rows) == len(single[0])
        for row, *of_meshes in zip(rows, *single, strict=True):
            for name in FIGURES:
                values, *others = np.reshape([one[name] for one in of_meshes], (3, 2)).tolist()
                for friction, of_friction in zip(("friction_half", "friction_double"), others, strict=True):
                    assert row[f"{friction}_{name}"] == pytest.approx(np.mean(of_friction), rel=1e-9, abs=1e-12)
                assert row[name] == pytest.approx(np.mean(values), rel=1e-12, abs=1e-15)
                assert (row[f"p10_{name}"], row[f"p90_{name}"]) == pytest.approx((min(values), max(values)), rel=1e-12)


def test_a_mesh_that_fails_is_left_out_from_there_on(scene, meshes, monkeypatch):
    """Also of the change with friction, which is over the meshes with both."""
    from warpknit.solve.relax import Relaxation

    reach = Relaxation.reach

    def fail(self, *args, **options):
        if self.row == 1 and started:
            raise Diverged("no progress")
        yield from reach(self, *args, **options)

    monkeypatch.setattr(Relaxation, "reach", fail)
    three = Meshes(meshes.models | {6: meshes.models[0]}, meshes.again)
    means, started = LoadPath(three), []
    list(means.rows(under_tension(scene, 1.0), 1))
    assert list(means.states) == [0, 1, 2, 3, 4, 5, 6]
    started.append(True)
    *_, records = means.load(under_tension(scene, 2.0), 1)
    row = three.mean_of(records)
    assert list(means.states) == [0, 2, 3, 4, 5, 6] and row.meshes == 2
    assert row.p10_strain_weft == row.p90_strain_weft  # two meshes of the same loops
    assert row.friction_half_strain_weft == pytest.approx(row_of(records[2]).strain_weft, rel=1e-12)


def test_too_few_meshes_raise_after_the_levels_that_enough_of_them_reach(scene, meshes, monkeypatch):
    from warpknit.solve.relax import Relaxation

    reach = Relaxation.reach

    def fail(self, *args, **options):
        if self.row in (0, 1):
            reached[self.row] = reached.get(self.row, 0) + 1
            if reached[self.row] > 2 + self.row:  # as knitted, and one or two levels
                raise Diverged("no progress")
        yield from reach(self, *args, **options)

    reached: dict[int, int] = {}
    monkeypatch.setattr(Relaxation, "reach", fail)
    two = Meshes.of([meshes.models[0], meshes.models[1]])
    means, rows = LoadPath(two), []
    with pytest.raises(Diverged, match="no progress"):
        rows += means.rows(under_tension(scene, 1.0), 4)
    assert [row.meshes for row in rows] == [2, 2]
    assert all(state.stages == () for state in means.states.values())


def test_service_tensions_are_means_and_are_kept(scene, meshes, tmp_path):
    path = load_equally(meshes, 0.0)
    points = {point.tension: point for point in service_points(scene, path, (), None, None)}
    row = path.at[2.0]
    assert points[2.0].strains == (row.strain_weft, row.strain_warp)
    expected = [f"{1e-6 * row[f'{end}_stress_max_Pa']:.0f} MPa" for end in ("p10", "p90")]
    assert quantities(points[2.0].range_texts[2]) == expected
    above = [one.stress_max_Pa > scene.wire.yield_stress for one in path.rows]
    assert above == [False] * (len(above) - 1) + [True]
    for friction in ("friction_half", "friction_double"):
        active, stress = (row[f"{friction}_{name}"] for name in ("active_percent", "stress_max_Pa"))
        assert quantities(" ".join(points[2.0].friction_texts[friction][1:])) == [f"{active:.1f} %", f"{1e-6 * stress:.0f} MPa"]
    write_states(scene, tmp_path, [], path)
    _, kept = read_states(scene, tmp_path)
    assert (kept.rows, kept.at, kept.ended) == (path.rows, path.at, path.ended)
    onwards = under_tension(scene, 2.1)
    assert list(LoadPath(meshes, kept.states[2.0]).rows(onwards, 1)) == list(LoadPath(meshes, path.states[2.0]).rows(onwards, 1))


def test_curves_are_means_of_the_curves_of_the_meshes(scene, meshes, monkeypatch):
    monkeypatch.setattr(curves, "POINTS", 2)
    means = tension_strain(meshes, 0.05, 0.02)
    single = [tension_strain(Meshes.of(meshes.models[place]), 0.05, 0.02) for place in meshes.own]
    for point, *others in zip(means, *single, strict=True):
        for name in curves.MEASURED:
            values = [other[name] for other in others]
            assert point[name] == pytest.approx(np.mean(values), rel=1e-12, abs=1e-15)
            assert (point[f"p10_{name}"], point[f"p90_{name}"]) == pytest.approx((min(values), max(values)), rel=1e-12)


@pytest.mark.slow
def test_the_page_shows_means_and_ranges(tmp_path, monkeypatch):
    """The service table, answers.json and the card are of the same meshes."""
    monkeypatch.setattr(curves, "POINTS", 2)
    file = tmp_path / "tricot.toml"
    (knit,) = ["bars = [{chain = '1-0/1-2'}, {chain = '1-2/1-0'}]\nwales = '26 /inch'\ncourses = '30 /inch'"]
    file.write_text(
        f"[wire]\nmaterial = 'molybdenum'\ndiameter = '30 um'\n[knit]\n{knit}\n[model]\nkind = 'spatial'\n"
        "boundary = 'periodic'\n[load]\ntension_weft = '2 N/m'\ntension_warp = '2 N/m'\n[solver]\npreset = 'draft'\n"
        "[output]\nframes = 2\n[variants]\ncount = 2\nstandard_error = 0\n"
        "[sweep]\ntension_weft = ['2 N/m']\ntension_warp = ['2 N/m']\n"
    )
    out = tmp_path / "out"
    command = ["report", str(file), "--out", str(out), "--tension", "2 N/m", "--cards", "nastran", "--quiet"]
    done = CliRunner().invoke(main, command)
    assert done.exit_code == 0, done.output
    answers = json.loads((out / "answers.json").read_text(encoding="utf-8"))
    card = json.loads((out / "material_card.json").read_text(encoding="utf-8"))["values"]
    with open(out / "map.csv", newline="", encoding="utf-8") as text:
        (cell,) = csv.DictReader(text)
    (service,) = [one for one in answers["service"] if one["tension_N_per_m"] == 2.0]
    for side, number in (("weft", 1), ("warp", 2)):
        strain = pytest.approx(float(cell[f"strain_{side}"]), abs=2e-3)  # with friction on other paths
        assert service["state"][f"strain_{side}"] == strain and card[f"prestrain{number}"] == strain
    options = ["--set", "contact.friction=0.1", "--set", "variants.sensitivity=false", "--quiet"]
    done = CliRunner().invoke(main, ["map", str(file), "--out", str(tmp_path / "low"), *options])
    assert done.exit_code == 0, done.output
    low, of_map = (json.loads((path / "map.json").read_text(encoding="utf-8")) for path in (tmp_path / "low", out))
    assert "frictions" not in low  # without variants.sensitivity
    half = of_map["frictions"]["friction_half"]  # of two meshes, so the mean of both with friction 0.1
    assert half == pytest.approx({name: low["optimum"][name] for name in half}, rel=1e-9)
    page = (out / "report.html").read_text(encoding="utf-8")
    assert page.count("<th>friction 0.1</th>") == page.count("<th>friction 0.4</th>") == 5  # optimum, three tensions, card
    assert page.count("<th>eight in ten meshes</th>") == 3 and "means of 2 meshes" in page
    assert "p10_tension_weft_N_per_m" in (out / "tension_strain.csv").read_text(encoding="utf-8").splitlines()[0]
    assert Path(out / "figures" / "report_tension.png").exists()
