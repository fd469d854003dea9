"""Estimated errors of finished runs. One that was interrupted while they were found finds them on `--resume`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ..base.errors import INTERRUPTED, ModelError, OutOfResources
from ..knit.lapping import KnitError
from ..measure import tension_scale
from ..results.finding import ResultWarning
from ..results.row import Row, read_rows, write_json
from ..scene import Scene
from ..solve.variant_models import VariantModels
from .changed_meshes import Beside
from .interrupts import Interrupted, Interrupts
from .other_model import spatial_means
from .progress_display import Display
from .run_directory import CommandResult
from .sensitivity import Sensitivity
from .summary import Estimate, Summary

Check = Callable[[Any], None]  # is called at every convergence check, may raise to stop
Estimator = Callable[[Check], Estimate]
COMPLETE = "interrupted; the results are complete"  # message of a run whose error is not known
NOT_ESTIMATED = "W45"
SMALL_TENSION = 1e-3  # of the scale of tensions: smaller differences do not count


@dataclass(frozen=True)
class MeansEstimator:
    """Estimates errors of means, from changes of two of the meshes."""

    scene: Scene
    device: str
    rows: dict[int, Row]  # the last one of each mesh
    small_tension: float  # [N/m]
    beside: Beside | None = None

    def __call__(self, check: Check) -> Estimate:
        sensitivity = Sensitivity(self.scene, self.device, self.rows, self.small_tension, self.beside)
        return sensitivity.estimate(sensitivity.changes(check))


def how_sure(scene: Scene, estimator: Estimator | None, interrupts: Interrupts) -> tuple[int, str, Estimate]:
    """Exit code, message and estimated error of a finished run, whose results are complete; an interrupt leaves them so."""
    estimate = Estimate()
    try:
        with interrupts.handled():
            interrupts.check()
            if estimator is not None:
                estimate = estimator(lambda _progress: interrupts.check())
            spatial = spatial_means(scene, lambda _progress: interrupts.check())
        return 0, "", replace(estimate, spatial_model=spatial)
    except Interrupted:
        if estimator is not None and estimate == Estimate():
            estimate = Estimate(warning=ResultWarning(NOT_ESTIMATED, "The error was not estimated: interrupted."))
        return INTERRUPTED, COMPLETE, estimate
    except (MemoryError, OutOfResources, ModelError, KnitError) as error:
        lacks = f"The error was not estimated: {str(error) or 'memory ran out'}."
        return 0, "", replace(estimate, warning=estimate.warning or ResultWarning(NOT_ESTIMATED, lacks))


def estimated_again(scene: Scene, out: Path, summary: Summary, device: str, display: Display) -> CommandResult[Summary | None]:
    """A finished run with its estimated error, which an interrupt left out."""
    estimator, variants = None, summary.variants
    if variants is not None and variants.count > 1 and scene.variants.sensitivity:
        rows = {int(row.variant): row for row in read_rows(out / "variants.csv", Row)}
        median: Any = VariantModels(scene, device).model(variants.median)
        small = SMALL_TENSION * tension_scale(replace(median, scene=scene))
        estimator = MeansEstimator(scene, device, rows, small)
    display.stage("estimated error", number=1, of=1)
    code, message, estimate = how_sure(scene, estimator, Interrupts())
    if variants is not None and estimate.changes is not None:
        variants = variants.changed(changes=estimate.changes)
    kept = tuple(one for one in summary.other_warnings if one.code != NOT_ESTIMATED)
    more = () if estimate.warning is None else (estimate.warning,)
    summary = replace(
        summary, message=message, estimate=estimate, variants=variants, other_warnings=(*kept, *more),
        spatial_model=estimate.spatial_model,
    )  # fmt: skip
    write_json(out / "summary.json", summary.json())
    return CommandResult(code, summary, message)
