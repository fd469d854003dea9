"""One curve, written in every format, is read as the same curve; units, axes and what else a file says are honoured."""

import numpy as np
import pytest
import wire_samples as samples
from pxr import Gf, Usd, UsdGeom

from warpknit.wires.read import read_wires

SPACING = 50e-6
# [m] The table keeps six digits of coordinates of up to 10 mm, the others more; along a wire the roundings of 73 points add up.
ROUNDED = 73 * 5e-9


def reference(tmp_path, name="plain.csv"):
    path = tmp_path / name
    samples.write_csv(path, samples.patch())
    return read_wires(path, node_spacing=SPACING)


def write_cubic(basis):
    return lambda path, wires: samples.write_usd(path, wires, basis=basis)


@pytest.mark.parametrize(
    ("name", "write", "unit"),
    [
        ("knit.npz", samples.write_npz, 1e-3),
        ("knit.bcc", lambda path, wires: samples.write_bcc(path, wires, kind=b"PL"), 1e-3),
        ("knit.usda", write_cubic("linear"), None),
        ("knit.usdc", write_cubic("linear"), None),
    ],
)
def test_polylines_are_the_same_wires_in_every_format(tmp_path, name, write, unit):
    write(tmp_path / name, samples.patch())
    wires, expected = read_wires(tmp_path / name, node_spacing=SPACING, unit=unit), reference(tmp_path)
    assert wires.kinds == expected.kinds == ("open",) * samples.ROWS
    for points, those in zip(wires.points, expected.points, strict=True):
        assert np.allclose(points, those, rtol=0.0, atol=ROUNDED)
    assert wires.period is None and wires.rest_lengths is None


@pytest.mark.usefixtures("stages_read_here")
def test_catmull_rom_curves_are_the_same_in_bcc_and_usd(tmp_path):
    samples.write_bcc(tmp_path / "knit.bcc", samples.patch())
    samples.write_usd(tmp_path / "knit.usda", samples.patch())
    one = read_wires(tmp_path / "knit.bcc", node_spacing=SPACING, unit=1e-3)
    other = read_wires(tmp_path / "knit.usda", node_spacing=SPACING)
    for points, those in zip(one.points, other.points, strict=True):
        assert np.allclose(points, those, rtol=0.0, atol=ROUNDED)
    assert one.radius is None and other.radius == pytest.approx(1e-3 * samples.RADIUS, rel=1e-6)


def test_a_cell_repeats_as_the_row_it_was_made_from(tmp_path):
    """Its wire, whose points were moved into one repeat, unrolls to the row. A periodic spline errs by 5/384 h^4 max|d4 f|,
    h = 2 pi/24 of the parameter and |d4 f| at most 16 (a + d) units; by the chord, whose speed varies, by a few times that."""
    samples.write_cell(tmp_path / "cell.pyp")
    wires = read_wires(tmp_path / "cell.pyp", node_spacing=SPACING)
    assert wires.kinds == ("periodic",) and wires.shifts.tolist() == [[1, 0]]
    assert wires.period == pytest.approx([1e-3 * samples.WALE, 1e-3 * samples.COURSE], rel=1e-7)
    assert wires.radius == pytest.approx(1e-3 * samples.RADIUS)
    row = 1e-3 * samples.row(np.linspace(-0.1, 2.0 * np.pi + 0.1, 20_000))
    start = 1e-3 * samples.row(np.zeros(1))[0]
    unrolled = wires.points[0] + start - wires.points[0][0]
    error = 5.0 / 384.0 * (2.0 * np.pi / samples.POINTS_PER_LOOP) ** 4 * 16.0 * (samples.BULGE + samples.DEPTH)
    away = max(np.linalg.norm(row - point, axis=1).min() for point in unrolled)
    assert away < 4.0 * error * 1e-3 * samples.UNIT
    assert (wires.points[0][0, :2] >= 0.0).all() and (wires.points[0][0, :2] < wires.period).all()
    begin, end = wires.ends(0)
    assert np.allclose(end[-1] - begin[0], [wires.period[0], 0.0, 0.0], atol=1e-15)
    # its edges are as long as they are free of stress, to the eight digits of the file; so are the segments of its nodes
    assert wires.rest_lengths is not None
    assert wires.rest_lengths[0] == pytest.approx(np.linalg.norm(end - begin, axis=1), rel=1e-6)


def test_rings_and_wires_of_a_pattern_are_told_apart(tmp_path):
    """Four points make a ring that crosses the border of the repeat and comes back; two make a wire two repeats up."""
    points = np.array([[0.9, 0.4, 0], [1.1, 0.4, 0], [0.1, 0.6, 0], [0.9, 0.6, 0], [0.5, 0.0, 0.3], [0.5, 1.0, -0.3]])
    points[1] -= [1.0, 0.0, 0.0]
    edges = np.array([[0, 1, 1, 0], [1, 2, 0, 0], [2, 3, -1, 0], [3, 0, 0, 0], [4, 5, 0, 0], [5, 4, 0, 2]])
    samples.write_pyp(tmp_path / "two.pyp", points, edges, (1.0, 1.0), 0.01)
    wires = read_wires(tmp_path / "two.pyp", node_spacing=0.05, interpolation="linear", unit=1e-3)
    assert wires.kinds == ("closed", "periodic")
    assert wires.shifts.tolist() == [[0, 0], [0, 2]]
    assert wires.lengths[0] == pytest.approx(1e-3 * 2 * (0.2 + 0.2), rel=0.01)
    assert wires.closing(1) == pytest.approx([0.0, 2e-3, 0.0])


@pytest.mark.parametrize(("up", "expected"), [(2, [1, 2, 3]), (1, [1, -3, 2]), (0, [2, 3, 1])])
def test_what_a_file_calls_up_is_z(tmp_path, up, expected):
    ends = np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]])
    samples.write_bcc(tmp_path / "up.bcc", [ends], up=up)
    wires = read_wires(tmp_path / "up.bcc", node_spacing=1.0, unit=1.0)
    assert wires.points[0][-1] == pytest.approx(expected)
    assert np.linalg.det(np.array([samples_axis(up, axis) for axis in np.eye(3)])) == pytest.approx(1.0)


def samples_axis(up, axis):
    from warpknit.wires.bases import upright

    return upright(axis, up)


def test_a_negative_count_is_a_ring(tmp_path):
    """A uniform Catmull-Rom curve through n points of a circle: a chord's middle is (9 (P1 + P2) - P0 - P3)/16, at radius
    (9 cos(pi/n) - cos(3 pi/n))/8 of the circle."""
    n = 12
    angle = 2.0 * np.pi * np.arange(n) / n
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], axis=1)
    samples.write_bcc(tmp_path / "ring.bcc", [ring], closed=True)
    wires = read_wires(tmp_path / "ring.bcc", node_spacing=2.0 * np.pi / (2 * n), unit=1.0)
    assert wires.kinds == ("closed",) and len(wires.points[0]) == 2 * n
    radius = np.linalg.norm(wires.points[0], axis=1)
    assert radius[::2] == pytest.approx(1.0, abs=1e-6)
    assert radius[1::2] == pytest.approx((9.0 * np.cos(np.pi / n) - np.cos(3.0 * np.pi / n)) / 8.0, abs=1e-6)


# --- USD


def stage_of(path, points, **options):
    samples.write_usd(path, points, **options)
    return Usd.Stage.Open(str(path))


@pytest.mark.usefixtures("stages_read_here")
def test_transforms_units_and_axes_of_a_stage(tmp_path):
    """Moved by 1 along y, turned by 90 degrees about x and doubled, in inches with y up."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "moved.usda"))
    UsdGeom.SetStageMetersPerUnit(stage, 0.0254)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    above = UsdGeom.Xform.Define(stage, "/Above")
    above.AddTranslateOp().Set(Gf.Vec3d(0.0, 1.0, 0.0))
    above.AddScaleOp().Set(Gf.Vec3f(2.0, 2.0, 2.0))
    curves = UsdGeom.BasisCurves.Define(stage, "/Above/Wires")
    curves.AddRotateXOp().Set(90.0)
    curves.CreateTypeAttr("linear")
    curves.CreateCurveVertexCountsAttr([2])
    curves.CreatePointsAttr([(0, 0, 0), (1, 1, 0)])
    curves.CreateWidthsAttr([0.1])
    stage.GetRootLayer().Save()
    wires = read_wires(tmp_path / "moved.usda", node_spacing=0.01)
    # (1, 1, 0) turns to (1, 0, 1), doubles to (2, 0, 2), moves to (2, 1, 2); y up: (x, -z, y)
    assert wires.points[0][0] == pytest.approx(np.array([0.0, 0.0, 1.0]) * 0.0254, abs=1e-8)
    assert wires.points[0][-1] == pytest.approx(np.array([2.0, -2.0, 1.0]) * 0.0254, abs=1e-8)
    assert wires.radius == pytest.approx(0.1 * 0.0254, rel=1e-6)


@pytest.mark.usefixtures("stages_read_here")
def test_a_stage_without_a_unit_is_in_centimetres(tmp_path):
    stage = stage_of(tmp_path / "cm.usda", [np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])])
    stage.GetRootLayer().pseudoRoot.ClearInfo("metersPerUnit")
    stage.GetRootLayer().Save()
    assert read_wires(tmp_path / "cm.usda", node_spacing=1e-3).lengths == pytest.approx([0.02])


def test_points_that_move_are_taken_at_a_time(tmp_path):
    stage = stage_of(tmp_path / "moves.usda", [np.array([[0.0, 0, 0], [1, 0, 0]])], basis="linear", wrap="nonperiodic")
    points = UsdGeom.BasisCurves(stage.GetPrimAtPath("/Wires")).GetPointsAttr()
    points.Clear()
    points.Set([(0, 0, 0), (1, 0, 0)], 3.0)
    points.Set([(0, 0, 0), (2, 0, 0)], 5.0)
    stage.GetRootLayer().Save()
    lengths = [read_wires(tmp_path / "moves.usda", node_spacing=1e-4, time=time).lengths[0] for time in (None, 5.0, 4.0)]
    assert lengths == pytest.approx([1e-3, 2e-3, 1.5e-3])


@pytest.mark.usefixtures("stages_read_here")
def test_only_what_is_drawn_is_read(tmp_path):
    stage = stage_of(tmp_path / "drawn.usda", [np.array([[0.0, 0, 0], [1, 0, 0]])], basis="linear", wrap="nonperiodic")
    for name in ("Hidden", "Proxy", "Guide"):
        curves = UsdGeom.BasisCurves.Define(stage, f"/{name}")
        curves.CreateTypeAttr("linear")
        curves.CreateCurveVertexCountsAttr([2])
        curves.CreatePointsAttr([(0, 0, 0), (9, 9, 9)])
        if name == "Hidden":
            curves.MakeInvisible()
        else:
            curves.CreatePurposeAttr(name.lower())
    stage.GetRootLayer().Save()
    assert len(read_wires(tmp_path / "drawn.usda", node_spacing=1e-4).points) == 1


# --- tables and arrays


@pytest.mark.parametrize(
    "text",
    [
        "0,0,0\n1,0,0\n\n0,1,0\n1,1,0\n",
        "a,0,0,0\na,1,0,0\nb,0,1,0\nb,1,1,0\n",
        "x;y;z\n0;0;0\n1;0;0\n\n\n0;1;0\n1;1;0",
        "x,y,z\n0,0,0\n1,0,0\n\n,,\n0,1,0\n1,1,0\n\n\n,,\n",
        "z [mm]\ty [mm]\tWire\tx [mm]\n0\t0\t1\t0\n0\t0\t1\t1\n0\t1\t2\t0\n0\t1\t2\t1\n",
    ],
)
def test_tables_with_and_without_headings(tmp_path, text):
    path = tmp_path / "two.csv"
    path.write_text(text, encoding="utf-8-sig")
    wires = read_wires(path, node_spacing=0.5e-3, unit=None if "mm" in text else 1e-3)
    assert [points.tolist() for points in wires.points] == [
        [[0, 0, 0], [0.0005, 0, 0], [0.001, 0, 0]],
        [[0, 0.001, 0], [0.0005, 0.001, 0], [0.001, 0.001, 0]],
    ]


def test_an_array_for_each_wire(tmp_path):
    np.savez(tmp_path / "two.npz", b=np.array([[0, 0, 0], [1, 0, 0]]), a=np.array([[0, 1, 0], [4, 1, 0]]))
    assert read_wires(tmp_path / "two.npz", node_spacing=0.1, unit=1.0).lengths == pytest.approx([1.0, 4.0])


def test_closed_can_be_asked_for_or_said(tmp_path):
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    np.savez(tmp_path / "asked.npz", square)
    np.savez(tmp_path / "said.npz", points=np.concatenate([square, square]), counts=[4, 4], closed=[True, False])
    options = {"node_spacing": 0.1, "unit": 1.0, "interpolation": "linear"}
    assert read_wires(tmp_path / "asked.npz", **options).kinds == ("open",)
    assert read_wires(tmp_path / "asked.npz", closed=True, **options).lengths == pytest.approx([4.0])
    assert read_wires(tmp_path / "said.npz", **options).kinds == ("closed", "open")


def test_a_period_makes_open_wires_go_on(tmp_path):
    """Of a row of three loops, with the period of one loop: its ends are three periods apart."""
    samples.write_npz(tmp_path / "rows.npz", samples.patch())
    period = (1e-3 * samples.WALE, 1e-3 * samples.COURSE)
    wires = read_wires(tmp_path / "rows.npz", node_spacing=SPACING, unit=1e-3, period=period)
    assert wires.kinds == ("periodic",) * 3 and wires.shifts.tolist() == [[3, 0]] * 3
    assert wires.closing(0) == pytest.approx([3e-3 * samples.WALE, 0.0, 0.0])
