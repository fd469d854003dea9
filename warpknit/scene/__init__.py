"""The scene: what is knitted, how it is loaded and solved, as frozen objects in plain SI.

    scene = load_scene("scenes/atlas_cell.toml", overrides=["load.strain_warp=0.05"], preset="draft")

A scene file is TOML; `warpknit.scene.scene` lists its keys. Whatever is wrong with it is a SceneError of one line.
"""

from warpknit.base.errors import SceneError
from warpknit.scene.knit import Bar, Hook, Knit, Loop
from warpknit.scene.options import Contact, ModelOptions, Output, Pull, Solver, Stage, Sweep
from warpknit.scene.panel_options import Cord, PanelOptions
from warpknit.scene.scene import Scene, resolved_toml
from warpknit.scene.scene_loader import load_scene, make_scene
from warpknit.scene.wire import Plating, Wire

__all__ = [
    "Bar",
    "Contact",
    "Cord",
    "Hook",
    "Knit",
    "Loop",
    "ModelOptions",
    "Output",
    "PanelOptions",
    "Plating",
    "Pull",
    "Scene",
    "SceneError",
    "Solver",
    "Stage",
    "Sweep",
    "Wire",
    "load_scene",
    "make_scene",
    "resolved_toml",
]
