"""The states of a report: from the map to curves, answers, material card, heat and openings.

Missing results are reported in words: a tension that the mesh does not reach, a state that did not converge. Curves and states
under equal tensions are kept on disk for another report of the same scene and map.
"""

from __future__ import annotations

import json
import time
import zipfile
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from .. import __version__
from ..base.errors import Diverged
from ..base.files import write_arrays
from ..base.text import exact
from ..compute.kept import strip_prefix
from ..results.finding import Finding
from ..results.row import Row, plain
from ..runner.answers import answers_of
from ..runner.branches import Jump as RowJump
from ..runner.branches import jumps_of, jumps_under_tension
from ..runner.history import mean_tension
from ..runner.progress_display import Display
from ..scene import Scene
from ..solve.model import build_model
from . import equal_tension
from .card_files import CARD, ahead_of_card
from .contact_map import MapRow, Optimum, find_jumps, find_optimum
from .curves import tension_strain
from .equal_tension import EqualTensionPath
from .fe_codes import CODES
from .findings import Findings
from .heat import heat, later_temperatures, tension_held
from .load_path import LoadPath, Meshes, Monitor, PathState, meshes_of, part_of, states_at, under_tension
from .map_paths import path_to
from .mean_card import MeanCard, find_mean, loads_of_card
from .opening_size import openings
from .report_files import write_files

STATES = "report_states.npz"
GRADIENT = "gradient"  # of a state, beside its snapshot
UNUSABLE = (OSError, ValueError, LookupError, TypeError, zipfile.BadZipFile)


def write_states(scene: Scene, out: Path, curves: Sequence[Row], path: EqualTensionPath) -> None:
    """Write the results of a report that do not depend on the requested tension."""
    about = {
        "curves": curves,
        "path": replace(path, states={}),
        "made_by": [scene.hash, __version__],
        "places": [list(of_meshes) for of_meshes in path.states.values()],
    }
    arrays = {"about": np.array(json.dumps(plain(about), default=lambda value: value.item()))}
    for number, of_meshes in enumerate(path.states.values()):
        for place, state in of_meshes.items():
            kept = state.kept | {GRADIENT: state.gradient}
            arrays |= {f"{number}_{place}_{name}": value for name, value in kept.items()}
    write_arrays(out / STATES, arrays)


def read_states(scene: Scene, out: Path) -> tuple[Sequence[Row], EqualTensionPath]:
    """Curves and path by `write_states` for this scene and version; without a readable file none."""
    try:
        with np.load(out / STATES, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        about = json.loads(str(arrays.pop("about")))
        if about["made_by"] != [scene.hash, __version__]:
            return (), EqualTensionPath()
        table = about["path"]
        at = {float(tension): Row(**row) for tension, row in table["at"].items()}
        stages = [under_tension(scene, tension) for tension in at]
        states: dict[float, dict[int, PathState]] = {}
        for number, (tension, places) in enumerate(zip(at, about["places"], strict=True)):
            kept = {place: strip_prefix(f"{number}_{place}_", arrays) for place in places}
            states[tension] = {
                place: PathState(tuple(stages[: number + 1]), of_mesh, of_mesh.pop(GRADIENT)) for place, of_mesh in kept.items()
            }
        path = EqualTensionPath([Row(**row) for row in table["rows"]], states, at, table["ended"])
        return [Row(**point) for point in about["curves"]], path
    except UNUSABLE:
        return (), EqualTensionPath()


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
    of_map: Sequence[Finding] = (),
    reflection: Sequence[Finding] = (),
) -> Findings:
    """Write report.html, the card, tension_strain.csv and figures into `out`. It holds the finished map of `scene`.

    rows: of the map. tension [N/m]: of the card, in both directions; default: the optimum. notes: how the scene was fitted.
    codes: FE codes that get the card (`fe.CODES`). of_map: lines on the optimum with other frictions. reflection: lines on the
    waves from the states of the map.
    A report without a card does not replace one that has one.
    Raises `ModelError`, `KnitError`.
    """
    show = progress or Display()

    stages = [name for name in STAGES if name != "heat" or later_temperatures(scene)]
    begins: dict[str, float] = {}  # [s] of the clock

    def begin(name: str) -> Monitor:
        if name in stages:
            begins[name] = time.perf_counter()
            show.stage(name, number=stages.index(name) + 1, of=len(stages))
        return lambda share: show.update(done=None if name in SEARCHES else share, load_factor=share)

    model, meshes = build_model(scene), meshes_of(scene)
    is_one = len(meshes.own) == 1
    weft, warp = (max(row[f"strain_{side}"] or 0.0 for row in rows) for side in ("weft", "warp"))
    largest = equal_tension.largest_equal_tension(rows)
    monitor = begin("tension-strain curves")
    curves, path = kept = read_states(scene, out)
    if not curves:
        curves = tension_strain(meshes, weft, warp, monitor)
    jumps = meshes.jumps(find_jumps, rows)
    optimum = find_optimum(rows, scene.wire.yield_stress, jumps)
    monitor = begin("equal tensions")
    if not path.rows and (largest > 0.0 or tension is not None):
        path = equal_tension.load_equally(meshes, largest, part_of(monitor, 0, 2))
    if (curves, path) != kept:
        write_states(scene, out, curves, path)
    if tension is not None:
        path = equal_tension.with_state_at(meshes, path, tension, part_of(monitor, 1, 2))
    path_jumps = meshes.jumps(jumps_under_tension, path.rows)
    answers = None if len(path.rows) < 2 else answers_of(meshes.first, path.rows, path_jumps)
    monitor = begin("material card")
    mean, where, loading = _card(scene, meshes, rows, optimum, path, path_jumps, tension, monitor)
    card = None if mean is None else mean.card
    if card is not None and tension is not None:
        yields = None if answers is None else answers.first_yield_interior
        card = replace(card, ahead=ahead_of_card(card, yields, path_jumps))
    service = equal_tension.service_points(scene, path, path_jumps, tension, card if is_one else None)
    best = None if answers is None else answers.best
    held = tension_held(path, tension, None if best is None else mean_tension(best))
    heated, no_heat = heat(scene, meshes, path, held, begin("heat"))
    begin("openings and page")
    (knitted,) = (None if isinstance(state, Diverged) else state for state in states_at(model, [np.eye(2)]))
    tensioned = None if mean is None else mean.tensioned
    states = {"as knitted": knitted, "at the tension of the card": tensioned}
    found = Findings(
        scene=scene,
        notes=notes,
        model=model,
        rows=rows,
        optimum=optimum,
        jumps=jumps,
        requested=tension,
        path=path,
        path_jumps=path_jumps,
        answers=None
        if answers is None
        else answers.changed(service=[point.answer for point in service], heat=[one for case in heated for one in case.answers]),
        heated=heated,
        no_heat=no_heat,
        service=service,
        curves=curves,
        where=where,
        card=card,
        mean=None if is_one else mean,
        loading=loading,
        tensioned=tensioned,
        knitted=knitted,
        openings={name: sizes for name, r in states.items() if r is not None and (sizes := openings(r))},
        model_warnings=list(model.warnings(rows)),
        earlier_kept=card is None and (out / CARD).exists(),
        codes=codes,
        of_map=of_map,
        reflection=reflection,
    )
    found = found if found.earlier_kept else replace(found, file_notes=write_files(found, out))
    ends = [*begins.values(), time.perf_counter()][1:]
    return replace(found, times={name: end - start for (name, start), end in zip(begins.items(), ends, strict=True)})


def _card(
    scene: Scene,
    meshes: Meshes,
    cells: Sequence[MapRow],
    optimum: Optimum | None,
    path: EqualTensionPath,
    path_jumps: Sequence[RowJump],
    tension: float | None,
    monitor: Monitor,
) -> tuple[MeanCard | None, str, Sequence[Row]]:
    """The card, its state in words, and neighbouring states; or None and the reason.

    A card at a `tension` [N/m] is computed from the states of the path under equal tensions, else from those at the optimum of
    the map's `cells`. It keeps the strains of these states, and so their equilibria. The neighbouring states end before the first
    snap-through. path_jumps: of the path. `monitor` gets the completed share.
    """
    row = None if tension is None else path.at.get(tension)
    if tension is not None:
        text, cell = f"{exact(tension, 'N/m')} in both directions", equal_tension.map_cell(cells, tension)
    elif optimum is not None:
        text, cell = "the optimum of the map", next(one for one in cells if one.load == optimum.load)
    else:
        return None, f"no card: the map has no optimum; {ANOTHER}, or widen [sweep]", ()
    try:
        if tension is not None and row is not None:
            way, rows, jumps = LoadPath(meshes, path.states[tension]), list(path.rows), list(path_jumps)
            passed = [jump for jump in jumps if mean_tension(jump[0]) < tension]
        elif cell is not None:
            way = LoadPath(meshes)
            to_cell, rows = path_to(scene, cell.load), []
            for number, stage in enumerate(to_cell.stages(scene)):
                rows += way.rows(stage, to_cell.levels, part_of(lambda share: monitor(WAY * share), number, len(to_cell.pairs)))
            jumps = passed = jumps_of(meshes.first, rows) if len(meshes.own) == 1 else []
        else:
            raise Diverged(equal_tension.unreached_text(scene, path, tension or 0.0))
        found = find_mean(meshes, way.states, tension, lambda share: monitor(WAY + (1.0 - WAY) * share))
    except Diverged as error:
        again = "" if tension is not None else ", which was not found again"
        return None, f"no card for {text}{again}: {error}" + ("" if tension is not None else f"; {ANOTHER}"), ()
    if jumps:
        rows = rows[: next(k for k, each in enumerate(rows, 1) if each is jumps[0][0])]
    else:
        beyond = {place: loads_of_card(scene, state.gradient, tension)[2] for place, state in way.states.items()}
        with suppress(Diverged):
            rows += way.rows(beyond, 1)
    if len(meshes.own) > 1:
        return found, text, rows
    card = found.card
    left = row is not None and equal_tension.is_other(card.row, row)
    branch = ""
    if tension is not None:
        branch = equal_tension.branches_at(tension, row, cells, card)
    elif cell is not None and cell.variants == 1:
        branch = equal_tension.two_equilibria(text, card.row, "on the card", cell, "in the map")
    of_state = f"its state is {equal_tension.LEFT}" if left else ""
    jumped = "; ".join(part for part in (equal_tension.jump_text(passed), of_state) if part)
    return replace(found, card=replace(card, jumps=jumped, branch=branch)), text, rows
