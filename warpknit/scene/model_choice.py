"""`model.kind = "auto"`: the plane where it is good for the knit, else space.

The plane is good where wires in space first touch after PLANE_IS_GOOD of the way to their closing in the plane, or later
(studies/condensation.md). That is known once the knit is laid out. The choice depends on the scene and the command alone, so that
`--resume` makes the same one. Loops of the mean size stand for scattered ones, so that all seeds of a map have one model.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

from warpknit.scene.capabilities import lacking
from warpknit.scene.knit import Knit
from warpknit.scene.presets import PRESETS
from warpknit.scene.traits import Case
from warpknit.scene.wire import Wire

from ..text import percent, rounded

if TYPE_CHECKING:
    from warpknit.scene.file import SceneFile
    from warpknit.scene.scene import Scene

AUTO, GIVEN = "auto", "as given"
PLANE_IS_GOOD = 0.8  # of the planar approach, at the first touch in space: the double atlas cell has 0.88
LARGE = 300_000  # nodes in space: from there on hours
NAMES = {"planar": "the plane", "spatial": "space"}


@dataclass(frozen=True)
class Choice:
    """A kind of model, and the reason in one line."""

    kind: str
    reason: str


def choose_model(file: SceneFile, wire: Wire, knit: Knit | None, *, command: str = "", ranks: int = 1) -> Choice:
    """The kind of model of a scene file, resolved, with its reason.

    knit: as it is laid out; None for hooks and wires from a file. command, ranks: as in `refuse`.
    """
    if file.model.kind != AUTO:
        return Choice(file.model.kind, GIVEN)
    best = _of_hook() if knit is None else _of_knit(file, wire, knit)
    other = replace(best, kind="spatial" if best.kind == "planar" else "planar")
    at_best, at_other = (_lacks(file, each.kind, command, ranks) for each in (best, other))
    if at_best == ([], []) or tuple(map(bool, at_other)) >= tuple(map(bool, at_best)):
        return replace(best, reason=f"taken by auto: {best.reason}")
    missing = f"not available in {NAMES[best.kind]}: {', '.join(dict.fromkeys([*at_best[0], *at_best[1]]))}"
    return Choice(other.kind, f"taken by auto: {missing}{'' if knit is None else f'; {best.reason}'}")


def _lacks(file: SceneFile, kind: str, command: str, ranks: int) -> tuple[list[str], list[str]]:
    """Features of the scene that a kind of model lacks, and those of the command."""
    scene = replace(file, model=replace(file.model, kind=kind))
    return list(lacking(Case(scene), kind)), list(lacking(Case(scene, command, ranks=ranks), kind, at_command=True))


def _of_hook() -> Choice:
    return Choice("planar", "two hooked wires, driven in their plane")


def _of_knit(file: SceneFile, wire: Wire, knit: Knit) -> Choice:
    from warpknit.knit.chain import KnitError

    radius = wire.diameter / 8 if file.model.body_radius is None else file.model.body_radius
    try:
        touch, loops = _laid_out(knit.even, wire.thickness, radius)
    except KnitError:
        return Choice("planar", "the knit cannot be laid out")
    if touch == 1.0:
        return Choice("planar", "wires in space touch no earlier than in the plane")
    first = f"wires in space first touch after {percent(touch, 0)} of the planar approach"
    if touch < PLANE_IS_GOOD:
        nodes = file.model.nodes_per_loop or PRESETS[file.solver.preset].spatial_nodes_per_loop
        size = _size(nodes * loops * math.prod(knit.repeats))
        return Choice("spatial", f"{first}; the plane is good from {percent(PLANE_IS_GOOD, 0)} on{size}")
    return Choice("planar", f"{first}, and the plane is good from {percent(PLANE_IS_GOOD, 0)} on")


def _size(nodes: int) -> str:
    """The cost of a large mesh in space, in words."""
    if nodes < LARGE:
        return ""
    return f"; about {rounded(nodes):,} nodes in space take hours (`warpknit plan`), model.kind = 'planar' is faster"


def first_touch(scene: Scene) -> float:
    """Where wires of the scene's knit first touch in space, as a share of the planar approach; 1: not before they do in the
    plane. Raises `KnitError`."""
    wire, model = scene.wire, scene.model
    return _laid_out(scene.knit.even, wire.thickness, model.body_radius)[0]


def tension_error(scene: Scene) -> float | None:
    """[%] known error of tensions at the preset in force, of tight knits against the reference preset; None if unknown."""
    name = scene.preset_in_force
    if name is None or first_touch(scene) >= PLANE_IS_GOOD:
        return scene.preset_error_percent
    return PRESETS[name].of(scene.model.kind, scene.solver.drive).tight_error_percent


@lru_cache(maxsize=64)
def _laid_out(knit: Knit, thickness: float, body_radius: float) -> tuple[float, int]:
    """`first_touch` of one repeat, and its loops; lengths in [m]."""
    from warpknit.knit.cloth import same_cloth
    from warpknit.knit.lens_width import way_left

    cloth = same_cloth(knit, thickness)  # with nested lenses as one, however many bodies they get
    return way_left(cloth, thickness, thickness + 2.0 * body_radius), len(cloth.stitches)
