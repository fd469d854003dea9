"""The points of a trade: numerical parameters of a scene with their values, runs of the scene without files, and their errors."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from .. import measure
from ..base.errors import Diverged, InputError
from ..base.text import rounded
from ..measure import MeshModel, Observables, table
from ..measure.table import Record
from ..mechanics.probe_settings import Varied, setting_of
from ..mechanics.protocols import Model
from ..results.row import Row, Values
from ..scene import Scene
from ..scene.presets import PRESETS
from ..solve.model import build_model
from ..solve.simulate import Progress, Simulation

DOUBLE_COST = 1.8  # time of a node-step in double precision over that in single: docs/studies/performance.md
FORCE_FLOOR = 1e-3  # of EI/W^2 a pair: lower bound of the contact force in a relative error
STRAIN_FLOOR = 1e-3  # lower bound of the strain in a relative error, where tension drives
TENSION_FLOOR = 1e-3  # of EI/C^3: lower bound of the tension in a relative error

Overrides = tuple[tuple[str, object], ...]

BASE = "base"  # name of the point with no parameter changed
STIFFNESSES = (0.25, 4.0, 16.0)  # times what the model chooses
LEVELS = (1, 2, 5, 10, 20)
OF_SOLVER = ("drive", "precision", "axial_softening", "residual_tolerance", "multipliers")  # parameters
PERIODS = (1.0, 3.0, 10.0, 30.0)  # slowest periods over which a ramp loads
DAMPINGS = (0.1, 0.3, 3.0)  # times the slowest angular frequency
SCALINGS = (100.0, 1e4)  # of all masses
STEPS = (3.0, 10.0)  # times the step that the real masses allow, reached by raising the masses of the nodes that limit it
BODY_MASSES = (0.1, 2.0)  # over half a loop of wire
RAMP_SOFTENINGS = (1.0, 100.0)


@dataclass(frozen=True)
class Point:
    """A point of a trade: overrides of the scene, and the group of the point."""

    group: str  # reference | preset | alone | together
    parameter: str  # the varied one; the preset; empty where several are
    overrides: Overrides
    preset: str | None = None

    @property
    def name(self) -> str:
        """Unique name, the same in every run of a study."""
        settings = " ".join(f"{key}={value}" for key, value in self.overrides)
        return f"{self.group}: {' '.join(part for part in (self.preset or '', settings) if part)}"


def reference_points(finest: Sequence[int], tolerance: float) -> list[Point]:
    """Reference runs: double precision, tightest tolerance, the finest first."""
    fixed = (("solver.precision", "double"), ("solver.residual_tolerance", tolerance), ("solver.drive", "relax"))
    softening = ("solver.axial_softening", PRESETS["reference"]["planar", "relax"].axial_softening)
    return [Point("reference", "", (("model.nodes_per_loop", n), *fixed, softening)) for n in finest]


def preset_points(base: Model) -> list[Point]:
    """The presets, which override the keys of the scene that they set."""
    drive = base.scene.solver.drive
    return [
        Point("preset", name, (
            ("model.nodes_per_loop", preset.nodes_per_loop), ("solver.axial_softening", preset.axial_softening),
            ("solver.residual_tolerance", preset.residual_tolerance),
        ), preset=name)
        for name, preset in ((name, presets[base.scene.model.kind, drive]) for name, presets in PRESETS.items())
    ]  # fmt: skip


def single_parameter_points(base: Model, varied: Varied) -> Iterator[Point]:
    """The scene itself, then one parameter varied at a time."""
    scene = base.scene
    preset = scene.solver.preset
    yield Point("alone", BASE, (), preset=preset)
    for parameter, key, values in _relaxation_parameters(base, varied):
        for value in values:
            yield Point("alone", parameter, ((key, value),), preset=preset)
    if scene.hook is None and scene.model.boundary == "gripped" and scene.panel.outline == "rectangle":
        for boundary, repeats in (("periodic", [1, 1]), ("gripped", [2, 2]), ("gripped", [4, 4])):
            overrides = (("model.boundary", boundary), ("knit.repeats", repeats))
            yield Point("alone", "size", overrides, preset=preset)


def _relaxation_parameters(base: Model, varied: Varied) -> Iterator[tuple[str, str, Sequence[object]]]:
    yield "nodes_per_loop", "model.nodes_per_loop", varied.nodes_per_loop
    yield "axial_softening", "solver.axial_softening", [_rounded(value) for value in varied.axial_softening]
    yield "residual_tolerance", "solver.residual_tolerance", varied.residual_tolerance
    yield "contact_stiffness", "contact.stiffness", [_rounded(factor * base.contact_stiffness) for factor in STIFFNESSES]
    yield "precision", "solver.precision", ("single", "double")
    yield "multipliers", "solver.multipliers", (False,)
    yield "levels", "output.frames", LEVELS
    if base.scene.hook is None:
        yield "merge_lenses", "model.merge_lenses", (not base.scene.model.merge_lenses,)


def ramp_points(base: Model, varied: Varied, period: float, time_step: float) -> Iterator[Point]:
    """A ramp, then each parameter varied. period [s]: of the slowest mode; time_step [s]: the stable one of the ramp."""
    rate, preset = 2.0 * math.pi / period, base.scene.solver.preset
    drive = ("solver.drive", "ramp")
    yield Point("alone", "drive", (drive,), preset=preset)
    for parameter, key, values in (
        ("loading_time", "solver.loading_time", [_rounded(k * period) for k in PERIODS]),
        ("damping", "solver.damping", [_rounded(k * rate) for k in DAMPINGS]),
        ("target_time_step", "solver.target_time_step", [_rounded(k * time_step) for k in STEPS]),
        ("body_mass", "contact.body_mass", BODY_MASSES),
        ("ramp_softening", "solver.axial_softening", RAMP_SOFTENINGS),
        ("ramp_nodes", "model.nodes_per_loop", varied.ramp_nodes_per_loop),
        ("mass_scaling", "solver.mass_scaling", SCALINGS),  # of every period: the loading time is unchanged in periods
    ):
        for value in values:
            yield Point("alone", parameter, (drive, (key, value)), preset=preset)


def combined_points(base: Model, varied: Varied, finest: int) -> Iterator[Point]:
    """Several parameters varied together."""
    _nodes, *others = setting_of(base.scene).overrides
    for setting in varied.combined:
        changed = tuple(each for each in setting.overrides if each not in others)
        if setting.nodes_per_loop < finest and len(changed) > 1:
            yield Point("together", "", changed)


def _rounded(value: float) -> float:
    """The value to three digits, for the tables."""
    return float(f"{value:.3g}")


class TradeRow(Row):
    """One point of a trade: the columns of trade.csv in their order. None where a point has no result, or no reference yet."""

    preset: str  # name of the preset of this point; empty where it is none
    group: str  # reference | preset | alone | together
    knob: str  # the parameter that is varied
    kind: str  # settings: words where they were read from a file
    boundary: str
    repeats: str
    nodes_per_loop: str
    merge_lenses: str
    drive: str
    precision: str
    axial_softening: str
    contact_stiffness_N_per_m: str
    residual_tolerance: str
    multipliers: str
    levels: str
    mass_scaling: str
    target_time_step_s: str
    loading_time_s: str
    damping_per_s: str
    body_mass_kg: str
    wall_s: float
    cpu_s: float  # of all threads together
    steps: int
    node_steps: int
    error_active_percent: float  # against the reference, as `Errors`
    error_tension: float
    error_contact_force: float
    error_stress: float
    active_percent: float  # results at the end of the last stage
    tension_weft_N_per_m: float  # of two hooked wires: the force [N] on the driven end, and 0
    tension_warp_N_per_m: float
    contact_force_sum_N: float
    contact_force_max_N: float
    stress_max_Pa: float
    strain_weft: float
    strain_warp: float
    stop_reason: str
    message: str
    point: str  # unique name

    @property
    def has_results(self) -> bool:
        """Whether the run came to its end."""
        return self.stress_max_Pa is not None

    @property
    def errors(self) -> Errors | None:
        """Errors against the reference, once there is one."""
        errors = [self[f"error_{name}"] for name in ERRORS]
        return None if None in errors else Errors(*errors)

    @property
    def cost(self) -> float:
        """Node-steps, weighted by DOUBLE_COST in double precision."""
        return float(self.node_steps * (DOUBLE_COST if self.precision == "double" else 1.0))

    @property
    def summary(self) -> Values:
        """Name, cost and errors, for trade.json."""
        errors = self.errors
        return Values(
            point=self.point, node_steps=self.node_steps, price=self.cost, cpu_s=self.cpu_s,
            largest_error_percent=errors and errors.largest_percent, errors=errors,
        )  # fmt: skip


COLUMNS = tuple(TradeRow.__annotations__)
RESULTS = COLUMNS[COLUMNS.index("active_percent") : COLUMNS.index("stop_reason")]


class CostLimitExceeded(Exception):
    """A run took more node-steps than its limit."""


def run_point(
    load: Callable[[], Scene],
    *,
    device: str = "cpu",
    max_node_steps: float = math.inf,
    monitor: Callable[[Progress], None] = lambda _: None,
) -> TradeRow:
    """Run the scene that `load` returns; `monitor` may raise to stop it.

    A refused scene, a diverged run and one that exceeds `max_node_steps` are outcomes, not errors.
    """
    try:
        simulation = Simulation(build_model(load(), device))
        model, least = simulation.model, 0.0  # of a ramp: node-steps by its loading time and first step
        settings = settings_of(model)
        if model.scene.solver.drive == "ramp":
            least = len(model.scene.stages) * model.loading_time / model.time_step * model.node_count
        if least > max_node_steps:
            limit = f"where the limit is {rounded(max_node_steps):,}"
            return _ended("cost limit", f"not run: at least {rounded(least):,} node-steps, {limit}").changed(**settings)
        simulation.compile()
    except InputError as error:
        return _ended("refused", str(error))

    def check_cost(progress: Progress) -> None:
        monitor(progress)
        if node_steps(simulation) > max_node_steps:
            raise CostLimitExceeded

    simulation.monitor = check_cost
    wall, cpu = time.perf_counter(), time.process_time()
    record: Record | None = None
    reason, message = "steady", ""
    try:
        for each in simulation.run():
            record = each
        check_cost(simulation.progress)
    except CostLimitExceeded:
        reason, message, record = "cost limit", f"stopped after {rounded(max_node_steps):,} node-steps", None
    except Diverged as error:
        reason, message, record = "diverged", str(error), None
    if record is not None and not record.steady:
        reason = "finished"
    return _ended(reason, message).changed(
        **settings,
        **({} if record is None else vars(results_of(record.observables))),
        wall_s=time.perf_counter() - wall,
        cpu_s=time.process_time() - cpu,
        steps=simulation.progress.steps,
        node_steps=node_steps(simulation),
    )


def _ended(stop_reason: str, message: str) -> TradeRow:
    """A point without settings, results and costs."""
    row = TradeRow(**dict.fromkeys(COLUMNS))
    return row.changed(wall_s=0.0, cpu_s=0.0, steps=0, node_steps=0, stop_reason=stop_reason, message=message)


def node_steps(simulation: Simulation) -> int:
    """Steps times nodes, of the mesh and of its smaller meshes."""
    pending, drives = [simulation.drive], []
    while pending:
        drive = pending.pop()
        if drive not in drives:
            drives.append(drive)
            pending += [other for other in (getattr(drive, "smaller", None), getattr(drive, "cell", None)) if other is not None]
    return sum(drive.progress.steps * drive.model.node_count for drive in drives)


def settings_of(model: Model) -> dict[str, object]:
    """Values of all parameters of a model: the columns of trade.csv."""
    scene, solver = model.scene, model.scene.solver
    ramp = solver.drive == "ramp"
    of_ramp = {"loading_time_s": "loading_time", "damping_per_s": "damping", "body_mass_kg": "body_mass"}
    return {
        **{name: getattr(scene.model, name) for name in ("kind", "boundary", "nodes_per_loop", "merge_lenses")},
        **{name: getattr(solver, name) for name in OF_SOLVER},
        "repeats": "x".join(map(str, scene.knit.repeats)),
        "contact_stiffness_N_per_m": model.contact_stiffness,
        "levels": scene.output.levels,
        "mass_scaling": 1.0 + model.added_mass if ramp else None,
        "target_time_step_s": solver.target_time_step,
        **{key: getattr(model, name, None) if ramp else None for key, name in of_ramp.items()},
    }


def results_of(r: Observables) -> Row:
    """Results of a state."""
    results = Row(**table.values(r, RESULTS))
    if r.hook_contact is None:
        return results
    return results.changed(tension_weft_N_per_m=abs(r.hook_contact.drive_force), tension_warp_N_per_m=0.0)


@dataclass(frozen=True)
class Scales:
    """Lower bounds of the reference values that errors are divided by [N, N/m, Pa]."""

    force: float
    tension: float
    stress: float
    by_tension: tuple[bool, bool] = (False, False)  # whether weft and warp are driven by tension: their strain is the result


def scales_of(model: MeshModel) -> Scales:
    """Scales of a mesh: bending each loop by about a wire diameter."""
    wire = model.scene.wire
    bent = wire.youngs_modulus * wire.radius * wire.diameter / model.scene.knit.wale_spacing**2
    tension = TENSION_FLOOR * measure.tension_scale(model)
    force = FORCE_FLOOR * measure.force_scale(model)
    is_hook, (*_, last) = model.scene.hook is not None, model.scene.stages
    return Scales(force * model.pair_count, force if is_hook else tension, bent, last.by_tension)


@dataclass(frozen=True)
class Errors:
    """Errors against the reference: relative; of the active share in percentage points."""

    active_percent: float
    tension: float  # the larger of weft and warp, over the larger of the reference; of the strain where tension drives
    contact_force: float  # of the sum over all contacts
    stress: float  # of the largest

    @property
    def largest_percent(self) -> float:
        return max(self.active_percent, 100.0 * self.tension, 100.0 * self.contact_force, 100.0 * self.stress)


def errors_of(results: Row, reference: Row, scales: Scales) -> Errors:
    """Errors of results relative to the reference."""
    by_tension = np.array(scales.by_tension)

    def larger(what: str, counts: np.ndarray, least: float) -> float:
        found, true = (np.array([row[what.format(side)] for side in ("weft", "warp")]) for row in (results, reference))
        return float(np.abs(found - true)[counts].max(initial=0.0) / max(np.abs(true).max(), least))

    tension = larger("tension_{}_N_per_m", ~by_tension, scales.tension)
    strain = larger("strain_{}", by_tension, STRAIN_FLOOR)
    force, stress = reference.contact_force_sum_N, reference.stress_max_Pa
    return Errors(
        active_percent=abs(results.active_percent - reference.active_percent),
        tension=max(tension, strain),
        contact_force=abs(results.contact_force_sum_N - force) / max(force, scales.force),
        stress=abs(results.stress_max_Pa - stress) / max(stress, scales.stress),
    )


ERRORS = tuple(Errors.__dataclass_fields__)
