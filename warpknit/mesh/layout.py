"""From a scene to the nodes of its mesh: the cloth, its copies, and the number of nodes."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ..base.errors import ModelError
from ..base.text import exact
from ..compute.memory import refuse_beyond_memory
from ..knit.cloth import Cloth, knit_cloth
from ..scene import PanelOptions, Scene, Stage
from ..scene.panel_options import covering_repeats
from ..wires.read import drawn_wires
from .panel import Panel, build_panel, table_lead
from .rest_table import Table, rest_table

SLIDE_ALLOWANCE = 0.2  # how far a contact may slide beyond its lens, in wire lengths of a loop


def mesh_nodes(scene: Scene) -> int:
    """Number of nodes of a scene's mesh, which is not laid out: estimated for cloth that is cut. Raises the errors of a file."""
    if scene.wires is not None:
        return drawn_wires(scene).node_count
    if scene.hook is not None:
        return 2 * (scene.model.nodes_per_loop + 1)
    return estimated_nodes(scene, knit_scene(scene))


def estimated_nodes(scene: Scene, cloth: Cloth) -> int:
    """Estimated number of nodes, for the check of memory."""
    repeats = scene.knit.repeats[0] * scene.knit.repeats[1]
    if scene.model.boundary == "gripped":
        repeats = scene.panel.shape(scene.knit.size).area / np.prod(scene.knit.repeat)
    return round(scene.model.nodes_per_loop * len(cloth.stitches) * repeats / math.prod(_tiles(scene)))


def copies_of_cloth(scene: Scene) -> tuple[int, int]:
    """How often `knit_scene` stands side by side (weft, warp) in the mesh: once where loops differ, as no repeat is like
    another then."""
    return (1, 1) if scene.knit.scatter else scene.knit.repeats


def knit_scene(scene: Scene, device: str = "cpu") -> Cloth:
    """One repeat of the scene's cloth; all of it where loops differ. Before layout it refuses a mesh that cannot fit on the
    device (`MemoryNeeded`, with the key that sets its size), and scattered loops that hook otherwise (`KnitError`).
    """
    knit = scene.knit if scene.knit.scatter else scene.knit.even
    cloth = knit_cloth(knit, scene.wire.thickness, scene.model.merge_lenses, _tiles(scene))
    size = f"knit.repeats = {list(scene.knit.repeats)}"
    if scene.panel.outline != "rectangle":
        corners, length = f"panel.corners = {len(scene.panel.corners or ())} corners", scene.panel.size
        size = corners if length is None else f"panel.size = {exact(length, 'm')}"
    refuse_beyond_memory(size, scene, estimated_nodes(scene, cloth), device)
    return cloth


def refuse_large_patch(scene: Scene, use: str, instead: str) -> None:
    """Refuse (`ModelError`) a gripped mesh that starts from a smaller one.

    use, instead: of many meshes side by side, for the message.
    """
    if scene.model.boundary == "gripped" and not scene.depends_on_path and smaller_scene(scene) is not None:
        raise ModelError(f"knit.repeats: {list(scene.knit.repeats)} are too many for {use}; write about ten a side, or {instead}")


def _tiles(scene: Scene) -> tuple[int, int]:
    """Pattern repeats that form one repeat of the cloth."""
    return scene.knit.repeats if scene.knit.scatter else (1, 1)


def lay_out(scene: Scene, cloth: Cloth) -> tuple[Table, Panel, float]:
    """Nodes of one repeat, the mesh of its copies, wire length of a loop [m]. Raises `ModelError`."""
    loop_length = cloth.stitch_length
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


RATIO = 3  # repeats of a mesh over the smaller one
LEAST = 8  # repeats of the smaller mesh, at least
WORTH = 1.5  # ratio from which a smaller mesh pays


def _smaller_side(repeats: int) -> int:
    """A smaller number of repeats of the same parity, with the same middle."""
    fewer = -(-repeats // RATIO)
    return min(repeats, max(LEAST + repeats % 2, fewer + (fewer - repeats) % 2))


def smaller_scene(scene: Scene) -> Scene | None:
    """Scene of the smaller mesh; None for small meshes, or where none is similar.

    A mesh of another outline than a rectangle, or on an edge that moves, starts from one repeat, whose change fades out towards
    the clamps. With friction it does so at its first load, unless a tension is given, at which the repeat may strain more.
    """
    repeats, is_gripped = scene.knit.repeats, scene.model.boundary == "gripped"
    if scene.hook is not None or scene.wires is not None or scene.knit.scatter or scene.wire.plastic:
        return None  # no repeat is like another, or what was before counts
    is_facet = is_gripped and (scene.panel.outline != "rectangle" or scene.has_moving_edge)
    carries = is_facet and scene.model.of_kind.carries_friction and not any(any(stage.by_tension) for stage in scene.stages)
    if scene.depends_on_path and not carries:
        return None
    if is_facet:
        return replace(one_repeat(scene), contact=scene.contact)
    smaller = (_smaller_side(repeats[0]), _smaller_side(repeats[1])) if is_gripped else (1, 1)
    if is_gripped and repeats[0] * repeats[1] < WORTH * smaller[0] * smaller[1]:
        return None
    return None if smaller == repeats else of_repeats(scene, *smaller)


def of_repeats(scene: Scene, columns: int, rows: int) -> Scene:
    """Scene of a tile or gripped rectangle of these repeats. Without loads that vary over the mesh."""
    knit = replace(scene.knit, repeats=(columns, rows))
    return replace(scene, knit=knit, panel=PanelOptions(), stages=_plain_stages(scene))


def shrunk(scene: Scene, share: float) -> Scene:
    """Scene of a smaller gripped mesh of the same form and grip pitch. Without loads that vary over the mesh."""
    panel, knit = scene.panel, scene.knit
    corners = None if panel.corners is None else tuple((share * x, share * y) for x, y in panel.corners)
    panel = replace(panel, size=None if panel.size is None else share * panel.size, corners=corners)
    if panel.outline == "rectangle":
        columns, rows = (max(1, round(share * repeats)) for repeats in knit.repeats)
    else:
        columns, rows = covering_repeats(panel.shape(knit.size), knit.repeat)
    return replace(scene, panel=panel, knit=replace(knit, repeats=(columns, rows)), stages=_plain_stages(scene))


def one_repeat(scene: Scene) -> Scene:
    """One periodic repeat of the same cloth, of even loops and without a history."""
    knit, options = replace(scene.knit, repeats=(1, 1), scatter=0.0), replace(scene.model, boundary="periodic")
    contact, wire = replace(scene.contact, friction=0.0), replace(scene.wire, plastic=False)
    stages = _plain_stages(scene)
    return replace(scene, wire=wire, knit=knit, model=options, panel=PanelOptions(), contact=contact, stages=stages)


def _plain_stages(scene: Scene) -> tuple[Stage, ...]:
    """The stages without loads that vary over the mesh."""
    return tuple(replace(stage, pull=(), temperature_gradient=(0.0, 0.0)) for stage in scene.stages)
