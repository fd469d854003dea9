"""The model that a scene asks for, planar or spatial: the one place that chooses between the two.

Each kind is a package of that name; its module `kind` has the same functions.
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
    """The initial state: knitted shape, no velocity, no load."""
    return _kind(model.scene).initial_state(model)


def mechanics_of(model: Model, state: Any) -> Mechanics:
    """The mechanics that step a state of a model."""
    mechanics: Mechanics = _kind(model.scene).mechanics(model, state)
    return mechanics


def replicas_of(model: Model, count: int, threads: int | None = None) -> Group:
    """A group of `count` replicas of a model; `threads` default to one a core."""
    replicas: Group = _kind(model.scene).replicas(model, count, threads=threads)
    return replicas


def estimates_of(scene: Scene) -> Estimates:
    """The estimates of the kind of model of a scene."""
    estimates: Estimates = _kind(scene).estimate
    return estimates


def trials_of(scene: Scene) -> Trials:
    """The probe-run settings of the kind of model of a scene."""
    trials: Trials = _kind(scene).trials
    return trials
