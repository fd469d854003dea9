"""The result of a run: what summary.json holds in SI units, beside the measures (results/row.py). An undefined value is null."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from .. import __version__
from ..measure import MeshModel, table
from ..results.finding import ResultWarning
from ..results.row import Row, Values, plain, valued
from .answers import Answers, answers_of
from .branches import jumps_of
from .history import ends_of
from .run_directory import Tree
from .warnings_of import warnings_of

TABLES = ("probes", "panel")  # of a row
ERRORS = ("active_percent", "tension", "contact_force", "stress")


@dataclass(frozen=True)
class Estimate:
    """Estimated errors of the last state of a run."""

    error: float | None = None  # with `run --error`: largest of the four below as a fraction, with a margin of 30 % and 0.2 %
    active_percent: float | None = None  # estimated error of the share of active contacts, in percentage points
    tension: float | None = None  # estimated relative error of the tension
    contact_force: float | None = None  # estimated relative error of the contact forces
    stress: float | None = None  # estimated relative error of the largest stress
    warning: ResultWarning | None = None


@dataclass(frozen=True)
class Summary:
    """The result of a run: what summary.json holds, and the table of the run and a notebook show."""

    scene: Values
    stop_reason: str  # `steady` (converged), `finished` (a ramp that had not converged at its end), `diverged`, `interrupted`
    model: Values
    solver: Values
    device: str = ""  # device that computed it
    message: str = ""  # why a run stopped early
    model_warnings: tuple[ResultWarning, ...] = ()  # why the model is not valid for this mesh, the gravest first
    other_warnings: tuple[ResultWarning, ...] = ()  # further limits to the use of this result
    stages: tuple[Row, ...] = ()  # the same groups at the end of each stage, with its `name`
    estimate: Estimate = field(default_factory=Estimate)
    jumps: Sequence[tuple[int, int]] = ()  # pairs of `index`: neighbouring records between which the mesh jumps to another
    # branch of equilibria; in a change of temperature also where it is strained by far more than free wire
    answers: Answers | None = None  # what a designer asks, see below; null for a `[hook]`
    version: str = __version__  # version of warpknit

    @property
    def end(self) -> Row:
        """The last record; without values where there is none."""
        return self.stages[-1] if self.stages else Row()

    def json(self) -> Tree:
        """All of summary.json, with the values of the last stage on top."""
        stages = [{"name": row.stage} | sections_of(row) for row in self.stages]
        last = sections_of(self.end)
        if self.stages:
            errors = {name: getattr(self.estimate, name) for name in ERRORS}
            last["quality"] |= {"estimated_error": self.estimate.error, "estimated_errors": errors}
        return {
            "scene": plain(self.scene),
            "version": self.version,
            "device": self.device,
            "stop_reason": self.stop_reason,
            "message": self.message,
            "warnings": plain(self.model_warnings + self.other_warnings),
            "model": plain(self.model.changed(warnings=self.model_warnings)),
            "solver": plain(self.solver),
            **last,
            "jumps": self.jumps,
            "answers": plain(self.answers),
            "stages": stages,
        }

    @classmethod
    def of(cls, tree: Tree) -> Summary:
        """The result that `json` gave."""
        of_model, quality = tree["model"].get("warnings", []), tree.get("quality", {})
        return cls(
            scene=Values(**tree["scene"]),
            stop_reason=tree["stop_reason"],
            model=Values(**tree["model"]),
            solver=Values(**tree["solver"]),
            model_warnings=tuple(ResultWarning("", text) for text in of_model),
            other_warnings=tuple(ResultWarning("", text) for text in tree["warnings"] if text not in of_model),
            stages=tuple(map(_row_of_sections, tree["stages"])),
            estimate=Estimate(quality.get("estimated_error"), **quality.get("estimated_errors", {})),
            answers=tree["answers"] and valued(tree["answers"]),
        )


def sections_of(row: Row) -> dict[str, dict[str, object]]:
    """The measures of the end of a stage by section (measure/table.py), its probes and its panel."""
    sections: dict[str, dict[str, object]] = {}
    for line in table.MEASURES:
        if line.summary and row.get(line.name) is not None:
            sections.setdefault(line.summary, {})[line.name] = row[line.name]
    return sections | {name: row[name] for name in TABLES if row.get(name)}


def _row_of_sections(stage: Tree) -> Row:
    """The row that `sections_of` was given, without the measures that are columns of history.csv alone."""
    sections = [part for name, part in stage.items() if name not in ("name", *TABLES)]
    values = {name: value for part in sections for name, value in part.items()}
    return Row(stage=stage["name"], **values, **{name: stage[name] for name in TABLES if name in stage})


def run_summary(
    model: MeshModel,
    rows: Sequence[Row],
    *,
    stop_reason: str,
    wall: float,
    compile_time: float,
    steps: int,
    message: str = "",
    notes: Sequence[str] = (),
    estimate: Estimate | None = None,
) -> Summary:
    """The result of a run from its rows. `notes` come from the drive."""
    estimate, scene, panel, jumps = estimate or Estimate(), model.scene, model.panel, jumps_of(model, rows)
    stages = tuple(ends_of(rows))
    noted = [ResultWarning("W20", note) for note in notes]
    return Summary(
        scene=Values(
            name=scene.name,  # name of the scene
            hash=scene.hash,  # hash of its values
        ),
        device=model.device,
        stop_reason=stop_reason,
        message=message,
        model_warnings=tuple(model.warnings(stages)),
        other_warnings=(*noted, *warnings_of(model, rows), *([estimate.warning] if estimate.warning else [])),
        model=Values(
            kind=scene.model.kind,  # planar or spatial
            kind_reason=scene.kind_reason,  # why: chosen in the scene, the default, or what exists only in the planar model
            source="hook" if scene.hook is not None else "knit" if scene.wires is None else "wires",  # table of the scene that
            # gives the wires: `knit`, `hook` or `wires`
            warnings=None,  # why the model is not valid for this mesh, the gravest first; also in `warnings`
            boundary=scene.model.boundary,  # `periodic`, `gripped` or that of wires from a file
            precision=model.precision.name,  # `single` or `double`
            wires=len(panel.wire_first),  # wires of the mesh
            nodes=model.node_count,  # nodes of the mesh
            repeats=list(scene.knit.repeats if scene.wires is None else scene.wires.repeats),  # repeats of the knit in weft and
            # warp
            bodies=panel.body_count,  # contact bodies, or in space places where two wires hook; of wires from a file also where
            # they cross or come near each other
            pairs=model.pair_count,  # two of each body
            rest_curve_error=model.curve_error / scene.wire.diameter,  # largest error of the contact curve in the reference
            # state, over d
        ),
        solver=Values(
            time_step_s=model.time_step,  # step of the unloaded mesh; 1 for a relaxation, which has fictitious masses
            steps=steps,  # time steps of the run
            wall_s=wall,  # wall time of steps, convergence checks and files, of all parts of a resumed run; without building the
            # model and compilation
            compile_s=compile_time,  # time of compilation; 0 if the kernels were compiled before
            ranks=model.ranks.count,  # processes under `mpirun`
            node_steps_per_s=steps * model.node_count / wall if wall > 0 else 0.0,  # steps times nodes over the wall time
            mass_scaling=1.0 + model.added_mass,  # mass of a ramp over the real mass
            axial_softening=model.softening,  # divisor of the axial stiffness that was used in the dynamics at the start of the
            # run: at most that of the scene; in space bending limits it
            preset=scene.solver.preset,  # preset of the settings
            preset_error_percent=scene.preset_error_percent,  # measured error of the preset; null if keys of the scene override
            # its settings
            drive=scene.solver.drive,  # `relax` or `ramp`
        ),
        stages=stages,
        estimate=estimate,
        jumps=[(before.index, after.index) for before, after in jumps],
        answers=answers_of(model, rows, jumps),
    )
