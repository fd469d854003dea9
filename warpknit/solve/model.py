"""The model that a scene asks for, planar or spatial: the one place that chooses between the two.

Each kind is a package of that name; its module `kind` has the same functions.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from types import ModuleType
from typing import Any

from ..base.errors import DeviceError, InputError
from ..base.text import either
from ..compute.device import devices
from ..compute.ranks import Ranks
from ..mechanics.protocols import Mechanics, Model
from ..mechanics.worlds import Worlds
from ..scene import Scene


def build_model(scene: Scene, device: str = "cpu", ranks: Ranks | None = None) -> Model:
    """The model of a scene: all constant data of its mesh, on a device; planar or spatial, as the scene says.

        model = build_model(load_scene("scenes/atlas_cell.toml"))
        model.node_count, model.pair_count, model.bending_stiffness          # ..., ..., EI [N m2]
        model.panel.wire_first, model.panel.clamp_position                   # [wire], (clamp, 2) [m] as knitted

    device: "cpu" or "cuda:0". ranks: processes that share the mesh; the model then covers this rank's strip.

    Raises `ModelError`, `MemoryNeeded`, `KnitError`, `SceneError`, `DeviceError`, `InputError` if `scene` is no scene.
    """
    if not isinstance(scene, Scene):
        raise InputError(f"build_model: {scene!r} is not a scene; give one, such as load_scene('scene.toml')")
    if device not in (available := devices()):
        raise DeviceError(f"device: {device!r} is not on this machine; use {either(available)}")
    model: Model = kind_of(scene).build_model(scene, device, ranks)
    return model


def initial_state(model: Model) -> Any:
    """The variables of a model's mesh, as Warp arrays: knitted shape, no velocity, no load.

        model = build_model(scene)
        state = initial_state(model)
        records = list(Simulation(model, state).run())               # changes the state
        state.arrays()                                               # copies on the host, by name

    The fields, with units, are in warpknit/planar/state.py and warpknit/spatial/rod_arrays.py.
    Raises `InputError` if `model` is no model.
    """
    if not hasattr(model, "scene"):
        raise InputError(f"initial_state: {model!r} is not a model; give one, such as build_model(scene)")
    return kind_of(model.scene).initial_state(model)


def mechanics_of(model: Model, state: Any) -> Mechanics:
    """The mechanics that step a state of a model."""
    return worlds_of([model], state).members[0]


def worlds_of(models: Sequence[Model], state: Any = None) -> Worlds:
    """Worlds of one topology side by side, one of each model; of a single one from a state."""
    worlds: Worlds = kind_of(models[0].scene).worlds(models, state)
    return worlds


def kind_of(scene: Scene) -> ModuleType:
    """The kind of model of a scene: its module `kind`, with a description and settings of probe runs."""
    return import_module(f"warpknit.{scene.model.kind}.kind")
