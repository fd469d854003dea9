"""warpknit: how a knitted metal mesh carries load, wire by wire and contact by contact.

    from pathlib import Path
    from warpknit import Simulation, build_model, load_scene, measure, run_scene
    run = run_scene(load_scene("scenes/atlas_cell.toml"), out=Path("runs/cell"))

or, without files, step by step:

    scene = load_scene("scenes/atlas_cell.toml", ["load.strain_weft=0.05"])
    model = build_model(scene)                       # planar or spatial, as the scene asks
    for record in Simulation(model).run():           # the equilibria of the load levels
        print(measure.mesh_tension(record.observables), measure.contacts(record.observables))

`knit_cloth` makes one repeat of the cloth alone; `export_run` writes a run's states in other forms.
"""

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

_DOOR = {
    "load_scene": "scene",
    "knit_cloth": "knit.cloth",
    "build_model": "model",
    "initial_state": "model",
    "Simulation": "solve.simulate",
    "measure": None,
    "run_scene": "runner.run",
    "export_run": "export",
}
__all__ = ["__version__", *_DOOR]


def __getattr__(name: str) -> Any:
    """Names are imported when they are asked for, so that importing the package is quick."""
    if name not in _DOOR:
        raise AttributeError(f"module 'warpknit' has no attribute {name!r}")
    module = _DOOR[name]
    return import_module(f"warpknit.{name}") if module is None else getattr(import_module(f"warpknit.{module}"), name)
