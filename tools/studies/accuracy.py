"""What settings miss: presets, the estimate of `warpknit run --error`, and single precision, each against a truer run.

    python tools/studies/accuracy.py presets [DIR] [--quick]
    python tools/studies/accuracy.py space [DIR] [--quick]
    python tools/studies/accuracy.py estimate [DIR] [--error PERCENT] [--quick]
    python tools/studies/accuracy.py precision [DIR] [--quick]

*presets*: what the presets, and node counts between them, miss on many scenes: the numbers in warpknit/scene/presets.py. Each
scene is run at each setting, tiles in five levels, patches in one, hooks in their own, and held against TRUE_NODES in double
precision to a tolerance of 1e-4 (1e-3 of patches and with friction). Leaves presets.csv, a row a scene and setting, and prints
the worst and the median error of each setting; goes on with the scenes that are missing there.

*space*: the same of the presets in space, on the tile of the double atlas, on two tight knits, and on four of thick wire, in
presets_spatial.csv.

*estimate*: is the error that `warpknit run --error 2` estimates above the true one? Ten scenes that its numbers were not set by,
each run as `run --error` runs it, in five levels, and then with CHECK_NODES in double precision to a tolerance of 1e-4 (1e-3 of a
gripped mesh). Leaves error_check.csv and goes on with the scenes that are missing there; prints in how many the true error was
under the estimate.

*precision*: single against double precision, error and speed on the main patch and on a strip of one metre, in precision.csv.
Single precision is a mixed one: displacements are 32-bit fixed point; forces, velocities and rest data float32; what adds up
over steps or over the mesh (load, time, sums of energy and forces, places in the neighbour search) float64. In double precision
all is float64. Both run the same scene; errors are against double precision with a residual ten times smaller. Speed is that of
steps on one thread from the state at rest, the best of rounds in which both precisions take turns. --quick leaves out the strip.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any

import numpy as np
from study import add_directory, read_rows, run, run_one_of, scene_of, show_rows, table_path, write_rows

from warpknit import measure
from warpknit.kernels import control as c
from warpknit.model import build_model
from warpknit.planar.model import Model
from warpknit.planar.neighbours import NeighbourSearch
from warpknit.planar.state import State, initial_state
from warpknit.planar.step import Stepper
from warpknit.scene.presets import PRESETS
from warpknit.solve.simulate import Simulation
from warpknit.trade.error_estimate import estimate_of, settings_for_error
from warpknit.trade.point import Results, errors_of, results_of, run_point, scales_of
from warpknit.trial import edge_of


def both(weft: float, warp: float) -> tuple[str, str]:
    return f"load.strain_weft={weft}", f"load.strain_warp={warp}"


# --- presets ----------------------------------------------------------------------------------------------------------

TRICOT = '[{chain = "1-0/1-2"}, {chain = "2-3/1-0"}]'
LEVELS = "output.frames=5"
STRAINS = (0.02, 0.05, 0.08, 0.1, 0.12, 0.15, 0.2, 0.25)
TRUE_NODES = {"cell": 96, "patch": 80, "hook": 192}  # nodes of what counts as true, a loop or a wire
TRUE_NODES_WITH_FRICTION = 48
NODES = (8, 10, 12, 14, 16, 18, 20, 24, 30, 40)
TIGHT_NODES = 24  # from which the tolerance is 1e-3: 3e-3 leaves more than the nodes do


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


def scenes() -> dict[str, tuple[str, tuple[str, ...]]]:
    """The scenes by name: file and overrides."""
    cell: dict[str, tuple[str, ...]] = {f"cell {100 * e:g} %": both(e, e) for e in STRAINS}
    tension = both(0.15, 0.15)
    cell |= {
        "cell 20 / 8 %": both(0.2, 0.08),
        "cell 8 / 20 %": both(0.08, 0.2),
        "cell 15 %, lenses unmerged": (*tension, "model.merge_lenses=false"),
        "cell 12 %, friction 0.1": (*both(0.12, 0.12), "contact.friction=0.1"),
        "cell 12 %, friction 0.3": (*both(0.12, 0.12), "contact.friction=0.3"),
        "cell 15 %, 30 um": (*tension, 'wire.diameter="30 um"'),
        "locknit 10 %": (f"knit.bars={TRICOT}", *both(0.1, 0.1)),
        "locknit 5 %": (f"knit.bars={TRICOT}", *both(0.05, 0.05)),
        "cord 10 %": ('knit.bars=[{chain = "1-0/2-3"}]', *both(0.1, 0.1)),
        "closed tricot 10 %": ('knit.bars=[{chain = "1-0/1-2"}]', *both(0.1, 0.1)),
    }
    found = {name: ("atlas_cell.toml", overrides) for name, overrides in cell.items()}
    once = "output.frames=1"
    found["hook"] = ("hook_free_body.toml", ())
    found["hook, half as far"] = ("hook_free_body.toml", ('load.displacement="0.4 mm"',))
    found["patch 2 x 2, 10 %"] = ("atlas_patch.toml", ("knit.repeats=[2, 2]", once))
    found["patch 4 x 4, 10 %"] = ("atlas_patch.toml", ("knit.repeats=[4, 4]", once))
    found["patch 7 x 6, 10 %"] = ("atlas_patch.toml", (once,))
    return found


def settings() -> Iterator[tuple[str, tuple[tuple[str, Any], ...]]]:
    """Names and overrides of the settings."""
    for n in NODES:
        tolerance = 3e-3 if n < TIGHT_NODES else 1e-3
        keys = (("model.nodes_per_loop", n), ("solver.axial_softening", 1000.0), ("solver.residual_tolerance", tolerance))
        yield f"{n} nodes", (*keys, ("solver.precision", "single"))
    for name, preset in PRESETS.items():
        yield name, (
            ("model.nodes_per_loop", preset.nodes_per_loop), ("solver.axial_softening", preset.axial_softening),
            ("solver.residual_tolerance", preset.residual_tolerance), ("solver.precision", preset.precision),
        )  # fmt: skip


def rows_of(name: str, file: str, overrides: Sequence[str], quick: bool) -> Iterator[PresetRow]:
    """One scene at every setting."""

    def outcome(keys: Sequence[tuple[str, Any]]) -> Any:
        levels = (LEVELS,) if file == "atlas_cell.toml" else ()
        return run_point(lambda: scene_of(file, *overrides, *levels, *keys), watch=lambda _progress: None)

    nodes = 30 if quick else TRUE_NODES.get(name.split()[0], TRUE_NODES["cell"])
    tolerance, softening = 1e-4, 64.0
    if name.startswith("patch"):
        tolerance, softening = 1e-3, 300.0
    if "friction" in name:  # states differ by the way as much as by the nodes
        nodes, tolerance = TRUE_NODES_WITH_FRICTION, 1e-3
    truth = outcome((
        ("model.nodes_per_loop", nodes), ("solver.axial_softening", softening), ("solver.residual_tolerance", tolerance),
        ("solver.precision", "double"),
    ))  # fmt: skip
    if truth.results is None:
        print(f"{name}: left out, {truth.message}", flush=True)
        return
    scales = scales_of(build_model(scene_of(file, *overrides)))
    for setting, keys in settings():
        if file.startswith("hook"):
            keys = tuple(pair for pair in keys if pair[0] != "solver.precision")
        found = outcome(keys)
        print(name, setting, found.stop_reason, found.message[:80], flush=True)
        yield _row(name, setting, dict(keys), found, truth.results, scales)


SPACE = "model.kind=spatial"
TRUE_IN_SPACE = (("model.nodes_per_loop", 128), ("solver.residual_tolerance", 1e-4))
TIGHT_KNITS = {
    "closed tricot of two bars": '[{chain = "1-0/1-2"}, {chain = "1-2/1-0"}]',
    "locknit": TRICOT,
}
JAMMED_KNITS = {  # of thick wire at 26 wales and 30 courses an inch
    **TIGHT_KNITS,
    "single atlas": '[{chain = "1-0/1-2/2-3/2-1"}]',
    "reverse locknit": '[{chain = "2-3/1-0"}, {chain = "1-0/1-2"}]',
}


def scenes_in_space() -> dict[str, tuple[str, ...]]:
    """The same of tiles in space: overrides by name."""
    left_out = ("friction", "unmerged")  # states that depend on the path; lenses are of the plane
    found = {
        name: overrides
        for name, (_, overrides) in scenes().items()
        if name.startswith("cell") and not any(word in name for word in left_out)
    }
    for name, bars in TIGHT_KNITS.items():
        for e in (0.02, 0.05):
            found[f"{name} {100 * e:g} %"] = (f"knit.bars={bars}", "knit.repeats=[3, 2]", *both(e, e))
    tight = (*MOLYBDENUM, "knit.wale_spacing='0.98 mm'", "knit.course_spacing='0.85 mm'")
    for name, bars in JAMMED_KNITS.items():
        found[f"{name}, 30 um, 6 %"] = (f"knit.bars={bars}", *tight, *both(0.06, 0.06))
    return found


def rows_in_space(name: str, overrides: Sequence[str], quick: bool) -> Iterator[PresetRow]:
    """One scene in space with every preset."""

    def outcome(keys: Sequence[tuple[str, Any]]) -> Any:
        levels = "output.frames=1" if quick else LEVELS
        return run_point(lambda: scene_of("atlas_cell.toml", *overrides, levels, SPACE, *keys), watch=lambda _progress: None)

    truth = outcome((("model.nodes_per_loop", 56), ("solver.residual_tolerance", 3e-3)) if quick else TRUE_IN_SPACE)
    if truth.results is None:
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
        yield _row(name, preset, keys, found, truth.results, scales)


def _row(name: str, setting: str, keys: dict[str, Any], outcome: Any, truth: Results, scales: Any) -> PresetRow:
    nan = float("nan")
    found = outcome.results
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
    """What a setting misses over all scenes [%]."""

    setting: str
    median: float
    worst: float
    where: str
    node_steps: float  # median


# --- the estimate of an error -----------------------------------------------------------------------------------------

GRIPPED_ERROR = 5.0  # [%] asked of a patch: for less it takes about the nodes that count as true
CHECK_NODES = {"periodic": 96, "gripped": 40, "hook": 192}

MOLYBDENUM = ('wire.material="molybdenum"', 'wire.diameter="30 um"')
LOOPS = ("knit.loop.closed_radius=0.55", "knit.loop.open_half_width=0.3")
FULL_ATLAS = 'knit.bars=[{chain = "1-0/1-2/2-3/2-1"}, {chain = "2-3/2-1/1-0/1-2"}]'
LOCKNIT = 'knit.bars=[{chain = "1-0/1-2"}, {chain = "2-3/1-0"}]'
CHECKED = {
    "cell 13 / 11 %": ("atlas_cell.toml", both(0.13, 0.11)),
    "cell 18 %, molybdenum 30 um": ("atlas_cell.toml", (*both(0.18, 0.18), *MOLYBDENUM)),
    "cell 18 / 4 %": ("atlas_cell.toml", both(0.18, 0.04)),
    "cell 14 %, other loops": ("atlas_cell.toml", (*both(0.14, 0.14), *LOOPS)),
    "cell 11 %, lenses unmerged": ("atlas_cell.toml", (*both(0.11, 0.11), "model.merge_lenses=false")),
    "tile of 3 x 2, 17 %": ("atlas_cell.toml", (*both(0.17, 0.17), "knit.repeats=[3, 2]")),
    "full double atlas 12 %": ("atlas_cell.toml", (*both(0.12, 0.12), FULL_ATLAS)),
    "locknit 7 %": ("atlas_cell.toml", (*both(0.07, 0.07), LOCKNIT)),
    "patch 5 x 5, 12 %": ("atlas_patch.toml", (*both(0.12, 0.12), "knit.repeats=[5, 5]")),
    "hook, molybdenum": ("hook_free_body.toml", ('wire.material="molybdenum"', 'load.displacement="0.6 mm"')),
}  # fmt: skip


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
    estimate = estimate_of(last, scene, within)
    kind = edge_of(scene)
    tolerance, softening = (1e-3, 300.0) if kind == "gripped" else (1e-4, 64.0)
    fine = [("model.nodes_per_loop", 34 if quick else CHECK_NODES[kind]), ("solver.precision", "double"),
            ("solver.residual_tolerance", tolerance), ("solver.axial_softening", softening)]  # fmt: skip
    *_, true = run(scene_of(file, *overrides, *levels, *fine))
    errors = errors_of(results_of(last), results_of(true), scales_of(build_model(scene)))
    estimated = float("nan") if estimate.error is None else 100 * estimate.error
    return EstimateRow(name, percent, within.setting.nodes_per_loop, estimated, errors.largest_percent, errors.active_percent,
               100 * errors.tension, 100 * errors.contact_force, 100 * errors.stress, last.steps, true.steps)  # fmt: skip


# --- precision --------------------------------------------------------------------------------------------------------

MESHES: dict[str, dict[str, dict[str, Any]]] = {
    "patch of 24 mm": {},
    "strip of 1 m": {"knit": {"repeats": [1, 250]}},
}


ROUNDS = 7  # of the speed
STEPS = 200  # of a round


@dataclass(frozen=True)
class PrecisionRow:
    """A row of precision.csv; errors in percent of the reference."""

    scene: str
    precision: str
    nodes: int
    steps: int
    node_steps_per_s: float
    tension_weft_N_per_m: float
    tension_warp_N_per_m: float
    active_percent: float
    error_tension_percent: float
    error_active_points: float
    error_contact_force_percent: float
    error_stress_percent: float


@dataclass(frozen=True)
class Equilibrium:
    """A mesh at rest under its load, and what is measured on it."""

    model: Model
    state: State
    steps: int
    tension: np.ndarray  # (2,) [N/m]
    active_percent: float
    contact_force: float  # [N]
    stress: float  # [Pa]


def find(name: str, precision: str, tolerance: float) -> Equilibrium:
    """Run a scene."""
    tables = {
        **MESHES[name], "solver": {"precision": precision, "residual_tolerance": tolerance}, "output": {"frames": 2},
    }  # fmt: skip
    model = build_model(scene_of("atlas_patch.toml", **tables))
    state = initial_state(model)
    simulation = Simulation(model, state)
    *_, last = simulation.run()
    r = last.observables
    return Equilibrium(
        model, state, simulation.progress.steps, np.array(measure.mesh_tension(r)), measure.contacts(r).active_percent,
        float(r.pair_force.max(initial=0.0)), measure.stress_extremes(r)[0],
    )  # fmt: skip


def speeds(meshes: Sequence[Equilibrium]) -> list[float]:
    """Node-steps a second of each, which take turns."""
    steppers = [Stepper(mesh.model, mesh.state, threads=1) for mesh in meshes]
    searches = [NeighbourSearch(mesh.model, mesh.state) for mesh in meshes]
    best = [np.inf] * len(meshes)
    for turn in range(ROUNDS + 1):
        for k, (stepper, neighbours) in enumerate(zip(steppers, searches, strict=True)):
            neighbours.search()
            start = time.perf_counter()
            stepper.step(STEPS)
            seconds = time.perf_counter() - start
            if meshes[k].state.read_control()[int(c.STATUS)]:
                raise SystemExit("a mesh at rest moved too far to be followed")  # steps then do nothing
            if turn:  # the first launch of all compiles
                best[k] = min(best[k], seconds)
    return [mesh.model.panel.node_count * STEPS / seconds for mesh, seconds in zip(meshes, best, strict=True)]


def row_of(name: str, precision: str, found: Equilibrium, reference: Equilibrium, speed: float) -> PrecisionRow:
    """A run against the reference."""
    error = lambda value, wanted: 100.0 * float(np.max(np.abs(value - wanted)) / np.max(np.abs(wanted)))  # noqa: E731
    return PrecisionRow(
        name, precision, found.model.panel.node_count, found.steps, speed, *found.tension.tolist(), found.active_percent,
        error(found.tension, reference.tension), abs(found.active_percent - reference.active_percent),
        error(found.contact_force, reference.contact_force), error(found.stress, reference.stress),
    )  # fmt: skip


# --- command line -----------------------------------------------------------------------------------------------------


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


def study_precision(given: argparse.Namespace) -> None:
    rows: list[PrecisionRow] = []
    for name in list(MESHES)[: 1 if given.quick else None]:
        found = {precision: find(name, precision, 3e-3) for precision in ("single", "double")}
        rates = speeds(list(found.values()))
        reference = find(name, "double", 3e-4)
        rows += [row_of(name, *item, reference, speed) for item, speed in zip(found.items(), rates, strict=True)]
        show_rows(rows)
    write_rows(table_path(given, "precision.csv"), rows)


QUICK = {
    "presets": "a coarser reference and three scenes",
    "space": "a coarser reference, one scene and one preset",
    "estimate": "34 nodes count as true, and two scenes are run",
    "precision": "leave out the strip",
}


def add_options(name: str, parser: argparse.ArgumentParser) -> None:
    add_directory(parser, quick=QUICK[name])
    if name == "estimate":
        parser.add_argument("--error", type=float, default=2.0, metavar="PERCENT")


if __name__ == "__main__":
    studies = {"presets": study_presets, "space": study_space, "estimate": study_estimate, "precision": study_precision}
    sys.exit(run_one_of(__doc__, studies, add_options))
