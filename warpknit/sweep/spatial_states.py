"""Many loads of one mesh in space, each brought to rest by itself as `warpknit run` does, in several processes.

A mesh in space is stepped on one core, so as many loads are under way as there are cores. Each process (state_process.py) builds
the mesh from the scene and is handed one load after the other; what it finds does not depend on which process has it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from multiprocessing.connection import wait
from types import TracebackType

from ..errors import Diverged, OutOfResources
from ..processes import ending_of, start_process
from ..scene import Scene, Stage
from ..spatial.estimate import process_count
from ..spatial.mesh import SpatialMesh
from ..spatial.observables import SpatialObservables
from ..spatial.relax import SpatialRelaxation
from .outcome import Outcome

PROCESS = f"{__package__}.state_process"
SAY_INTERVAL = 0.5  # [s] between what is heard of a load that is under way


@dataclass(frozen=True)
class Way:
    """How far a load is under way."""

    index: int
    steps: int
    load_factor: float


def bring_to_rest(mesh: SpatialMesh, index: int, stage: Stage, watch: Callable[[Way], None]) -> Outcome:
    """The mesh at rest under the load of `stage`, reached from the mesh as knitted. `watch` is called at every look."""
    one = replace(mesh, scene=replace(mesh.scene, stages=(stage,)))
    relaxation = SpatialRelaxation(one, lambda progress: watch(Way(index, progress.steps, progress.load_factor)))
    relaxation.warm_up()
    reading: SpatialObservables | None = None
    error: Diverged | None = None
    try:
        for record in relaxation.run():
            reading = record.observables
    except Diverged as failure:
        reading, error = None, failure
    return Outcome(index, relaxation.progress.steps, reading, error)


class SpatialStates:
    """One stage for each load; `run` yields outcomes as loads come to rest. The counterpart of `Batch` in space."""

    def __init__(
        self,
        mesh: SpatialMesh,
        stages: Sequence[Stage],
        *,
        watch: Callable[[SpatialStates], None] | None = None,
        processes: int | None = None,
    ) -> None:
        """`stages`: each load. `watch` is called again and again, and may raise to stop. `processes`: default `process_count`."""
        self.mesh, self.stages = mesh, tuple(stages)
        self.processes = processes or process_count(len(self.stages))
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
            yield bring_to_rest(self.mesh, index, stage, watch)

    def _in_processes(self) -> Iterator[Outcome]:
        SpatialRelaxation(self.mesh).warm_up()  # kernels are compiled once, not by all processes
        waiting = list(enumerate(self.stages))[::-1]
        with ExitStack() as stack:
            workers = [stack.enter_context(_Worker(self.mesh.scene)) for _ in range(self.processes)]
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
