"""Certainty of means over meshes of scattered loops; scatter of single meshes.

    python tools/studies/variants.py [DIR] [--knit NAME]      an hour; --quick a minute

One repeat of each knit as `warpknit new` has it (30 um molybdenum, 26 wales and 30 courses an inch), strained by 6 % both ways,
or pulled by 2 N/m, with friction 0.2 and loops scattered by 2 %. Every case changes one thing. The band of the first 16 meshes,
in which eight in ten are to lie, is held against the others of the first case.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from study import add_directory, new_parser, show_rows, start_study, table_path, write_rows

from warpknit import measure
from warpknit.knit.named import named_knit
from warpknit.runner.variants import range_of
from warpknit.scene import Scene, make_scene
from warpknit.solve.simulate import Record, Simulation
from warpknit.solve.variant_models import VariantModels

KNITS = ("tricot", "reverse-locknit", "atlas", "queens-cord", "locknit", "satin", "sharkskin", "open-tricot")
STRAIN = {"strain_weft": 0.06, "strain_warp": 0.06}
MESHES, OF_BAND, OF_CASES = 64, 16, 16
BY_TENSION = "by 2 N/m"
COUNTS = {"as it is": MESHES, BY_TENSION: MESHES, "4 x 4 repeats": 4, "8 x 8 repeats": 2}  # of other cases: OF_CASES
Tables = dict[str, dict[str, Any]]
TENSIONS: Tables = {"load": {"strain_weft": None, "strain_warp": None, "tension_weft": 2.0, "tension_warp": 2.0}}
SETTINGS: dict[str, Tables] = {
    "3 levels": {"output": {"frames": 3}},
    "24 levels": {"output": {"frames": 24}},
    "1.5 times the nodes": {"model": {"nodes_per_loop": 42}},
    "draft": {"solver": {"preset": "draft"}},
    "tolerance 1e-4": {"solver": {"residual_tolerance": 1e-4, "precision": "double"}},
    "2 x 2 repeats": {"knit": {"repeats": [2, 2]}},
    "3 x 3 repeats": {"knit": {"repeats": [3, 3]}},
}
CASES: dict[str, Tables] = {
    "as it is": {},
    **SETTINGS,
    BY_TENSION: TENSIONS,
    **{f"{BY_TENSION}, {case}": TENSIONS | tables for case, tables in SETTINGS.items()},
    "4 x 4 repeats": {"knit": {"repeats": [4, 4]}},
    "8 x 8 repeats": {"knit": {"repeats": [8, 8]}},
    "friction 0": {"contact": {"friction": 0.0}},
    "friction 0.1": {"contact": {"friction": 0.1}},
    "friction 0.3": {"contact": {"friction": 0.3}},
    "scatter 0.005": {"variants": {"scatter": 0.005}},
    "scatter 0.05": {"variants": {"scatter": 0.05}},
    "weft first": {"load": {"strain_warp": 0.0}, "path": STRAIN},
    "warp first": {"load": {"strain_weft": 0.0}, "path": STRAIN},
    "back from 7 %": {"load": {"strain_weft": 0.07, "strain_warp": 0.07}, "path": STRAIN},
}


@dataclass(frozen=True)
class Row:
    """Meshes of one case, SI; standard deviations, and errors of means over the larger mean."""

    knit: str
    case: str
    meshes: int  # that converged
    failed: int
    tension_weft_N_per_m: float
    tension_warp_N_per_m: float
    std_weft: float
    std_warp: float
    error_percent: float
    strain_weft: float
    strain_warp: float
    std_strain: float  # the larger of weft and warp
    active_percent: float
    stress_max_Pa: float
    std_stress_Pa: float
    inside_percent: float | None  # of other meshes within the band of the first ones: both tensions, or strains where these drive
    steps: float  # of a mesh
    wall_s: float  # of all, with their models


def scene_of(knit: str, case: str) -> Scene:
    """The scene of a case."""
    bars = [{"chain": bar.chain, "threading": bar.threading, "shift": bar.shift} for bar in named_knit(knit).bars]
    table: dict[str, Any] = {
        "wire": {"material": "molybdenum", "diameter": "30 um"},
        "knit": {"bars": bars, "wales": "26 /inch", "courses": "30 /inch"},
        "model": {"kind": "spatial", "boundary": "periodic"},
        "contact": {"friction": 0.2},
        "load": dict(STRAIN),
        "solver": {},
        "output": {"frames": 6},
        "variants": {"count": OF_CASES},
    }
    for name, values in CASES[case].items():
        if name == "path":
            table["path"] = [values]
        else:
            table[name] = {key: value for key, value in (table[name] | values).items() if value is not None}
    return make_scene(table)


def values_of(record: Record) -> list[float]:
    r = record.observables
    strain = np.diag(r.stretch) - 1.0
    return [*measure.mesh_tension(r), *strain, measure.contacts(r).active_percent, measure.largest_stress(r), record.steps]


def solved(scene: Scene, count: int) -> tuple[NDArray[np.float64], int]:
    """Values (mesh, 7) of the last record of converged meshes; number of the others."""
    models = VariantModels(scene)
    numbers = models.take(count)
    simulation = Simulation(models.model(numbers[0]), worlds=[models.model(number) for number in numbers])
    last = {record.world: record for record in simulation.run()}
    found = [values_of(last[world]) for world in sorted(last) if world not in simulation.failures]
    return np.array(found).reshape(-1, 7), len(simulation.failures)


def inside(values: NDArray[np.float64]) -> float:
    """Share [%] of later meshes within the first ones' band; mean of weft and warp. values: (mesh, side)."""
    low, high = range_of(values[:OF_BAND])
    others = values[OF_BAND:]
    return 100.0 * float(np.mean((low <= others) & (others <= high)))


def row_of(knit: str, case: str, count: int) -> Row:
    begin = time.perf_counter()
    values, failed = solved(scene_of(knit, case), count)
    mean, std = values.mean(axis=0), values.std(axis=0, ddof=1)
    sides = slice(2, 4) if case.startswith(BY_TENSION) else slice(2)
    largest, scattered = np.abs(mean[sides]).max(), std[sides]
    return Row(
        knit, case, len(values), failed, *mean[:2].tolist(), *std[:2].tolist(),
        error_percent=float(100.0 * scattered.max() / np.sqrt(len(values)) / largest),
        strain_weft=float(mean[2]), strain_warp=float(mean[3]), std_strain=float(std[2:4].max()),
        active_percent=float(mean[4]), stress_max_Pa=float(mean[5]), std_stress_Pa=float(std[5]),
        inside_percent=inside(values[:, sides]) if len(values) > 2 * OF_BAND else None,
        steps=float(mean[6]), wall_s=time.perf_counter() - begin,
    )  # fmt: skip


def add(parser: argparse.ArgumentParser) -> None:
    add_directory(parser, "two cases of a tricot with four meshes")
    parser.add_argument("--knit", choices=KNITS, action="append", help="one of the knits; again for more")
    parser.add_argument("--case", choices=list(CASES), action="append", help="one of the cases; again for more")


def main() -> None:
    parser = new_parser(__doc__)
    add(parser)
    given = start_study(parser)
    knits, cases = (KNITS[:1], list(CASES)[:2]) if given.quick else (given.knit or KNITS, given.case or list(CASES))
    rows = []
    for knit in knits:
        for case in cases:
            count = 4 if given.quick else COUNTS.get(case, OF_CASES)
            rows.append(row_of(knit, case, count))
            show_rows(rows[-1:])
            write_rows(table_path(given, "variants.csv"), rows)


if __name__ == "__main__":
    main()
