"""Equilibria of one repeat of endless cloth at many deformation gradients; either model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ..base.errors import Diverged
from ..measure import Observables
from ..scene import Scene
from ..studies.batch import Batch, Mesh, mesh_of
from .load_path import under_strain

# Residual, so that the differences between states hold three digits: the card's stiffness is nearly singular, and its inverse
# loses one more. The contact point is found to 1e-5 of a segment, which leaves residuals of up to 1e-5.
DIFFERENCE_TOLERANCE = 2e-5
ROUGH_TOLERANCE = 1e-4  # for a mesh that does not converge to the finer one


def tolerances_of(scene: Scene) -> list[float]:
    """Residual tolerances of a material card, to be tried one after the other: the scene's comes last."""
    return [DIFFERENCE_TOLERANCE, ROUGH_TOLERANCE, scene.solver.residual_tolerance]


def exact_model(scene: Scene, tolerance: float = DIFFERENCE_TOLERANCE) -> Mesh:
    """The mesh of `scene` in double precision, converged enough for differences of states. Raises `ModelError`, `KnitError`."""
    return mesh_of(exact(scene, tolerance))


def exact(scene: Scene, tolerance: float) -> Scene:
    """The scene in double precision, with a residual tolerance that is at most this."""
    tolerance = min(scene.solver.residual_tolerance, tolerance)
    return replace(scene, solver=replace(scene.solver, precision="double", residual_tolerance=tolerance))


def states_at(
    model: Mesh, gradients: Sequence[np.ndarray], monitor: Callable[[float], None] = lambda _: None
) -> list[Observables | Diverged]:
    """Equilibrium or error at each upper triangular deformation gradient (2, 2).

    Each is reached proportionally from the mesh as knitted, at the temperature of the scene's first load step. `monitor` gets
    the share of states found.
    """
    stages = [under_strain(model.scene, f) for f in gradients]
    found: dict[int, Observables | Diverged] = {}
    for outcome in Batch(model, stages).run():
        if outcome.observables is not None:
            found[outcome.index] = outcome.observables
        elif outcome.error is not None:
            found[outcome.index] = outcome.error
        monitor(len(found) / len(stages))
    return [found[index] for index in range(len(stages))]
