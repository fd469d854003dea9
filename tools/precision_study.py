"""Single against double precision: error and speed on the main patch and on a strip of one metre.

    python tools/precision_study.py [--quick] [--out DIR]

Single precision is a mixed one: displacements are 32-bit fixed point; forces, velocities and rest data float32; what adds up
over steps or over the mesh (load, time, sums of energy and forces, places in the neighbour search) float64. In double precision
all is float64. Both run the same scene; errors are against double precision with a residual ten times smaller. Prints the
table and leaves precision.csv in DIR. --quick leaves out the strip.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from study import scene_of, show_rows, write_rows

from warpknit.run.run import run_scene

RESULTS = Path(__file__).parent / "results"
SCENES: dict[str, dict[str, dict[str, Any]]] = {
    "patch of 24 mm": {},
    "strip of 1 m": {"knit": {"repeats": [1, 250]}},
}


@dataclass(frozen=True)
class Row:
    """A row of precision.csv; errors in percent of the reference."""

    scene: str
    precision: str
    nodes: int
    steps: int
    node_steps_per_s: float
    wall_s: float
    tension_weft_N_per_m: float
    tension_warp_N_per_m: float
    active_percent: float
    error_tension_percent: float
    error_active_points: float
    error_contact_force_percent: float
    error_stress_percent: float


def summary_of(name: str, precision: str, tolerance: float) -> dict[str, Any]:
    """What a run of a scene found."""
    tables = {
        **SCENES[name],
        "solver": {"precision": precision, "residual_tolerance": tolerance},
        "output": {"frames": 2, "usd": False, "figures": False},
    }
    with tempfile.TemporaryDirectory() as folder:
        return run_scene(scene_of("atlas_patch.toml", **tables), out=Path(folder) / "run").summary


def row_of(name: str, precision: str, found: dict[str, Any], reference: dict[str, Any]) -> Row:
    """A run against the reference."""
    def error(group: str, *keys: str) -> float:
        wanted = max(abs(reference[group][key]) for key in keys)
        return 100.0 * max(abs(found[group][key] - reference[group][key]) for key in keys) / wanted

    mesh, solver = found["mesh"], found["solver"]
    return Row(
        name, precision, found["model"]["nodes"], solver["steps"], solver["node_steps_per_s"], solver["wall_s"],
        mesh["tension_weft_N_per_m"], mesh["tension_warp_N_per_m"], found["contacts"]["active_percent"],
        error("mesh", "tension_weft_N_per_m", "tension_warp_N_per_m"),
        abs(found["contacts"]["active_percent"] - reference["contacts"]["active_percent"]),
        error("contacts", "force_max_N"), error("wire", "stress_max_Pa"),
    )  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--out", type=Path, default=RESULTS)
    given = parser.parse_args(arguments)
    rows = []
    for name in list(SCENES)[: 1 if given.quick else None]:
        found = {precision: summary_of(name, precision, 3e-3) for precision in ("single", "double")}
        reference = summary_of(name, "double", 3e-4)
        rows += [row_of(name, precision, summary, reference) for precision, summary in found.items()]
        show_rows(rows)
    write_rows(given.out / "precision.csv", rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
