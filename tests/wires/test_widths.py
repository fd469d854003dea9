"""Widths of a file: which wires are how thick, what follows for contact and section, and what is said where they do not count."""

import numpy as np
import pytest
import wire_samples as samples
from pxr import Sdf, Usd, UsdGeom

from reference.in_words import quantities
from warpknit.base.errors import SceneError
from warpknit.commands.plan import overview_of
from warpknit.scene import load_scene
from warpknit.scene.scene import resolved_toml
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation
from warpknit.wires.file_curves import curves_of
from warpknit.wires.read import read_wires
from warpknit.wires.stage_process import stage_arrays

pytestmark = pytest.mark.usefixtures("stages_read_here")

X = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])


def stage_text(widths: str, more: str = "", points: str = "") -> str:
    """Two straight wires along x, 1 mm apart."""
    return f"""#usda 1.0
(metersPerUnit = 0.001
upAxis = "Z")
def BasisCurves "pair"
{{
    uniform token type = "linear"
    uniform token wrap = "nonperiodic"
    int[] curveVertexCounts = [3, 3]
    point3f[] points = [{points or "(0, 0, 0), (1, 0, 0), (2, 0, 0), (0, 1, 0), (1, 1, 0), (2, 1, 0)"}]
    {widths}
}}
{more}
"""


def curves(text: str):
    layer = Sdf.Layer.CreateAnonymous(".usda")
    assert layer.ImportFromString(text)
    return curves_of(stage_arrays(Usd.Stage.Open(layer), None), "linear")


def scene_of(folder, widths: str, **tables):
    (folder / "pair.usda").write_text(stage_text(widths), encoding="utf-8")
    table = {"wires": {"file": str(folder / "pair.usda"), "node_spacing": "0.25 mm"}, "load": {"strain_weft": 0.001}}
    return load_scene(table | tables)


EACH = 'float[] widths = [0.2, 0.4] (interpolation = "uniform")'
UNEVEN = 'float[] widths = [0.2, 0.3, 0.2, 0.2, 0.2, 0.2] (interpolation = "vertex")'


@pytest.mark.parametrize(
    ("widths", "radius"),
    [
        ("float[] widths = [0.2]", [0.1, 0.1]),
        ('float[] widths = [0.2] (interpolation = "constant")', [0.1, 0.1]),
        (EACH, [0.1, 0.2]),
        ("float[] widths = [0.2, 0.2, 0.2, 0.4, 0.4, 0.4]", [0.1, 0.2]),
        ('float[] widths = [0.2, 0.2, 0.2, 0.4, 0.4, 0.4] (interpolation = "varying")', [0.1, 0.2]),
        (f'{EACH}\nfloat[] primvars:widths = [0.6] (interpolation = "constant")', [0.3, 0.3]),
        ("", None),
    ],
)
def test_widths_are_constant_or_of_each_curve(widths, radius):
    found = curves(stage_text(widths))
    assert not found.no_radius and not found.notes
    assert (found.radius is None and radius is None) or found.radius.tolist() == radius


@pytest.mark.parametrize(
    ("widths", "fault"),
    [
        (UNEVEN, "200 um to 300 um along wire 1"),
        ("float[] widths = [0.2, 0.4]", "2 widths of /pair"),
        ('float[] widths = [0.2, 0.4, 0.2] (interpolation = "uniform")', "3 widths of /pair"),
        ("float[] widths = [0]", "a width of 0"),
        (
            EACH + "\ndouble3 xformOp:scale = (1, 2, 1)\nuniform token[] xformOpOrder = ['xformOp:scale']",
            "/pair",
        ),
    ],
)
def test_other_widths_are_no_thickness(tmp_path, widths, fault):
    found = curves(stage_text(widths))
    assert found.radius is None and fault in found.no_radius
    with pytest.raises(SceneError, match="wire.diameter: .*'pair.usda'"):
        scene_of(tmp_path, widths)
    file = overview_of(scene_of(tmp_path, widths, wire={"diameter": "0.1 mm"})).file
    assert file is not None and any(fault in one.text and "widths that are not used" in one.text for one in file.warnings)


def test_widths_are_the_sections_and_the_contact_of_the_wires(tmp_path):
    """EI as the fourth power, EA as the square of the width; centre lines touch at the mean of both widths."""
    scene = scene_of(tmp_path, EACH, wire={"material": "tungsten"})
    assert scene.wire.diameter == pytest.approx(0.4e-3, rel=1e-12) and scene.wires.widths
    rods = build_model(scene).rods
    assert rods.of_wires("bending_stiffness") == pytest.approx(np.pi / 64 * 400e9 * np.array([0.2e-3, 0.4e-3]) ** 4, rel=0.03)
    assert rods.of_wires("axial_stiffness")[1] / rods.of_wires("axial_stiffness")[0] == pytest.approx(4.0)
    assert rods.of_wires("bending_stiffness")[1] / rods.of_wires("bending_stiffness")[0] == pytest.approx(16.0)
    assert rods.touch_distance(np.array([0]), np.array([len(rods.position) - 1])) == pytest.approx(0.3e-3)
    (tmp_path / "scene.toml").write_text(resolved_toml(scene), encoding="utf-8")
    again = load_scene(tmp_path / "scene.toml")
    assert again == scene and again.hash == scene.hash


def test_widths_are_the_thickness_of_the_yarn(tmp_path):
    """Of four plated ends: (d + 2 t) sqrt(4) is the width."""
    plating = {"material": "gold", "thickness": "1 um"}
    wire = scene_of(tmp_path, "float[] widths = [0.2]", wire={"ends": 4, "plating": plating}).wire
    assert wire.thickness == pytest.approx(0.2e-3) and wire.diameter == pytest.approx(98e-6)
    with pytest.raises(SceneError, match="plating"):
        scene_of(tmp_path, "float[] widths = [0.001]", wire={"ends": 4, "plating": plating})


def test_a_given_diameter_stands_before_the_file_and_the_difference_is_reported(tmp_path):
    scene = scene_of(tmp_path, EACH, wire={"diameter": "0.1 mm"})
    [warning] = overview_of(scene).file.warnings
    assert not scene.wires.widths and {"0.2", "0.4 mm", "0.1 mm"} <= set(quantities(warning.text))
    model = build_model(scene)
    assert model.rods.of_wires("thickness") == pytest.approx([0.1e-3, 0.1e-3])
    assert model.panel.warnings == (warning,)
    asked = scene.changed({"wires.widths": True})
    assert asked.wires.widths and asked.wire.diameter == pytest.approx(0.4e-3)
    left = load_scene(scene, ["wires.widths=false"])
    assert left.wire.diameter == pytest.approx(0.1e-3)


def test_the_radius_of_a_pattern_is_that_of_its_wires(tmp_path):
    samples.write_cell(tmp_path / "cell.pyp")
    table = {"wires": {"file": str(tmp_path / "cell.pyp")}, "model": {"boundary": "periodic"}, "load": {"strain_warp": 0.01}}
    scene = load_scene(table)
    assert scene.wire.diameter == pytest.approx(2e-3 * samples.RADIUS) and scene.wires.node_spacing == scene.wire.diameter
    samples.write_csv(tmp_path / "plain.csv", samples.patch())
    with pytest.raises(SceneError, match="wires.widths: true .*'plain.csv'"):
        load_scene({"wires": {"file": str(tmp_path / "plain.csv"), "widths": True}})


def test_wires_of_several_widths_carry_tension_by_their_sections(tmp_path):
    """Straight wires of 0.2 and 0.4 mm, 1 mm apart, strained by e: E e in both, and E e pi (0.2^2 + 0.4^2)/4 mm2 in all.

    A strain of 0.001 along wires without bends; the residual is 0.1 % or less of the tension.
    """
    scene = scene_of(tmp_path, EACH, output={"frames": 1}, solver={"preset": "draft"})
    model = build_model(scene)
    observed = list(Simulation(model).run())[-1].observables
    modulus, areas = scene.wire.youngs_modulus, np.pi / 4 * np.array([0.2e-3, 0.4e-3]) ** 2
    pull = np.maximum.reduceat(observed.tension, model.rods.wire_first)
    assert pull == pytest.approx(0.001 * modulus * areas, rel=2e-3)
    inner = (model.rods.following >= 0) & (model.rods.previous >= 0)
    assert observed.wire_stress.node[inner] == pytest.approx(0.001 * modulus, rel=2e-3)
    assert observed.wire_mass == pytest.approx(scene.wire.density * 2e-3 * areas.sum(), rel=1e-6)


def test_invalid_curves_are_skipped_and_named(tmp_path):
    more = """def BasisCurves "stray"
{
    uniform token type = "cubic"
    uniform token basis = "bezier"
    int[] curveVertexCounts = [4, 5]
    point3f[] points = [(0, 5, 0), (1, 5, 0), (2, 5, 0), (3, 5, 0), (0, 6, 0), (1, 6, 0), (2, 6, 0), (3, 6, 0), (4, 6, 0)]
    float[] widths = [0.6, 0.8] (interpolation = "uniform")
}
def BasisCurves "short"
{
    int[] curveVertexCounts = [4]
    point3f[] points = [(0, 0, 0)]
}
def NurbsCurves "other" {}
def NurbsCurves "hidden"
{
    token visibility = "invisible"
}
"""
    found = curves(stage_text(EACH, more, points="(0, 0, 0), (1, nan, 0), (2, 0, 0), (0, 1, 0), (1, 1, 0), (2, 1, 0)"))
    assert len(found.curves) == 2 and found.radius.tolist() == [0.2, 0.3]  # each with its own width
    assert found.curves[1].pieces[0, :, 1] == pytest.approx(5.0)
    named = (("NurbsCurves /other",), ("/short",), ("curve 1 of /pair: point 2 ", "curve 4 of /stray: "))
    assert all(all(name in note for name in names) for names, note in zip(named, found.notes, strict=False))
    assert "/hidden" not in " ".join(found.notes)


def test_curves_of_an_instancer_are_not_read_where_they_are_defined():
    more = """def PointInstancer "many"
{
    def BasisCurves "one"
    {
        uniform token type = "linear"
        int[] curveVertexCounts = [2]
        point3f[] points = [(0, 0, 0), (1, 0, 0)]
    }
}
"""
    found = curves(stage_text(EACH, more))
    assert len(found.curves) == 2 and [note.split()[-1] for note in found.notes] == ["/many"]


def test_widths_of_a_run_are_those_that_are_read_back(tmp_path):
    """The stage of a run has the thickness of each wire in mm."""
    scene = scene_of(tmp_path, EACH)
    layout = build_model(scene).layout()
    assert layout.wire_diameter == pytest.approx([0.2e-3, 0.4e-3])
    stage = Usd.Stage.CreateInMemory()
    from warpknit.export.usd.shapes import define_wires

    prim = define_wires(stage, Sdf.Path("/wires"), np.arange(2), np.array([3, 3]), 1e3 * layout.wire_diameter, shows_stress=False)
    drawn = UsdGeom.BasisCurves(prim)
    drawn.CreatePointsAttr([(x, y, 0) for y in (0, 1) for x in range(3)])
    UsdGeom.SetStageMetersPerUnit(stage, 1e-3)
    assert curves_of(stage_arrays(stage, None), "linear").radius.tolist() == [0.1, 0.2]


def test_arrays_that_are_not_read_are_named(tmp_path):
    np.savez(tmp_path / "knit.npz", points=X, counts=[3], diameter=np.array([0.1]))
    wires = read_wires(tmp_path / "knit.npz", node_spacing=0.5, unit=1.0)
    assert [note.split()[-1] for note in wires.notes] == ["diameter"]
