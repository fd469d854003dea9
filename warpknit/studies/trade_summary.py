"""What trade.json and the table on the terminal say of the points of a trade."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Any

from ..base.text import rounded
from ..runner.summary_table import model_rows
from . import parameters
from .point import Errors
from .trade_table import TradeRow


def point_summary(row: TradeRow) -> dict[str, Any]:
    """Name, cost and errors of a point, for trade.json."""
    outcome = row.outcome
    return {
        "point": row.point,
        "node_steps": outcome.node_steps,
        "price": row.cost,
        "cpu_s": outcome.cpu_s,
        "largest_error_percent": row.errors.largest_percent if row.errors else None,
        "errors": asdict(row.errors) if row.errors else None,
    }


def parameter_table(rows: Sequence[TradeRow]) -> list[dict[str, Any]]:
    """Effect of each parameter alone: cost relative to the unchanged scene, and errors."""
    base = next((row for row in rows if row.parameter == parameters.BASE), None)
    if base is None:
        return []
    lines = []
    for row in rows:
        if row.group != "alone":
            continue
        value = row.point.removeprefix(f"alone: {base.point.removeprefix('alone: ')}").strip()
        errors = asdict(row.errors) if row.errors else dict.fromkeys(("active_percent", "tension", "contact_force", "stress"))
        lines.append({
            "knob": row.parameter,
            "value": value,
            "stop_reason": row.outcome.stop_reason,
            "node_steps_over_base": row.outcome.node_steps / base.outcome.node_steps,
            "price_over_base": row.cost / base.cost,
            "cpu_over_base": row.outcome.cpu_s / base.outcome.cpu_s if base.outcome.cpu_s else None,
            **{f"error_{name}": error for name, error in errors.items()},
            "largest_error_percent": row.errors.largest_percent if row.errors else None,
        })  # fmt: skip
    return lines


def columns_of(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Rows as columns, for a CSV file."""
    return {name: ["" if row[name] is None else row[name] for row in rows] for name in rows[0]}


def trade_lines(summary: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Table of a trade: pairs of a heading and a text."""
    for warning in summary.get("warnings", ()):
        yield "warning", warning
    yield from model_rows(summary.get("model"))
    why = ", ".join(f"{count} {reason}" for reason, count in summary.get("without_result_by", {}).items())
    reasons = f" ({why})" if why else ""
    yield "points", f"{summary['points']}, {summary['without_result']} without a result{reasons}"
    worst = 0.0
    if own := summary["reference"].get("own_error"):
        worst = Errors(**own).largest_percent
        yield "reference", f"{summary['reference']['nodes_per_loop'][0]:g} nodes a loop, own error {worst:.2g} %"
    for preset in summary["presets"]:
        yield f"preset {preset['point'].split()[1]}", _cost_and_error(preset, worst)
    for point in summary["front"]:
        yield "Pareto front", f"{_cost_and_error(point, worst)}: {point['point'].partition(': ')[2]}"
    for parameter in dict.fromkeys(row["knob"] for row in summary["knobs"]):
        varied = [row for row in summary["knobs"] if row["knob"] == parameter and row["largest_error_percent"] is not None]
        for row in varied:
            yield (
                parameter,
                f"{row['value'] or 'unchanged'}: {row['price_over_base']:.2g} x, {_percent(row['largest_error_percent'])}",
            )
    yield "stopped", summary["stop_reason"]


def _percent(error: float) -> str:
    return f"{error:.2g} %" if error < 99.5 else f"{error:.0f} %"


def _cost_and_error(point: dict[str, Any], own: float) -> str:
    """Cost and error of a point; `own` [%] is the error of the reference, below which none is known."""
    error = point["largest_error_percent"]
    known = "no result" if error is None else _percent(error) + (", below the reference's own error" if error < own else "")
    return f"{rounded(point['price']):,} node-steps, {known}"
