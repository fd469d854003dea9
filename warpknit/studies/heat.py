"""Heat on a mesh under tension: at constant tension, and in a frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from ..base.errors import Diverged
from ..base.text import celsius, exact
from ..results.row import Row
from ..runner.answers import Heat, heat_of
from ..runner.branches import Jump, jumps_of
from ..scene import Scene
from .equal_tension import EqualTensionPath, levels_between
from .load_path import LoadPath, Meshes, Monitor, part_of, under_strain, under_tension

TOLERANCE = 5e-5  # residual, at most: heat strains a soft mesh by little, and its tension is held to two thirds of that
LEAST_LEVELS = 2  # of a change of temperature


def later_temperatures(scene: Scene) -> list[float]:
    """Temperatures of [[path]] other than the temperature of [load] [K]."""
    return list(dict.fromkeys(stage.temperature for stage in scene.stages))[1:]


@dataclass(frozen=True)
class HeatedMesh:
    """Rows of history.csv of a heated mesh."""

    rows: Sequence[Row]
    answers: Sequence[Heat]  # effects of heat, as in the answers of a run
    jumps: Sequence[Jump]  # of neighbouring rows to another equilibrium
    ended: str = ""  # why, where it did not reach the last temperature


def tension_held(path: EqualTensionPath, requested: float | None, best: float | None) -> float | None:
    """[N/m] tension at which heat is applied: `requested` where the path has reached it, else `best`."""
    return requested if requested in path.states else best


def heat(
    scene: Scene,
    meshes: Meshes,
    path: EqualTensionPath,
    held: float | None,
    monitor: Monitor = lambda _: None,
) -> tuple[list[HeatedMesh], str]:
    """Meshes under a tension [N/m] at the temperatures of [[path]]; or none, and the reason.

    One is under constant tension, one in a frame that expands by model.frame_expansion. Both begin at the nearest tension of the
    path, not above the given one. With friction or yield they return to the first temperature. `monitor` gets the completed
    share. Where a load does not converge, the rows end with the records before.
    """
    temperatures = later_temperatures(scene)
    if not temperatures:
        return [], "the scene has no [[path]] with another temperature"
    if scene.depends_on_path:
        temperatures = [*temperatures, scene.stages[0].temperature]
    if held is None or len(path.rows) < 2:
        return [], "no tension was found that the mesh carries below the elastic limit of the wire"
    low = max((tension for tension in path.states if tension <= held), default=0.0)
    mesh = LoadPath(meshes.with_tolerance(TOLERANCE), path.states.get(low))
    scene, under = mesh.scene, under_tension(scene, held)
    try:
        *_, begin = mesh.rows(under, 1 if low == held else levels_between(scene, low, held))
    except Diverged as error:
        return [], f"the mesh did not converge under {exact(held, 'N/m')} at {celsius(under.temperature)}: {error}"
    framed = {place: under_strain(scene, state.gradient) for place, state in mesh.states.items()}
    cases = (("tension held", dict.fromkeys(framed, under)), ("frame held", framed))
    found = []
    for number, (name, loads) in enumerate(cases):
        way, rows, stages = LoadPath(mesh.meshes, mesh.states), [begin], list(next(iter(mesh.states.values())).stages)
        ended = ""
        ahead = part_of(monitor, number, len(cases))
        try:
            for count, temperature in enumerate(temperatures):
                at = f"{celsius(temperature)}, {name}"
                stage = {place: replace(loads[place], name=at, temperature=temperature) for place in way.states}
                stages.append(next(iter(stage.values())))
                frames = scene.output.frames
                levels = frames if isinstance(frames, str) else max(LEAST_LEVELS, frames // 2)
                rows += way.rows(stage, levels, part_of(ahead, count, len(temperatures)))
        except Diverged:
            ended = f"{stages[-1].name}: the mesh did not converge above {celsius(rows[-1].temperature_K)}"
        jumps = meshes.jumps(jumps_of, rows)
        found.append(HeatedMesh(rows, heat_of(rows, stages, jumps), jumps, ended))
    return found, ""
