"""A run as a USD stage that Blender, usdview and Omniverse open, written frame by frame.

    scene.usda                 the stage: units, time codes, camera, lights, materials, and the list of frames
    wires.topology.usdc        what does not move: curve counts, widths, names; and the pose of the first frame
    wires.manifest.usda        which attributes move
    frames/wires.######.usdc   one frame each, joined by value clips

    /World/Panel/Tile_##    a run of whole wires under a double translate, so that float32 points lie near zero
        Wires     BasisCurves, linear: the points are the nodes; a closed wire ends with its first node one period on.
                  primvars:warpknit:wireId (uniform), :stress (vertex) [Pa]
        Contacts  Points, one a contact body; widths are those of a marker that reaches both wires.
                  primvars:warpknit:active (both pairs closed: 0 or 1), :activePairs (0, 1 or 2),
                  :normalForceA, :normalForceB, :normalForce (what passes from wire to wire: the smaller one) [N],
                  :wireA, :wireB

Lengths are in mm, everything else in SI. A time code is the index of a frame. A frame is on the disk before the stage
names it, and every file is written aside and renamed, so a killed run leaves a stage with the frames it had finished.
`active` and `activePairs` are integers because USD interpolates floats between frames and holds integers.
"""

import errno
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Kind, Sdf, Tf, Usd, UsdGeom, UsdLux, UsdShade, Vt

from warpknit.files import path_aside
from warpknit.frame import Frame, WireLayout, curve_position

__all__ = ["StageWriter", "stress_colour"]

MILLIMETRES = 1000.0  # stage units in a metre
SCENE, TOPOLOGY, MANIFEST, FRAMES = "scene.usda", "wires.topology.usdc", "wires.manifest.usda", "frames"
PANEL = Sdf.Path("/Panel")  # the panel's path in the layers other than scene.usda
GOLD = Gf.Vec3f(1.0, 0.77, 0.34)
OPEN_COLOUR, ACTIVE_COLOUR = np.array([[0.75, 0.75, 0.75], [0.8, 0.02, 0.02]], dtype=np.float32)
# Gold at rest to dark violet at the limit: lightness falls steadily, so it reads without colour vision. Linear RGB.
STRESS_COLOURS = np.array([GOLD, (0.90, 0.33, 0.10), (0.60, 0.08, 0.10), (0.22, 0.02, 0.16), (0.03, 0.005, 0.10)])

UNITS = {"length": "mm", "stress": "Pa", "force": "N", "temperature": "K", "strain": "1"}
LOADS = {
    "factor": "load_factor",
    "strainWeft": "strain_weft",
    "strainWarp": "strain_warp",
    "shear": "shear",
    "temperature": "temperature",
}

POINT3, FLOATS, INTS, COLOURS = (
    Sdf.ValueTypeNames.Point3fArray,
    Sdf.ValueTypeNames.FloatArray,
    Sdf.ValueTypeNames.IntArray,
    Sdf.ValueTypeNames.Color3fArray,
)
Attributes: TypeAlias = tuple[tuple[str, Any, str], ...]  # name, type, interpolation of a primvar
MOVING_WIRES: Attributes = (
    ("points", POINT3, ""),
    ("extent", Sdf.ValueTypeNames.Float3Array, ""),
    ("primvars:warpknit:stress", FLOATS, "vertex"),
    ("primvars:displayColor", COLOURS, "vertex"),
)
MOVING_CONTACTS: Attributes = (
    ("points", POINT3, ""),
    ("extent", Sdf.ValueTypeNames.Float3Array, ""),
    ("primvars:warpknit:active", INTS, "vertex"),
    ("primvars:warpknit:activePairs", INTS, "vertex"),
    ("primvars:warpknit:normalForce", FLOATS, "vertex"),
    ("primvars:warpknit:normalForceA", FLOATS, "vertex"),
    ("primvars:warpknit:normalForceB", FLOATS, "vertex"),
    ("primvars:displayColor", COLOURS, "vertex"),
)


@dataclass(frozen=True, eq=False)
class _Tile:
    """A run of whole wires, and the bodies whose first wire is among them."""

    name: str
    wires: slice
    points: slice  # of the drawn curves
    bodies: slice | NDArray[np.int64]
    body_count: int
    origin: NDArray[np.float64]  # [3] [mm]


class StageWriter:
    """Write a stage into `directory`, one call of `add_frame` a frame, and `close` at the end.

    `colour_stress_max` [Pa]: colour the wires, gold at zero stress to dark violet here; without it they are gold.
    `resume`: go on with the stage that is in the directory, if it is of the same scene; the frames from the first one
    that is added again are written anew.
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
        points_per_tile: int = 500_000,
        resume: bool = False,
    ) -> None:
        if colour_stress_max is not None and not (np.isfinite(colour_stress_max) and colour_stress_max > 0.0):
            raise ValueError(f"colour_stress_max: {colour_stress_max} is not a positive stress in Pa")
        if np.any(np.diff(layout.curve_start) < 3):
            raise ValueError("layout: a wire needs three points or more")
        self.directory = Path(directory)
        self.path = self.directory / SCENE
        self.layout = layout
        self._colour_stress_max = colour_stress_max
        self._points_per_tile = points_per_tile
        self._frames_per_second = frames_per_second
        self._metadata: dict[str, Any] = {"version": version, "sceneName": scene_name, "sceneHash": scene_hash}
        self._loads: dict[int, dict[str, Any]] = {}
        self._tiles: tuple[_Tile, ...] = ()
        self._scene: Sdf.Layer | None = None
        self._low, self._high = np.full(3, np.inf), np.full(3, -np.inf)
        self._complete = False
        self._metadata |= {"pointsPerTile": points_per_tile, "wires": layout.wire_count, "nodes": layout.node_count}
        self._metadata |= {"bodies": layout.body_count, "colourStressMax": float(colour_stress_max or 0.0)}
        self._earlier = _earlier_stage(self.path) if resume else {}

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
        position = curve_position(self.layout, frame) * MILLIMETRES
        body_position = frame.body_position * MILLIMETRES
        if self._scene is None:
            self._begin(frame, position, body_position)
        path = self.directory / FRAMES / f"wires.{frame.index:06d}.usdc"
        with path_aside(path) as aside, _disk_errors(path):
            layer = Sdf.Layer.CreateNew(str(aside))
            layer.defaultPrim = PANEL.name
            with Sdf.ChangeBlock():
                for prim, values, attributes in self._samples(frame, position, body_position):
                    _declare(layer, prim, attributes, values)
                    for name, value in values.items():
                        layer.SetTimeSample(prim.AppendProperty(name), frame.index, value)
            _written(layer.Save(), path)
            del layer
        self._loads[frame.index] = _load(frame)
        for points in (position, body_position):
            if points.size:
                low, high = _bounds(points)
                self._low, self._high = np.minimum(self._low, low), np.maximum(self._high, high)
        self._write_scene()
        return path

    def close(self, *, complete: bool = True) -> None:
        """Say in the stage whether the run came to its end. A stage without a frame is not written."""
        self._complete = complete
        if self._scene is not None:
            self._write_scene()

    def _begin(self, frame: Frame, position: NDArray[Any], body_position: NDArray[Any]) -> None:
        """Write what does not move; keep earlier frames that come before `frame`, and drop all others."""
        self.directory.mkdir(parents=True, exist_ok=True)
        self._tiles = _tiles(self.layout, position, self._points_per_tile)
        if all(self._earlier.get(name) == value for name, value in self._metadata.items() if name != "version"):
            loads = _earlier_loads(self._earlier)
            self._loads = {index: load for index, load in loads.items() if index < frame.index}
        if self._loads:
            self._low, self._high = np.array(self._earlier["boundsLow"]), np.array(self._earlier["boundsHigh"])
            origins = _earlier_origins(self.directory / TOPOLOGY)  # the tiles stay where the earlier frames lie
            self._tiles = tuple(replace(tile, origin=origins[tile.name]) for tile in self._tiles)
            self._scene = self._new_scene()
            self._write_scene()
        else:
            self.path.unlink(missing_ok=True)
            _export(self._topology(frame, position, body_position), self.directory / TOPOLOGY)
            _export(self._manifest(), self.directory / MANIFEST)
            self._scene = self._new_scene()
        for leftover in (*self.directory.glob(".*.partial.*"), *(self.directory / FRAMES).glob(".wires.*.partial.*")):
            if re.match(r"\.(scene|wires\.\w+)\.partial\.", leftover.name):  # of a run that was killed
                leftover.unlink()
        keep = {f"wires.{index:06d}.usdc" for index in self._loads}
        for path in (self.directory / FRAMES).glob("wires.*.usdc"):
            if re.fullmatch(r"wires\.\d{6,}\.usdc", path.name) and path.name not in keep:
                path.unlink()

    def _samples(
        self, frame: Frame, position: NDArray[Any], body_position: NDArray[Any]
    ) -> list[tuple[Sdf.Path, dict[str, Any], Attributes]]:
        """What moves, at one frame: (prim, attribute -> value, the attributes' types) for each prim."""
        layout = self.layout
        samples: list[tuple[Sdf.Path, dict[str, Any], Attributes]] = []
        for tile in self._tiles:
            points = (position[tile.points] - tile.origin).astype(np.float32)
            node = layout.curve_node[tile.points] if layout.curve_closing.size else tile.points
            stress = np.asarray(frame.node_stress[node], dtype=np.float32)
            values = {
                "points": Vt.Vec3fArray.FromNumpy(points),
                "extent": _extent(points, layout.diameter * MILLIMETRES),
                "primvars:warpknit:stress": Vt.FloatArray.FromNumpy(stress),
            }
            if self._colour_stress_max is not None:
                values["primvars:displayColor"] = Vt.Vec3fArray.FromNumpy(
                    stress_colour(stress, self._colour_stress_max)
                )
            samples.append((PANEL.AppendPath(f"{tile.name}/Wires"), values, MOVING_WIRES))
            if not tile.body_count:
                continue
            points = (body_position[tile.bodies] - tile.origin).astype(np.float32)
            force = frame.pair_force.reshape(-1, 2)[tile.bodies].astype(np.float32)
            active = frame.pair_active.reshape(-1, 2)[tile.bodies].sum(axis=1, dtype=np.int32)
            colour = np.where(active[:, None] == 2, ACTIVE_COLOUR, OPEN_COLOUR)
            values = {
                "points": Vt.Vec3fArray.FromNumpy(points),
                "extent": _extent(points, self._marker_width),
                "primvars:warpknit:active": Vt.IntArray.FromNumpy((active == 2).astype(np.int32)),
                "primvars:warpknit:activePairs": Vt.IntArray.FromNumpy(active),
                "primvars:warpknit:normalForce": Vt.FloatArray.FromNumpy(force.min(axis=1)),
                "primvars:warpknit:normalForceA": Vt.FloatArray.FromNumpy(np.ascontiguousarray(force[:, 0])),
                "primvars:warpknit:normalForceB": Vt.FloatArray.FromNumpy(np.ascontiguousarray(force[:, 1])),
                "primvars:displayColor": Vt.Vec3fArray.FromNumpy(colour),
            }
            samples.append((PANEL.AppendPath(f"{tile.name}/Contacts"), values, MOVING_CONTACTS))
        return samples

    @property
    def _marker_width(self) -> float:
        """[mm]  a sphere about a clasp that reaches the centres of wires 1.25 diameters away."""
        return 2.5 * self.layout.diameter * MILLIMETRES

    def _topology(self, frame: Frame, position: NDArray[Any], body_position: NDArray[Any]) -> Sdf.Layer:
        layer = Sdf.Layer.CreateAnonymous("topology.usdc")
        stage = Usd.Stage.Open(layer)
        _set_units(stage)
        panel = UsdGeom.Xform.Define(stage, PANEL)
        stage.SetDefaultPrim(panel.GetPrim())
        counts = np.diff(self.layout.curve_start).astype(np.int32)
        for tile in self._tiles:
            xform = UsdGeom.Xform.Define(stage, PANEL.AppendChild(tile.name))
            xform.AddTranslateOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Vec3d(*tile.origin.tolist()))
            curves = UsdGeom.BasisCurves.Define(stage, xform.GetPath().AppendChild("Wires"))
            curves.CreateTypeAttr(UsdGeom.Tokens.linear)
            curves.CreateWrapAttr(UsdGeom.Tokens.nonperiodic)
            curves.CreateCurveVertexCountsAttr(Vt.IntArray.FromNumpy(counts[tile.wires]))
            _set_width(curves, self.layout.diameter * MILLIMETRES)
            wires = np.arange(tile.wires.start, tile.wires.stop, dtype=np.int32)
            _set_primvar(curves, "warpknit:wireId", INTS, UsdGeom.Tokens.uniform, Vt.IntArray.FromNumpy(wires))
            if self._colour_stress_max is None:
                curves.CreateDisplayColorPrimvar(UsdGeom.Tokens.constant).Set([GOLD])
            if not tile.body_count:
                continue
            contacts = UsdGeom.Points.Define(stage, xform.GetPath().AppendChild("Contacts"))
            bodies = np.arange(self.layout.body_count)[tile.bodies]
            contacts.CreateIdsAttr(Vt.Int64Array.FromNumpy(bodies))
            _set_width(contacts, self._marker_width)
            for name, column in (("wireA", 0), ("wireB", 1)):
                values = Vt.IntArray.FromNumpy(self.layout.body_wires[bodies, column].astype(np.int32))
                _set_primvar(contacts, f"warpknit:{name}", INTS, UsdGeom.Tokens.vertex, values)
        for prim, values, attributes in self._samples(frame, position, body_position):  # the pose where no clip is read
            _declare(layer, prim, attributes, values)
            for name, value in values.items():
                layer.GetAttributeAtPath(prim.AppendProperty(name)).default = value
        return layer

    def _manifest(self) -> Sdf.Layer:
        layer = Sdf.Layer.CreateAnonymous("manifest.usda")
        layer.defaultPrim = PANEL.name
        for tile in self._tiles:
            for child, attributes in (("Wires", MOVING_WIRES), ("Contacts", MOVING_CONTACTS)):
                names = {name for name, _, _ in attributes}
                if child == "Wires" and self._colour_stress_max is None:
                    names.remove("primvars:displayColor")
                if child == "Wires" or tile.body_count:
                    _declare(layer, PANEL.AppendPath(f"{tile.name}/{child}"), attributes, names)
        return layer

    def _new_scene(self) -> Sdf.Layer:
        """What is the same in scene.usda at every frame."""
        layer = Sdf.Layer.CreateAnonymous("scene.usda")
        stage = Usd.Stage.Open(layer)
        _set_units(stage)
        stage.SetTimeCodesPerSecond(self._frames_per_second)
        stage.SetFramesPerSecond(self._frames_per_second)
        world = UsdGeom.Xform.Define(stage, "/World").GetPrim()
        stage.SetDefaultPrim(world)
        Usd.ModelAPI(world).SetKind(Kind.Tokens.assembly)
        Usd.ModelAPI(world).SetAssetName(self._metadata["sceneName"])
        Usd.ModelAPI(world).SetAssetVersion(self._metadata["sceneHash"])
        panel = UsdGeom.Xform.Define(stage, "/World/Panel").GetPrim()
        Usd.ModelAPI(panel).SetKind(Kind.Tokens.component)
        gold, colour = _materials(stage)
        UsdShade.MaterialBindingAPI.Apply(panel).Bind(gold if self._colour_stress_max is None else colour)
        for tile in self._tiles:
            if tile.body_count:
                contacts = stage.OverridePrim(f"/World/Panel/{tile.name}/Contacts")
                UsdShade.MaterialBindingAPI.Apply(contacts).Bind(colour)
        camera = UsdGeom.Camera.Define(stage, "/World/Camera")
        camera.CreateProjectionAttr(UsdGeom.Tokens.perspective)
        camera.AddTranslateOp(UsdGeom.XformOp.PrecisionDouble)
        camera.CreateClippingRangeAttr()
        UsdLux.DomeLight.Define(stage, "/World/DomeLight").CreateIntensityAttr(0.6)
        key = UsdLux.DistantLight.Define(stage, "/World/KeyLight")
        key.CreateIntensityAttr(3.0)
        key.CreateAngleAttr(1.0)
        key.AddRotateXYZOp().Set(Gf.Vec3f(-35.0, 25.0, 0.0))
        del stage  # references and clips are relative to the file: add them where nothing composes them
        spec = layer.GetPrimAtPath("/World/Panel")
        spec.referenceList.prependedItems = [Sdf.Reference(f"./{TOPOLOGY}", PANEL)]
        return layer

    def _write_scene(self) -> None:
        """Bring the frame list, the time codes and the camera up to date, and write scene.usda."""
        layer, frames = self._scene, self.frames
        assert layer is not None
        layer.startTimeCode, layer.endTimeCode = float(frames[0]), float(frames[-1])
        active = Vt.Vec2dArray([Gf.Vec2d(float(index), float(number)) for number, index in enumerate(frames)])
        clips = {
            "primPath": str(PANEL),
            "manifestAssetPath": Sdf.AssetPath(f"./{MANIFEST}"),
            "assetPaths": Sdf.AssetPathArray([Sdf.AssetPath(f"./{FRAMES}/wires.{index:06d}.usdc") for index in frames]),
            "active": active,
            "times": Vt.Vec2dArray([Gf.Vec2d(float(index), float(index)) for index in frames]),
        }
        layer.GetPrimAtPath("/World/Panel").SetInfo("clips", {"default": clips})
        loads = [self._loads[index] for index in frames]
        layout = self.layout
        layer.customLayerData = {
            "warpknit": {
                **self._metadata,
                "complete": self._complete,
                "frames": Vt.IntArray(list(frames)),
                "load": {
                    "stage": Vt.StringArray([load["stage"] for load in loads]),
                    **{name: Vt.DoubleArray([load[name] for load in loads]) for name in LOADS},
                },
                "units": dict(UNITS),
                "wireDiameter": layout.diameter * MILLIMETRES,
                "bodyRadius": layout.body_radius * MILLIMETRES,
                "boundsLow": Vt.DoubleArray(self._low.tolist()),
                "boundsHigh": Vt.DoubleArray(self._high.tolist()),
            }
        }
        self._place_camera(layer)
        _export(layer, self.path)

    def _place_camera(self, layer: Sdf.Layer) -> None:
        """Look down on the technical face, weft to the right, with all frames in view and a margin of a tenth."""
        centre, size = 0.5 * (self._low + self._high), self._high - self._low
        aperture, focal_length, aspect = 24.0, 50.0, 4.0 / 3.0
        distance = 1.1 * max(float(size[1]), float(size[0]) / aspect) * focal_length / aperture + float(size[2])
        values = {
            "xformOp:translate": Gf.Vec3d(float(centre[0]), float(centre[1]), float(self._high[2]) + distance),
            "clippingRange": Gf.Vec2f(0.01 * distance, 10.0 * distance),
            "verticalAperture": aperture,
            "horizontalAperture": aperture * aspect,
            "focalLength": focal_length,
        }
        camera = layer.GetPrimAtPath("/World/Camera")
        for name, value in values.items():
            attribute = camera.attributes.get(name) or Sdf.AttributeSpec(camera, name, Sdf.ValueTypeNames.Float)
            attribute.default = value


def stress_colour(stress: NDArray[Any], stress_max: float) -> NDArray[np.float32]:
    """[point, 3]  linear RGB of the size of a stress, from gold at zero to dark violet at `stress_max` and above."""
    last = len(STRESS_COLOURS) - 1
    table = np.linspace(0.0, last, 256)
    colours = np.stack([np.interp(table, np.arange(last + 1), channel) for channel in STRESS_COLOURS.T], axis=1)
    entry = np.minimum(np.abs(stress) * (255.0 / stress_max) + 0.5, 255.0).astype(np.uint8)
    return np.asarray(colours.astype(np.float32)[entry])


def _load(frame: Frame) -> dict[str, Any]:
    return {"stage": frame.stage, **{name: getattr(frame, source) for name, source in LOADS.items()}}


def _tiles(layout: WireLayout, position: NDArray[Any], points_per_tile: int) -> tuple[_Tile, ...]:
    """Cut the wires, in their order, into runs of about `points_per_tile` points."""
    start = layout.curve_start
    count = max(1, round(int(start[-1]) / points_per_tile))
    cut = np.searchsorted(start, np.linspace(0, start[-1], count + 1)[1:-1])
    cut = np.unique(np.concatenate(([0], cut, [layout.wire_count])))
    body_tile = np.searchsorted(cut, layout.body_wires[:, 0], side="right") - 1
    tiles = []
    for number, (first, end) in enumerate(zip(cut[:-1].tolist(), cut[1:].tolist(), strict=True)):
        points = slice(int(start[first]), int(start[end]))
        bodies = slice(None) if len(cut) == 2 else np.flatnonzero(body_tile == number)
        low, high = _bounds(position[points])
        tiles.append(
            _Tile(
                name=f"Tile_{number:02d}",
                wires=slice(first, end),
                points=points,
                bodies=bodies,
                body_count=int(np.count_nonzero(body_tile == number)),
                origin=np.round(0.5 * (low + high), 6),
            )
        )
    return tuple(tiles)


def _extent(points: NDArray[np.float32], width: float) -> Vt.Vec3fArray:
    """Bounds of points [mm] that are drawn `width` [mm] wide."""
    low, high = _bounds(points)
    pad = np.float32(0.5 * width)
    return Vt.Vec3fArray.FromNumpy(np.stack([low - pad, high + pad]))


def _bounds(points: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Lowest and highest coordinates, a column at a time: over an axis of three NumPy takes several times as long."""
    return np.array([column.min() for column in points.T]), np.array([column.max() for column in points.T])


def _declare(layer: Sdf.Layer, prim: Sdf.Path, attributes: Attributes, names: Any) -> None:
    """Make specs, without values, of those attributes that are among `names`."""
    spec = Sdf.CreatePrimInLayer(layer, prim)
    for name, kind, interpolation in attributes:
        if name in names and name not in spec.attributes:
            attribute = Sdf.AttributeSpec(spec, name, kind)
            if interpolation:
                attribute.SetInfo("interpolation", interpolation)


def _set_units(stage: Usd.Stage) -> None:
    UsdGeom.SetStageMetersPerUnit(stage, 1.0 / MILLIMETRES)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)


def _set_width(shape: Any, width: float) -> None:
    shape.CreateWidthsAttr([width])
    shape.SetWidthsInterpolation(UsdGeom.Tokens.constant)


def _set_primvar(shape: Any, name: str, kind: Any, interpolation: str, values: Any) -> None:
    UsdGeom.PrimvarsAPI(shape).CreatePrimvar(name, kind, interpolation).Set(values)


def _materials(stage: Usd.Stage) -> tuple[UsdShade.Material, UsdShade.Material]:
    """Gold, and one that shows the vertex colours."""
    UsdGeom.Scope.Define(stage, "/World/Looks")
    gold = UsdShade.Material.Define(stage, "/World/Looks/Gold")
    surface = _surface(stage, gold, {"metallic": 1.0, "roughness": 0.25})
    surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(GOLD)
    colour = UsdShade.Material.Define(stage, "/World/Looks/DisplayColor")
    surface = _surface(stage, colour, {"metallic": 0.0, "roughness": 0.6})
    reader = UsdShade.Shader.Define(stage, colour.GetPath().AppendChild("Reader"))
    reader.CreateIdAttr("UsdPrimvarReader_float3")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("displayColor")
    reader.CreateInput("fallback", Sdf.ValueTypeNames.Float3).Set(GOLD)
    result = reader.CreateOutput("result", Sdf.ValueTypeNames.Float3)
    surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(result)
    return gold, colour


def _surface(stage: Usd.Stage, material: UsdShade.Material, inputs: Mapping[str, float]) -> UsdShade.Shader:
    shader = UsdShade.Shader.Define(stage, material.GetPath().AppendChild("Surface"))
    shader.CreateIdAttr("UsdPreviewSurface")
    for name, value in inputs.items():
        shader.CreateInput(name, Sdf.ValueTypeNames.Float).Set(value)
    output = shader.CreateOutput("surface", Sdf.ValueTypeNames.Token)
    material.CreateSurfaceOutput().ConnectToSource(output)
    return shader


def _export(layer: Sdf.Layer, path: Path) -> None:
    with path_aside(path) as aside, _disk_errors(path):
        _written(layer.Export(str(aside)), path)


@contextmanager
def _disk_errors(path: Path) -> Iterator[None]:
    """USD tells of a full disk in its own way: as `OSError` with the path."""
    try:
        yield
    except Tf.ErrorException as error:
        number = errno.ENOSPC if os.strerror(errno.ENOSPC) in str(error) else errno.EIO
        raise OSError(number, os.strerror(number), str(path)) from error


def _written(done: bool, path: Path) -> None:
    if not done:
        raise OSError(errno.EIO, os.strerror(errno.EIO), str(path))


def _earlier_stage(path: Path) -> dict[str, Any]:
    """The customLayerData of a stage that an earlier run left; empty where there is none."""
    if not (path.is_file() and (path.parent / TOPOLOGY).is_file()):
        return {}
    layer = Sdf.Layer.OpenAsAnonymous(str(path))
    return dict(layer.customLayerData.get("warpknit", {})) if layer else {}


def _earlier_loads(data: Mapping[str, Any]) -> dict[int, dict[str, Any]]:
    columns = {name: list(values) for name, values in data["load"].items()}
    return {
        index: {name: values[number] for name, values in columns.items()} for number, index in enumerate(data["frames"])
    }


def _earlier_origins(path: Path) -> dict[str, NDArray[np.float64]]:
    layer = Sdf.Layer.OpenAsAnonymous(str(path))
    panel = layer.GetPrimAtPath(PANEL)
    return {child.name: np.array(child.attributes["xformOp:translate"].default) for child in panel.nameChildren}
