"""Steps of small meshes on the emulated device, and the arrays of their states behind them.

    python tests/reference/emulated_steps.py RESULT.npz [--lanes forward|reversed] [--only WORD]

`--lanes`: the threads of a CUDA block are fibers that run in this order between barriers (emulated_block.py); left out, one
thread does what they share. A process of its own, with a kernel cache of its own.
"""

from __future__ import annotations

import argparse
import importlib
import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from reference import emulated_block

# steps of the cases of gpu_cases.py
STEPS = {
    "planar cell": 400,
    "planar cell, double, friction": 400,
    "planar patch, yield": 100,
    "spatial cell": 50,
    "spatial patch, friction, yield": 50,
    "spatial patch, friction, yield, single": 50,
    "tight tricot": 50,
}


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("result", type=Path)
    parser.add_argument("--lanes", choices=["forward", "reversed"])
    parser.add_argument("--only", default="")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        if given.lanes is not None:
            emulated_block.use(Path(folder), reversed_lanes=given.lanes == "reversed")
        importlib.import_module("reference.emulated_device")
        result = {}
        for name, steps in STEPS.items():
            if given.only in name:
                result |= {f"{name}: {key}": values for key, values in stepped(name, steps).items()}
    np.savez(given.result, **result)


def stepped(name: str, steps: int) -> dict[str, np.ndarray]:
    """Arrays of the state of a case after some steps towards its load, and the sums of the last one."""
    from reference.gpu_cases import DEVICE, scene_of
    from warpknit.mesh.rim import LoadPoint
    from warpknit.solve.model import build_model
    from warpknit.solve.simulate import Simulation

    scene = scene_of(name)
    simulation = Simulation(build_model(scene, DEVICE))
    simulation.mechanics.search()
    stage = scene.stages[0]
    gradient = np.diag([1.0 + (stage.strain_weft or 0.0), 1.0 + (stage.strain_warp or 0.0)])
    next(simulation.drive.reach(LoadPoint(gradient, stage.temperature)))
    simulation.mechanics.step(steps)
    return {**simulation.state.arrays(), "control": simulation.state.steering.values}


if __name__ == "__main__":
    main()
