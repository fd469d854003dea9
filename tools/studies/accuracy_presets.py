"""The errors of presets and node counts, for accuracy.py."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any

from accuracy_scenes import scenes, scenes_in_space
from study import read_rows, scene_of, show_rows, table_path, write_rows

from warpknit.scene.presets import PRESETS
from warpknit.solve.model import build_model
from warpknit.studies.points import errors_of, run_point, scales_of

LEVELS = "output.frames=5"
TRUE_NODES = {"cell": 96, "patch": 80, "hook": 192}  # nodes of what counts as true, a loop or a wire
TRUE_NODES_WITH_FRICTION = 48
NODES = (8, 10, 12, 14, 16, 18, 20, 24, 30, 40)
TIGHT_NODES = 24  # from which the tolerance is 1e-3: 3e-3 leaves more than the nodes do
SPACE = "model.kind=spatial"
TRUE_IN_SPACE = (("model.nodes_per_loop", 128), ("solver.residual_tolerance", 1e-4))


@dataclass(frozen=True)
class PresetRow:
    """A row of presets.csv; errors in percent."""

    scene: str
    setting: str
    nodes_per_loop: int
    residual_tolerance: float
    node_steps: int
    cpu_s: float
    stop_reason: str
    active_percent: float
    tension_weft: float
    tension_warp: float
    contact_force_N: float
    stress_Pa: float
    error_active: float
    error_tension: float
    error_contact_force: float
    error_stress: float
    error_largest: float


def settings() -> Iterator[tuple[str, tuple[tuple[str, Any], ...]]]:
    """Names and overrides of the settings."""
    for n in NODES:
        tolerance = 3e-3 if n < TIGHT_NODES else 1e-3
        keys = (("model.nodes_per_loop", n), ("solver.axial_softening", 1000.0), ("solver.residual_tolerance", tolerance))
        yield f"{n} nodes", (*keys, ("solver.precision", "single"))
    for name, preset in ((name, presets["planar", "relax"]) for name, presets in PRESETS.items()):
        yield name, (
            ("model.nodes_per_loop", preset.nodes_per_loop), ("solver.axial_softening", preset.axial_softening),
            ("solver.residual_tolerance", preset.residual_tolerance), ("solver.precision", preset.precision),
        )  # fmt: skip


def rows_of(name: str, file: str, overrides: Sequence[str], quick: bool) -> Iterator[PresetRow]:
    """One scene at every setting."""

    def outcome(keys: Sequence[tuple[str, Any]]) -> Any:
        levels = (LEVELS,) if file == "atlas_cell.toml" else ()
        return run_point(lambda: scene_of(file, *overrides, *levels, *keys))

    nodes = 30 if quick else TRUE_NODES.get(name.split(maxsplit=1)[0], TRUE_NODES["cell"])
    tolerance, softening = 1e-4, 64.0
    if name.startswith("patch"):
        tolerance, softening = 1e-3, 300.0
    if "friction" in name:  # states differ by the way as much as by the nodes
        nodes, tolerance = TRUE_NODES_WITH_FRICTION, 1e-3
    truth = outcome((
        ("model.nodes_per_loop", nodes), ("solver.axial_softening", softening), ("solver.residual_tolerance", tolerance),
        ("solver.precision", "double"),
    ))  # fmt: skip
    if not truth.has_results:
        print(f"{name}: left out, {truth.message}", flush=True)
        return
    scales = scales_of(build_model(scene_of(file, *overrides)))
    for setting, keys in settings():
        if file.startswith("hook"):
            keys = tuple(pair for pair in keys if pair[0] != "solver.precision")
        found = outcome(keys)
        print(name, setting, found.stop_reason, found.message[:80], flush=True)
        yield _row(name, setting, dict(keys), found, truth, scales)


def rows_in_space(name: str, overrides: Sequence[str], quick: bool) -> Iterator[PresetRow]:
    """One spatial scene with every preset."""

    def outcome(keys: Sequence[tuple[str, Any]]) -> Any:
        levels = "output.frames=1" if quick else LEVELS
        return run_point(lambda: scene_of("atlas_cell.toml", *overrides, levels, SPACE, *keys))

    truth = outcome((("model.nodes_per_loop", 56), ("solver.residual_tolerance", 3e-3)) if quick else TRUE_IN_SPACE)
    if not truth.has_results:
        print(f"{name}: left out, {truth.message}", flush=True)
        return
    scales = scales_of(build_model(scene_of("atlas_cell.toml", *overrides, SPACE)))
    for preset in list(PRESETS)[: 1 if quick else None]:
        scene = scene_of("atlas_cell.toml", *overrides, SPACE, f"solver.preset={preset}")
        keys = {
            "model.nodes_per_loop": scene.model.nodes_per_loop, "solver.residual_tolerance": scene.solver.residual_tolerance,
        }  # fmt: skip
        found = outcome((("solver.preset", preset),))
        print(name, preset, found.stop_reason, found.message[:80], flush=True)
        yield _row(name, preset, keys, found, truth, scales)


def _row(name: str, setting: str, keys: dict[str, Any], outcome: Any, truth: Any, scales: Any) -> PresetRow:
    nan = float("nan")
    found = outcome if outcome.has_results else None
    errors = None if found is None else errors_of(found, truth, scales)
    return PresetRow(
        name, setting, keys["model.nodes_per_loop"], keys["solver.residual_tolerance"], outcome.node_steps, outcome.cpu_s,
        outcome.stop_reason,
        *((nan,) * 5 if found is None else (found.active_percent, found.tension_weft_N_per_m, found.tension_warp_N_per_m,
                                            found.contact_force_sum_N, found.stress_max_Pa)),
        *((nan,) * 5 if errors is None else (errors.active_percent, 100 * errors.tension, 100 * errors.contact_force,
                                             100 * errors.stress, errors.largest_percent)),
    )  # fmt: skip


@dataclass(frozen=True)
class Worst:
    """Largest errors of a setting over all scenes [%]."""

    setting: str
    median: float
    worst: float
    where: str
    node_steps: float  # median


def study_presets(given: argparse.Namespace) -> None:
    path = table_path(given, "presets.csv")
    rows = read_rows(path, PresetRow)
    there = {row.scene for row in rows}
    for number, (name, (file, overrides)) in enumerate(scenes().items()):
        if (given.quick and number % 8) or name in there:
            continue
        rows += rows_of(name, file, overrides, given.quick)
        write_rows(path, rows)
    _show_worst(rows)


def study_space(given: argparse.Namespace) -> None:
    path = table_path(given, "presets_spatial.csv")
    rows = read_rows(path, PresetRow)
    there = {row.scene for row in rows}
    for name, overrides in list(scenes_in_space().items())[: 1 if given.quick else None]:
        if name not in there:
            rows += rows_in_space(name, overrides, given.quick)
            write_rows(path, rows)
    _show_worst(rows)


def _show_worst(rows: Sequence[PresetRow]) -> None:
    """Print the worst and the median error of each setting."""
    table = []
    for setting in dict.fromkeys(row.setting for row in rows):
        those = [row for row in rows if row.setting == setting and row.error_largest == row.error_largest]
        worst = max(those, key=lambda row: row.error_largest)
        table.append(Worst(setting, median(r.error_largest for r in those), worst.error_largest, worst.scene,
                           median(r.node_steps for r in those)))  # fmt: skip
    show_rows(table)
