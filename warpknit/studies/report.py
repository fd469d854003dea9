"""The states of a report: from the map to curves, answers, material card, heat and openings.

Missing results are reported in words: a tension that the mesh does not reach, a state that did not converge. Curves and states
under equal tensions are kept on disk for another report of the same scene and map.
"""

from __future__ import annotations

import json
import time
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from .. import __version__
from ..base.errors import Diverged
from ..base.files import write_arrays
from ..base.text import exact
from ..compute.kept import strip_prefix
from ..measure import Observables
from ..measure.table import Record
from ..results.finding import Finding
from ..results.row import Row, plain
from ..runner.answers import answers_of
from ..runner.branches import Jump as RowJump
from ..runner.branches import jumps_of, jumps_under_tension
from ..runner.history import mean_tension, row_of
from ..runner.progress_display import Display
from ..scene import Scene, Stage
from ..solve.model import build_model
from .card import MaterialCard, find_card
from .card_files import CARD, ahead_of_card
from .contact_map import MapRow, Optimum, find_jumps, find_optimum, levels_of_pairs
from .curves import tension_strain
from .equal_tension import (
    LEFT,
    EqualTensionPath,
    branches_at,
    is_other,
    jump_text,
    largest_equal_tension,
    load_equally,
    map_cell,
    service_points,
    two_equilibria,
    unreached_text,
    with_state_at,
)
from .fe_codes import CODES
from .findings import Findings
from .heat import heat, later_temperatures, tension_held
from .load_path import LoadPath, Mesh, PathState, exact_model, part_of, states_at, tolerances_of, under_tension
from .mean_card import find_mean, loads_of_card, meshes_of
from .opening_size import openings
from .report_files import write_files

STATES = "report_states.npz"
UNUSABLE = (OSError, ValueError, LookupError, TypeError, zipfile.BadZipFile)


@dataclass(frozen=True)
class KeptStates:
    """Results of a report that do not depend on the requested tension."""

    curves: Sequence[Row] = ()
    path: EqualTensionPath = EqualTensionPath()  # of one mesh of even loops
    means: EqualTensionPath = EqualTensionPath()  # over the meshes of [variants], without their states; empty without them


def write_states(scene: Scene, out: Path, states: KeptStates) -> None:
    """Write the file into `out`."""
    about = plain(replace(states, path=replace(states.path, states={}))) | {"made_by": [scene.hash, __version__]}
    arrays = {"about": np.array(json.dumps(about, default=lambda value: value.item()))}
    for number, state in enumerate(states.path.states.values()):
        arrays |= {f"{number}_{name}": value for name, value in state.kept.items()}
    write_arrays(out / STATES, arrays)


def read_states(scene: Scene, out: Path) -> KeptStates:
    """States by `write_states` for this scene and version; without a readable file none."""
    try:
        with np.load(out / STATES, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        about = json.loads(str(arrays.pop("about")))
        if about["made_by"] != [scene.hash, __version__]:
            return KeptStates()
        path, means = (_path_from(about[name]) for name in ("path", "means"))
        stages = [under_tension(scene, tension) for tension in path.at]
        states = {
            tension: PathState(tuple(stages[: number + 1]), strip_prefix(f"{number}_", arrays))
            for number, tension in enumerate(path.at)
        }
        return KeptStates([Row(**point) for point in about["curves"]], replace(path, states=states), means)
    except UNUSABLE:
        return KeptStates()


def _path_from(table: Mapping[str, Any]) -> EqualTensionPath:
    """The path in such a file, without its states."""
    at = {float(tension): Row(**row) for tension, row in table["at"].items()}
    return EqualTensionPath([Row(**row) for row in table["rows"]], {}, at, table["ended"])


STAGES = ("tension-strain curves", "equal tensions", "material card", "heat", "openings and page")  # of the progress
SEARCHES = ("equal tensions", "heat")  # of these, whose length is not known before
ANOTHER = "ask for a card at a tension that the mesh carries, with --tension"
WAY = 0.6  # of the time of a card: the way to the optimum


def write_report(
    scene: Scene,
    rows: Sequence[MapRow],
    out: Path,
    *,
    tension: float | None = None,
    notes: Sequence[str] = (),
    codes: Sequence[str] = tuple(CODES),
    progress: Display | None = None,
    reflection: Sequence[Finding] = (),
) -> Findings:
    """Write report.html, the card, tension_strain.csv and figures into `out`. It holds the finished map of `scene`.

    rows: of the map. tension [N/m]: of the card, in both directions; default: the optimum. notes: how the scene was fitted.
    codes: FE codes that get the card (`fe.CODES`). reflection: lines on the waves from the states of the map.
    A report without a card does not replace one that has one.
    Raises `ModelError`, `KnitError`.
    """
    show = progress or Display()

    stages = [name for name in STAGES if name != "heat" or later_temperatures(scene)]
    begins: dict[str, float] = {}  # [s] of the clock

    def begin(name: str) -> Callable[[float], None]:
        if name in stages:
            begins[name] = time.perf_counter()
            show.stage(name, number=stages.index(name) + 1, of=len(stages))
        return lambda share: show.update(done=None if name in SEARCHES else share, load_factor=share)

    model = build_model(scene)
    weft, warp = (max(row[f"strain_{side}"] or 0.0 for row in rows) for side in ("weft", "warp"))
    largest = largest_equal_tension(rows)
    double = exact_model(scene, scene.solver.residual_tolerance)
    several = scene.variants.count > 1
    monitor = begin("tension-strain curves")
    kept = read_states(scene, out)
    curves, path, means = kept.curves, kept.path, kept.means
    if not curves:
        meshes = meshes_of(scene, scene.solver.residual_tolerance) if several else model
        curves = tension_strain(meshes, weft, warp, monitor)
    jumps = find_jumps(model, rows)
    optimum = find_optimum(rows, scene.wire.yield_stress, jumps)
    monitor = begin("equal tensions")
    parts = 2 + several
    if not path.rows and (largest > 0.0 or tension is not None):
        path = load_equally(double, largest, part_of(monitor, 0, parts))
    if several and path.rows and (not means.rows or (tension is not None and tension not in means.at)):
        meshes = meshes_of(scene, scene.solver.residual_tolerance)
        means = load_equally(meshes, largest, part_of(monitor, 2, parts), tension)
        means = replace(means if tension is None else with_state_at(meshes, means, tension), states={})
    if (curves, path, means) != (kept.curves, kept.path, kept.means):
        write_states(scene, out, KeptStates(curves, path, means))
    if tension is not None:
        path = with_state_at(double, path, tension, part_of(monitor, 1, parts))
    found_jumps = jumps_under_tension(double, path.rows)
    shown = replace(path, rows=means.rows, at=means.at, ended=means.ended) if means.rows else path
    shown_jumps = [] if means.rows else found_jumps  # of means there are none
    answers = None if len(shown.rows) < 2 else answers_of(double, shown.rows, shown_jumps)
    monitor = begin("material card")
    card, tensioned, where, loading = _card(double, rows, optimum, path, found_jumps, tension, part_of(monitor, 0, 2))
    mean = None
    if card is not None and several:
        load = under_tension(scene, tension) if tension is not None else _load_of_map(scene, optimum)
        mean = find_mean(scene, load, tension, card, part_of(monitor, 1, 2))
        card, loading = (card, loading) if mean is None else (mean.card, mean.loading)
    if card is not None and tension is not None:
        yields = None if answers is None else answers.first_yield_interior
        card = replace(card, ahead=ahead_of_card(card, yields, shown_jumps))
    service = service_points(scene, shown, shown_jumps, tension, None if means.rows else card)
    best = None if answers is None else answers.best
    held = tension_held(path, tension, None if best is None else mean_tension(best))
    heated, no_heat = heat(scene, path, held, begin("heat"))
    begin("openings and page")
    (knitted,) = (None if isinstance(state, Diverged) else state for state in states_at(model, [np.eye(2)]))
    states = {"as knitted": knitted, "at the tension of the card": tensioned}
    found = Findings(
        scene=scene,
        notes=notes,
        model=model,
        rows=rows,
        optimum=optimum,
        jumps=jumps,
        requested=tension,
        path=shown,
        path_jumps=shown_jumps,
        answers=None
        if answers is None
        else answers.changed(service=[point.answer for point in service], heat=[one for case in heated for one in case.answers]),
        heated=heated,
        no_heat=no_heat,
        service=service,
        curves=curves,
        where=where,
        card=card,
        mean=mean,
        loading=loading,
        tensioned=tensioned,
        knitted=knitted,
        openings={name: sizes for name, r in states.items() if r is not None and (sizes := openings(r))},
        model_warnings=list(model.warnings(rows)),
        earlier_kept=card is None and (out / CARD).exists(),
        codes=codes,
        reflection=reflection,
    )
    found = found if found.earlier_kept else replace(found, file_notes=write_files(found, out))
    ends = [*begins.values(), time.perf_counter()][1:]
    return replace(found, times={name: end - start for (name, start), end in zip(begins.items(), ends, strict=True)})


def _card(
    model: Mesh,
    cells: Sequence[MapRow],
    optimum: Optimum | None,
    path: EqualTensionPath,
    path_jumps: Sequence[RowJump],
    tension: float | None,
    monitor: Callable[[float], None],
) -> tuple[MaterialCard | None, Observables | None, str, Sequence[Row]]:
    """The card, its mesh, its state in words, and neighbouring states; or None and the reason.

    A card at a `tension` [N/m] is computed from the state of the path under equal tensions, else from the map's `cells`. It keeps
    the strains of this state, and so its equilibrium. The states end before the first snap-through. path_jumps: of the path.
    `monitor` gets the completed share.
    """
    scene = model.scene
    row = None if tension is None else path.at.get(tension)
    if tension is not None:
        text, cell = f"{exact(tension, 'N/m')} in both directions", map_cell(cells, tension)
    elif optimum is not None:
        text, cell = "the optimum of the map", next(one for one in cells if one.load == optimum.load)
    else:
        return None, None, f"no card: the map has no optimum; {ANOTHER}, or widen [sweep]", ()
    try:
        if tension is not None and row is not None:
            begin, rows, jumps = path.states[tension], list(path.rows), path_jumps
            passed = [jump for jump in jumps if mean_tension(jump[0]) < tension]
        elif cell is not None:
            way = LoadPath(model)
            rows = [row_of(record) for record in _path_of_map(way, cell, lambda share: monitor(WAY * share))]
            begin, jumps = way.state, jumps_of(model, rows)
            passed = jumps
        else:
            raise Diverged(unreached_text(scene, path, tension or 0.0))
        here = rows[-1] if row is None else row
        load, ahead, beyond = loads_of_card(scene, here, tension)
        card, mesh = _card_from(scene, begin, load, ahead, lambda share: monitor(WAY + (1.0 - WAY) * share))
    except Diverged as error:
        if tension is None:
            return None, None, f"no card for {text}, which was not found again: {error}; {ANOTHER}", ()
        return None, None, f"no card for {text}: {error}", ()
    if jumps:
        rows = rows[: next(k for k, each in enumerate(rows, 1) if each is jumps[0][0])]
    else:
        with suppress(Diverged):
            rows.append(row_of(LoadPath(model, begin).to(beyond)))
    left = row is not None and is_other(card.row, row)
    if tension is not None:
        branch = branches_at(tension, row, cells, card)
    else:
        branch = "" if cell is None or cell.variants > 1 else two_equilibria(text, card.row, "on the card", cell, "in the map")
    jumped = "; ".join(part for part in (jump_text(passed), f"its state is {LEFT}" if left else "") if part)
    return replace(card, jumps=jumped, branch=branch), mesh, text, rows


def _load_of_map(scene: Scene, cell: MapRow | Optimum | None) -> Stage:
    """The load of a cell of the map."""
    assert scene.sweep is not None and cell is not None
    return scene.sweep.stage(scene.stages[0], cell.load)


def _path_of_map(way: LoadPath, cell: MapRow, monitor: Callable[[float], None]) -> Iterator[Record]:
    """Records on the load path to a cell of the map, in its levels. Raises `Diverged`."""
    scene = way.scene
    assert scene.sweep is not None
    levels = dict(zip(scene.sweep.pairs, levels_of_pairs(scene.sweep.pairs, scene.levels), strict=True))
    return way.load(_load_of_map(scene, cell), levels[cell.load], monitor)


def _card_from(
    scene: Scene, begin: PathState, load: Stage, ahead: Stage, monitor: Callable[[float], None]
) -> tuple[MaterialCard, Observables]:
    """The card under `load`, from a state converged to the tolerance of the scene; ahead: a further increment of load.

    Raises `Diverged`.
    """
    *finer, tolerance = tolerances_of(scene)
    for one in finer:
        with suppress(Diverged):
            return find_card(exact_model(scene, one), begin, load, monitor, ahead=ahead)
    return find_card(exact_model(scene, tolerance), begin, load, monitor, ahead=ahead)
