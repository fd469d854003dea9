"""Answers of four knits against the friction of their wires.

    python tools/studies/friction.py [DIR]      an hour; --quick 3 min

One repeat of each knit as `warpknit new` has it (30 um molybdenum, 26 wales and 30 courses an inch; the open double atlas 15 and
25), standard preset; means over 16 meshes whose loops scatter by 2 %, side by side. They are strained by 6 % both ways (the
double atlas by 10 %), and pulled by 1 N/m both ways, in six levels each.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from study import (
    COLOURS,
    add_directory,
    new_figure,
    new_parser,
    picture_path,
    show_rows,
    start_study,
    table_path,
    tidy,
    write_rows,
)

from warpknit import Simulation, build_model, measure
from warpknit.knit.named import named_knit
from warpknit.scene import Scene, make_scene
from warpknit.solve.simulate import Record

KNITS = ("tricot", "reverse-locknit", "atlas", "double-atlas")
FRICTIONS = (0.0, 0.1, 0.2, 0.4)
SEEDS = 16
LOADS = ("strain", "tension")


@dataclass(frozen=True)
class Row:
    """Means and standard deviations of the meshes of one knit, load and friction, SI."""

    knit: str
    load: str  # strain, or tension
    friction: float
    meshes: int  # of those that converged
    strain_weft: float
    strain_warp: float
    tension_weft_N_per_m: float
    tension_warp_N_per_m: float
    active_percent: float
    stress_max_Pa: float
    strain_weft_std: float
    strain_warp_std: float
    tension_weft_N_per_m_std: float
    tension_warp_N_per_m_std: float
    active_percent_std: float
    stress_max_Pa_std: float
    steps: float  # of a mesh
    wall_s: float  # of all meshes


def scene_of(knit: str, load: str, friction: float, seed: int, preset: str) -> Scene:
    named = named_knit(knit)
    bars = [{"chain": bar.chain, "threading": bar.threading, "shift": bar.shift} for bar in named.bars]
    knitted = {"bars": bars, "wales": f"{named.wales} /inch", "courses": f"{named.courses} /inch", "repeats": [1, 1]}
    value = 0.01 * named.strain if load == "strain" else 1.0
    return make_scene({
        "wire": {"material": "molybdenum", "diameter": "30 um"},
        "knit": knitted | {"scatter": 0.02, "seed": seed},
        "model": {"kind": "spatial", "boundary": "periodic"},
        "contact": {"friction": friction},
        "load": {f"{load}_weft": value, f"{load}_warp": value},
        "solver": {"preset": preset},
        "output": {"frames": 6},
    })  # fmt: skip


def values_of(record: Record) -> list[float]:
    r = record.observables
    strain, tension = np.diag(r.stretch) - 1.0, measure.mesh_tension(r)
    return [*strain, *tension, measure.contacts(r).active_percent, measure.largest_stress(r), record.steps]


def row_of(knit: str, load: str, friction: float, seeds: int, preset: str) -> Row:
    begin = time.perf_counter()
    scenes = [scene_of(knit, load, friction, seed, preset) for seed in range(seeds)]
    records = Simulation(build_model(scenes[0]), worlds=scenes).run()
    found = np.array([values_of(record) for record in records if record.load_factor == 1.0])
    mean, deviation = found.mean(axis=0).tolist(), found.std(axis=0, ddof=1).tolist()
    wall = time.perf_counter() - begin
    return Row(knit, load, friction, len(found), *mean[:6], *deviation[:6], steps=mean[6], wall_s=wall)


def draw(rows: list[Row], path: Path) -> None:
    """Tension at 6 %, strain and active contacts under 1 N/m, each against friction."""
    figure, panels = new_figure(11.0, 3.8, 1, 3)
    shown = (
        ("strain", lambda r: 0.5 * (r.tension_weft_N_per_m + r.tension_warp_N_per_m),
         lambda r: 0.5 * (r.tension_weft_N_per_m_std + r.tension_warp_N_per_m_std), "mean tension at 6 % (10 %) [N/m]"),
        ("tension", lambda r: 50.0 * (r.strain_weft + r.strain_warp),
         lambda r: 50.0 * (r.strain_weft_std + r.strain_warp_std), "mean strain under 1 N/m [%]"),
        ("tension", lambda r: r.active_percent, lambda r: r.active_percent_std, "active contacts under 1 N/m [%]"),
    )  # fmt: skip
    for axes, (load, value, deviation, label) in zip(panels[0], shown, strict=True):
        for knit, colour in zip(KNITS, COLOURS, strict=False):
            own = [row for row in rows if row.knit == knit and row.load == load]
            error = [deviation(row) / np.sqrt(row.meshes) for row in own]
            axes.errorbar([row.friction for row in own], [value(row) for row in own], error, color=colour, label=knit, capsize=3)
        axes.set(xlabel="friction coefficient", ylabel=label, ylim=(0.0, None))
    tidy(panels)
    figure.savefig(path)


def main() -> None:
    parser = new_parser(__doc__)
    add_directory(parser, "draft preset, two meshes, frictions 0 and 0.2")
    given = start_study(parser)
    frictions, seeds, preset = ((0.0, 0.2), 2, "draft") if given.quick else (FRICTIONS, SEEDS, "standard")
    rows = []
    for knit in KNITS:
        for load in LOADS:
            for friction in frictions:
                rows.append(row_of(knit, load, friction, seeds, preset))
                show_rows(rows[-1:])
    write_rows(table_path(given, "friction.csv"), rows)
    draw(rows, picture_path(given, "friction.png"))


if __name__ == "__main__":
    main()
