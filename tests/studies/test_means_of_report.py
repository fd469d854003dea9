"""A report of several meshes has means: of the path under equal tensions, of curves, and on the page."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from reference.in_words import quantities
from warpknit.base.errors import Diverged
from warpknit.commands.cli import main
from warpknit.runner.history import row_of
from warpknit.scene import Scene, load_scene
from warpknit.studies import curves
from warpknit.studies.curves import tension_strain
from warpknit.studies.equal_tension import load_equally, service_points
from warpknit.studies.load_path import LoadPath, MeshesPath, under_tension
from warpknit.studies.mean_card import meshes_of
from warpknit.studies.report import KeptStates, read_states, write_states

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
FIGURES = ("strain_weft", "strain_warp", "active_percent", "stress_max_Pa")


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene(TABLES)


@pytest.fixture(scope="module")
def meshes(scene: Scene) -> list:
    return meshes_of(scene, scene.solver.residual_tolerance)


def test_rows_of_meshes_are_the_means_of_their_paths_to_the_bit(scene, meshes):
    means, ways = MeshesPath(meshes), [LoadPath(mesh) for mesh in meshes]
    for tension in (1.0, 2.0):  # the second load step begins where the first one ends
        stage = under_tension(scene, tension)
        rows = list(means.rows(stage, 2))
        single = [[row_of(record) for record in way.load(stage, 2)] for way in ways]
        assert len(rows) == len(single[0])
        for row, *of_meshes in zip(rows, *single, strict=True):
            for name in FIGURES:
                values = [one[name] for one in of_meshes]
                assert row[name] == pytest.approx(np.mean(values), rel=1e-12, abs=1e-15)
                assert (row[f"p10_{name}"], row[f"p90_{name}"]) == pytest.approx((min(values), max(values)), rel=1e-12)


def test_a_mesh_that_fails_is_left_out_from_there_on(scene, meshes, monkeypatch):
    from warpknit.solve.relax import Relaxation

    reach = Relaxation.reach

    def fail(self, *args, **options):
        if self.row == 1 and len(means.models) == 3 and started:
            raise Diverged("no progress")
        yield from reach(self, *args, **options)

    monkeypatch.setattr(Relaxation, "reach", fail)
    means, started = MeshesPath([*meshes, meshes[0]]), []
    list(means.rows(under_tension(scene, 1.0), 1))
    assert list(means.models) == [0, 1, 2]
    started.append(True)
    rows = list(means.rows(under_tension(scene, 2.0), 1))
    assert list(means.models) == [0, 2] and rows[-1].meshes == 2
    assert rows[-1].p10_strain_weft == rows[-1].p90_strain_weft  # two meshes of the same loops


def test_too_few_meshes_raise(scene, meshes, monkeypatch):
    from warpknit.solve.relax import Relaxation

    def fail(self, *args, **options):
        raise Diverged("no progress")
        yield

    monkeypatch.setattr(Relaxation, "reach", fail)
    means = MeshesPath(meshes)
    with pytest.raises(Diverged, match="no progress"):
        list(means.rows(under_tension(scene, 1.0), 1))
    assert list(means.models) == [0, 1]


def test_service_tensions_are_means_and_are_kept(scene, meshes, tmp_path):
    path = load_equally(meshes, 0.0)
    points = {point.tension: point for point in service_points(scene, path, (), None, None)}
    row = path.at[2.0]
    assert points[2.0].strains == (row.strain_weft, row.strain_warp)
    expected = [f"{1e-6 * row[f'{end}_stress_max_Pa']:.0f} MPa" for end in ("p10", "p90")]
    assert quantities(points[2.0].range_texts[2]) == expected
    above = [one.stress_max_Pa > scene.wire.yield_stress for one in path.rows]
    assert above == [False] * (len(above) - 1) + [True]
    path = replace(path, states={})
    write_states(scene, tmp_path, KeptStates([], path, path))
    kept = read_states(scene, tmp_path).means
    assert (kept.rows, kept.at, kept.ended, kept.states) == (path.rows, path.at, path.ended, {})


def test_curves_are_means_of_the_curves_of_the_meshes(scene, meshes, monkeypatch):
    monkeypatch.setattr(curves, "POINTS", 2)
    means, single = tension_strain(meshes, 0.05, 0.02), [tension_strain(mesh, 0.05, 0.02) for mesh in meshes]
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
    page = (out / "report.html").read_text(encoding="utf-8")
    assert page.count("<th>eight in ten meshes</th>") == 3 and "means of 2 meshes" in page
    assert "p10_tension_weft_N_per_m" in (out / "tension_strain.csv").read_text(encoding="utf-8").splitlines()[0]
    assert Path(out / "figures" / "report_tension.png").exists()
