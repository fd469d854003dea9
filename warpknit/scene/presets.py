"""The presets of `solver.preset`: sets of numerical options, from fast to accurate."""

from __future__ import annotations

from dataclasses import dataclass, replace

SPATIAL_SOFTENING = 1e5  # of a spatial relaxation: the bending stiffness of the loops limits it (spatial/model.py)


@dataclass(frozen=True)
class Preset:
    """Defaults of the keys that a scene leaves out."""

    nodes_per_loop: int  # model.nodes_per_loop
    spatial_nodes_per_loop: int  # the same in the spatial model, closer together at bends (spatial/placed_wires.py)
    spatial_ramp_nodes_per_loop: int  # the same in a spatial ramp, at equal distances
    ramp_nodes_per_loop: int  # the same in a ramp, whose segments keep the length of their chords and not of their arcs
    axial_softening: float  # solver.axial_softening: EA is divided by it in the dynamics
    ramp_axial_softening: float  # the same in a ramp, where nothing takes its error out again
    precision: str  # solver.precision: single | double
    ramp_precision: str  # the same in a ramp: true masses and little softening make float32's round-off shake the wires
    residual_tolerance: float  # solver.residual_tolerance
    error_percent: float  # measured, see below
    node_steps: float  # of a repeat of the double atlas mesh and a load level, measured
    spatial_error_percent: float  # the same in the spatial model
    spatial_node_steps: float
    tight_error_percent: float | None  # the same for tensions of tight spatial knits, at nine of ten levels; None: not known

    def of(self, kind: str, drive: str) -> Preset:
        """The preset for a drive (relax | ramp) and a kind of model (planar | spatial)."""
        numerics = {
            "relax": self,
            "ramp": replace(
                self,
                nodes_per_loop=self.ramp_nodes_per_loop,
                axial_softening=self.ramp_axial_softening,
                precision=self.ramp_precision,
            ),
        }[drive]
        softening = SPATIAL_SOFTENING if drive == "relax" else numerics.axial_softening
        return {
            "planar": replace(numerics, tight_error_percent=None),
            "spatial": replace(
                numerics,
                nodes_per_loop=self.spatial_nodes_per_loop if drive == "relax" else self.spatial_ramp_nodes_per_loop,
                axial_softening=softening,
                precision="double",
                error_percent=self.spatial_error_percent,
                node_steps=self.spatial_node_steps,
            ),
        }[kind]


# `error_percent` is the largest error in active share, tension, sum of contact forces and largest stress over the 12 loads of one
# repeat of the double atlas mesh in tools/studies/results/presets.csv (python tools/studies/accuracy.py presets): 2 to 25 %
# strain, even and uneven, 15 and 30 um wire, lenses merged or not. `node_steps` is the median there. Other knits and grips are
# in studies/trade.md; `run --error` measures on the scene. Spatial errors are in presets_spatial.csv (`accuracy.py space`);
# the draft's is a sixth of the contacts, light ones about to close at 10 % strain: else it is 1.5. `tight_error_percent` is of
# ten knits of two wires by 2 to 12 %, against the reference preset (tools/studies/tight_knits.py --against).
PRESETS = {
    "draft": Preset(
        nodes_per_loop=12,
        ramp_nodes_per_loop=16,
        spatial_nodes_per_loop=20,
        spatial_ramp_nodes_per_loop=48,
        axial_softening=1000.0,
        ramp_axial_softening=100.0,
        precision="single",
        ramp_precision="double",
        residual_tolerance=1e-2,
        error_percent=2.1,
        node_steps=1.03e5,
        spatial_error_percent=2.7,
        spatial_node_steps=1.38e5,
        tight_error_percent=7.0,
    ),
    "standard": Preset(
        nodes_per_loop=16,
        ramp_nodes_per_loop=28,
        spatial_nodes_per_loop=28,
        spatial_ramp_nodes_per_loop=64,
        axial_softening=1000.0,
        ramp_axial_softening=30.0,
        precision="single",
        ramp_precision="double",
        residual_tolerance=3e-3,
        error_percent=1.7,
        node_steps=1.84e5,
        spatial_error_percent=1.4,
        spatial_node_steps=2.12e5,
        tight_error_percent=1.8,
    ),
    "reference": Preset(
        nodes_per_loop=48,
        ramp_nodes_per_loop=72,
        spatial_nodes_per_loop=64,
        spatial_ramp_nodes_per_loop=128,
        axial_softening=200.0,
        ramp_axial_softening=1.0,
        precision="double",
        ramp_precision="double",
        residual_tolerance=1e-4,
        error_percent=0.1,
        node_steps=4.6e6,
        spatial_error_percent=0.5,
        spatial_node_steps=1.32e6,
        tight_error_percent=None,
    ),
}
DEFAULT_PRESET = "standard"
COMPARED_NODES = 40  # nodes of a spatial loop; the locknit of docs/studies/extremes.md has the same state with 32 and more


def tight_knits(name: str, kind: str) -> str:
    """Accuracy for tight knits at a preset, a sentence without its point; or empty."""
    error = PRESETS[name].of(kind, "relax").tight_error_percent
    if error is None:
        return ""
    found = (
        f"tight knits: tensions within {error:g} % of preset reference at nine of ten loads, another equilibrium at the others"
    )
    return f"{found}; compare with model.nodes_per_loop = {COMPARED_NODES} and other output.frames"


def preset_like(kind: str, nodes_per_loop: int, axial_softening: float, precision: str, residual_tolerance: float) -> str | None:
    """Preset with these settings of a relaxation, or None."""
    given = (nodes_per_loop, axial_softening, precision, residual_tolerance)
    for name, preset in PRESETS.items():
        p = preset.of(kind, "relax")
        if given == (p.nodes_per_loop, p.axial_softening, p.precision, p.residual_tolerance):
            return name
    return None
