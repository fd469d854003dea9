"""What condensing the crossings into the plane costs: the same cell planar and in space, level by level.

    python tools/condensation_study.py [--scene FILE] [--strain 0.2] [--levels 10] [--set KEY=VALUE]...

Prints one row a level and model: tension, share of active contacts, sum and largest of the contact forces, largest stress,
node-steps and wall time. A third run shows the planar model with wires that close at one diameter, as they do in space, in
place of 1.25.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from warpknit import measure
from warpknit.planar.model import build_model
from warpknit.planar.state import initial_state
from warpknit.scene import load_scene
from warpknit.solve.simulate import Simulation
from warpknit.spatial.drive import SpatialRecord
from warpknit.spatial.mesh import build_mesh
from warpknit.spatial.relax import SpatialRelaxation

SCENES = Path(__file__).parent.parent / "scenes"
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
    for record in Simulation(model, initial_state(model)).run():
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
    relaxation = SpatialRelaxation(build_mesh(load_scene(scene, [*overrides, "model.kind=spatial"])))
    begin = time.perf_counter()
    for record in relaxation.run():
        yield record_row("spatial", relaxation, record, time.perf_counter() - begin)


def record_row(name: str, relaxation: SpatialRelaxation, record: SpatialRecord, wall: float = float("nan")) -> Row:
    """The row of a record in space."""
    r = record.observables
    return Row(
        name,
        float(r.gradient[0, 0] - 1.0),
        *measure.mesh_tension(r),
        measure.contacts(r).active_percent,
        float(r.site_force.sum()),
        float(r.site_force.max(initial=0.0)),
        measure.stress_extremes(r)[0],
        float(record.steps) * relaxation.mesh.rods.node_count,
        wall,
    )


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", default=str(SCENES / "atlas_cell_spatial.toml"))
    parser.add_argument("--strain", type=float, default=0.2)
    parser.add_argument("--levels", type=int, default=10)
    parser.add_argument("--set", dest="overrides", action="append", default=[])
    given = parser.parse_args(arguments)
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
    return 0


def line(r: Row) -> str:
    """One row as text."""
    tension = f"{1e3 * r.weft:10.3f} {1e3 * r.warp:10.3f}"
    contact = f"{r.share:9.1f} {1e6 * r.force_sum:7.1f} {1e6 * r.force_max:11.2f}"
    return f"{r.model:16s} {r.strain:7.3f} {tension} {contact} {1e-6 * r.stress:11.1f} {r.node_steps:11.2e} {r.wall:7.1f}"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
