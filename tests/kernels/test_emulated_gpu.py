"""What can be known of a GPU without one: runs that take its way on the CPU, and what the CUDA compiler makes of the kernels.

reference/emulated_gpu.py runs in processes of its own.
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from reference import emulated_gpu
from warpknit import measure
from warpknit.model import build_model
from warpknit.scene import load_scene
from warpknit.solve.simulate import Simulation

TABLE = Path(__file__).parent / "cuda_resources.json"  # of each kernel at sm_90: registers and stack [B] a thread
CELLS = ("planar cell", "spatial cell")


def emulated(folder: Path, *options: str, cache: bool = False) -> dict[str, Any]:
    """The result of a process; `cache`: with the kernels of this one, whose threads run forward."""
    result = folder / "result.json"
    own = {} if cache else {"WARP_CACHE_PATH": str(folder / "cache")}
    command = [sys.executable, emulated_gpu.__file__, str(result), *options]
    said = subprocess.run(command, env=os.environ | own, capture_output=True, text=True, check=False)
    assert said.returncode == 0, said.stderr[-4000:]
    found: dict[str, Any] = json.loads(result.read_text())
    return found


@pytest.mark.parametrize("name", CELLS)
def test_a_run_as_on_a_gpu_has_the_figures_of_the_cpu(name: str, tmp_path: Path) -> None:
    """A thread a node and a pair, and copies on the host, lead to the equilibrium that blocks and shared memory lead to: tensions
    within the residual tolerance of the preset, and the same contacts."""
    scene, overrides = emulated_gpu.CASES[name]
    simulation = Simulation(build_model(load_scene(emulated_gpu.SCENES / scene, overrides), "cpu"))
    *_, last = simulation.run()
    weft, warp, active = emulated(tmp_path, "--only", name, cache=True)["figures"][name]
    tolerance = simulation.model.scene.solver.residual_tolerance
    assert [weft, warp] == pytest.approx(measure.mesh_tension(last.observables), rel=tolerance)
    assert active == pytest.approx(measure.contacts(last.observables).active_percent)


@pytest.mark.slow
@pytest.mark.parametrize(("order", "only"), [("reversed", ""), ("permuted", "cell"), ("permuted", "patch")])
def test_states_do_not_depend_on_the_order_of_the_threads(order: str, only: str, tmp_path: Path) -> None:
    """Every array of the last state, the sums over the mesh included, has the same bits."""
    (tmp_path / order).mkdir()
    forward = emulated(tmp_path, "--only", only)["states"]
    other = emulated(tmp_path / order, "--only", only, "--order", order)["states"]
    assert forward
    assert {name: {key for key in arrays if arrays[key] != other[name][key]} for name, arrays in forward.items()} == {
        name: set() for name in forward
    }


@pytest.mark.slow
def test_modules_compile_for_cuda(tmp_path: Path) -> None:
    """For the oldest and a recent GPU; no kernel needs more registers or stack than the table says. To renew the table:
    `python tests/reference/emulated_gpu.py RESULT.json --arch 90`, and copy `kernels` of it."""
    found = emulated(tmp_path, "--arch", "75", "90")["kernels"]["90"]
    if (sys.platform, platform.machine()) != ("linux", "x86_64"):
        pytest.skip("compiled, but cuobjdump is packaged for Linux x86-64 alone")
    table = json.loads(TABLE.read_text())
    assert set(found) == set(table)
    assert {name: used for name, used in found.items() if used[0] > table[name][0] or used[1] > table[name][1]} == {}
