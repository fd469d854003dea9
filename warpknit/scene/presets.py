"""The presets of `solver.preset`: sets of numerical options, from fast to accurate."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Preset:
    """Defaults of omitted keys, for one kind of model and one drive.

    Spatial nodes are closer together at bends (spatial/placed_wires.py), in a ramp at equal distances. Segments of a ramp keep
    the length of their chords, not of their arcs, and nothing corrects the error of its softening; true masses with little
    softening make float32's round-off shake the wires.
    """

    nodes_per_loop: int  # model.nodes_per_loop
    axial_softening: float  # solver.axial_softening: EA is divided by it in the dynamics
    precision: str  # solver.precision: single | double
    residual_tolerance: float  # solver.residual_tolerance


@dataclass(frozen=True)
class Measured:
    """Accuracy and cost of a relaxation at a preset."""

    error_percent: float  # largest error in active share, tension, sum of contact forces and largest stress
    node_steps: float  # of a repeat of the double atlas mesh and a load level, median
    tight_error_percent: float | None = None  # of tensions of tight spatial knits, at nine of ten levels; None: not known


SPATIAL_SOFTENING = 1e5  # of a spatial relaxation: the bending stiffness of the loops limits it (spatial/model.py)
PRESETS = {  # by kind of model and drive
    "draft": {
        ("planar", "relax"): Preset(12, 1000.0, "single", 1e-2),
        ("planar", "ramp"): Preset(16, 100.0, "double", 1e-2),
        ("spatial", "relax"): Preset(20, SPATIAL_SOFTENING, "double", 1e-2),
        ("spatial", "ramp"): Preset(48, 100.0, "double", 1e-2),
    },
    "standard": {
        ("planar", "relax"): Preset(16, 1000.0, "single", 3e-3),
        ("planar", "ramp"): Preset(28, 30.0, "double", 3e-3),
        ("spatial", "relax"): Preset(28, SPATIAL_SOFTENING, "double", 3e-3),
        ("spatial", "ramp"): Preset(64, 30.0, "double", 3e-3),
    },
    "reference": {
        ("planar", "relax"): Preset(48, 200.0, "double", 1e-4),
        ("planar", "ramp"): Preset(72, 1.0, "double", 1e-4),
        ("spatial", "relax"): Preset(64, SPATIAL_SOFTENING, "double", 1e-4),
        ("spatial", "ramp"): Preset(128, 1.0, "double", 1e-4),
    },
}
DEFAULT_PRESET = "standard"
# Strain from one equilibrium to the next where the state depends on the load history: against 0.5 %, 1 % changes tensions of four
# knits with friction by 2 % at most, 2 % by 5 % (studies/friction.md).
HISTORY_INCREMENTS = {"draft": 0.02, "standard": 0.01, "reference": 0.005}
# Over the 12 loads of one repeat of the double atlas mesh in tools/studies/results/presets.csv (python
# tools/studies/accuracy.py presets): 2 to 25 % strain, even and uneven, 15 and 30 um wire, lenses merged or not. Other knits and
# grips are in studies/trade.md; `run --error` measures on the scene. Spatial errors are in presets_spatial.csv (`accuracy.py
# space`); the draft's is a sixth of the contacts, light ones about to close at 10 % strain: else it is 1.5. Tight knits: ten
# knits of two wires by 2 to 12 %, against the reference preset (tools/studies/tight_knits.py --against).
MEASURED = {
    ("draft", "planar"): Measured(2.1, 1.03e5),
    ("draft", "spatial"): Measured(2.7, 1.38e5, 7.0),
    ("standard", "planar"): Measured(1.7, 1.84e5),
    ("standard", "spatial"): Measured(1.4, 2.12e5, 1.8),
    ("reference", "planar"): Measured(0.1, 4.6e6),
    ("reference", "spatial"): Measured(0.5, 1.32e6),
}
COMPARED_NODES = 40  # nodes of a spatial loop; the locknit of docs/studies/extremes.md has the same state with 32 and more
