"""Runs of small scenes as on a GPU, on the CPU: a thread a pair, in any order, and the states that come out.

    python tests/reference/emulated_gpu.py RESULT.json [--order forward|reversed|permuted] [--only WORD] [--arch 90 75]

The scenes are those of gpu_cases.py, the device is `cuda:0` of emulated_device.py. `--order` is that in which the threads of
every launch run. `--arch` compiles each module that was used, with the overloads that were launched, for these compute
capabilities, and notes what cuobjdump says of its kernels. A process of its own, with a kernel cache of its own, as Warp's
templates are changed.
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
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from warp._src import codegen, types

sys.path.insert(0, str(Path(__file__).parents[1]))
from reference.gpu_cases import CASES, COMPILED, DEVICE, SHARED, scene_of
from reference.thread_ranks import run_ranks

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


def set_order(order: str) -> None:
    """Have the threads of each CPU launch run in this order, in modules that are compiled from now on."""
    named = "cpu_module_template_forward"
    template = getattr(codegen, named)
    if template.count(LOOP) != 1:
        raise RuntimeError(f"Warp's {named} has changed: the order of threads can't be set")
    setattr(codegen, named, template.replace(LOOP, f"{ORDERS[order]}\n        {LOOP.replace('task_index', 'task')}"))


def noted(launch: Callable[..., Any], used: dict[wp.Kernel, None]) -> Callable[..., Any]:
    """`wp.launch` that notes the kernels, and of generic ones the overloads, that the emulated device launches."""

    def noting(kernel: wp.Kernel, *given: Any, **named: Any) -> Any:
        recorded = launch(kernel, *given, **named)
        if str(named["device"]) == DEVICE and recorded is not None:
            used[recorded.kernel] = None
        return recorded

    return noting


def states(only: str) -> Iterator[tuple[str, dict[str, str], list[float]]]:
    """Of each case its name, a hash of each array of its last state, and tension and active share there."""
    from warpknit import measure
    from warpknit.solve.model import build_model
    from warpknit.solve.simulate import Simulation

    for name in CASES:
        if only in name:
            simulation = Simulation(build_model(scene_of(name), DEVICE))
            for record in simulation.run():
                found = record.observables
            arrays = simulation.state.arrays()
            hashes = {key: hashlib.sha256(np.ascontiguousarray(values)).hexdigest()[:16] for key, values in arrays.items()}
            yield name, hashes, [*map(float, measure.mesh_tension(found)), float(measure.contacts(found).active_percent)]


def register() -> None:
    """Launch the kernels that the cases do not reach."""
    from warpknit.solve.model import build_model
    from warpknit.solve.simulate import Simulation

    for name in COMPILED:
        Simulation(build_model(scene_of(name), DEVICE)).compile()
    for name in SHARED:
        run_ranks(2, partial(compile_shared, scene_of(name)))


def compile_shared(scene: Any, ranks: Any) -> None:
    """Compile the kernels of a rank."""
    from warpknit.solve.model import build_model
    from warpknit.solve.simulate import Simulation

    Simulation(build_model(scene, DEVICE, ranks)).compile()


def name_of(kernel: wp.Kernel) -> str:
    """Module and key of a kernel, and of an overload the types of the numbers that may be of any type, each once."""
    parent = kernel.generic_parent
    name = f"{kernel.module.name.rsplit('.', 1)[-1]}.{kernel.key}"
    if parent is None:
        return name
    generic = [argument.label for argument in parent.adj.args if types.type_is_generic(argument.type)]
    found = {types.type_repr(getattr(one.type, "dtype", one.type)) for one in kernel.adj.args if one.label in generic}
    return f"{name}[{', '.join(sorted(found))}]"


def resources(arch: int, used: Iterable[wp.Kernel]) -> Iterator[tuple[str, list[int]]]:
    """Compile modules for `arch`; of each kernel used registers and stack [B] a thread and shared memory [B] a block."""
    tool = shutil.which("cuobjdump") or next(
        (str(path) for path in Path(sys.prefix).glob("lib/python*/site-packages/nvidia/cu*/bin/cuobjdump")), None
    )
    for module in {kernel.module: None for kernel in used}:
        with tempfile.TemporaryDirectory() as folder:
            wp.compile_aot_module(module, arch=arch, module_dir=folder, use_ptx=False)
            if tool is None:
                continue
            known = [*used, *(kernel for kernel in module._get_live_kernels() if not kernel.is_generic)]
            names = {kernel.get_mangled_name(): name_of(kernel) for kernel in known if kernel.module is module}
            for cubin in Path(folder).glob("*.cubin"):
                command = [tool, "--dump-resource-usage", str(cubin)]
                said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
                for kernel, line in re.findall(r"Function (\S+)_cuda_kernel_forward:\s*\n\s*(REG:.*)", said):
                    numbers = dict(re.findall(r"(\w+):(\d+)", line))
                    if kernel in names:  # not an overload for the CPU
                        yield names[kernel], [int(numbers[key]) for key in ("REG", "STACK", "SHARED")]


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("result", type=Path)
    parser.add_argument("--order", choices=ORDERS, default="forward")
    parser.add_argument("--only", default="")
    parser.add_argument("--arch", type=int, nargs="*", default=[])
    given = parser.parse_args()
    set_order(given.order)
    importlib.import_module("reference.emulated_device")
    used: dict[wp.Kernel, None] = {}
    wp.launch = noted(wp.launch, used)
    result: dict[str, Any] = {"states": {}, "figures": {}, "kernels": {}}
    for name, hashes, figures in states(given.only):
        result["states"][name], result["figures"][name] = hashes, figures
    if given.arch:
        register()
    for arch in given.arch:
        result["kernels"][str(arch)] = dict(sorted(resources(arch, used)))
    given.result.write_text(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
