"""warpknit: how a knitted metal mesh carries load, wire by wire and contact by contact.

    import warpknit

    run = warpknit.run("scenes/atlas_cell.toml", "runs/cell")        # a file, TOML text, a dict, or a scene
    run.summary["mesh"]["tension_weft_N_per_m"], run.history["strain_weft"], run.states[-1].node_position

Scenes are changed in code, and states are computed without files:

    scene = warpknit.load_scene("scenes/atlas_cell.toml").changed({"wire.diameter": "17 um", "output.frames": 4})
    for record in warpknit.Simulation(warpknit.build_model(scene)).run():    # one equilibrium a load level
        print(record.load_factor, warpknit.measure.mesh_tension(record.observables))    # [N/m] weft, warp

| name | |
|---|---|
| `load_scene` | a `Scene` from a file, text or a dict; `scene.changed` |
| `wires_from_arrays` | the table `[wires]` of centre lines in NumPy arrays |
| `run`, `run_map`, `make_report` | the commands, into a directory; they return a `Run` |
| `load_run` | the `Run` of a directory: summary, tables, states and observables as arrays |
| `build_model`, `initial_state`, `Simulation` | the same states without files, record by record |
| `measure` | measures of a recorded state |

`warpknit.Scene` and `warpknit.Run` are what these functions return, for annotations and `help`; `warpknit.scene` has the tables
of a scene and `resolved_toml`.

Everything is in SI units. docs/python.md has probes, forces of one's own, parameter studies and notebooks.
Errors are in `warpknit.errors`; each is one line that says what is wrong and what to write instead.
"""

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

from .base import errors

__version__ = "0.2.0"
sys.modules["warpknit.errors"] = errors  # for `from warpknit.errors import SceneError`

if TYPE_CHECKING:
    from . import measure, scene
    from .commands.report import make_report
    from .commands.run import run, run_map
    from .results.run import Run, load_run
    from .scene import Scene, load_scene
    from .solve.model import build_model, initial_state
    from .solve.simulate import Simulation
    from .wires.arrays import wires_from_arrays

_PUBLIC = {
    "load_scene": "scene",
    "wires_from_arrays": "wires.arrays",
    "build_model": "solve.model",
    "initial_state": "solve.model",
    "Simulation": "solve.simulate",
    "run": "commands.run",
    "run_map": "commands.run",
    "make_report": "commands.report",
    "load_run": "results.run",
    "measure": None,
    "Run": "results.run",
    "Scene": "scene",
    "scene": None,
}
__all__ = [
    "Run",
    "Scene",
    "Simulation",
    "__version__",
    "build_model",
    "errors",
    "initial_state",
    "load_run",
    "load_scene",
    "make_report",
    "measure",
    "run",
    "run_map",
    "scene",
    "wires_from_arrays",
]


def __getattr__(name: str) -> Any:
    """Import a name of the public API on first use."""
    if name not in _PUBLIC:
        raise AttributeError(f"module 'warpknit' has no attribute {name!r}")
    module = _PUBLIC[name]
    return import_module(f"warpknit.{name}") if module is None else getattr(import_module(f"warpknit.{module}"), name)


def __dir__() -> list[str]:
    return __all__
