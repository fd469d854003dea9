"""One point of a trade: a run of the scene at some settings, without files."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from .. import measure
from ..base.errors import Diverged, InputError
from ..base.text import rounded
from ..measure import MeshModel, Observables, table
from ..measure.table import Record
from ..scene import Scene
from ..solve.model import build_model
from ..solve.simulate import Progress, Simulation

FORCE_FLOOR = 1e-3  # of EI/W^2 a pair: lower bound of the contact force in a relative error
STRAIN_FLOOR = 1e-3  # lower bound of the strain in a relative error, where tension drives
TENSION_FLOOR = 1e-3  # of EI/C^3: lower bound of the tension in a relative error


@dataclass(frozen=True)
class Results:
    """Results at the end of the last stage."""

    active_percent: float
    tension_weft_N_per_m: float  # of two hooked wires: the force [N] on the driven end, and 0
    tension_warp_N_per_m: float
    contact_force_sum_N: float
    contact_force_max_N: float
    stress_max_Pa: float
    strain_weft: float = 0.0
    strain_warp: float = 0.0


@dataclass(frozen=True)
class PointOutcome:
    """Settings, results and cost of a point; `results` is None where the run did not finish."""

    settings: dict[str, object]
    results: Results | None
    stop_reason: str
    message: str = ""
    wall_s: float = 0.0
    cpu_s: float = 0.0  # of all threads together
    steps: int = 0
    node_steps: int = 0


class CostLimitExceeded(Exception):
    """A run took more node-steps than its limit."""


def run_point(
    load: Callable[[], Scene],
    *,
    device: str = "cpu",
    max_node_steps: float = math.inf,
    monitor: Callable[[Progress], None],
) -> PointOutcome:
    """Run the scene that `load` returns; `monitor` may raise to stop it.

    A refused scene, a diverged run and one that exceeds `max_node_steps` are outcomes, not errors.
    """
    settings: dict[str, object] = {}
    try:
        simulation = Simulation(build_model(load(), device))
        simulation.compile()
    except InputError as error:
        return PointOutcome(settings, None, "refused", str(error))
    settings = settings_of(simulation.model)

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
    return PointOutcome(
        settings=settings,
        results=None if record is None else results_of(record.observables),
        stop_reason=reason,
        message=message,
        wall_s=time.perf_counter() - wall,
        cpu_s=time.process_time() - cpu,
        steps=simulation.progress.steps,
        node_steps=node_steps(simulation),
    )


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


def results_of(r: Observables) -> Results:
    """Results of a state."""
    results = Results(**table.values(r, Results.__dataclass_fields__))
    if r.hook_contact is None:
        return results
    return replace(results, tension_weft_N_per_m=abs(r.hook_contact.drive_force), tension_warp_N_per_m=0.0)


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


def errors_of(results: Results, reference: Results, scales: Scales) -> Errors:
    """Errors of results relative to the reference."""
    by_tension = np.array(scales.by_tension)

    def larger(of: Callable[[Results], tuple[float, float]], counts: np.ndarray, least: float) -> float:
        found, true = np.array(of(results)), np.array(of(reference))
        return float(np.abs(found - true)[counts].max(initial=0.0) / max(np.abs(true).max(), least))

    tension = larger(lambda r: (r.tension_weft_N_per_m, r.tension_warp_N_per_m), ~by_tension, scales.tension)
    strain = larger(lambda r: (r.strain_weft, r.strain_warp), by_tension, STRAIN_FLOOR)
    force, stress = reference.contact_force_sum_N, reference.stress_max_Pa
    return Errors(
        active_percent=abs(results.active_percent - reference.active_percent),
        tension=max(tension, strain),
        contact_force=abs(results.contact_force_sum_N - force) / max(force, scales.force),
        stress=abs(results.stress_max_Pa - stress) / max(stress, scales.stress),
    )
