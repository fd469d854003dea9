"""One point of a trade: a run of the scene at some settings, without files, and its errors."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .. import measure
from ..base.errors import Diverged, InputError
from ..base.text import rounded
from ..measure import MeshModel, Observables, table
from ..measure.table import Record
from ..results.row import Row, Values
from ..scene import Scene
from ..solve.model import build_model
from ..solve.simulate import Progress, Simulation

DOUBLE_COST = 1.8  # time of a node-step in double precision over that in single: docs/studies/performance.md
FORCE_FLOOR = 1e-3  # of EI/W^2 a pair: lower bound of the contact force in a relative error
STRAIN_FLOOR = 1e-3  # lower bound of the strain in a relative error, where tension drives
TENSION_FLOOR = 1e-3  # of EI/C^3: lower bound of the tension in a relative error


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
        simulation.compile()
    except InputError as error:
        return without_run("refused", str(error))

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
    return without_run(reason, message).changed(
        **settings_of(simulation.model),
        **({} if record is None else vars(results_of(record.observables))),
        wall_s=time.perf_counter() - wall,
        cpu_s=time.process_time() - cpu,
        steps=simulation.progress.steps,
        node_steps=node_steps(simulation),
    )


def without_run(stop_reason: str, message: str) -> TradeRow:
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


def settings_of(model: MeshModel) -> dict[str, object]:
    """Values of all parameters of a model: the columns of trade.csv."""
    ramp = model.scene.solver.drive == "ramp"
    of_ramp = {"loading_time_s": "loading_time", "damping_per_s": "damping", "body_mass_kg": "body_mass"}
    return settings_of_scene(model.scene) | {
        "contact_stiffness_N_per_m": model.contact_stiffness,
        "mass_scaling": 1.0 + model.added_mass if ramp else None,
        **{key: getattr(model, name, None) if ramp else None for key, name in of_ramp.items()},
    }


def settings_of_scene(scene: Scene) -> dict[str, object]:
    """Values of the parameters that stand in a scene."""
    solver = scene.solver
    return {
        "kind": scene.model.kind,
        "boundary": scene.model.boundary,
        "repeats": "x".join(map(str, scene.knit.repeats)),
        "nodes_per_loop": scene.model.nodes_per_loop,
        "merge_lenses": scene.model.merge_lenses,
        "drive": solver.drive,
        "precision": solver.precision,
        "axial_softening": solver.axial_softening,
        "residual_tolerance": solver.residual_tolerance,
        "multipliers": solver.multipliers,
        "levels": scene.output.levels,
        "target_time_step_s": solver.target_time_step,
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
