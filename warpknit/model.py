"""The model that a scene asks for, planar or spatial: the one place that chooses between the two."""

from __future__ import annotations

from typing import Any

from .mechanics import Model
from .ranks.ranks import Ranks
from .scene import Scene


def build_model(scene: Scene, device: str = "cpu", ranks: Ranks | None = None) -> Model:
    """Build and upload the model of a scene, of this rank's strip where several `ranks` share it.

    Raises `ModelError`, `MemoryNeeded`, `KnitError`, `SceneError`.
    """
    if scene.model.kind == "spatial":
        from .spatial.mesh import build_mesh

        return build_mesh(scene, device, ranks)
    from .planar.model import build_model as build_planar

    return build_planar(scene, device, ranks)


def initial_state(model: Model) -> Any:
    """The state of a model to start from: the knitted shape, no velocity, no load."""
    return model.initial_state()
