"""`warpknit map` as a function."""

from __future__ import annotations

from pathlib import Path

from ..results.run import Run
from ..runner.progress_display import Progress
from ..runner.run_directory import CommandResult
from ..scene import Scene, load_scene
from ..scene.capabilities import refuse
from ..studies.sweep import run_map as sweep_scene
from .carried_out import Directory, Source, carried_out


def run_map(
    scene: Source,
    out: Directory | None = None,
    *,
    resume: bool = False,
    force: bool = False,
    quiet: bool = False,
) -> Run:
    """Run all strains of a scene's [sweep] into the directory `out`, as `warpknit map` does, and return the results.

        run = warpknit.run_map("scenes/contact_map.toml", "runs/map")
        run.summary["optimum"]["strain_weft"]
        run.tables["map"]["active_percent"]                                  # [pair of strains] [%]
        run.tables["map"].grid("active_percent", "strain_warp", "strain_weft")  # (warp, weft) [%]

    scene, out, resume, force, quiet and what is raised: as in `run`. Maps run on the CPU.
    """
    loaded = load_scene(scene, command="map")
    return carried_out(
        loaded,
        out,
        quiet,
        lambda where, progress: map_command(loaded, where, resume=resume, force=force, progress=progress),
        resume=resume,
        force=force,
    )


def map_command(
    scene: Scene, out: Path, *, resume: bool, force: bool, progress: Progress, device: str | None = None
) -> CommandResult:
    """`warpknit map`. Raises as `sweep_scene` does."""
    refuse(scene, "map")
    return sweep_scene(scene, out=out, device=device, resume=resume, force=force, progress=progress)
