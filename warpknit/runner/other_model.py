"""Spatial means under the load of a planar tile, if they take only seconds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..base.errors import ModelError, SceneError
from ..knit.lapping import KnitError
from ..mesh.layout import mesh_nodes
from ..results.row import Row
from ..scene import Scene
from ..scene.presets import PRESETS
from ..solve.variant_models import VariantModels, last_records
from .history import row_of

MESHES = 3
NODE_STEPS = 1.5e7  # of all meshes, some 5 s on two cores; a comparison that needs more is left out
FEWEST_STEPS = 1_000  # that a mesh takes
FIGURES = ("strain_weft", "strain_warp", "tension_weft_N_per_m", "tension_warp_N_per_m", "active_percent", "stress_max_Pa")


class _TooLong(Exception):
    """The comparison needs more node-steps than it may take."""


def spatial_means(scene: Scene, monitor: Callable[[int], None], pair: tuple[float, float] | None = None) -> Row | None:
    """Means of the spatial model for a planar tile; None for other meshes, and where they take too long.

    monitor: called at every check with the time steps so far, may raise to stop. pair: a load of [sweep]; default: the scene's.
    """
    other = _spatial(scene)
    if other is None:
        return None
    if pair is not None and other.sweep is not None:
        other = replace(other, stages=(other.sweep.stage(other.stages[0], pair),), sweep=None)

    def check(steps: int) -> None:
        monitor(steps)
        if steps * models[0].node_count > NODE_STEPS:
            raise _TooLong

    try:
        if MESHES * mesh_nodes(other) * FEWEST_STEPS > NODE_STEPS:
            return None
        variants = VariantModels(other)
        models = [variants.model(number) for number in variants.take(MESHES)]
        ends = [row_of(record) for _place, record in last_records(models, check)]
    except (KnitError, ModelError, _TooLong):
        return None
    if len(ends) < MESHES:
        return None
    return Row(meshes=MESHES, **{name: float(np.mean([row[name] for row in ends])) for name in FIGURES})


def _spatial(scene: Scene) -> Scene | None:
    """The scene in the spatial model, by its preset; None for a spatial scene, without a tile, or with planar keys.

    Nodes and other numerics of the scene are left out: they are for the planar model, which needs fewer nodes.
    """
    is_tile = scene.model.boundary == "periodic" and scene.solver.drive == "relax"
    if not scene.variants.sensitivity or scene.model.of_kind.own_loops or not is_tile:
        return None
    loops = {}
    if scene.knit.scatter:  # of a single mesh; the scatter of [variants] takes its place
        loops = {"knit.scatter": 0.0, "knit.seed": 0, "variants.scatter": scene.knit.scatter, "variants.seed": scene.knit.seed}
    numerics = PRESETS[scene.solver.preset]["spatial", "relax"]
    try:
        return scene.changed(
            {
                "model.kind": "spatial",
                "model.nodes_per_loop": numerics.nodes_per_loop,
                **{f"solver.{name}": getattr(numerics, name) for name in ("axial_softening", "precision", "residual_tolerance")},
                "variants.count": MESHES,
                "variants.standard_error": 0.0,
                "variants.sensitivity": False,
                **loops,
            }
        )
    except SceneError:
        return None
