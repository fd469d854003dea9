"""Scenes of the smaller meshes of a multilevel start."""

from __future__ import annotations

from dataclasses import replace

from ..scene import PanelOptions, Scene, Stage

RATIO = 3  # repeats of a mesh over those of the smaller one
LEAST = 8  # repeats of the smaller mesh, at least
WORTH = 1.5  # ratio from which a smaller mesh pays


def _smaller_side(repeats: int) -> int:
    """A smaller number of repeats of the same parity, so that the middle of the mesh is the same."""
    fewer = -(-repeats // RATIO)
    return min(repeats, max(LEAST + repeats % 2, fewer + (fewer - repeats) % 2))


def smaller_scene(scene: Scene) -> Scene | None:
    """The scene of the smaller mesh, or None where the mesh is small enough, or none is like it.

    A mesh of another outline than a rectangle starts from one repeat in the plane only: in space, where it fades out towards the
    clamps, wires would pass through each other.
    """
    repeats = scene.knit.repeats
    if scene.hook is not None or scene.wires is not None or scene.knit.scatter or scene.depends_on_path:
        return None  # no repeat is like another, or what was before counts
    if scene.model.boundary == "periodic":
        smaller = (1, 1)
    elif scene.model.kind == "spatial" and (scene.panel.outline != "rectangle" or scene.has_moving_edge):
        return None
    elif scene.panel.outline != "rectangle":
        return one_repeat(scene)
    else:
        smaller = _smaller_side(repeats[0]), _smaller_side(repeats[1])
        if repeats[0] * repeats[1] < WORTH * smaller[0] * smaller[1]:
            return None
    if smaller == repeats:
        return None
    return of_repeats(scene, *smaller)


def of_repeats(scene: Scene, columns: int, rows: int) -> Scene:
    """The scene of a tile, or a gripped rectangle, of so many repeats, without loads that vary over the mesh."""
    knit = replace(scene.knit, repeats=(columns, rows))
    return replace(scene, knit=knit, panel=PanelOptions(), stages=_plain_stages(scene))


def one_repeat(scene: Scene) -> Scene:
    """The scene of one periodic repeat of the same cloth."""
    knit, options = replace(scene.knit, repeats=(1, 1)), replace(scene.model, boundary="periodic")
    contact, wire = replace(scene.contact, friction=0.0), replace(scene.wire, plastic=False)
    stages = _plain_stages(scene)
    return replace(scene, wire=wire, knit=knit, model=options, panel=PanelOptions(), contact=contact, stages=stages)


def _plain_stages(scene: Scene) -> tuple[Stage, ...]:
    """The stages without loads that vary over the mesh."""
    return tuple(replace(stage, pull=(), temperature_gradient=(0.0, 0.0)) for stage in scene.stages)
