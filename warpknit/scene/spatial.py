"""What a scene of the spatial model (`model.kind = "spatial"`) may ask for."""

from __future__ import annotations

from warpknit.scene.file import SceneFile
from warpknit.scene.source import Source

WITH = "with model.kind = 'spatial'"


def refuse_unsupported(source: Source, file: SceneFile) -> None:
    """Raise SceneError where the scene asks the spatial model for what only the planar one does."""
    if file.model.kind != "spatial":
        return
    for location, given, supported, allowed in (
        (
            ("contact", "treatment"),
            file.contact.treatment,
            file.contact.treatment == "free-body",
            f"left out {WITH}, whose wires touch each other themselves",
        ),
        (("panel", "focal_length"), file.panel.focal_length, file.panel.focal_length is None, f"left out {WITH}"),
        (("solver", "precision"), file.solver.precision, file.solver.precision != "single", f"'double' {WITH}"),
        (("solver", "multipliers"), file.solver.multipliers, file.solver.multipliers, f"true {WITH}"),
        (
            ("contact", "body_mass"),
            file.contact.body_mass,
            file.contact.body_mass is None,
            f"left out {WITH}, whose wires touch each other themselves",
        ),
    ):
        if not supported:
            raise source.refusal(location, given, allowed)
    stages = [(("load",), file.load), *((("path", number), stage) for number, stage in enumerate(file.path))]
    moves = file.panel.cord is not None or any(stage.pull for _, stage in stages)
    if moves and file.solver.drive == "ramp":
        raise source.refusal(("solver", "drive"), "ramp", f"'relax' with cords or pulls {WITH}")
    for place, stage in stages:
        if moves and stage.clamp_rotation:
            raise source.refusal((*place, "clamp_rotation"), stage.clamp_rotation, f"0 with cords or pulls {WITH}")
