"""Metal meshes pulled to break (Fibres & Textiles in Eastern Europe 2023, doi 10.2478/ftee-2023-0015), in space.

    python tools/studies/pulled_meshes.py [DIR] [--quick] [--only MESH]

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
from dataclasses import asdict, dataclass, field
from typing import Any

from pulled_pictures import draw
from strip_bounds import straight_strain, strongest
from strip_pull import WARP, WEFT, Pull, pull
from study import add_directory, new_parser, picture_path, show_rows, table_path, write_rows

from warpknit.design.inputs import fit_run_in, fitted_overrides
from warpknit.device import start_warp
from warpknit.scene import Scene, make_scene

INCH, RACK = 25.4e-3, 480  # [m]; courses
STIFF = 100.0  # [N/m] force from which a strip counts as stiff: a twelfth of the mean of what was measured at break
YIELD = 0.75  # of the strength: as for molybdenum in warpknit/scene/materials.py
DIRECTIONS = {"warp": WARP, "weft": WEFT}

REVERSE_LOCKNIT = ({"chain": "2-3/1-0"}, {"chain": "1-0/1-2"})  # bar 2 of the paper lies at the back
ATLAS = ({"chain": "1-0/1-2/2-3/2-1"}, {"chain": "2-3/2-1/1-0/1-2"})
OPEN_TRICOT = ({"chain": "0-1/2-1"}, {"chain": "2-1/0-1"})


@dataclass(frozen=True)
class Measured:
    """Force and elongation at break of a strip, mean and coefficient of variation of the samples."""

    width: float  # [m]
    force: float  # [N]
    force_cv: float
    strain: float
    strain_cv: float


@dataclass(frozen=True)
class Mesh:
    """What was published of a mesh, and the spacings of its cases."""

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
# of HF-1 and HF-2, for 24, 26 and 28 wales, courses at which the loops of both bars can take their run-in
MESHES = (
    Mesh(
        "HF-1", REVERSE_LOCKNIT, MOLYBDENUM | {"diameter": "17 um", "ends": 4}, OF_MOLYBDENUM,
        {"base": (26, 28), "24 wales": (24, 31), "28 wales": (28, 26)},
        {"warp": Measured(25e-3, 36.16, 0.07, 0.452, 0.03), "weft": Measured(15e-3, 29.01, 0.08, 1.068, 0.02)},
        (2.370, 2.220),
    ),
    Mesh(
        "HF-2", REVERSE_LOCKNIT, MOLYBDENUM | {"diameter": "16 um", "ends": 4}, OF_MOLYBDENUM,
        {"base": (26, 25), "24 wales": (24, 28), "28 wales": (28, 23)},
        {"warp": Measured(25e-3, 30.40, 0.11, 0.444, 0.02), "weft": Measured(20e-3, 25.93, 0.02, 1.261, 0.03)},
        (2.690, 2.220),
    ),
    Mesh(
        "LF-2", ATLAS, MOLYBDENUM | {"diameter": "27 um", "ends": 3}, OF_MOLYBDENUM,
        {"base": (26, 30), "25 courses": (26, 25), "40 courses": (26, 40)},
        {"warp": Measured(45e-3, 29.30, 0.07, 0.522, 0.08), "weft": Measured(40e-3, 23.68, 0.03, 0.726, 0.12)},
    ),
    Mesh(
        "LF-1", ATLAS, STEEL | {"diameter": "30 um", "ends": 3}, OF_STEEL,
        {"base": (26, 30), "25 courses": (26, 25), "40 courses": (26, 40)},
        {"warp": Measured(30e-3, 23.14, 0.15, 0.357, 0.19), "weft": Measured(48e-3, 17.79, 0.08, 0.961, 0.06)},
    ),
)  # fmt: skip


@dataclass(frozen=True)
class Case:
    """One choice of what was not published."""

    name: str
    changes: dict[str, Any] = field(default_factory=dict)  # of the scene, dotted
    bars: tuple[dict[str, str], ...] | None = None
    only: tuple[str, ...] = ("HF-1", "LF-2")  # meshes


CASES = (
    Case("elastic", {"wire.plastic": False}),
    Case("no friction", {"contact.friction": 0.0}),
    Case("half set", {"wire.set_fraction": 0.5}),
    Case("hardening 0.1", {"wire.hardening": 0.1}, only=("HF-1",)),
    Case("40 nodes", {"model.nodes_per_loop": 40}, only=("HF-1",)),
    Case("open tricot", bars=OPEN_TRICOT, only=("LF-2",)),
)


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
    model: str  # that model.kind = "auto" takes
    steps: int
    seconds: float


def scene_of(mesh: Mesh, spacing: tuple[float, float], case: Case) -> Scene:
    """One repeat, with the loops of each bar fitted to its run-in where that was published."""
    table = {
        "wire": {
            **mesh.wire, "yield_stress": YIELD * mesh.middle, "tensile_strength": mesh.middle, "plastic": True, "hardening": 0.01,
        },
        "knit": {
            "bars": list(case.bars or mesh.bars), "wale_spacing": INCH / spacing[0], "course_spacing": INCH / spacing[1],
        },
        "model": {"kind": "spatial", "boundary": "periodic"},
        "contact": {"friction": 0.2},
        "solver": {"preset": "draft", "max_steps": 8000},
    }  # fmt: skip
    scene = make_scene(table, list(case.changes.items()))
    if mesh.run_in is not None:
        fitted = fit_run_in(scene, tuple(length / RACK for length in mesh.run_in)).scene
        scene = scene.changed(fitted_overrides(fitted.knit))
    return scene


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
        scene.changed({"model.kind": "auto"}).model.kind, pulled.steps, seconds,
    )  # fmt: skip


def pulls_of(mesh: Mesh, *, quick: bool = False) -> Iterator[tuple[Row, list[LevelRow]]]:
    """Both directions of every case; quick: of the base, up to fewer steps."""
    for case, spacing in list(cases_of(mesh))[: 1 if quick else None]:
        scene = scene_of(mesh, spacing, case)
        for direction, axis in DIRECTIONS.items():
            begin = time.process_time()
            end = straight_strain(scene, axis) + 0.05
            pulled = pull(scene, axis, end, step=0.04, strength=mesh.strength[1], steps=50_000 if quick else 100_000)
            row = row_of(mesh, direction, case.name, scene, pulled, time.process_time() - begin)
            yield row, [LevelRow(mesh.name, direction, case.name, **asdict(level)) for level in pulled.levels]


def main() -> int:
    parser = new_parser(__doc__)
    add_directory(parser, quick="the base case of HF-1; under a minute")
    parser.add_argument("--only", choices=[mesh.name for mesh in MESHES], help="this mesh")
    given = parser.parse_args()
    start_warp()
    rows: list[Row] = []
    levels: list[LevelRow] = []
    for mesh in MESHES[:1] if given.quick else MESHES:
        if given.only in (None, mesh.name):
            for row, found in pulls_of(mesh, quick=given.quick):
                rows.append(row)
                levels += found
                pulled = f"{row.mesh} {row.direction} {row.case}: {row.ending} at {row.last_strain:.3f}, {row.last_force:.0f} N/m"
                print(f"{pulled}, {row.seconds:.0f} s", flush=True)
    show_rows(rows)
    write_rows(table_path(given, "pulled_meshes.csv"), rows)
    write_rows(table_path(given, "pulled_meshes_levels.csv"), levels)
    draw(picture_path(given, "pulled_meshes.png"), rows, levels, MESHES)
    return 0


if __name__ == "__main__":
    sys.exit(main())
