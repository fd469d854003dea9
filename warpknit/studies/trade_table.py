"""The points of a trade: rows of trade.csv, the tables of trade.json, and the lines of the command."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from .. import __version__
from ..base.errors import RunDirectoryError
from ..base.files import write_table
from ..base.text import rounded
from ..results.finding import Finding, ResultTable, ResultWarning
from ..results.row import Values, plain, valued
from ..runner.run_directory import Tree
from ..runner.summary_table import heading, model_findings
from . import parameters
from .point import Errors, PointOutcome, Results

DOUBLE_COST = 1.8  # time of a node-step in double precision over that in single: docs/studies/performance.md
SETTINGS = (
    "kind", "boundary", "repeats", "nodes_per_loop", "merge_lenses", "drive", "precision", "axial_softening",
    "contact_stiffness_N_per_m", "residual_tolerance", "multipliers", "levels", "mass_scaling", "target_time_step_s",
    "loading_time_s", "damping_per_s", "body_mass_kg",
)  # fmt: skip
COSTS = ("wall_s", "cpu_s", "steps", "node_steps")
RESULTS = tuple(Results.__dataclass_fields__)
ERRORS = tuple(Errors.__dataclass_fields__)


@dataclass
class TradeRow:
    """One point: its group, its outcome and, once there is a reference, its errors."""

    point: str
    group: str
    parameter: str  # column `knob`
    outcome: PointOutcome
    errors: Errors | None = field(default=None)

    @property
    def cost(self) -> float:
        """Node-steps, weighted by DOUBLE_COST in double precision."""
        return self.outcome.node_steps * (DOUBLE_COST if self.outcome.settings.get("precision") == "double" else 1.0)

    @property
    def preset(self) -> str:
        """Name of the preset of this point; empty where it is none."""
        return self.parameter if self.group == "preset" else ""

    @property
    def largest_error(self) -> float | None:
        """[%]"""
        return self.errors.largest_percent if self.errors else None

    @property
    def columns(self) -> dict[str, object]:
        """Values of the columns of trade.csv."""
        outcome = self.outcome
        return {
            "preset": self.preset, "group": self.group, "knob": self.parameter,
            **{name: outcome.settings.get(name) for name in SETTINGS},
            **{name: getattr(outcome, name) for name in COSTS},
            **{f"error_{name}": getattr(self.errors, name, None) for name in ERRORS},
            **{name: getattr(outcome.results, name, None) for name in RESULTS},
            "stop_reason": outcome.stop_reason, "message": outcome.message, "point": self.point,
        }  # fmt: skip

    @property
    def summary(self) -> Values:
        """Name, cost and errors, for trade.json."""
        return Values(
            point=self.point,
            node_steps=self.outcome.node_steps,
            price=self.cost,
            cpu_s=self.outcome.cpu_s,
            largest_error_percent=self.largest_error,
            errors=self.errors,
        )


def write_trade(path: Path, rows: Sequence[TradeRow]) -> None:
    """Write trade.csv, atomically."""
    lines = [row.columns for row in rows]
    write_table(path, {name: np.array([line[name] for line in lines], dtype=object) for name in lines[0]})


def read_trade(path: Path) -> list[TradeRow]:
    """Rows that `write_trade` wrote, without errors, settings as text; none where the file is absent.

    Raises `RunDirectoryError` where it is of another version.
    """
    if not path.exists():
        return []
    with open(path, newline="", encoding="utf-8") as file:
        reader = csv.DictReader(file)
        wanted = TradeRow("", "", "", PointOutcome({}, None, "")).columns
        if missing := set(wanted) - set(reader.fieldnames or ()):
            raise RunDirectoryError(f"{path}: not of this version (no {', '.join(sorted(missing))}); start over with --force")
        return [_row(values) for values in reader]


def _row(values: Mapping[str, str]) -> TradeRow:
    results = Results(**{name: float(values[name]) for name in RESULTS}) if values[RESULTS[0]] else None
    outcome = PointOutcome(
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


def parameter_table(rows: Sequence[TradeRow]) -> list[Values]:
    """Effect of each parameter alone: cost relative to the unchanged scene, and errors."""
    base = next((row for row in rows if row.parameter == parameters.BASE), None)
    if base is None:
        return []
    unchanged = f"alone: {base.point.removeprefix('alone: ')}"
    return [
        Values(
            knob=row.parameter,
            value=row.point.removeprefix(unchanged).strip(),
            stop_reason=row.outcome.stop_reason,
            node_steps_over_base=row.outcome.node_steps / base.outcome.node_steps,
            price_over_base=row.cost / base.cost,
            cpu_over_base=row.outcome.cpu_s / base.outcome.cpu_s if base.outcome.cpu_s else None,
            **{f"error_{name}": getattr(row.errors, name, None) for name in ERRORS},
            largest_error_percent=row.largest_error,
        )
        for row in rows
        if row.group == "alone"
    ]


@dataclass(frozen=True, kw_only=True)
class TradeSummary:
    """The tables of trade.json."""

    scene: Values
    version: str = __version__
    stop_reason: str
    warnings: Sequence[ResultWarning]
    model: Values
    points: int
    without_result: int
    without_result_by: Mapping[str, int]
    reference: Values  # empty where it did not finish
    front: Sequence[Values]
    presets: Sequence[Values]
    knobs: Sequence[Values]

    def json(self) -> Tree:
        """All of trade.json."""
        return dict(plain(self))

    @classmethod
    def of(cls, tree: Tree) -> TradeSummary:
        """The result that `json` gave."""
        warnings = [*map(ResultWarning.of, tree["warnings"])]
        return cls(**vars(valued(tree)) | {"warnings": warnings, "without_result_by": tree["without_result_by"]})


def trade_table(result: TradeSummary) -> ResultTable:
    """The table of a trade."""
    return ResultTable(tuple(trade_findings(result)), tuple(result.warnings), "trade.json")


def trade_findings(result: TradeSummary) -> Iterator[Finding]:
    """The rows of the table of a trade."""
    missing = f", {result.without_result} without a result" if result.without_result else ""
    yield heading(result.scene.name, f"{result.points} points{missing}", result.stop_reason)
    for reason, count in result.without_result_by.items():
        yield Finding("  without a result", f"{count} {reason}")
    worst = 0.0
    if "own_error" in result.reference:
        worst = Errors(**vars(result.reference.own_error)).largest_percent
        text = f"{result.reference.nodes_per_loop[0]:g} nodes a loop, own error {worst:.2g} %"
        yield Finding("reference", text, short=True)
    for preset in result.presets:
        yield Finding(f"preset {preset.point.split()[1]}", _cost_and_error(preset, worst), short=True)
    yield Finding("Pareto front", f"{len(result.front)} points (trade.csv)", short=True)
    for point in result.front:
        yield Finding("  point", f"{_cost_and_error(point, worst)}: {point.point.partition(': ')[2]}")
    for parameter in dict.fromkeys(row.knob for row in result.knobs):
        for row in (row for row in result.knobs if row.knob == parameter and row.largest_error_percent is not None):
            cost = f"{row.value or 'unchanged'}: {row.price_over_base:.2g} x"
            yield Finding(f"  {parameter}", f"{cost}, {_percent(row.largest_error_percent)}")
    yield from model_findings(result.model, f"{result.model.nodes:,} nodes" if "nodes" in result.model else "")


def _percent(error: float) -> str:
    return f"{error:.2g} %" if error < 99.5 else f"{error:.0f} %"


def _cost_and_error(point: Values, own: float) -> str:
    """Cost and error of a point; `own` [%] is the error of the reference, below which none is known."""
    error = point.largest_error_percent
    known = "no result" if error is None else _percent(error) + (", below the reference's own error" if error < own else "")
    return f"{rounded(point.price):,} node-steps, {known}"
