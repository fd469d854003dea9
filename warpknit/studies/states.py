"""Equilibria of one mesh under many loads: side by side with replicas, else in several processes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from ..mechanics.protocols import Model
from ..scene import Scene, Stage
from ..solve.model import build_model
from .batch import Batch
from .state_processes import StateProcesses

Mesh = Any  # a model of either kind (mechanics.py)
States = Batch | StateProcesses


def mesh_of(scene: Scene) -> Any:
    """The model of a scene, on the CPU. Raises `ModelError`, `MemoryNeeded`, `KnitError`, `SceneError`."""
    return build_model(scene)


def states_of(
    model: Model, stages: Sequence[Stage], levels: Sequence[int] | None = None, watch: Callable[[States], None] | None = None
) -> States:
    """Solver of a mesh under each of `stages`; its `run` yields an `Outcome` each, in any order.

    `levels` of each, default `output.frames`. `watch` is called regularly, and may raise to stop.
    """
    states: Any = Batch if model.has_replicas else StateProcesses
    return states(model, stages, levels, watch=watch)
