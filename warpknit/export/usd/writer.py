"""`StageWriter`: frames in, a stage on the disk that is whole at any time."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from warpknit.export.run_record import RunRecord
from warpknit.export.usd import scene, shapes
from warpknit.export.usd.tiles import MILLIMETRES, POINTS_PER_TILE, Sheet, cut_tiles
from warpknit.results.frame import Frame, WireLayout, curve_position, drawn_frame, drawn_layout

MARKER_WIDTH = 2.5  # diameters: a sphere about a clasp that reaches the centres of wires 1.25 diameters away
UNITS = {"length": "mm", "stress": "Pa", "force": "N", "temperature": "K", "strain": "1"}
LOADS = {
    "factor": "load_factor",
    "strainWeft": "strain_weft",
    "strainWarp": "strain_warp",
    "shear": "shear",
    "temperature": "temperature",
}


class StageWriter:
    """Writes a stage into `directory`: `add_frame` for each frame, `close` at the end. A stage that was there is replaced.

    `colour_stress_max` [Pa]: colour the wires, gold at zero stress to dark violet here; without it they are gold. `full_every`:
    interval of frames with all points, beside the first frame and ends of load steps; 0: no others. `points_per_tile`: about.
    """

    def __init__(
        self,
        directory: Path,
        layout: WireLayout,
        *,
        scene_name: str,
        scene_hash: str,
        version: str,
        colour_stress_max: float | None = None,
        full_every: int = 1,
        points_per_tile: int = POINTS_PER_TILE,
    ) -> None:
        if colour_stress_max is not None and not (np.isfinite(colour_stress_max) and colour_stress_max > 0.0):
            raise ValueError(f"colour_stress_max: {colour_stress_max} is not a positive stress in Pa")
        if np.any(np.diff(layout.curve_start) < 3):
            raise ValueError("layout: a wire needs three points or more")
        self.directory = directory
        self.path = self.directory / "scene.usda"
        self.layout = layout
        self._colour_stress_max = colour_stress_max
        self._full_every = full_every
        self._points_per_tile = points_per_tile
        self._metadata: dict[str, Any] = {
            "version": version,
            "sceneName": scene_name,
            "sceneHash": scene_hash,
            "wires": layout.wire_count,
            "nodes": layout.node_count,
            "bodies": layout.body_count,
            "colourStressMax": float(colour_stress_max or 0.0),
            "units": dict(UNITS),
            "wireDiameter": layout.diameter * MILLIMETRES,
            "bodyRadius": layout.body_radius * MILLIMETRES,
        }
        self._loads: dict[int, dict[str, Any]] = {}
        self._full: list[int] = []
        self._marker_width = MARKER_WIDTH * layout.diameter * MILLIMETRES  # [mm]
        self._scene: Sdf.Layer | None = None  # without a frame yet
        self._low, self._high = np.full(3, np.inf), np.full(3, -np.inf)  # [mm] of all frames

    @property
    def frames(self) -> tuple[int, ...]:
        """Indices of the frames in the stage."""
        return tuple(self._loads)

    def add_frame(self, frame: Frame, *, names: bool = True) -> Path:
        """Write one frame; its path. Raises ValueError where a number is not finite.

        names: whether the stage on the disk names it at once; else with the next one.
        """
        frame.require_layout(self.layout)
        frame.require_finite()
        if self._loads and frame.index <= max(self._loads):
            raise ValueError(f"frame {frame.index}: the stage already has frame {max(self._loads)}")
        if self._scene is None:
            self._begin(frame)
        is_full = not self._full or frame.load_factor == 1.0
        is_full |= self._full_every > 0 and frame.index % self._full_every == 0
        path = self.directory / scene.FRAMES / scene.frame_file(frame.index)
        layer = Sdf.Layer.CreateAnonymous(path.name)
        layer.defaultPrim = scene.FULL if is_full else scene.K8
        with Sdf.ChangeBlock():
            for prim, values in self._values(frame, is_full).items():
                shapes.author(layer, prim, values, frame.index)
        scene.write_layer(layer, path)
        self._loads[frame.index] = {"stage": frame.stage, **{name: getattr(frame, source) for name, source in LOADS.items()}}
        if is_full:
            self._full.append(frame.index)
        if names:
            self._write_scene(complete=False)
        return path

    def close(self, *, complete: bool = True) -> None:
        """Record in the stage whether the run came to its end. A stage without a frame is not written."""
        if self._loads:
            self._write_scene(complete=complete)

    def _begin(self, frame: Frame) -> None:
        """Remove an earlier stage, and write what does not move."""
        self.directory.mkdir(parents=True, exist_ok=True)
        self.path.unlink(missing_ok=True)
        for pattern in ("wires.[0-9]*.usdc", ".wires.*.partial.usdc"):
            for path in (self.directory / scene.FRAMES).glob(pattern):
                path.unlink()
        position, layout = curve_position(self.layout, frame), self.layout
        self._tiles = cut_tiles(layout, position, self._points_per_tile)
        kept = MILLIMETRES * np.concatenate([tile.take(position)[tile.thinning.kept] for tile in self._tiles])
        bodies, size = MILLIMETRES * frame.body_position[:, :2], MILLIMETRES * layout.period
        self._sheet = Sheet(kept[:, :2], bodies, size, frame.deformation, layout.repeats)
        self._sheet_origin = np.round(0.5 * (kept.min(axis=0) + kept.max(axis=0)), 3)  # [mm]
        pose = self._values(frame, is_full=True)
        scene.write_layer(self._topology(pose), self.directory / scene.TOPOLOGY)
        manifest = Sdf.Layer.CreateAnonymous("manifest.usda")
        manifest.defaultPrim = scene.FULL
        for prim, values in pose.items():
            shapes.declare(manifest, prim, values)
        scene.write_layer(manifest, self.directory / scene.MANIFEST)
        name, scene_hash = self._metadata["sceneName"], self._metadata["sceneHash"]
        self._scene = scene.new_scene(self._tiles, name, scene_hash, shows_stress=self._colour_stress_max is not None)

    def _values(self, frame: Frame, is_full: bool) -> dict[Sdf.Path, shapes.Values]:
        """Moving values of one frame, tile by tile and then the sheet; the bounds of the stage grow with them."""
        layout, limit = self.layout, self._colour_stress_max
        width, marker = layout.diameter * MILLIMETRES, self._marker_width
        position, stress = curve_position(layout, frame), frame.node_stress[layout.curve_node]
        force, active = frame.pair_force.reshape(-1, 2), frame.pair_active.reshape(-1, 2)
        found, kept = {}, []
        for tile in self._tiles:
            points, tile_stress = tile.local(tile.take(position)), tile.take(stress).astype(np.float32)
            if is_full:
                found[_prim(scene.FULL, tile.name, "Wires")] = shapes.wire_values(points, tile_stress, width, limit)
            points, tile_stress = points[tile.thinning.kept], tile.thinning.largest(tile_stress)
            found[_prim(scene.K8, tile.name, "Wires")] = shapes.wire_values(points, tile_stress, width, limit)
            kept.append((points + tile.origin, tile_stress))
            if tile.bodies.size:
                points = tile.local(frame.body_position[tile.bodies])
                values = shapes.contact_values(points, force[tile.bodies], active[tile.bodies], marker)
                found[_prim(scene.CONTACTS, tile.name, "Contacts")] = values
            if layout.in_space:
                mine = np.isin(frame.elsewhere_wires[:, 0], tile.wires)
                points, wires = tile.local(frame.elsewhere_position[mine]), frame.elsewhere_wires[mine]
                values = shapes.elsewhere_values(points, frame.elsewhere_force[mine], wires, marker)
                found[_prim(scene.CONTACTS, tile.name, "ContactsElsewhere")] = values
        points, tile_stress = map(np.concatenate, zip(*kept, strict=True))
        place = (self._sheet.position(points, frame.deformation) - self._sheet_origin).astype(np.float32)
        share = self._sheet.active_percent(frame.pair_active)
        values = shapes.wire_values(place, self._sheet.largest(tile_stress), width, limit)
        found[_prim(scene.SURFACE, "Surface")] = values | {"primvars:warpknit:activeShare": share}
        self._low = np.minimum(self._low, MILLIMETRES * position.min(axis=0) - 0.5 * marker)
        self._high = np.maximum(self._high, MILLIMETRES * position.max(axis=0) + 0.5 * marker)
        return found

    def _topology(self, pose: Mapping[Sdf.Path, shapes.Values]) -> Sdf.Layer:
        """Static values, and the pose without a clip."""
        layer = Sdf.Layer.CreateAnonymous("topology.usdc")
        stage = Usd.Stage.Open(layer)
        scene.set_units(stage)
        layout, shows_stress = self.layout, self._colour_stress_max is not None
        purpose = UsdGeom.Tokens.render if len(self._tiles) > 1 else UsdGeom.Tokens.default_
        for part in (scene.FULL, scene.K8, scene.CONTACTS, scene.SURFACE):
            UsdGeom.Xform.Define(stage, f"/{part}")
        stage.SetDefaultPrim(stage.GetPrimAtPath(f"/{scene.FULL}"))
        for tile in self._tiles:
            for part in (scene.FULL, scene.K8, scene.CONTACTS):
                xform = UsdGeom.Xform.Define(stage, _prim(part, tile.name))
                xform.AddTranslateOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Vec3d(*tile.origin.tolist()))
            own = layout.wire_diameter[tile.wires] * MILLIMETRES
            drawn = [
                shapes.define_wires(stage, _prim(part, tile.name, "Wires"), tile.wires, counts, own, shows_stress=shows_stress)
                for part, counts in ((scene.FULL, tile.point_counts), (scene.K8, tile.thinning.counts))
            ]
            path, wires = _prim(scene.CONTACTS, tile.name), layout.body_wires[tile.bodies]
            if tile.bodies.size:
                drawn.append(shapes.define_contacts(stage, path.AppendChild("Contacts"), tile.bodies, wires, self._marker_width))
            if layout.in_space:
                drawn.append(shapes.define_elsewhere(stage, path.AppendChild("ContactsElsewhere")))
            for shape in drawn:
                shape.CreatePurposeAttr(purpose)
        faces, pairs = self._sheet.face_vertices, self._sheet.pair_counts
        sheet = shapes.define_surface(stage, _prim(scene.SURFACE, "Surface"), faces, pairs, shows_stress=shows_stress)
        sheet.AddTranslateOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Vec3d(*self._sheet_origin.tolist()))
        sheet.CreatePurposeAttr(UsdGeom.Tokens.proxy)
        for prim, values in pose.items():
            shapes.author(layer, prim, values)
        return layer

    def _write_scene(self, *, complete: bool) -> None:
        """Update frame list, time codes and camera, and write scene.usda."""
        layer, frames = self._scene, self.frames
        assert layer is not None
        scene.set_clips(layer, frames, self._full)
        loads = {name: Vt.DoubleArray([load[name] for load in self._loads.values()]) for name in LOADS}
        layer.customLayerData = {
            "warpknit": {
                **self._metadata,
                "complete": complete,
                "frames": Vt.IntArray(list(frames)),
                "fullFrames": Vt.IntArray(self._full),
                "load": {"stage": Vt.StringArray([load["stage"] for load in self._loads.values()]), **loads},
            }
        }
        scene.place_camera(layer, self._low, self._high)
        scene.write_layer(layer, self.path)


def _prim(*names: str) -> Sdf.Path:
    """Path in the layers other than scene.usda: a part, a tile and a shape."""
    return Sdf.Path("/" + "/".join(names))


def export_usd(record: RunRecord) -> list[Path]:
    """Write scene.usda and its layers; the paths, the stage first."""
    writer = StageWriter(
        record.directory,
        drawn_layout(record.layout),
        scene_name=record.name,
        scene_hash=record.scene_hash,
        version=record.version,
        colour_stress_max=record.yield_stress,
    )
    frames = [writer.add_frame(drawn_frame(record.layout, frame)) for frame in record.frames()]
    writer.close(complete=record.stop_reason in ("steady", "finished"))
    return [writer.path, *frames]
