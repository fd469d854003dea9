"""What `solver.preset` stands for: the sets of numerical options that trade accuracy for time."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Preset:
    """Values for the keys that a scene leaves out."""

    nodes_per_loop: int  # model.nodes_per_loop
    axial_softening: float  # solver.axial_softening: EA is divided by it in the dynamics
    ramp_axial_softening: float  # the same in a ramp, where nothing takes its error out again
    precision: str  # solver.precision: single | double
    ramp_precision: str  # the same in a ramp: true masses and little softening make float32's round-off shake the wires
    residual_tolerance: float  # solver.residual_tolerance


PRESETS = {
    "draft": Preset(
        nodes_per_loop=12,
        axial_softening=1000.0,
        ramp_axial_softening=100.0,
        precision="single",
        ramp_precision="double",
        residual_tolerance=1e-2,
    ),
    "standard": Preset(
        nodes_per_loop=16,
        axial_softening=1000.0,
        ramp_axial_softening=30.0,
        precision="single",
        ramp_precision="double",
        residual_tolerance=3e-3,
    ),
    "reference": Preset(
        nodes_per_loop=48,
        axial_softening=200.0,
        ramp_axial_softening=1.0,
        precision="double",
        ramp_precision="double",
        residual_tolerance=1e-4,
    ),
}
DEFAULT_PRESET = "standard"
