"""Equilibria of one mesh under many loads, side by side."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from ..mechanics.protocols import Model
from ..scene import Scene, Stage
from ..solve.model import build_model
from .batch import Batch

Mesh = Any  # a model of either kind (mechanics.py)
States = Batch
MOST_NODES = 500_000  # of all meshes side by side


def mesh_of(scene: Scene) -> Any:
    """The model of a scene, on the CPU. Raises `ModelError`, `MemoryNeeded`, `KnitError`, `SceneError`."""
    return build_model(scene)


def side_by_side(loads: int, nodes: int) -> int:
    """How many of so many loads of a mesh are solved at once."""
    return min(loads, max(1, MOST_NODES // nodes))


def states_of(
    model: Model, stages: Sequence[Stage], levels: Sequence[int] | None = None, watch: Callable[[States], None] | None = None
) -> States:
    """Solver of a mesh under each of `stages`; its `run` yields an `Outcome` each, in any order.

    `levels` of each, default `output.frames`. `watch` is called at every convergence check, and may raise to stop.
    """
    return Batch(model, stages, levels, watch=watch)
