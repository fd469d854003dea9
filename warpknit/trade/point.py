"""One point of a trade: the scene with some settings, run without files; what it found and what it cost."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from .. import measure
from ..errors import Diverged, InputError
from ..measure import MeshModel, Observables, table
from ..measure.table import Record
from ..model import build_model
from ..scene import Scene
from ..solve.simulate import Progress, Simulation

FORCE_FLOOR = 1e-3  # of EI/W^2 a pair: what contact forces are compared with where contacts carry less
TENSION_FLOOR = 1e-3  # of EI/C^3: the same of tensions


@dataclass(frozen=True)
class Found:
    """What a mesh carries at the end of its last stage."""

    active_percent: float
    tension_weft_N_per_m: float  # of two hooked wires: the force [N] on the driven end, and 0
    tension_warp_N_per_m: float
    contact_force_sum_N: float
    contact_force_max_N: float
    stress_max_Pa: float


@dataclass(frozen=True)
class Outcome:
    """How a point ended; `found` is None where it did not come to its end."""

    settings: dict[str, object]
    found: Found | None
    stop_reason: str
    message: str = ""
    wall_s: float = 0.0
    cpu_s: float = 0.0  # of all threads together
    steps: int = 0
    node_steps: int = 0


class TooDear(Exception):
    """A point has cost more than it may."""


def run_point(
    load: Callable[[], Scene],
    *,
    device: str = "cpu",
    most_node_steps: float = math.inf,
    watch: Callable[[Progress], None],
) -> Outcome:
    """Run the scene that `load` returns; `watch` may raise to stop it.

    A scene that is refused, a run that diverges and one that takes more than `most_node_steps` are outcomes, not errors.
    """
    settings: dict[str, object] = {}
    try:
        simulation = Simulation(build_model(load(), device))
        simulation.compile()
    except InputError as error:
        return Outcome(settings, None, "refused", str(error))
    settings = settings_of(simulation.model)

    def look(progress: Progress) -> None:
        watch(progress)
        if node_steps(simulation) > most_node_steps:
            raise TooDear

    simulation.watch = look
    wall, cpu = time.perf_counter(), time.process_time()
    record: Record | None = None
    reason, message = "steady", ""
    try:
        for each in simulation.run():
            record = each
    except TooDear:
        reason, message, record = "too dear", f"stopped after {most_node_steps:.2g} node-steps", None
    except Diverged as error:
        reason, message, record = "diverged", str(error), None
    if record is not None and not record.steady:
        reason = "finished"
    return Outcome(
        settings=settings,
        found=None if record is None else found_at(record.observables),
        stop_reason=reason,
        message=message,
        wall_s=time.perf_counter() - wall,
        cpu_s=time.process_time() - cpu,
        steps=simulation.progress.steps,
        node_steps=node_steps(simulation),
    )


def node_steps(simulation: Simulation) -> int:
    """Steps times nodes of a mesh, and of the smaller meshes beside it."""
    drives, found = [simulation.drive], []
    while drives:
        one = drives.pop()
        if one not in found:
            found.append(one)
            drives += [other for other in (getattr(one, "smaller", None), getattr(one, "cell", None)) if other is not None]
    return sum(one.progress.steps * one.model.node_count for one in found)


def settings_of(model: MeshModel) -> dict[str, object]:
    """The knobs of a model as they stand, whichever were turned."""
    ramp = model.scene.solver.drive == "ramp"
    of_ramp = {"loading_time_s": "loading_time", "damping_per_s": "damping", "body_mass_kg": "body_mass"}
    return settings_of_scene(model.scene) | {
        "contact_stiffness_N_per_m": model.contact_stiffness,
        "mass_scaling": 1.0 + model.added_mass if ramp else None,
        **{key: getattr(model, name, None) if ramp else None for key, name in of_ramp.items()},
    }


def settings_of_scene(scene: Scene) -> dict[str, object]:
    """Those of them that a scene says."""
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
        "levels": scene.output.frames,
        "target_time_step_s": solver.target_time_step,
    }


def found_at(r: Observables) -> Found:
    """What a state says of the mesh."""
    found = Found(**table.values(r, Found.__dataclass_fields__))
    if r.hook_contact is None:
        return found
    return replace(found, tension_weft_N_per_m=abs(r.hook_contact.drive_force), tension_warp_N_per_m=0.0)


@dataclass(frozen=True)
class Scales:
    """What differences are divided by where the reference carries less [N, N/m, Pa]."""

    force: float
    tension: float
    stress: float


def scales_of(model: MeshModel) -> Scales:
    """The least forces that count: bending by about a wire diameter a loop."""
    wire = model.scene.wire
    bent = wire.youngs_modulus * wire.radius * wire.diameter / model.scene.knit.wale_spacing**2
    tension = TENSION_FLOOR * measure.tension_scale(model)
    force = FORCE_FLOOR * measure.force_scale(model)
    return Scales(force * model.pair_count, force if model.scene.hook is not None else tension, bent)


@dataclass(frozen=True)
class Errors:
    """Differences from the reference: of the active share in points of percent, the others relative."""

    active_percent: float
    tension: float  # the larger of weft and warp, over the larger tension of the reference
    contact_force: float  # of the sum over all contacts
    stress: float  # of the largest

    @property
    def largest_percent(self) -> float:
        return max(self.active_percent, 100.0 * self.tension, 100.0 * self.contact_force, 100.0 * self.stress)


def errors_of(found: Found, reference: Found, scales: Scales) -> Errors:
    """How far a point is from the reference."""
    pulled = np.array([reference.tension_weft_N_per_m, reference.tension_warp_N_per_m])
    missed = np.array([found.tension_weft_N_per_m, found.tension_warp_N_per_m]) - pulled
    force, stress = reference.contact_force_sum_N, reference.stress_max_Pa
    return Errors(
        active_percent=abs(found.active_percent - reference.active_percent),
        tension=float(np.abs(missed).max() / max(np.abs(pulled).max(), scales.tension)),
        contact_force=abs(found.contact_force_sum_N - force) / max(force, scales.force),
        stress=abs(found.stress_max_Pa - stress) / max(stress, scales.stress),
    )
