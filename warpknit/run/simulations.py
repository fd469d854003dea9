"""What runs a scene, in the model that the scene asks for."""

from __future__ import annotations

from ..errors import ModelError
from ..planar.model import build_model
from ..planar.state import initial_state
from ..ranks.ranks import One, Ranks
from ..scene import Scene
from ..solve.simulate import Progress, Simulation
from ..spatial.drive import SpatialDrive
from ..spatial.mesh import build_mesh
from ..spatial.ramp import SpatialRamp
from ..spatial.relax import SpatialRelaxation


def simulation_of(
    scene: Scene, device: str, ranks: Ranks | None = None, progress: Progress | None = None
) -> Simulation | SpatialDrive:
    """A run of a scene from where `progress` stands. Raises `ModelError`, `MemoryNeeded`, `KnitError`, `SceneError`."""
    ranks = ranks or One()
    if scene.model.kind != "spatial":
        model = build_model(scene, device, ranks)
        return Simulation(model, initial_state(model), progress=progress)
    if ranks.count > 1:
        raise ModelError(f"model.kind: given 'spatial', which {ranks.count} ranks cannot share: run without mpirun")
    drive = SpatialRelaxation if scene.solver.drive == "relax" else SpatialRamp
    return drive(build_mesh(scene, device), progress=progress)
