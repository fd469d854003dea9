"""States of one mesh under many loads, in the model that its scene asks for."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ..planar.model import Model, build_model
from ..scene import Scene, Stage
from ..spatial.mesh import SpatialMesh, build_mesh
from .batch import Batch
from .spatial_states import SpatialStates

Mesh = Model | SpatialMesh
States = Batch | SpatialStates


def mesh_of(scene: Scene) -> Mesh:
    """The mesh of a scene, on the CPU. Raises `ModelError`, `MemoryNeeded`, `KnitError`, `SceneError`."""
    return build_mesh(scene) if scene.model.kind == "spatial" else build_model(scene)


def node_count(mesh: Mesh) -> int:
    """Nodes that are stepped; in space, clamped wires are divided anew."""
    return mesh.rods.node_count if isinstance(mesh, SpatialMesh) else mesh.panel.node_count


def states_of(mesh: Mesh, stages: Sequence[Stage], watch: Callable[[States], None] | None = None) -> States:
    """What brings `mesh` to rest under each of `stages`; its `run` yields an `Outcome` each, in any order.

    `watch` is called as it goes on, and may raise to stop.
    """
    if isinstance(mesh, SpatialMesh):
        return SpatialStates(mesh, stages, watch=watch)
    return Batch(mesh, stages, watch=watch)
