"""`warpknit reflect`: the waves from all recorded states of a run or a map, on all cores.

DIR gets reflection.csv, reflection.npz (amplitudes) and figures/reflection_*.png, and its summary the section `reflection`.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import numpy as np

from ..base.errors import InputError, MemoryNeeded, RunDirectoryError
from ..base.files import write_arrays
from ..base.text import at_least, engineering, exact, memory
from ..compute.memory import available_memory
from ..knit.cloth import knit_cloth
from ..mechanics.numerics import thread_count
from ..mesh.layout import mesh_nodes
from ..results.finding import Finding
from ..results.frame import Frame, WireLayout, state_file
from ..results.row import Row, columns_of, read_rows, write_json, write_rows
from ..runner.interrupts import Interrupts
from ..runner.progress_display import Display
from ..runner.run_directory import SUMMARIES
from ..scene import Scene
from ..scene.options import Reflection
from ..studies.contact_map import MapRow, read_map
from .currents import MeshCurrents, scattering_at
from .impedance import surface_radius, wire_impedance, yarn_radius
from .repeat import BRANCHES, CLOSED, COMPUTED, LEAST, OPEN, repeat_of
from .table import COLUMNS, LossRow, Reflected, loss_row
from .waves import Angles, Scattering, first_lobe

# --- the recorded states


def states_of(directory: Path) -> dict[int, Row]:
    """States of a run or map with files, by number. Raises RunDirectoryError for states of an earlier version."""
    path = directory / "history.csv"
    rows: Iterable[tuple[int, Row]] = enumerate(read_rows(path, Row)) if path.exists() else _cells(directory)
    there = {
        number: row
        for number, row in rows
        if row.get("tension_weft_N_per_m") is not None and state_file(directory, number).exists()
    }
    if there:
        with np.load(path := state_file(directory, next(iter(there)))) as file:
            if "contact_force" not in file.files:
                raise RunDirectoryError(f"{path}: contains no contacts; run the scene again with --force")
    return there


def _cells(directory: Path) -> Iterator[tuple[int, MapRow]]:
    """State number and row of each load of a map, mesh by mesh."""
    whole = (directory / "map.csv", directory / "map_details.csv")
    place = {row.load: number for number, row in enumerate(read_map(*whole))}
    meshes = {int(path.stem.removeprefix("map_")): path for path in (directory / "variants").glob("map_*.csv")}
    tables = {mesh: (path, path.with_name(path.name.replace("map", "details"))) for mesh, path in meshes.items()}
    for mesh, paths in sorted(tables.items()) or [(0, whole)]:
        yield from ((mesh * len(place) + place[row.load], row) for row in read_map(*paths))


# --- the study


def reflect(directory: Path, scene: Scene, progress: Display | None = None) -> Reflected:
    """Solve the waves from all states in `directory`, and write the results. It holds a finished run or map of `scene`.

    Raises InputError, RunDirectoryError, and KeyboardInterrupt, on which nothing is written.
    """
    options, display = options_of(scene), progress or Display()
    states = states_of(directory)
    if not states:
        why = "a map keeps its states only with [reflection]" if (directory / "map.csv").exists() else "no recorded states"
        raise RunDirectoryError(f"{directory}: {why}; run the scene again with [reflection], and --force")
    display.stage(f"reflection of {len(states)} states", number=1, of=1)
    found: dict[int, list[list[Scattering]]] = {}
    for record, waves in _solved(directory, scene, list(states)):
        found[record] = waves
        display.update(done=len(found) / len(states), load_factor=1.0)
    names, angles = contact_states(options), Angles(options.theta, options.phi)
    rows = [
        loss_row(record, state, frequency, angles, name, one)
        for record, state in states.items()
        for frequency, waves in zip(options.frequencies, found[record], strict=True)
        for name, one in zip(names, waves, strict=True)
    ]
    result = Reflected(tuple(rows), scene.wire.yield_stress, is_map=not (directory / "history.csv").exists())
    write_rows(directory / "reflection.csv", result.rows, COLUMNS)
    amplitudes = {
        name: np.array([[[getattr(one, name) for one in waves] for waves in found[record]] for record in states])
        for name in ("reflection", "transmission")
    }
    about = {"record": np.array(list(states)), "frequency": np.array(options.frequencies), "contacts": np.array(names)}
    write_arrays(directory / "reflection.npz", about | amplitudes)
    for name in SUMMARIES:
        if (path := directory / name).exists():
            write_json(path, result.added_to(json.loads(path.read_text(encoding="utf-8"))))
    if scene.output.figures:
        _draw(directory, scene, states, result)
    return result


def contact_states(options: Reflection) -> tuple[str, ...]:
    """The states of contacts that are solved."""
    return (COMPUTED, OPEN, CLOSED) if options.contacts == COMPUTED else (options.contacts,)


def _solved(directory: Path, scene: Scene, records: Sequence[int]) -> Iterator[tuple[int, list[list[Scattering]]]]:
    """Record and waves [frequency][contact state] of each state, as they come."""
    interrupts = Interrupts()
    with interrupts.handled(), ThreadPoolExecutor(worker_count(len(records), scene)) as pool:
        waiting = {pool.submit(state_waves, directory, scene, record): record for record in records}
        try:
            for done in as_completed(waiting):
                if interrupts.is_requested:
                    raise KeyboardInterrupt(f"interrupted; the states are kept in {directory}")
                yield waiting[done], done.result()
        finally:
            pool.shutdown(cancel_futures=True)


def worker_count(states: int, scene: Scene) -> int:
    """Threads that share states: one a core, as far as memory goes."""
    return max(1, min(thread_count(states), available_memory() // max(size_of(scene)[1], 1)))


def state_waves(directory: Path, scene: Scene, record: int) -> list[list[Scattering]]:
    """Waves [frequency][contact state] from one recorded state. Raises InputError beyond its first grating lobe."""
    options = scene.reflection
    assert options is not None
    frame = Frame.load(state_file(directory, record))
    repeat = repeat_of(WireLayout.load(directory / "layout.npz"), frame, scene.wire, branch_length(scene))
    refuse_lobes(scene, repeat.wires.cell)
    names = contact_states(options)
    return scattering_at(
        MeshCurrents(repeat.wires),
        options.frequencies,
        Angles(options.theta, options.phi),
        lambda frequency: wire_impedance(scene.wire, frequency),
        lambda frequency: [repeat.contacts(scene.wire, frequency, name, options.film_resistance) for name in names],
    )


def reflection_text(scene: Scene) -> str:
    """Cost of the waves from a state, for a plan. Raises as `options_of`."""
    options, (branches, needed) = options_of(scene), size_of(scene)
    count, workers = len(options.frequencies), worker_count(os.cpu_count() or 1, scene)
    waves = f"{count} frequenc{'y' if count == 1 else 'ies'} up to {engineering(options.frequencies[-1], 'Hz')}"
    return f"{waves}, about {branches:,} branches of wire a state; {memory(workers * needed)} in {workers} threads"


# --- files


def read_findings(directory: Path, scene: Scene) -> list[Finding]:
    """Lines of the table for the reflection that a directory holds; none without one."""
    path, is_map = directory / "reflection.csv", (directory / "map.csv").exists()
    return Reflected(tuple(read_rows(path, LossRow)), scene.wire.yield_stress, is_map).findings if path.exists() else []


def _draw(directory: Path, scene: Scene, states: Mapping[int, Row], result: Reflected) -> None:
    from ..export.map_figure import Marks, map_figure
    from ..export.reflection_figure import frequency_figure, tension_figure

    columns = {**columns_of(map(vars, result.rows)), "contacts": np.array([row.contacts for row in result.rows])}
    folder, title = directory / "figures", scene.name
    loads = {record: state.load for record, state in states.items() if isinstance(state, MapRow)}
    if not loads:
        tension_figure(columns, result.shown_frequencies, folder / "reflection_tension.png", title)
        frequency_figure(columns, result.rows[-1].record, folder / "reflection_frequency.png", title)
        return
    weft, warp = (sorted({load[side] for load in loads.values()}) for side in (0, 1))
    by_tension = scene.sweep is not None and scene.sweep.by_tension
    stress = _grid({loads[record]: [state.stress_max_Pa] for record, state in states.items()}, weft, warp)
    for frequency in result.shown_frequencies:
        losses: dict[Any, list[float]] = {}
        for row in result.given(frequency):
            losses.setdefault(loads[row.record], []).append(row.loss)
        best, at = result.least(frequency), engineering(frequency, "Hz")
        places = () if best is None else ((f"least tension, {best.loss:.3g} dB", loads[best.record], best.loss),)
        map_figure(
            folder / f"reflection_map_{at.replace(' ', '_')}.png", weft, warp, _grid(losses, weft, warp),
            title=title, label=f"reflection loss at {at}, the worse polarisation", unit="dB", by_tension=by_tension,
            marks=Marks(stress=stress, yield_stress=scene.wire.yield_stress, optimum=None, places=places),
        )  # fmt: skip


def _grid(values: Mapping[Any, Sequence[float]], weft: Sequence[float], warp: Sequence[float]) -> np.ndarray:
    """(warp, weft) mean of the values of each load; nan where there is none."""
    return np.array([[float(np.mean(values[x, y])) if (x, y) in values else np.nan for x in weft] for y in warp])


# --- checks of [reflection]

BYTES = 200  # for each pair of half branches, at normal incidence


def options_of(scene: Scene) -> Reflection:
    """[reflection] of a scene.

    Raises InputError where it has none, for a branch length below a wire diameter, for frequencies with grating lobes, and
    MemoryNeeded for a mesh that is too large.
    """
    options = scene.reflection
    if options is None:
        raise InputError(f"{scene.path}: no [reflection]; give --set 'reflection.frequencies=[\"10 GHz\"]', or add the table")
    least = 2.0 * surface_radius(scene.wire)
    if options.branch_length is not None and options.branch_length < least:
        wrong = f"{exact(options.branch_length, 'm')} is below the wire diameter"
        raise InputError(f"{scene.path}: reflection.branch_length: {wrong}; write {at_least(least, 'm')} or more")
    refuse_lobes(scene, np.diag(np.asarray(scene.knit.size) * (1.0 + _largest_strains(scene))))
    (branches, needed), available = size_of(scene), available_memory()
    if needed > available:
        wrong = f"about {branches:,} branches of wire need {memory(needed)}, {memory(available)} are available"
        raise MemoryNeeded(f"{scene.path}: reflection: {wrong}; write fewer knit.repeats, or a larger reflection.branch_length")
    return options


def _largest_strains(scene: Scene) -> np.ndarray:
    """(2,) largest strains in weft and warp that the scene prescribes, at least 0."""
    strains = [(stage.strain_weft or 0.0, stage.strain_warp or 0.0) for stage in scene.stages]
    if scene.sweep is not None and not scene.sweep.by_tension:
        strains += scene.sweep.pairs
    return np.max([(0.0, 0.0), *strains], axis=0)


def refuse_lobes(scene: Scene, cell: np.ndarray) -> None:
    """Raise InputError for frequencies with grating lobes; cell: periods (rows [m])."""
    options = scene.reflection
    assert options is not None
    limit, highest = first_lobe(cell, Angles(options.theta, options.phi)), max(options.frequencies)
    if highest >= limit:
        raise InputError(
            f"{scene.path}: reflection.frequencies: {engineering(highest, 'Hz')} is beyond the first grating lobe of a repeat, at"
            f" {engineering(limit, 'Hz', 4)}; write lower frequencies, or fewer knit.repeats"
        )


def branch_length(scene: Scene) -> float:
    """[m] longest branch."""
    assert scene.reflection is not None
    if scene.reflection.branch_length is not None:
        return scene.reflection.branch_length
    return max(_loop_length(scene) / BRANCHES, LEAST * yarn_radius(scene.wire))


def _loop_length(scene: Scene) -> float:
    """[m] of wire a loop."""
    return knit_cloth(scene.knit.even, scene.wire.thickness, scene.model.merge_lenses).wire_length


def size_of(scene: Scene) -> tuple[int, int]:
    """Estimated branches of wire in the equation of one state, and its memory [bytes]."""
    assert scene.reflection is not None
    loops = mesh_nodes(scene) / scene.model.nodes_per_loop
    branches = round(loops * _loop_length(scene) / branch_length(scene))
    return branches, BYTES * (2 * branches) ** 2 * (2 if scene.reflection.theta else 1)
