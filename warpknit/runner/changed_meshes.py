"""Meshes of a scene with changes in nodes, friction and load; run here, or by a process beside the run."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from multiprocessing.connection import Connection

from warpknit.base.errors import ModelError
from warpknit.base.processes import start_process
from warpknit.knit.lapping import KnitError
from warpknit.mechanics.numerics import thread_count
from warpknit.results.row import Row
from warpknit.runner.history import row_of
from warpknit.scene import Scene
from warpknit.scene.options import Stage
from warpknit.solve.variant_models import VariantModels, last_records

COARSENING = 1.4  # nodes a loop of the run over the comparison's
NODES = "nodes"
FRICTIONS = {"friction_half": 0.5, "friction_double": 2.0}  # factors by which it is uncertain
INTERVAL = 0.1  # [s] between calls of the monitor while another process runs the meshes

Check = Callable[[int], None]  # is called with the time steps so far, may raise to stop
ChangedRows = dict[str, dict[int, Row]]  # the last row of each mesh, by change and number


def changes_of(scene: Scene) -> dict[str, Scene]:
    """Scenes by what they change: the nodes a loop, and with these, which cost less, one thing more each."""
    friction, overshoot, nodes = scene.contact.friction, scene.variants.overshoot, fewer_nodes(scene)
    coarse = replace(scene, model=replace(scene.model, nodes_per_loop=nodes))
    found = {NODES: coarse}
    if friction > 0.0:
        for name, factor in FRICTIONS.items():
            found[name] = replace(coarse, contact=replace(scene.contact, friction=factor * friction))
    if overshoot > 0.0:
        found["overshoot"] = replace(coarse, stages=(_overshot(scene.stages[0], overshoot), *scene.stages))
    return found


def fewer_nodes(scene: Scene) -> int:
    """Nodes a loop of the comparison."""
    return round(scene.model.nodes_per_loop / COARSENING)


def _overshot(stage: Stage, overshoot: float) -> Stage:
    """The first load step, further by a share of its strains and tensions."""
    names = ("strain_weft", "strain_warp", "tension_weft", "tension_warp")
    driven = {name: (1.0 + overshoot) * value for name in names if (value := getattr(stage, name)) is not None}
    return replace(stage, name="overshoot", **driven)


def changed_rows(scene: Scene, device: str, numbers: list[int], check: Check) -> ChangedRows:
    """Rows of the meshes `numbers` with each change; of those whose loops fit, and that run to the end."""
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


class Beside:
    """Rows of changed meshes from another process."""

    def __init__(self, pipe: Connection, numbers: list[int]) -> None:
        self._pipe, self._numbers = pipe, numbers

    def rows(self, numbers: list[int], check: Check) -> ChangedRows | None:
        """Rows of the meshes; None of others than were begun, and where the process has failed."""
        if numbers != self._numbers:
            return None
        with suppress(EOFError, OSError):
            while not self._pipe.poll(INTERVAL):
                check(0)
            rows: ChangedRows = self._pipe.recv()
            return rows
        return None


@contextmanager
def beside(scene: Scene, device: str, numbers: list[int]) -> Iterator[Beside | None]:
    """Begin with the changes of meshes; None on a GPU or a single core, which both would share."""
    started = None
    if device == "cpu" and thread_count(2) > 1 and os.name == "posix":
        with suppress(OSError):
            started = start_process(__spec__.name)
    if started is None:
        yield None
        return
    process, pipe = started
    with process, pipe:
        try:
            with suppress(OSError):
                pipe.send((scene, numbers))
            yield Beside(pipe, numbers)
        finally:
            process.kill()


def main(arguments: list[str]) -> None:
    """Send the rows of what comes through the pipe, until the run closes it."""
    for number in (signal.SIGINT, signal.SIGTERM):  # meant for the run
        signal.signal(number, signal.SIG_IGN)
    os.environ["WARPKNIT_THREADS"] = "1"  # the run has the other cores
    pipe = Connection(int(arguments[0]))

    def check(_steps: int) -> None:
        if pipe.poll():
            raise EOFError

    with suppress(Exception):  # the run then finds them itself, and reports why not
        scene, numbers = pipe.recv()
        pipe.send(changed_rows(scene, "cpu", numbers, check))


if __name__ == "__main__":
    main(sys.argv[1:])
