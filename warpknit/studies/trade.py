"""`warpknit trade`: all points of a study into a directory, with interrupt and resume; the table of the command.

DIR holds trade.csv, trade_knobs.csv (effect of each parameter alone), trade.json, scene.toml (resolved) and figures/trade.png.
"""

from __future__ import annotations

import logging
import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import astuple
from pathlib import Path
from typing import Any

from .. import __version__
from ..base.errors import Diverged, InputError, RunDirectoryError
from ..base.text import rounded
from ..compute.device import find_device
from ..mechanics.numerics import slowest_rate
from ..mechanics.probe_settings import Varied
from ..mesh.layout import mesh_nodes
from ..results.finding import Finding, ResultTable, ResultWarning
from ..results.row import Row, Values, read_rows, valued, write_json, write_rows
from ..runner.interrupts import Interrupted, Interrupts
from ..runner.progress_display import Display
from ..runner.run_directory import CommandResult, Tree, check_directory, open_directory
from ..runner.summary_table import heading, model_findings
from ..scene import Scene
from ..scene.capabilities import refuse
from ..solve.model import build_model, kind_of
from . import points
from .points import BASE, COLUMNS, ERRORS, RESULTS, Errors, Overrides, Point, TradeRow, errors_of, run_point, scales_of

_log = logging.getLogger(__name__)

Loader = Callable[[Overrides, str | None], Scene]

RATIO = math.sqrt(2.0)  # ratio of successive node counts of the references
COST_LIMIT = 4.0  # times the node-steps of the reference: limit of a point
MIN_ORDER, MAX_ORDER = 1.0, 4.0  # accepted orders of convergence; outside, the differences are too small or too noisy
RAMP_NODES = 2_000  # largest mesh on which ramps in real time are tried: they take a hundred times the steps


class TradeSummary(Values):
    """The tables of trade.json."""

    scene: Values
    version: str
    stop_reason: str
    warnings: Sequence[ResultWarning]
    model: Values
    points: int
    without_result: int
    without_result_by: Values
    reference: Values  # empty where it did not finish
    front: Sequence[Values]
    presets: Sequence[Values]
    knobs: Sequence[Values]

    @classmethod
    def of(cls, tree: Tree) -> TradeSummary:
        """The summary in trade.json."""
        return cls(**vars(valued(tree)) | {"warnings": [*map(ResultWarning.of, tree["warnings"])]})


def run_trade(
    load: Loader,
    *,
    out: Path,
    against: str | None = None,
    device: str | None = None,
    resume: bool = False,
    force: bool = False,
    progress: Display | None = None,
) -> CommandResult[TradeSummary]:
    """Measure speed against accuracy of a scene into the directory `out`.

    `load` returns the scene with more overrides and a preset; `against` is the `model.kind` of the reference. Raises
    `SceneError`, `RunDirectoryError`, `DeviceError`, `ModelError`, `KnitError` before anything is written, and `Diverged` where
    the reference does. An interrupt ends with exit_code 130 and keeps the finished points.
    """
    scene = load((), None)
    refuse(scene, "trade")
    # friction has another default in another model
    of_reference: Overrides = (("model.kind", against), ("contact.friction", scene.contact.friction)) if against else ()
    load(of_reference, None)  # refused before anything is written
    finished, keep = check_directory(out, "trade", scene, resume=resume, force=force)
    if finished is not None:
        return CommandResult(0, TradeSummary.of(finished))
    name = find_device(device, nodes=lambda: mesh_nodes(scene))
    base = build_model(scene, name)
    open_directory(out, scene, keep=keep)
    return _Study(load, base, of_reference, name, out, progress or Display()).run()


class _Study:
    """Runs the remaining points and writes their results."""

    def __init__(self, load: Loader, base: Any, of_reference: Overrides, device: str, out: Path, display: Display) -> None:
        self.load_with, self.base, self.device, self.out, self.display = load, base, device, out, display
        self.of_kind: Overrides = (("model.kind", base.scene.model.kind),)
        self.of_reference = of_reference
        self.scales = scales_of(base)
        self.path = out / "trade.csv"
        self.rows = read_trade(self.path)
        truth = load(of_reference, None)
        kind = kind_of(truth)
        finest = kind.HOOK_REFERENCE if truth.hook is not None else next(n for m, n in kind.REFERENCE if base.node_count <= m)
        self.tolerance = kind.TOLERANCE
        self.finest = [round(finest / RATIO**k) for k in range(3)]
        self._interrupts = Interrupts()

    def run(self) -> CommandResult[TradeSummary]:
        reason, code, message = "finished", 0, ""
        with self._interrupts.handled():
            try:
                for warning in self.base.warnings([]):
                    _log.warning("warning %s: %s", warning.code, warning)
                wanted = self._points()
                _log.info("%d settings to run", len(wanted) - len(self.rows))
                for number, point in enumerate(wanted, start=1):
                    self._interrupts.check()
                    self.display.stage(point.name, number=number, of=len(wanted))
                    self._run(point)
            except Interrupted:
                reason, code, message = "interrupted", 130, f"interrupted; finished settings are kept in {self.out}"
        summary = self._summary(reason)
        write_json(self.out / "trade.json", summary)
        if code == 0:
            write_rows(self.out / "trade_knobs.csv", summary.knobs, [*vars(summary.knobs[0])])
            self._draw(summary.reference.own_error)
        return CommandResult(code, summary, message)

    # --- points ---

    def _points(self) -> list[Point]:
        varied = kind_of(self.base.scene).varied(self.base.scene, self.base.softening)
        tried = [*points.preset_points(self.base), *points.single_parameter_points(self.base, varied)]
        tried += self._ramp_points(varied)
        tried += points.combined_points(self.base, varied, self.finest[0])
        return [*points.reference_points(self.finest, self.tolerance), *filter(self._is_available, tried)]

    def _is_available(self, point: Point) -> bool:
        """Whether this kind of model has the parameter that a point varies."""
        try:
            self._load(point)
        except InputError:
            return False
        return True

    def _load(self, point: Point) -> Scene:
        """Scene of a point, in the model of the scene or of the reference."""
        last = self.of_reference if point.group == "reference" else ()
        return self.load_with((*self.of_kind, *point.overrides, *last), point.preset)

    def _ramp_points(self, varied: Varied) -> Iterator[Point]:
        if self.base.node_count > RAMP_NODES:
            _log.info("ramps are left out: the mesh has more than %d nodes", RAMP_NODES)
            return
        try:
            model = build_model(self._load(Point("alone", "drive", (("solver.drive", "ramp"),))))
        except InputError as error:
            _log.info("ramps are left out: %s", error)
            return
        rate = slowest_rate(model.scene, model.loop_length)
        yield from points.ramp_points(self.base, varied, 2.0 * math.pi / rate, model.time_step)

    def _run(self, point: Point) -> None:
        if any(row.point == point.name for row in self.rows):
            return
        reference = next((row for row in self.rows if row.group == "reference"), None)
        limit = math.inf if reference is None else COST_LIMIT * reference.node_steps
        row = run_point(
            lambda: self._load(point), device=self.device, max_node_steps=limit, monitor=lambda progress: self._interrupts.check()
        )
        if point.group == "reference" and not row.has_results:
            raise Diverged(f"the reference of {self.finest[0]} nodes a loop failed: {row.message}")
        preset = point.parameter if point.group == "preset" else ""
        row = row.changed(point=point.name, group=point.group, knob=point.parameter, preset=preset)
        if row.has_results:
            truth = self.rows[0] if self.rows else row
            force = row.contact_force_sum_N * _repeats(truth) / _repeats(row)  # compared per repeat
            errors = vars(errors_of(row.changed(contact_force_sum_N=force), truth, self.scales))
            row = row.changed(**{f"error_{name}": value for name, value in errors.items()})
        self.rows.append(row)
        write_rows(self.path, self.rows, COLUMNS)

    # --- results ---

    def _summary(self, reason: str) -> TradeSummary:
        counted, scene = self._counted, self.base.scene
        reference = self._reference()
        own = reference.own_error.largest_percent if "own_error" in reference else 0.0
        failed = Counter(row.stop_reason for row in self.rows if not row.has_results)
        return TradeSummary(
            scene=Values(name=scene.name, hash=scene.hash),
            version=__version__,
            stop_reason=reason,
            warnings=list(self.base.warnings([])),
            model=Values(
                kind=scene.model.kind,
                kind_reason=scene.kind_reason,
                friction=scene.contact.friction,
                friction_assumed="contact.friction" in scene.assumed,
            ),
            points=len(self.rows),
            without_result=failed.total(),
            without_result_by=Values(**failed),
            reference=reference,
            front=[counted[k].summary for k in pareto([(row.cost, row.errors.largest_percent) for row in counted], own)],
            presets=[row.summary for row in self.rows if row.group == "preset"],
            knobs=parameter_table(self.rows),
        )

    @property
    def _counted(self) -> list[Any]:
        """The points with errors, without the reference."""
        return [row for row in self.rows if row.has_results and row.group != "reference"]

    def _reference(self) -> Values:
        """Results of the reference, and its own error by extrapolation from three node counts."""
        rows = [row for row in self.rows if row.group == "reference"]
        if len(rows) < len(self.finest):
            return Values()
        found = Row(**{name: rows[0][name] for name in RESULTS})
        first, second, third = rows
        limits = {name: extrapolate(first[name], second[name], third[name], RATIO) for name in RESULTS}
        return Values(
            nodes_per_loop=[float(row.nodes_per_loop) for row in rows],
            found=found,
            order={name: order for name, (order, _) in limits.items()},
            own_error=errors_of(found, Row(**{name: limit for name, (_, limit) in limits.items()}), self.scales),
            node_steps=rows[0].node_steps,
        )

    def _draw(self, own: Errors) -> None:
        from ..export.trade_figure import trade_figure

        trade_figure(self.out / "figures" / "trade.png", self._counted, astuple(own), title=self.base.scene.name)


def read_trade(path: Path) -> list[TradeRow]:
    """Rows of trade.csv, settings as text; none where the file is absent. Raises `RunDirectoryError` for another version."""
    rows = read_rows(path, TradeRow) if path.exists() else []
    if rows and (missing := set(COLUMNS) - set(vars(rows[0]))):
        raise RunDirectoryError(f"{path}: not of this version (no {', '.join(sorted(missing))}); start over with --force")
    return rows


def _repeats(row: TradeRow) -> int:
    return math.prod(int(part) for part in row.repeats.split("x"))


def extrapolate(finest: float, middle: float, coarsest: float, ratio: float) -> tuple[float, float]:
    """Order p and limit f of values at n, n/ratio and n/ratio^2 nodes (Richardson).

        f(n) = f + C n^-p        (f1 - f2)/(f2 - f3) = r^-p        f = f1 + (f1 - f2)/(r^p - 1)

    with f1 at the most nodes and r the ratio of successive node counts (Roache, J. Fluids Eng. 116 (1994) 405).
    The order is clipped to the accepted range, also where the differences do not decrease monotonically.
    """
    first, second = finest - middle, middle - coarsest
    apparent = math.log(second / first) / math.log(ratio) if first * second > 0.0 else 0.0
    order = min(max(apparent, MIN_ORDER), MAX_ORDER)
    return order, finest + first / (ratio**order - 1.0)


def pareto(points: Sequence[tuple[float, float]], least: float = 0.0) -> list[int]:
    """Indices of non-dominated (cost, error) points, by increasing cost. They end at the first error below `least`."""
    order = sorted(range(len(points)), key=lambda k: points[k])
    front: list[int] = []
    for k in order:
        if not front or least <= points[front[-1]][1] > points[k][1]:
            front.append(k)
    return front


def parameter_table(rows: Sequence[TradeRow]) -> list[Values]:
    """Effect of each parameter alone: cost relative to the unchanged scene, and errors."""
    base = next((row for row in rows if row.knob == BASE), None)
    if base is None:
        return []
    unchanged = f"alone: {base.point.removeprefix('alone: ')}"
    return [
        Values(
            knob=row.knob,
            value=row.point.removeprefix(unchanged).strip(),
            stop_reason=row.stop_reason,
            node_steps_over_base=row.node_steps / base.node_steps,
            price_over_base=row.cost / base.cost,
            cpu_over_base=row.cpu_s / base.cpu_s if base.cpu_s else None,
            **{f"error_{name}": row[f"error_{name}"] for name in ERRORS},
            largest_error_percent=row.summary.largest_error_percent,
        )
        for row in rows
        if row.group == "alone"
    ]


def trade_table(result: TradeSummary) -> ResultTable:
    """The table of a trade."""
    return ResultTable(tuple(trade_findings(result)), tuple(result.warnings), "trade.json")


def trade_findings(result: TradeSummary) -> Iterator[Finding]:
    """The rows of the table of a trade."""
    missing = f", {result.without_result} without a result" if result.without_result else ""
    yield heading(result.scene.name, f"{result.points} points{missing}", result.stop_reason)
    for reason, count in vars(result.without_result_by).items():
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
    """Cost and error of a point; `own` [%] is the error of the reference, the least known error."""
    error = point.largest_error_percent
    known = "no result" if error is None else _percent(error) + (", below the reference's own error" if error < own else "")
    return f"{rounded(point.price):,} node-steps, {known}"
