"""The result of a run: what summary.json holds in SI units, beside the measures (results/row.py). An undefined value is null.

Of panels, gripped meshes of a dozen repeats or more and those on cords, also the section `panel` and maps as tables.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import TypeAlias

import numpy as np

from .. import __version__
from ..measure import MeshModel, table
from ..measure.observables import PanelMap
from ..measure.surface import find_surface
from ..measure.table import Record
from ..mesh.rim import build_rim
from ..results.finding import ResultWarning
from ..results.row import Columns, Row, Values, plain, valued
from ..scene.scene import may_vary
from .answers import Answers, answers_of
from .branches import jumps_of
from .history import ends_of
from .run_directory import Tree
from .variants import OF_ONE_PATH, Means, variant_warnings
from .warnings_of import warnings_of

TABLES = ("probes", "panel")  # of a row
OF_MESHES = ("variants", "spatial_model")  # sections of several meshes
ERRORS = ("active_percent", "tension", "contact_force", "stress", "standard_error", "nodes", "friction", "strain")
Value: TypeAlias = float | str | None
PanelValues: TypeAlias = dict[str, Value | dict[str, float]]  # the section of summary.json


@dataclass(frozen=True)
class Estimate:
    """Estimated errors of the last state of a run; of means also the `changes` behind them."""

    error: float | None = None  # of means: root of the sum of squares; with `run --error`: largest error, with a margin
    active_percent: float | None = None  # estimated error of the share of active contacts, in percentage points
    tension: float | None = None  # estimated relative error of the tension; of the strain where tension drives
    contact_force: float | None = None  # estimated relative error of the contact forces
    stress: float | None = None  # estimated relative error of the largest stress
    warning: ResultWarning | None = None
    standard_error: float | None = None  # of means: the largest standard error, as a fraction
    nodes: float | None = None  # of means: the largest error by the number of nodes
    friction: float | None = None  # of means: the largest change with half and with twice the friction (root mean square)
    strain: float | None = None  # part of `tension` where tension drives: estimated relative error of the strain; else null
    spatial_model: Row | None = None
    changes: Values | None = None


@dataclass(frozen=True)
class Summary:
    """The result of a run: what summary.json holds, and the table of the run and a notebook show."""

    scene: Values
    stop_reason: str  # `steady` (converged), `finished` (a ramp that had not converged at its end), `diverged`, `interrupted`
    model: Values
    solver: Values
    device: str = ""  # device of the run
    message: str = ""  # why a run stopped early
    warnings: Sequence[ResultWarning] = ()  # limits to the use of this result
    stages: tuple[Row, ...] = ()  # the same groups at the end of each load step, with its `name`
    estimate: Estimate = field(default_factory=Estimate)
    jumps: Sequence[tuple[int, int]] = ()  # pairs of `index`: neighbouring records with a snap-through between them
    variants: Means | None = None  # with `variants.count` above 1: spread of single meshes about the means
    spatial_model: Row | None = None  # of a planar tile: means of three meshes of the spatial model
    answers: Answers | None = None  # results for a designer, see below; null for a `[hook]`
    version: str = __version__  # version of warpknit

    @property
    def end(self) -> Row:
        """The last record; without values where there is none."""
        return self.stages[-1] if self.stages else Row()

    def json(self) -> Tree:
        """All of summary.json, with the values of the last stage at the top level."""
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
            "warnings": plain(self.warnings),
            "model": plain(self.model),
            "solver": plain(self.solver),
            **last,
            **{name: plain(part) for name in OF_MESHES if (part := getattr(self, name)) is not None},
            "jumps": self.jumps,
            "answers": plain(self.answers),
            "stages": stages,
        }

    @classmethod
    def of(cls, tree: Tree) -> Summary:
        """The result that `json` gave."""
        given, quality = vars(valued(tree)), tree.get("quality", {})
        warnings, of_model = ([ResultWarning.of(text) for text in part.get("warnings", ())] for part in (tree, tree["model"]))
        given |= {
            "model": given["model"].changed(warnings=of_model),
            "warnings": warnings,
            "stages": tuple(map(_row_of_sections, tree["stages"])),
            "estimate": Estimate(quality.get("estimated_error"), **quality.get("estimated_errors", {})),
            "version": __version__,
        }
        return cls(**{entry.name: given[entry.name] for entry in fields(cls) if entry.name in given})


def sections_of(row: Row) -> dict[str, dict[str, object]]:
    """Measures at the end of a load step by section (measure/table.py), probes and panel."""
    sections: dict[str, dict[str, object]] = {}
    for line in table.MEASURES:
        if line.summary and row.get(line.name) is not None:
            sections.setdefault(line.summary, {})[line.name] = row[line.name]
    return sections | {name: row[name] for name in TABLES if row.get(name)}


def _row_of_sections(stage: Tree) -> Row:
    """The row given to `sections_of`, without measures of history.csv alone."""
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
    variants: Means | None = None,
) -> Summary:
    """The result of a run from its rows. `notes` come from the drive."""
    scene, panel, jumps = model.scene, model.panel, jumps_of(model, rows)
    stages = tuple(ends_of(rows))
    last = next((stage for stage in scene.stages if stages and stage.name == stages[-1].stage), scene.stages[0])
    warnings, of_model = warnings_of(model, rows), list(model.warnings(stages))
    if variants is not None:
        jumps = []
        warnings = [warning for warning in warnings if warning.code not in OF_ONE_PATH]
        warnings += variant_warnings(variants, scene.variants.standard_error)
    return Summary(
        scene=Values(
            name=scene.name,  # name of the scene
            hash=scene.hash,  # hash of the values of the scene
            load=last.text,  # load step of the last record, in words
            by_tension=[*last.by_tension],  # in weft and warp: true for a given tension, false for a strain
        ),
        device=model.device,
        stop_reason=stop_reason,
        message=message,
        warnings=[*of_model, *warnings],
        model=Values(
            kind=scene.model.kind,  # planar or spatial
            friction=scene.contact.friction,  # friction coefficient
            friction_assumed="contact.friction" in scene.assumed,  # whether this is the default, not given in the scene
            kind_reason=scene.kind_reason,  # reason: chosen in the scene, the default, or a feature of the planar model only
            source="hook" if scene.hook is not None else "knit" if scene.wires is None else "wires",
            warnings=of_model,  # why the model is not valid for this mesh, most serious first; also in `warnings`
            one_of_many=variants is None and may_vary(scene),  # whether meshes of other loops have other results
            boundary=scene.model.boundary,  # `periodic`, `gripped` or the boundary of wires from a file
            precision=model.precision.name,  # `single` or `double`
            wires=len(panel.wire_first),  # wires of the mesh
            nodes=model.node_count,  # nodes of the mesh
            repeats=list(scene.knit.repeats if scene.wires is None else scene.wires.repeats),
            bodies=panel.body_count,  # clasps; of wires from a file also where wires cross or come near
            pairs=model.pair_count,  # two for each clasp, one for each of its wires
            notes=list(panel.notes),  # how the mesh was cut
            rest_curve_error=model.curve_error / scene.wire.diameter,  # of the contact curve, over d
        ),
        solver=Values(
            time_step_s=model.time_step,  # step of the unloaded mesh; 1 for a relaxation, which has fictitious masses
            steps=steps,  # time steps of the run
            wall_s=wall,  # of steps, checks and files, of all parts of a resumed run
            compile_s=compile_time,  # time of compilation; 0 if the kernels were compiled before
            ranks=model.ranks.count,  # processes under `mpirun`
            node_steps_per_s=steps * model.node_count / wall if wall > 0 else 0.0,  # steps times nodes over the wall time
            mass_scaling=1.0 + model.added_mass,  # mass of a ramp over the real mass
            axial_softening=model.softening,  # at the start of the run
            preset=scene.solver.preset,  # preset of the settings
            preset_error_percent=scene.preset_measured and scene.preset_measured.error_percent,
            drive=scene.solver.drive,  # `relax` or `ramp`
            notes=list(notes),  # load levels that needed more than one increment, and overlaps as knitted
        ),
        stages=stages,
        jumps=[(before.index, after.index) for before, after in jumps],
        variants=variants,
        answers=answers_of(model, rows, jumps),
    )


def _map_table(m: PanelMap, mean_gradient: np.ndarray) -> Columns:
    """One value for each tile that is mostly mesh.

    Positions are tile centres relative to the centre of the panel, undeformed and in the mean deformation.
    """
    known = m.known
    now = m.place[known] @ mean_gradient.T
    return {
        "x_m": now[:, 0],
        "y_m": now[:, 1],
        "weft_m": m.place[known][:, 0],
        "warp_m": m.place[known][:, 1],
        "inside": m.inside[known],
        "strain_weft": m.gradient[known][:, 0, 0] - 1.0,
        "strain_warp": m.gradient[known][:, 1, 1] - 1.0,
        "shear": m.gradient[known][:, 0, 1] + m.gradient[known][:, 1, 0],
        "tension_weft_N_per_m": m.tension[known][:, 0, 0],
        "tension_warp_N_per_m": m.tension[known][:, 1, 1],
        "active_percent": np.nan_to_num(m.active_percent[known]),
        "stress_max_Pa": m.stress_max[known],
    }


def panel_of(record: Record) -> tuple[dict[str, Columns], PanelValues | None]:
    """Tables `map`, `edge` and, with a target shape, `surface` of a panel; and its summary, None without a map or cords."""
    r = record.observables
    model, options = r.model, r.model.scene.panel
    panel_map = r.panel_map if record.load_factor == 1.0 else None  # at the end of a load step
    if panel_map is None and options.cord is None:
        return {}, None
    rim = build_rim(model.panel, model.scene)
    stations = record.stations if len(record.stations) else np.zeros((len(rim.arc), 3))  # zero where the rim is fixed
    values: PanelValues = {
        "outline": options.outline,  # `panel.outline`
        "area_m2": model.panel.area,  # area as knitted
    }
    if panel_map is not None:
        known, tension = panel_map.known, panel_map.tension
        least = np.minimum(tension[..., 0, 0], tension[..., 1, 1])
        values |= {
            "tension_median_weft_N_per_m": float(np.median(tension[known][:, 0, 0])),
            "tension_median_warp_N_per_m": float(np.median(tension[known][:, 1, 1])),  # the same in warp
            "tension_least_N_per_m": float(least[known].min()),  # smallest tension of a repeat in weft or warp
            "tension_threshold_N_per_m": options.tension_threshold,  # `panel.tension_threshold`
            "area_below_tension_percent": _share_below(panel_map, least, options.tension_threshold),
            "active_threshold_percent": options.active_threshold,  # `panel.active_threshold`
            "area_below_active_percent": _share_below(panel_map, panel_map.active_percent, options.active_threshold),
        }
    if rim.is_free:
        cord = rim.cord_forces(r.stretch, stations)[1]
        values |= {
            "cord_tension_max_N": float(cord.max()),  # largest tension of the edge cords
            "cord_tension_min_N": float(cord.min()),  # smallest tension of the edge cords
            "cord_displacement_max_m": float(np.hypot(stations[:, 0], stations[:, 1]).max()),
        }
    if panel_map is None:
        return {}, values
    middle = model.panel.low + 0.5 * model.panel.size
    tables: dict[str, Columns] = {"map": _map_table(panel_map, r.stretch)}
    if options.focal_length is not None:
        surface = find_surface(panel_map, rim, r.stretch, stations, middle, options.focal_length)
        x, y = surface.point.T
        tables["surface"] = {"x_m": x, "y_m": y, "height_m": surface.height, "deviation_m": surface.deviation}
        values["surface"] = {
            "focal_length_m": options.focal_length,  # `panel.focal_length`
            "rms_deviation_m": surface.rms_deviation,  # root mean square deviation from the paraboloid
            "rms_best_fit_m": surface.rms_best_fit,  # the same after the best shift and tilt
            "pillowing_m": surface.pillowing,  # largest deviation from the paraboloid
            "slope_max": float(np.hypot(x, y).max() / (2.0 * options.focal_length)),  # slope of the paraboloid at the edge
        }
    position = (rim.place - model.panel.low - 0.5 * model.panel.size) @ r.stretch.T + stations[:, :2]
    tables["edge"] = {"x_m": position[:, 0], "y_m": position[:, 1], "held": rim.given.astype(int)}
    return tables, values


def _share_below(panel_map: PanelMap, values: np.ndarray, threshold: float | None) -> float | None:
    """[%] share of the area with `values` (column, row) below a threshold; None without one."""
    if threshold is None:
        return None
    with np.errstate(invalid="ignore"):
        return 100.0 * panel_map.area_share(values < threshold)
