"""Both models on a GPU: copy bandwidth, steps at many sizes, both scenes of a million nodes.

Steps start from a periodic tile at its load, one repeat in equilibrium laid out over all; free wires have no contact. Bytes of a
step count the arrays of its launches: read once, written once, without kernels that few contacts need. Runs of scenes write no
files. `--minutes` shortens the list: cases that would exceed the remaining time are noted as left out.
"""

from __future__ import annotations

import argparse
import math
import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from warpknit.base.errors import MemoryNeeded, OutOfResources
from warpknit.compute.launch import Launch
from warpknit.mesh.rim import LoadPoint
from warpknit.scene import Scene, load_scene
from warpknit.solve.model import build_model
from warpknit.solve.progress import Progress
from warpknit.solve.simulate import Simulation

from .planar import copy_bandwidth
from .turns import best

SCENES = Path(__file__).parents[2] / "scenes"
CELLS = {"planar": "atlas_cell.toml", "spatial": "atlas_cell_spatial.toml"}
MILLIONS = ("panel_million.toml", "panel_million_spatial.toml")
STRAIN = 0.1  # weft and warp
STEPS = 50  # of a turn: a graph, or a check
REPEATS = 20  # of a launch that is timed alone
# kernels that empty and fill the lists which the next ones fill and read
EMPTIES = ("empty_pair_lists", "list_awake_pairs", "find_followed_contacts")
FEW = ("find_closest_places", "warpknit.kernels.wire_contact_forces")  # kernel and module that find what few contacts leave
SMALL = 200  # nodes of a mesh that compiles the kernels, before anything is timed
NO_ROOM = (MemoryError, RuntimeError, MemoryNeeded, OutOfResources)  # Warp's, and a model's
# methods of the drive and of the mechanics of the largest mesh, timed each without those inside it
DRIVE = {"_solve_smaller": "smaller meshes", "_prepare": "response of the cloth", "_apply": "start from the smaller mesh"}
MECHANICS = {
    "step": "steps",
    "check": "checks",
    "renew": "checks",
    "search": "searches",
    "observe": "records",
    "compile": "compile",
}
MEMBRANE = {"imbalance": "membrane", "follow": "membrane", "move": "membrane", "renew": "membrane"}


class OutOfTime(Exception):
    """The time budget is spent."""


# --- steps ------------------------------------------------------------------------------------------------------------


def at_load(kind: str, nodes: int, precision: str, device: str) -> Simulation:
    """A periodic tile of about `nodes` nodes, at its load."""
    settings = [
        "solver.preset=draft",
        f"solver.precision={precision}",
        "output.frames=1",
        f"load.strain_weft={STRAIN}",
        f"load.strain_warp={STRAIN}",
    ]
    one = build_model(load_scene(SCENES / CELLS[kind], settings)).node_count
    side = max(1, round(math.sqrt(nodes / one)))
    scene = load_scene(SCENES / CELLS[kind], [*settings, f"knit.repeats=[{side}, {max(2, round(nodes / one / side))}]"])
    simulation = Simulation(build_model(scene, device))
    simulation.mechanics.search()
    drive: Any = simulation.drive
    next(drive.reach(LoadPoint((1.0 + STRAIN) * np.eye(2), scene.stages[0].temperature)))
    while drive.state.steering.ramp_step < drive.state.steering.ramp_steps:
        drive.mechanics.step(STEPS)
    return simulation


def step_launches(stepper: Any, *, free: bool) -> list[list[Launch]]:
    """The launches of two steps one after the other: planar nodes are stored twice, in turn."""
    turns = [stepper.launches(parity) for parity in (0, 1)] if hasattr(stepper, "by_pair") else 2 * [stepper.launches()]
    contact = ("contact", "friction", "bodies", "wire_closest", "wire_contact_by_batch", "wire_contact_forces", "wire_friction")
    return [[one for one in turn if not free or one.kernel.module.name.rsplit(".", 1)[-1] not in contact] for turn in turns]


def bytes_of(launch: Launch) -> int:
    """[B] of the arrays of a launch by the comments in its kernel: what it reads, and what it writes; not what a condition behind
    a comma leaves to evaluations or to meshes with a load of the nodes."""
    if launch.threads == 0:
        return 0
    way, conditional, total = "in", "", 0
    given = dict(zip((argument.label for argument in launch.kernel.adj.args), launch.arguments, strict=True))
    for line in launch.kernel.adj.source.splitlines():
        if said := re.match(r"\s*# (?:state )?(in and out|in|out)\b(,?)", line):
            way, conditional = said[1], said[2]
        named = re.match(r"\s+(\w+): ", line)
        if named and isinstance(array := given.pop(named[1], None), wp.array) and not conditional:
            total += array.capacity * (2 if way == "in and out" else 1)
    return total


def steps(kind: str, nodes: int, options: argparse.Namespace, copy: float) -> Iterator[dict[str, Any]]:
    """With contact and free, by graphs and launch by launch."""
    begin, device = time.perf_counter(), options.device
    simulation = at_load(kind, nodes, options.precision[0], device)
    stepper, state, count = simulation.mechanics.stepper, simulation.state, simulation.model.node_count
    state.steering.set(travel_limit=math.inf, time_step=0.0)  # the state stays, also without contact
    built = time.perf_counter() - begin
    for free in (False, True):
        turns = step_launches(stepper, free=free)
        recorded = [[one.record(device) for one in turn if one.threads] for turn in turns]

        def alone(recorded: list[list[wp.Launch]] = recorded) -> None:
            for k in range(STEPS):
                for one in recorded[k % 2]:
                    one.launch()

        with wp.ScopedCapture(device=device) as capture:
            alone()
        works = {"graph": partial(wp.capture_launch, capture.graph), "launches": alone}
        best(works, 1, device=device)
        number = sum(bytes_of(one) for one in turns[0] if not {one.kernel.key, one.kernel.module.name} & set(FEW)) / count
        kernels = times_of_launches(recorded[0], [one for one in turns[0] if one.threads], options)
        for way, seconds in best(works, options.rounds, device=device).items():
            speed = count * STEPS / seconds
            yield {
                "case": f"{kind}, {'free' if free else 'in contact'}, {way}",
                "nodes": count,
                "precision": options.precision[0],
                "step_us": 1e6 * seconds / STEPS,
                "node_steps_per_s": speed,
                "bytes_a_node_step": number,
                "share_of_copy": number * speed / copy,
                "built_s": built,
                "launches": kernels if way == "launches" else [],
            }


def times_of_launches(recorded: list[wp.Launch], launches: list[Launch], options: argparse.Namespace) -> list[dict[str, Any]]:
    """Time of each launch of a step, repeated alone. Where it fills a list, behind the launch that empties it."""
    groups: list[list[int]] = []
    for k in range(len(launches)):
        if k > 0 and launches[k - 1].kernel.key in EMPTIES:
            groups[-1].append(k)
        else:
            groups.append([k])

    def repeat(group: list[int]) -> None:
        for _ in range(REPEATS):
            for k in group:
                recorded[k].launch()

    found = best({group[-1]: partial(repeat, group) for group in groups}, options.rounds, device=options.device)
    return [
        {"kernel": one.kernel.key, "threads": one.threads, "us": 1e6 * found[k] / REPEATS, "bytes": bytes_of(one)}
        for k, one in enumerate(launches)
        if k in found
    ]


# --- whole scenes -----------------------------------------------------------------------------------------------------


class Parts:
    """Time [s] of methods, each without the methods that it calls."""

    def __init__(self, device: str) -> None:
        self.seconds: dict[str, float] = {}
        self._device, self._inside = device, [0.0]

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        begin = time.perf_counter()
        self._inside.append(0.0)
        try:
            yield
        finally:
            wp.synchronize_device(self._device)
            taken = time.perf_counter() - begin
            self.seconds[name] = self.seconds.get(name, 0.0) + taken - self._inside.pop()
            self._inside[-1] += taken

    def time(self, owner: Any, methods: dict[str, str]) -> None:
        """Have calls of these methods of an object timed under a name."""
        for method, name in methods.items():
            if hasattr(owner, method):
                setattr(owner, method, self._timed(getattr(owner, method), name))

    def _timed(self, method: Callable[..., Any], name: str) -> Callable[..., Any]:
        def timed(*given: Any, **named: Any) -> Any:
            with self.part(name):
                return method(*given, **named)

        return timed


def whole(scene: Scene, device: str, end: float) -> dict[str, Any]:
    """A run of a scene and its parts; one that is not done at the time `end` is broken off."""
    parts, finished = Parts(device), True

    def stop_late(_progress: Progress) -> None:
        if time.perf_counter() > end:
            raise OutOfTime

    begin = time.perf_counter()
    with parts.part("mesh and model"):
        model = build_model(scene, device)
    with parts.part("smaller meshes built"):
        simulation = Simulation(model, monitor=stop_late)
    drive = simulation.drive
    for owner, methods in ((drive, DRIVE), (drive.mechanics, MECHANICS), (getattr(drive, "membrane", None), MEMBRANE)):
        parts.time(owner, methods)
    with parts.part("compile"):
        simulation.compile()
    try:
        with parts.part("rest"):
            for _record in simulation.run():
                pass
    except OutOfTime:
        finished = False
    return {
        "case": f"{scene.name}, whole",
        "nodes": model.node_count,
        "finished": finished,
        "steps": simulation.progress.steps,
        "wall_s": time.perf_counter() - begin,
        "parts_s": parts.seconds,
    }


# --- all --------------------------------------------------------------------------------------------------------------


def cases(options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """A dictionary a case: the bandwidth, both models from small to large, then the scenes, as far as time and memory allow."""
    end = time.perf_counter() + 60.0 * options.minutes
    device = wp.get_device(options.device)
    copy = copy_bandwidth(options.device)
    yield {"case": "copy", "device": device.name, "warp": wp.__version__, "copy_bytes_per_s": copy}
    spent = {
        kind: [(SMALL, seconds_of(partial(list, steps(kind, SMALL, options, copy)))) for _ in range(2)][1:] for kind in CELLS
    }
    for nodes in map(int, options.nodes):
        for kind in CELLS:
            begin, needed = time.perf_counter(), expected(spent[kind], nodes)
            if begin + needed > end - options.scenes * 60.0 * options.minutes:
                yield {"case": f"{kind}, steps", "nodes": nodes, "left_out": f"no time: would take about {needed:.0f} s"}
                continue
            try:
                yield from steps(kind, nodes, options, copy)
            except NO_ROOM as error:
                yield {"case": f"{kind}, steps", "nodes": nodes, "left_out": str(error)}
            spent[kind].append((nodes, time.perf_counter() - begin))
    for number, name in enumerate(MILLIONS if options.scenes > 0.0 else ()):
        now = time.perf_counter()
        scene = load_scene(SCENES / name, options.overrides)
        try:
            yield whole(scene, options.device, now + (end - now) / (len(MILLIONS) - number))
        except NO_ROOM as error:
            yield {"case": f"{scene.name}, whole", "nodes": 0, "left_out": str(error)}


def seconds_of(work: Callable[[], object]) -> float:
    """[s] of a call."""
    begin = time.perf_counter()
    work()
    return time.perf_counter() - begin


def expected(spent: list[tuple[int, float]], nodes: int) -> float:
    """Expected time [s] of a case, linear in the number of nodes; the first case is tried."""
    (first, begin), (last, seconds) = spent[0], spent[-1]
    return seconds + max(0.0, seconds - begin) * (nodes - last) / max(1, last - first)


def table(found: list[dict[str, Any]]) -> str:
    """The cases as text."""
    lines = [f"{'case':<40}{'nodes':>12}{'step [us]':>12}{'node-steps/s':>14}{'B/node-step':>13}{'of copy':>9}"]
    for one in found:
        if "copy_bytes_per_s" in one:
            lines.append(f"copy on {one['device']}: {one['copy_bytes_per_s']:.3g} B/s")
        elif "left_out" in one:
            lines.append(f"{one['case']:<40}{one['nodes']:>12,}  left out: {one['left_out']}")
        elif "wall_s" in one:
            end = "" if one["finished"] else ", not finished"
            lines.append(f"{one['case']:<40}{one['nodes']:>12,}  {one['wall_s']:.1f} s, {one['steps']:,} steps{end}")
            lines += [
                f"    {part:<36}{seconds:>12.2f} s" for part, seconds in sorted(one["parts_s"].items(), key=lambda p: -p[1])
            ]
        else:
            numbers = f"{one['step_us']:>12.1f}{one['node_steps_per_s']:>14.3g}{one['bytes_a_node_step']:>13.0f}"
            lines.append(f"{one['case']:<40}{one['nodes']:>12,}{numbers}{one['share_of_copy']:>9.2f}")
            lines += [
                f"    {launch['kernel']:<36}{launch['threads']:>12,}{launch['us']:>12.1f}{launch['bytes'] / one['nodes']:>27.0f}"
                for launch in one["launches"]
            ]
    return "\n".join(lines)
