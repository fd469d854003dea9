"""Metal meshes pulled to break, as published; unpublished values are varied.

Source: "Research on the Knittability of Metallic Yarns in the Warp-knitted Mesh of a Deployable Antenna", Fibres & Textiles in
Eastern Europe 2023, doi 10.2478/ftee-2023-0015, tables: yarn, lapping, run-in a rack, and of strips of 100 mm between clamps with
free sides the width, force and elongation at break.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from warpknit.scene import Scene
from warpknit.studies.inputs import fit_run_in

RACK = 480  # courses

REVERSE_LOCKNIT = ({"chain": "2-3/1-0"}, {"chain": "1-0/1-2"})  # bar 2 of the paper lies at the back
ATLAS = ({"chain": "1-0/1-2/2-3/2-1"}, {"chain": "2-3/2-1/1-0/1-2"})
OPEN_TRICOT = ({"chain": "0-1/2-1"}, {"chain": "2-1/0-1"})


@dataclass(frozen=True)
class Measured:
    """Force and elongation at break of a strip: mean and coefficient of variation."""

    width: float  # [m]
    force: float  # [N]
    force_cv: float
    strain: float
    strain_cv: float


@dataclass(frozen=True)
class Mesh:
    """Published data of a mesh, and the spacings of its cases."""

    name: str
    bars: tuple[dict[str, str], ...]
    wire: dict[str, Any]
    strength: tuple[float, float]  # [Pa] range of such wire
    spacings: dict[str, tuple[float, float]]  # wales and courses an inch: base, and other cases
    measured: dict[str, Measured]
    run_in: tuple[float, float] | None = None  # [m] a rack, in the order of the bars

    @property
    def middle(self) -> float:
        """[Pa] strength of the base case."""
        return 0.5 * sum(self.strength)


MOLYBDENUM = {"material": "molybdenum", "youngs_modulus": "320 GPa"}
STEEL = {"material": "molybdenum", "youngs_modulus": "193 GPa", "poissons_ratio": 0.29, "density": "7900 kg/m^3"}
OF_MOLYBDENUM, OF_STEEL = (0.8e9, 1.2e9), (0.6e9, 1.1e9)
# HF-1 and HF-2: the loops of both bars take their run-in with 30 to 37 and 26 to 33 courses from 24 to 28 wales; with 32 wales,
# of cloth that has shrunk in width off the machine, with 27 to 30 and 25
MESHES = (
    Mesh(
        "HF-1", REVERSE_LOCKNIT, MOLYBDENUM | {"diameter": "17 um", "ends": 4}, OF_MOLYBDENUM,
        {"base": (26, 33), "24 wales": (24, 37), "28 wales": (28, 30), "32 wales": (32, 28)},
        {"warp": Measured(25e-3, 36.16, 0.07, 0.452, 0.03), "weft": Measured(15e-3, 29.01, 0.08, 1.068, 0.02)},
        (2.370, 2.220),
    ),
    Mesh(
        "LF-2", ATLAS, MOLYBDENUM | {"diameter": "27 um", "ends": 3}, OF_MOLYBDENUM,
        {"base": (26, 30), "25 courses": (26, 25), "40 courses": (26, 40)},
        {"warp": Measured(45e-3, 29.30, 0.07, 0.522, 0.08), "weft": Measured(40e-3, 23.68, 0.03, 0.726, 0.12)},
    ),
    Mesh(
        "HF-2", REVERSE_LOCKNIT, MOLYBDENUM | {"diameter": "16 um", "ends": 4}, OF_MOLYBDENUM,
        {"base": (26, 28), "24 wales": (24, 33), "28 wales": (28, 26), "32 wales": (32, 25)},
        {"warp": Measured(25e-3, 30.40, 0.11, 0.444, 0.02), "weft": Measured(20e-3, 25.93, 0.02, 1.261, 0.03)},
        (2.690, 2.220),
    ),
    Mesh(
        "LF-1", ATLAS, STEEL | {"diameter": "30 um", "ends": 3}, OF_STEEL,
        {"base": (26, 30), "25 courses": (26, 25), "40 courses": (26, 40)},
        {"warp": Measured(30e-3, 23.14, 0.15, 0.357, 0.19), "weft": Measured(48e-3, 17.79, 0.08, 0.961, 0.06)},
    ),
)  # fmt: skip


def with_run_in(scene: Scene, run_in: tuple[float, ...] | None) -> Scene:
    """Scene with the run-in [m] a rack of each bar, or unchanged."""
    if run_in is None:
        return scene
    bars = fit_run_in(scene, tuple(length / RACK for length in run_in)).scene.knit.bars
    return scene.changed({"knit.bars": [{"chain": bar.chain, "loop_scale": bar.loop_scale} for bar in bars]})


@dataclass(frozen=True)
class Case:
    """One choice of what was not published."""

    name: str
    changes: dict[str, Any] = field(default_factory=dict)  # of the scene, dotted
    bars: tuple[dict[str, str], ...] | None = None
    only: tuple[str, ...] = ("HF-1", "LF-2", "HF-2", "LF-1")  # meshes


CASES = (
    Case("elastic", {"wire.plastic": False}, only=("HF-1", "HF-2", "LF-1")),
    Case("elastic", {"wire.plastic": False, "solver.max_steps": 40_000}, only=("LF-2",)),  # 8000 do not pass a jump at 34 to 36 %
    Case("no friction", {"contact.friction": 0.0}),
    Case("set 0.8", {"wire.set_fraction": 0.8}),
    Case("hardening 0.1", {"wire.hardening": 0.1}, only=("HF-1",)),
    Case("E 280 GPa", {"wire.youngs_modulus": 280e9}, only=("HF-1",)),  # with plating
    Case("yield 0.5", {"wire.yield_stress": 0.5 * 1.0e9}, only=("HF-1",)),  # of the middle strength
    Case("yield 0.5", {"wire.yield_stress": 0.5 * 0.85e9}, only=("LF-1",)),
    Case("yield 0.95", {"wire.yield_stress": 0.95 * 1.0e9}, only=("HF-1",)),
    Case("yield 0.95", {"wire.yield_stress": 0.95 * 0.85e9}, only=("LF-1",)),
    Case("40 nodes", {"model.nodes_per_loop": 40}, only=("HF-1",)),
    Case("open tricot", bars=OPEN_TRICOT, only=("LF-2", "LF-1")),
)
