"""Numerical settings of probe runs and references of a trade."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from ..scene import Scene

SOFTENING = 1000.0  # axial softening of probe runs


@dataclass(frozen=True)
class Setting:
    """Numerical settings of a probe run."""

    nodes_per_loop: int
    axial_softening: float
    residual_tolerance: float
    precision: str

    @property
    def overrides(self) -> tuple[tuple[str, object], ...]:
        """The settings as keys of a scene."""
        tables = {"nodes_per_loop": "model"}
        return tuple((f"{tables.get(name, 'solver')}.{name}", value) for name, value in asdict(self).items())


def setting_of(scene: Scene) -> Setting:
    """The settings of a scene."""
    solver = scene.solver
    return Setting(scene.model.nodes_per_loop, solver.axial_softening, solver.residual_tolerance, solver.precision)


@dataclass(frozen=True)
class Varied:
    """Values of the numerical parameters that a trade varies."""

    nodes_per_loop: tuple[int, ...]
    axial_softening: tuple[float, ...]
    residual_tolerance: tuple[float, ...]
    ramp_nodes_per_loop: tuple[int, ...]
    combined: tuple[Setting, ...]  # all combinations of the parameters with the largest effect on cost


def edge_of(scene: Scene) -> str:
    """periodic | gripped | hook: decides how errors depend on the nodes."""
    return "hook" if scene.hook is not None else scene.model.boundary
