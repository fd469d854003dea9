"""The plan: its keys, that its counts are those of the model, its estimates against runs, and what it refuses."""

import json
import subprocess
import sys
from dataclasses import fields, is_dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import warp as wp

from warpknit.commands.plan import make_plan
from warpknit.compute import device, memory
from warpknit.compute.memory import MEMORY_PER_NODE
from warpknit.design.estimate import PAGE_TIME
from warpknit.errors import DeviceError, InputError, MemoryNeeded
from warpknit.knit.chain import KnitError
from warpknit.mesh.layout import knit_scene
from warpknit.mesh.load_point import LoadPoint
from warpknit.planar import estimate
from warpknit.planar.estimate import ESTIMATE_FACTOR
from warpknit.planar.observables import read
from warpknit.planar.state import initial_state
from warpknit.runner.run import run_scene
from warpknit.scene import load_scene, make_scene
from warpknit.solve.model import build_model, estimates_of
from warpknit.solve.simulate import Simulation
from warpknit.spatial.estimate import size_of_model, spatial_time

ROOT = Path(__file__).parent.parent
CELL = ROOT / "scenes" / "atlas_cell.toml"
PATCH = ROOT / "scenes" / "atlas_patch.toml"
HOOK = ROOT / "scenes" / "hook_free_body.toml"


def test_keys_are_those_scripts_rely_on():
    planned = make_plan(load_scene(CELL), "cpu").as_dict()
    assert set(planned) == {
        "nodes", "wires", "bodies", "pairs", "memory_bytes", "time_step_s", "limited_by", "steps", "wall_s", "physics", "model",
        "report_s",
    }  # fmt: skip
    assert json.loads(json.dumps(planned, allow_nan=False)) == planned


def test_counts_of_the_cell():
    """One repeat of the double atlas: 2 threads, 8 loops of 16 nodes, 12 bodies with two pairs each."""
    planned = make_plan(load_scene(CELL), "cpu")
    assert (planned.wires, planned.nodes, planned.bodies, planned.pairs) == (2, 8 * 16, 12, 24)
    assert planned.counted


def test_a_plan_shows_the_loads():
    """One line a stage: what drives weft and warp, and the temperature; a stage of its own has no name."""
    stages = ['path=[{name="cold", temperature="-190 degC", tension_warp="2 N/m"}]', "load.shear=0.01", "load.strain_warp=0.05"]
    lines = make_plan(load_scene(PATCH, stages), "cpu").lines()
    at = next(k for k, line in enumerate(lines) if line.startswith("load "))
    assert lines[at] == "load       load: strain 10 % in weft, strain 5 % in warp, shear 1 %, at 20 degC"
    assert lines[at + 1] == "           cold: strain 10 % in weft, tension 2 N/m in warp, shear 1 %, at -190 degC"
    assert "load       strain 10 % in weft and warp, at 20 degC" in make_plan(load_scene(PATCH), "cpu").lines()


@pytest.mark.parametrize("boundary", ["periodic", "gripped"])
def test_estimated_sizes_of_large_meshes(monkeypatch, boundary):
    """Above COUNTED_NODES sizes are those of endless cloth: exact for a tile, off by the edges of a gripped mesh.

    A gripped mesh of 7 x 6 repeats loses clasps on a rim of at most a quarter of a repeat, 2 (1/7 + 1/6)/4 of all.
    """
    scene = load_scene(PATCH, [f'model.boundary="{boundary}"'])
    counted = make_plan(scene, "cpu")
    monkeypatch.setattr(estimate, "COUNTED_NODES", 0)
    estimated = make_plan(scene, "cpu")
    assert not estimated.counted and "about" in estimated.lines()[2]
    allowed = 0.0 if boundary == "periodic" else 0.5 * (1 / 7 + 1 / 6)
    assert estimated.nodes == pytest.approx(counted.nodes, rel=allowed, abs=0)
    assert estimated.bodies == pytest.approx(counted.bodies, rel=allowed, abs=0)
    assert (estimated.time_step_s, estimated.limited_by) == (counted.time_step_s, counted.limited_by)


@pytest.mark.parametrize(
    ("override", "sentence"),
    [
        ('model.boundary="gripped"', "grips"),
        ('model.boundary="periodic"', "periodic boundary"),
        ('load.temperature="-190 degC"', "thermal strain"),
        ("load.tension_weft=0.1", "tension search"),
        ("load.shear=0.1", "shear"),
        ('wire.plating={material="gold", thickness="0.2 um"}', "plating"),
        ("wire.set_fraction=0.5", "rest curvature"),
        ("wire.ends=3", "ends"),
        ('solver.drive="ramp"', "ramp"),
        ('solver.precision="double"', "double precision"),
        ("solver.axial_softening=10", "softening"),
    ],
)
def test_physics_is_named_where_the_scene_asks_for_it(override, sentence):
    planned = make_plan(load_scene(CELL, ["knit.repeats=[2, 2]", override]), "cpu")
    assert any(text.startswith(f"{sentence}:") for text in planned.physics)


TRICOT, ATLAS = [{"chain": "1-0/1-2"}, {"chain": "1-2/1-0"}], [{"chain": "1-0/1-2/2-3/3-4/3-2/2-1"}]


@pytest.mark.parametrize(
    ("bars", "kind", "diameter", "line"),
    [
        (TRICOT, "spatial", "90 um", "as knitted, wires overlap in 4 places of a repeat, by up to 71 % of their thickness: "),
        (ATLAS, "spatial", "70 um", "as knitted, wires overlap in 6 places of a repeat, by up to 23 % of their thickness: "),
        (ATLAS, "planar", "120 um", "at least 16 of 20 pairs of a repeat are active as knitted: "),
        (TRICOT, "spatial", "30 um", None),
        (ATLAS, "spatial", "50 um", None),
        (ATLAS, "planar", "60 um", None),
    ],
)
def test_wires_too_thick_for_the_loops_are_told_as_by_a_run(bars, kind, diameter, line):
    """What a run finds when it begins: the same places as deep in space; in the plane all 20 pairs of the atlas of 120 um, of
    which 16 are those of single lenses, and none of that of 60 um."""
    knit = {"bars": bars, "wales": "26 /inch", "courses": "30 /inch"}
    model = {"kind": kind, "boundary": "periodic", "nodes_per_loop": 24}
    scene = load_scene({"wire": {"diameter": diameter}, "knit": knit, "model": model, "load": {"strain_weft": 0.01}})
    told = [warning for warning in make_plan(scene).warnings if "too thick" in warning]
    assert told == ([] if line is None else [f"{line}the yarn is too thick for the loops, or the bars lap through each other"])
    if line is not None and kind == "spatial":
        mechanics = Simulation(build_model(scene)).mechanics
        mechanics.contact.search()
        mechanics.is_in_equilibrium(LoadPoint(np.eye(2), scene.wire.reference_temperature))
        [note] = mechanics.notes
        assert note.startswith(line.partition(" of a repeat")[0])


def test_physics_that_is_off_is_not_named():
    overrides = ["solver.axial_softening=1", "solver.multipliers=false"]
    named = {text.split(":")[0] for text in make_plan(load_scene(CELL, overrides), "cpu").physics}
    assert named == {
        "stretching", "bending", "contact", "periodic boundary", "affine prediction", "relaxation", "double precision",
    }  # fmt: skip


def test_the_load_path_is_said_to_decide_between_equilibria() -> None:
    """Of a mesh; of two hooked wires there is one. A map alone runs no [[path]]."""
    for scene, said in ((CELL, "a tight mesh may have several, of which the load path decides"), (HOOK, "independent of")):
        [relaxation] = [text for text in make_plan(load_scene(scene), "cpu").physics if text.startswith("relaxation: ")]
        assert said in relaxation
    swept = {"path[0].temperature": "-100 degC", "sweep": {"strain_weft": [0.1], "strain_warp": [0.1]}}
    physics = make_plan(load_scene(CELL, swept), "cpu").physics
    assert "without effect: path (a map runs only [load])" in physics


def test_a_scene_with_a_report_tells_its_time() -> None:
    """A tile has one, with a map by default: without [sweep] and with fewer pairs in it. A gripped mesh has none."""
    cell = make_plan(load_scene(CELL), "cpu")
    few = make_plan(load_scene(CELL, {"sweep": {"strain_weft": [0.1], "strain_warp": [0.1]}}), "cpu")
    hot = make_plan(load_scene(CELL, {"path[0].temperature": "140 degC"}), "cpu")
    assert 0.0 < few.report_map_s < 0.1 * cell.report_map_s and few.report_s < cell.report_s < hot.report_s
    assert few.report_s > few.wall_s + PAGE_TIME, "the card and the page are part of it"
    assert any(line.startswith("report     warpknit report takes about ") and " for its map, " in line for line in cell.lines())
    assert "in about" in few.sweep
    gripped = make_plan(load_scene(PATCH), "cpu")
    assert gripped.report_s is None and gripped.as_dict()["report_s"] is None
    assert not any(line.startswith("report") for line in gripped.lines())


def test_a_ramp_has_a_real_step_and_what_limits_it():
    scene = load_scene(CELL, ['solver.drive="ramp"'])
    planned = make_plan(scene, "cpu")
    built = build_model(scene)
    assert planned.time_step_s == built.time_step < 1e-5
    assert planned.limited_by in ("stretch", "bending", "contact")
    # every stage takes its loading time, at steps that are at most the first one
    assert planned.steps >= built.loading_time / built.time_step


def test_text_says_what_the_numbers_say():
    planned = make_plan(load_scene(PATCH), "cpu")
    text = "\n".join(planned.lines())
    assert f"{planned.nodes:,} nodes on {planned.wires} wires" in text
    assert f"{planned.bodies} bodies, {planned.pairs} pairs" in text
    assert all(sentence in text for sentence in planned.physics)
    assert "not estimated" in "\n".join(replace(planned, wall_s=None).lines())


@pytest.mark.parametrize(
    ("name", "nodes", "measured_s"), [("panel_million", 10_769_440, 22.1), ("panel_million_spatial", 6_725_230, 45.7)]
)
def test_the_time_on_a_gpu_is_that_of_docs_studies_performance(name: str, nodes: int, measured_s: float) -> None:
    scene = load_scene(ROOT / "scenes" / f"{name}.toml")
    estimates = estimates_of(scene)
    size, _ = estimates.size_of(scene, knit_scene(scene))
    assert size.nodes == pytest.approx(nodes, rel=0.02)
    cost = estimates.cost_of(scene, size)
    assert cost.gpu_seconds == pytest.approx(measured_s, rel=0.3)
    assert cost.gpu_seconds < cost.seconds / 5
    ramp = load_scene(CELL, ['solver.drive="ramp"'])
    assert estimates_of(ramp).cost_of(ramp, estimates_of(ramp).size_of(ramp, None)[0]).gpu_seconds is None


@pytest.mark.parametrize(
    ("path", "overrides", "preset"),
    [
        (CELL, ["output.frames=5"], "standard"),
        (CELL, [], "draft"),
        (CELL, ["load.strain_weft=0.04", "load.strain_warp=0.04"], "standard"),
        (PATCH, ["knit.repeats=[2, 2]"], "draft"),
        (CELL, ['solver.drive="ramp"', "output.frames=2", "solver.loading_time=0.004"], "draft"),
    ],
)
def test_steps_are_within_the_factor_that_is_promised(path, overrides, preset):
    scene = load_scene(path, overrides, preset)
    built = build_model(scene)
    simulation = Simulation(built, initial_state(built))
    for _record in simulation.run():
        pass
    planned = make_plan(scene, "cpu").steps
    assert 1 / ESTIMATE_FACTOR < simulation.progress.steps / planned < ESTIMATE_FACTOR


@pytest.mark.parametrize(
    ("name", "overrides"),
    [
        ("atlas_cell_spatial.toml", ["solver.preset=draft", "output.frames=1", "load.strain_weft=0.05", "load.strain_warp=0.05"]),
        ("hook_spatial.toml", ["output.frames=1", "load.displacement=0.05 mm"]),
    ],
)
def test_steps_in_space_are_within_the_factor_that_is_promised(name, overrides):
    scene = load_scene(ROOT / "scenes" / name, overrides)
    relaxation = Simulation(build_model(scene))
    for _record in relaxation.run():
        pass
    planned = make_plan(scene, "cpu")
    assert 1 / planned.factor < relaxation.progress.steps / planned.steps < planned.factor


@pytest.mark.parametrize("bars", [None, '[{chain="1-0/1-2"}, {chain="1-2/1-0"}]'], ids=["open net", "tight tricot"])
def test_time_in_space_goes_by_the_pairs_that_a_run_begins_with(bars):
    """Up to those of curves whose chords pass farther from each other, which are not counted: by 4/27 of an edge at most."""
    overrides = ["model.nodes_per_loop=48"] + ([f"knit.bars={bars}"] if bars else [])
    mesh = build_model(load_scene(ROOT / "scenes" / "atlas_cell_spatial.toml", overrides))
    relaxation = Simulation(mesh)
    relaxation.mechanics.contact.search()
    planned = size_of_model(mesh)
    assert 0.6 < planned.near / relaxation.mechanics.contact.pair_count <= 1.0
    fewer = replace(planned, near=0)
    assert spatial_time(1000, planned) > spatial_time(1000, fewer)


FLAT = "wire,x [mm],y [mm],z [mm]\n1,0,0,0\n1,3,3,0\n2,0,3,0\n2,3,0,0\n"  # two wires that meet


@pytest.mark.parametrize(
    ("name", "overrides", "line"),
    [
        ("wires/plain_knit_cell.toml", ["wires.node_spacing=1e-6"], "half the thickness of the wire"),
        ("wires/plain_knit_patch.toml", ["wires.node_spacing=0.02"], "of which its clamps hold four"),
        (None, [], "centre lines of wires 1 and 2 intersect"),
    ],
)
def test_a_plan_in_space_refuses_what_a_run_refuses(name, overrides, line, tmp_path):
    """With the same line."""
    if name is None:
        (tmp_path / "flat.csv").write_text(FLAT)
        scene = make_scene({"wires": {"file": "flat.csv"}, "wire": {"diameter": "0.1 mm"}}, path=tmp_path / "flat.toml")
    else:
        scene = load_scene(ROOT / "scenes" / name, overrides)
    with pytest.raises(InputError, match=line) as planned:
        make_plan(scene, "cpu")
    with pytest.raises(InputError) as run:
        run_scene(scene, out=tmp_path / "run", device="cpu")
    assert str(planned.value) == str(run.value)


@pytest.mark.parametrize(("precision", "share"), [("single", 0.45), ("double", 0.55)])
def test_memory_per_node_covers_the_arrays(precision, share):
    """The arrays of a stepping mesh take `share` of MEMORY_PER_NODE, to 10 points; copies made by exports the rest.

    What a repeat or a launch takes once is small beside 86,400 nodes.
    """
    scene = load_scene(CELL, ["knit.repeats=[20, 20]", f'solver.precision="{precision}"'])
    built = build_model(scene)
    state = initial_state(built)
    simulation = Simulation(built, state)
    simulation.mechanics.neighbours.search()
    reading = read(built, state)
    total = array_bytes([built, state, simulation, reading], set())
    assert total / built.panel.node_count / MEMORY_PER_NODE["planar", precision] == pytest.approx(share, abs=0.1)


def array_bytes(thing, seen):
    """Bytes of all arrays below some objects, each once."""
    if id(thing) in seen or isinstance(thing, (str, int, float, type, wp.Launch)):
        return 0
    seen.add(id(thing))
    if isinstance(thing, np.ndarray):
        return thing.nbytes if thing.base is None else 0
    if isinstance(thing, wp.array):
        return thing.capacity
    if isinstance(thing, (list, tuple)):
        return sum(array_bytes(part, seen) for part in thing)
    if is_dataclass(thing):
        return sum(array_bytes(getattr(thing, field.name), seen) for field in fields(thing))
    if type(thing).__module__.startswith("warpknit."):
        return sum(array_bytes(part, seen) for part in vars(thing).values())
    return 0


def test_what_cannot_fit_is_refused_and_says_how_much(monkeypatch):
    monkeypatch.setattr(memory, "available_memory", lambda device="cpu": 2**30)
    with pytest.raises(MemoryNeeded, match=r"knit.repeats = \[1000000, 1000000\]: .* GiB, 1 GiB are available"):
        make_plan(load_scene(CELL, ["knit.repeats=[1000000, 1000000]"]), "cpu")


def test_a_device_that_is_not_there_is_refused():
    with pytest.raises(DeviceError, match="--device: 'cuda:99' .* cpu"):
        make_plan(load_scene(CELL), "cuda:99")


def test_the_default_device_goes_by_the_size_of_the_mesh(monkeypatch):
    """Small meshes stay on the CPU where there is a GPU; ranks of one machine take its GPUs in turn."""
    monkeypatch.setattr(device, "devices", lambda: ["cpu", "cuda:0", "cuda:1"])
    assert device.find_device(None, nodes=lambda: 1000) == "cpu"
    assert [device.find_device(None, place, lambda: 10**6) for place in range(3)] == ["cuda:0", "cuda:1", "cuda:0"]
    assert device.find_device("cuda:1", nodes=lambda: 1000) == "cuda:1"
    assert make_plan(load_scene(CELL)).device == "cpu"


def test_a_knit_that_cannot_be_made_is_refused():
    with pytest.raises(KnitError):
        make_plan(make_scene({"knit": {"bars": [{"chain": "1-0/1-2", "threading": "|."}]}}), "cpu")


def test_planning_compiles_nothing(tmp_path):
    """In a process with a kernel cache of its own: it stays empty."""
    code = (
        f"import warp as wp; wp.config.kernel_cache_dir = {str(tmp_path)!r}; wp.config.quiet = True\n"
        "from warpknit.commands.plan import make_plan; from warpknit.scene import load_scene\n"
        f"make_plan(load_scene({str(CELL)!r}), 'cpu')"
    )
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []
