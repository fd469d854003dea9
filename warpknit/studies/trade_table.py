"""trade.csv: settings, cost, results and errors of each point of a trade."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ..base.files import write_aside
from ..errors import RunDirectoryError
from .point import Errors, Outcome, Results

DOUBLE_COST = 1.8  # time of a node-step in double precision over that in single: docs/studies/performance.md
SETTINGS = (
    "kind", "boundary", "repeats", "nodes_per_loop", "merge_lenses", "drive", "precision", "axial_softening",
    "contact_stiffness_N_per_m", "residual_tolerance", "multipliers", "levels", "mass_scaling", "target_time_step_s",
    "loading_time_s", "damping_per_s", "body_mass_kg",
)  # fmt: skip
COSTS = ("wall_s", "cpu_s", "steps", "node_steps")
RESULTS = tuple(Results.__dataclass_fields__)
ERRORS = ("active_percent", "tension", "contact_force", "stress")
COLUMNS = (
    "preset", "group", "knob", *SETTINGS, *COSTS, *(f"error_{name}" for name in ERRORS), *RESULTS,
    "stop_reason", "message", "point",
)  # fmt: skip


@dataclass
class TradeRow:
    """One point: its group, its outcome and, once there is a reference, its errors."""

    point: str
    group: str
    parameter: str  # column `knob`
    outcome: Outcome
    errors: Errors | None = field(default=None)

    @property
    def cost(self) -> float:
        """Node-steps, weighted by DOUBLE_COST in double precision."""
        return self.outcome.node_steps * (DOUBLE_COST if self.outcome.settings.get("precision") == "double" else 1.0)

    @property
    def preset(self) -> str:
        """Name of the preset of this point; empty where it is none."""
        return self.parameter if self.group == "preset" else ""


def write_rows(path: Path, rows: Sequence[TradeRow]) -> None:
    """Write the table, atomically."""
    with write_aside(path) as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        for row in rows:
            outcome = row.outcome
            values: dict[str, object] = {name: outcome.settings.get(name) for name in SETTINGS}
            values |= {name: getattr(outcome, name) for name in COSTS}
            values |= {f"error_{name}": getattr(row.errors, name) if row.errors else None for name in ERRORS}
            values |= {name: getattr(outcome.results, name) if outcome.results else None for name in RESULTS}
            values |= {"preset": row.preset, "group": row.group, "knob": row.parameter, "point": row.point}
            writer.writerow(values | {"stop_reason": outcome.stop_reason, "message": outcome.message})


def read_rows(path: Path) -> list[TradeRow]:
    """Rows that `write_rows` wrote, without errors, settings as text; none where the file is absent.

    Raises `RunDirectoryError` where it is of another version.
    """
    if not path.exists():
        return []
    with open(path, newline="", encoding="utf-8") as file:
        reader = csv.DictReader(file)
        if missing := set(COLUMNS) - set(reader.fieldnames or ()):
            raise RunDirectoryError(f"{path}: not of this version (no {', '.join(sorted(missing))}); start over with --force")
        return [_row(values) for values in reader]


def _row(values: dict[str, str]) -> TradeRow:
    results = Results(**{name: float(values[name]) for name in RESULTS}) if values[RESULTS[0]] else None
    outcome = Outcome(
        settings={name: values[name] or None for name in SETTINGS},
        results=results,
        stop_reason=values["stop_reason"],
        message=values["message"],
        wall_s=float(values["wall_s"]),
        cpu_s=float(values["cpu_s"]),
        steps=int(values["steps"]),
        node_steps=int(values["node_steps"]),
    )
    return TradeRow(values["point"], values["group"], values["knob"], outcome)
