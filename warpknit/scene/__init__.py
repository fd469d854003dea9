"""The scene: what is knitted, how it is loaded and solved, as frozen objects in plain SI.

    scene = load_scene("scenes/atlas_cell.toml", overrides=["load.strain_warp=0.05"], preset="draft")

A scene file is TOML; `warpknit.scene.scene` lists its keys. Whatever is wrong with it is a SceneError of one line.
"""

from ..base.errors import SceneError
from .knit import Bar, Hook, Knit, Loop
from .options import Contact, ModelOptions, Output, Pull, Solver, Stage, Sweep
from .panel_options import Cord, PanelOptions
from .scene import Scene, resolved_toml
from .scene_loader import load_scene, make_scene
from .wire import Plating, Wire

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
