"""Many loads of one mesh, each solved as by `warpknit run`, in several processes.

Each core runs one process (state_process.py), which builds the model from the scene and solves one load after another. Results
do not depend on the process.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from multiprocessing.connection import wait
from types import TracebackType
from typing import Any

from ..base.processes import ending_of, start_process
from ..errors import Diverged, OutOfResources
from ..mechanics.numerics import thread_count
from ..scene import Scene, Stage
from ..solve.simulate import Simulation
from .outcome import Outcome

PROCESS = f"{__package__}.state_process"
REPORT_INTERVAL = 0.5  # [s] between progress messages of a load


@dataclass(frozen=True)
class LoadProgress:
    """Progress of one load."""

    index: int
    steps: int
    load_factor: float


def equilibrium_under(model: Any, index: int, stage: Stage, levels: int, watch: Callable[[LoadProgress], None]) -> Outcome:
    """The equilibrium under the load of `stage`, from the mesh as knitted and in so many levels.

    `watch` is called at every convergence check.
    """
    output = replace(model.scene.output, frames=levels)
    single_stage = replace(model, scene=replace(model.scene, stages=(stage,), output=output))
    simulation = Simulation(single_stage, watch=lambda progress: watch(LoadProgress(index, progress.steps, progress.load_factor)))
    simulation.compile()
    observables: Any = None
    error: Diverged | None = None
    try:
        for record in simulation.run():
            observables = record.observables
    except Diverged as failure:
        observables, error = None, failure
    return Outcome(index, simulation.progress.steps, observables, error)


class StateProcesses:
    """One stage for each load; `run` yields outcomes as loads converge. For models without replicas (see `Batch`)."""

    def __init__(
        self,
        model: Any,
        stages: Sequence[Stage],
        levels: Sequence[int] | None = None,
        *,
        watch: Callable[[StateProcesses], None] | None = None,
        processes: int | None = None,
    ) -> None:
        """`stages`: each load; `levels` of each, default `output.frames`.

        `watch` is called regularly, and may raise to stop. `processes`: default `thread_count`.
        """
        self.model, self.stages = model, tuple(stages)
        self._levels = list(levels or [model.scene.output.frames] * len(self.stages))
        self._loads = list(enumerate(zip(self.stages, self._levels, strict=True)))
        self.processes = processes or thread_count(len(self.stages))
        self._watch = watch or (lambda _states: None)
        self._running: dict[int, LoadProgress] = {}
        self._finished_levels = self._finished_steps = 0

    @property
    def steps(self) -> int:
        """Steps of all loads together."""
        return self._finished_steps + sum(progress.steps for progress in self._running.values())

    @property
    def done(self) -> float:
        """Completed share of all load levels."""
        running = sum(self._levels[index] * progress.load_factor for index, progress in self._running.items())
        return (self._finished_levels + running) / max(1, sum(self._levels))

    def run(self) -> Iterator[Outcome]:
        """Find the equilibrium under every load. Raises `OutOfResources`."""
        for outcome in self._in_processes() if self.processes > 1 else self._here():
            self._running.pop(outcome.index, None)
            self._finished_levels += self._levels[outcome.index]
            self._finished_steps += outcome.steps
            yield outcome

    def _here(self) -> Iterator[Outcome]:
        def watch(progress: LoadProgress) -> None:
            self._running[progress.index] = progress
            self._watch(self)

        for index, (stage, levels) in self._loads:
            yield equilibrium_under(self.model, index, stage, levels, watch)

    def _in_processes(self) -> Iterator[Outcome]:
        Simulation(self.model).compile()  # kernels are compiled once, not by all processes
        waiting = [(index, *load) for index, load in self._loads]  # the last ones first: of a map, the largest strains
        with ExitStack() as stack:
            workers = [stack.enter_context(_Worker(self.model.scene)) for _ in range(self.processes)]
            busy = {}
            for worker in workers:
                worker.send(waiting.pop())
                busy[worker.pipe] = worker
            while busy:
                for pipe in wait(list(busy), REPORT_INTERVAL):
                    worker = busy[pipe]  # type: ignore[index]
                    message = worker.receive()
                    if isinstance(message, LoadProgress):
                        self._running[message.index] = message
                        continue
                    if waiting:
                        worker.send(waiting.pop())
                    else:
                        del busy[worker.pipe]
                    yield message
                self._watch(self)


class _Worker:
    """A process that is handed loads."""

    def __init__(self, scene: Scene) -> None:
        try:
            self._process, self.pipe = start_process(PROCESS)
        except OSError as error:
            raise OutOfResources(f"memory ran out: a worker process did not start: {error.strerror}") from error
        self.send(scene)

    def __enter__(self) -> _Worker:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        """End the process."""
        self.pipe.close()
        self._process.kill()
        self._process.wait()

    def send(self, what: Scene | tuple[int, Stage, int]) -> None:
        try:
            self.pipe.send(what)
        except OSError:
            self.receive()  # raises its error, or reports its end

    def receive(self) -> LoadProgress | Outcome:
        """Its next progress message or outcome. Raises its error."""
        try:
            message = self.pipe.recv()
        except (EOFError, OSError):
            raise OutOfResources(
                f"out of memory, or killed: a worker process {ending_of(self._process)};"
                " finished loads are kept, continue with --resume"
            ) from None
        if isinstance(message, Exception):
            raise message
        return message
