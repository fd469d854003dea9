"""`warpknit map`: the sweep of a scene into a directory, with interrupt and resume.

DIR holds map.csv, map_details.csv, map.json, scene.toml (resolved) and figures/*.png; with [variants] also the map of each mesh,
variants/map_##.csv and variants/details_##.csv. Every file is written aside and renamed.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Container, Mapping
from contextlib import suppress
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from .. import __version__, measure
from ..base.errors import Diverged
from ..base.text import counted, percent
from ..compute.device import find_device
from ..compute.memory import available_memory, refuse_beyond_memory, required_memory
from ..measure import Observables, tension_scale
from ..measure.table import Record
from ..mesh.layout import refuse_large_patch
from ..results.finding import ResultWarning
from ..results.frame import state_file
from ..results.row import Values, write_json
from ..runner.cautions import sweep_cautions
from ..runner.interrupts import Interrupted, Interrupts
from ..runner.monitor import DISPLAY_INTERVAL
from ..runner.other_model import FIGURES as COMPARED
from ..runner.other_model import spatial_means
from ..runner.progress_display import Display
from ..runner.run_directory import CommandResult, check_directory, open_directory
from ..runner.variants import first_meshes, mesh_values, wanted
from ..scene import Scene
from ..scene.capabilities import refuse
from ..solve.model import build_model
from ..solve.variant_models import MOST_NODES, VariantModels
from . import contact_map
from .contact_map import STEADY, MapRow, Pair
from .load_path import ends_of, knitted_worlds, share_done, with_frictions
from .map_paths import MapPath, map_paths, path_to

_log = logging.getLogger(__name__)

SAVE_INTERVAL = 5.0  # [s] between saves of finished cells
FIGURES = (
    # file, column, label, unit
    ("contact_map", "active_percent", "active contacts", "% of pairs"),
    ("stress_map", "stress_max_Pa", "largest wire stress", "Pa"),
    ("yield_map", "yield_fraction", "wire above the elastic limit", "%"),
)
# of what is not prescribed
BY_STRAIN = (
    ("tension_weft_map", "tension_weft_N_per_m", "weft tension", "N/m"),
    ("tension_warp_map", "tension_warp_N_per_m", "warp tension", "N/m"),
)
BY_TENSION = (("strain_weft_map", "strain_weft", "weft strain", "%"), ("strain_warp_map", "strain_warp", "warp strain", "%"))
LEAST_SHARE = 0.1  # of the largest tension of a map: the error of a smaller one is measured by that
PERCENT = 100.0  # of a fraction, as some columns are
SPREAD_FIGURES = (  # of several meshes
    ("contact_spread_map", "std_active_percent", "standard deviation of active contacts", "percentage points"),
    ("stress_spread_map", "std_stress_max_Pa", "standard deviation of the largest wire stress", "Pa"),
)


def run_map(
    scene: Scene,
    *,
    out: Path,
    device: str | None = None,
    resume: bool = False,
    force: bool = False,
    progress: Display | None = None,
    command: str = "map",
    keep_states: bool = False,
) -> CommandResult[contact_map.MapSummary]:
    """Run the sweep of `scene` into the directory `out`; command: for messages.

    keep_states: write the equilibria too, as in a run; mesh by mesh, its pairs line by line.

    Raises `SceneError`, `RunDirectoryError`, `DeviceError`, `ModelError`, `KnitError` before anything is written. Strains at
    which the mesh does not converge have no values; an interrupt ends with exit_code 130 and keeps the finished cells.
    """
    refuse(scene, "map", device=None if device is None else find_device(device))
    refuse_large_patch(scene, "a map", "less")
    finished, keep = check_directory(out, "map", scene, resume=resume, force=force, command=command)
    if finished is not None:
        return CommandResult(0, contact_map.MapSummary.of(finished))
    variants = VariantModels(scene) if scene.variants.count > 1 else None
    first = build_model(scene) if variants is None else variants.of_place(0)  # raises before anything is removed
    refuse_beyond_memory("sweep", first.scene, first.node_count)
    open_directory(out, scene, keep=keep)
    return _Mapper(scene, first, variants, out, progress or Display(), keep_states).run()


class _Mapper:
    """Runs the batches of a map, and writes the rows."""

    def __init__(
        self, scene: Scene, first: Any, variants: VariantModels | None, out: Path, display: Display, keep_states: bool
    ) -> None:
        """first: the single mesh, or the first of the `variants`."""
        assert scene.sweep is not None
        self.keep_states, self.variants, self.first = keep_states, variants, first
        self.scene, self.sweep, self.out, self.display = scene, scene.sweep, out, display
        self.nodes = first.node_count
        self.pairs = scene.sweep.pairs
        self.maps = [self._read(mesh) for mesh in range(scene.variants.count)]  # of each mesh, the rows by pair
        self.steps = self._stage = 0
        self._interrupts = Interrupts()
        self._begin = self._saved = self._shown = time.perf_counter()

    def run(self) -> CommandResult[contact_map.MapSummary]:
        reason, code, message = "finished", 0, ""
        with self._interrupts.handled():
            try:
                while missing := self._missing():
                    self._solve(missing)
                self._interrupts.check()
            except Interrupted:
                reason, code, message = "interrupted", 130, f"interrupted; finished cells are kept in {self.out}"
            finally:
                self._save()
        summary = self._summary(reason)
        if code == 0:
            summary = summary.changed(**self._spatial_model(), **self._frictions(summary.optimum))
        if code == 0 and not any(row.active_percent is not None for row in self.rows):
            code, message = 3, f"no {self.sweep.quantity} of the sweep converged: {self.rows[0].message}"
            summary = summary.changed(stop_reason="diverged")
        write_json(self.out / "map.json", summary)
        if self.scene.output.figures and self.rows:
            self._draw(summary)
        return CommandResult(code, summary, message)

    def _spatial_model(self) -> dict[str, Values]:
        """Means of the spatial model and the map at the largest load; an interrupt leaves them out."""
        steady = [row for row in self.rows if row.stop_reason == STEADY]
        if not steady:
            return {}
        row = max(steady, key=lambda row: sum(row.load))
        with suppress(Interrupted), self._interrupts.handled():
            means = spatial_means(self.scene, lambda _steps: self._interrupts.check(), row.load)
            planar = Values(**{name: row[name] for name in COMPARED})
            return {} if means is None else {"spatial_model": Values(**vars(means), load=list(row.load), planar=planar)}
        return {}

    def _frictions(self, optimum: contact_map.Optimum | None) -> dict[str, Values]:
        """Means at the optimum with other frictions; an interrupt leaves them out."""
        if optimum is None or self.variants is None or not (meshes := with_frictions(self.variants)).again:
            return {}
        path = path_to(self.scene, optimum.load)
        models = {place: meshes.models[place] for place in meshes.again}
        count, found = len(models), dict[int, Mapping[str, float]]()
        with suppress(Interrupted), self._interrupts.handled():
            simulation = knitted_worlds(
                list(models.values()), [path.stages(self.scene)] * count, [path.levels] * count,
                lambda _load: self._interrupts.check(),
            )  # fmt: skip
            for world, end in ends_of(simulation):
                if isinstance(end, Record) and end.stage_index == len(path.pairs) - 1:
                    row = contact_map.map_row(optimum.load, end, steps=0, by_tension=self.sweep.by_tension)
                    found[list(models)[world]] = vars(row)
            rows = {mesh: rows.get(optimum.load) for mesh, rows in enumerate(self.maps)}
            found |= {mesh: vars(row) for mesh, row in rows.items() if row is not None and row.stop_reason == STEADY}
            means = {name: meshes.means(found, name) for name in COMPARED}
            known = means[COMPARED[0]]
            by_friction = {one: Values(**{name: mean[one] for name, mean in means.items()}) for one in known}
            return {"frictions": Values(**by_friction)} if known else {}
        return {}

    @property
    def rows(self) -> list[MapRow]:
        return contact_map.mean_map([list(rows.values()) for rows in self.maps if rows])

    @property
    def model_warnings(self) -> list[ResultWarning]:
        return list(self.first.warnings(self.rows))

    @property
    def _missing_warning(self) -> list[ResultWarning]:
        """Warning on missing pairs of an interrupted map; none for a complete map."""
        if not self._missing():
            return []
        done, wanted = len(self.rows), len(self.pairs)
        pairs = f"{done} of {wanted} pairs of {self.sweep.quantity} are done"
        return [ResultWarning("W42", f"The map is incomplete: {pairs}.")]

    # --- cells ---

    def _missing(self) -> list[tuple[int, Pair]]:
        """Meshes and pairs to solve: half of the variants at every pair, then all where these are not enough."""
        variants, first = self.scene.variants, first_meshes(self.scene.variants)
        missing = [(mesh, pair) for pair in self.pairs for mesh in range(first) if pair not in self.maps[mesh]]
        if missing or first == variants.count:
            return missing
        found = {
            pair: [row for mesh in range(first) if (row := self.maps[mesh][pair]).stop_reason == STEADY] for pair in self.pairs
        }
        tensions = [row.tension for rows in found.values() for row in rows]
        least = max(LEAST_SHARE * float(np.abs(tensions).max()), 1e-3 * tension_scale(self.first)) if tensions else 0.0
        by_tension = [self.sweep.by_tension] * 2

        def is_enough(rows: list[MapRow]) -> bool:
            error = mesh_values(by_tension, rows, least).standard_error if rows else math.inf
            return wanted(variants.count, variants.standard_error, first, error) == first

        more = [pair for pair, rows in found.items() if not is_enough(rows)]
        return [(mesh, pair) for pair in more for mesh in range(first, variants.count) if pair not in self.maps[mesh]]

    def _model(self, mesh: int) -> Any:
        return self.first if self.variants is None else self.variants.of_place(mesh)

    def _solve(self, missing: list[tuple[int, Pair]]) -> None:
        """Solve pairs of meshes along their paths; one mesh after the other where worlds share loops.

        Meshes on one path take similar numbers of steps, so they run side by side: a thread steps some of them at once.
        """
        meshes = max(mesh for mesh, _pair in missing) + 1
        several = f", {meshes} meshes" if meshes > 1 else ""
        self._stage += 1
        pairs = len({pair for _mesh, pair in missing})
        self.display.stage(f"{counted(pairs, 'pair')} of {self.sweep.quantity}{several}", number=self._stage, of=self._stage)
        paths = [
            (mesh, path)
            for path in map_paths(self.scene)
            for mesh in range(meshes)
            if any((mesh, pair) in missing for pair in path.pairs)
        ]
        own_loops = self.scene.model.of_kind.own_loops
        alike: Callable[[tuple[int, MapPath]], int] = lambda one: self._model(one[0]).node_count if own_loops else one[0]  # noqa: E731
        groups = [list(own) for _, own in groupby(sorted(paths, key=alike), alike)]
        fit = int(available_memory() // required_memory(self.first.scene, self.nodes))
        most, finished = max(1, min(fit, MOST_NODES // self.nodes)), 0
        for own in (group[begin : begin + most] for group in groups for begin in range(0, len(group), most)):
            self._solve_together(own, set(missing), finished / len(paths), len(own) / len(paths))
            finished += len(own)

    def _solve_together(
        self, own: list[tuple[int, MapPath]], missing: Container[tuple[int, Pair]], finished: float, share: float
    ) -> None:
        """Solve paths of meshes side by side, a `share` of this stage's; keep the `missing` pairs."""
        levels = [path.levels for _mesh, path in own]
        steps_before = self.steps

        def monitor(_load: float) -> None:
            self._interrupts.check()
            if time.perf_counter() - self._shown < DISPLAY_INTERVAL:
                return
            self._shown = time.perf_counter()
            self.steps = steps_before + simulation.steps
            rate = self.steps * self.nodes / (time.perf_counter() - self._begin)
            found = finished + share * share_done(simulation, levels)
            self.display.update(done=found, load_factor=found, node_steps_per_s=rate)
            if time.perf_counter() - self._saved > SAVE_INTERVAL:
                self._save()

        models, stages = [self._model(mesh) for mesh, _path in own], [path.stages(self.scene) for _mesh, path in own]
        simulation = knitted_worlds(models, stages, levels, monitor)
        for world, end in ends_of(simulation):
            mesh, path = own[world]
            if isinstance(end, Diverged):
                progress = simulation.drives[world].progress
                reached, steps = path.pairs[progress.stage_index :], progress.steps
            else:
                reached, steps = (path.pairs[end.stage_index],), end.steps
            for pair in reached:
                if (mesh, pair) not in missing:
                    continue
                if self.keep_states and isinstance(end, Record):
                    self._keep(mesh * len(self.pairs) + self.pairs.index(pair), end.observables)
                self.maps[mesh][pair] = contact_map.map_row(pair, end, steps=steps, by_tension=self.sweep.by_tension)
        self.steps = steps_before + simulation.steps

    # --- files ---

    def _keep(self, number: int, state: Observables) -> None:
        """Write an equilibrium, and with the first one the layout."""
        if not (self.out / "layout.npz").exists():
            self.first.layout().save(self.out / "layout.npz")
        load = self.scene.stages[0]
        frame = measure.frame(state, index=number, stage=load.name, load_factor=1.0, temperature=load.temperature)
        frame.save(state_file(self.out, number))

    def _paths(self, mesh: int) -> tuple[Path, Path]:
        if self.variants is None:
            return self.out / "map.csv", self.out / "map_details.csv"
        return self.out / "variants" / f"map_{mesh:02d}.csv", self.out / "variants" / f"details_{mesh:02d}.csv"

    def _read(self, mesh: int) -> dict[Pair, MapRow]:
        return {row.load: row for row in contact_map.read_map(*self._paths(mesh))}

    def _save(self) -> None:
        tables = [(self.rows, (self.out / "map.csv", self.out / "map_details.csv"))]
        if self.variants is not None:
            tables += [(list(rows.values()), self._paths(mesh)) for mesh, rows in enumerate(self.maps) if rows]
        order = {pair: place for place, pair in enumerate(self.pairs)}
        for table, paths in tables:
            contact_map.write_map(sorted(table, key=lambda row: order[row.load]), *paths)
        self._saved = time.perf_counter()

    def _summary(self, reason: str) -> contact_map.MapSummary:
        wall = time.perf_counter() - self._begin
        rows, wire, scene, by_tension = self.rows, self.scene.wire, self.scene, self.sweep.by_tension
        jumps = contact_map.find_jumps(self.first, rows) if self.variants is None else []  # of means there are none
        optimum = contact_map.find_optimum(rows, wire.yield_stress, jumps)
        warnings = [*self.model_warnings, *sweep_cautions(scene, self.first.cloth)]
        warnings += [*contact_map.unconverged_warning(rows, by_tension), *contact_map.jump_warning(jumps, by_tension)]
        warnings += self._missing_warning or contact_map.optimum_warnings(optimum, jumps)
        return contact_map.MapSummary(
            scene=Values(name=scene.name, hash=scene.hash),
            version=__version__,
            stop_reason=reason,
            warnings=warnings,
            path=f"each pair of {self.sweep.quantity} proportionally from the knitted mesh,"
            f" {scene.levels} levels to the largest {self.sweep.quantity.removesuffix('s')}",
            loads=self.sweep.quantity,
            cells=Values(wanted=len(self.pairs), done=len(rows), steady=sum(row.stop_reason == STEADY for row in rows)),
            variants=sum(map(bool, self.maps)),
            model=Values(
                kind=scene.model.kind,
                kind_reason=scene.kind_reason,
                friction=scene.contact.friction,
                friction_assumed="contact.friction" in scene.assumed,
                boundary=scene.model.boundary,
                nodes=self.nodes,
                bodies=self.first.panel.body_count,
            ),
            solver=Values(
                preset=scene.solver.preset,
                wall_s=wall,
                cell_steps=self.steps,
                cell_steps_per_s=self.steps / wall,
                node_steps_per_s=self.steps * self.nodes / wall,
            ),
            wire=Values(yield_stress_Pa=wire.yield_stress, yield_stress_assumed="wire.yield_stress" in scene.assumed),
            optimum=optimum,
            jumps=jumps,
        )

    def _draw(self, summary: contact_map.MapSummary) -> None:
        from ..export.map_figure import Marks, map_figure

        scene, wire, rows, count = self.scene, self.scene.wire, self.rows, summary.variants
        weft, warp = self.sweep.axes
        load = None if summary.optimum is None else summary.optimum.load
        marks = Marks(
            stress=contact_map.grid(rows, "stress_max_Pa", weft, warp),
            yield_stress=wire.yield_stress,
            is_assumed="wire.yield_stress" in scene.assumed,
            optimum=load,
            jumps=summary.jumps,
            optimum_note=contact_map.optimum_note(load, summary.jumps),
        )
        scatter = f", mean of up to {count} meshes, loops scattered by {percent(scene.variants.scatter, 0)}" if count > 1 else ""
        ends = f"{wire.ends} x " if wire.ends > 1 else ""
        mesh = f"{scene.name}: {wire.material} {ends}{1e6 * wire.diameter:g} um, {scene.model.boundary}{scatter}"
        found = BY_TENSION if self.sweep.by_tension else BY_STRAIN
        for name, column, label, unit in FIGURES + found + (SPREAD_FIGURES if count > 1 else ()):
            values = (PERCENT if unit == "%" else 1.0) * contact_map.grid(rows, column, weft, warp)
            map_figure(
                self.out / "figures" / f"{name}.png", weft, warp, values, title=mesh, label=label, unit=unit, marks=marks,
                warnings=list(map(str, self.model_warnings + self._missing_warning)), by_tension=self.sweep.by_tension,
            )  # fmt: skip
