"""Speed of the planar step beside a C loop and the memory bandwidth, measured in the same run: one JSON line a case.

    python tools/bench.py                                    free wires, 1e4 to 1e6 nodes, both precisions, 1 and 2 threads
    python tools/bench.py --nodes 1e7 --contact --precision single
    python tools/bench.py --device cuda:0                    on a GPU, beside the copy bandwidth
    python tools/bench.py --usd --nodes 1e6                  what writing frames as USD costs, see bench_usd.py
    python tools/bench.py --space --nodes 500 5000           steps in space, and what its parts take, see spatial_cost.py

Each case is measured in `--rounds` turns, warpknit and the C loop one after the other, and the best turn of each counts; on
a busy machine compare the ratio, not the speed. `--contact` steps the periodic mesh of scenes/atlas_cell.toml at 12 % with
its contacts; the C loop has none. The C loop (bench_loop.c) needs gcc. Compilation is timed apart.
"""

from __future__ import annotations

import argparse
import ctypes
import dataclasses
import json
import math
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from warpknit.device import find_device
from warpknit.kernels import control as c
from warpknit.planar.model import (Model, build_model)
from warpknit.planar.state import State, initial_state
from warpknit.planar.step import Stepper
from warpknit.scene import load_scene
from warpknit.solve.simulate import Simulation

HERE = Path(__file__).parent
CELL = HERE.parent / "scenes/atlas_cell.toml"
CHUNK = 512  # of bench_loop.c
COORDINATES = 4  # x and y of displacement and velocity, each read and written once a step
REAL = {"single": (np.float32, ctypes.c_float, "float"), "double": (np.float64, ctypes.c_double, "double")}
GRAPH = 50  # steps are taken in multiples of it


# --- what is measured -------------------------------------------------------------------------------------------------


def tile(nodes: int, precision: str, device: str) -> Model:
    """A periodic tile of about so many nodes."""
    one = build_model(load_scene(CELL)).panel.node_count
    columns = max(1, round(math.sqrt(nodes / one)))
    rows = max(1, round(nodes / one / columns))
    return build_model(load_scene(CELL, [f"knit.repeats=[{columns}, {rows}]", f"solver.precision='{precision}'"]), device)


def without_bodies(model: Model) -> Model:
    """The same wires, free of contact."""
    from warpknit.planar.model import assemble_model

    none, places = np.zeros(0, np.int32), np.zeros((0, 2))
    pairs = {name: none for name in ("pair_wire", "pair_seed", "pair_table", "pair_low", "pair_high", "pair_side")}
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
    kept = solved.read_control()
    state.write_control({int(c.GRADIENT) + k: kept[int(c.GRADIENT) + k] for k in range(4)})
    state.write_control({c.CONTACT_STIFFNESS: kept[int(c.CONTACT_STIFFNESS)], c.DAMPING: 0.05})
    return state


class Steps:
    """Steps of a model, to be timed."""

    def __init__(self, model: Model, state: State, threads: int) -> None:
        self.model = model
        self.state = state
        state.write_control({c.TRAVEL_LIMIT: np.inf})
        begin = time.perf_counter()
        self.stepper = Stepper(model, state, threads=threads)
        self.stepper.step(GRAPH + 2)
        wp.synchronize_device(model.device)
        self.compile_s = time.perf_counter() - begin

    def seconds(self, steps: int) -> float:
        begin = time.perf_counter()
        self.stepper.step(steps)
        wp.synchronize_device(self.model.device)
        return time.perf_counter() - begin


class CLoop:
    """bench_loop.c with the rest data of the model's first thread, as one wire of as many nodes."""

    def __init__(self, model: Model, folder: Path) -> None:
        self.real, self.c_real, name = REAL[model.precision.name]
        library = folder / f"bench_loop_{name}.so"
        if not library.exists():
            command = ["gcc", "-O3", "-march=native", "-ffast-math", "-fopenmp", "-shared", "-fPIC", f"-DREAL={name}",
                       "-o", str(library), str(HERE / "bench_loop.c"), "-lm"]  # fmt: skip
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

    def seconds(self, steps: int, threads: int) -> float:
        def address(values: np.ndarray) -> ctypes.c_void_p:
            return values.ctypes.data_as(ctypes.c_void_p)

        numbers = [self.c_real(v) for v in (self.axial, 0.99, 1.0, 1.0)]
        begin = time.perf_counter()
        self.library.take_steps(
            ctypes.c_int64(self.nodes), ctypes.c_int64(self.period), steps, threads,
            *map(address, self.state), *map(address, self.rest), address(self.gradient), *numbers,
        )  # fmt: skip
        return time.perf_counter() - begin


def triad_bandwidth(library: ctypes.CDLL, threads: int, elements: int = 8_000_000) -> float:
    """[B/s] of a = b + s c on arrays far beyond the cache, the best of five rounds."""
    arrays = [np.ones(elements) for _ in range(3)]
    addresses = [a.ctypes.data_as(ctypes.c_void_p) for a in arrays]
    best = math.inf
    for _ in range(5):
        begin = time.perf_counter()
        library.triad(ctypes.c_int64(elements), 1, threads, *addresses, ctypes.c_double(2.0))
        best = min(best, time.perf_counter() - begin)
    return 24.0 * elements / best


def copy_bandwidth(device: str, bytes_: int = 1 << 28) -> float:
    """[B/s] of a copy on the device, read and write counted, the best of ten."""
    a, b = (wp.zeros(bytes_ // 4, dtype=wp.float32, device=device) for _ in range(2))
    best = math.inf
    for _ in range(10):
        wp.synchronize_device(device)
        begin = time.perf_counter()
        wp.copy(a, b)
        wp.synchronize_device(device)
        best = min(best, time.perf_counter() - begin)
    return 2.0 * bytes_ / best


# --- a case -----------------------------------------------------------------------------------------------------------


def measure(args: argparse.Namespace, nodes: int, precision: str, folder: Path) -> list[dict[str, Any]]:
    """One dictionary a number of threads."""
    model = tile(nodes, precision, args.device)
    if not args.contact:
        model = without_bodies(model)
    on_cpu = args.device == "cpu"
    loop = CLoop(model, folder)
    count = model.panel.node_count
    floor_bytes = 2 * COORDINATES * np.dtype(REAL[precision][0]).itemsize
    found = []
    for threads in args.threads if on_cpu else [1]:
        state = stretched(model) if args.contact else initial_state(model)
        steps = Steps(model, state, threads)
        number = max(1, round(args.seconds * 2e8 * threads / count / GRAPH)) * GRAPH if on_cpu else 40 * GRAPH
        ours, theirs = math.inf, math.inf
        for _ in range(args.rounds):
            ours = min(ours, steps.seconds(number) / number)
            if on_cpu:
                theirs = min(theirs, loop.seconds(number, threads) / number)
        bandwidth = triad_bandwidth(loop.library, threads) if on_cpu else copy_bandwidth(args.device)
        found.append({
            "case": "contact" if args.contact else "free",
            "nodes": count,
            "precision": precision,
            "threads": threads,
            "device": args.device,
            "node_steps_per_s": count / ours,
            "compile_s": round(steps.compile_s, 3),
            "c_loop_node_steps_per_s": loop.nodes / theirs if on_cpu else None,
            "bandwidth_floor_node_steps_per_s": bandwidth / floor_bytes,
        })  # fmt: skip
    return found


def bench_usd(args: argparse.Namespace) -> None:
    from bench_usd import panel, slowdown, write_speed

    for nodes in args.nodes:
        model = panel(int(nodes))
        print(json.dumps(write_speed(model, frames=args.frames, rounds=args.rounds, on=args.folder)), flush=True)
        for threads in args.threads:
            found = slowdown(model, frames=args.frames, steps=args.steps, threads=threads, on=args.folder)
            print(json.dumps(found), flush=True)


def bench_space(args: argparse.Namespace) -> None:
    from spatial_cost import SCENE, measure

    from warpknit.spatial.mesh import build_mesh

    one = build_mesh(load_scene(SCENE, ["model.nodes_per_loop=64"])).rods.node_count
    for nodes in args.nodes:
        print(json.dumps(measure(repeats=max(1, round(math.sqrt(nodes / one))), rounds=args.rounds)), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--nodes", type=float, nargs="+", default=[1e4, 1e5, 1e6])
    parser.add_argument("--precision", nargs="+", choices=tuple(REAL), default=list(REAL))
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--contact", action="store_true", help="the periodic mesh with its contacts at 12 %% strain")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=0.3, help="about how long a turn takes")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--usd", action="store_true", help="write frames, beside numpy.tofile and while stepping")
    parser.add_argument("--space", action="store_true", help="cells of the spatial model at 10 %%")
    parser.add_argument("--frames", type=int, default=20, help="of --usd")
    parser.add_argument("--steps", type=int, default=400, help="of --usd, between two frames")
    parser.add_argument("--folder", type=Path, help="of --usd: where to write.  [default: the system's for temporary files]")
    args = parser.parse_args()
    args.device = find_device(args.device)
    if args.usd or args.space:
        (bench_usd if args.usd else bench_space)(args)
        return
    with tempfile.TemporaryDirectory() as folder:
        for nodes in args.nodes:
            for precision in args.precision:
                for found in measure(args, int(nodes), precision, Path(folder)):
                    print(json.dumps(found), flush=True)


if __name__ == "__main__":
    main()
