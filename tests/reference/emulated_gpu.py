"""Runs of small scenes as on a GPU, on the CPU: a thread a node and a pair, in any order, and the states that come out.

    python tests/reference/emulated_gpu.py RESULT.json [--order forward|reversed|permuted] [--only WORD] [--arch 90 75]

The device `cuda:0` of this process is the CPU, so that runs take the way of a GPU, and what the host reads are copies. `--order`
is that in which the threads of every launch run. `--arch` compiles each module that was used, with the overloads that were
launched, for these compute capabilities, and notes what cuobjdump says of its kernels. A process of its own, with a kernel cache
of its own, as Warp's templates are changed.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib
import json
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from warp._src import codegen, context

SCENES = Path(__file__).parents[2] / "scenes"
DEVICE = "cuda:0"
LOOP = "{name}_cpu_kernel_forward<wp_linear_contiguous>(*dim, task_index, _wp_args);"
# a stride that shares no factor with the number of threads visits each of them once
PERMUTED = """size_t stride = dim->size / 2 + 1;
        for (size_t a = stride, b = dim->size; b != 0 || a != 1;) {{
            if (b == 0) {{ a = ++stride; b = dim->size; continue; }}
            const size_t rest = a % b; a = b; b = rest;
        }}
        const size_t task = (task_index * stride + dim->size / 3) % dim->size;"""
ORDERS = {
    "forward": "const size_t task = task_index;",
    "reversed": "const size_t task = dim->size - 1 - task_index;",
    "permuted": PERMUTED,
}
CASES: dict[str, tuple[str, list[str]]] = {
    "planar cell": ("atlas_cell.toml", ["solver.preset=draft", "output.frames=1"]),
    "planar cell, double, friction": (
        "friction_cycle.toml", ["solver.preset=draft", "solver.precision=double", "output.frames=1"],
    ),
    "planar patch, yield": (
        "atlas_patch.toml", ["knit.repeats=[2, 2]", "solver.preset=draft", "wire.plastic=true", "output.frames=1"],
    ),
    "planar panel, from a smaller mesh": (
        "atlas_patch.toml", ["knit.repeats=[12, 12]", "solver.preset=draft", "output.frames=1", "solver.residual_tolerance=0.05"],
    ),
    "planar ramp": (
        "atlas_cell.toml", ["solver.preset=draft", "solver.drive=ramp", "solver.loading_time=2e-5 s", "output.frames=1"],
    ),
    "spatial cell": ("atlas_cell_spatial.toml", ["solver.preset=draft", "output.frames=1"]),
    "spatial patch, friction, yield": (
        "atlas_cell_spatial.toml",
        ["model.boundary=gripped", "knit.repeats=[1, 1]", "solver.preset=draft", "wire.plastic=true", "contact.friction=0.1",
         "load.strain_weft=0.04", "load.strain_warp=0.04", "output.frames=1"],
    ),
    "spatial panel, from a smaller mesh": (
        "atlas_cell_spatial.toml",
        ["model.boundary=gripped", "knit.repeats=[11, 11]", "solver.preset=draft", "output.frames=1",
         "solver.residual_tolerance=0.05"],
    ),
}  # fmt: skip


def set_order(order: str) -> None:
    """Have the threads of each CPU launch run in this order, in modules that are compiled from now on."""
    named = "cpu_module_template_forward"
    template = getattr(codegen, named)
    if template.count(LOOP) != 1:
        raise RuntimeError(f"Warp's {named} has changed: the order of threads can't be set")
    setattr(codegen, named, template.replace(LOOP, f"{ORDERS[order]}\n        {LOOP.replace('task_index', 'task')}"))


def emulate() -> None:
    """Have a device of this name, whose arrays the host does not share. To be called before what uses host.py is imported."""
    context.runtime.device_map[DEVICE] = context.runtime.cpu_device
    wp.get_devices = lambda: ["cpu", DEVICE]
    view = wp.array.numpy
    wp.array.numpy = lambda array: view(array).copy()
    host = importlib.import_module("warpknit.host")
    host.is_in_place = lambda device: False


def noted(launch: Callable[..., Any], used: dict[context.Module, None]) -> Callable[..., Any]:
    """`wp.launch` that notes the modules of the kernels."""

    def noting(kernel: wp.Kernel, *given: Any, **named: Any) -> Any:
        used[kernel.module] = None
        return launch(kernel, *given, **named)

    return noting


def states(only: str) -> Iterator[tuple[str, dict[str, str], list[float]]]:
    """Of each case its name, a hash of each array of its last state, and tension and active share there."""
    from warpknit import measure
    from warpknit.model import build_model
    from warpknit.scene import load_scene
    from warpknit.solve.simulate import Simulation

    for name, (scene, overrides) in CASES.items():
        if only in name:
            simulation = Simulation(build_model(load_scene(SCENES / scene, overrides), DEVICE))
            for record in simulation.run():
                found = record.observables
            arrays = simulation.state.arrays()
            hashes = {key: hashlib.sha256(np.ascontiguousarray(values)).hexdigest()[:16] for key, values in arrays.items()}
            yield name, hashes, [*map(float, measure.mesh_tension(found)), float(measure.contacts(found).active_percent)]


def resources(arch: int, used: Iterable[context.Module]) -> Iterator[tuple[str, list[int]]]:
    """Compile the modules for `arch`; of each kernel, with the types of one of its launches, registers and stack [B] a thread."""
    tool = shutil.which("cuobjdump") or next(
        (str(path) for path in Path(sys.prefix).glob("lib/python*/site-packages/nvidia/cu*/bin/cuobjdump")), None
    )
    for module in used:
        with tempfile.TemporaryDirectory() as folder:
            wp.compile_aot_module(module, arch=arch, module_dir=folder, use_ptx=False)
            if tool is None:
                continue
            for cubin in Path(folder).glob("*.cubin"):
                command = [tool, "--dump-resource-usage", str(cubin)]
                said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
                for kernel, line in re.findall(r"Function (\S+)_[0-9a-f]+_cuda_kernel_forward:\s*\n\s*(REG:.*)", said):
                    yield kernel, [int(number) for number in re.findall(r"(?:REG|STACK):(\d+)", line)]


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("result", type=Path)
    parser.add_argument("--order", choices=ORDERS, default="forward")
    parser.add_argument("--only", default="")
    parser.add_argument("--arch", type=int, nargs="*", default=[])
    given = parser.parse_args()
    set_order(given.order)
    wp.init()
    emulate()
    used: dict[context.Module, None] = {}
    wp.launch = noted(wp.launch, used)
    result: dict[str, Any] = {"states": {}, "figures": {}, "kernels": {}}
    for name, hashes, figures in states(given.only):
        result["states"][name], result["figures"][name] = hashes, figures
    for arch in given.arch:
        most: dict[str, list[int]] = {}
        for kernel, numbers in sorted(resources(arch, used)):
            most[kernel] = [max(pair) for pair in zip(numbers, most.get(kernel, [0, 0]), strict=True)]
        result["kernels"][str(arch)] = most
    given.result.write_text(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
