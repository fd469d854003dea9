"""`warpknit reflect`: the waves from all recorded states of a run or a map, on all cores.

DIR gets reflection.csv, reflection.npz (amplitudes) and figures/reflection_*.png, and its summary the section `reflection`.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..base.errors import RunDirectoryError
from ..base.files import write_arrays
from ..base.text import engineering, memory
from ..compute.memory import available_memory
from ..mechanics.numerics import thread_count
from ..results.finding import Finding
from ..results.frame import Frame, WireLayout, state_file
from ..results.row import Row, columns_of, read_rows, write_json, write_rows
from ..runner.interrupts import Interrupts
from ..runner.progress_display import Display
from ..runner.run_directory import SUMMARIES
from ..scene import Scene
from ..scene.options import Reflection
from ..studies.contact_map import MapRow, read_map
from .checks import Size, branch_length, options_of, refuse_lobes
from .currents import MeshCurrents, scattering_at
from .impedance import wire_impedance
from .repeat import CLOSED, COMPUTED, OPEN, repeat_of
from .table import (
    COLUMNS,
    LoadedMesh,
    LossRow,
    given_rows,
    least_tension,
    least_tensions,
    loss_row,
    reflection_findings,
    shown_frequencies,
    shown_record,
    summary_of,
)
from .waves import Angles, Scattering

STARTED = 8  # states from which on other processes are worth their start
THREADS = "OPENBLAS_NUM_THREADS"
PROGRAMS = ("warpknit", "__main__", "pytest")  # main modules that another process may import without harm


@dataclass(frozen=True)
class Reflected:
    """The result of `reflect`."""

    rows: tuple[LossRow, ...]
    limit: float  # [Pa] elastic limit of the wire
    is_map: bool

    @property
    def findings(self) -> list[Finding]:
        """The lines of the table of a command."""
        return list(reflection_findings(self.rows, self.limit, self.is_map))

    @property
    def record(self) -> int:
        """Record of the summary: the last one; of a map, at the least tension and highest frequency."""
        return shown_record(self.rows, self.rows[-1].frequency_Hz, self.limit, self.is_map)

    def added_to(self, summary: dict[str, Any]) -> dict[str, Any]:
        """A summary with the section `reflection`, and least tensions among the answers."""
        least = {"reflection": least_tensions(self.rows, self.limit)}
        losses = summary_of([row for row in self.rows if row.record == self.record])
        return summary | {"reflection": losses, "answers": (summary.get("answers") or {}) | least}


# --- the recorded states


def states_of(directory: Path) -> list[LoadedMesh]:
    """Recorded states of a finished run or map whose files exist.

    Raises RunDirectoryError for states without their contacts, of an earlier version.
    """
    if (directory / "history.csv").exists():
        rows: Iterable[tuple[int, Row]] = enumerate(read_rows(directory / "history.csv", Row))
    else:
        rows = _cells(directory)
    found = [_state(number, row) for number, row in rows if row.get("tension_weft_N_per_m") is not None]
    there = [state for state in found if state_file(directory, state.record).exists()]
    if there:
        with np.load(path := state_file(directory, there[0].record)) as file:
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


def _state(number: int, row: Row) -> LoadedMesh:
    load = row.load if isinstance(row, MapRow) else None
    return LoadedMesh(number, (row.strain_weft, row.strain_warp), row.tension, load, row.stress_max_Pa)


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
    for record, waves in _solved(directory, scene, states):
        found[record] = waves
        display.update(done=len(found) / len(states), load_factor=1.0)
    names, angles = contact_states(options), Angles(options.theta, options.phi)
    rows = [
        loss_row(state, frequency, angles, name, one)
        for state in states
        for frequency, waves in zip(options.frequencies, found[state.record], strict=True)
        for name, one in zip(names, waves, strict=True)
    ]
    result = Reflected(tuple(rows), scene.wire.yield_stress, is_map=states[0].load is not None)
    _write(directory, scene, states, found, result)
    return result


def contact_states(options: Reflection) -> tuple[str, ...]:
    """The states of contacts that are solved."""
    return (COMPUTED, OPEN, CLOSED) if options.contacts == COMPUTED else (options.contacts,)


def _solved(directory: Path, scene: Scene, states: Sequence[LoadedMesh]) -> Iterator[tuple[int, list[list[Scattering]]]]:
    """Record and waves [frequency][contact state] of each state, as they come."""
    workers, interrupts = worker_count(len(states), Size.of(scene)), Interrupts()
    with interrupts.handled():
        if workers == 1 or len(states) < STARTED:
            for state in states:
                _stop_if_asked(interrupts, directory)
                yield state.record, state_waves(directory, scene, state.record)
            return
        with _one_thread_each(), ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _ignore_interrupts) as pool:
            waiting = {pool.submit(state_waves, directory, scene, state.record): state.record for state in states}
            try:
                for done in as_completed(waiting):
                    _stop_if_asked(interrupts, directory)
                    yield waiting[done], done.result()
            finally:
                pool.shutdown(wait=True, cancel_futures=True)


def _ignore_interrupts() -> None:
    """The process that started the pool shuts it down."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _stop_if_asked(interrupts: Interrupts, directory: Path) -> None:
    if interrupts.is_requested:
        raise KeyboardInterrupt(f"interrupted; the states are kept in {directory}")


def worker_count(states: int, size: Size) -> int:
    """Processes that share states: one a core, as far as memory goes.

    One where the main module would run again in each of them.
    """
    main = getattr(sys.modules["__main__"], "__file__", None)
    if main is not None and Path(main).stem not in PROGRAMS:
        return 1
    return max(1, min(thread_count(states), available_memory() // max(size.needed, 1)))


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Processes that start inside use one thread each for matrices."""
    before = os.environ.get(THREADS)
    os.environ[THREADS] = "1"
    try:
        yield
    finally:
        del os.environ[THREADS]
        if before is not None:
            os.environ[THREADS] = before


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
    options, size = options_of(scene), Size.of(scene)
    count, workers = len(options.frequencies), worker_count(STARTED, size)
    waves = f"{count} frequenc{'y' if count == 1 else 'ies'} up to {engineering(options.frequencies[-1], 'Hz')}"
    return f"{waves}, about {size.branches:,} branches of wire a state; {memory(workers * size.needed)} in {workers} processes"


# --- files


def read_findings(directory: Path, scene: Scene) -> list[Finding]:
    """Lines of the table for the reflection that a directory holds; none without one."""
    path, is_map = directory / "reflection.csv", (directory / "map.csv").exists()
    return Reflected(tuple(read_rows(path, LossRow)), scene.wire.yield_stress, is_map).findings if path.exists() else []


def _write(
    directory: Path, scene: Scene, states: Sequence[LoadedMesh], found: Mapping[int, list[list[Scattering]]], result: Reflected
) -> None:
    """Write table, amplitudes, section of the summary and figures."""
    write_rows(directory / "reflection.csv", result.rows, COLUMNS)
    options = scene.reflection
    assert options is not None
    amplitudes = {
        name: np.array([[[getattr(one, name) for one in waves] for waves in found[state.record]] for state in states])
        for name in ("reflection", "transmission")
    }
    about = {
        "record": np.array([state.record for state in states]),
        "frequency": np.array(options.frequencies),
        "contacts": np.array(contact_states(options)),
    }
    write_arrays(directory / "reflection.npz", about | amplitudes)
    for name in SUMMARIES:
        if (path := directory / name).exists():
            write_json(path, result.added_to(json.loads(path.read_text(encoding="utf-8"))))
    if scene.output.figures:
        _draw(directory, scene, states, result)


def _draw(directory: Path, scene: Scene, states: Sequence[LoadedMesh], result: Reflected) -> None:
    from ..export.map_figure import Marks, map_figure
    from ..export.reflection_figure import frequency_figure, tension_figure

    columns = {**columns_of(map(vars, result.rows)), "contacts": np.array([row.contacts for row in result.rows])}
    folder, title = directory / "figures", scene.name
    if states[0].load is None:
        tension_figure(columns, shown_frequencies(result.rows), folder / "reflection_tension.png", title)
        frequency_figure(columns, result.record, folder / "reflection_frequency.png", title)
        return
    weft, warp = (sorted({state.load[side] for state in states if state.load}) for side in (0, 1))
    by_tension = scene.sweep is not None and scene.sweep.by_tension
    stress = _grid({state.load: [state.stress] for state in states}, weft, warp)
    place = {state.record: state.load for state in states}
    for frequency in shown_frequencies(result.rows):
        here = given_rows(result.rows, frequency)
        losses: dict[Any, list[float]] = {}
        for row in here:
            losses.setdefault(place[row.record], []).append(row.loss)
        best, at = least_tension(here, result.limit), engineering(frequency, "Hz")
        places = () if best is None else ((f"least tension, {best.loss:.3g} dB", place[best.record], best.loss),)
        map_figure(
            folder / f"reflection_map_{at.replace(' ', '_')}.png", weft, warp, _grid(losses, weft, warp),
            title=title, label=f"reflection loss at {at}, the worse polarisation", unit="dB", by_tension=by_tension,
            marks=Marks(stress=stress, yield_stress=scene.wire.yield_stress, optimum=None, places=places),
        )  # fmt: skip


def _grid(values: Mapping[Any, Sequence[float]], weft: Sequence[float], warp: Sequence[float]) -> np.ndarray:
    """(warp, weft) mean of the values of each load; nan where there is none."""
    return np.array([[float(np.mean(values[x, y])) if (x, y) in values else np.nan for x in weft] for y in warp])
