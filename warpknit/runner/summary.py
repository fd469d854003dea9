"""summary.json: results of a run in SI units (docs/scenes.md has the keys).

Keys beside the measures (measure/table.py), a panel (panel_report.py) and the answers (answers.py). An undefined value is null.

    scene.name                               name of the scene
    scene.hash                               hash of its values
    version                                  version of warpknit
    device                                   device that computed it
    stop_reason                              `steady` (converged), `finished` (a ramp that had not converged at its end),
                                             `diverged`, `interrupted`
    message                                  why a run stopped early
    warnings                                 limits to the use of this result
    model.kind                               planar or spatial
    model.kind_reason                        why: chosen in the scene, the default, or what exists only in the planar model
    model.source                             table of the scene that gives the wires: `knit`, `hook` or `wires`
    model.warnings                           why the model is not valid for this mesh, the gravest first; also in `warnings`
    model.boundary                           `periodic`, `gripped` or that of wires from a file
    model.precision                          `single` or `double`
    model.wires                              wires of the mesh
    model.nodes                              nodes of the mesh
    model.repeats                            repeats of the knit in weft and warp
    model.bodies                             contact bodies, or in space places where two wires hook; of wires from a file also
                                             where they cross or come near each other
    model.pairs                              two of each body
    model.rest_curve_error                   largest error of the contact curve in the reference state, over d
    solver.time_step_s                       step of the unloaded mesh; 1 for a relaxation, which has fictitious masses
    solver.steps                             time steps of the run
    solver.wall_s                            wall time of steps, convergence checks and files, of all parts of a resumed run;
                                             without building the model and compilation
    solver.compile_s                         time of compilation; 0 if the kernels were compiled before
    solver.ranks                             processes under `mpirun`
    solver.node_steps_per_s                  steps times nodes over the wall time
    solver.mass_scaling                      mass of a ramp over the real mass
    solver.axial_softening                   divisor of the axial stiffness that was used in the dynamics at the start of the run:
                                             at most that of the scene; in space bending limits it
    solver.preset                            preset of the settings
    solver.preset_error_percent              measured error of the preset; null if keys of the scene override its settings
    solver.drive                             `relax` or `ramp`
    quality.kinetic_to_internal              largest kinetic over stored energy of the states that count as results
    quality.energy_balance                   work less stored, dissipated and kinetic energy, over the larger of stored energy
                                             and EI/W a loop
    quality.energy_balance_of_stored         the same over the largest stored energy so far; needs four `output.frames` or more
    quality.penetration_max                  largest overlap of all records, over d
    quality.estimated_error                  with `run --error`: largest of the four below as a fraction, with a margin of 30 %
                                             and 0.2 %
    quality.estimated_errors.active_percent  estimated error of the share of active contacts, in percentage points
    quality.estimated_errors.tension         estimated relative error of the tension
    quality.estimated_errors.contact_force   estimated relative error of the contact forces
    quality.estimated_errors.stress          estimated relative error of the largest stress
    wire.stress_max_so_far_Pa                largest stress of all records so far
    probes                                   last values of the probes of `run`, by their names
    jumps                                    pairs of `index`: neighbouring records between which the mesh jumps to another
                                             branch of equilibria; in a change of temperature also where it is strained by far
                                             more than free wire
    answers                                  what a designer asks, see below; null for a `[hook]`
    stages                                   the same groups at the end of each stage, with its `name`
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from .. import __version__, measure
from ..measure import MeshModel, table
from ..measure.jumps import STORED_FLOOR
from ..measure.table import Record
from .answers import answers_of
from .branches import jumps_of
from .history import Row, missing_work
from .warnings_of import warnings_of


def stage_summary(
    record: Record, rows: list[Row], panel: dict[str, Any] | None = None, probes: Sequence[str] = ()
) -> dict[str, Any]:
    """Measures at the end of a stage, by section (measure/table.py).

    `rows` are all rows up to it, `panel` is the section of a panel, `probes` are the names of probes.
    """
    model, row = record.observables.model, vars(rows[-1])
    sections: dict[str, dict[str, Any]] = {}
    for line in table.MEASURES:
        value = None
        if line.summary:
            value = row.get(line.name) if line.history else line.value(record)
        if value is not None:
            sections.setdefault(line.summary, {})[line.name] = value
    sections["quality"] |= {
        "kinetic_to_internal": kinetic_to_internal(rows, model),
        "energy_balance": energy_balance(rows, model),
        "energy_balance_of_stored": energy_balance_of_stored(rows, model),
        "penetration_max": max(each.penetration for each in rows),
    }
    sections["wire"]["stress_max_so_far_Pa"] = max(each.stress_max_Pa for each in rows)
    if probes:
        sections["probes"] = {name: row[name] for name in probes}
    return {"name": record.stage, **sections} | ({} if panel is None else {"panel": panel})


def kinetic_to_internal(rows: list[Row], model: MeshModel) -> float:
    """Largest kinetic over stored energy: of equilibria, or of a ramp after a tenth of its load."""
    counted = [row for row in rows if (row.steady or row.load_factor > 0.1) and row.stored > 0.0 and row.load_factor > 0.0]
    floor = 1e-12 * measure.energy_scale(model)
    return max((row.energy_kinetic_J / max(row.stored, floor) for row in counted), default=0.0)


def energy_balance(rows: list[Row], model: MeshModel) -> float:
    """Work in less stored, dissipated and kinetic energy of the last row, over the larger of stored and EI/W a loop.

    The damping of a ramp counts as dissipated; a relaxation follows equilibria, where damping dissipates nothing.
    """
    return missing_work(rows[-1], model) / max(rows[-1].stored, measure.energy_scale(model))


def energy_balance_of_stored(rows: list[Row], model: MeshModel) -> float:
    """The same over the largest stored energy so far; 0 where almost none was stored."""
    largest = max(row.stored for row in rows)
    least = STORED_FLOOR * measure.energy_scale(model)
    return missing_work(rows[-1], model) / largest if largest > least else 0.0


@dataclass(frozen=True)
class Estimate:
    """Estimated errors of the last state of a run."""

    error: float | None  # the largest of the four below, relative; None where there is no estimate
    active_percent: float | None = None  # percentage points
    tension: float | None = None
    contact_force: float | None = None
    stress: float | None = None
    warning: str = ""


def run_summary(
    model: MeshModel,
    rows: list[Row],
    stages: list[dict[str, Any]],
    *,
    stop_reason: str,
    wall: float,
    compile_time: float,
    steps: int,
    message: str = "",
    notes: Sequence[str] = (),
    estimate: Estimate | None = None,
) -> dict[str, Any]:
    """All of summary.json, with the values of the last stage on top. `notes` come from the drive."""
    estimate = estimate or Estimate(None)
    scene, panel, jumps, of_model = model.scene, model.panel, jumps_of(model, rows), list(model.warnings(stages))
    last = {key: value for key, value in stages[-1].items() if key != "name"} if stages else {}
    if "quality" in last:
        last["quality"] = {**last["quality"], "estimated_error": estimate.error, "estimated_errors": {
            "active_percent": estimate.active_percent, "tension": estimate.tension,
            "contact_force": estimate.contact_force, "stress": estimate.stress,
        }}  # fmt: skip
    return {
        "scene": {"name": scene.name, "hash": scene.hash},
        "version": __version__,
        "device": model.device,
        "stop_reason": stop_reason,
        "message": message,
        "warnings": [*of_model, *notes, *warnings_of(model, rows, stages), *([estimate.warning] if estimate.warning else [])],
        "model": {
            "kind": scene.model.kind,
            "kind_reason": scene.kind_reason,
            "source": "hook" if scene.hook is not None else "knit" if scene.wires is None else "wires",
            "warnings": of_model,
            "boundary": scene.model.boundary,
            "precision": model.precision.name,
            "wires": len(panel.wire_first),
            "nodes": model.node_count,
            "repeats": list(scene.knit.repeats if scene.wires is None else scene.wires.repeats),
            "bodies": panel.body_count,
            "pairs": model.pair_count,
            "rest_curve_error": model.curve_error / scene.wire.diameter,
        },
        "solver": {
            "time_step_s": model.time_step,
            "steps": steps,
            "wall_s": wall,
            "compile_s": compile_time,
            "ranks": model.ranks.count,
            "node_steps_per_s": steps * model.node_count / wall if wall > 0 else 0.0,
            "mass_scaling": 1.0 + model.added_mass,
            "axial_softening": model.softening,
            "preset": scene.solver.preset,
            "preset_error_percent": scene.preset_error_percent,
            "drive": scene.solver.drive,
        },
        **last,
        "jumps": [[before.index, after.index] for before, after in jumps],
        "answers": answers_of(model, rows, jumps),
        "stages": stages,
    }
