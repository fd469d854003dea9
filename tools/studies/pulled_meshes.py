"""Spatial metal meshes pulled to break (Fibres & Textiles in Eastern Europe 2023, doi 10.2478/ftee-2023-0015).

    python tools/studies/pulled_meshes.py [DIR] [--quick] [--only MESH] [--case NAME]

One repeat of endless cloth is pulled along the wales (warp) and along the courses (weft), free of tension across, until the axial
stress of a wire reaches its strength or no further level converges. The published inputs are as printed. What was not published
is varied one at a time (CASES): gauge, courses, friction, set of the loops, yield, lapping of the atlas. Prints and writes a row
for each pull (pulled_meshes.csv), its levels (pulled_meshes_levels.csv) and the picture. Nothing is fitted to what was measured
at break.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TypeVar

from pulled_data import CASES, MESHES, Case, Mesh, with_run_in
from pulled_pictures import draw
from strip_bounds import straight_strain, strongest
from strip_pull import WARP, WEFT, Pull, pull
from study import add_directory, new_parser, picture_path, read_rows, show_rows, start_study, table_path, write_rows

from warpknit.base.errors import Diverged
from warpknit.scene import Scene, make_scene

INCH = 25.4e-3  # [m]
STIFF = 100.0  # [N/m] force from which a strip counts as stiff: a twelfth of the mean of what was measured at break
YIELD = 0.75  # of the strength: as for molybdenum in warpknit/scene/materials.py
DIRECTIONS = {"warp": WARP, "weft": WEFT}


@dataclass(frozen=True)
class LevelRow:
    """A row of pulled_meshes_levels.csv, SI."""

    mesh: str
    direction: str
    case: str
    strain: float
    strain_across: float
    force: float
    axial: float
    fibre: float
    active: float


@dataclass(frozen=True)
class Row:
    """A row of pulled_meshes.csv, SI; forces over the width as knitted."""

    mesh: str
    direction: str
    case: str
    wales: float  # an inch
    courses: float
    ending: str
    last_strain: float
    last_across: float
    last_force: float
    last_axial: float
    last_fibre: float
    stiff_strain: float  # from which it carries STIFF
    straight_strain: float
    force_weak: float  # at which the axial stress is the lower strength, from the last level on in proportion
    force_strong: float
    bound_weak: float  # all wires across a line at the lower strength
    bound_strong: float
    measured_strain: float
    measured_force: float
    model: str  # model.kind
    steps: int
    seconds: float


T = TypeVar("T", Row, LevelRow)


def scene_of(mesh: Mesh, spacing: tuple[float, float], case: Case) -> Scene:
    """One repeat, with each bar's loops sized by its published run-in."""
    table = {
        "wire": {
            **mesh.wire, "yield_stress": YIELD * mesh.middle, "tensile_strength": mesh.middle, "plastic": True, "hardening": 0.01,
        },
        "knit": {
            "bars": list(case.bars or mesh.bars),
            "wale_spacing": INCH / spacing[0], "course_spacing": INCH / spacing[1],
        },
        "model": {"kind": "spatial", "boundary": "periodic"},
        "contact": {"friction": 0.2},
        "solver": {"preset": "draft", "max_steps": 8000},
    }  # fmt: skip
    return with_run_in(make_scene(table, list(case.changes.items())), mesh.run_in)


def cases_of(mesh: Mesh) -> Iterator[tuple[Case, tuple[float, float]]]:
    """The cases of a mesh and their spacings, the base first."""
    for name, spacing in mesh.spacings.items():
        yield Case(name), spacing
    for case in CASES:
        if mesh.name in case.only:
            yield case, mesh.spacings["base"]


def row_of(mesh: Mesh, direction: str, case: str, scene: Scene, pulled: Pull, seconds: float) -> Row:
    """The summary of a pull."""
    axis, last, measured = DIRECTIONS[direction], pulled.levels[-1], mesh.measured[direction]
    weak, strong = mesh.strength
    return Row(
        mesh.name, direction, case, INCH / scene.knit.wale_spacing, INCH / scene.knit.course_spacing, pulled.ending,
        last.strain, last.strain_across, last.force, last.axial, last.fibre, pulled.strain_at(STIFF),
        straight_strain(scene, axis), pulled.force_at(weak), pulled.force_at(strong),
        strongest(scene, axis, weak), strongest(scene, axis, strong), measured.strain, measured.force / measured.width,
        scene.model.kind, pulled.steps, seconds,
    )  # fmt: skip


def pulls_of(mesh: Mesh, *, case: str | None = None, quick: bool = False) -> Iterator[tuple[Row, list[LevelRow]]]:
    """Both directions of every case, or of one; quick: of the base, up to fewer steps."""
    wanted = "base" if quick else case
    for each, spacing in cases_of(mesh):
        if wanted not in (None, each.name):
            continue
        scene = scene_of(mesh, spacing, each)
        for direction, axis in DIRECTIONS.items():
            begin = time.process_time()
            end = straight_strain(scene, axis) + 0.05
            try:
                pulled = pull(scene, axis, end, step=0.04, strength=mesh.strength[1], steps=50_000 if quick else 70_000)
            except Diverged as error:
                print(f"{mesh.name} {direction} {each.name}: {error}", flush=True)
                continue
            row = row_of(mesh, direction, each.name, scene, pulled, time.process_time() - begin)
            yield row, [LevelRow(mesh.name, direction, each.name, **asdict(level)) for level in pulled.levels]


def renewed(path: Path, rows: list[T], kind: type[T]) -> list[T]:
    """The rows and earlier ones of other pulls, by meshes and cases."""
    pulls = {(row.mesh, row.direction, row.case) for row in rows}
    kept = [row for row in read_rows(path, kind) if (row.mesh, row.direction, row.case) not in pulls]
    order = [(mesh.name, case.name, direction) for mesh in MESHES for case, _ in cases_of(mesh) for direction in DIRECTIONS]
    known = [row for row in [*kept, *rows] if (row.mesh, row.case, row.direction) in order]
    return sorted(known, key=lambda row: order.index((row.mesh, row.case, row.direction)))


def main() -> int:
    parser = new_parser(__doc__)
    add_directory(parser, quick="the base case of HF-1; under a minute")
    parser.add_argument("--only", choices=[mesh.name for mesh in MESHES], help="renew the rows of this mesh")
    parser.add_argument("--case", help="renew the rows of this case")
    given = start_study(parser)
    of_pulls, of_levels = table_path(given, "pulled_meshes.csv"), table_path(given, "pulled_meshes_levels.csv")
    rows: list[Row] = []
    levels: list[LevelRow] = []
    for mesh in MESHES[:1] if given.quick else MESHES:
        if given.only in (None, mesh.name):
            for row, found in pulls_of(mesh, case=given.case, quick=given.quick):
                rows, levels = renewed(of_pulls, [row], Row), renewed(of_levels, found, LevelRow)
                write_rows(of_pulls, rows)
                write_rows(of_levels, levels)
                pulled = f"{row.mesh} {row.direction} {row.case}: {row.ending} at {row.last_strain:.3f}, {row.last_force:.0f} N/m"
                print(f"{pulled}, {row.seconds:.0f} s", flush=True)
    show_rows(rows)
    draw(picture_path(given, "pulled_meshes.png"), rows, levels, MESHES)
    return 0


if __name__ == "__main__":
    sys.exit(main())
