"""The check of estimated errors, for accuracy.py."""

from __future__ import annotations

import argparse
from dataclasses import dataclass

from accuracy_scenes import CHECKED
from study import read_rows, run, scene_of, show_rows, table_path, write_rows

from warpknit.mechanics.probe_settings import edge_of
from warpknit.solve.model import build_model
from warpknit.studies.points import errors_of, results_of, scales_of
from warpknit.studies.probe_run import estimate_of, settings_for_error

GRIPPED_ERROR = 5.0  # [%] asked of a patch: for less it takes about the nodes that count as true
CHECK_NODES = {"periodic": 96, "gripped": 40, "hook": 192}


@dataclass(frozen=True)
class EstimateRow:
    """A row of error_check.csv; errors in percent."""

    scene: str
    asked: float
    nodes_per_loop: int
    estimate: float
    true: float
    true_active: float
    true_tension: float
    true_contact_force: float
    true_stress: float
    steps: int
    true_steps: int

    @property
    def is_under(self) -> bool:
        return self.true < self.estimate


def checked(name: str, percent: float, quick: bool) -> EstimateRow:
    """Run a scene within an error, and truly."""
    file, overrides = CHECKED[name]
    levels = () if file.startswith("hook") else ("output.frames=5",)
    scene = scene_of(file, *overrides, *levels)
    within = settings_for_error(scene, percent)
    *_, last = run(scene_of(file, *overrides, *levels, *within.overrides))
    estimate = estimate_of(last, scene, within, percent)
    kind = edge_of(scene)
    tolerance, softening = (1e-3, 300.0) if kind == "gripped" else (1e-4, 64.0)
    fine = [("model.nodes_per_loop", 34 if quick else CHECK_NODES[kind]), ("solver.precision", "double"),
            ("solver.residual_tolerance", tolerance), ("solver.axial_softening", softening)]  # fmt: skip
    *_, true = run(scene_of(file, *overrides, *levels, *fine))
    errors = errors_of(results_of(last.observables), results_of(true.observables), scales_of(build_model(scene)))
    estimated = float("nan") if estimate.error is None else 100 * estimate.error
    return EstimateRow(name, percent, within.nodes_per_loop, estimated, errors.largest_percent, errors.active_percent,
               100 * errors.tension, 100 * errors.contact_force, 100 * errors.stress, last.steps, true.steps)  # fmt: skip


def study_estimate(given: argparse.Namespace) -> None:
    path = table_path(given, "error_check.csv")
    rows = read_rows(path, EstimateRow)
    for name in list(CHECKED)[:2] if given.quick else CHECKED:
        asked = max(given.error, GRIPPED_ERROR) if name.startswith("patch") else given.error
        if any(row.scene == name and row.asked == asked for row in rows):
            continue
        rows.append(checked(name, asked, given.quick))
        write_rows(path, rows)
    show_rows(rows)
    print(f"the true error is under the estimate in {sum(row.is_under for row in rows)} of {len(rows)}")
