"""`warpknit trade`: all points of a study into a directory, with interrupt and resume.

DIR holds trade.csv, trade_knobs.csv (effect of each parameter alone), trade.json, scene.toml (resolved) and figures/trade.png.
"""

from __future__ import annotations

import logging
import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, astuple, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..base.errors import Diverged, InputError
from ..base.files import write_table
from ..base.text import rounded
from ..compute.device import find_device
from ..mechanics.numerics import slowest_rate
from ..mechanics.probe_settings import Varied
from ..mesh.layout import mesh_nodes
from ..results.row import Values, write_json
from ..runner.interrupts import Interrupted, Interrupts
from ..runner.progress_display import Display
from ..runner.run_directory import CommandResult, continues_earlier, finished_summary, open_directory
from ..scene import Scene, resolved_toml
from ..scene.capabilities import refuse
from ..solve.model import build_model, kind_of
from . import parameters
from .parameters import Overrides, Point
from .point import Errors, PointOutcome, Results, errors_of, run_point, scales_of, settings_of_scene
from .trade_table import TradeRow, TradeSummary, parameter_table, read_trade, write_trade

_log = logging.getLogger(__name__)

Loader = Callable[[Overrides, str | None], Scene]

RATIO = math.sqrt(2.0)  # ratio of successive node counts of the references
COST_LIMIT = 4.0  # times the node-steps of the reference: limit of a point
MIN_ORDER, MAX_ORDER = 1.0, 4.0  # accepted orders of convergence; outside, the differences are too small or too noisy
RAMP_NODES = 2_000  # largest mesh on which ramps in real time are tried: they take a hundred times the steps


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
    if resume and (finished := finished_summary(out, "trade.json", scene, "trade")) is not None:
        return CommandResult(0, TradeSummary.of(finished))
    resolved = resolved_toml(scene)
    keep = continues_earlier(out, "trade.csv", "trade", resolved, resume=resume, force=force)
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
        finest, self.tolerance = kind_of(truth).reference(truth, base.node_count)
        self.finest = [round(finest / RATIO**k) for k in range(3)]
        self._interrupts = Interrupts()

    def run(self) -> CommandResult[TradeSummary]:
        reason, code, message = "finished", 0, ""
        with self._interrupts.handled():
            try:
                for warning in self.base.warnings([]):
                    _log.warning("warning %s: %s", warning.code, warning)
                points = self._points()
                _log.info("%d settings to run", len(points) - len(self.rows))
                for number, point in enumerate(points, start=1):
                    self._interrupts.check()
                    self.display.stage(point.name, number=number, of=len(points))
                    self._run(point)
            except Interrupted:
                reason, code, message = "interrupted", 130, f"interrupted; finished settings are kept in {self.out}"
        summary = self._summary(reason)
        write_json(self.out / "trade.json", summary.json())
        if code == 0:
            knobs = [vars(row) for row in summary.knobs]
            columns = {name: np.array(["" if row[name] is None else row[name] for row in knobs]) for name in knobs[0]}
            write_table(self.out / "trade_knobs.csv", columns)
            self._draw(summary.reference.own_error)
        return CommandResult(code, summary, message)

    # --- points ---

    def _points(self) -> list[Point]:
        varied = kind_of(self.base.scene).varied(self.base.scene, self.base.softening)
        points = [*parameters.preset_points(self.base), *parameters.single_parameter_points(self.base, varied)]
        points += self._ramp_points(varied)
        points += parameters.combined_points(self.base, varied, self.finest[0])
        return [*parameters.reference_points(self.finest, self.tolerance), *filter(self._is_available, points)]

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

    @property
    def _limit(self) -> float:
        """Node-steps of a point, at most; none for the reference itself."""
        reference = next((row for row in self.rows if row.group == "reference"), None)
        return math.inf if reference is None else COST_LIMIT * reference.outcome.node_steps

    def _least_work(self, point: Point) -> float:
        """Least node-steps of a ramp, from loading time and first step; 0 of others."""
        scene = self._load(point)
        if scene.solver.drive != "ramp":
            return 0.0
        try:
            ramp = build_model(scene)
        except InputError:
            return 0.0
        return len(scene.stages) * ramp.loading_time / ramp.time_step * ramp.node_count

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
        yield from parameters.ramp_points(self.base, varied, 2.0 * math.pi / rate, model.time_step)

    def _run(self, point: Point) -> None:
        if any(row.point == point.name for row in self.rows):
            return
        is_reference = point.group == "reference"
        limit, least = self._limit, self._least_work(point)
        if least > limit:
            message = f"not run: at least {rounded(least):,} node-steps, where the limit is {rounded(limit):,}"
            outcome = PointOutcome(settings_of_scene(self._load(point)), None, "cost limit", message)
        else:
            outcome = run_point(
                lambda: self._load(point),
                device=self.device,
                max_node_steps=limit,
                monitor=lambda progress: self._interrupts.check(),
            )
        if is_reference and outcome.results is None:
            raise Diverged(f"the reference of {self.finest[0]} nodes a loop failed: {outcome.message}")
        self.rows.append(TradeRow(point.name, point.group, point.parameter, outcome))
        self._compute_errors()
        write_trade(self.path, self.rows)

    def _compute_errors(self) -> None:
        """Fill in errors against the finest reference; sums over a mesh are compared per repeat."""
        truth = self.rows[0].outcome.results
        assert truth is not None
        for row in self.rows:
            results = row.outcome.results
            if results is not None:
                sum_ = results.contact_force_sum_N * _repeats(self.rows[0]) / _repeats(row)
                row.errors = errors_of(replace(results, contact_force_sum_N=sum_), truth, self.scales)

    # --- results ---

    def _summary(self, reason: str) -> TradeSummary:
        if self.rows:
            self._compute_errors()
        counted, scene = self._counted, self.base.scene
        reference = self._reference()
        own = reference.own_error.largest_percent if "own_error" in reference else 0.0
        failed = [row.outcome.stop_reason for row in self.rows if row.outcome.results is None]
        return TradeSummary(
            scene=Values(name=scene.name, hash=scene.hash),
            stop_reason=reason,
            warnings=list(self.base.warnings([])),
            model=Values(
                kind=scene.model.kind,
                kind_reason=scene.kind_reason,
                friction=scene.contact.friction,
                friction_assumed="contact.friction" in scene.assumed,
            ),
            points=len(self.rows),
            without_result=len(failed),
            without_result_by=dict(Counter(failed)),
            reference=reference,
            front=[counted[k].summary for k in pareto([(row.cost, row.largest_error or 0.0) for row in counted], own)],
            presets=[row.summary for row in self.rows if row.group == "preset"],
            knobs=parameter_table(self.rows),
        )

    @property
    def _counted(self) -> list[TradeRow]:
        """The points with errors, without the reference."""
        return [row for row in self.rows if row.errors is not None and row.group != "reference"]

    def _reference(self) -> Values:
        """Results of the reference, and its own error by extrapolation from three node counts."""
        rows = [row for row in self.rows if row.group == "reference"]
        if len(rows) < len(self.finest):
            return Values()
        results = [row.outcome.results for row in rows]
        first, second, third = (asdict(each) for each in results if each is not None)
        limits = {name: extrapolate(first[name], second[name], third[name], RATIO) for name in first}
        extrapolated = Results(**{name: limit.limit for name, limit in limits.items()})
        assert results[0] is not None
        return Values(
            nodes_per_loop=[float(str(row.outcome.settings["nodes_per_loop"])) for row in rows],
            found=results[0],
            order={name: limit.order for name, limit in limits.items()},
            own_error=errors_of(results[0], extrapolated, self.scales),
            node_steps=rows[0].outcome.node_steps,
        )

    def _draw(self, own: Errors) -> None:
        from ..export.trade_figure import Mark, trade_figure

        marks = [Mark(row.cost, astuple(row.errors), row.group, row.preset) for row in self._counted if row.errors is not None]
        trade_figure(self.out / "figures" / "trade.png", marks, astuple(own), title=self.base.scene.name)


def _repeats(row: TradeRow) -> int:
    """Number of repeats of the mesh of a point."""
    return math.prod(int(part) for part in str(row.outcome.settings["repeats"]).split("x"))


@dataclass(frozen=True)
class Extrapolated:
    """Order of convergence, limit and error of one quantity."""

    order: float  # p, clipped to the accepted range
    limit: float  # f
    error: float  # of the finest value: |f1 - f|, more where the order is clipped


def extrapolate(finest: float, middle: float, coarsest: float, ratio: float) -> Extrapolated:
    """Richardson extrapolation to infinitely many nodes from values at n, n/ratio and n/ratio^2 nodes.

        f(n) = f + C n^-p        (f1 - f2)/(f2 - f3) = r^-p        f = f1 + (f1 - f2)/(r^p - 1)

    with f1 at the most nodes and r the ratio of successive node counts (Roache, J. Fluids Eng. 116 (1994) 405).
    Where the differences do not decrease monotonically by an order in the accepted range, that order is clipped, and the error is
    at least the larger difference.
    """
    first, second = finest - middle, middle - coarsest
    apparent = math.log(second / first) / math.log(ratio) if first * second > 0.0 else 0.0
    order = min(max(apparent, MIN_ORDER), MAX_ORDER)
    step = first / (ratio**order - 1.0)
    least = 0.0 if order == apparent else max(abs(first), abs(second))
    return Extrapolated(order, finest + step, max(abs(step), least))


def pareto(points: Sequence[tuple[float, float]], least: float = 0.0) -> list[int]:
    """Indices of non-dominated (cost, error) points, by increasing cost. They end at the first error below `least`."""
    order = sorted(range(len(points)), key=lambda k: points[k])
    front: list[int] = []
    for k in order:
        if not front or least <= points[front[-1]][1] > points[k][1]:
            front.append(k)
    return front
