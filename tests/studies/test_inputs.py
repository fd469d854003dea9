"""What a user knows of a mesh is put into its scene."""

import json
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from reference.cases import slow
from reference.in_words import key_of, quantities
from warpknit import measure
from warpknit.base.errors import InputError
from warpknit.commands.report import lengths_of
from warpknit.knit.named import named_knit
from warpknit.mesh.layout import knit_scene
from warpknit.planar.observables import read
from warpknit.planar.state import initial_state
from warpknit.results.run import load_run
from warpknit.runner.progress_display import Display
from warpknit.scene import load_scene, make_scene
from warpknit.solve.model import build_model
from warpknit.studies import inputs
from warpknit.studies.inputs import (
    COLUMNS,
    POOR_FIT,
    Known,
    fit_curve,
    fit_loop_length,
    fit_run_in,
    fitted_overrides,
    openings_per_length,
    with_known,
    with_openings,
    write_fit,
)
from warpknit.studies.load_path import states_at
from warpknit.studies.sections import Page, mesh_section

SCENE = Path(__file__).parents[2] / "scenes" / "contact_map.toml"
INCH = 0.0254


@pytest.fixture(scope="module")
def scene():
    return load_scene(SCENE, ["output.frames=3"], "draft")


def test_the_double_atlas_has_two_openings_a_repeat(scene):
    """A repeat of 2 wales and 4 courses: sqrt(2/(2 W 4 C)) openings per length."""
    knit = scene.knit
    expected = np.sqrt(2.0 / (8.0 * knit.wale_spacing * knit.course_spacing))
    assert openings_per_length(scene) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("name", "loops"),
    [("tricot", 2), ("open-tricot", 2), ("locknit", 2), ("reverse-locknit", 2), ("atlas", 6), ("full-double-atlas", 4)],
)
def test_a_fully_threaded_knit_has_an_opening_for_each_wale_and_course(name, loops):
    """Of W x C each, 1 / sqrt(W C) per length; a repeat is one wale wide and so many courses long."""
    knit = {"bars": [vars(bar) for bar in named_knit(name).bars], "wales": "26 /inch", "courses": "30 /inch"}
    made = load_scene({"wire": {"diameter": "30 um"}, "knit": knit, "model": {"boundary": "periodic"}})
    assert inputs.complete_openings(made)[0] == loops
    assert openings_per_length(made) == pytest.approx(np.sqrt(26.0 * 30.0) / INCH)


@pytest.mark.parametrize(("factor", "says"), [(1.2, False), (1.3, True), (0.85, False), (0.75, True)])
def test_openings_that_change_the_spacings_by_more_than_a_quarter_are_told(scene, factor, says):
    notes = with_openings(scene, factor * openings_per_length(scene)).notes
    assert any("change both spacings by a factor of" in note for note in notes) == says


def test_scatter_of_the_loops_does_not_change_what_an_opening_is(scene):
    scattered = replace(scene, knit=replace(scene.knit, scatter=0.1))
    assert openings_per_length(scattered) == openings_per_length(scene)


def test_wales_and_courses_follow_from_openings(scene):
    """Twice the openings per length halve both spacings; what comes out has what was asked."""
    wanted = 12.0 / INCH
    found = with_openings(scene, wanted).scene
    assert openings_per_length(found) == pytest.approx(wanted, rel=1e-9)
    ratio = scene.knit.wale_spacing / scene.knit.course_spacing
    assert found.knit.wale_spacing / found.knit.course_spacing == pytest.approx(ratio)
    with pytest.raises(InputError, match="at most"):
        with_openings(scene, 1e6)


def test_loops_of_any_shape_take_numbers_of_numpy():
    """As a fit sets them: the general loops of a single atlas."""
    scene = load_scene(SCENE, ['knit.bars=[{chain="1-0/1-2/2-3/2-1"}]', "knit.repeats=[1,1]"])
    proportions = replace(scene.knit.loop, foot_half_width=np.float64(0.1))
    found = knit_scene(replace(scene, knit=replace(scene.knit, loop=proportions)))
    same = knit_scene(replace(scene, knit=replace(scene.knit, loop=replace(proportions, foot_half_width=0.1))))
    assert found.stitch_length == same.stitch_length


def test_loops_are_fitted_to_their_wire_length(scene):
    """The knitted loop has the length that was asked for, within what the tolerance of the factor makes of it."""
    found = fit_loop_length(scene, 5.7e-3)
    assert knit_scene(found.scene).wire_length == pytest.approx(5.7e-3, rel=1e-3)
    assert found.scene.knit.loop.closed_radius > scene.knit.loop.closed_radius
    with pytest.raises(InputError) as refused:
        fit_loop_length(scene, 9e-3)
    given, least, most = (float(one.removesuffix(" mm")) for one in quantities(refused.value) if one.endswith("mm"))
    assert key_of(refused.value) == "--fit-loop-length" and (given, int(least), int(most)) == (9.0, 5, 6)


def test_loops_of_each_bar_are_fitted_to_its_run_in():
    """Reverse locknit, 480 courses a rack of 2220 and 2500 mm: each bar takes its length a course; the loops of one bar do not
    change those of the other. Tolerance: that of the factor, as lengths grow less than in proportion to it."""
    bars = [{"chain": "2-3/1-0"}, {"chain": "1-0/1-2"}]
    scene = make_scene({"knit": {"bars": bars, "wales": "26 /inch", "courses": "28 /inch"}, "model": {"boundary": "periodic"}})
    wanted = 2.500 / 480, 2.220 / 480
    fitted = with_known(scene, Known(loop_length=wanted))
    found = [knit_scene(fitted.scene).run_in(bar) for bar in range(2)]
    assert found == pytest.approx(wanted, rel=inputs.FIT_TOLERANCE)
    assert "factor" not in fitted.loops and fitted.loops["bar_factors"] == tuple(bar.loop_scale for bar in fitted.scene.knit.bars)
    again = load_scene(scene, fitted_overrides(fitted.scene.knit))
    assert [knit_scene(again).run_in(bar) for bar in range(2)] == found
    assert fitted.scene.knit.loop == scene.knit.loop
    with pytest.raises(InputError, match=r"9 mm for bar 2 .* 4\.\d+ mm to 4\.\d+ mm"):
        fit_run_in(scene, (wanted[0], 9e-3))
    with pytest.raises(InputError, match="5 mm, 4 mm, 4 mm .* 3 .* 2 "):
        fit_run_in(scene, (5e-3, 4e-3, 4e-3))


@pytest.mark.parametrize("name", ["tricot", *slow("full-double-atlas", "atlas", "reverse-locknit")])
def test_rods_in_space_have_the_lengths_that_loops_were_fitted_to(name):
    """Natural lengths of the rods of each bar, over the courses. Tolerance: that of the factor, and a thousandth between samples
    and nodes. In plan view these knits have 2 to 8 % less wire."""
    bars = [asdict(bar) for bar in named_knit(name).bars]
    scene = make_scene({
        "wire": {"material": "molybdenum", "diameter": "30 um"},
        "knit": {"bars": bars, "wales": "26 /inch", "courses": "30 /inch", "repeats": [1, 1]},
        "model": {"kind": "spatial", "boundary": "periodic"},
        "contact": {"friction": 0.0},
    })  # fmt: skip

    def rods(fitted):
        model = build_model(fitted)
        bar_of = np.array([model.cloth.threads[thread].bar for thread in model.panel.wire_thread])
        return [model.rods.wire_length[bar_of == bar].mean() / model.cloth.courses for bar in range(len(bars))]

    tolerance = inputs.FIT_TOLERANCE + 1e-3
    cloth = knit_scene(scene)
    assert cloth.wire_length > 1.01 * cloth.stitch_length
    wanted = tuple(1.005 * cloth.run_in(bar) for bar in range(len(bars)))
    each = with_known(scene, Known(loop_length=wanted))
    assert rods(each.scene) == pytest.approx(wanted, rel=tolerance)
    alike = with_known(scene, Known(loop_length=(1.005 * cloth.wire_length,)))
    assert np.mean(rods(alike.scene)) == pytest.approx(1.005 * cloth.wire_length, rel=tolerance)
    mass = 1.25 * measure.areal_mass(states_at(build_model(scene), [np.eye(2)])[0])
    (note,) = with_known(scene, Known(areal_mass=mass)).notes
    assert quantities(note)[-1] == f"{1.25e3 * np.mean(rods(scene)):.3g} mm"


def test_lengths_are_read_with_their_units():
    assert lengths_of("fit_loop_length", "5.6 mm") == lengths_of("fit_loop_length", 5.6e-3) == (5.6e-3,)
    assert (
        lengths_of("fit_loop_length", "4.63 mm, 4940 um")
        == lengths_of("fit_loop_length", ["4.63 mm", 4.94e-3])
        == (4.63e-3, 4.94e-3)
    )
    with pytest.raises(InputError, match="fit_loop_length"):
        lengths_of("fit_loop_length", "4.63 mm,")


def test_an_areal_mass_is_compared(scene):
    """8 loops of length l a repeat of 8 W C: l rho A / (W C), in the planar model l in plan view."""
    knit = scene.knit
    mass = knit_scene(scene).stitch_length * scene.wire.linear_density / (knit.wale_spacing * knit.course_spacing)
    (note,) = with_known(scene, Known(areal_mass=mass / 1.25)).notes
    assert "+25 %" in note and f"{knit_scene(scene).stitch_length / 1.25 * 1e3:.3g} mm" in note


def test_the_areal_mass_is_that_of_all_bars(scene):
    """Locknit lays two loops on each needle and course: the mass of the mesh as it is modelled, whatever the number of bars."""
    bars = [{"chain": "1-0/1-2", "threading": "|"}, {"chain": "2-3/1-0", "threading": "|"}]
    locknit = make_scene({"knit": {"bars": bars}, "model": {"kind": "planar", "boundary": "periodic"}})
    model = build_model(locknit)
    mass = measure.areal_mass(read(model, initial_state(model)))
    assert mass == pytest.approx(knit_scene(locknit).wire_per_area * locknit.wire.linear_density, rel=1e-9)
    (note,) = with_known(locknit, Known(areal_mass=mass)).notes
    assert {f"{1e3 * mass:.3g}", "0 %", f"{1e3 * knit_scene(locknit).stitch_length:.3g} mm"} <= set(quantities(note))
    page = Page("locknit")
    found = SimpleNamespace(scene=locknit, model=model, knitted=read(model, initial_state(model)), card=None, notes=())
    mesh_section(page, found, {})
    assert f"{1e3 * mass:.3g} g/m2" in page.html()


def test_loops_are_fitted_to_a_biaxial_curve(scene, tmp_path, monkeypatch):
    """A curve computed for loops of another size gives that size back: the misfit is zero there, and is sought to the tolerance
    of the factor."""
    tolerance = 1e-2
    monkeypatch.setattr(inputs, "FIT_TOLERANCE", tolerance)
    factor = 1.08
    names = ("closed_radius", "closed_head", "open_head", "open_half_width")
    loop = replace(scene.knit.loop, **{name: factor * getattr(scene.knit.loop, name) for name in names})
    other = build_model(replace(scene, knit=replace(scene.knit, loop=loop)))
    strains = [(0.15, 0.15), (0.16, 0.1)]
    states = states_at(other, [np.diag(1.0 + np.array(pair)) for pair in strains])
    lines = [",".join(map(str, (*pair, *measure.mesh_tension(state)))) for pair, state in zip(strains, states, strict=True)]
    path = tmp_path / "measured.csv"
    path.write_text("\n".join([",".join(COLUMNS), *lines]), encoding="utf-8")
    fitted = fit_curve(scene, path, Display())
    found = fitted.scene
    write_fit(fitted, tmp_path)
    fit = json.loads((tmp_path / "fit.json").read_text(encoding="utf-8"))
    assert (fit["fitted_to"], fit["notes"]) == ("measured.csv", list(fitted.notes))
    assert fit["loop"] == {name: getattr(found.knit.loop, name) for name in names}
    assert fit["factor"] == pytest.approx(factor, abs=2 * tolerance) and 0.0 <= fit["rms_error"] < POOR_FIT
    assert found.knit.loop.closed_radius / scene.knit.loop.closed_radius == pytest.approx(factor, abs=2 * tolerance)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("strain_weft,strain_warp\n0.1,0.1\n", "tension_weft_N_per_m"),
        (",".join(COLUMNS) + "\n0.1,0.1,much,1\n", "'much'"),
        (",".join(COLUMNS) + "\n0.1,0.1,nan,1\n", "finite"),
        (",".join(COLUMNS) + "\n", "no rows"),
        (",".join(COLUMNS) + "\n0.1,0.1,0,0\n", " 0"),
        (",".join(COLUMNS) + "\n0.1,0.1,500,500\n", "rms error"),
    ],
)
def test_a_bad_curve_is_refused(scene, tmp_path, monkeypatch, text, said):
    monkeypatch.setattr(inputs, "FIT_TOLERANCE", 0.05)
    path = tmp_path / "measured.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match="measured.csv") as refused:
        fit_curve(scene, path, Display())
    assert said in str(refused.value) and "\n" not in str(refused.value)


def test_what_was_fitted_is_left_as_numbers(scene, tmp_path):
    """The factor on the proportions gives the wire length; a report without a fit removes the file of an earlier one."""
    fitted = with_known(scene, Known(loop_length=(5.6e-3,)))
    write_fit(fitted, tmp_path)
    (tmp_path / "map.json").write_text('{"scene": {"name": "x"}, "stop_reason": "finished", "warnings": []}', encoding="utf-8")
    fit = load_run(tmp_path).fit
    assert (fit["fitted_to"], fit["rms_error"], fit["notes"]) == ("loop length", None, list(fitted.notes))
    assert fit["loop"]["closed_radius"] == pytest.approx(fit["factor"] * scene.knit.loop.closed_radius, rel=1e-12)
    assert fit["wale_spacing_m"] == scene.knit.wale_spacing
    assert knit_scene(fitted.scene).wire_length == pytest.approx(5.6e-3, rel=inputs.FIT_TOLERANCE)
    write_fit(with_known(scene, Known()), tmp_path)
    assert load_run(tmp_path).fit is None


def test_a_missing_curve_is_refused(scene, tmp_path):
    with pytest.raises(InputError, match="nowhere.csv"):
        fit_curve(scene, tmp_path / "nowhere.csv", Display())
