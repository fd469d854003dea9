"""`warpknit trade`: all points of a study into a directory, with interrupt and resume.

DIR holds trade.csv, trade_knobs.csv (effect of each parameter alone), trade.json, scene.toml (resolved) and figures/trade.png.
"""

from __future__ import annotations

import json
import logging
import math
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from ..base.files import write_aside, write_table
from ..base.text import rounded
from ..compute.device import find_device
from ..errors import Diverged, InputError
from ..mechanics.numerics import slowest_rate
from ..mechanics.trial import Varied
from ..mesh.layout import mesh_nodes
from ..runner.interrupts import Interrupted, Interrupts
from ..runner.progress_display import Progress as Display
from ..runner.run_directory import CommandResult, continues_earlier, finished_result, open_directory
from ..scene import Scene, resolved_toml
from ..scene.capabilities import refuse
from ..solve.model import build_model, trials_of
from . import parameters
from .extrapolation import extrapolate
from .parameters import Overrides, Point
from .pareto import pareto
from .point import Errors, Outcome, Results, errors_of, run_point, scales_of, settings_of_scene
from .trade_summary import columns_of, parameter_table, point_summary
from .trade_table import TradeRow, read_rows, write_rows

_log = logging.getLogger(__name__)

Loader = Callable[[Overrides, str | None], Scene]

RATIO = math.sqrt(2.0)  # ratio of successive node counts of the references
COST_LIMIT = 4.0  # times the node-steps of the reference: limit of a point
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
) -> CommandResult:
    """Measure speed against accuracy of a scene into the directory `out`.

    `load` returns the scene with more overrides and a preset; `against` is the `model.kind` of the reference. Raises
    `SceneError`, `RunDirectoryError`, `DeviceError`, `ModelError`, `KnitError` before anything is written, and `Diverged` where
    the reference does. An interrupt ends with exit_code 130 and keeps the finished points.
    """
    scene = load((), None)
    refuse(scene, "trade")
    of_reference: Overrides = (("model.kind", against),) if against else ()
    load(of_reference, None)  # refused before anything is written
    if resume and (finished := finished_result(out, "trade.json", scene.hash, "trade")) is not None:
        return finished
    resolved = resolved_toml(scene)
    keep = continues_earlier(out, "trade.csv", "trade", resolved, resume=resume, force=force)
    name = find_device(device, nodes=lambda: mesh_nodes(scene))
    base = build_model(scene, name)
    open_directory(out, resolved, keep=keep)
    return _Study(load, base, of_reference, name, out, progress or Display()).run()


class _Study:
    """Runs the remaining points and writes their results."""

    def __init__(self, load: Loader, base: Any, of_reference: Overrides, device: str, out: Path, display: Display) -> None:
        self.load_with, self.base, self.device, self.out, self.display = load, base, device, out, display
        self.of_kind: Overrides = (("model.kind", base.scene.model.kind),)
        self.of_reference = of_reference
        self.scales = scales_of(base)
        self.path = out / "trade.csv"
        self.rows = read_rows(self.path)
        truth = load(of_reference, None)
        finest, self.tolerance = trials_of(truth).reference(truth, base.node_count)
        self.finest = [round(finest / RATIO**k) for k in range(3)]
        self._interrupts = Interrupts()

    def run(self) -> CommandResult:
        reason, code, message = "finished", 0, ""
        with self._interrupts.handled():
            try:
                for warning in self.base.warnings([]):
                    _log.warning("warning: %s", warning)
                points = self._points()
                _log.info("%d points to run", len(points) - len(self.rows))
                for number, point in enumerate(points, start=1):
                    self._interrupts.check()
                    self.display.stage(point.name, number=number, of=len(points))
                    self._run(point)
            except Interrupted:
                reason, code, message = "interrupted", 130, f"interrupted; finished points are kept in {self.out}"
        summary = self._summary(reason)
        with write_aside(self.out / "trade.json") as file:
            json.dump(summary, file, indent=2, allow_nan=False)
        if code == 0:
            write_table(self.out / "trade_knobs.csv", columns_of(summary["knobs"]))
            self._draw()
        return CommandResult(code, summary, message)

    # --- points ---

    def _points(self) -> list[Point]:
        varied = trials_of(self.base.scene).varied(self.base.scene, self.base.softening)
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
        """The scene of a point, in the kind of model of the scene or of the reference."""
        last = self.of_reference if point.group == "reference" else ()
        return self.load_with((*self.of_kind, *point.overrides, *last), point.preset)

    @property
    def _limit(self) -> float:
        """Node-steps of a point, at most; none for the reference itself."""
        reference = next((row for row in self.rows if row.group == "reference"), None)
        return math.inf if reference is None else COST_LIMIT * reference.outcome.node_steps

    def _least_work(self, point: Point) -> float:
        """Node-steps that a ramp takes at least, from its loading time and its first step; 0 of others."""
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
            outcome = Outcome(settings_of_scene(self._load(point)), None, "cost limit", message)
        else:
            outcome = run_point(
                lambda: self._load(point),
                device=self.device,
                max_node_steps=limit,
                watch=lambda progress: self._interrupts.check(),
            )
        if is_reference and outcome.results is None:
            raise Diverged(f"the reference of {self.finest[0]} nodes a loop failed: {outcome.message}")
        self.rows.append(TradeRow(point.name, point.group, point.parameter, outcome))
        self._compute_errors()
        write_rows(self.path, self.rows)

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

    def _summary(self, reason: str) -> dict[str, Any]:
        from .. import __version__

        if self.rows:
            self._compute_errors()
        counted = [row for row in self.rows if row.errors is not None and row.group != "reference"]
        reference = self._reference()
        own = Errors(**reference["own_error"]).largest_percent if reference else 0.0
        costs_and_errors = [(row.cost, row.errors.largest_percent) for row in counted if row.errors is not None]
        return {
            "scene": {"name": self.base.scene.name, "hash": self.base.scene.hash},
            "version": __version__,
            "stop_reason": reason,
            "warnings": list(self.base.warnings([])),
            "model": {"kind": self.base.scene.model.kind, "kind_reason": self.base.scene.kind_reason},
            "points": len(self.rows),
            "without_result": sum(row.outcome.results is None for row in self.rows),
            "without_result_by": dict(Counter(row.outcome.stop_reason for row in self.rows if row.outcome.results is None)),
            "reference": reference,
            "front": [point_summary(counted[k]) for k in pareto(costs_and_errors, own)],
            "presets": [point_summary(row) for row in self.rows if row.group == "preset"],
            "knobs": parameter_table(self.rows),
        }

    def _reference(self) -> dict[str, Any]:
        """Results of the reference, and its own error by extrapolation from three node counts."""
        rows = [row for row in self.rows if row.group == "reference"]
        if len(rows) < len(self.finest):
            return {}
        results = [row.outcome.results for row in rows]
        first, second, third = (asdict(each) for each in results if each is not None)
        nodes = [float(str(row.outcome.settings["nodes_per_loop"])) for row in rows]
        limits = {name: extrapolate(first[name], second[name], third[name], RATIO) for name in first}
        extrapolated = Results(**{name: limit.limit for name, limit in limits.items()})
        assert results[0] is not None
        return {
            "nodes_per_loop": nodes,
            "found": first,
            "order": {name: limit.order for name, limit in limits.items()},
            "own_error": asdict(errors_of(results[0], extrapolated, self.scales)),
            "node_steps": rows[0].outcome.node_steps,
        }

    def _draw(self) -> None:
        from ..export.trade_figure import Mark, trade_figure

        marks = [
            Mark(row.cost, tuple(asdict(row.errors).values()), row.group, row.preset)
            for row in self.rows
            if row.errors is not None and row.group != "reference"
        ]
        own = self._reference()["own_error"]
        trade_figure(self.out / "figures" / "trade.png", marks, tuple(own.values()), title=self.base.scene.name)


def _repeats(row: TradeRow) -> int:
    """Number of repeats of the mesh of a point."""
    return math.prod(int(part) for part in str(row.outcome.settings["repeats"]).split("x"))
