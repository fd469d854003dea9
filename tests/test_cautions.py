"""What a run says of its own result because of what was asked for; odd constants and loads are in test_extremes.py."""

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from reference.in_words import codes, quantities, table_of
from warpknit.commands.plan import overview_of
from warpknit.knit.centreline import Thread
from warpknit.knit.cloth import Cloth
from warpknit.knit.straight_wires import ROUNDED, least_length
from warpknit.mesh.layout import knit_scene
from warpknit.results.finding import ResultWarning
from warpknit.results.row import Row, Values
from warpknit.runner import cautions as of_input
from warpknit.runner import warnings_of as of_result
from warpknit.runner.run import run_scene
from warpknit.runner.summary import Summary
from warpknit.runner.summary_table import _earlier_steps, _mesh_findings, summary_findings
from warpknit.scene import Scene, load_scene, make_scene
from warpknit.solve.model import build_model

SCENE = Path(__file__).parents[1] / "scenes" / "friction_cycle.toml"  # to 16 % and back
OVERLOAD = SCENE.with_name("overload.toml")  # molybdenum that yields at 0.6 GPa


def planned(scene: Scene, *device: str) -> list[ResultWarning]:
    """The warnings of a plan."""
    return list(overview_of(scene, *device).warnings)


@pytest.mark.parametrize(
    ("load", "says"), [("strain_warp=0", True), ("strain_warp=0.1", False), ("tension_warp=0", False), ("temperature=200", False)]
)
def test_a_scene_without_load_is_named(load: str, says: bool) -> None:
    scene = load_scene(SCENE.with_name("wires") / "plain_knit_patch.toml", (f"load.{load}",))
    assert ("W24" in codes(of_input.scene_cautions(scene, None))) == says


@pytest.mark.parametrize(("nodes", "says"), [(8, True), (12, False)])
def test_few_nodes_are_named(nodes: int, says: bool) -> None:
    model = build_model(load_scene(SCENE, (f"model.nodes_per_loop={nodes}",)))
    assert ("W25" in codes(of_input.scene_cautions(model.scene, model.cloth))) == says


@pytest.mark.parametrize(("share", "says"), [(1.01, True), (0.99, False)])
def test_a_tension_beyond_all_wires_at_their_limit_is_named(share: float, says: bool) -> None:
    """Tensions of weft and warp add up to axial force times length of the wires in an area: elastic limit x section x length."""
    scene = load_scene(SCENE.with_name("contact_map.toml"))
    cloth = build_model(scene).cloth
    wire = scene.wire
    most = wire.yield_stress * math.pi * wire.radius**2 * cloth.wire_per_area
    stage = replace(
        scene.stages[0], strain_weft=None, strain_warp=None, tension_weft=0.5 * share * most, tension_warp=0.5 * share * most
    )
    assert ("W26" in codes(of_input.scene_cautions(replace(scene, stages=(stage,)), cloth))) == says


def summary_of(*ends: Row) -> Summary:
    """The result of a run with these ends of its stages."""
    model, solver = Values(kind="planar", kind_reason="", source="knit", nodes=1), Values(steps=1, wall_s=1.0, compile_s=0.0)
    return Summary(Values(name="", hash=""), "steady", model, solver, stages=ends)


def stressed(plastic: bool, tension: float, **wire: float) -> list[ResultWarning]:
    """Warnings of a run with a stress of 700 MPa, above the elastic limit of 0.6 GPa."""
    model = build_model(load_scene(OVERLOAD, (f"wire.plastic={'true' if plastic else 'false'}",)))
    row = Row(stress_max_Pa=7e8, active_pairs=0)
    return list(of_result._overstressed(model, [row], [Row(stress_interior_max_Pa=tension, yield_fraction=0.1, **wire)]))


def test_an_elastic_wire_above_its_limit_claims_no_set() -> None:
    (said,) = stressed(False, 7e8)
    assert said.code == "W04" and "700 MPa" in said.text and "600 MPa" in said.text
    assert said.advice is not None and "wire.plastic" in said.advice


def test_the_largest_stress_of_a_run_has_its_load_step() -> None:
    model = build_model(load_scene(OVERLOAD))
    rows = [Row(stress_max_Pa=stress, stage=stage, active_pairs=0) for stage, stress in (("stretched", 7e8), ("eclipse", 9e8))]
    ends = [Row(stress_interior_max_Pa=7e8, yield_fraction=0.1) for _ in rows]
    (said,) = of_result._overstressed(model, rows, ends)
    assert "900 MPa in 'eclipse'" in said.text


def test_a_plastic_wire_says_how_much_of_it_has_yielded() -> None:
    """Yield is by bending alone: a stress of bending and tension may be above the limit without it."""
    (said,) = stressed(True, 7e8, plastic_fraction=0.031, plastic_strain_max=0.0021)
    assert quantities(said.text)[-2:] == ["3.1 %", "0.21 %"] and said.advice is None
    (said,) = stressed(True, 7e8, plastic_fraction=0.0, plastic_strain_max=0.0)
    assert said.text.endswith("bending alone, which stays below.")


TRICOT = {
    "wire": {"material": "molybdenum", "diameter": "17 um", "ends": 4},
    "knit": {"bars": [{"chain": "1-0/1-2"}, {"chain": "1-2/1-0"}], "wales": "26 /inch", "courses": "30 /inch"},
    "model": {"boundary": "periodic", "kind": "spatial"},
    "contact": {"friction": 0.0},
    "variants": {"count": 1},
    "load": {"tension_weft": "2 N/m", "tension_warp": "2 N/m"},
}


def released(fraction: float, rows: list[Row]) -> list[ResultWarning]:
    """Warnings of a run of the tricot about its state before the load."""
    scene = make_scene(TRICOT | {"wire": TRICOT["wire"] | {"set_fraction": fraction}})
    return list(of_result._contacts_as_knitted(SimpleNamespace(scene=scene), rows))


def as_released(stress: float, strain_warp: float, tension_weft: float = 0.1) -> list[Row]:
    """The record before the load, and the first one under tension."""
    before = {"tension_weft_N_per_m": -2.68, "tension_warp_N_per_m": -0.64}
    behind = {"tension_weft_N_per_m": tension_weft, "tension_warp_N_per_m": 0.1}
    first = Row(stage="load", load_factor=0.0, steady=True, stress_max_Pa=stress, active_pairs=20, **before)
    return [first, Row(stage="load", load_factor=0.05, strain_weft=0.25, strain_warp=strain_warp, **behind)]


def test_release_beyond_the_strength_is_told_with_the_fraction_of_the_elastic_limit() -> None:
    """Stress is proportional to 1 - set_fraction: 3 GPa at 0.5 is 600 MPa at 1 - 0.5 0.6/3 = 0.9."""
    (said,) = released(0.5, as_released(3.0e9, -0.19))
    assert said.code == "W12" and {"3 GPa", "800 MPa"} <= set(quantities(said.text))
    assert {"19.0 %", "100 mN/m"} <= set(quantities(said.text))
    assert said.advice is not None and "wire.set_fraction = 0.9 " in said.advice
    (said,) = released(0.9, as_released(5.3e8, -0.03))
    assert said.code == "W14" and "20 active pairs" in said.text


@pytest.mark.parametrize(("strain", "tension_weft", "says"), [(-0.11, 0.1, True), (-0.09, 0.1, False), (-0.11, 0.3, False)])
def test_release_that_closes_the_knit_is_told(strain: float, tension_weft: float, says: bool) -> None:
    """Below the strength, by more than 10 % under the first tension; a larger tension across contracts any mesh."""
    (said,) = released(0.8, as_released(5.3e8, strain, tension_weft))
    assert ("shortens the mesh" in said.text) == says == (said.code == "W12")


def test_mean_curvature_of_a_wave() -> None:
    """x = a sin(2 pi y): the direction swings by 4 atan(2 pi a) a period."""
    y = np.arange(2000) / 2000
    points = np.stack([0.2 * np.sin(2 * np.pi * y), y, 0 * y], axis=1)
    length = float(np.linalg.norm(np.diff(np.vstack([points, [0.0, 1.0, 0.0]]), axis=0), axis=1).sum())
    line = Thread(points, length, np.zeros(2000, dtype=int), 0)
    cloth = Cloth(np.ones(2), 1, 1, "general", (line,), (), None, (), None, np.zeros(0, dtype=int))
    assert cloth.mean_curvature * length == pytest.approx(4 * math.atan(2 * math.pi * 0.2), rel=1e-3)


@pytest.mark.parametrize(("share", "says"), [(1.01, True), (0.99, False)])
def test_a_natural_curvature_that_no_wire_holds_is_told_by_the_plan(share: float, says: bool) -> None:
    """E d/2 (1 - f) k against a fully plastic round section at the strength, 16/(3 pi) times the stress at first yield."""
    scene = make_scene(TRICOT)
    cloth, wire = knit_scene(scene), scene.wire
    bent = wire.youngs_modulus * 0.5 * wire.diameter * cloth.mean_curvature
    released = replace(
        scene, wire=replace(wire, set_fraction=1.0 - share * 16.0 / (3.0 * math.pi) * wire.tensile_strength / bent)
    )
    found = list(of_input.release_cautions(released, cloth))
    assert bool(found) == says and list(of_input.release_cautions(scene, cloth)) == []
    least = 1.0 - 16.0 / (3.0 * math.pi) * wire.yield_stress / bent
    assert all(f"wire.set_fraction = {math.ceil(100 * least) / 100:g} " in str(one.advice) for one in found)
    assert (found == []) or found[0] in planned(released, "cpu")


@pytest.mark.parametrize("kind", ["planar", "spatial"])
@pytest.mark.parametrize("plastic", [True, False])
def test_summary_and_table_agree_on_yield(tmp_path: Path, kind: str, plastic: bool) -> None:
    """Keys of yield only where yield is computed; an elastic wire has the share that would yield."""
    changes = (f"wire.plastic={'true' if plastic else 'false'}", "path=[]", f"model.kind={kind}", "output.frames=1")
    strains = ("load.strain_weft=0.1", "load.strain_warp=0.1", "wire.yield_stress=1.5e8")
    few = (*strains, "output.usd=false", "output.figures=false", "solver.preset=draft")
    summary = run_scene(load_scene(OVERLOAD, (*changes, *few)), out=tmp_path / "run", device="cpu").summary
    wire, table = summary.json()["wire"], table_of(summary_findings(summary))
    assert wire["yield_fraction"] > 0.0
    assert ("plastic_fraction" in wire) is ("plastic_strain_max" in wire) is plastic
    assert ("  yielded" in table) is (plastic and wire["plastic_fraction"] > 0.0)
    assert ("  above yield" in table) is not plastic


TIGHT = [
    'wire.material="molybdenum"', 'wire.diameter="30 um"', 'knit.wale_spacing="0.98 mm"', 'knit.course_spacing="0.85 mm"',
    'knit.bars=[{chain="1-0/1-2"},{chain="1-2/1-0"}]',
]  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "frames", "says"), [(TIGHT, 6, True), (TIGHT, 7, False), ([], 1, False)], ids=["few", "many", "open"]
)
def test_a_tight_knit_asks_for_small_increments(changes: list[str], frames: int, says: bool) -> None:
    """1.5 % or less: 10 % in seven."""
    scene = load_scene(SCENE.with_name("atlas_cell_spatial.toml"), [*changes, f"output.frames={frames}"])
    assert ("W32" in codes(of_input.scene_cautions(scene, build_model(scene).cloth))) == says


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        (["solver.preset=standard"], True),
        (["solver.preset=draft"], True),
        (["solver.preset=reference"], False),
        (["solver.preset=standard", "model.kind=planar"], False),
    ],
    ids=["standard", "draft", "reference", "planar"],
)
def test_a_plan_says_what_is_known_of_tight_knits_at_a_preset(changes: list[str], says: bool) -> None:
    scene = load_scene(SCENE.with_name("atlas_cell_spatial.toml"), [*TIGHT, *changes])
    assert ("preset reference at nine of ten loads" in overview_of(scene, "cpu").accuracy) == says


def test_a_wire_hooked_once_each_way_needs_the_polygon_through_its_hooks() -> None:
    """One wire that hooks the same wire a repeat W to the right once a height H: W to there and sqrt(W^2 + H^2) back to its next
    copy, wherever the hook lies. Under F the repeat is F (W, 0), F (0, H). Each of both pieces is rounded by ROUNDED, down."""
    arms = SimpleNamespace(thread=0, column=0, arc=0.0), SimpleNamespace(thread=0, column=1, arc=0.4)
    clasp, thread = SimpleNamespace(position=np.array([0.3, 0.1]), arms=arms), SimpleNamespace(length=1.0)
    cloth = SimpleNamespace(threads=[thread], clasps=[clasp], size=np.array([2.0, 3.0]))
    for weft, warp in ((1.0, 1.0), (1.5, 1.0), (1.2, 0.8)):
        expected = 2.0 * weft + math.hypot(2.0 * weft, 3.0 * warp)
        assert least_length(cloth, np.diag([weft, warp])) == pytest.approx(expected, rel=0.0, abs=2 * ROUNDED * 3.0)


GAUGE = {"wales": "26 /inch", "courses": "30 /inch"}
KNITS = {
    "double atlas": {},  # that of the paper
    "tricot": {"bars": [{"chain": "1-0/1-2"}, {"chain": "1-2/1-0"}], **GAUGE},
    "atlas": {"bars": [{"chain": "1-0/1-2/2-3/3-4/3-2/2-1"}], **GAUGE},
    "reverse locknit": {"bars": [{"chain": "2-3/1-0"}, {"chain": "1-0/1-2"}], **GAUGE},
}


@pytest.mark.parametrize(
    ("knit", "reached", "beyond"),
    [("double atlas", 1.0, 1.3), ("tricot", 0.5, 0.7), ("atlas", 1.0, 1.3), ("reverse locknit", 0.5, 0.7)],
)
def test_a_strain_beyond_straight_wires_is_named(knit: str, reached: float, beyond: float) -> None:
    """The wires of a repeat laid straight from hook to hook reach some strain in both directions, and none beyond."""
    for strain, says in ((reached, False), (beyond, True)):
        load = {"strain_weft": strain, "strain_warp": strain}
        wire = {"material": "molybdenum", "diameter": "30 um"}
        scene = load_scene({"wire": wire, "knit": KNITS[knit], "model": {"boundary": "periodic"}, "load": load})
        assert codes(of_input.scene_cautions(scene, knit_scene(scene))).count("W27") == says


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"load": {"strain_warp": 0.5, "tension_weft": "1 N/m"}}, False),
        ({"load": {"strain_warp": 1.5, "tension_weft": "1 N/m"}}, True),
        ({"load": {"tension_warp": "1 N/m", "tension_weft": "1 N/m"}}, False),
        ({"sweep": {"strain_weft": [0.7, 0.1], "strain_warp": [0.0, 0.5]}}, False),
        ({"sweep": {"strain_weft": [0.9, 0.1], "strain_warp": [0.0, 0.9]}}, True),
    ],
)
def test_straight_wires_bound_stages_by_tension_and_the_largest_pair_of_a_sweep(given: dict[str, dict], says: bool) -> None:
    """A direction under tension may contract to nothing: 150 % in warp is then still beyond the wires of a tricot."""
    wire = {"material": "molybdenum", "diameter": "30 um"}
    scene = load_scene({"wire": wire, "knit": KNITS["tricot"], "model": {"boundary": "periodic"}} | given)
    cloth = knit_scene(scene)
    assert codes([*of_input.scene_cautions(scene, cloth), *of_input.sweep_cautions(scene, cloth)]).count("W27") == says


@pytest.mark.parametrize(("share", "says"), [(1.01, True), (0.99, False)])
def test_the_largest_tensions_of_a_sweep_have_the_bound_of_a_stage(share: float, says: bool) -> None:
    scene = load_scene(SCENE.with_name("contact_map.toml"))
    cloth = knit_scene(scene)
    half = 0.5 * share * scene.wire.yield_stress * math.pi * scene.wire.radius**2 * cloth.wire_per_area
    sweep = replace(scene.sweep, strain_weft=None, strain_warp=None, tension_weft=(0.1, half), tension_warp=(half, 0.2))
    assert ("W26" in codes(of_input.sweep_cautions(replace(scene, sweep=sweep), cloth))) == says


def test_the_table_names_the_last_load_step(tmp_path: Path) -> None:
    table = table_of(summary_findings(summary_of(Row(stage="load", displacement_m=0.0), Row(stage="cold", temperature_K=83.15))))
    assert quantities(table["load step"]) == ["2"]


def test_the_table_has_a_row_of_each_stage_before_the_last(tmp_path: Path) -> None:
    """Strains, tensions, share of active contacts, largest stress and temperature."""
    mesh = {"strain_weft": 0.096, "strain_warp": 0.093, "temperature_K": 293.15}
    mesh |= {"tension_weft_N_per_m": 0.2, "tension_warp_N_per_m": 0.1}
    end = Row(stage="load", **mesh, active_percent=66.67, stress_max_Pa=224.7e6)
    table = table_of(_earlier_steps([end, Row(stage="cold")]))
    assert table["  end of load"] == "9.60 % weft, 9.30 % warp; 200 mN/m weft, 100 mN/m warp; 67 % active; 225 MPa; 20 degC"


@pytest.mark.parametrize(
    ("given", "says"), [(20, True), ("20", True), ("20 K", False), ("20 degC", False), (120, False), (293.15, False)]
)
@pytest.mark.parametrize("place", ["load", "path"])
def test_a_cold_temperature_without_a_unit_is_named(given: float | str, says: bool, place: str) -> None:
    """A bare 20 is 20 K, and was probably meant as 20 degC."""
    stage = {"temperature": given}
    scene = load_scene(
        {"load": {"strain_warp": 0.1} | (stage if place == "load" else {})} | ({"path": [stage]} if place == "path" else {})
    )
    found = [one for one in of_input.scene_cautions(scene, None) if one.code == "W29"]
    assert bool(found) == says and all("20 is -253.15 degC" in one.text for one in found)


def test_a_tension_within_the_tolerance_is_zero_in_every_row(tmp_path: Path) -> None:
    """3.58 mN/m beside 9.22 N/m, with a tolerance of 10 mN/m, as in the rows of the answers."""
    mesh = {"tension_weft_N_per_m": 9.22, "tension_warp_N_per_m": 3.58e-3, "strain_weft": 0.1, "strain_warp": 0.1}
    end = Row(stage="load", **mesh, active=1, pairs=2, active_percent=50.0, force_max_N=1.0)
    result = replace(summary_of(end), answers=Values(tension_tolerance_N_per_m=0.01))
    assert table_of(_mesh_findings(result, "", ""))["tension"] == "9.22 N/m weft, 0 N/m warp"


@pytest.mark.parametrize(("text", "told"), [("", True), ("# later", True), ("[load]\nstrain_warp = 0.1", False)])
def test_an_empty_file_is_told(text: str, told: bool, tmp_path: Path) -> None:
    """It is planned with all defaults. A dict without keys in code is meant so."""
    (tmp_path / "a.toml").write_text(text)
    scene = load_scene(tmp_path / "a.toml", ["output.frames=2"])
    assert ("W21" in codes(planned(scene))) == told
    assert not load_scene({}).is_empty


@pytest.mark.parametrize(("repeats", "few"), [((1, 1), True), ((2, 2), True), ((4, 6), False), ((12, 12), False)])
def test_a_patch_of_fragments_is_told_by_the_plan_and_the_run(repeats: tuple[int, int], few: bool) -> None:
    """Grips cut a tile: wires of less than a loop are a tenth of its wire or more. Larger patches and tiles of endless cloth have
    next to none, although as many of their wires are short."""
    scene = load_scene({"load": {"strain_warp": 0.02}}, {"knit.repeats": list(repeats)}, "draft")
    model = build_model(scene)
    length = model.panel.wire_length
    is_short = length < model.cloth.stitch_length
    short = np.count_nonzero(is_short)
    assert (length[is_short].sum() >= 0.1 * length.sum()) == few
    for warnings in (planned(scene), of_result.warnings_of(model, [])):
        told = [one.text for one in warnings if one.code == "W20"]
        assert len(told) == few
        assert not few or told[0].startswith(f"{short} of {len(length)} wires")
    assert "W20" not in codes(planned(scene.changed({"model.boundary": "periodic"})))


def test_pieces_of_less_than_a_loop_between_grips_are_counted_where_one_is_taut() -> None:
    """The edge of a patch cuts pieces of less than a loop. A long wire, a stress like that of others, or a tile say nothing."""
    model = build_model(load_scene(SCENE.with_name("atlas_patch.toml"), ["knit.repeats=[4, 3]"]))
    length = model.panel.wire_length
    short, long = int(np.argmin(length)), int(np.argmax(length))
    assert length[short] < model.cloth.stitch_length < length[long]

    def said(wire: int, largest: float, of: object = model, part: float = 0.0) -> list[str]:
        stress = {"stress_max_wire": wire, "stress_max_Pa": largest, "stress_interior_max_Pa": 1e8}
        mesh = {"tension_weft_N_per_m": 2.0, "fragment_tension_weft_N_per_m": part, "tension_warp_N_per_m": 1.0}
        return [one.text for one in of_result._taut_between_grips(of, [Row(**stress, **mesh)])]

    (line,) = said(short, 2e9)
    assert {"2 GPa", "100 MPa"} <= set(quantities(line))
    tile = build_model(load_scene(SCENE.with_name("atlas_cell.toml")))
    assert not said(long, 2e9) and not said(short, 2e8) and not said(0, 2e9, tile) and not said(long, 2e9, part=0.2)
    (line,) = said(long, 2e9, part=1.0)
    assert "50 %" in quantities(line)


def test_bars_that_are_given_twice_and_even_chains_are_reported():
    def found(*chains):
        scene = load_scene({"knit": {"bars": [{"chain": chain} for chain in chains]}, "load": {"strain_weft": 0.01}})
        return [one.text for one in of_input.scene_cautions(scene, None) if one.code in ("W22", "W23")]

    assert found("2-3/1-0", "1-0/1-2") == []
    assert found("1-0/1-2", "2-3/1-0", "1-0/1-2") == ["knit.bars[0] and knit.bars[2] are the same: every loop has both wires."]
    assert found("4-6/2-0", "2-0/2-4") == ["Chains in even numbers count half needles: 4-6/2-0 as 2-3/1-0, 2-0/2-4 as 1-0/1-2."]


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("wire.youngs_modulus", "320 MPa", True),
        ("wire.density", "10 g/cm^3", False),
        ("contact.friction", 0.5, False),
        ("contact.friction", 5.0, True),
    ],
)
def test_a_constant_of_no_metal_is_named(key: str, value: float | str, says: bool) -> None:
    found = [one for one in of_input.scene_cautions(load_scene(SCENE, {key: value}), None) if one.code == "W28"]
    assert [one.text.split()[0] for one in found] == [key] * says
