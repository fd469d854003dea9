"""The first steps of a small mesh of a scene, measured: `warpknit plan` estimates steps and time from them."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from statistics import median

from ..base.errors import Diverged
from ..mechanics.numerics import thread_count
from ..mechanics.protocols import Model
from ..mesh.layout import mesh_nodes, of_repeats, shrunk, smaller_scene
from ..scene import Scene
from .model import build_model
from .progress import Progress
from .simulate import Simulation
from .variant_models import VariantModels, side_by_side

SAMPLE_NODES = 20_000  # a mesh up to here is built whole: a second
WORK = 1e7  # steps times nodes of a sample run, of FEWEST_NODES at least: a second or two
MOST_EXCESS = 4.0  # over WORK, before two load levels are solved: the first begins with the mesh as knitted
MOST_SECONDS = 5.0  # of a mesh of more than SAMPLE_NODES
# nodes and time of a mesh that starts from one repeat: smaller ones hardly converge
SAMPLE_OF_REPEAT, SECONDS_OF_REPEAT = 30_000, 15.0
FEWEST_NODES = 1_000
TIMED_CHECKS = 8  # convergence checks by which the time of a step is measured
PATCH = 2  # repeats a side of a small gripped mesh
LARGE = 12, 2  # repeats of a gripped mesh with a multilevel start, like the scene's


class _Enough(Exception):
    """The sample run has taken its steps."""


@dataclass
class SampleRun:
    """Cost of a run of a small mesh: to the end of the load, or WORK."""

    model: Model
    most_checks: int | None = None  # None: to the end of WORK
    worlds: Sequence[Model] = ()  # that run beside each other in place of the model; their steps add up
    most_seconds: float = MOST_SECONDS  # of the mesh itself
    steps: int = 0
    place: float = 0.0  # load steps that are done, with the share of the present one
    marks: list[tuple[float, int]] = field(default_factory=list)  # place and steps of each load level
    clock: list[tuple[float, int]] = field(default_factory=list)  # [s] and steps at each convergence check
    failure: str = ""
    seconds: float = 0.0  # with the smaller meshes
    begin: float = 0.0  # [s] by the same clock

    def run(self) -> SampleRun:
        """Take the steps. Raises `ModelError` where a run does."""
        simulation = Simulation(self.model, worlds=self.worlds)
        simulation.monitor = lambda progress: self._monitor(progress, simulation.steps)
        simulation.compile()
        self.begin = time.perf_counter()
        try:
            for record in simulation.run():
                self.place = record.stage_index + record.load_factor
                self.marks.append((self.place, record.steps))
        except _Enough:
            pass
        except Diverged as error:
            self.failure = str(error)
        self.seconds, self.steps = time.perf_counter() - self.begin, simulation.progress.steps
        return self

    def _monitor(self, progress: Progress, steps: int) -> None:
        if self.clock and steps == self.clock[-1][1]:  # a smaller mesh is solved
            self.clock[-1] = time.perf_counter(), steps
            return
        self.clock.append((time.perf_counter(), steps))
        before = self.marks[-1][0] if self.marks else 0.0
        if self.model.scene.solver.drive == "ramp":
            self.place = progress.stage_index + min(1.0, progress.time / self.model.loading_time)
        else:
            self.place = before + progress.level_share * (progress.stage_index + progress.load_factor - before)
        work = steps * max(FEWEST_NODES, self.model.node_count) / WORK
        is_late = self.model.node_count > SAMPLE_NODES and self.clock[-1][0] - self.clock[0][0] > self.most_seconds
        if (work > 1.0 and len(self.marks) > 2) or work > MOST_EXCESS or is_late or len(self.clock) == self.most_checks:
            raise _Enough

    def path_steps(self) -> tuple[float, float, float]:
        """Steps to the end of the load: at least, expected and at most, by the levels measured.

        The first level does not count where there are others: it begins with the mesh as knitted.
        """
        model, marks = self.model, self.marks
        stages = len(model.scene.stages)
        if model.scene.solver.drive == "ramp":  # its step shrinks with the load
            steps = stages * max(self.steps / (self.place or 1.0), model.loading_time / model.time_step)
            return steps, steps, steps
        if len(marks) < 2:
            marks = [(0.0, 0), (self.place or 1.0, self.steps)]
        rates = [(b[1] - a[1]) / (b[0] - a[0]) for a, b in pairwise(marks)]
        place, steps = marks[-1]
        first, later = (marks[1], rates[1:]) if len(marks) > 2 else (marks[0], rates)
        left, mean = stages - place, (steps - first[1]) / (place - first[0])
        return steps + left * min(later), steps + left * mean, steps + left * max(later)

    def step_time(self, checks: int | None = None) -> float:
        """Time of a step [s], the median over the first `checks` convergence checks or all."""
        spans = list(pairwise(self.clock))[:checks]
        return median((b[0] - a[0]) / (b[1] - a[1]) for a, b in spans) if spans else self.seconds / max(1, self.steps)


@dataclass(frozen=True)
class Measured:
    """Cost of a run of a scene, by sample runs on the CPU."""

    small: SampleRun
    least_steps: int
    steps: int
    most_steps: int
    seconds: float  # of these steps

    @property
    def is_bound(self) -> bool:
        """Whether the steps are a lower bound: the sample run has not reached a load level."""
        return not self.small.place and not self.small.failure


def measure_meshes(scene: Scene, count: int) -> Measured:
    """Measure one of several meshes of unequal loops, side by side. Raises the errors of a run."""
    variants = VariantModels(scene)
    models = [variants.model(number) for number in variants.take(count)]
    run = measure_run(models[0], models[0].node_count, models[0].scene)
    if len(side_by_side(models)) > 1:
        return run
    alone, beside = (SampleRun(models[0], TIMED_CHECKS, worlds).run().step_time() for worlds in ((), models))
    return replace(run, seconds=run.seconds * beside / alone)


def sample_model(scene: Scene) -> tuple[Model, bool]:
    """Model for a sample run, of fewer repeats where the mesh is large; and whether it is the mesh of the scene.

    Raises the errors of a run.
    """
    nodes = mesh_nodes(scene)
    if scene.hook is not None or scene.wires is not None or nodes <= SAMPLE_NODES:
        return build_model(scene), True
    columns, rows = scene.knit.repeats
    most = max(1, math.isqrt(SAMPLE_NODES * columns * rows // nodes))
    return build_model(of_repeats(scene, min(most, columns), min(most, rows))), False


def measure_run(sample: Model, nodes: int, scene: Scene) -> Measured:
    """Steps and time of a run of `nodes` nodes, from its `sample_model`. Raises the errors of a run.

    Events within a repeat take the same steps in any number of repeats, long waves between grips take steps in proportion to the
    repeats a side. The geometric mean of both is expected, except for a multilevel start. A mesh that starts from one repeat has
    a small one of the same form.
    """
    is_knit = scene.hook is None and scene.wires is None
    is_gripped = is_knit and scene.model.boundary == "gripped"
    smaller = smaller_scene(scene) if scene.solver.drive == "relax" else None
    is_large, small_scene, (columns, rows) = smaller is not None, sample.scene, scene.knit.repeats
    seconds = MOST_SECONDS
    if is_gripped and smaller is not None and smaller.model.boundary == "periodic":
        small_scene = scene if nodes <= SAMPLE_OF_REPEAT else shrunk(scene, math.sqrt(SAMPLE_OF_REPEAT / nodes))
        seconds = SECONDS_OF_REPEAT
    elif is_gripped:
        small_scene = of_repeats(scene, *(LARGE if is_large else (min(PATCH, columns), min(PATCH, rows))))
    elif is_knit and not is_large:
        small_scene = of_repeats(scene, 1, 1)
    small = SampleRun(sample if small_scene == sample.scene else build_model(small_scene), most_seconds=seconds).run()
    least, steps, most_steps = small.path_steps()
    if is_gripped and not is_large:
        side = math.sqrt(max(1.0, nodes / small.model.node_count))
        steps, most_steps = math.sqrt(side) * steps, side * most_steps
    seconds, larger = small.seconds * steps / max(1, small.steps), nodes / small.model.node_count
    if is_large and larger > 1.0:
        seconds += steps * small.step_time() * larger / thread_count(round(larger))
    elif small.model is not sample:
        closing = small.step_time() / small.step_time(TIMED_CHECKS)  # wires that touch take longer
        step_time = SampleRun(sample, TIMED_CHECKS).run().step_time()
        seconds = steps * max(1.0, closing) * step_time * nodes / sample.node_count
    return Measured(small, round(least), round(steps), round(most_steps), seconds)
