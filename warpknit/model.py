"""The model that a scene asks for, planar or spatial: the one place that chooses between the two.

Each kind is a package of that name, whose module `kind` holds what stands here in its own form.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

from .estimate import Estimates
from .mechanics import Group, Mechanics, Model
from .ranks.ranks import Ranks
from .scene import Scene
from .trial import Trials


def _kind(scene: Scene) -> Any:
    return import_module(f".{scene.model.kind}.kind", __package__)


def build_model(scene: Scene, device: str = "cpu", ranks: Ranks | None = None) -> Model:
    """Build and upload the model of a scene, of this rank's strip where several `ranks` share it.

    Raises `ModelError`, `MemoryNeeded`, `KnitError`, `SceneError`.
    """
    model: Model = _kind(scene).build_model(scene, device, ranks)
    return model


def initial_state(model: Model) -> Any:
    """The state of a model to start from: the knitted shape, no velocity, no load."""
    return _kind(model.scene).initial_state(model)


def mechanics_of(model: Model, state: Any) -> Mechanics:
    """What steps a state of a model."""
    mechanics: Mechanics = _kind(model.scene).mechanics(model, state)
    return mechanics


def replicas_of(model: Model, count: int, threads: int | None = None) -> Group:
    """So many states of a model that has replicas, stepped by one launch and shared by `threads`; default: one a core."""
    replicas: Group = _kind(model.scene).replicas(model, count, threads=threads)
    return replicas


def estimates_of(scene: Scene) -> Estimates:
    """What the kind of model that a scene asks for says of a run of it."""
    estimates: Estimates = _kind(scene).estimate
    return estimates


def trials_of(scene: Scene) -> Trials:
    """What the kind of model that a scene asks for is tried at, to trade speed for accuracy."""
    trials: Trials = _kind(scene).trials
    return trials
