"""Small scenes that take all ways of a run on a GPU: files of scenes/ with other values."""

from __future__ import annotations

from pathlib import Path

from warpknit.scene import Scene, load_scene

SCENES = Path(__file__).parents[2] / "scenes"
DEVICE = "cuda:0"
SHARED = ("planar patch, yield", "spatial patch, friction, yield")  # cases that two ranks share
CASES: dict[str, tuple[str, list[str]]] = {
    "planar cell": ("atlas_cell.toml", ["solver.preset=draft", "output.frames=1"]),
    "planar cell, double, friction": (
        "friction_cycle.toml",
        ["solver.preset=draft", "solver.precision=double", "output.frames=1"],
    ),
    "planar patch, yield": (
        "atlas_patch.toml",
        ["knit.repeats=[2, 2]", "solver.preset=draft", "wire.plastic=true", "output.frames=1"],
    ),
    "planar panel, from a smaller mesh": (
        "atlas_patch.toml",
        ["knit.repeats=[12, 12]", "solver.preset=draft", "output.frames=1", "solver.residual_tolerance=0.05"],
    ),
    "planar ramp": (
        "atlas_cell.toml",
        ["solver.preset=draft", "solver.drive=ramp", "solver.loading_time=2e-5 s", "output.frames=1"],
    ),
    "planar cell, by tension": (
        "atlas_cell.toml",
        ["solver.preset=draft", "load.tension_weft=0.02 N/m", "load.tension_warp=0.02 N/m", "output.frames=1"],
    ),
    "spatial patch, by tension": (
        "atlas_cell_spatial.toml",
        [
            "model.boundary=gripped",
            "knit.repeats=[1, 1]",
            "solver.preset=draft",
            "load.tension_weft=0.02 N/m",
            "load.tension_warp=0.02 N/m",
            "output.frames=1",
        ],
    ),
    "spatial cell": ("atlas_cell_spatial.toml", ["solver.preset=draft", "output.frames=1"]),
    "spatial patch, friction, yield": (
        "atlas_cell_spatial.toml",
        [
            "model.boundary=gripped",
            "knit.repeats=[1, 1]",
            "solver.preset=draft",
            "wire.plastic=true",
            "contact.friction=0.1",
            "load.strain_weft=0.04",
            "load.strain_warp=0.04",
            "output.frames=1",
        ],
    ),
    "spatial patch, friction, yield, single": (
        "atlas_cell_spatial.toml",
        [
            "model.boundary=gripped",
            "knit.repeats=[1, 1]",
            "solver.preset=draft",
            "solver.precision=single",
            "wire.plastic=true",
            "contact.friction=0.1",
            "load.strain_weft=0.04",
            "load.strain_warp=0.04",
            "output.frames=1",
        ],
    ),
    "spatial panel, from a smaller mesh": (
        "atlas_cell_spatial.toml",
        [
            "model.boundary=gripped",
            "knit.repeats=[12, 3]",
            "solver.preset=draft",
            "solver.precision=single",
            "output.frames=1",
            "solver.residual_tolerance=0.05",
        ],
    ),
    "tight tricot": (
        "atlas_cell_spatial.toml",
        [
            'knit.bars=[{chain = "1-0/1-2"}, {chain = "1-2/1-0"}]',
            'knit.wale_spacing="1 mm"',
            'knit.course_spacing="0.8 mm"',
            "knit.repeats=[3, 2]",
            "load.strain_weft=0.0",
            "load.strain_warp=0.02",
            "solver.preset=draft",
            "output.frames=1",
        ],
    ),
}
# compiled and not run, for their kernels
COMPILED: dict[str, tuple[str, list[str]]] = {
    "hook with a point": ("hook_point.toml", []),
    "hook on a plane": ("hook_friction_plane.toml", []),
}  # fmt: skip


def scene_of(name: str) -> Scene:
    """The scene of a case."""
    file, overrides = (CASES | COMPILED)[name]
    return load_scene(SCENES / file, overrides)
