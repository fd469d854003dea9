"""Steps and wall time of `warpknit plan` beside runs, on an idle machine."""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from warpknit.base.errors import Diverged
from warpknit.commands.plan import make_plan
from warpknit.scene import Scene, make_scene
from warpknit.scene.scene_loader import load_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation

SCENES = Path(__file__).parents[2] / "scenes"
CELL, COARSE = "atlas_cell_spatial.toml", "model.nodes_per_loop=48"
PLANAR = ("output.frames=10",)
SPATIAL = "model.kind=spatial"
# a tight knit: two full bars
TRICOT = {
    "wire": {"diameter": "15 um"},
    "knit": {
        "bars": [{"chain": "1-0/1-2"}, {"chain": "1-2/1-0"}],
        "wale_spacing": "1 mm", "course_spacing": "0.8 mm", "repeats": [2, 1],
    },
    "model": {"kind": "spatial", "boundary": "periodic", "nodes_per_loop": 48},
    "load": {"strain_weft": 0.1, "strain_warp": 0.1},
    "output": {"frames": 5},
}  # fmt: skip
KNITS: dict[str, tuple[str | dict, tuple[str, ...]]] = {
    "planar cell": ("atlas_cell.toml", PLANAR),
    "planar patch": ("atlas_patch.toml", PLANAR),
    "cell": (CELL, ()),
    "cell, 1 %: no contact": (CELL, (COARSE, "load.strain_weft=0.01", "load.strain_warp=0.01", "output.frames=2")),
    "cell, 20 %": (CELL, ("solver.preset=draft", "load.strain_weft=0.2", "load.strain_warp=0.2", "output.frames=4")),
    "cell by tension": (CELL, ("solver.preset=draft", "load.tension_weft=0.05", "load.tension_warp=0.05", "output.frames=3")),
    "cell, friction": (
        CELL,
        ("solver.preset=draft", "contact.friction=0.2", "load.strain_weft=0.06", "load.strain_warp=0.06", "output.frames=2"),
    ),
    "3 x 3 repeats": (CELL, ("solver.preset=draft", "knit.repeats=[3, 3]", "output.frames=2")),
    "patch of 2 x 2": ("atlas_patch.toml", (SPATIAL, COARSE, "knit.repeats=[2, 2]", "output.frames=2")),
    "hook": ("hook_spatial.toml", ()),
    "hook, friction": ("hook_spatial.toml", ("contact.friction=0.2", "output.frames=4")),
    "tricot": (TRICOT, ()),
    "plain knit from a file": ("wires/plain_knit_spatial.toml", ()),
    "open wires from a file": ("wires/plain_knit_patch.toml", ("load.strain_warp=0.1", "output.frames=2")),
}


def cases(options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """A dictionary a scene whose name has `options.only` in it."""
    for name, (source, overrides) in KNITS.items():
        if options.only in name:
            scene = make_scene(source, overrides) if isinstance(source, dict) else load_scene(SCENES / source, overrides)
            yield {"case": name} | compared(scene)


def compared(scene: Scene) -> dict[str, Any]:
    """Planned and taken steps and seconds."""
    planned = make_plan(scene, "cpu")
    assert planned.wall_s is not None
    relaxation = Simulation(build_model(scene))
    relaxation.compile()
    begin, note = time.perf_counter(), None
    try:
        for _record in relaxation.run():
            pass
    except Diverged as error:
        note = str(error)
    took, steps = time.perf_counter() - begin, relaxation.progress.steps
    return {
        "nodes": planned.nodes,
        "steps": steps,
        "steps_planned": planned.steps,
        "steps_planned_over_taken": planned.steps / steps,
        "wall_s": took,
        "wall_s_planned": planned.wall_s,
        "time_planned_over_taken": planned.wall_s / took,
        "step_us": 1e6 * took / steps,
        "diverged": note,
    }
