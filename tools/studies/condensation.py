"""Cost of condensing crossings to planar contacts: planar and spatial knits, level by level.

    python tools/studies/condensation.py levels [--scene FILE] [--strain 0.2] [--levels 10] [--set KEY=VALUE]...     5 min
    python tools/studies/condensation.py causes [DIR] [--draw]                                                       3 min
    python tools/studies/condensation.py tight [DIR]                                                                 2 min

*levels* prints one row a level and model: tension, share of active contacts, sum and largest of the contact forces, largest
stress, node-steps and wall time. A third run shows the planar model with wires that close at one diameter, as spatial wires do,
in place of 1.25.

*causes* switches off each cause, on the cell to 20 % both ways and on a closed tricot to 10 %: the planar model closed at 1.25
and at one diameter, spatial wires, the same with twist made twenty times as stiff (no twist), and with the knit's heights
doubled, so that wires cross over and under each other at twice the angle. It leaves condensation.csv, condensation_clasps.csv
(every clasp of the spatial cell and the width of its lens) and condensation.png; with --draw it draws from the tables.

*tight* says why spatial tight knits hook sooner, in tight_knits.csv. A tricot, whose two bars slide along each other in the
planar model: with wires kept from sliding there, and spatial with contact only in the clasps that carry there. A single atlas,
whose feet turn round the head below in a loop of 9 diameters: spatial as knitted and with all heights doubled and tripled.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from study import (
    SCENES,
    add_directory,
    new_figure,
    picture_path,
    read_rows,
    run_one_of,
    show_rows,
    table_path,
    tidy,
    write_rows,
)

from warpknit import measure
from warpknit.measure import wires_slid
from warpknit.planar.state import State, initial_state
from warpknit.scene import load_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Record, Simulation
from warpknit.spatial.model import SpatialModel, rods_of_wires
from warpknit.spatial.observables import SpatialObservables
from warpknit.spatial.placed_wires import place_wires
from warpknit.spatial.rest_curve import CentreLine
from warpknit.spatial.rods import Rods

SCENE = str(SCENES / "atlas_cell_spatial.toml")

# --- level by level ---------------------------------------------------------------------------------------------------

THIN_BODY = "1 nm"  # closes where wires are a diameter apart


@dataclass(frozen=True)
class Row:
    """One level of one model, SI."""

    model: str
    strain: float
    weft: float
    warp: float
    share: float
    force_sum: float
    force_max: float
    stress: float
    node_steps: float
    wall: float


def planar_rows(name: str, scene: str, overrides: list[str]) -> Iterator[Row]:
    model = build_model(load_scene(scene, [*overrides, "model.kind=planar"]))
    begin = time.perf_counter()
    for record in Simulation(model).run():
        r = record.observables
        force = r.pair_force.reshape(-1, 2).min(axis=1)
        yield Row(
            name,
            float(r.gradient[0, 0] - 1.0),
            *measure.mesh_tension(r),
            measure.contacts(r).active_percent,
            float(force.sum()),
            float(force.max(initial=0.0)),
            measure.stress_extremes(r)[0],
            float(record.steps) * model.panel.node_count,
            time.perf_counter() - begin,
        )


def spatial_rows(scene: str, overrides: list[str]) -> Iterator[Row]:
    relaxation = Simulation(build_model(load_scene(scene, [*overrides, "model.kind=spatial"])))
    begin = time.perf_counter()
    for record in relaxation.run():
        yield record_row("spatial", relaxation, record, time.perf_counter() - begin)


def record_row(name: str, relaxation: Simulation, record: Record, wall: float = float("nan")) -> Row:
    """Row of a spatial record."""
    r = record.observables
    return Row(
        name,
        float(r.gradient[0, 0] - 1.0),
        *measure.mesh_tension(r),
        measure.contacts(r).active_percent,
        float(r.site_force.sum()),
        float(r.site_force.max(initial=0.0)),
        measure.largest_stress(r),
        float(record.steps) * relaxation.model.rods.node_count,
        wall,
    )


def line(r: Row) -> str:
    """One row as text."""
    tension = f"{1e3 * r.weft:10.3f} {1e3 * r.warp:10.3f}"
    contact = f"{r.share:9.1f} {1e6 * r.force_sum:7.1f} {1e6 * r.force_max:11.2f}"
    return f"{r.model:16s} {r.strain:7.3f} {tension} {contact} {1e-6 * r.stress:11.1f} {r.node_steps:11.2e} {r.wall:7.1f}"


# --- causes -----------------------------------------------------------------------------------------------------------

CELL = ["load.strain_weft=0.2", "load.strain_warp=0.2", "output.frames=10"]
TRICOT = [
    'knit.bars=[{chain="1-0/1-2"},{chain="1-2/1-0"}]', "knit.wale_spacing='1 mm'", "knit.course_spacing='0.8 mm'",
    "knit.repeats=[2,1]", "load.strain_weft=0.1", "load.strain_warp=0.1", "output.frames=5",
]  # fmt: skip
PLANAR = ["model.kind=planar", "model.nodes_per_loop=24", "solver.residual_tolerance=3e-3"]
SPATIAL = ["model.nodes_per_loop=48", "solver.residual_tolerance=1e-2"]
STIFF_TWIST, HIGH = 20.0, 2.0
PARTS = 16  # of a segment's curve
SEEN = 6  # segments before and behind a contact, in which its lens is looked for
LEAST = 1e-6  # [N] of a clasp that is looked at


@dataclass(frozen=True)
class KnitRow(Row):
    """One level of one model of one knit."""

    knit: str


@dataclass(frozen=True)
class Clasp:
    """A place where two wires hook, with its lens in plan view; lengths in wire diameters."""

    strain: float
    site: int
    force: float  # [N]
    contacts: int
    width: float  # of the lens where it is widest
    q: float  # (difference of the slopes out of the plane)^2 over (curvature of the width times the diameter), as in the lens
    law: float  # (q + 1/q)/2 below q = 1, else 1


def without_twist(mesh: SpatialModel) -> SpatialModel:
    section = replace(mesh.rods.section, twist_stiffness=STIFF_TWIST * mesh.rods.section.twist_stiffness)
    return replace(mesh, rods=replace(mesh.rods, section=section))


def with_high_crossings(mesh: SpatialModel, height: float = HIGH) -> SpatialModel:
    up, section = np.array([1.0, 1.0, height]), mesh.rods.section
    assert mesh.cloth is not None and mesh.table is not None
    wires = place_wires(mesh.cloth, mesh.table, mesh.panel, section.thickness)
    assert wires.forms is not None
    line = wires.forms.line
    line = CentreLine(line.slope * up, line.between * up, line.step)
    forms = replace(wires.forms, points=tuple(points * up for points in wires.forms.points), line=line)
    wires = replace(wires, forms=forms)
    rods, curve = rods_of_wires(section, mesh.panel, wires)
    return replace(mesh, wires=wires, rods=rods, curve=curve)


def lens_of(relaxation: Simulation, reading: SpatialObservables, site: int) -> Clasp:
    """The lens in which the wires of a site touch: how wide it is, and what the slopes and curvatures in it ask for."""
    touching, d = reading.touching, relaxation.model.rods.section.thickness
    here = np.flatnonzero(reading.touching_site[0] == site)
    k = here[np.argmax(touching.force[here])]
    shift = touching.shift[k].copy()
    shift[:2] = reading.gradient @ shift[:2]
    rods = relaxation.model.rods
    one = curve_about(rods, reading, int(touching.first[k]))
    two = curve_about(rods, reading, int(touching.second[k])) + shift
    apart = np.linalg.norm(one[:, None, :2] - two[None, :, :2], axis=2)
    beside = apart.argmin(axis=1)
    way = np.gradient(two, axis=0)[beside]
    off = one - two[beside]
    width = np.sign(way[:, 0] * off[:, 1] - way[:, 1] * off[:, 0]) * apart.min(axis=1)
    low = high = SEEN * PARTS + round(touching.place[k, 0] * PARTS)
    side = np.sign(width[low])
    while low > 0 and np.sign(width[low - 1]) == side:
        low -= 1
    while high < len(width) - 1 and np.sign(width[high + 1]) == side:
        high += 1
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(one[:, :2], axis=0), axis=1))])
    inner = slice(low + (high - low) // 5, high - (high - low) // 5 + 1)
    curvature = -2.0 * np.polyfit(arc[inner], np.abs(width[inner]), 2)[0]
    slope = np.polyfit(arc[inner], off[inner, 2], 1)[0]
    q = float(slope**2 / (curvature * d))
    return Clasp(
        strain=float(reading.gradient[0, 0] - 1.0),
        site=site,
        force=float(reading.site_force[site]),
        contacts=int((touching.force[here] > 0.0).sum()),
        width=float(np.abs(width[low : high + 1]).max() / d),
        q=q,
        law=0.5 * (q + 1.0 / q) if q < 1.0 else 1.0,
    )


def curve_about(rods: Rods, reading: SpatialObservables, node: int) -> np.ndarray:
    """Points (n, 3) [m] of the curve of a wire about a node, evenly along each segment."""
    segments = [node]
    for _ in range(SEEN):
        segments.insert(0, int(rods.previous[segments[0]]))
        segments.append(int(rods.following[segments[-1]]))
    edges = reading.curve.behind(np.array(segments)).edge
    start = reading.position[node] + np.cumsum(edges, axis=0) - edges - edges[:SEEN].sum(axis=0)
    segment, place = np.repeat(segments, PARTS), np.tile(np.arange(PARTS) / PARTS, len(segments))
    return np.repeat(start, PARTS, axis=0) + reading.curve.offset(segment, place)


def runs() -> Iterator[tuple[KnitRow, list[Clasp]]]:
    """All rows, with the clasps of the spatial cell's rows."""
    for knit, load in (("double atlas", CELL), ("tricot", TRICOT)):
        for name, more in (("planar, 1.25 d", []), ("planar, one d", [f"model.body_radius={THIN_BODY!r}"])):
            for row in planar_rows(name, SCENE, [*load, *PLANAR, *more]):
                yield KnitRow(**vars(row), knit=knit), []
        for name, change in (("spatial", None), ("no twist", without_twist), ("doubled heights", with_high_crossings)):
            if knit == "tricot" and change is with_high_crossings:
                continue
            mesh = build_model(load_scene(SCENE, [*load, *SPATIAL, "model.kind=spatial"]))
            relaxation = Simulation(mesh if change is None else change(mesh))
            for record in relaxation.run():
                sites = np.flatnonzero(record.observables.site_force > LEAST) if knit == "double atlas" and change is None else []
                clasps = [lens_of(relaxation, record.observables, int(site)) for site in sites]
                yield KnitRow(**vars(record_row(name, relaxation, record)), knit=knit), clasps


def draw(path: Path, rows: list[KnitRow], clasps: list[Clasp]) -> None:
    figure, panels = new_figure(10, 4, 1, 2)
    left, right = panels[0]
    cell = [row for row in rows if row.knit == "double atlas"]
    base = {round(r.strain, 4): r.weft for r in cell if r.model == "spatial"}
    for model in ("planar, 1.25 d", "planar, one d", "no twist", "doubled heights"):
        level = [r for r in cell if r.model == model and r.strain > 0.09]
        error = [100 * (r.weft / base[round(r.strain, 4)] - 1) for r in level]
        left.plot([100 * r.strain for r in level], error, marker="o", label=model)
    left.axhline(0.0, color="black", linewidth=1)
    left.set(xlabel="strain, both ways [%]", ylabel="weft tension over spatial one [%]", title="Double atlas cell")
    q = np.linspace(0.25, 3.0, 200)
    right.plot(q, np.where(q < 1, 0.5 * (q + 1 / q), 1.0), color="black", label="(q + 1/q)/2, 1 above q = 1")
    for number, label in ((1, "wires touch once"), (2, "wires touch twice")):
        found = [one for one in clasps if min(one.contacts, 2) == number and one.strain > 0.11 and one.width < 3]
        right.plot([one.q for one in found], [one.width for one in found], "o", label=label)
    right.axhline(1.25, color="grey", linestyle=":", label="planar law")
    right.set(xlabel="q = slope difference$^2$/(curvature d)", ylabel="width of the lens [d]")
    right.set_title("Spatial clasps, 12 to 20 %")
    tidy(panels)
    figure.savefig(path)


# --- tight knits ------------------------------------------------------------------------------------------------------

SINGLE_ATLAS = [
    'knit.bars=[{chain="1-0/1-2/2-3/3-4/3-2/2-1"}]', "wire.material='molybdenum'", "wire.diameter='20 um'",
    "knit.wale_spacing='0.977 mm'", "knit.course_spacing='0.847 mm'", "knit.repeats=[2,1]",
]  # fmt: skip
TIGHT_LEVELS = 4
TIGHT_STRAIN = {"tricot": 0.08, "single atlas": 0.10}
IN_PLANE = ["model.kind=planar", "model.nodes_per_loop=24", "solver.precision=double"]
# wires kept from sliding are not in balance as a whole, and beyond 6 % not within any tolerance
HELD = ["solver.residual_tolerance=2e-2", "load.strain_weft=0.06", "load.strain_warp=0.06", "output.frames=3"]
FAR = 1.0  # [m]
CARRYING = {4, 10}  # clasps of a repeat of the tricot that carry in the planar model


@dataclass(frozen=True)
class TightLevel:
    """One level of one way to compute a knit, SI."""

    knit: str
    model: str
    strain: float
    weft: float
    warp: float
    largest_force: float
    slid: float  # [d] of wires along each other


def tight_in_plane(knit: str, name: str, overrides: list[str], *, may_slide: bool = True) -> Iterator[TightLevel]:
    model = build_model(load_scene(SCENE, overrides))
    state, start = initial_state(model), model.panel.wire_first
    simulation = Simulation(model, state, monitor=lambda _: None if may_slide else hold_wires(state, start))
    for record in simulation.run():
        r = record.observables
        force = r.pair_force.reshape(-1, 2).min(axis=1)
        slid = wires_slid(r.u, start) / model.scene.wire.diameter
        yield TightLevel(knit, name, float(r.gradient[0, 0] - 1.0), *measure.mesh_tension(r), float(force.max(initial=0.0)), slid)


def hold_wires(state: State, start: np.ndarray) -> None:
    """Put wires back that have slid as a whole along the warp."""
    for array in (*(state.node_uy[k] for k in (0, 1)), state.node_vy):
        values = array.numpy()
        count = np.diff(np.append(start, len(values)))
        array.assign(values - np.repeat(np.add.reduceat(values, start) / count, count))


def tight_in_space(
    knit: str, name: str, overrides: list[str], *, only: set[int] | None = None, height: float = 1.0
) -> Iterator[TightLevel]:
    mesh = build_model(load_scene(SCENE, overrides))
    if height != 1.0:
        mesh = with_high_crossings(mesh, height)
    relaxation = Simulation(mesh)
    if only is not None:
        relaxation.mechanics.contact.search = searching_only(relaxation, mesh, only)  # type: ignore[method-assign]
    for record in relaxation.run():
        r = record.observables
        slid = measure.slid(r) / mesh.scene.wire.diameter
        force = float(r.site_force.max(initial=0.0))
        yield TightLevel(knit, name, float(r.gradient[0, 0] - 1.0), *measure.mesh_tension(r), force, slid)


def searching_only(relaxation: Simulation, mesh: SpatialModel, clasps: set[int]) -> Callable[..., None]:
    """A search for contacts with wires far apart outside these clasps of a repeat."""
    contact, search = relaxation.mechanics.contact, relaxation.mechanics.contact.search
    assert mesh.cloth is not None
    of_repeat = len(mesh.cloth.clasps)

    def renew(*rows: Any) -> None:
        search(*rows)
        pairs, count = contact.pairs, contact.pair_count
        shift = pairs.pair_shift.numpy()
        site, _ = relaxation.mechanics.sites.of(
            pairs.pair_first.numpy()[:count], pairs.pair_second.numpy()[:count], shift[:count]
        )
        shift[:count][~np.isin(np.where(site >= 0, site % of_repeat, -1), list(clasps))] = FAR
        pairs.pair_shift.assign(shift)

    return renew


def tight_levels() -> Iterator[TightLevel]:
    for knit, keys in (("tricot", TRICOT), ("single atlas", SINGLE_ATLAS)):
        load = [
            *keys,
            f"load.strain_weft={TIGHT_STRAIN[knit]}",
            f"load.strain_warp={TIGHT_STRAIN[knit]}",
            f"output.frames={TIGHT_LEVELS}",
        ]
        space = [*load, *SPATIAL, "model.kind=spatial"]
        yield from tight_in_plane(knit, "plane", [*load, *IN_PLANE, "solver.residual_tolerance=3e-3"])
        if knit == "tricot":
            yield from tight_in_plane(knit, "plane, no sliding", [*load, *IN_PLANE, *HELD], may_slide=False)
            yield from tight_in_space(knit, "space, the plane's clasps", space, only=CARRYING)
        yield from tight_in_space(knit, "space", space)
        if knit == "single atlas":
            for height in (2.0, 3.0):
                yield from tight_in_space(knit, f"space, heights x {height:g}", space, height=height)


# --- command line -----------------------------------------------------------------------------------------------------


def study_levels(given: argparse.Namespace) -> None:
    load = [f"load.strain_weft={given.strain}", f"load.strain_warp={given.strain}", f"output.frames={given.levels}"]
    overrides = [*load, *given.overrides]
    planar = [o for o in overrides if not o.startswith("model.nodes_per_loop")]
    print("model             strain  weft mN/m  warp mN/m  active %  sum uN  largest uN  stress MPa  node-steps  wall s")
    for rows in (
        planar_rows("planar", given.scene, planar),
        planar_rows("planar, one d", given.scene, [*planar, f"model.body_radius={THIN_BODY!r}"]),
        spatial_rows(given.scene, overrides),
    ):
        for r in rows:
            if r.strain > 0.0:
                print(line(r), flush=True)


def study_causes(given: argparse.Namespace) -> None:
    tables = table_path(given, "condensation.csv"), table_path(given, "condensation_clasps.csv")
    if not given.draw:
        rows, clasps = [], []
        for row, found in runs():
            if row.strain > 0.0:
                rows.append(row)
                clasps += found
                print(row, flush=True)
        write_rows(tables[0], rows)
        write_rows(tables[1], clasps)
    rows, clasps = read_rows(tables[0], KnitRow), read_rows(tables[1], Clasp)
    show_rows(clasps)
    draw(picture_path(given, "condensation.png"), rows, clasps)


def study_tight(given: argparse.Namespace) -> None:
    rows = [level for level in tight_levels() if level.strain > 0.0]
    write_rows(table_path(given, "tight_knits.csv"), rows)
    show_rows(rows)


def add_options(name: str, parser: argparse.ArgumentParser) -> None:
    if name == "levels":
        parser.add_argument("--scene", default=SCENE)
        parser.add_argument("--strain", type=float, default=0.2)
        parser.add_argument("--levels", type=int, default=10)
        parser.add_argument("--set", dest="overrides", action="append", default=[], metavar="KEY=VALUE")
    else:
        add_directory(parser)
    if name == "causes":
        parser.add_argument("--draw", action="store_true", help="draw from the tables, without running anything")


if __name__ == "__main__":
    sys.exit(run_one_of(__doc__, {"levels": study_levels, "causes": study_causes, "tight": study_tight}, add_options))
