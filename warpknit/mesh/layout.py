"""From a scene to the nodes of its mesh: the cloth, its copies, and the number of nodes."""

from __future__ import annotations

import math

import numpy as np

from ..base.text import exact
from ..compute.memory import refuse_beyond_memory
from ..knit.clasp_classes import clasp_classes
from ..knit.cloth import Cloth, same_cloth
from ..scene import Scene
from ..wires.read import rest_wires
from .panel import Panel, build_panel, table_lead
from .rest_table import Table, rest_table

SLIDE_ALLOWANCE = 0.2  # how far a contact may slide beyond its lens, in wire lengths of a loop


def mesh_nodes(scene: Scene) -> int:
    """Number of nodes of a scene's mesh, which is not laid out: estimated for cloth that is cut. Raises the errors of a file."""
    if scene.wires is not None:
        return rest_wires(scene).node_count
    if scene.hook is not None:
        return 2 * (scene.model.nodes_per_loop + 1)
    return estimated_nodes(scene, knit_scene(scene))


def estimated_nodes(scene: Scene, cloth: Cloth) -> int:
    """Estimated number of nodes, to refuse a mesh that does not fit in memory."""
    repeats = scene.knit.repeats[0] * scene.knit.repeats[1]
    if scene.model.boundary == "gripped":
        repeats = scene.panel.shape(scene.knit.size).area / np.prod(scene.knit.repeat)
    return round(scene.model.nodes_per_loop * len(cloth.stitches) * repeats / math.prod(_tiles(scene)))


def copies_of_cloth(scene: Scene) -> tuple[int, int]:
    """How often `knit_scene` stands side by side (weft, warp) in the mesh: once where loops differ, as no repeat is like
    another then."""
    return (1, 1) if scene.knit.scatter else scene.knit.repeats


def knit_scene(scene: Scene, device: str = "cpu") -> Cloth:
    """One repeat of the scene's cloth, or all of it where loops differ; refuses (`MemoryNeeded`) a mesh that cannot fit on
    the device before anything is laid out, and (`KnitError`) loops so far from the mean that they hook
    otherwise."""
    knit = scene.knit if scene.knit.scatter else scene.knit.even
    cloth = same_cloth(knit, scene.wire.thickness, scene.model.merge_lenses, _tiles(scene))
    refuse_large_mesh(scene, cloth, device)
    return cloth


def refuse_large_mesh(scene: Scene, cloth: Cloth, device: str) -> None:
    """Refuse (`MemoryNeeded`) a mesh of the cloth that cannot fit on the device."""
    refuse_beyond_memory(_size_of(scene), scene, estimated_nodes(scene, cloth), device)


def contact_classes(scene: Scene) -> np.ndarray:
    """[clasp] number of the class of contact of each clasp of `knit_scene`."""
    knit = scene.knit if scene.knit.scatter else scene.knit.even
    return clasp_classes(knit, scene.wire.thickness, scene.model.merge_lenses, _tiles(scene))


def _tiles(scene: Scene) -> tuple[int, int]:
    """Pattern repeats that form one repeat of the cloth."""
    return scene.knit.repeats if scene.knit.scatter else (1, 1)


def _size_of(scene: Scene) -> str:
    """The key that sets the size of the mesh, with its value."""
    if scene.panel.outline == "rectangle":
        return f"knit.repeats = {list(scene.knit.repeats)}"
    if scene.panel.size is None:
        return f"panel.corners = {len(scene.panel.corners or ())} corners"
    return f"panel.size = {exact(scene.panel.size, 'm')}"


def lay_out(scene: Scene, cloth: Cloth) -> tuple[Table, Panel, float]:
    """Nodes of one repeat of the scene's cloth, the mesh of its copies, and the length [m] of wire of a loop. Raises
    `ModelError`."""
    loop_length = sum(t.length for t in cloth.threads) / len(cloth.stitches)
    slack = SLIDE_ALLOWANCE * loop_length
    spacing = loop_length / scene.model.nodes_per_loop
    table = rest_table(
        cloth,
        nodes_per_loop=scene.model.nodes_per_loop,
        set_fraction=scene.wire.set_fraction,
        lead=table_lead(cloth, 0.8 * spacing, slack),
    )
    panel = build_panel(
        cloth,
        table,
        repeats=copies_of_cloth(scene),
        outline=None if scene.model.boundary == "periodic" else scene.panel.shape(scene.knit.size),
        slack=slack,
        set_fraction=scene.wire.set_fraction,
    )
    return table, panel, loop_length
