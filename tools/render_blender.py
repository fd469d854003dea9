"""Render scene.usda of a run with Blender.

    blender --background --python tools/render_blender.py -- runs/my_mesh/scene.usda picture.png
    python tools/render_blender.py runs/my_mesh/scene.usda picture.png      # in a Python with the package bpy

One millimetre of the mesh is one metre in Blender (SCALE): its clipping distances and tools suit metres.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import bpy  # type: ignore[import-not-found]

SCALE = 1000.0
SAMPLES = 32


def import_scene(path: str) -> None:
    """Import a stage into an empty scene, with materials that show its colours."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.world = world = bpy.data.worlds.new("World")  # that the dome light of the stage sets
    bpy.ops.wm.usd_import(filepath=path, scale=SCALE, import_all_materials=True, set_frame_range=True)
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)  # Blender reads its intensity only
    material = bpy.data.materials["DisplayColor"]
    for shape in bpy.data.objects:
        if (
            shape.type in ("CURVES", "POINTCLOUD", "MESH") and not shape.data.materials
        ):  # Blender binds the materials of meshes only
            shape.data.materials.append(material)
        if shape.type == "POINTCLOUD":  # points whose number changes lose it
            modifier = shape.modifiers.new("Material", "NODES")
            modifier.node_group = set_material(material)


def set_material(material: Any) -> Any:
    """Geometry nodes that give points a material."""
    group = bpy.data.node_groups.new("Material", "GeometryNodeTree")
    for direction in ("INPUT", "OUTPUT"):
        group.interface.new_socket("Geometry", in_out=direction, socket_type="NodeSocketGeometry")
    begin, node, end = (group.nodes.new(kind) for kind in ("NodeGroupInput", "GeometryNodeSetMaterial", "NodeGroupOutput"))
    node.inputs["Material"].default_value = material
    group.links.new(begin.outputs[0], node.inputs["Geometry"])
    group.links.new(node.outputs["Geometry"], end.inputs[0])
    return group


def render(path: str, *, frame: int | None, size: tuple[int, int]) -> None:
    """Render through the camera of the stage, at its last frame by default."""
    scene = bpy.context.scene
    scene.camera = next(shape for shape in bpy.data.objects if shape.type == "CAMERA")
    scene.frame_set(scene.frame_end if frame is None else frame)
    scene.render.engine, scene.cycles.samples, scene.cycles.device = "CYCLES", SAMPLES, "CPU"
    scene.view_settings.view_transform = "Standard"  # colours as they are in the file
    scene.render.resolution_x, scene.render.resolution_y = size
    scene.render.filepath = path
    bpy.ops.render.render(write_still=True)


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("stage", help="scene.usda of a run")
    parser.add_argument("picture", help="the PNG to write")
    parser.add_argument("--frame", type=int, help="number of the record  [default: the last]")
    parser.add_argument("--size", type=int, nargs=2, default=(960, 720), metavar=("W", "H"), help="pixels  [default: 960 720]")
    given = parser.parse_args(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else None)
    import_scene(given.stage)
    render(str(Path(given.picture).resolve()), frame=given.frame, size=tuple(given.size))
    return 0


if __name__ == "__main__":
    sys.exit(main())
