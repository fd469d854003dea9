"""The planar step beside a C loop and memory bandwidth, in one run.

Each case is measured in `--rounds` turns, warpknit and the C loop one after the other, and the best turn of each counts; on
a busy machine compare the ratio, not the speed. `--contact` steps the periodic mesh of scenes/atlas_cell.toml at 12 % with
its contacts; the C loop has none. The C loop (planar_loop.c) needs gcc. Compilation is timed apart.
"""

from __future__ import annotations

import argparse
import ctypes
import dataclasses
import math
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from warpknit.planar.model import Model, assemble_model
from warpknit.planar.state import State, initial_state
from warpknit.planar.step import Stepper
from warpknit.scene import load_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation

from .turns import best

HERE = Path(__file__).parent
CELL = HERE.parents[1] / "scenes/atlas_cell.toml"
CHUNK = 512  # of planar_loop.c
COORDINATES = 4  # x and y of displacement and velocity, each read and written once a step
REAL = {"single": (np.float32, ctypes.c_float, "float"), "double": (np.float64, ctypes.c_double, "double")}
GRAPH = 50  # steps are taken in multiples of it


# --- what is measured -------------------------------------------------------------------------------------------------


def tile(nodes: int, precision: str, device: str) -> Model:
    """A periodic tile of about `nodes` nodes."""
    one = build_model(load_scene(CELL)).panel.node_count
    columns = max(1, round(math.sqrt(nodes / one)))
    rows = max(1, round(nodes / one / columns))
    return build_model(load_scene(CELL, [f"knit.repeats=[{columns}, {rows}]", f"solver.precision='{precision}'"]), device)


def without_bodies(model: Model) -> Model:
    """The same wires, free of contact."""
    none, places = np.zeros(0, np.int32), np.zeros((0, 2))
    pairs = dict.fromkeys(("pair_wire", "pair_seed", "pair_table", "pair_low", "pair_high", "pair_side"), none)
    panel = dataclasses.replace(
        model.panel, body_rest=places, body_origin=places, pair_shift=places, rhombus_bodies=none, **pairs
    )
    scene = model.scene
    return assemble_model(
        scene, model.table, panel, device=model.device, loop_length=float(model.table.spacing[0]) * scene.model.nodes_per_loop,
        displacement_range=2 * max(scene.knit.wale_spacing, scene.knit.course_spacing), cloth=model.cloth,
    )  # fmt: skip


def stretched(model: Model) -> State:
    """The tile at 12 % both ways with its contacts closed: the steady state of one repeat, laid out over all."""
    scene = load_scene(CELL, ["load.strain_weft=0.12", "load.strain_warp=0.12", "output.frames=6",
                              f"solver.precision='{model.precision.name}'"])  # fmt: skip
    cell = build_model(scene)
    solved = initial_state(cell)
    for _record in Simulation(cell, solved).run():
        pass
    state = initial_state(model)
    threads, columns, rows = len(cell.table.nodes), *model.scene.knit.repeats
    bodies = cell.panel.body_count
    for name in ("node_ux", "node_uy"):
        values = getattr(solved, name)[solved.parity].numpy()
        wires = [np.tile(values[f : f + n], rows) for f, n in zip(cell.panel.wire_first, cell.panel.wire_count, strict=True)]
        by_thread = [wires[int(np.nonzero(cell.panel.wire_thread == t)[0][0])] for t in range(threads)]
        getattr(state, name)[0].assign(np.concatenate([by_thread[t] for t in model.panel.wire_thread]))
    for name, each in (("body_ux", 1), ("body_uy", 1), ("pair_slide", 2), ("pair_u", 2), ("pair_offset", 2)):
        values = getattr(solved, name).numpy().reshape(bodies, each)
        getattr(state, name).assign(np.tile(values, (columns * rows, 1)).ravel())
    state.steering.set(gradient=solved.gradient, contact_stiffness=solved.steering.contact_stiffness, damping=0.05)
    return state


class Steps:
    """Steps of a model, to be timed."""

    def __init__(self, model: Model, state: State, threads: int) -> None:
        self.model = model
        self.state = state
        state.steering.set(travel_limit=np.inf)
        begin = time.perf_counter()
        self.stepper = Stepper(model, state, threads=threads)
        self.stepper.step(GRAPH + 2)
        wp.synchronize_device(model.device)
        self.compile_s = time.perf_counter() - begin


class CLoop:
    """planar_loop.c with the rest data of the model's first thread, as one wire."""

    def __init__(self, model: Model, folder: Path) -> None:
        self.real, self.c_real, name = REAL[model.precision.name]
        library = folder / f"planar_loop_{name}.so"
        if not library.exists():
            command = ["gcc", "-O3", "-march=native", "-ffast-math", "-fopenmp", "-shared", "-fPIC", f"-DREAL={name}",
                       "-o", str(library), str(HERE / "planar_loop.c"), "-lm"]  # fmt: skip
            subprocess.run(command, check=True)
        self.library = ctypes.CDLL(str(library))
        table = model.table
        self.period = int(table.nodes[0])
        first = int(table.start[0])

        def of_period(values: np.ndarray) -> np.ndarray:
            period = values[first : first + self.period]
            return np.tile(period, 2 + 2 * CHUNK // self.period).astype(self.real)

        self.rest = [of_period(a) for a in (
            table.rest_x, table.rest_y, table.rest_length, table.rest_angle, model.bending_stiffness / table.hinge_length,
            1.0 / model.rest.node_mass.numpy(),
        )]  # fmt: skip
        self.axial = model.axial_stiffness / model.softening
        self.nodes = model.panel.node_count // self.period * self.period
        self.state = [np.zeros(self.nodes, self.real) for _ in range(6)]
        self.gradient = np.array([1.0, 0.0, 0.0, 1.0], self.real)

    def step(self, steps: int, threads: int) -> None:
        def address(values: np.ndarray) -> ctypes.c_void_p:
            return values.ctypes.data_as(ctypes.c_void_p)

        numbers = [self.c_real(v) for v in (self.axial, 0.99, 1.0, 1.0)]
        self.library.take_steps(
            ctypes.c_int64(self.nodes), ctypes.c_int64(self.period), steps, threads,
            *map(address, self.state), *map(address, self.rest), address(self.gradient), *numbers,
        )  # fmt: skip


def triad_bandwidth(library: ctypes.CDLL, threads: int, elements: int = 8_000_000) -> float:
    """Bandwidth [B/s] of a = b + s c beyond the cache; best of five rounds."""
    arrays = [np.ones(elements) for _ in range(3)]
    addresses = [a.ctypes.data_as(ctypes.c_void_p) for a in arrays]
    given = (ctypes.c_int64(elements), 1, threads, *addresses, ctypes.c_double(2.0))
    return 24.0 * elements / best({"triad": lambda: library.triad(*given)}, 5, device="cpu")["triad"]


def copy_bandwidth(device: str, bytes_: int = 1 << 28) -> float:
    """[B/s] of a copy on the device, read and write counted, the best of ten."""
    a, b = (wp.zeros(bytes_ // 4, dtype=wp.float32, device=device) for _ in range(2))
    wp.synchronize_device(device)
    return 2.0 * bytes_ / best({"copy": lambda: wp.copy(a, b)}, 10, device=device)["copy"]


# --- a case -----------------------------------------------------------------------------------------------------------


def measure(options: argparse.Namespace, nodes: int, precision: str, folder: Path) -> list[dict[str, Any]]:
    """One dictionary a number of threads."""
    model = tile(nodes, precision, options.device)
    if not options.contact:
        model = without_bodies(model)
    on_cpu = options.device == "cpu"
    loop = CLoop(model, folder) if on_cpu else None
    count = model.panel.node_count
    floor_bytes = 2 * COORDINATES * np.dtype(REAL[precision][0]).itemsize
    found = []
    for threads in options.threads if on_cpu else [1]:
        state = stretched(model) if options.contact else initial_state(model)
        steps = Steps(model, state, threads)
        number = max(1, round(options.seconds * 2e8 * threads / count / GRAPH)) * GRAPH if on_cpu else 40 * GRAPH
        works: dict[str, Callable[[], object]] = {"warpknit": partial(steps.stepper.step, number)}
        if loop is not None:
            works["c"] = partial(loop.step, number, threads)
        seconds = {name: taken / number for name, taken in best(works, options.rounds, device=options.device).items()}
        bandwidth = triad_bandwidth(loop.library, threads) if loop is not None else copy_bandwidth(options.device)
        found.append({
            "case": "contact" if options.contact else "free",
            "nodes": count,
            "precision": precision,
            "threads": threads,
            "device": options.device,
            "node_steps_per_s": count / seconds["warpknit"],
            "compile_s": round(steps.compile_s, 3),
            "c_loop_node_steps_per_s": loop.nodes / seconds["c"] if loop is not None else None,
            "bandwidth_floor_node_steps_per_s": bandwidth / floor_bytes,
        })  # fmt: skip
    return found


def cases(options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """A dictionary a size, precision and number of threads."""
    with tempfile.TemporaryDirectory() as folder:
        for nodes in options.nodes:
            for precision in options.precision:
                yield from measure(options, int(nodes), precision, Path(folder))
