"""The table of measures, and that both models offer the observables it draws on."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from reference.in_words import table_of
from warpknit import export, measure
from warpknit.base.errors import Diverged
from warpknit.base.text import engineering
from warpknit.measure import Observables, class_median_force, class_of_pair, classes_of, table
from warpknit.measure.observables import MeshModel
from warpknit.measure.table import Measure
from warpknit.planar.model import Model
from warpknit.planar.observables import PlanarObservables
from warpknit.results.row import Row, read_rows
from warpknit.runner.run import run_scene
from warpknit.runner.summary import Summary
from warpknit.runner.summary_table import summary_findings
from warpknit.scene import load_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation
from warpknit.spatial.model import SpatialModel
from warpknit.spatial.observables import SpatialObservables
from warpknit.studies.load_path import states_at

CELL = Path(__file__).parent.parent / "scenes" / "atlas_cell.toml"
PATCH = CELL.with_name("atlas_patch.toml")
QUICK = ("load.strain_weft=0.01", "load.strain_warp=0.01", "output.frames=1", "output.figures=false", "output.usd=false")
OF_KIND = {"planar": ("model.nodes_per_loop=12",), "spatial": ("model.kind=spatial", "model.nodes_per_loop=16")}


def longest_segment(r: Observables) -> float:
    """[m] of all wires between two nodes: the recipe's new measure."""
    layout = r.model.layout()
    lengths = np.linalg.norm(np.diff(r.node_position, axis=0), axis=1)
    return float(np.delete(lengths, layout.wire_start[1:-1] - 1).max())


@pytest.mark.parametrize("kind", OF_KIND)
def test_a_line_of_the_table_is_a_column_and_a_key(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One function and one line, in either model: the last column of history.csv, and a key of every stage of summary.json."""
    line = Measure("longest_segment_m", longest_segment, history=True, summary="wire")
    nothing = Measure("nothing", lambda r: None, history=True, summary="wire")
    monkeypatch.setattr(table, "MEASURES", (*table.MEASURES, line, nothing))
    scene = load_scene(CELL, [*QUICK, *OF_KIND[kind]])
    assert run_scene(scene, out=tmp_path / "run", device="cpu").exit_code == 0
    with open(tmp_path / "run" / "history.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    summary = json.loads((tmp_path / "run" / "summary.json").read_text(encoding="utf-8"))
    assert list(rows[-1])[-1] == "longest_segment_m"
    found = float(rows[-1]["longest_segment_m"])
    assert found > 0.0
    assert summary["wire"]["longest_segment_m"] == summary["stages"][0]["wire"]["longest_segment_m"] == found
    assert "nothing" not in rows[-1] and "nothing" not in summary["wire"]


def test_the_largest_contact_force_is_one_value(tmp_path: Path) -> None:
    """Below the threshold of active pairs, too: the key of the summary, the column of history.csv and the row of the table."""
    scene = load_scene(CELL, [*QUICK, "contact.threshold=1 N", "load.strain_weft=0.1", "load.strain_warp=0.1"])
    summary = run_scene(scene, out=tmp_path / "run", device="cpu").summary.json()
    [_, row] = read_rows(tmp_path / "run" / "history.csv", Row)
    assert summary["contacts"]["active"] == 0 and row.contact_force_max_N > 1e-6
    assert summary["contacts"]["force_max_N"] == row.contact_force_max_N
    shown = table_of(summary_findings(Summary.of(summary)))["  largest force"]
    assert shown == engineering(row.contact_force_max_N, "N")


@pytest.mark.parametrize(
    ("offered", "by"),
    [(Observables, PlanarObservables), (Observables, SpatialObservables), (MeshModel, Model), (MeshModel, SpatialModel)],
)
def test_both_models_offer_the_same_names(offered: type, by: type) -> None:
    """Properties, methods and fields of both are those of the protocols."""
    names = {name for name in vars(offered) if not name.startswith("_")}
    fields = {name for kind in by.__mro__ for name in getattr(kind, "__annotations__", {})}
    assert names and names <= {*dir(by), *fields}


def test_shares_of_the_wire_are_by_length() -> None:
    """Nine close nodes stand for a tenth of the wire, and carry twice the limit of 1 Pa: a share of 10 %, not of 9 in 10 nodes.
    1 % of the wire exceeds the stress of the node behind which 1 % of the length is left, 1.9 Pa, and half of it 0.1 Pa."""
    model = SimpleNamespace(scene=SimpleNamespace(wire=SimpleNamespace(yield_stress=1.0, plastic=True)))
    stress = np.append(1.1 + 0.1 * np.arange(9), 0.1)
    of_wire = SimpleNamespace(node=stress, contact=np.zeros(0), contact_node=np.zeros(0, dtype=int))
    reading = SimpleNamespace(
        model=model, wire_stress=of_wire, node_length=np.append(np.full(9, 0.1 / 9), 0.9), plastic_strain=stress - 1.0
    )
    assert measure.stress_extremes(reading) == pytest.approx((1.9, 1.9, 0.1))
    assert measure.plastic_extremes(reading)[0] == pytest.approx(0.1)
    of_wire.contact, of_wire.contact_node = np.array([3.0]), np.array([9])  # behind the last node, which stands for the rest
    assert measure.stress_extremes(reading) == pytest.approx((3.0, 1.9, 1.0))
    of_wire.contact, of_wire.contact_node = np.zeros(0), np.zeros(0, dtype=int)
    reading.node_length = np.append(np.full(9, 0.009 / 9), 0.991)
    assert measure.stress_extremes(reading)[1] == 0.1


@pytest.mark.parametrize("boundary", ["periodic", "gripped"])
@pytest.mark.parametrize("kind", OF_KIND)
def test_nodes_stand_for_all_of_the_wire(kind: str, boundary: str) -> None:
    """The lengths of a tile add up to that of its wires as knitted, those of a patch to that between their clamps."""
    repeats = "[3, 3]" if boundary == "gripped" else "[1, 1]"
    model = build_model(load_scene(CELL, [*OF_KIND[kind], f"model.boundary={boundary}", f"knit.repeats={repeats}"]))
    state = states_at(model, [np.eye(2)])[0]
    assert not isinstance(state, Diverged)
    assert state.node_length.shape == (model.node_count,)
    assert float(state.node_length.sum()) == pytest.approx(state.wire_length, rel=1e-9)


def test_every_measure_is_named_once_where_it_stands() -> None:
    for place in ("history", "map", "summary"):
        named = [(getattr(line, place), line.name) for line in table.MEASURES if getattr(line, place)]
        assert len(named) == len(set(named))


def test_a_line_of_the_formats_is_an_export(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One file and one line: `--to` takes the name, and the function gets the run."""
    scene = load_scene(CELL, [*QUICK, *OF_KIND["planar"]])
    run_scene(scene, out=tmp_path / "run", device="cpu")
    monkeypatch.setitem(export.FORMATS, "csv2", export.FORMATS["csv"])
    assert export.export_run(tmp_path / "run", "csv2") == export.export_run(tmp_path / "run", "csv") != []


@pytest.mark.parametrize("kind", OF_KIND)
def test_the_layout_has_the_classes_of_the_contacts(kind: str) -> None:
    """Those of the columns of the history, a class a body; none where nothing is knitted."""
    model = build_model(load_scene(CELL, [*QUICK, *OF_KIND[kind]]))
    np.testing.assert_array_equal(np.repeat(model.layout().body_class, 2), class_of_pair(model))
    assert len(np.unique(model.layout().body_class)) == len(classes_of(model)) > 1
    assert build_model(load_scene(CELL.with_name("hook_spatial.toml"))).layout().body_class.size == 0


@pytest.mark.parametrize(("loaded", "found"), [(3, 0.0), (4, 283e-6), (5, 283e-6)])
def test_a_class_has_the_force_that_half_of_its_pairs_reach(loaded: int, found: float) -> None:
    """Of eight pairs 3, 4 or 5 carry 283 uN and the others nothing: half of them carry 283 uN from four on, never a mean."""
    model = build_model(load_scene(CELL, [*QUICK, *OF_KIND["planar"]]))
    pairs = np.flatnonzero(class_of_pair(model) == 0)
    assert len(pairs) == 8
    force = np.zeros(model.pair_count)
    force[pairs[:loaded]] = 283e-6
    assert class_median_force(SimpleNamespace(model=model, pair_force=force), "A") == found


def test_light_contacts_are_active_with_less_than_a_tenth_of_the_mean_force() -> None:
    """Five pairs carry 1000 times the threshold, three 5 times and two half of it: three are light. Without forces none is."""
    model = build_model(load_scene(CELL, [*QUICK, *OF_KIND["planar"]]))
    light = next(one for one in table.MEASURES if one.name == "light_percent")
    force = np.zeros(model.pair_count)
    assert light.of(SimpleNamespace(model=model, pair_force=force)) == 0.0
    force[:10] = measure.active_threshold(model) * np.repeat([1000.0, 5.0, 0.5], [5, 3, 2])
    assert light.of(SimpleNamespace(model=model, pair_force=force)) == pytest.approx(300.0 / model.pair_count)


@pytest.mark.parametrize("kind", ["planar", "spatial"])
def test_pieces_at_the_grips_carry_the_virial_of_their_own_forces(kind: str) -> None:
    """A piece that touches nothing is pulled by its two clamps alone, by equal and opposite forces: its part of the tension is
    that of its clamps in the sum over all clamps, whatever the origin. A tile has no pieces."""
    overrides = {
        "model.kind": kind,
        "knit.repeats": [2, 2],
        "load.strain_weft": 0.02,
        "load.strain_warp": 0.02,
        "output.frames": 1,
    }
    simulation = Simulation(build_model(load_scene(PATCH, overrides, "draft")))
    *_, record = simulation.run()
    r = record.observables
    panel, loop = r.model.panel, r.model.cloth.stitch_length
    short = np.repeat(panel.wire_length < loop, 2)
    force, clamp = r.edge_force[:, :2], panel.clamp_position
    found = measure.fragment_tension(r)
    for origin in (panel.low, panel.low + panel.size):
        pull = force[short].T @ (clamp[short] - origin) / panel.area
        assert np.abs(force[short].sum(axis=0)).max() < 1e-2 * np.abs(force[short]).max()
        cauchy = pull @ (np.eye(2) + 0.02 * np.eye(2)).T / 1.02**2
        assert found == pytest.approx(tuple(np.diag(cauchy)), rel=0.02)
    tile = load_scene(PATCH, overrides | {"model.boundary": "periodic"}, "draft")
    assert measure.fragment_tension(SimpleNamespace(model=build_model(tile))) == (None, None)
