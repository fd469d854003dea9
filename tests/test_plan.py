"""The plan: its keys, that its counts are those of the model, its steps against those of runs, and what it refuses."""

import json
from dataclasses import fields, is_dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import warp as wp

from reference.cases import slow
from reference.in_words import quantities, table_of
from warpknit.base.errors import DeviceError, InputError, MemoryNeeded
from warpknit.commands.plan import make_plan, overview_of
from warpknit.compute import device, memory
from warpknit.compute.memory import MEMORY_PER_NODE
from warpknit.knit.lapping import KnitError
from warpknit.mesh.rim import LoadPoint
from warpknit.planar.observables import read
from warpknit.planar.state import initial_state
from warpknit.runner.run import run_scene
from warpknit.scene import load_scene, make_scene
from warpknit.solve import sample_run
from warpknit.solve.model import build_model
from warpknit.solve.sample_run import SampleRun
from warpknit.solve.simulate import Simulation

ROOT = Path(__file__).parent.parent
CELL = ROOT / "scenes" / "atlas_cell.toml"
PATCH = ROOT / "scenes" / "atlas_patch.toml"
HOOK = ROOT / "scenes" / "hook_free_body.toml"


def test_keys_are_those_scripts_rely_on():
    planned = make_plan(load_scene(CELL), "cpu").as_dict()
    assert set(planned) == {
        "nodes", "wires", "bodies", "pairs", "memory_bytes", "time_step_s", "limited_by", "steps", "wall_s", "physics", "model",
    }  # fmt: skip
    assert json.loads(json.dumps(planned, allow_nan=False)) == planned


def test_counts_of_the_cell():
    """One repeat of the double atlas: 2 threads, 8 loops of 16 nodes, 12 bodies with two pairs each."""
    planned = overview_of(load_scene(CELL), "cpu")
    assert (planned.wires, planned.nodes, planned.bodies) == (2, 8 * 16, 12)
    assert planned.is_whole


def test_a_plan_shows_the_loads():
    """One line a stage: what drives weft and warp, and the temperature; a stage of its own has no name."""
    stages = ['path=[{name="cold", temperature="-190 degC", tension_warp="2 N/m"}]', "load.shear=0.01", "load.strain_warp=0.05"]
    steps = [line.text for line in make_plan(load_scene(PATCH, stages), "cpu").table().findings if line.name == "  load step"]
    assert steps == [
        "load: strain 10 % in weft, strain 5 % in warp, shear 1 %, at 20 degC",
        "cold: strain 10 % in weft, tension 2 N/m in warp, shear 1 %, at -190 degC",
    ]
    first, *others = make_plan(load_scene(PATCH), "cpu").table().lines()
    assert (first.name, first.text) == ("atlas_patch", "strain 10 % in weft and warp, at 20 degC, on cpu")
    assert len(others) == 6


@pytest.mark.parametrize("boundary", ["periodic", "gripped"])
def test_estimated_sizes_of_large_meshes(monkeypatch, boundary):
    """Above SAMPLE_NODES sizes are those of endless cloth: exact for a tile, off by the edges of a gripped mesh.

    A gripped mesh of 7 x 6 repeats loses clasps on a rim of at most a quarter of a repeat, 2 (1/7 + 1/6)/4 of all.
    """
    scene = load_scene(PATCH, [f'model.boundary="{boundary}"'])
    counted = overview_of(scene, "cpu")
    monkeypatch.setattr(sample_run, "SAMPLE_NODES", 0)
    estimated = overview_of(scene, "cpu")
    assert not estimated.is_whole and estimated.mesh[1][1].startswith("about ")
    allowed = 0.0 if boundary == "periodic" else 0.5 * (1 / 7 + 1 / 6)
    assert estimated.nodes == pytest.approx(counted.nodes, rel=allowed, abs=0)
    assert estimated.bodies == pytest.approx(counted.bodies, rel=allowed, abs=0)
    assert estimated.model.time_step == counted.model.time_step


@pytest.mark.parametrize(
    ("override", "sentence"),
    [
        ('model.boundary="gripped"', "grips"),
        ('model.boundary="periodic"', "periodic boundary"),
        ('load.temperature="-190 degC"', "thermal strain"),
        ("load.tension_weft=0.1", "strain by tension"),
        ("load.shear=0.1", "shear"),
        ('wire.plating={material="gold", thickness="0.2 um"}', "plating"),
        ("wire.set_fraction=0.5", "natural curvature"),
        ("wire.ends=3", "ends"),
        ('solver.drive="ramp"', "ramp"),
        ('solver.precision="double"', "double precision"),
        ("solver.axial_softening=10", "softening"),
    ],
)
def test_physics_is_named_where_the_scene_asks_for_it(override, sentence):
    planned = overview_of(load_scene(CELL, ["knit.repeats=[2, 2]", override]), "cpu")
    assert any(text.startswith(f"{sentence}:") for text in planned.physics)


TRICOT, ATLAS = [{"chain": "1-0/1-2"}, {"chain": "1-2/1-0"}], [{"chain": "1-0/1-2/2-3/3-4/3-2/2-1"}]


@pytest.mark.parametrize(
    ("bars", "kind", "diameter", "given"),
    [
        (TRICOT, "spatial", "90 um", ["4", "71 %"]),
        (ATLAS, "spatial", "70 um", ["6", "23 %"]),
        (ATLAS, "planar", "120 um", ["16", "20"]),
        (TRICOT, "spatial", "30 um", []),
        (ATLAS, "spatial", "50 um", []),
        (ATLAS, "planar", "60 um", []),
    ],
)
def test_wires_too_thick_for_the_loops_are_told_as_by_a_run(bars, kind, diameter, given):
    """What a run finds when it begins: the same places as deep in space; in the plane all 20 pairs of the atlas of 120 um, of
    which 16 are those of single lenses, and none of that of 60 um."""
    knit = {"bars": bars, "wales": "26 /inch", "courses": "30 /inch"}
    model = {"kind": kind, "boundary": "periodic", "nodes_per_loop": 24}
    scene = load_scene({"wire": {"diameter": diameter}, "knit": knit, "model": model, "load": {"strain_weft": 0.01}})
    told = [quantities(one.text) for one in overview_of(scene).warnings if one.code == "W14"]
    assert told == ([given] if given else [])
    if given and kind == "spatial":
        mechanics = Simulation(build_model(scene)).mechanics
        mechanics.contact.search()
        mechanics.is_in_equilibrium(LoadPoint(np.eye(2), scene.wire.reference_temperature))
        [note] = mechanics.notes
        assert quantities(note)[0] == given[0]


def test_physics_that_is_off_is_not_named():
    overrides = ["solver.axial_softening=1", "solver.multipliers=false"]
    named = {text.split(":")[0] for text in overview_of(load_scene(CELL, overrides), "cpu").physics}
    assert named == {
        "stretching", "bending", "contact", "periodic boundary", "affine prediction", "relaxation", "double precision",
    }  # fmt: skip


def test_the_load_path_is_said_to_decide_between_equilibria() -> None:
    """Of a mesh; of two hooked wires there is one. A map alone runs no [[path]]."""
    for scene, said in ((CELL, "a tight mesh may have several, and the load path decides"), (HOOK, "independent of")):
        [relaxation] = [text for text in overview_of(load_scene(scene), "cpu").physics if text.startswith("relaxation: ")]
        assert said in relaxation
    swept = {"path[0].temperature": "-100 degC", "sweep": {"strain_weft": [0.1], "strain_warp": [0.1]}}
    physics = overview_of(load_scene(CELL, swept), "cpu").physics
    assert any(text.startswith("without effect: path ") for text in physics)


def test_a_scene_with_a_sweep_has_the_time_of_its_map() -> None:
    """By the levels of all pairs: one of 0.05 takes half of those of one of 0.1."""
    one, two = (
        make_plan(load_scene(CELL, {"sweep": {"strain_weft": weft, "strain_warp": [0.1]}, "output.frames": 2}), "cpu")
        for weft in ([0.1], [0.05, 0.1])
    )
    assert one.map_s is not None and two.map_s is not None and one.map_s > 0.0
    assert "2" in quantities(table_of(two.table().lines())["map"])
    assert make_plan(load_scene(CELL, ["output.frames=1"]), "cpu").map_s is None


def test_a_map_without_a_load_is_headed_by_its_pairs() -> None:
    """Four pairs of tensions; a scene with a load to run has this load in its first row."""
    sweep = {"tension_weft": ["1 N/m", "2 N/m"], "tension_warp": ["1 N/m", "2 N/m"]}
    scene = load_scene(CELL, {"sweep": sweep, "load": {}, "output.frames": 1})
    assert table_of(make_plan(scene, "cpu").table().lines())[scene.name].startswith("4 pairs of tensions")
    loaded = scene.changed({"load.strain_weft": 0.1, "load.strain_warp": 0.1})
    assert quantities(table_of(make_plan(loaded, "cpu").table().lines())[scene.name])[0] == "10 %"


def test_a_ramp_has_a_real_step_and_what_limits_it():
    scene = load_scene(CELL, ['solver.drive="ramp"'])
    planned = make_plan(scene, "cpu")
    built = build_model(scene)
    values = planned.as_dict()
    assert values["time_step_s"] == built.time_step < 1e-5
    assert values["limited_by"] in ("stretch", "bending", "contact")
    # every stage takes its loading time, at steps that are at most the first one
    assert planned.steps >= built.loading_time / built.time_step


def test_text_says_what_the_numbers_say():
    planned = make_plan(load_scene(PATCH), "cpu")
    text = "\n".join(f"{line.name.strip()}: {line.text}" for line in planned.table().lines(verbose=True))
    assert f"{planned.nodes:,} nodes on {planned.wires} wires" in text
    assert f"{planned.bodies} clasps, {2 * planned.bodies} pairs" in text
    assert all(sentence in text for sentence in planned.physics)
    assert "unknown on a GPU" in table_of(replace(planned, device="cuda:0").table().lines())["time"]


TRICOT_CELL = {
    "wire": {"diameter": "30 um"}, "knit": {"bars": TRICOT, "wales": "26 /inch", "courses": "30 /inch"},
    "model": {"kind": "spatial", "boundary": "periodic"}, "contact": {"friction": 0.0}, "variants": {"count": 1},
    "solver": {"preset": "draft"},
}  # fmt: skip
BY_TENSION = {"load.tension_weft": "1 N/m", "load.tension_warp": "1 N/m", "output.frames": 5}
WIRES = ROOT / "scenes" / "wires" / "plain_knit_spatial.toml"
SPATIAL_CELL = ROOT / "scenes" / "atlas_cell_spatial.toml"


@pytest.mark.parametrize(
    ("source", "overrides"),
    [
        (CELL, {}),
        (CELL, {"load.tension_weft": "5 mN/m", "load.tension_warp": "5 mN/m", "solver.preset": "draft", "output.frames": 5}),
        (CELL, {"solver.drive": "ramp", "output.frames": 2, "solver.loading_time": 0.004, "solver.preset": "draft"}),
        (HOOK, {"output.frames": 5}),
        *slow((PATCH, {"solver.preset": "draft", "output.frames": 8, "knit.repeats": [4, 4]})),
        *slow((SPATIAL_CELL, {"output.frames": 5})),
        *slow((SPATIAL_CELL, {"solver.preset": "draft", "knit.repeats": [2, 2], "output.frames": 4})),
        (TRICOT_CELL, {"load.strain_weft": 0.06, "load.strain_warp": 0.06, "output.frames": 5}),
        *slow((TRICOT_CELL, BY_TENSION)),
        *slow((WIRES, {"output.frames": 4})),
    ],
)  # fmt: skip
def test_steps_are_within_a_factor_of_two(source: Path | dict, overrides: dict) -> None:
    """Of a sample run that ends before the load, but for the coarsest of these scenes."""
    scene = load_scene(source, overrides)
    simulation = Simulation(build_model(scene))
    for _record in simulation.run():
        pass
    run = make_plan(scene, "cpu").run
    assert 0.5 < run.steps / simulation.progress.steps < 2.0
    assert run.least_steps <= run.steps <= run.most_steps


def test_the_rest_of_a_load_takes_the_steps_of_the_levels_measured() -> None:
    """500 steps to a tenth, 100 and 300 to each of two more: the last 0.7 takes 7 x 200 steps, at least 7 x 100, at most 7 x 300.
    The first level begins with the mesh as knitted, and does not count."""
    run = SampleRun(build_model(load_scene(CELL)), marks=[(0.0, 0), (0.1, 500), (0.2, 600), (0.3, 900)])
    assert run.path_steps() == pytest.approx((900 + 700, 900 + 1400, 900 + 2100))


FLAT = "wire,x [mm],y [mm],z [mm]\n1,0,0,0\n1,3,3,0\n2,0,3,0\n2,3,0,0\n"  # two wires that meet


@pytest.mark.parametrize(
    ("name", "overrides", "line"),
    [
        ("wires/plain_knit_cell.toml", ["wires.node_spacing=1e-6"], "wires.node_spacing: "),
        ("wires/plain_knit_patch.toml", ["wires.node_spacing=0.02"], "its clamps hold four"),
        (None, [], "wires 1 and 2 "),
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


@pytest.mark.parametrize(("precision", "share"), [("single", 0.55), ("double", 0.65)])
def test_memory_per_node_covers_the_arrays(precision, share):
    """The arrays of a stepping mesh, with those of its last level, take `share` of MEMORY_PER_NODE, to 10 points; copies made by
    exports the rest.

    What a repeat or a launch takes once is small beside 86,400 nodes.
    """
    scene = load_scene(CELL, ["knit.repeats=[20, 20]", f'solver.precision="{precision}"'])
    built = build_model(scene)
    state = initial_state(built)
    simulation = Simulation(built, state)
    simulation.mechanics.neighbours.search()
    reading = read(built, state)
    total = array_bytes([built, state, simulation, reading], set())
    assert total / built.panel.node_count / MEMORY_PER_NODE["planar", precision][0] == pytest.approx(share, abs=0.1)


def array_bytes(thing, seen):
    """Bytes of all arrays below some objects, each once."""
    if id(thing) in seen or isinstance(thing, (str, int, float, type, wp.Launch)):
        return 0
    seen.add(id(thing))
    if isinstance(thing, np.ndarray):
        return thing.nbytes if thing.base is None else 0
    if isinstance(thing, wp.array):  # parts of an array have its memory
        return 0 if ("memory", thing.ptr) in seen or seen.add(("memory", thing.ptr)) else thing.capacity
    if isinstance(thing, (list, tuple)):
        return sum(array_bytes(part, seen) for part in thing)
    if is_dataclass(thing):
        return sum(array_bytes(getattr(thing, field.name), seen) for field in fields(thing))
    if type(thing).__module__.startswith("warpknit."):
        return sum(array_bytes(part, seen) for part in vars(thing).values())
    return 0


def test_what_cannot_fit_is_refused_and_says_how_much(monkeypatch):
    monkeypatch.setattr(memory, "available_memory", lambda device="cpu": 2**30)
    with pytest.raises(MemoryNeeded, match=r"knit.repeats = \[1000000, 1000000\]: .* GiB.* 1 GiB "):
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
    assert overview_of(load_scene(CELL)).device == "cpu"


def test_a_knit_that_cannot_be_made_is_refused():
    with pytest.raises(KnitError):
        make_plan(make_scene({"knit": {"bars": [{"chain": "1-0/1-2", "threading": "|."}]}}), "cpu")
