"""Many loads of one mesh, each brought to equilibrium by itself as `warpknit run` does, in several processes.

As many loads are under way as there are cores. Each process (state_process.py) builds the model from the scene and is handed one
load after the other; what it finds does not depend on which process has it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from multiprocessing.connection import wait
from types import TracebackType
from typing import Any

from ..errors import Diverged, OutOfResources
from ..numerics import thread_count
from ..processes import ending_of, start_process
from ..scene import Scene, Stage
from ..solve.simulate import Simulation
from .outcome import Outcome

PROCESS = f"{__package__}.state_process"
SAY_INTERVAL = 0.5  # [s] between what is heard of a load that is under way


@dataclass(frozen=True)
class Way:
    """How far a load is under way."""

    index: int
    steps: int
    load_factor: float


def equilibrium_under(model: Any, index: int, stage: Stage, watch: Callable[[Way], None]) -> Outcome:
    """The mesh in equilibrium under the load of `stage`, reached from the mesh as knitted. `watch` is called at every convergence
    check."""
    one = replace(model, scene=replace(model.scene, stages=(stage,)))
    simulation = Simulation(one, watch=lambda progress: watch(Way(index, progress.steps, progress.load_factor)))
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
    """One stage for each load; `run` yields outcomes as loads come to rest. For models that do not step many
    states by one launch, as `Batch` does."""

    def __init__(
        self,
        model: Any,
        stages: Sequence[Stage],
        *,
        watch: Callable[[StateProcesses], None] | None = None,
        processes: int | None = None,
    ) -> None:
        """`stages`: each load. `watch` is called again and again, and may raise to stop. `processes`: default `thread_count`."""
        self.model, self.stages = model, tuple(stages)
        self.processes = processes or thread_count(len(self.stages))
        self._watch = watch or (lambda _states: None)
        self._under_way: dict[int, Way] = {}
        self._finished = self._finished_steps = 0

    @property
    def steps(self) -> int:
        """Steps taken of all loads."""
        return self._finished_steps + sum(way.steps for way in self._under_way.values())

    @property
    def done(self) -> float:
        """Share of all loads that is on."""
        return (self._finished + sum(way.load_factor for way in self._under_way.values())) / max(1, len(self.stages))

    def run(self) -> Iterator[Outcome]:
        """Bring the mesh to rest under every load. Raises `OutOfResources`."""
        for outcome in self._in_processes() if self.processes > 1 else self._here():
            self._under_way.pop(outcome.index, None)
            self._finished += 1
            self._finished_steps += outcome.steps
            yield outcome

    def _here(self) -> Iterator[Outcome]:
        def watch(way: Way) -> None:
            self._under_way[way.index] = way
            self._watch(self)

        for index, stage in enumerate(self.stages):
            yield equilibrium_under(self.model, index, stage, watch)

    def _in_processes(self) -> Iterator[Outcome]:
        Simulation(self.model).compile()  # kernels are compiled once, not by all processes
        waiting = list(enumerate(self.stages))[::-1]
        with ExitStack() as stack:
            workers = [stack.enter_context(_Worker(self.model.scene)) for _ in range(self.processes)]
            busy = {}
            for worker in workers:
                worker.send(waiting.pop())
                busy[worker.pipe] = worker
            while busy:
                for pipe in wait(list(busy), SAY_INTERVAL):
                    worker = busy[pipe]  # type: ignore[index]
                    said = worker.receive()
                    if isinstance(said, Way):
                        self._under_way[said.index] = said
                        continue
                    if waiting:
                        worker.send(waiting.pop())
                    else:
                        del busy[worker.pipe]
                    yield said
                self._watch(self)


class _Worker:
    """A process that is handed loads."""

    def __init__(self, scene: Scene) -> None:
        try:
            self._process, self.pipe = start_process(PROCESS)
        except OSError as error:
            raise OutOfResources(f"memory ran out: a process that shares the loads did not start: {error.strerror}") from error
        self.send(scene)

    def __enter__(self) -> _Worker:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        """End it; it has nothing to put away."""
        self.pipe.close()
        self._process.kill()
        self._process.wait()

    def send(self, what: Scene | tuple[int, Stage]) -> None:
        try:
            self.pipe.send(what)
        except OSError:
            self.receive()  # it says why, or is gone

    def receive(self) -> Way | Outcome:
        """What it says of the load that it has. Raises whatever went wrong there."""
        try:
            said = self.pipe.recv()
        except (EOFError, OSError):
            raise OutOfResources(
                f"memory ran out, or somebody ended it: a process that shares the loads {ending_of(self._process)};"
                " what is done is kept, --resume goes on"
            ) from None
        if isinstance(said, Exception):
            raise said
        return said
