"""The optimum tension of a mesh for the wires in use: the tensile load with the most active contacts while no wire passes the
elastic limit.

    python tools/studies/optimum_tension.py [SCENE] [--out DIR] [--set KEY=VALUE]...       default: scenes/contact_map.toml

Makes the contact map of SCENE for tungsten and for gold-plated molybdenum of 15, 17, 27 and 30 um, each in DIR/<wire>, and prints
a line a wire as comma separated values, which are left in DIR/optimum.csv too: strains, tensions, share of active contacts,
largest stress and what it leaves of the elastic limit.
"""

from __future__ import annotations

import csv
import io
import sys
from pathlib import Path

from study import SCENES, new_parser

from warpknit.base.files import write_aside
from warpknit.scene import load_scene
from warpknit.studies.sweep import run_map

MATERIALS = {
    "tungsten": ["wire.material=tungsten"],
    "gold-plated molybdenum": [
        "wire.material=molybdenum",
        'wire.plating={material="gold", thickness="0.2 um"}',
    ],
}
DIAMETERS = (15, 17, 27, 30)  # [um]
COLUMNS = ("wire", "diameter_um", "yield_stress_Pa", "strain_weft", "strain_warp", "tension_weft_N_per_m",
           "tension_warp_N_per_m", "active_percent", "stress_max_Pa", "stress_margin", "cells_below_limit", "wall_s")  # fmt: skip


def main() -> None:
    parser = new_parser(__doc__)
    parser.add_argument("scene", nargs="?", default=SCENES / "contact_map.toml")
    parser.add_argument("--out", type=Path, default=Path("runs/optimum_tension"))
    parser.add_argument("--set", action="append", default=[], dest="overrides", metavar="KEY=VALUE")
    options = parser.parse_args()
    table = io.StringIO()
    writers = [csv.DictWriter(target, COLUMNS, extrasaction="ignore") for target in (table, sys.stdout)]
    for writer in writers:
        writer.writeheader()
    for wire, settings in MATERIALS.items():
        for diameter in DIAMETERS:
            name = f"{wire.replace(' ', '_')}_{diameter}um"
            scene = load_scene(
                options.scene,
                ["model.kind=planar", *options.overrides, *settings, f"wire.diameter={diameter} um", f"name={name}"],
            )
            out = options.out / name
            result = run_map(scene, out=out, force=True)
            with open(out / "map.csv", newline="", encoding="utf-8") as file:
                stresses = [float(row["stress_max_Pa"]) for row in csv.DictReader(file) if row["stress_max_Pa"]]
            limit = scene.wire.yield_stress
            best = result.summary.optimum
            row = {"wire": wire, "diameter_um": diameter, "yield_stress_Pa": limit, **(vars(best) if best else {})}
            row["cells_below_limit"] = f"{sum(stress <= limit for stress in stresses)} of {len(stresses)}"
            row["wall_s"] = result.summary.solver.wall_s
            for writer in writers:
                writer.writerow({key: f"{value:.4g}" if isinstance(value, float) else value for key, value in row.items()})
            sys.stdout.flush()
    with write_aside(options.out / "optimum.csv") as file:
        file.write(table.getvalue())


if __name__ == "__main__":
    main()
