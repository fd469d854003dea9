"""Why wires condensed into the plane differ from wires in space: each cause switched off, and the width of every hooked lens.

    python tools/condensation_causes.py [--draw]

Writes tools/results/condensation.csv and condensation_clasps.csv in about 3 min of a core, draws docs/images/condensation.png;
with --draw from the tables. On the cell to 20 % both ways, and on a closed tricot to 10 %: the planar model closed at 1.25 and at
one diameter, wires in space, the same with twist made twenty times as stiff (no twist), and with the knit's heights doubled, so
that wires cross over and under each other at twice the angle. Clasps are those of the cell in space.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from condensation_study import SCENES, THIN_BODY, Row, planar_rows, record_row
from study import new_figure, read_rows, show_rows, tidy, write_rows

from warpknit.scene import load_scene
from warpknit.spatial.mesh import SpatialMesh, build_mesh, rods_of_wires
from warpknit.spatial.observables import SpatialObservables
from warpknit.spatial.relax import SpatialRelaxation
from warpknit.spatial.rest_curve import CentreLine, fit_rest_curve

RESULTS = Path(__file__).parent / "results"
PICTURE = Path(__file__).parent.parent / "docs" / "images" / "condensation.png"
SCENE = str(SCENES / "atlas_cell_spatial.toml")
CELL = ["load.strain_weft=0.2", "load.strain_warp=0.2", "output.frames=10"]
TRICOT = [
    'knit.bars=[{chain="1-0/1-2"},{chain="1-2/1-0"}]', "knit.wale_spacing='1 mm'", "knit.course_spacing='0.8 mm'",
    "knit.repeats=[2,1]", "load.strain_weft=0.1", "load.strain_warp=0.1", "output.frames=5",
]  # fmt: skip
PLANAR = ["model.nodes_per_loop=24", "solver.residual_tolerance=3e-3"]
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
    """A place where two wires hook, in space: the lens that they bound in plan view, lengths in diameters of the wire."""

    strain: float
    site: int
    force: float  # [N]
    contacts: int
    width: float  # of the lens where it is widest
    q: float  # (difference of the slopes out of the plane)^2 over (curvature of the width times the diameter), as in the lens
    law: float  # (q + 1/q)/2 below q = 1, else 1


def without_twist(mesh: SpatialMesh) -> SpatialMesh:
    section = replace(mesh.rods.section, twist_stiffness=STIFF_TWIST * mesh.rods.section.twist_stiffness)
    return replace(mesh, rods=replace(mesh.rods, section=section))


def with_high_crossings(mesh: SpatialMesh, height: float = HIGH) -> SpatialMesh:
    up, wires = np.array([1.0, 1.0, height]), mesh.wires
    assert wires.line is not None
    line = CentreLine(wires.line.slope * up, wires.line.between * up)
    wires = replace(wires, points=tuple(points * up for points in wires.points), line=line)
    rods = rods_of_wires(mesh.rods.section, mesh.panel, wires)
    return replace(mesh, wires=wires, rods=rods, curve=fit_rest_curve(rods, line))


def lens_of(relaxation: SpatialRelaxation, reading: SpatialObservables, site: int) -> Clasp:
    """The lens in which the wires of a site touch: how wide it is, and what the slopes and curvatures in it ask for."""
    touching, d = reading.touching, relaxation.mesh.rods.section.thickness
    here = np.flatnonzero(reading.touching_site[0] == site)
    k = here[np.argmax(touching.force[here])]
    shift = touching.shift[k].copy()
    shift[:2] = reading.gradient @ shift[:2]
    one = curve_about(relaxation, int(touching.first[k]))
    two = curve_about(relaxation, int(touching.second[k])) + shift
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


def curve_about(relaxation: SpatialRelaxation, node: int) -> np.ndarray:
    """Points (n, 3) [m] of the curve of a wire (kernels/wire_curve.py) about a node, evenly along each segment."""
    state, rods, curve = relaxation.stepper.state, relaxation.mesh.rods, relaxation.mesh.curve
    tangent, first = state.tangent.numpy(), state.director.numpy()
    second, edge = np.cross(tangent, first), state.length.numpy()[:, None] * tangent
    before, after = rods.previous, rods.following
    rise = curve.slope[:, :1] * (first[before] + first) + curve.slope[:, 1:] * (second[before] + second)
    slope = 0.5 * (edge[before] + edge + rise)
    s = np.arange(PARTS)[:, None] / PARTS
    begin = node
    start = state.position.numpy()[node].copy()
    for _ in range(SEEN):
        begin = before[begin]
        start -= edge[begin]
    points = []
    for _ in range(2 * SEEN + 1):
        b = curve.bump[begin]
        bump = (b[0] + s * b[2]) * first[begin] + (b[1] + s * b[3]) * second[begin]
        smooth = s * (1 - s) ** 2 * slope[begin] + s * s * (3 - 2 * s) * edge[begin] + s * s * (s - 1) * slope[after[begin]]
        points.append(start + smooth + (s * (1 - s)) ** 2 * bump)
        start = start + edge[begin]
        begin = after[begin]
    return np.concatenate(points)


def runs() -> Iterator[tuple[KnitRow, list[Clasp]]]:
    """All rows, with the clasps of those of the cell in space."""
    for knit, load in (("double atlas", CELL), ("tricot", TRICOT)):
        for name, more in (("planar, 1.25 d", []), ("planar, one d", [f"model.body_radius={THIN_BODY!r}"])):
            for row in planar_rows(name, SCENE, [*load, *PLANAR, *more]):
                yield KnitRow(**vars(row), knit=knit), []
        for name, change in (("spatial", None), ("no twist", without_twist), ("doubled heights", with_high_crossings)):
            if knit == "tricot" and change is with_high_crossings:
                continue
            mesh = build_mesh(load_scene(SCENE, [*load, *SPATIAL, "model.kind=spatial"]))
            relaxation = SpatialRelaxation(mesh if change is None else change(mesh))
            for record in relaxation.run():
                sites = np.flatnonzero(record.observables.site_force > LEAST) if knit == "double atlas" and change is None else []
                clasps = [lens_of(relaxation, record.observables, int(site)) for site in sites]
                yield KnitRow(**vars(record_row(name, relaxation, record)), knit=knit), clasps


def draw(rows: list[KnitRow], clasps: list[Clasp]) -> None:
    figure, panels = new_figure(10, 4, 1, 2)
    left, right = panels[0]
    cell = [row for row in rows if row.knit == "double atlas"]
    base = {round(r.strain, 4): r.weft for r in cell if r.model == "spatial"}
    for model in ("planar, 1.25 d", "planar, one d", "no twist", "doubled heights"):
        level = [r for r in cell if r.model == model and r.strain > 0.09]
        error = [100 * (r.weft / base[round(r.strain, 4)] - 1) for r in level]
        left.plot([100 * r.strain for r in level], error, marker="o", label=model)
    left.axhline(0.0, color="black", linewidth=1)
    left.set(xlabel="strain, both ways [%]", ylabel="weft tension over that in space [%]", title="Double atlas cell")
    q = np.linspace(0.25, 3.0, 200)
    right.plot(q, np.where(q < 1, 0.5 * (q + 1 / q), 1.0), color="black", label="(q + 1/q)/2, 1 above q = 1")
    for number, label in ((1, "wires touch once"), (2, "wires touch twice")):
        found = [one for one in clasps if min(one.contacts, 2) == number and one.strain > 0.11 and one.width < 3]
        right.plot([one.q for one in found], [one.width for one in found], "o", label=label)
    right.axhline(1.25, color="grey", linestyle=":", label="planar law")
    right.set(xlabel="q = slope difference$^2$/(curvature d)", ylabel="width of the lens [d]")
    right.set_title("Clasps in space, 12 to 20 %")
    tidy(panels)
    figure.savefig(PICTURE)


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draw", action="store_true", help="draw from the tables, without running anything")
    given = parser.parse_args(arguments)
    tables = RESULTS / "condensation.csv", RESULTS / "condensation_clasps.csv"
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
    draw(rows, clasps)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
