"""Runs the meshes of [variants] side by side, and writes their mean. Recorded states belong to the median mesh.

Beside them DIR has variants.csv: the rows of each mesh. While it runs, variants/## holds the states of each.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from ..base.errors import Diverged
from ..measure.table import Record
from ..mesh.layout import refuse_large_patch
from ..results.frame import Frame, state_file
from ..results.row import Row, Values
from ..scene import Scene
from ..solve.simulate import Progress, Simulation
from ..solve.variant_models import VariantModels, side_by_side
from .branches import with_work
from .estimates import MESHES, Beside, Estimator, Sensitivity, beside
from .history import row_of, with_sums, write_history
from .monitor import Checkpoint, LoopResult
from .recorder import Recorder, frame_of, open_frames
from .run_directory import CommandResult
from .summary import Summary
from .variants import Means, MeshValues, branch_of, first_meshes, mean_row, mesh_values_of, spreads, wanted


class MeshGroups:
    """The meshes of a scene's [variants], in groups side by side."""

    def __init__(self, scene: Scene, device: str, checkpoint: Checkpoint | None = None) -> None:
        """checkpoint: to go on from. Raises `ModelError`, `KnitError` where no mesh can be made."""
        refuse_large_patch(scene, "variants", "variants.count = 1")
        self.scene, self.models = scene, VariantModels(scene, device)
        self.failed: dict[int, str] = {}
        self.begun: list[int] = []  # their numbers
        self.group: list[int] = []  # those that run now
        self.finished_steps = 0
        if checkpoint is None:
            self.simulation = self._next(first_meshes(scene.variants))
            return
        kept = checkpoint.header.variants
        self.failed, refused = ({int(number): text for number, text in kept[name].items()} for name in ("failed", "refused"))
        self.models.refused, self.models.next = refused, kept["next"]
        self.begun, self.finished_steps = list(kept["begun"]), kept["finished_steps"]
        self.simulation = self._simulation(list(kept["group"]), checkpoint.progress)
        ended = {world: self.failed[number] for world, number in enumerate(self.group) if number in self.failed}
        self.simulation.failures = {world: Diverged(text) for world, text in ended.items()}

    def kept(self) -> dict[str, object]:
        """Values from which `__init__` continues."""
        names = ("failed", "begun", "group", "finished_steps")
        kept = {name: getattr(self, name) for name in names}
        return {**kept, "refused": self.models.refused, "next": self.models.next}

    def _simulation(self, numbers: list[int], progress: list[Progress] | None = None) -> Simulation:
        self.group = numbers
        models = [self.models.model(number) for number in numbers]
        return Simulation(self.of_scene(models[0]), worlds=models, progress=progress)

    def of_scene(self, model: Any) -> Any:
        """Model of a mesh as the model of the whole scene."""
        return replace(model, scene=self.scene)

    def _next(self, more: int) -> Simulation:
        numbers = self.models.take(more, lambda models, model: len(side_by_side([*models, model])) == 1)
        self.begun += numbers
        return self._simulation(numbers)

    def follow(self, more: int) -> Simulation:
        """Next simulation, with up to `more` further meshes."""
        self.note_failures()
        self.finished_steps += self.simulation.steps
        self.simulation = self._next(more)
        return self.simulation

    def note_failures(self) -> None:
        """Keep the errors of the meshes that run."""
        self.failed |= {self.group[world]: str(error) for world, error in self.simulation.failures.items()}

    @property
    def steps(self) -> int:
        """Time steps of all meshes so far."""
        return self.finished_steps + self.simulation.steps

    @property
    def share(self) -> float:
        """Completed share of the loads of the meshes begun."""
        running = self.simulation.drives
        done = [(drive.progress.stage_index + drive.progress.load_factor) / len(self.scene.stages) for drive in running]
        done = [1.0 if world in self.simulation.failures else min(1.0, share) for world, share in enumerate(done)]
        return (len(self.begun) - len(self.group) + sum(done)) / len(self.begun)


class VariantsRecorder(Recorder):
    """Writes the records of several meshes as records of one run."""

    def __init__(self, variants: MeshGroups, *args: Any, **options: Any) -> None:
        self.meshes = variants
        self._beside: Beside | None = None
        self.members: dict[int, list[Row]] = {}  # rows of each mesh
        super().__init__(variants.simulation, *args, **options)

    def run(self) -> CommandResult[Summary | None]:
        if not self.scene.variants.sensitivity:
            return super().run()
        with beside(self.scene, self.meshes.models.device, self.meshes.begun[:MESHES]) as self._beside:
            return super().run()

    def _loop(self) -> LoopResult:
        loop = self.monitor.run(self._write_record, self._following)
        self.meshes.note_failures()
        whole = self._whole_members()
        if not whole:
            failed = [*self.meshes.failed.values(), *self.meshes.models.refused.values()]
            return loop if loop.exit_code else LoopResult("diverged", 3, f"none of {len(self.meshes.begun)} meshes: {failed[0]}")
        self._write_mean(whole, complete=loop.exit_code == 0)
        return loop

    # --- records

    def _write_record(self, record: Record) -> None:
        self._reserve_memory()
        number = self.meshes.group[record.world]
        model = self.meshes.models.model(number)
        row = row_of(record, self.probes).changed(variant=number)
        frame_of(record).save(state_file(self._member_directory(number), record.index))
        rows = with_work([*self.members.get(number, []), row], model)
        rows[-1] = with_sums(rows, model).changed(panel=None)
        self.members[number] = rows

    def _member_directory(self, number: int) -> Path:
        return self.out / "variants" / f"{number:03d}"

    def _recorded(self) -> dict[str, object]:
        self.meshes.note_failures()
        rows = [vars(row) for rows in self.members.values() for row in rows]
        return {"rows": rows, "variants": self.meshes.kept()}

    def _take_up(self, rows: list[Row]) -> None:
        super()._take_up([])
        for row in rows:
            self.members.setdefault(row.variant, []).append(row)

    def _whole_members(self) -> dict[int, list[Row]]:
        """The rows of each mesh that has reached the end of its load."""
        return {
            number: rows
            for number, rows in sorted(self.members.items())
            if rows[-1].load_factor == 1.0 and rows[-1].stage == self.scene.stages[-1].name and number not in self.meshes.failed
        }

    def _mesh_values(self, whole: dict[int, list[Row]]) -> MeshValues:
        return mesh_values_of(self.scene, [rows[-1] for rows in whole.values()])

    def _following(self) -> Simulation | None:
        """Simulation of further meshes, where the means are not known well enough."""
        self.meshes.note_failures()
        whole, variants = self._whole_members(), self.scene.variants
        found = len(self.meshes.begun)
        error = self._mesh_values(whole).standard_error if whole else float("inf")
        more = wanted(variants.count, variants.standard_error, found, error) - found
        return self.meshes.follow(more) if more > 0 else None

    # --- the mean

    def _write_mean(self, whole: dict[int, list[Row]], *, complete: bool) -> None:
        seen = self._mesh_values(whole)
        median = list(whole)[seen.median]
        self.model = self.meshes.of_scene(self.meshes.models.model(median))
        self.rows = [mean_row(rows, seen.median) for rows in zip(*whole.values(), strict=True)]
        write_history(self.out / "variants.csv", [row for rows in whole.values() for row in rows], "variant")
        self.model.layout().save(self.out / "layout.npz")
        with open_frames(self.scene, self.model.layout(), self.out) as frames:
            for index in range(len(self.rows)):
                frames.add_frame(Frame.load(state_file(self._member_directory(median), index)))
            frames.close(complete=complete)
        write_history(self.out / "history.csv", self.rows)
        self.variants = self._means(seen, whole, median)

    def _means(self, seen: MeshValues, whole: dict[int, list[Row]], median: int) -> Means:
        failed, refused = self.meshes.failed, self.meshes.models.refused
        return Means(
            count=len(whole),
            failed=len(failed),
            refused=len(refused),
            why=next(iter([*failed.values(), *refused.values()]), ""),
            standard_error=seen.standard_error if len(whole) > 1 else None,
            median=median,
            branch=branch_of(seen),
            changes=Values(),
            **spreads([rows[-1] for rows in whole.values()]),
        )

    @property
    def estimator(self) -> Estimator | None:
        if self.variants is None or self.variants.count == 1 or not self.scene.variants.sensitivity:
            return None
        whole = {number: rows[-1] for number, rows in self._whole_members().items()}
        return Sensitivity(self.scene, self.meshes.models.device, whole, self._beside)

    # --- while it runs

    @property
    def steps(self) -> int:
        return self.meshes.steps

    def _show(self, progress: Progress) -> None:
        count = len(self.meshes.begun)
        if self._stage_shown != count:
            self._stage_shown = count
            self.display.stage(f"{count} meshes", number=1, of=1)
        share, rate = self.meshes.share, self.steps * self.model.node_count / max(self.monitor.wall, 1e-9)
        self.display.update(done=share, load_factor=share, node_steps_per_s=rate)
