"""`StageWriter`: frames in, a stage on the disk that is whole at any time."""

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from warpknit.base.files import path_aside
from warpknit.export.run_record import RunRecord
from warpknit.export.usd.scene import (
    CONTACTS,
    FRAMES,
    FULL,
    K8,
    MANIFEST,
    SURFACE,
    TOPOLOGY,
    frame_file,
    new_scene,
    place_camera,
    save_layer,
    set_clips,
    set_units,
    write_layer,
)
from warpknit.export.usd.shapes import (
    Values,
    contact_values,
    declare,
    define_contacts,
    define_elsewhere,
    define_surface,
    define_wires,
    elsewhere_values,
    surface_values,
    wire_values,
)
from warpknit.export.usd.tiles import MILLIMETRES, POINTS_PER_TILE, Sheet, Thinning, Tile, cut_tiles, from_origin, tile_of
from warpknit.results.frame import Frame, WireLayout, curve_position, drawn_frame, drawn_layout

LAYOUT = "tiles, lod: full, k8, surface; contacts between stitches"  # stages of another layout are not continued
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
    """Writes a stage into `directory`: `add_frame` for each frame, `close` at the end.

    `colour_stress_max` [Pa]: colour the wires, gold at zero stress to dark violet here; without it they are gold. `full_every`:
    interval of frames with all points, beside the first frame and ends of load steps; 0: no others. `points_per_tile`: about.
    `resume`: continue the stage in the directory, if it is of the same scene. `earlier_frames`: its whole frames. `streaming`:
    write one frame while the next is made; `flush` waits for the last, and errors come one frame later.
    """

    def __init__(
        self,
        directory: str | os.PathLike[str],
        layout: WireLayout,
        *,
        scene_name: str,
        scene_hash: str,
        version: str,
        colour_stress_max: float | None = None,
        frames_per_second: float = 10.0,
        full_every: int = 1,
        points_per_tile: int = POINTS_PER_TILE,
        resume: bool = False,
        streaming: bool = False,
    ) -> None:
        if colour_stress_max is not None and not (np.isfinite(colour_stress_max) and colour_stress_max > 0.0):
            raise ValueError(f"colour_stress_max: {colour_stress_max} is not a positive stress in Pa")
        if np.any(np.diff(layout.curve_start) < 3):
            raise ValueError("layout: a wire needs three points or more")
        self.directory = Path(directory)
        self.path = self.directory / "scene.usda"
        self.layout = layout
        self._colour_stress_max = colour_stress_max
        self._full_every = full_every
        self._points_per_tile = points_per_tile
        self._frames_per_second = frames_per_second
        self._metadata: dict[str, Any] = {"version": version, "sceneName": scene_name, "sceneHash": scene_hash}
        self._metadata |= {"layout": LAYOUT, "pointsPerTile": points_per_tile, "fullEvery": full_every}
        self._metadata |= {"wires": layout.wire_count, "nodes": layout.node_count, "bodies": layout.body_count}
        self._metadata |= {"colourStressMax": float(colour_stress_max or 0.0)}
        self._loads: dict[int, dict[str, Any]] = {}
        self._full: set[int] = set()
        self._tiles: tuple[Tile, ...] = ()
        self._thinnings: tuple[Thinning, ...] = ()
        self._surface: Sheet | None = None
        self._origin = np.zeros(3)  # [mm] of the sheet
        self._scene: Sdf.Layer | None = None
        self._low, self._high = np.full(3, np.inf), np.full(3, -np.inf)
        self._complete = False
        self._disk = ThreadPoolExecutor(1, "frame") if streaming else None
        self._pending: Future[None] | None = None
        self._earlier = _earlier_stage(self.path) if resume else {}
        self.earlier_frames = self._usable_frames()

    @property
    def frames(self) -> tuple[int, ...]:
        """Indices of the frames in the stage."""
        return tuple(sorted(self._loads))

    def add_frame(self, frame: Frame) -> Path:
        """Write one frame and name it in the stage; its path. Raises ValueError where a number is not finite."""
        frame.require_layout(self.layout)
        frame.require_finite()
        if self._loads and frame.index <= max(self._loads):
            raise ValueError(f"frame {frame.index}: the stage already has frame {max(self._loads)}")
        if self._scene is None:
            self._begin(frame)
        is_full = not self._full or frame.load_factor == 1.0
        is_full |= self._full_every > 0 and frame.index % self._full_every == 0
        path = self.directory / FRAMES / frame_file(frame.index)
        with ExitStack() as stack:
            layer = Sdf.Layer.CreateNew(str(stack.enter_context(path_aside(path))))
            layer.defaultPrim = FULL if is_full else K8
            with Sdf.ChangeBlock():
                for prim, values in self._samples(frame, is_full):
                    declare(layer, prim, values)
                    for name, value in values.items():
                        layer.SetTimeSample(prim.AppendProperty(name), frame.index, value)
            del values
            save_layer(layer, path)
            del layer
            bring_to_disk = stack.pop_all().close
        self.flush()
        if self._disk is None:
            bring_to_disk()
        self._loads[frame.index] = _load(frame)
        if is_full:
            self._full.add(frame.index)
        if self._disk is not None:
            self._pending = self._disk.submit(bring_to_disk)
        else:
            self._write_scene()
        return path

    def flush(self) -> None:
        """Wait until the last frame is on disk, and name it in the stage."""
        if self._pending is None:
            return
        pending, self._pending = self._pending, None
        try:
            pending.result()
        except BaseException:
            last = max(self._loads)
            del self._loads[last]
            self._full.discard(last)
            raise
        self._write_scene()

    def close(self, *, complete: bool = True) -> None:
        """Say in the stage whether the run came to its end. A stage without a frame is not written."""
        self.flush()
        self._complete = complete
        if self._scene is not None and self._loads:
            self._write_scene()
        if self._disk is not None:
            self._disk.shutdown()

    # --- at the first frame ---

    def _begin(self, frame: Frame) -> None:
        """Write what does not move; keep earlier frames that come before `frame`, and drop all others."""
        self.directory.mkdir(parents=True, exist_ok=True)
        self._take_up([index for index in self.earlier_frames if index < frame.index])
        if not self._loads:
            self._start(frame)
        points = sum(thinning.kept.size for thinning in self._thinnings)
        self._scene = new_scene(
            self._tiles,
            points,
            name=self._metadata["sceneName"],
            scene_hash=self._metadata["sceneHash"],
            frames_per_second=self._frames_per_second,
            shows_stress=self._colour_stress_max is not None,
        )
        if self._loads:
            self._write_scene()
        self._remove_leftovers()

    def _start(self, frame: Frame) -> None:
        self.path.unlink(missing_ok=True)
        self._set_tiles(cut_tiles(self.layout, curve_position(self.layout, frame), self._points_per_tile))
        pose = dict(self._tile_samples(frame, True))
        self._set_surface({prim: values["points"] for prim, values in pose.items()}, frame.deformation)
        pose[_prim(SURFACE)] = self._sheet_values(frame, pose)
        write_layer(self._topology(pose), self.directory / TOPOLOGY)
        manifest = Sdf.Layer.CreateAnonymous("manifest.usda")
        manifest.defaultPrim = FULL
        for prim, values in pose.items():
            declare(manifest, prim, values)
        write_layer(manifest, self.directory / MANIFEST)

    def _usable_frames(self) -> tuple[int, ...]:
        """Frames of an earlier stage, up to the first lost file."""
        if any(self._earlier.get(name) != value for name, value in self._metadata.items() if name != "version"):
            return ()
        frames = list(self._earlier["frames"])
        lost = [number for number, index in enumerate(frames) if not (self.directory / FRAMES / frame_file(index)).is_file()]
        return tuple(frames[: lost[0]] if lost else frames)

    def _take_up(self, frames: Sequence[int]) -> None:
        """Go on with the earlier stage: these of its frames, and its tiles."""
        if not frames:
            return
        loads = _earlier_loads(self._earlier)
        self._loads = {index: loads[index] for index in frames}
        self._full = {index for index in self._earlier["fullFrames"] if index in self._loads}
        self._low, self._high = np.array(self._earlier["boundsLow"]), np.array(self._earlier["boundsHigh"])
        topology = Sdf.Layer.OpenAsAnonymous(str(self.directory / TOPOLOGY))
        tiles, points = [], {}
        for spec in topology.GetPrimAtPath(f"/{K8}").nameChildren:
            path = spec.path.AppendChild("Wires")
            wires = np.array(topology.GetAttributeAtPath(f"{path}.primvars:warpknit:wireId").default, dtype=np.int64)
            tiles.append(tile_of(self.layout, spec.name, wires, np.array(spec.attributes["xformOp:translate"].default)))
            for prim in (path, _prim(CONTACTS, spec.name)):
                if attribute := topology.GetAttributeAtPath(prim.AppendProperty("points")):
                    points[prim] = attribute.default
        self._set_tiles(tuple(tiles))
        first = loads[min(loads)]
        deformation = np.array([[1.0 + first["strainWeft"], first["shear"]], [0.0, 1.0 + first["strainWarp"]]])
        self._set_surface(points, deformation)

    def _set_tiles(self, tiles: tuple[Tile, ...]) -> None:
        self._tiles = tiles
        self._thinnings = tuple(Thinning.of(tile.point_counts) for tile in tiles)

    def _set_surface(self, points: Mapping[Sdf.Path, Any], deformation: NDArray[Any]) -> None:
        """Lay the sheet through the points [mm] of the first frame, tile by tile."""
        bodies = np.zeros((self.layout.body_count, 2))
        for tile in self._tiles:
            if tile.bodies.size:
                bodies[tile.bodies] = np.array(points[_prim(CONTACTS, tile.name)])[:, :2] + tile.origin[:2]
        wires = np.concatenate([np.array(points[_prim(K8, tile.name)]) + tile.origin for tile in self._tiles])
        self._surface = Sheet(wires[:, :2], bodies, self.layout.period * MILLIMETRES, deformation, self.layout.repeats)
        self._origin = np.round(0.5 * (wires.min(axis=0) + wires.max(axis=0)), 3)

    def _remove_leftovers(self) -> None:
        """Remove files of a killed run, and frames unknown to the stage."""
        for leftover in (*self.directory.glob(".*.partial.*"), *(self.directory / FRAMES).glob(".wires.*.partial.*")):
            if re.match(r"\.(scene|wires\.\w+)\.partial\.", leftover.name):
                leftover.unlink()
        keep = {frame_file(index) for index in self._loads}
        for path in (self.directory / FRAMES).glob("wires.*.usdc"):
            if re.fullmatch(r"wires\.\d{6,}\.usdc", path.name) and path.name not in keep:
                path.unlink()

    # --- layers ---

    def _samples(self, frame: Frame, is_full: bool) -> Iterator[tuple[Sdf.Path, Values]]:
        """Moving values of one frame: (prim, attribute -> value), tile by tile and then the sheet."""
        kept = {}
        for prim, values in self._tile_samples(frame, is_full):
            if prim.HasPrefix(f"/{K8}"):
                kept[prim] = values
            yield prim, values
        yield _prim(SURFACE), self._sheet_values(frame, kept)

    def _tile_samples(self, frame: Frame, is_full: bool) -> Iterator[tuple[Sdf.Path, Values]]:
        layout, limit = self.layout, self._colour_stress_max
        width = layout.diameter * MILLIMETRES
        position = curve_position(layout, frame)
        stress = frame.node_stress[layout.curve_node] if layout.curve_closing.size else frame.node_stress
        force, active = frame.pair_force.reshape(-1, 2), frame.pair_active.reshape(-1, 2)
        for tile, thinning in zip(self._tiles, self._thinnings, strict=True):
            tile_stress, points = tile.take(stress, np.float32), tile.local(position)
            if is_full:
                yield self._seen(tile, _prim(FULL, tile.name), wire_values(points, tile_stress, width, limit))
            points = points[thinning.kept]
            values = wire_values(points, thinning.largest(tile_stress), width, limit)
            yield self._seen(tile, _prim(K8, tile.name), values)
            if tile.bodies.size:
                points = np.empty((tile.bodies.size, 3), dtype=np.float32)
                from_origin(frame.body_position[tile.bodies], tile.origin, points)
                values = contact_values(points, force[tile.bodies], active[tile.bodies], MARKER_WIDTH * width)
                yield self._seen(tile, _prim(CONTACTS, tile.name), values)
            if layout.in_space:
                mine = np.isin(frame.elsewhere_wires[:, 0], tile.wires)
                place, wires = frame.elsewhere_position[mine], frame.elsewhere_wires[mine]
                points = from_origin(place, tile.origin, np.empty(place.shape, dtype=np.float32))
                values = elsewhere_values(points, frame.elsewhere_force[mine], wires, MARKER_WIDTH * width)
                yield self._seen(tile, _elsewhere(tile.name), values)

    def _sheet_values(self, frame: Frame, kept: Mapping[Sdf.Path, Values]) -> Values:
        """Moving values of the sheet, from the kept points of the tiles."""
        assert self._surface is not None
        thinned = [(tile, kept[_prim(K8, tile.name)]) for tile in self._tiles]
        points = np.concatenate([np.asarray(values["points"]) + tile.origin for tile, values in thinned])
        stress = np.concatenate([np.asarray(values["primvars:warpknit:stress"]) for _, values in thinned])
        return surface_values(
            (self._surface.position(points, frame.deformation) - self._origin).astype(np.float32),
            self._surface.largest(stress),
            self._surface.active_percent(frame.pair_active),
            self.layout.diameter * MILLIMETRES,
            self._colour_stress_max,
        )

    def _seen(self, tile: Tile, prim: Sdf.Path, values: Values) -> tuple[Sdf.Path, Values]:
        """The same, with the bounds of the stage extended to it."""
        low, high = np.array(values["extent"]) + tile.origin
        self._low, self._high = np.minimum(self._low, low), np.maximum(self._high, high)
        return prim, values

    def _topology(self, pose: Mapping[Sdf.Path, Values]) -> Sdf.Layer:
        """Static values, and the pose without a clip."""
        layer = Sdf.Layer.CreateAnonymous("topology.usdc")
        stage = Usd.Stage.Open(layer)
        set_units(stage)
        width, shows_stress = self.layout.diameter * MILLIMETRES, self._colour_stress_max is not None
        purpose = UsdGeom.Tokens.render if len(self._tiles) > 1 else UsdGeom.Tokens.default_
        for part in (FULL, K8, CONTACTS, SURFACE):
            UsdGeom.Xform.Define(stage, f"/{part}")
        stage.SetDefaultPrim(stage.GetPrimAtPath(f"/{FULL}"))
        for tile, thinning in zip(self._tiles, self._thinnings, strict=True):
            for part, counts in ((FULL, tile.point_counts), (K8, thinning.counts), (CONTACTS, None)):
                prim = _prim(part, tile.name)
                xform = UsdGeom.Xform.Define(stage, prim.GetParentPath())
                xform.AddTranslateOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Vec3d(*tile.origin.tolist()))
                shapes = []
                if counts is not None:
                    own = self.layout.wire_diameter[tile.wires] * MILLIMETRES
                    shapes.append(define_wires(stage, prim, tile.wires, counts, own, shows_stress=shows_stress))
                elif tile.bodies.size:
                    wires = self.layout.body_wires[tile.bodies]
                    shapes.append(define_contacts(stage, prim, tile.bodies, wires, MARKER_WIDTH * width))
                if counts is None and self.layout.in_space:
                    shapes.append(define_elsewhere(stage, _elsewhere(tile.name)))
                for shape in shapes:
                    shape.CreatePurposeAttr(purpose)
        assert self._surface is not None
        faces, pairs = self._surface.face_vertices, self._surface.pair_counts
        sheet = define_surface(stage, _prim(SURFACE), faces, pairs, shows_stress=shows_stress)
        sheet.AddTranslateOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Vec3d(*self._origin.tolist()))
        sheet.CreatePurposeAttr(UsdGeom.Tokens.proxy)
        for prim, values in pose.items():
            declare(layer, prim, values)
            for name, value in values.items():
                layer.GetAttributeAtPath(prim.AppendProperty(name)).default = value
        return layer

    def _write_scene(self) -> None:
        """Update frame list, time codes and camera, and write scene.usda."""
        layer, frames = self._scene, self.frames
        assert layer is not None
        set_clips(layer, frames, sorted(self._full))
        loads = [self._loads[index] for index in frames]
        layer.customLayerData = {
            "warpknit": {
                **self._metadata,
                "complete": self._complete,
                "frames": Vt.IntArray(list(frames)),
                "fullFrames": Vt.IntArray(sorted(self._full)),
                "load": {
                    "stage": Vt.StringArray([load["stage"] for load in loads]),
                    **{name: Vt.DoubleArray([load[name] for load in loads]) for name in LOADS},
                },
                "units": dict(UNITS),
                "wireDiameter": self.layout.diameter * MILLIMETRES,
                "bodyRadius": self.layout.body_radius * MILLIMETRES,
                "boundsLow": Vt.DoubleArray(self._low.tolist()),
                "boundsHigh": Vt.DoubleArray(self._high.tolist()),
            }
        }
        place_camera(layer, self._low, self._high)
        write_layer(layer, self.path)


def _prim(part: str, tile: str | None = None) -> Sdf.Path:
    """Path of what is drawn in the layers other than scene.usda."""
    if tile is None:
        return Sdf.Path(f"/{part}/{SURFACE}")
    return Sdf.Path(f"/{part}/{tile}/{'Contacts' if part == CONTACTS else 'Wires'}")


def _elsewhere(tile: str) -> Sdf.Path:
    """Path of the contacts between stitches of a tile, beside those at hooks."""
    return Sdf.Path(f"/{CONTACTS}/{tile}/ContactsElsewhere")


def _load(frame: Frame) -> dict[str, object]:
    return {"stage": frame.stage, **{name: getattr(frame, source) for name, source in LOADS.items()}}


def _earlier_stage(path: Path) -> dict[str, Any]:
    """The customLayerData of a stage that an earlier run left; empty where there is none."""
    if not (path.is_file() and (path.parent / TOPOLOGY).is_file()):
        return {}
    layer = Sdf.Layer.OpenAsAnonymous(str(path))
    return dict(layer.customLayerData.get("warpknit", {})) if layer else {}


def _earlier_loads(data: Mapping[str, Any]) -> dict[int, dict[str, Any]]:
    columns = {name: list(values) for name, values in data["load"].items()}
    return {index: {name: values[number] for name, values in columns.items()} for number, index in enumerate(data["frames"])}


def export_usd(record: RunRecord) -> list[Path]:
    """Write scene.usda and its layers; the paths, the stage first."""
    writer = StageWriter(
        record.directory,
        drawn_layout(record.layout),
        scene_name=record.name,
        scene_hash=record.scene_hash,
        version=record.version,
        colour_stress_max=record.yield_stress,
        streaming=True,
    )
    frames = [writer.add_frame(drawn_frame(record.layout, frame)) for frame in record.frames()]
    writer.close(complete=record.stop_reason in ("steady", "finished"))
    return [writer.path, *frames]
