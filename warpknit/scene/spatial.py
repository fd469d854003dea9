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
        (("panel", "grip_pitch"), file.panel.grip_pitch, file.panel.grip_pitch is None, f"left out {WITH}"),
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
    for place, stage in ((("load",), file.load), *((("path", k), stage) for k, stage in enumerate(file.path))):
        if stage.pull:
            raise source.refusal((*place, "pull"), "a pull", f"left out {WITH}")
