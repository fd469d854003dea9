"""The central rhombus: 12 bodies, 24 pairs, against the size of the panel, the nodes of the wire, body mass and loading time.

    python tools/studies/rhombus.py [DIR] [--quick] [--fine]

Panels are gripped, N x N repeats of scenes/atlas_patch.toml; nodes, mass and time are of the periodic cell of
scenes/atlas_cell.toml, which has the same rhombus without a rim. A primary portion (a circular loop and an oval loop along
the warp) is two loops, so its nodes are twice `model.nodes_per_loop`. Prints a table and leaves rhombus.csv and
rhombus.png.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree
from study import (
    COLOURS,
    add_directory,
    new_figure,
    new_parser,
    picture_path,
    run_model,
    scene_of,
    show_rows,
    table_path,
    tidy,
    write_rows,
)

from warpknit import measure
from warpknit.compute.device import start_warp
from warpknit.planar.observables import PlanarObservables
from warpknit.scene import Scene
from warpknit.solve.model import build_model

CELL, PATCH = "atlas_cell.toml", "atlas_patch.toml"
SIZES = (3, 5, 7, 9, 13, 19, 27)
STRAINS = (0.1, 0.14)
PORTIONS = (24, 32, 50, 100, 200, 400)
MASSES = (0.01, 0.1, 0.5, 1.0)
TIMES = ("1 ms", "3 ms", "10 ms", "30 ms")
SLOWLY = 'solver.loading_time="300 ms"'
LOADED = 0.14  # strain both ways at which nodes, mass and time are compared: all contacts of the first two kinds are closed


@dataclass(frozen=True)
class Row:
    """A row of rhombus.csv."""

    varied: str
    value: str
    strain: float  # both ways, of the boundary
    bodies: int
    pairs: int
    active_percent: float
    force_mean_N: float  # of the active pairs of the rhombus
    force_max_N: float
    local_weft: float  # strain of the rhombus itself
    local_warp: float
    kinetic_to_internal: float  # largest of the recorded states past a tenth of the load
    force_error_on_the_way: float  # largest of the mean force while loading, over its value at the end; ramps only
    steps: int
    wall_s: float


def rhombus_forces(r: PlanarObservables) -> np.ndarray:
    """[N] of the pairs of the central rhombus."""
    bodies = r.model.panel.rhombus_bodies
    return r.pair_force.reshape(-1, 2)[bodies].ravel()


def local_strain(r: PlanarObservables) -> tuple[float, float]:
    """Strain in weft and warp of the mesh round the rhombus: by which bodies a repeat to either side of its own have parted."""
    panel, knit = r.model.panel, r.model.scene.knit
    if r.model.scene.model.boundary == "periodic":
        return float(r.gradient[0, 0] - 1.0), float(r.gradient[1, 1] - 1.0)
    place_at_rest = panel.body_rest + panel.body_origin
    now = place_at_rest @ r.gradient.T + r.body_u
    tree = cKDTree(place_at_rest)
    strain = []
    for axis in (0, 1):
        step = np.zeros(2)
        step[axis] = knit.repeat[axis]
        rest = place_at_rest[panel.rhombus_bodies]
        away, place = tree.query(np.stack([rest - step, rest + step]))
        both = np.all(away < 1e-3 * knit.repeat[axis], axis=0)
        apart = now[place[1, both], axis] - now[place[0, both], axis]
        strain.append(float(apart.mean() / (2.0 * step[axis]) - 1.0) if both.any() else math.nan)
    return strain[0], strain[1]


def rows_of(varied: str, value: str, scene: Scene, strains: tuple[float, ...], curve: Curve | None = None) -> list[Row]:
    """One run, read at its last state at each of `strains`; `curve` is what forces on the way are compared with."""
    model = build_model(scene)
    begin = time.perf_counter()
    rows: dict[int, Row] = {}
    kinetic, behind = 0.0, math.nan
    for record in run_model(model):
        r = record.observables
        energies = r.energies
        if record.load_factor > 0.1 and energies.stored > 0.0:
            kinetic = max(kinetic, energies.kinetic / energies.stored)
        strain = float(r.gradient[0, 0] - 1.0)
        force = rhombus_forces(r)
        if curve is not None:
            behind = max(0.0 if np.isnan(behind) else behind, abs(force.sum() - curve.at(strain)) / curve.at(LOADED))
        near = np.flatnonzero(np.isclose(strain, strains, atol=1e-6))
        if not len(near):
            continue
        active = measure.pair_active(r).reshape(-1, 2)[model.panel.rhombus_bodies].ravel()
        count = measure.contacts(r, model.panel.rhombus_bodies)
        rows[int(near[0])] = Row(
            varied, value, strain, count.bodies, count.pairs, count.active_percent,
            float(force[active].mean()) if active.any() else 0.0, float(force.max()), *local_strain(r), kinetic, behind,
            record.steps, time.perf_counter() - begin,
        )  # fmt: skip
    return list(rows.values())


@dataclass(frozen=True)
class Curve:
    """Sum of the contact forces of the rhombus against strain both ways."""

    strain: list[float]
    force: list[float]

    def at(self, strain: float) -> float:
        return float(np.interp(strain, self.strain, self.force))


def curve_of(*overrides: str) -> Curve:
    scene = both_ways(CELL, LOADED, 28, *overrides)
    records = list(run_model(build_model(scene)))
    return Curve(
        [float(r.observables.gradient[0, 0] - 1.0) for r in records], [rhombus_forces(r.observables).sum() for r in records]
    )


def both_ways(file: str, strain: float, frames: int, *overrides: str) -> Scene:
    return scene_of(file, *overrides, load={"strain_weft": strain, "strain_warp": strain}, output={"frames": frames})


# --- what is varied ---------------------------------------------------------------------------------------------------


def sizes(repeats: Sequence[int]) -> list[Row]:
    """Gripped panels of N x N repeats, then endless cloth, at 10 % and 14 %."""
    rows = []
    for n in repeats:
        scene = both_ways(PATCH, STRAINS[-1], 7, "solver.preset=draft", f"knit.repeats=[{n}, {n}]")
        rows += rows_of("panel, repeats a side", str(n), scene, STRAINS)
    scene = both_ways(CELL, STRAINS[-1], 7, "solver.preset=draft")
    return rows + rows_of("panel, repeats a side", "endless", scene, STRAINS)


def nodes(portions: Sequence[int]) -> list[Row]:
    """Nodes a primary portion, of the periodic cell; softened so that bending sets the step, in double precision."""
    rows = []
    for portion in portions:
        fine = [f"model.nodes_per_loop={portion // 2}", "solver.precision=double", "solver.residual_tolerance=2e-3"]
        fine += ["solver.max_steps=20_000_000"]
        rows += rows_of("nodes a primary portion", str(portion), both_ways(CELL, LOADED, 2, *fine), (LOADED,))
    return rows


def masses_and_times(masses: Sequence[float], times: Sequence[str]) -> list[Row]:
    """Ramps in real time at the draft preset, against a nearly static one."""
    kept = ["solver.preset=draft", "solver.precision=double", "solver.drive=ramp"]
    curve = curve_of(*kept, SLOWLY)
    rows = []
    for name, values, key in (("body mass", masses, "contact.body_mass"), ("loading time", times, "solver.loading_time")):
        for value in values:
            given = f'{key}="{value}"' if isinstance(value, str) else f"{key}={value}"
            scene = both_ways(CELL, LOADED, 20, *kept, given)
            rows += rows_of(name, str(value), scene, (LOADED,), curve)
    return rows


# --- output -----------------------------------------------------------------------------------------------------------


def draw(path: Path, rows: list[Row]) -> None:
    figure, panels = new_figure(15.0, 4.0, 1, 4)
    for colour, strain in zip(COLOURS, STRAINS, strict=False):
        of_size = [r for r in rows if r.varied.startswith("panel") and math.isclose(r.strain, strain, abs_tol=1e-6)]
        *panel, endless = of_size
        n = [int(r.value) for r in panel]
        label = f"{100 * strain:.0f} % both ways"
        panels[0, 0].plot(n, [1e6 * r.force_mean_N for r in panel], color=colour, marker="o", markersize=4, label=label)
        panels[0, 0].axhline(1e6 * endless.force_mean_N, color=colour, linestyle=":", label=f"endless cloth, {label}")
        for side, style in (("weft", "-"), ("warp", "--")):
            local = [100 * getattr(r, f"local_{side}") for r in panel]
            panels[0, 1].plot(n, local, style, color=colour, marker="o", markersize=4, label=f"{side}, {label}")
        panels[0, 1].axhline(100 * strain, color=colour, linestyle=":")
    panels[0, 0].set(
        xlabel="repeats a side", ylabel="mean force of active contacts [µN]", xscale="log", yscale="log", ylim=(8, 300)
    )
    panels[0, 1].set(xlabel="repeats a side", ylabel="strain round the rhombus [%]", xscale="log")
    for axes in panels[0, :2]:
        axes.set_xticks([3, 5, 9, 19, 27], ["3", "5", "9", "19", "27"], minor=False)
        axes.minorticks_off()
    way = "largest error of forces on the way [%]"
    for axes, name, xlabel in (
        (panels[0, 2], "body mass", "body mass over half a loop [-]"),
        (panels[0, 3], "loading time", "loading time [ms]"),
    ):
        of_kind = [r for r in rows if r.varied == name]
        value = [float(r.value.removesuffix(" ms")) for r in of_kind]
        axes.plot(value, [100 * r.force_error_on_the_way for r in of_kind], color=COLOURS[2], marker="o", markersize=4)
        axes.set(xlabel=xlabel, ylabel=way, xscale="log", yscale="log", ylim=(0.3, 200.0))
    tidy(panels)
    panels[0, 0].legend(frameon=False, fontsize=8, loc="center right", bbox_to_anchor=(1.0, 0.62))  # between the curves
    figure.savefig(path)


def main() -> int:
    parser = new_parser(__doc__)
    add_directory(parser, quick="fewer and smaller cases")
    parser.add_argument("--fine", action="store_true", help="800 nodes a primary portion too, five minutes more")
    given = parser.parse_args()
    start_warp()
    rows = sizes(SIZES[:3] if given.quick else SIZES)
    show_rows(rows)
    of_nodes = nodes(PORTIONS[:2] if given.quick else (*PORTIONS, *((800,) if given.fine else ())))
    show_rows(of_nodes)
    of_time = masses_and_times(MASSES[-2:] if given.quick else MASSES, TIMES[:1] if given.quick else TIMES)
    show_rows(of_time)
    rows += of_nodes + of_time
    write_rows(table_path(given, "rhombus.csv"), rows)
    draw(picture_path(given, "rhombus.png"), rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
