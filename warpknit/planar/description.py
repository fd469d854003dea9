"""The planar model of a scene in words, for `warpknit plan`."""

from __future__ import annotations

from collections.abc import Iterator

from ..base.text import engineering, rounded
from ..knit.cloth import Cloth
from ..scene import Scene
from ..scene.presets import PRESETS
from .model import Model
from .model import tight_loops as limitations

__all__ = ["accuracy", "contacts", "limitations", "overlaps_as_knitted", "physics"]


def contacts(bodies: int) -> str:
    """The number of bodies, with what they are."""
    return f"{bodies:,} bodies, {2 * bodies:,} pairs"


def accuracy(scene: Scene) -> str:
    """Expected error of the settings of the scene."""
    name = scene.preset_in_force
    if name is None:
        return "accuracy unknown for these settings; run --error PERCENT chooses settings for an error"
    preset = PRESETS[name]
    grips = "; larger for short wires between grips" if scene.model.boundary == "gripped" and scene.hook is None else ""
    return (
        f"{scene.preset_error_text}{grips};"
        f" {rounded(preset.node_steps):,} node-steps a load level there; run --error PERCENT measures it on this scene"
    )


def physics(model: Model, bodies: int) -> Iterator[str]:
    """Physics of a mesh with `bodies` bodies, one sentence each."""
    scene, wire = model.scene, model.scene.wire
    yield f"stretching: wires carry tension, EA = {engineering(wire.axial_stiffness, 'N')}"
    yield f"bending: wires resist a change of curvature, EI = {engineering(1e6 * wire.bending_stiffness, 'N mm2')}"
    if scene.hook is not None:
        yield f"contact: one place, contact.treatment = {scene.contact.treatment!r}"
    elif bodies:
        merged = "nested lenses merged" if scene.model.merge_lenses else "one for each lens, model.merge_lenses = false"
        yield f"contact: {bodies:,} hooks, each a body between two wires ({merged})"
    if model.softening != 1.0:
        yield f"softening: axial stiffness divided by {model.softening:g} in the dynamics, solver.axial_softening"
    if scene.solver.drive == "relax" and scene.solver.multipliers:
        yield "augmented Lagrangian: multipliers correct the errors of softening and contact penalty, solver.multipliers"


def overlaps_as_knitted(scene: Scene, repeat: Cloth) -> Iterator[str]:
    """Warning where bodies of a repeat have no room as knitted. Merged lenses do not count: their bodies may move aside."""
    reach = 0.5 * scene.wire.thickness + scene.model.body_radius
    narrow = [clasp for clasp in repeat.clasps if clasp.lenses == 1 and sum(arm.clearance for arm in clasp.arms) < 2.0 * reach]
    if narrow:
        of_all = f"{2 * len(narrow)} of {2 * len(repeat.clasps)} pairs of a repeat"
        yield f"At least {of_all} are active as knitted."
