"""What the threads of a CUDA block share, without a GPU: a fiber a thread (reference/emulated_block.py), beside one thread.

The order of the threads between two barriers changes no bit: a barrier that is missing, or a place that two threads write, would
show. Against the CPU the states differ by round-off: sums are added in another order.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from reference import emulated_steps

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="fibers need a compiler of C")
# found in evaluations alone, here of meshes without load, where they are round-off; and what a step leaves behind for itself
NOT_COMPARED = {"moment", "edge_force", "bend_energy", "twist", "curvature", "sweep"}
# of the largest value of an array; closest points are found to the square root of round-off, single precision adds up over steps
TOLERANCE, SINGLE_TOLERANCE = 1e-6, 0.05
SINGLE = {"planar cell", "planar patch, yield", "spatial patch, friction, yield, single"}


def stepped(folder: Path, *options: str) -> dict[str, np.ndarray]:
    """Arrays behind the steps of a process, whose kernel cache is `cache` in the folder where blocks are emulated."""
    result = folder / "states.npz"
    own = {"WARP_CACHE_PATH": str(folder / "cache")} if "--lanes" in options else {}
    command = [sys.executable, emulated_steps.__file__, str(result), *options]
    said = subprocess.run(command, env=os.environ | own, capture_output=True, text=True, check=False)
    assert said.returncode == 0, said.stderr[-4000:]
    with np.load(result) as found:
        return dict(found)


def off(found: np.ndarray, expected: np.ndarray) -> float:
    """Largest difference of two arrays, over the largest value."""
    scale = float(np.abs(expected).max(initial=0.0))
    return float(np.abs(found - expected).max()) / scale if scale > 0.0 else float(np.abs(found).max(initial=0.0))


@pytest.mark.slow
def test_threads_of_a_block_take_the_step_of_one_thread(tmp_path: Path) -> None:
    forward, reversed_ = (stepped(tmp_path, "--lanes", lanes) for lanes in ("forward", "reversed"))
    alone = stepped(tmp_path)
    assert [name for name in forward if not np.array_equal(forward[name], reversed_[name], equal_nan=True)] == []
    wrong = {}
    for name, values in alone.items():
        case, array = name.split(": ")
        difference = off(forward[name], values.astype(float))
        if array not in NOT_COMPARED and difference > (SINGLE_TOLERANCE if case in SINGLE else TOLERANCE):
            wrong[name] = difference
    assert wrong == {}
    assert all(np.any(values != 0.0) for name, values in alone.items() if name.endswith((": velocity", ": node_vx")))
