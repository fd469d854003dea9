"""What `solver.preset` stands for: the sets of numerical options that trade accuracy for time."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Preset:
    """Values for the keys that a scene leaves out."""

    nodes_per_loop: int  # model.nodes_per_loop
    axial_softening: float  # solver.axial_softening: EA is divided by it in the dynamics
    precision: str  # solver.precision: single | double
    residual_tolerance: float  # solver.residual_tolerance


PRESETS = {
    "draft": Preset(nodes_per_loop=18, axial_softening=1000.0, precision="single", residual_tolerance=3e-3),
    "standard": Preset(nodes_per_loop=27, axial_softening=700.0, precision="single", residual_tolerance=3e-3),
    "reference": Preset(nodes_per_loop=92, axial_softening=64.0, precision="double", residual_tolerance=1e-4),
}
DEFAULT_PRESET = "standard"
