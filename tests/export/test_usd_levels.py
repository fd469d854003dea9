"""Tiles and levels of detail: every wire in one tile, float32 fine enough on a large panel, each level true to the frame."""

import itertools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from reference.stages import FLOAT32_STEP, prims, primvar, world_points, write
from warpknit.export.usd.tiles import STRIDE, Sheet, Thinning, cut_tiles
from warpknit.results.frame import Frame, WireLayout, curve_position


@pytest.fixture
def frames(make_frame: Callable[..., Frame]) -> list[Frame]:
    return [make_frame(index, shear=0.01 * index) for index in range(4)]


def at_level(path: Path, level: str) -> Usd.Stage:
    stage = Usd.Stage.Open(str(path))
    assert stage.GetPrimAtPath("/World/Panel").GetVariantSet("lod").SetVariantSelection(level)
    return stage


# --- tiles ------------------------------------------------------------------------------------------------------------


def strands(wires: int, pieces: int, nodes: int = 30, order: int = 7) -> tuple[WireLayout, Frame]:
    """Upright wires 1 mm apart, each cut into so many pieces of 10 mm; in an order that has nothing to do with their place."""
    count = wires * pieces
    place = np.arange(count) * order % count
    x, y = 1e-3 * (place // pieces), 10e-3 * (place % pieces)
    node = np.tile(np.arange(nodes), count)
    position = np.stack((np.repeat(x, nodes), np.repeat(y, nodes) + 10e-3 * node / nodes, np.zeros(node.size)), axis=1)
    layout = WireLayout(
        wire_start=np.arange(count + 1) * nodes,
        wire_closed=np.zeros(count, dtype=bool),
        period=np.ones(2),
        diameter=15e-6,
        body_radius=2e-6,
        body_wires=np.stack((np.arange(count - 1), np.arange(1, count)), axis=1),
        rhombus_bodies=np.zeros(0, dtype=int),
    )
    frame = Frame(
        index=0, stage="load", load_factor=0.0, strain_weft=0.0, strain_warp=0.0, shear=0.0, temperature=293.15,
        node_position=position, node_stress=np.arange(node.size, dtype=float), body_position=position[: count - 1],
        pair_force=np.zeros(2 * count - 2), pair_active=np.zeros(2 * count - 2, dtype=bool),
    )  # fmt: skip
    return layout, frame


@pytest.mark.parametrize(("pieces", "bands"), [(1, {0}), (6, {0, 1, 2, 3})])
def test_tiles_are_shares_of_whole_wires(pieces: int, bands: set[int]) -> None:
    """Each wire and body in one tile, each tile within a wire of its share; along the warp only where wires are cut."""
    layout, frame = strands(60, pieces)
    share = layout.node_count / 16
    tiles = cut_tiles(layout, frame.node_position, round(share))
    assert sorted(np.concatenate([tile.wires for tile in tiles])) == list(range(layout.wire_count))
    assert sorted(np.concatenate([tile.bodies for tile in tiles])) == list(range(layout.body_count))
    assert {int(tile.name[-2:]) for tile in tiles} == bands
    for tile in tiles:
        points = tile.take(frame.node_position)
        assert abs(len(points) - share) <= len(bands) * 30 + share / 16
        assert np.array_equal(points, np.concatenate([frame.node_position[30 * w : 30 * w + 30] for w in tile.wires]))
    columns = [1e3 * tile.take(frame.node_position)[:, 0] for tile in tiles if tile.name.endswith("_00")]
    assert all(a.max() <= b.min() for a, b in itertools.pairwise(columns))


def test_points_of_a_panel_of_ten_metres_keep_a_hundredth_of_a_micrometre(tmp_path: Path) -> None:
    """A point r from the origin of its tile is off by no more than half a unit of float32 at r; 10 m away it would be 0.5 um."""
    layout, frame = strands(100, 1)
    frame = replace(frame, node_position=frame.node_position + (10.0, 8.0, 0.0) + 1e-7 * np.sqrt(2.0))
    stage = at_level(write(tmp_path, layout, [frame], points_per_tile=300).path, "full")
    wires = prims(stage, UsdGeom.BasisCurves)
    assert len(wires) == 10
    reach = 6e-3  # [m] half of a tile: 9 mm x 10 mm, from a middle that is rounded to 1 um
    points, ids = (np.concatenate(part) for part in (
        [world_points(shape, 0.0) for shape in wires], [primvar(shape, "warpknit:wireId") for shape in wires],
    ))  # fmt: skip
    expected = frame.node_position.reshape(layout.wire_count, -1, 3)[ids].reshape(-1, 3)
    assert np.abs(points - expected).max() <= FLOAT32_STEP * reach < 1e-9


def test_tile_counts_extents_and_purposes(tmp_path: Path, layout: WireLayout, frames: list[Frame]) -> None:
    path = write(tmp_path, layout, frames, points_per_tile=100).path
    for level in ("full", "k8"):
        stage = at_level(path, level)
        wires, contacts = prims(stage, UsdGeom.BasisCurves), prims(stage, UsdGeom.Points)
        assert len(wires) > 1
        for shape in wires + contacts:
            assert shape.GetPurposeAttr().Get() == "render"
            for time in range(4):
                points, half = np.array(shape.GetPointsAttr().Get(time)), 0.5 * shape.GetWidthsAttr().Get()[0]
                assert np.isfinite(points).all()
                low, high = np.array(shape.GetExtentAttr().Get(time))
                assert np.allclose(low, points.min(0) - half) and np.allclose(high, points.max(0) + half)
        for shape in wires:
            counts = np.array(shape.GetCurveVertexCountsAttr().Get())
            ids = primvar(shape, "warpknit:wireId")
            assert counts.size == ids.size and counts.min() >= 3
            if level == "full":
                assert np.array_equal(counts, np.diff(layout.curve_start)[ids])
            for time in range(4):
                points = len(shape.GetPointsAttr().Get(time))
                assert points == counts.sum() == len(primvar(shape, "warpknit:stress", time))
        for shape in contacts:
            bodies = np.array(shape.GetIdsAttr().Get())
            inside = {int(w) for curve in wires if curve.GetPath().GetParentPath() == shape.GetPath().GetParentPath()
                      for w in primvar(curve, "warpknit:wireId")}  # fmt: skip
            assert {int(w) for w in layout.body_wires[bodies, 0]} <= inside


# --- levels of detail -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("counts", [[3], [4, 9, 10, 17, 18, 6, 100, 3, 1000]])
def test_thinning_keeps_ends_and_peaks(counts: list[int]) -> None:
    thinning = Thinning.of(np.array(counts))
    values = np.random.default_rng(3).normal(size=sum(counts))
    largest = thinning.largest(values)
    start = 0
    for count, kept_count in zip(counts, thinning.counts, strict=True):
        inside = (thinning.kept >= start) & (thinning.kept < start + count)
        kept = thinning.kept[inside] - start
        assert kept[0] == 0 and kept[-1] == count - 1 and kept.size == kept_count == max(3, -(-(count - 1) // STRIDE) + 1)
        assert np.diff(kept).min() >= 1 and np.diff(kept).max() <= STRIDE
        assert largest[inside].max() == values[start : start + count].max()
        start += count


@pytest.mark.parametrize("points_per_tile", [500_000, 100])
def test_thinned_level_is_a_choice_of_the_points(
    tmp_path: Path, layout: WireLayout, frames: list[Frame], points_per_tile: int
) -> None:
    stage = at_level(write(tmp_path, layout, frames, points_per_tile=points_per_tile).path, "k8")
    for frame in frames:
        position, stress = curve_position(layout, frame), frame.node_stress[layout.curve_node]
        for shape in prims(stage, UsdGeom.BasisCurves):
            points, found = world_points(shape, frame.index), primvar(shape, "warpknit:stress", frame.index)
            first = 0
            counts = shape.GetCurveVertexCountsAttr().Get()
            for wire, count in zip(primvar(shape, "warpknit:wireId"), counts, strict=True):
                run = slice(layout.curve_start[wire], layout.curve_start[wire + 1])
                kept = Thinning.of(np.array([run.stop - run.start])).kept
                assert np.allclose(points[first : first + count], position[run][kept], rtol=0.0, atol=FLOAT32_STEP * 10e-3)
                assert np.isclose(found[first : first + count].max(), stress[run].max(), rtol=FLOAT32_STEP)
                first += count
        assert sum(len(shape.GetIdsAttr().Get()) for shape in prims(stage, UsdGeom.Points)) == layout.body_count


@pytest.mark.parametrize(("limit", "level"), [(1000, "full"), (100, "k8"), (10, "surface")])
def test_stage_opens_at_the_finest_level_that_is_not_too_large(
    tmp_path: Path, layout: WireLayout, frames: list[Frame], monkeypatch: pytest.MonkeyPatch, limit: int, level: str
) -> None:
    monkeypatch.setattr("warpknit.export.usd.scene.SHOWN_POINTS", limit)
    stage = Usd.Stage.Open(str(write(tmp_path, layout, frames[:1]).path))
    assert stage.GetPrimAtPath("/World/Panel").GetVariantSet("lod").GetVariantSelection() == level


def test_full_level_stands_still_where_it_was_not_asked_for(tmp_path: Path, layout: WireLayout, frames: list[Frame]) -> None:
    """Every third frame and the end of the stage hold every point; the thinned level moves at every frame."""
    frames[2] = replace(frames[2], load_factor=1.0)
    path = write(tmp_path, layout, frames[:3], full_every=3).path
    stage = at_level(path, "full")
    data = stage.GetRootLayer().customLayerData["warpknit"]
    assert (list(data["frames"]), list(data["fullFrames"])) == ([0, 1, 2], [0, 2])
    shown = {"full": (0, 0, 2), "k8": (0, 1, 2)}
    for level, indices in shown.items():
        stage = at_level(path, level)
        (wires,), (contacts,) = prims(stage, UsdGeom.BasisCurves), prims(stage, UsdGeom.Points)
        for time, index in enumerate(indices):
            points, expected = world_points(wires, time), curve_position(layout, frames[index])
            assert np.allclose(points[0], expected[0], rtol=0.0, atol=FLOAT32_STEP * 10e-3)
            assert np.array_equal(primvar(contacts, "warpknit:active", time), frames[time].body_active)


def test_sheet_carries_stress_and_contacts(tmp_path: Path, layout: WireLayout, frames: list[Frame]) -> None:
    layout = replace(layout, repeats=np.array([3, 2]))
    writer = write(tmp_path, layout, frames, points_per_tile=100)
    for level, purpose in (("full", "proxy"), ("k8", "proxy"), ("surface", "default")):
        stage = at_level(writer.path, level)
        (sheet,) = prims(stage, UsdGeom.Mesh)
        assert sheet.GetPurposeAttr().Get() == purpose
        assert bool(prims(stage, UsdGeom.BasisCurves)) == (level != "surface")
        pairs = primvar(sheet, "warpknit:pairs")
        assert pairs.sum() == 2 * layout.body_count
        for frame in frames:
            stress, share = (primvar(sheet, f"warpknit:{name}", frame.index) for name in ("stress", "activeShare"))
            assert np.isclose(stress.max(), frame.node_stress.max(), rtol=FLOAT32_STEP)
            assert np.isclose((0.01 * share * pairs).sum(), frame.pair_active.sum(), rtol=1e-6)


def test_sheet_of_one_tile_is_a_level_only(tmp_path: Path, layout: WireLayout, frames: list[Frame]) -> None:
    path = write(tmp_path, layout, frames).path
    assert prims(at_level(path, "full"), UsdGeom.Mesh) == []
    assert len(prims(at_level(path, "surface"), UsdGeom.Mesh)) == 1
    stage = at_level(path, "full")
    (wires,) = prims(stage, UsdGeom.BasisCurves)
    assert wires.GetPurposeAttr().Get() == "default"


def test_sheet_moves_with_the_mean() -> None:
    """x = F X + u: a uniform u moves every vertex by u; F alone carries the grid; faces turn counter-clockwise."""
    x, y = np.meshgrid(np.linspace(0.0, 4.0, 81), np.linspace(0.0, 3.0, 61))
    points = np.stack((x.ravel(), y.ravel(), np.full(x.size, 0.5)), axis=1)
    sheet = Sheet(points[:, :2], points[:7, :2], np.array([4.0, 3.0]), np.eye(2), np.array([4, 3]))
    assert (len(sheet.face_vertices), sheet.pair_counts.sum()) == (12, 14)
    deformation = np.array([[1.1, 0.2], [0.0, 0.9]])
    moved = points.copy()
    moved[:, :2] = points[:, :2] @ deformation.T
    moved += (0.3, -0.2, 0.1)
    vertices = sheet.position(moved, deformation)
    column, row = np.meshgrid(np.arange(5.0), np.arange(4.0))
    expected = np.stack((column.ravel(), row.ravel()), axis=1) @ deformation.T + (0.3, -0.2)
    assert np.allclose(vertices[:, :2], expected, atol=1e-12) and np.allclose(vertices[:, 2], 0.6, atol=1e-12)
    corner = vertices[sheet.face_vertices][:, :, :2]
    a, b = corner[:, 1] - corner[:, 0], corner[:, 3] - corner[:, 0]
    assert np.allclose(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], np.linalg.det(deformation))
