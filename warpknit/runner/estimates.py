"""Estimated errors of finished runs. `--resume` completes an interrupted estimate.

Errors of means over meshes: by their number, and by changes of nodes, friction and an overshoot of the load. Each change runs on
two of the meshes, here or in a second process during the run. It is compared with the same two meshes, so their scatter drops
out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from ..base.errors import INTERRUPTED, ModelError, OutOfResources
from ..base.processes import worker
from ..base.text import listed
from ..compute.device import start_warp
from ..knit.lapping import KnitError
from ..mechanics.numerics import process_count
from ..results.finding import ResultWarning
from ..results.row import Row, Values, read_rows, write_json
from ..scene import Scene
from ..scene.options import Stage
from ..solve.variant_models import VariantModels, last_records
from .history import row_of
from .interrupts import Interrupted, Interrupts
from .other_model import spatial_means
from .progress_display import Display
from .run_directory import CommandResult
from .summary import Estimate, Summary
from .variants import mesh_values_of

COARSENING = 1.4  # nodes a loop of the run over the comparison's
NODES = "nodes"
FRICTIONS = {"friction_half": 0.5, "friction_double": 2.0}  # factors by which it is uncertain
INTERVAL = 0.1  # [s] between calls of the monitor while another process runs the meshes
MESHES = 2  # by which a change is measured
ORDER = 2  # of the errors of discretisation: they fall with the square of the nodes
WORDS = {NODES: "fewer nodes", "friction_half": "half the friction", "friction_double": "twice the friction"}
COMPLETE = "interrupted; the results are complete"  # message of a run whose error is not known
NOT_ESTIMATED = "W45"

Check = Callable[[int], None]  # is called with the time steps so far, may raise to stop
ChangedRows = dict[str, dict[int, Row]]  # the last row of each mesh, by change and number
Estimator = Callable[[Check], Estimate]
Beside = Callable[[list[int], Check], "ChangedRows | None"]  # rows of meshes with each change, from another process


def estimated(
    out: Path, scene: Scene, summary: Summary, estimator: Estimator | None, interrupts: Interrupts, display: Display
) -> CommandResult[Summary | None]:
    """A finished run with its estimated error; an interrupt leaves its results complete."""
    code, message, estimate = 0, "", Estimate()
    if estimator is not None:
        display.stage("estimated error", number=1, of=1)

    def check(_progress: object) -> None:
        interrupts.check()

    try:
        with interrupts.handled():
            interrupts.check()
            if estimator is not None:
                estimate = estimator(check)
            estimate = replace(estimate, spatial_model=spatial_means(scene, check))
    except Interrupted:
        code, message = INTERRUPTED, COMPLETE
        if estimator is not None and estimate == Estimate():
            estimate = Estimate(warning=ResultWarning(NOT_ESTIMATED, "The error was not estimated: interrupted."))
    except (MemoryError, OutOfResources, ModelError, KnitError) as error:
        lacks = f"The error was not estimated: {str(error) or 'memory ran out'}."
        estimate = replace(estimate, warning=estimate.warning or ResultWarning(NOT_ESTIMATED, lacks))
    if code or message != summary.message or estimate != Estimate():
        variants = summary.variants
        if variants is not None and estimate.changes is not None:
            variants = variants.changed(changes=estimate.changes)
        warnings = [one for one in summary.warnings if one.code != NOT_ESTIMATED]
        warnings += [] if estimate.warning is None else [estimate.warning]
        spatial = estimate.spatial_model
        summary = replace(
            summary, message=message, estimate=estimate, variants=variants, warnings=warnings, spatial_model=spatial
        )
        write_json(out / "summary.json", summary.json())
    return CommandResult(code, summary, message, goes_on=scene.reflection is not None)


def estimated_again(scene: Scene, out: Path, summary: Summary, device: str, display: Display) -> CommandResult[Summary | None]:
    """A finished run with its estimated error, after an interrupted estimate."""
    estimator, variants = None, summary.variants
    if variants is not None and variants.count > 1 and scene.variants.sensitivity:
        estimator = Sensitivity(scene, device, {int(row.variant): row for row in read_rows(out / "variants.csv", Row)})
    return estimated(out, scene, summary, estimator, Interrupts(), display)


# --- of means


class Sensitivity:
    """Estimates errors of means: runs the changes of a scene on two meshes that have been run."""

    def __init__(self, scene: Scene, device: str, rows: Mapping[int, Row], beside: Beside | None = None) -> None:
        """rows: the last one of each mesh, by number; beside: has begun with the changes."""
        self.scene, self.device, self._beside = scene, device, beside
        self.numbers = list(rows)[:MESHES]
        self.rows = {number: rows[number] for number in self.numbers}
        self.seen = mesh_values_of(scene, list(rows.values()))

    def __call__(self, check: Check) -> Estimate:
        return self.estimate(self.changes(check))

    def changes(self, check: Check) -> dict[str, Values]:
        """Changes of the means by name, where all meshes run to the end.

        By figure, as fractions of the means; of `active_percent` of all contacts.
        """
        found = None if self._beside is None else self._beside(self.numbers, check)
        if found is None:
            found = changed_rows(self.scene, self.device, self.numbers, check)
        before = {name: self.rows if name == NODES else found.get(NODES, {}) for name in found}
        changes = {name: self._change(before[name], rows) for name, rows in found.items()}
        return {name: change for name, change in changes.items() if change is not None}

    def _change(self, before: Mapping[int, Row], after: Mapping[int, Row]) -> Values | None:
        """Change between two sets of rows of the same meshes; None where no mesh is in both."""
        if not (both := before.keys() & after.keys()):
            return None
        first, second = (mesh_values_of(self.scene, [rows[k] for k in sorted(both)]).values for rows in (before, after))
        relative = (second - first).mean(axis=0) / self.seen.scale
        return Values(**dict(zip(self.seen.names, relative.tolist(), strict=True)))

    def estimate(self, changes: Mapping[str, Values]) -> Estimate:
        """Estimated errors of the means: root of the sum of squares over number of meshes, nodes and friction.

        With a warning of changes that are not known, because no mesh runs to the end with them.
        """
        seen = self.seen
        parts = {"standard_error": seen.values.std(axis=0, ddof=1) / math.sqrt(len(seen.values)) / seen.scale}
        values = {name: np.array([change[figure] for figure in seen.names]) for name, change in changes.items()}
        if NODES in values:
            coarser = self.scene.model.nodes_per_loop / fewer_nodes(self.scene)
            parts["nodes"] = np.abs(values[NODES]) / (coarser**ORDER - 1.0)  # Richardson
        if friction := [values[name] for name in FRICTIONS if name in values]:
            parts["friction"] = np.sqrt(np.mean(np.square(friction), axis=0))
        weft, warp, active, stress = np.sqrt(sum(part**2 for part in parts.values())).tolist()
        strains = [error for error, name in zip((weft, warp), seen.names, strict=False) if name.startswith("strain")]
        tensions = [error for error, name in zip((weft, warp), seen.names, strict=False) if name.startswith("tension")]
        largest = {name: float(part.max()) for name, part in parts.items()}
        return Estimate(
            max(weft, warp, active, stress), 100.0 * active, max(tensions or strains), stress=stress,
            standard_error=largest["standard_error"], nodes=largest.get("nodes"), friction=largest.get("friction"),
            warning=self._lacking(changes), strain=max(strains, default=None), changes=Values(**changes),
        )  # fmt: skip

    def _lacking(self, changes: Mapping[str, Values]) -> ResultWarning | None:
        names = [WORDS[name] for name in changes_of(self.scene) if name in WORDS and name not in changes]
        if not names:
            return None
        return ResultWarning("W45", f"The estimated error leaves out {listed(names)}, with which no mesh converged.")


def changes_of(scene: Scene) -> dict[str, Scene]:
    """Scenes by what they change: fewer nodes a loop, and one further change each at these nodes."""
    overshoot, nodes = scene.variants.overshoot, fewer_nodes(scene)
    coarse = replace(scene, model=replace(scene.model, nodes_per_loop=nodes))
    found = {NODES: coarse} | other_frictions(coarse)
    if overshoot > 0.0:
        found["overshoot"] = replace(coarse, stages=(_overshot(scene.stages[0], overshoot), *scene.stages))
    return found


def other_frictions(scene: Scene) -> dict[str, Scene]:
    """The scene with half and twice its friction; none for a scene without friction."""
    contact = scene.contact
    if contact.friction == 0.0:
        return {}
    return {
        name: replace(scene, contact=replace(contact, friction=factor * contact.friction)) for name, factor in FRICTIONS.items()
    }


def fewer_nodes(scene: Scene) -> int:
    """Nodes a loop of the comparison."""
    return round(scene.model.nodes_per_loop / COARSENING)


def _overshot(stage: Stage, overshoot: float) -> Stage:
    names = ("strain_weft", "strain_warp", "tension_weft", "tension_warp")
    driven = {name: (1.0 + overshoot) * value for name in names if (value := getattr(stage, name)) is not None}
    return replace(stage, name="overshoot", **driven)


def changed_rows(scene: Scene, device: str, numbers: list[int], check: Check) -> ChangedRows:
    """Rows of the meshes `numbers` with each change: if loops fit, and the runs reach the end."""
    meshes, models = [], []
    for name, changed in changes_of(scene).items():
        variants = VariantModels(changed, device)
        for number in numbers:
            with suppress(KnitError, ModelError):
                models.append(variants.model(number))
                meshes.append((name, number))
    found: ChangedRows = {}
    for place, record in last_records(models, check):
        name, number = meshes[place]
        found.setdefault(name, {})[number] = row_of(record)
    return found


# --- beside the run


@contextmanager
def beside(scene: Scene, device: str, numbers: list[int]) -> Iterator[Beside | None]:
    """Begin with the changes of meshes; None on a GPU or a single core, which both would share."""
    begun = None
    with ExitStack() as stack:
        if process_count(2, device) > 1:
            with suppress(OSError):
                begun = partial(_rows_of, stack.enter_context(worker(send_changed_rows, scene, numbers)), numbers)
        yield begun


def _rows_of(pipe: Connection, begun: list[int], numbers: list[int], check: Check) -> ChangedRows | None:
    """Rows of the meshes from another process; None if other meshes were begun, or if the process has failed."""
    with suppress(EOFError, OSError):
        while numbers == begun:
            if pipe.poll(INTERVAL):
                rows: ChangedRows = pipe.recv()[0]
                return rows
            check(0)
    return None


def send_changed_rows(send: Callable[[ChangedRows], None], scene: Scene, numbers: list[int]) -> None:
    """Send the rows of the meshes, from a process."""
    start_warp()
    send(changed_rows(scene, "cpu", numbers, lambda _steps: None))
