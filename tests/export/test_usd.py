"""The stage holds what it was given, at every time, in every state in which a run may leave it."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Plug, Usd, UsdGeom, UsdLux, UsdShade, UsdValidation

from reference.stages import FLOAT32_STEP, prims, primvar, world_points, write
from warpknit.export.usd.shapes import _colour_index, _stress_table
from warpknit.export.usd.writer import StageWriter
from warpknit.results.frame import Frame, WireLayout, curve_position

REACH = 10e-3  # [m]  no point lies farther from the middle of its tile
FRAMES = (0, 1, 2, 4)


@pytest.fixture
def frames(make_frame: Callable[..., Frame]) -> list[Frame]:
    return [make_frame(index, shear=0.01 * index) for index in FRAMES]


@pytest.fixture
def stage(tmp_path: Path, layout: WireLayout, frames: list[Frame]) -> Usd.Stage:
    return Usd.Stage.Open(str(write(tmp_path, layout, frames).path))


def stress_colour(stress: np.ndarray, limit: float) -> np.ndarray:
    return _stress_table()[_colour_index(stress, limit)]


def check_frames(stage: Usd.Stage, layout: WireLayout, frames: list[Frame]) -> None:
    """Points, stress and contact state equal what was given, to float32."""
    contacts = [shape for shape in prims(stage, UsdGeom.Points) if shape.GetPrim().GetName() == "Contacts"]
    for frame in frames:
        wires = prims(stage, UsdGeom.BasisCurves)
        points = np.concatenate([world_points(shape, frame.index) for shape in wires])
        assert np.allclose(points, curve_position(layout, frame), rtol=0.0, atol=FLOAT32_STEP * REACH)
        stress = np.concatenate([primvar(shape, "warpknit:stress", frame.index) for shape in wires])
        assert np.allclose(stress, frame.node_stress[layout.curve_node], rtol=FLOAT32_STEP)
        body = np.concatenate([np.array(shape.GetIdsAttr().Get()) for shape in contacts])
        assert sorted(body) == list(range(layout.body_count))
        points = np.concatenate([world_points(shape, frame.index) for shape in contacts])
        assert np.allclose(points, frame.body_position[body], rtol=0.0, atol=FLOAT32_STEP * REACH)
        for name, expected in (
            ("active", frame.body_active),
            ("activePairs", frame.pair_active.reshape(-1, 2).sum(1)),
            ("normalForce", frame.body_force),
            ("normalForceA", frame.pair_force[0::2]),
            ("normalForceB", frame.pair_force[1::2]),
            ("wireA", layout.body_wires[:, 0]),
            ("wireB", layout.body_wires[:, 1]),
        ):
            given = np.concatenate([primvar(shape, f"warpknit:{name}", frame.index) for shape in contacts])
            assert np.allclose(given, expected[body], rtol=FLOAT32_STEP), name


@pytest.mark.parametrize("level", ["full", "k8", "surface"])
@pytest.mark.parametrize("points_per_tile", [500_000, 100])
def test_validators_report_no_error(
    tmp_path: Path, space_layout: WireLayout, make_space_frame: Callable[..., Frame], level: str, points_per_tile: int
) -> None:
    frames = [make_space_frame(index) for index in FRAMES]
    writer = write(tmp_path, space_layout, frames, points_per_tile=points_per_tile, colour_stress_max=5e8)
    stage = Usd.Stage.Open(str(writer.path))
    assert stage.GetPrimAtPath("/World/Panel").GetVariantSet("lod").SetVariantSelection(level)
    for plugin in Plug.Registry().GetAllPlugins():
        if plugin.name.endswith("Validators"):
            plugin.Load()
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert len(validators) > 5
    errors = UsdValidation.ValidationContext(validators).Validate(stage)
    assert [(error.GetName(), error.GetMessage()) for error in errors] == []


@pytest.mark.parametrize("points_per_tile", [500_000, 100])
def test_read_back_equals_what_was_given(tmp_path: Path, layout: WireLayout, frames: list[Frame], points_per_tile: int) -> None:
    writer = write(tmp_path, layout, frames, points_per_tile=points_per_tile)
    stage = Usd.Stage.Open(str(writer.path))
    assert (len(prims(stage, UsdGeom.BasisCurves)) > 1) == (points_per_tile == 100)
    check_frames(stage, layout, frames)


def test_counts_agree(stage: Usd.Stage, layout: WireLayout) -> None:
    (wires,), (contacts,) = prims(stage, UsdGeom.BasisCurves), prims(stage, UsdGeom.Points)
    counts = np.array(wires.GetCurveVertexCountsAttr().Get())
    assert counts.tolist() == (np.diff(layout.wire_start) + layout.wire_closed).tolist()
    assert primvar(wires, "warpknit:wireId").tolist() == list(range(layout.wire_count))
    for time in FRAMES:
        assert len(wires.GetPointsAttr().Get(time)) == counts.sum() == len(primvar(wires, "warpknit:stress", time))
        assert len(contacts.GetPointsAttr().Get(time)) == layout.body_count
    for shape, width in ((wires, 0.015), (contacts, 2.5 * 0.015)):
        assert shape.GetWidthsInterpolation() == "constant"
        assert np.allclose(shape.GetWidthsAttr().Get(), [width], rtol=FLOAT32_STEP)
    assert not wires.GetNormalsAttr().HasAuthoredValue()


def test_closed_wire_ends_one_deformed_period_on(stage: Usd.Stage, layout: WireLayout, frames: list[Frame]) -> None:
    """x_end - x_first = F period, with F = [[1 + strain, shear], [0, 1 + strain]]."""
    (wires,) = prims(stage, UsdGeom.BasisCurves)
    for frame in frames:
        points = world_points(wires, frame.index)[layout.curve_start[-2] :]
        expected = [frame.shear * layout.period[1], (1.0 + frame.strain_warp) * layout.period[1], 0.0]
        assert np.allclose(points[-1] - points[0], expected, atol=2 * FLOAT32_STEP * REACH)


def test_extent_contains_drawn_wires(stage: Usd.Stage, layout: WireLayout) -> None:
    for shape in prims(stage, UsdGeom.BasisCurves) + prims(stage, UsdGeom.Points):
        for time in FRAMES:
            points, half = np.array(shape.GetPointsAttr().Get(time)), 0.5 * shape.GetWidthsAttr().Get()[0]
            low, high = np.array(shape.GetExtentAttr().Get(time))
            assert np.allclose(low, points.min(0) - half) and np.allclose(high, points.max(0) + half)
            assert np.all(low < points.min(0)) and np.all(high > points.max(0))


def test_time_codes_are_frame_indices(stage: Usd.Stage, frames: list[Frame]) -> None:
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (FRAMES[0], FRAMES[-1])
    (wires,) = prims(stage, UsdGeom.BasisCurves)
    assert set(FRAMES) <= set(wires.GetPointsAttr().GetTimeSamples())
    data = stage.GetRootLayer().customLayerData["warpknit"]
    assert list(data["frames"]) == list(FRAMES)
    assert np.allclose(data["load"]["strainWarp"], [frame.strain_warp for frame in frames], rtol=1e-15)
    assert data["complete"] and data["sceneHash"] == "0123abcd" and data["units"]["length"] == "mm"


def test_between_frames_points_move_and_states_hold(stage: Usd.Stage, layout: WireLayout, frames: list[Frame]) -> None:
    """Points are interpolated linearly; an integer keeps the value of the frame before."""
    (wires,), (contacts,) = prims(stage, UsdGeom.BasisCurves), prims(stage, UsdGeom.Points)
    before, after = frames[1], frames[2]
    assert np.any(before.body_active != after.body_active)
    middle = 0.5 * (curve_position(layout, before) + curve_position(layout, after))
    assert np.allclose(world_points(wires, 1.5), middle, rtol=0.0, atol=2 * FLOAT32_STEP * REACH)
    for time in (1.0, 1.5, 1.99):
        assert np.array_equal(primvar(contacts, "warpknit:active", time), before.body_active)
    assert np.array_equal(primvar(contacts, "warpknit:active", 2.0), after.body_active)


def test_where_a_frame_is_left_out_the_one_before_stands_still(stage: Usd.Stage, layout: WireLayout, frames: list[Frame]) -> None:
    (wires,) = prims(stage, UsdGeom.BasisCurves)
    for time, frame in ((2.5, frames[2]), (3.0, frames[2]), (3.99, frames[2]), (4.0, frames[3])):
        expected = curve_position(layout, frame)
        assert np.allclose(world_points(wires, time), expected, rtol=0.0, atol=FLOAT32_STEP * REACH)


def test_frame_whose_file_is_lost_has_no_value(tmp_path: Path, layout: WireLayout, frames: list[Frame]) -> None:
    writer = write(tmp_path, layout, frames[:3])
    (tmp_path / "frames" / "wires.000001.usdc").unlink()
    stage = Usd.Stage.Open(str(writer.path))
    (wires,) = prims(stage, UsdGeom.BasisCurves)
    assert wires.GetPointsAttr().Get(1.0) is None
    assert wires.GetPointsAttr().Get(0.0) is not None and wires.GetPointsAttr().Get(2.0) is not None


def test_killed_run_leaves_its_frames(tmp_path: Path, layout: WireLayout, frames: list[Frame]) -> None:
    """No close, a frame that the stage does not name yet, and half of the next one."""
    writer = write(tmp_path, layout, frames[:2], close=False)
    whole = writer.directory / "frames" / "wires.000001.usdc"
    shutil.copy(whole, whole.with_name("wires.000002.usdc"))
    whole.with_name(".wires.000003.partial.usdc").write_bytes(whole.read_bytes()[:100])
    stage = Usd.Stage.Open(str(writer.path))
    assert stage.GetEndTimeCode() == 1
    assert stage.GetRootLayer().customLayerData["warpknit"]["complete"] is False
    check_frames(stage, layout, frames[:2])
    del stage
    again = write(tmp_path, layout, frames)
    assert again.frames == FRAMES and list(tmp_path.rglob(".*")) == []
    stage = Usd.Stage.Open(str(again.path))
    check_frames(stage, layout, frames)
    assert stage.GetRootLayer().customLayerData["warpknit"]["complete"] is True


def test_failed_frame_leaves_the_stage_as_it_was(
    tmp_path: Path, layout: WireLayout, frames: list[Frame], monkeypatch: pytest.MonkeyPatch
) -> None:
    writer = write(tmp_path, layout, frames[:1], close=False)

    def full(source: object, target: object) -> None:
        raise OSError("no space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("warpknit.base.files.os.replace", full)
        with pytest.raises(OSError, match="no space"):
            writer.add_frame(frames[1])
    assert sorted(path.name for path in (tmp_path / "frames").iterdir()) == ["wires.000000.usdc"]
    check_frames(Usd.Stage.Open(str(writer.path)), layout, frames[:1])


def test_new_run_drops_the_frames_of_the_old_one(tmp_path: Path, layout: WireLayout, frames: list[Frame]) -> None:
    write(tmp_path, layout, frames)
    foreign = tmp_path / "frames" / "note.txt"
    foreign.write_text("mine")
    write(tmp_path, layout, frames[:2])
    assert sorted(path.name for path in foreign.parent.iterdir()) == [
        "note.txt",
        "wires.000000.usdc",
        "wires.000001.usdc",
    ]


def test_stage_can_be_moved(tmp_path: Path, layout: WireLayout, frames: list[Frame]) -> None:
    write(tmp_path / "here", layout, frames)
    (tmp_path / "here").rename(tmp_path / "there")
    check_frames(Usd.Stage.Open(str(tmp_path / "there" / "scene.usda")), layout, frames)


@pytest.mark.parametrize("name", ["node_position", "node_stress", "body_position", "pair_force", "strain_weft"])
def test_nothing_but_finite_numbers_is_written(tmp_path: Path, layout: WireLayout, frames: list[Frame], name: str) -> None:
    value = np.array(getattr(frames[0], name), copy=True)
    value.ravel()[-1:] = np.nan
    writer = StageWriter(tmp_path, layout, scene_name="zigzag", scene_hash="0", version="1.0")
    with pytest.raises(ValueError, match=f"frame 0: {name} "):
        writer.add_frame(replace(frames[0], **{name: value}))
    writer.close()
    assert list(tmp_path.rglob("*.usd*")) == []


def test_frames_come_in_order(tmp_path: Path, layout: WireLayout, frames: list[Frame]) -> None:
    writer = write(tmp_path, layout, frames[:2], close=False)
    with pytest.raises(ValueError, match="frame 1"):
        writer.add_frame(frames[0])


def test_wires_are_gold_unless_stress_is_shown(tmp_path: Path, layout: WireLayout, frames: list[Frame]) -> None:
    for limit, name in ((None, "Gold"), (5e8, "DisplayColor")):
        stage = Usd.Stage.Open(str(write(tmp_path / name, layout, frames, colour_stress_max=limit).path))
        (wires,) = prims(stage, UsdGeom.BasisCurves)
        material, _ = UsdShade.MaterialBindingAPI(wires).ComputeBoundMaterial()
        assert material.GetPath().name == name
        colour = np.array(wires.GetDisplayColorPrimvar().ComputeFlattened(4))
        expected = [[1.0, 0.77, 0.34]] if limit is None else stress_colour(primvar(wires, "warpknit:stress", 4), limit)
        assert np.allclose(colour, expected)


def test_light_on_a_white_plane(tmp_path: Path, layout: WireLayout, frames: list[Frame]) -> None:
    """Radiance of a white plane, dome + irradiance cos(angle)/pi, between dim and burnt out; the key light as irradiance."""
    stage = Usd.Stage.Open(str(write(tmp_path, layout, frames[:1]).path))
    key, dome = UsdLux.DistantLight.Get(stage, "/World/KeyLight"), UsdLux.DomeLight.Get(stage, "/World/DomeLight")
    assert key.GetNormalizeAttr().Get()
    direction = UsdGeom.Xformable(key).GetLocalTransformation().TransformDir((0.0, 0.0, -1.0))
    radiance = dome.GetIntensityAttr().Get() - key.GetIntensityAttr().Get() * direction[2] / np.pi
    assert direction[2] < 0.0 and 0.4 < radiance < 0.9


def test_stress_colour_ends() -> None:
    assert np.allclose(stress_colour(np.array([0.0]), 1e9), [[1.0, 0.77, 0.34]])
    darkness = stress_colour(np.linspace(0.0, 1e9, 256), 1e9) @ [0.2126, 0.7152, 0.0722]
    assert np.all(np.diff(darkness) < 0.0)


def test_camera_sees_every_frame(stage: Usd.Stage) -> None:
    frustum = UsdGeom.Camera(stage.GetPrimAtPath("/World/Camera")).GetCamera(0).frustum
    cache = UsdGeom.BBoxCache(0, ["default"])
    for time in FRAMES:
        cache.SetTime(time)
        bounds = cache.ComputeWorldBound(stage.GetPrimAtPath("/World/Panel"))
        assert frustum.Intersects(bounds)
        box = bounds.ComputeAlignedRange()
        assert all(frustum.Intersects(Gf.Vec3d(box.GetCorner(corner))) for corner in range(8))


@pytest.mark.parametrize("points_per_tile", [500_000, 100])
def test_contacts_elsewhere_are_points_whose_number_changes(
    tmp_path: Path, space_layout: WireLayout, make_space_frame: Callable[..., Frame], points_per_tile: int
) -> None:
    """Each with its force and wires, in the tile of its first wire; in place of none a point of no width and no wire."""
    frames = [make_space_frame(index, count) for index, count in enumerate((0, 9, 4, 0))]
    stage = Usd.Stage.Open(str(write(tmp_path, space_layout, frames, points_per_tile=points_per_tile).path))
    shapes = [shape for shape in prims(stage, UsdGeom.Points) if shape.GetPrim().GetName() == "ContactsElsewhere"]
    check_frames(stage, space_layout, frames)
    assert len(shapes) == len(prims(stage, UsdGeom.BasisCurves)) and (len(shapes) > 1) == (points_per_tile == 100)
    for frame in frames:
        points, force, first, second, width = (
            np.concatenate([read(shape) for shape in shapes])
            for read in (
                lambda shape, time=frame.index: world_points(shape, time).reshape(-1, 3),
                *(lambda shape, time=frame.index, name=name: primvar(shape, f"warpknit:{name}", time)
                  for name in ("normalForce", "wireA", "wireB")),
                lambda shape, time=frame.index: np.array(shape.GetWidthsAttr().Get(time)),
            )
        )  # fmt: skip
        assert np.allclose(width, np.where(first < 0, 0.0, 2.5 * 0.015)) and np.all(force[first < 0] == 0.0)
        order, given = np.argsort(force)[np.count_nonzero(first < 0) :], np.argsort(frame.elsewhere_force)
        assert np.allclose(force[order], frame.elsewhere_force[given], rtol=FLOAT32_STEP)
        assert np.array_equal(np.stack([first, second], axis=1)[order], frame.elsewhere_wires[given])
        assert np.allclose(points[order], frame.elsewhere_position[given], rtol=0.0, atol=FLOAT32_STEP * REACH)
        for shape in shapes:
            low, high = np.array(shape.GetExtentAttr().Get(frame.index))
            points = np.array(shape.GetPointsAttr().Get(frame.index))
            assert np.all(low <= points) and np.all(high >= points)
    wires = {wire for shape in prims(stage, UsdGeom.BasisCurves)[:1] for wire in primvar(shape, "warpknit:wireId").tolist()}
    assert set(primvar(shapes[0], "warpknit:wireA", 1)) <= wires | {-1}
