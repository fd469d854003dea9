"""scene.usda: the levels of detail as variants, their clips, materials, light, camera, and the list of frames."""

import errno
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from pxr import Gf, Kind, Sdf, Tf, Usd, UsdGeom, UsdLux, UsdShade, Vt

from warpknit.base.files import path_aside
from warpknit.export.usd.shapes import GOLD
from warpknit.export.usd.tiles import MILLIMETRES, Tile


def write_layer(layer: Sdf.Layer, path: Path) -> None:
    """Write a layer that stays in memory. Raises OSError, naming `path`, where the disk fails."""
    with path_aside(path) as aside:
        try:
            number = 0 if layer.Export(str(aside)) else errno.EIO
        except Tf.ErrorException as error:
            number = errno.ENOSPC if os.strerror(errno.ENOSPC) in str(error) else errno.EIO
        if number:
            raise OSError(number, os.strerror(number), str(path))


def set_units(stage: Usd.Stage) -> None:
    UsdGeom.SetStageMetersPerUnit(stage, 1.0 / MILLIMETRES)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)


TOPOLOGY, MANIFEST, FRAMES = "wires.topology.usdc", "wires.manifest.usda", "frames"
# A part is a prim at the root of the layers other than scene.usda; a level of detail is made of parts.
FULL, K8, CONTACTS, SURFACE = "Full", "K8", "Contacts", "Surface"  # contacts: where wires hook, and elsewhere
LEVELS = {"full": (FULL, CONTACTS, SURFACE), "k8": (K8, CONTACTS, SURFACE), "surface": (SURFACE,)}
FRAMES_PER_SECOND = 10.0
SHOWN_POINTS = 5_000_000  # a stage opens at the finest level of no more points
PANEL = "/World/Panel"
DOME, KEY = 0.4, 0.4  # light under which a white plane is bright, and not white; Blender takes KEY four times


def frame_file(index: int) -> str:
    return f"wires.{index:06d}.usdc"


def new_scene(tiles: Sequence[Tile], name: str, scene_hash: str, *, shows_stress: bool) -> Sdf.Layer:
    """Static parts of scene.usda."""
    layer = Sdf.Layer.CreateAnonymous("scene.usda")
    stage = Usd.Stage.Open(layer)
    set_units(stage)
    stage.SetTimeCodesPerSecond(FRAMES_PER_SECOND)
    stage.SetFramesPerSecond(FRAMES_PER_SECOND)
    world = UsdGeom.Xform.Define(stage, "/World").GetPrim()
    stage.SetDefaultPrim(world)
    Usd.ModelAPI(world).SetKind(Kind.Tokens.assembly)
    Usd.ModelAPI(world).SetAssetName(name)
    Usd.ModelAPI(world).SetAssetVersion(scene_hash)
    panel = UsdGeom.Xform.Define(stage, PANEL).GetPrim()
    Usd.ModelAPI(panel).SetKind(Kind.Tokens.component)
    gold, colour = _materials(stage)
    UsdShade.MaterialBindingAPI.Apply(panel).Bind(colour)
    levels = panel.GetVariantSets().AddVariantSet("lod")
    for level in LEVELS:
        levels.AddVariant(level)
        levels.SetVariantSelection(level)
        with levels.GetVariantEditContext():
            if not shows_stress and level != "surface":
                for tile in tiles:
                    wires = stage.OverridePrim(f"{PANEL}/{tile.name}/Wires")
                    UsdShade.MaterialBindingAPI.Apply(wires).Bind(gold)
            surface = stage.OverridePrim(f"{PANEL}/Surface")
            if level == "surface":
                UsdGeom.Imageable(surface).CreatePurposeAttr(UsdGeom.Tokens.default_)
            elif len(tiles) == 1:  # of several tiles it stands in for the wires
                surface.SetActive(False)
    points = {"full": sum(tile.points.size for tile in tiles), "k8": sum(tile.thinning.kept.size for tile in tiles), "surface": 0}
    levels.SetVariantSelection(next(level for level in LEVELS if points[level] <= SHOWN_POINTS))
    _light_and_camera(stage)
    del stage  # payloads and clips are relative to the file: add them where nothing composes them
    for level, parts in LEVELS.items():
        spec = _variant(layer, level)
        spec.payloadList.prependedItems = [Sdf.Payload(f"./{TOPOLOGY}", Sdf.Path(f"/{part}")) for part in parts]
    return layer


def set_clips(layer: Sdf.Layer, frames: Sequence[int], full_frames: Sequence[int]) -> None:
    """Join the files of these frames to each level; `full_frames` are those that hold every point."""
    layer.startTimeCode, layer.endTimeCode = float(frames[0]), float(frames[-1])
    parts = {part: _clips(part, full_frames if part == FULL else frames) for part in (FULL, K8, CONTACTS, SURFACE)}
    for level, names in LEVELS.items():
        _variant(layer, level).SetInfo("clips", {part.lower(): parts[part] for part in names})


def _clips(part: str, frames: Sequence[int]) -> dict[str, object]:
    """Clips of one part. Where frames are left out the last one before stands still: nothing is made up in between."""
    times: list[tuple[int, int]] = []
    for number, index in enumerate(frames):
        if number and index > frames[number - 1] + 1:
            times.append((index, frames[number - 1]))
        times.append((index, index))
    return {
        "primPath": f"/{part}",
        "manifestAssetPath": Sdf.AssetPath(f"./{MANIFEST}"),
        "assetPaths": Sdf.AssetPathArray([Sdf.AssetPath(f"./{FRAMES}/{frame_file(index)}") for index in frames]),
        "active": _pairs((index, number) for number, index in enumerate(frames)),
        "times": _pairs(times),
    }


def _pairs(values: Iterable[tuple[int, int]]) -> Vt.Vec2dArray:
    return Vt.Vec2dArray([Gf.Vec2d(float(a), float(b)) for a, b in values])


def _variant(layer: Sdf.Layer, level: str) -> Sdf.PrimSpec:
    return layer.GetPrimAtPath(Sdf.Path(PANEL).AppendVariantSelection("lod", level))


def _materials(stage: Usd.Stage) -> tuple[UsdShade.Material, UsdShade.Material]:
    """Gold, and one that shows the colours of the points."""
    UsdGeom.Scope.Define(stage, "/World/Looks")
    gold = UsdShade.Material.Define(stage, "/World/Looks/Gold")
    surface = _surface_shader(stage, gold, {"metallic": 1.0, "roughness": 0.25})
    surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(GOLD)
    colour = UsdShade.Material.Define(stage, "/World/Looks/DisplayColor")
    surface = _surface_shader(stage, colour, {"metallic": 0.0, "roughness": 0.6})
    reader = UsdShade.Shader.Define(stage, colour.GetPath().AppendChild("Reader"))
    reader.CreateIdAttr("UsdPrimvarReader_float3")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("displayColor")
    reader.CreateInput("fallback", Sdf.ValueTypeNames.Float3).Set(GOLD)
    result = reader.CreateOutput("result", Sdf.ValueTypeNames.Float3)
    surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(result)
    return gold, colour


def _surface_shader(stage: Usd.Stage, material: UsdShade.Material, inputs: Mapping[str, float]) -> UsdShade.Shader:
    shader = UsdShade.Shader.Define(stage, material.GetPath().AppendChild("Surface"))
    shader.CreateIdAttr("UsdPreviewSurface")
    for name, value in inputs.items():
        shader.CreateInput(name, Sdf.ValueTypeNames.Float).Set(value)
    output = shader.CreateOutput("surface", Sdf.ValueTypeNames.Token)
    material.CreateSurfaceOutput().ConnectToSource(output)
    return shader


def _light_and_camera(stage: Usd.Stage) -> None:
    camera = UsdGeom.Camera.Define(stage, "/World/Camera")
    camera.CreateProjectionAttr(UsdGeom.Tokens.perspective)
    camera.AddTranslateOp(UsdGeom.XformOp.PrecisionDouble)
    camera.CreateClippingRangeAttr()
    UsdLux.DomeLight.Define(stage, "/World/DomeLight").CreateIntensityAttr(DOME)
    key = UsdLux.DistantLight.Define(stage, "/World/KeyLight")
    key.CreateIntensityAttr(KEY)
    key.CreateNormalizeAttr(True)  # the intensity is the irradiance, however small the angle
    key.CreateAngleAttr(1.0)
    key.AddRotateXYZOp().Set(Gf.Vec3f(-35.0, 25.0, 0.0))


def place_camera(layer: Sdf.Layer, low: np.ndarray, high: np.ndarray) -> None:
    """Look down on the technical face, with all frames in view; weft to the right, a margin of a tenth."""
    centre, size = 0.5 * (low + high), high - low
    aperture, focal_length, aspect = 24.0, 50.0, 4.0 / 3.0
    distance = 1.1 * max(float(size[1]), float(size[0]) / aspect) * focal_length / aperture + float(size[2])
    values = {
        "xformOp:translate": Gf.Vec3d(float(centre[0]), float(centre[1]), float(high[2]) + distance),
        "clippingRange": Gf.Vec2f(0.01 * distance, 10.0 * distance),
        "verticalAperture": aperture,
        "horizontalAperture": aperture * aspect,
        "focalLength": focal_length,
    }
    camera = layer.GetPrimAtPath("/World/Camera")
    for name, value in values.items():
        attribute = camera.attributes.get(name) or Sdf.AttributeSpec(camera, name, Sdf.ValueTypeNames.Float)
        attribute.default = value
