"""What forces, tensions and energies are compared with where little is loaded."""

from __future__ import annotations

from typing import Protocol

from ..scene import Scene


class Sized(Protocol):
    """A model of either kind."""

    @property
    def scene(self) -> Scene: ...
    @property
    def bending_stiffness(self) -> float: ...
    @property
    def node_count(self) -> int: ...


def force_scale(model: Sized) -> float:
    """EI/W^2 [N]."""
    return model.bending_stiffness / model.scene.knit.wale_spacing**2


def tension_scale(model: Sized) -> float:
    """EI/C^3 [N/m]: the stiffness of a loose mesh, and the measure of a small tension."""
    return model.bending_stiffness / model.scene.knit.course_spacing**3


def energy_scale(model: Sized) -> float:
    """EI/W a loop [J]: what energies are compared with where little is stored."""
    loops = model.node_count / model.scene.model.nodes_per_loop
    return model.bending_stiffness / model.scene.knit.wale_spacing * loops
