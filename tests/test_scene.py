"""The scene: defaults, what follows from other values, overrides, and what it shares with the knit."""

import math
from dataclasses import fields
from pathlib import Path

import pytest
from pydantic_core import PydanticCustomError

from warpknit.knit import loops
from warpknit.knit.cloth import knit_cloth
from warpknit.scene import SceneError, load_scene, make_scene
from warpknit.scene.knit import Loop
from warpknit.scene.materials import MATERIALS
from warpknit.scene.presets import PRESETS

SCENES = Path(__file__).parent.parent / "scenes"


# --- defaults and derived values


def test_the_patch_is_the_papers_mesh():
    scene = load_scene(SCENES / "atlas_patch.toml")
    assert scene.name == "atlas_patch"
    assert scene.wire.diameter == 15e-6
    assert scene.wire.youngs_modulus == 400e9
    assert scene.knit.size == pytest.approx((23.8e-3, 24e-3), rel=1e-12)
    assert scene.model.boundary == "gripped"
    assert scene.model.body_radius == 15e-6 / 8
    assert [(stage.strain_weft, stage.strain_warp, stage.temperature) for stage in scene.stages] == [(0.1, 0.1, 293.15)]


def test_the_cell_is_one_periodic_repeat_of_the_patch():
    cell, patch = load_scene(SCENES / "atlas_cell.toml"), load_scene(SCENES / "atlas_patch.toml")
    assert cell.model.boundary == "periodic"
    assert cell.knit.repeats == (1, 1)
    assert cell.wire == patch.wire
    assert make_scene({}, ["model.boundary=periodic"]).knit == cell.knit


def test_a_million_repeats_are_a_valid_scene():
    """Whether they fit in memory is for the model to say."""
    assert make_scene({}, ["knit.repeats=[1000000000, 1000000000]"]).knit.repeats == (10**9, 10**9)


def test_counts_per_length_stand_for_spacings():
    knit = make_scene({"knit": {"wales": "5 /cm", "courses": "10 /cm"}}).knit
    assert (knit.wale_spacing, knit.course_spacing) == (2e-3, 1e-3)


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_fills_in_what_the_scene_leaves_out(name):
    scene, preset = make_scene({"model": {"kind": "planar"}}, preset=name), PRESETS[name]["planar", "relax"]
    assert scene.solver.preset == name
    assert scene.model.nodes_per_loop == preset.nodes_per_loop
    assert scene.solver.axial_softening == preset.axial_softening
    assert scene.solver.precision == preset.precision
    assert scene.solver.residual_tolerance == preset.residual_tolerance


def test_keys_of_the_scene_stand_before_the_preset():
    model = {"kind": "planar", "nodes_per_loop": 50}
    scene = make_scene({"model": model, "solver": {"preset": "draft", "precision": "double"}})
    assert scene.model.nodes_per_loop == 50
    assert scene.solver.precision == "double"
    assert scene.solver.axial_softening == PRESETS["draft"]["planar", "relax"].axial_softening


def test_the_preset_of_the_command_line_stands_before_the_files():
    assert make_scene({"solver": {"preset": "draft"}}, preset="reference").solver.preset == "reference"


def test_wire_stiffness_and_mass_of_a_round_section():
    """EA = E pi d^2/4, EI = E pi d^4/64, mass per length = rho pi d^2/4."""
    wire = make_scene({}).wire
    area = math.pi * wire.diameter**2 / 4
    assert wire.axial_stiffness == pytest.approx(400e9 * area, rel=1e-12)
    assert wire.bending_stiffness == pytest.approx(400e9 * math.pi * wire.diameter**4 / 64, rel=1e-12)
    assert wire.linear_density == pytest.approx(19250 * area, rel=1e-12)


@pytest.mark.parametrize(("material", "stiffer", "heavier"), [("tungsten", 0.022, 0.054), ("molybdenum", 0.027, 0.102)])
def test_plating_of_gold_adds_stiffness_and_mass(material, stiffer, heavier):
    """An annulus of thickness t: EI grows by E_Au/E ((1 + 2t/d)^4 - 1), mass by rho_Au/rho ((1 + 2t/d)^2 - 1)."""
    bare = make_scene({"wire": {"material": material}}).wire
    plated = make_scene({"wire": {"material": material, "plating": {"thickness": "0.2 um"}}}).wire
    assert plated.bending_stiffness / bare.bending_stiffness - 1 == pytest.approx(stiffer, abs=5e-4)
    assert plated.linear_density / bare.linear_density - 1 == pytest.approx(heavier, abs=5e-4)


def test_parallel_ends_add_up():
    one, three = make_scene({}).wire, make_scene({}, ["wire.ends=3"]).wire
    assert three.axial_stiffness == 3 * one.axial_stiffness
    assert three.bending_stiffness == 3 * one.bending_stiffness
    assert three.linear_density == 3 * one.linear_density


def test_a_key_of_the_wire_stands_before_its_material():
    wire = make_scene({"wire": {"material": "molybdenum", "expansion": "5.1e-6 /K"}}).wire
    assert wire.expansion == 5.1e-6
    assert wire.density == MATERIALS["molybdenum"].density


def test_displacement_of_every_side_stretches_by_twice_itself():
    stage = load_scene(SCENES / "atlas_patch.toml", ["load.displacement=1.2 mm"]).stages[0]
    assert (stage.strain_weft, stage.strain_warp) == pytest.approx((2.4 / 23.8, 2.4 / 24.0), rel=1e-12)


def test_a_stage_takes_over_what_it_leaves_out():
    stages = make_scene(
        {
            "load": {"strain_weft": 0.1, "tension_warp": "2 N/m"},
            "path": [
                {"name": "cold", "temperature": "-190 degC"},
                {"tension_weft": 1},
                {"strain_warp": 0, "shear": 0.05},
            ],
        }
    ).stages
    told = [(s.name, s.strain_weft, s.tension_weft, s.strain_warp, s.tension_warp, s.shear, s.temperature) for s in stages]
    assert told == [
        ("load", 0.1, None, None, 2.0, 0.0, 293.15),
        ("cold", 0.1, None, None, 2.0, 0.0, 83.15),
        ("stage-3", None, 1.0, None, 2.0, 0.0, 83.15),
        ("stage-4", None, 1.0, 0.0, None, 0.05, 83.15),
    ]


def test_without_a_temperature_the_wire_stays_where_it_is_free_of_thermal_strain():
    assert make_scene({"wire": {"reference_temperature": "300 K"}}).stages[0].temperature == 300.0


# --- overrides


@pytest.mark.parametrize("text", ["17 um", '"17 um"', "17e-6", " 17e-6 "])
def test_an_override_is_toml_or_a_plain_string(text):
    assert make_scene({}, [f"wire.diameter={text}"]).wire.diameter == 17e-6


def test_an_override_takes_the_place_of_the_other_way_to_say_it(caplog):
    table = {"load": {"strain_weft": 0.1, "strain_warp": 0.1}, "knit": {"wale_spacing": "1.7 mm"}}
    with caplog.at_level("INFO", logger="warpknit"):
        scene = make_scene(table, ["load.tension_weft=2 N/m", "knit.wales=5 /cm", "load.strain_warp=0.1"])
    assert caplog.messages == [
        "load.tension_weft replaces load.strain_weft = 0.1",
        "knit.wales replaces knit.wale_spacing = '1.7 mm'",
    ]
    assert (scene.stages[0].strain_weft, scene.stages[0].tension_weft) == (None, 2.0)
    assert scene.stages[0].strain_warp == 0.1
    assert scene.knit.wale_spacing == 2e-3
    assert table == {"load": {"strain_weft": 0.1, "strain_warp": 0.1}, "knit": {"wale_spacing": "1.7 mm"}}


def test_two_overrides_that_say_it_twice_are_refused():
    with pytest.raises(SceneError, match="load.strain_weft|strain_weft = 0.1"):
        make_scene({}, ["load.strain_weft=0.1", "load.tension_weft=2"])


def test_an_override_makes_the_stage_it_names():
    assert [stage.name for stage in make_scene({}, ["path[0].name=hot"]).stages] == ["load", "hot"]


# --- agreement with the knit


def test_loop_defaults_and_ranges_are_those_of_the_knit():
    defaults = make_scene({}).knit.loop
    assert {f.name for f in fields(loops.LoopProportions)} == set(Loop.keys)
    for proportion in fields(loops.LoopProportions):
        assert getattr(defaults, proportion.name) == proportion.default
    for name, (low, high) in loops.RANGES.items():
        check = Loop.keys[name].check
        for value in (low, high):
            assert check(value) == value
        for value in (low - 1e-6, high + 1e-6):
            with pytest.raises(PydanticCustomError):
                check(value)


def test_the_size_of_the_panel_is_that_of_the_knit():
    scene = load_scene(SCENES / "atlas_cell.toml")
    assert scene.knit.size == pytest.approx(tuple(knit_cloth(scene.knit, scene.wire.diameter).size), rel=1e-12)


def test_fine_nodes_are_double_unless_said():
    """Round-off of single precision grows as EI/h^2: many nodes a loop default to double."""
    fine = {"kind": "planar", "nodes_per_loop": 60}
    assert make_scene({"model": fine}).solver.precision == "double"
    assert make_scene({"model": fine, "solver": {"precision": "single"}}).solver.precision == "single"


def knit_of(*chains):
    """A scene with one bar for each chain."""
    bars = [{"chain": chain} for chain in chains]
    return make_scene({"knit": {"bars": bars, "wales": "26 /inch", "courses": "33 /inch"}})


@pytest.mark.parametrize(
    ("chains", "even"),
    [
        (("2-3/1-0//", "1-0/1-2 //"), ()),
        (("2-3 / 1-0", " 1-0 / 1-2 "), ()),
        (("4-6/2-0", "2-0/2-4//"), ("4-6/2-0 as 2-3/1-0", "2-0/2-4 as 1-0/1-2")),
    ],
)
def test_chains_as_they_are_published_are_the_same_knit(chains, even):
    """// ends a chain; where all numbers of all bars are even, a needle counts two."""
    plain, published = knit_of("2-3/1-0", "1-0/1-2"), knit_of(*chains)
    assert published == plain and published.hash == plain.hash and published.knit.repeat == plain.knit.repeat
    assert published.even_chains == even and plain.even_chains == ()


def test_inlays_with_even_numbers_stay_beside_odd_ones():
    bars = knit_of("0-0/2-2", "1-0/0-1").knit.bars
    assert [bar.chain for bar in bars] == ["0-0/2-2", "1-0/0-1"]
    assert [bar.chain for bar in knit_of("0-0/4-4", "2-0/0-2").knit.bars] == ["0-0/2-2", "1-0/0-1"]


@pytest.mark.parametrize("chain", ["2-3-3/1-0-0", "2-3/1-0-1"])
def test_links_of_three_numbers_are_refused_by_name(chain):
    with pytest.raises(SceneError, match="write (2-3|1-0)") as caught:
        knit_of(chain, "1-0/1-2")
    assert caught.value.key == "knit.bars[0].chain"


def test_repeats_that_are_written_out_make_a_larger_repeat_of_the_same_knit():
    """Twice the courses with the same loops: wire a loop, and hooks a loop."""
    short, long = knit_of("2-3/1-0", "1-0/1-2"), knit_of("2-3/1-0/2-3/1-0", "1-0/1-2/1-0/1-2")
    cloth, twice = (knit_cloth(scene.knit, scene.wire.thickness) for scene in (short, long))
    assert long.knit.repeat == (short.knit.repeat[0], 2.0 * short.knit.repeat[1])
    assert len(twice.stitches) == 2 * len(cloth.stitches) and len(twice.clasps) == 2 * len(cloth.clasps)
    assert twice.wire_length == pytest.approx(cloth.wire_length, rel=1e-9)
