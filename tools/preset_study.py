"""What the presets, and node counts between them, miss on many scenes: the numbers in warpknit/scene/presets.py.

    python tools/preset_study.py DIR [--quick]

Each scene is run at each setting, tiles in five levels, patches in one, hooks in their own, and held against TRUE_NODES in double
precision to a tolerance of 1e-4 (1e-3 of patches and with friction). Leaves presets.csv in DIR, a row a scene and setting, and
prints the worst and the median error of each setting; goes on with the scenes that are missing in DIR.
Kept: tools/results/presets.csv.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

from study import read_rows, scene_of, show_rows, write_rows

from warpknit.planar.model import (build_model)
from warpknit.scene.presets import PRESETS
from warpknit.trade.point import Found, errors_of, run_point, scales_of

TRICOT = '[{chain = "1-0/1-2"}, {chain = "2-3/1-0"}]'
LEVELS = "output.frames=5"
STRAINS = (0.02, 0.05, 0.08, 0.1, 0.12, 0.15, 0.2, 0.25)
TRUE_NODES = {"cell": 96, "patch": 80, "hook": 192}  # nodes of what counts as true, a loop or a wire
TRUE_NODES_WITH_FRICTION = 48
NODES = (8, 10, 12, 14, 16, 18, 20, 24, 30, 40)
TIGHT_NODES = 24  # from which the tolerance is 1e-3: 3e-3 leaves more than the nodes do


@dataclass(frozen=True)
class Row:
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
    cell: dict[str, tuple[str, ...]] = {
        f"cell {100 * e:g} %": (f"load.strain_weft={e}", f"load.strain_warp={e}") for e in STRAINS
    }
    tension = ("load.strain_weft=0.15", "load.strain_warp=0.15")
    cell |= {
        "cell 20 / 8 %": ("load.strain_weft=0.2", "load.strain_warp=0.08"),
        "cell 8 / 20 %": ("load.strain_weft=0.08", "load.strain_warp=0.2"),
        "cell 15 %, lenses unmerged": (*tension, "model.merge_lenses=false"),
        "cell 12 %, friction 0.1": ("load.strain_weft=0.12", "load.strain_warp=0.12", "contact.friction=0.1"),
        "cell 12 %, friction 0.3": ("load.strain_weft=0.12", "load.strain_warp=0.12", "contact.friction=0.3"),
        "cell 15 %, 30 um": (*tension, 'wire.diameter="30 um"'),
        "locknit 10 %": (f"knit.bars={TRICOT}", "load.strain_weft=0.1", "load.strain_warp=0.1"),
        "locknit 5 %": (f"knit.bars={TRICOT}", "load.strain_weft=0.05", "load.strain_warp=0.05"),
        "cord 10 %": ('knit.bars=[{chain = "1-0/2-3"}]', "load.strain_weft=0.1", "load.strain_warp=0.1"),
        "closed tricot 10 %": ('knit.bars=[{chain = "1-0/1-2"}]', "load.strain_weft=0.1", "load.strain_warp=0.1"),
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


def rows_of(name: str, file: str, overrides: Sequence[str], quick: bool) -> Iterator[Row]:
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
    if truth.found is None:
        print(f"{name}: left out, {truth.message}", flush=True)
        return
    scales = scales_of(build_model(scene_of(file, *overrides)))
    for setting, keys in settings():
        if file.startswith("hook"):
            keys = tuple(pair for pair in keys if pair[0] != "solver.precision")
        found = outcome(keys)
        print(name, setting, found.stop_reason, found.message[:80], flush=True)
        yield _row(name, setting, dict(keys), found, truth.found, scales)


def _row(name: str, setting: str, keys: dict[str, Any], outcome: Any, truth: Found, scales: Any) -> Row:
    nan = float("nan")
    found = outcome.found
    errors = None if found is None else errors_of(found, truth, scales)
    return Row(
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--quick", action="store_true", help="a coarser reference and three scenes")
    options = parser.parse_args()
    rows = read_rows(options.folder / "presets.csv", Row)
    there = {row.scene for row in rows}
    for number, (name, (file, overrides)) in enumerate(scenes().items()):
        if (options.quick and number % 8) or name in there:
            continue
        rows += rows_of(name, file, overrides, options.quick)
        write_rows(options.folder / "presets.csv", rows)
    table = []
    for setting in dict.fromkeys(row.setting for row in rows):
        those = [row for row in rows if row.setting == setting and row.error_largest == row.error_largest]
        worst = max(those, key=lambda row: row.error_largest)
        table.append(Worst(setting, median(r.error_largest for r in those), worst.error_largest, worst.scene,
                           median(r.node_steps for r in those)))  # fmt: skip
    show_rows(table)


if __name__ == "__main__":
    main()
