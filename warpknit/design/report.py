"""The output of `warpknit report` in addition to a contact map: report.html, the material card, tension-strain curves.

The page states what is missing: a tension that the mesh does not reach, a state that did not converge.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, fields, replace
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np

from .. import __version__, measure
from ..errors import Diverged
from ..files import write_aside, write_table
from ..measure import Observables
from ..mesh.layout import contact_classes
from ..runner.answers import answers_of
from ..runner.answers_table import answer_rows
from ..runner.branches import Jump as RowJump
from ..runner.branches import jumps_of, jumps_under_tension
from ..runner.history import Row, mean_tension, row_of
from ..runner.progress_display import Progress
from ..runner.strength import exceeded_text
from ..scene import Scene, Stage, Sweep
from ..scene.capabilities import refuse
from ..sweep.contact_map import (
    Jump,
    MapRow,
    Optimum,
    axes_of,
    find_jumps,
    find_optimum,
    grid,
    jump_warning,
    load_text,
    model_warnings,
    optimum_note,
    unconverged_warning,
)
from ..sweep.states import Mesh, mesh_of
from ..text import celsius, engineering, exact
from .card import MaterialCard, find_card
from .card_files import CARD, card_warnings, write_card
from .curves import CurvePoint, tension_strain
from .equal_tension import (
    EqualTensionPath,
    jump_text,
    load_equally,
    service_points,
    service_tensions,
    unreached_text,
    with_service,
)
from .fe import CODES, FILES, limit_of_curves, write_fe_cards
from .fine_states import ROUGH_TOLERANCE, exact_model, states_at
from .heat import HeatedMesh, heat
from .load_path import LoadPath, PathState, under_strain, under_tension
from .network import contact_resistances, sheet_resistance
from .opening_size import BANDS, Opening, openings
from .page import Page
from .sections import (
    answers_section,
    card_section,
    curve_section,
    electric_section,
    map_section,
    mesh_section,
    missing_text,
    openings_section,
    wire_text,
)
from .service import EqualTension, ServicePoint, equal_tension

STAGES = ("tension-strain curves", "equal tensions", "material card", "heat", "openings and page")  # of the progress
WAY = 0.6  # of the time of a card: the way to the optimum
BEYOND = 13.0 / 12.0  # of the load of the card: last point of its loading curves
DEFAULT_STRAINS = tuple(round(0.02 * k, 2) for k in range(11))
DEFAULT_SWEEP = Sweep(strain_weft=DEFAULT_STRAINS, strain_warp=DEFAULT_STRAINS)  # of the map where the scene has no [sweep]


@dataclass(frozen=True)
class Findings:
    """The content of the page."""

    scene: Scene
    notes: Sequence[str]  # how the scene was fitted
    model: Mesh
    rows: Sequence[MapRow]
    optimum: Optimum | None
    jumps: Sequence[Jump]  # of the map
    requested: float | None  # [N/m] tension requested for the card
    equal_tension: EqualTension  # largest in the map
    path: EqualTensionPath
    path_jumps: Sequence[RowJump]
    answers: dict[str, Any] | None  # that it gives (runner/answers.py)
    heated: Sequence[HeatedMesh]  # at one tension, while its temperature changes
    service: Sequence[ServicePoint]
    curves: Sequence[CurvePoint]
    where: str  # state of the card, in words; or why there is none
    card: MaterialCard | None
    loading: Sequence[Row]  # states from the mesh as knitted to the card and beyond, up to the first jump
    tensioned: Observables | None  # the mesh of the card
    knitted: Observables | None  # the mesh as knitted
    knitted_openings: Sequence[Opening]
    tensioned_openings: Sequence[Opening]
    model_warnings: Sequence[str]  # where the states are outside the validity of their model
    earlier_kept: bool  # nothing was written: there is no card, and the directory has an earlier report with one
    codes: Sequence[str]  # FE codes that get the card
    file_notes: tuple[str, ...] = ()  # FE codes without a card and why, and files that were removed

    @property
    def found_again(self) -> bool:
        """False where a card for the optimum of the map was looked for, and its state not found."""
        return self.requested is not None or self.card is not None

    @property
    def by_tension(self) -> bool:
        """Whether the map prescribes tensions."""
        return any(row.by_tension for row in self.rows)

    def place_in_map(self, point: ServicePoint) -> tuple[float, float] | None:
        """The load of a service point, by the axes of the map; None without one, or outside the map."""
        load = (point.tension, point.tension) if point.strains and self.by_tension else point.strains
        weft, warp = axes_of(self.rows)
        within = load is not None and weft[0] <= load[0] <= weft[-1] and warp[0] <= load[1] <= warp[-1]
        return load if within else None

    @property
    def sweep_text(self) -> str:
        """The loads of the map, and where they are from."""
        axes = zip(("weft", "warp"), axes_of(self.rows), strict=True)
        ends = " and ".join(
            f"{load_text((axis[0], axis[-1]), self.by_tension).replace(' / ', ' to ')} in {side}" for side, axis in axes
        )
        default = self.scene.sweep is DEFAULT_SWEEP
        source = "the default of a report; a table [sweep] in the scene changes them" if default else "of [sweep] in the scene"
        return f"{len(self.rows)} pairs of {'tensions' if self.by_tension else 'strains'}, {ends}: {source}"

    @property
    def card_state(self) -> str:
        """State and temperature of the card; or why there is none."""
        if self.card is not None:
            beyond = exceeded_text(self.scene, self.card.stress_max)
            stress = f", with a wire stress of {engineering(self.card.stress_max, 'Pa')}, {beyond}" if beyond else ""
            return f"{self.where}, at {celsius(self.card.temperature)}{stress}"
        return self.where + ("; the earlier report in the directory, with its card, is kept" if self.earlier_kept else "")

    @property
    def answer_lines(self) -> Iterator[tuple[str, str]]:
        """Headings and texts of the answers under equal tensions, for a terminal."""
        if self.answers is not None:
            yield from answer_rows(self.answers, self.scene.wire.yield_stress, gave_up=self.path.gave_up)
            yield "equal tensions", f"followed {self.path.end_text}"

    @property
    def limit_of_curves(self) -> str | None:
        """What the curves of the FE cards lack; None where they go on beyond the card, and without a card."""
        at_jump = bool(self.path_jumps and self.loading and self.loading[-1] is self.path_jumps[0][0])
        return None if self.card is None else limit_of_curves(self.card, self.loading, self.codes, at_jump=at_jump)

    @property
    def warnings(self) -> list[str]:
        """Limits to the use of the card and of the curves, for a terminal."""
        of_card = [] if self.card is None else list(card_warnings(self.card, self.scene))
        return [*of_card, *(limit for limit in (self.limit_of_curves, missing_text(self.curves)) if limit is not None)]


def report_scene(scene: Scene) -> Scene:
    """`scene`, with the default sweep if it has none. Raises `SceneError` for a scene without a report."""
    scene = replace(scene, sweep=scene.sweep or DEFAULT_SWEEP)
    refuse(scene, "report")
    return scene


def write_report(
    scene: Scene,
    rows: Sequence[MapRow],
    out: Path,
    *,
    tension: float | None = None,
    notes: Sequence[str] = (),
    codes: Sequence[str] = tuple(CODES),
    progress: Progress | None = None,
) -> Findings:
    """Write report.html, the card, tension_strain.csv and figures into `out`, which holds the finished map of `scene`.

    rows: of the map. tension [N/m]: of the card, in both directions; default: the optimum. notes: how the scene was fitted.
    codes: FE codes that get the card (`fe.CODES`). A report without a card does not replace one that has one.
    Raises `ModelError`, `KnitError`.
    """
    show = progress or Progress()

    def begin(number: int) -> Callable[[float], None]:
        show.stage(STAGES[number], number=number + 1, of=len(STAGES))
        return lambda share: show.update(done=share, load_factor=share)

    model = mesh_of(scene)
    weft, warp = (max(vars(row)[f"strain_{side}"] or 0.0 for row in rows) for side in ("weft", "warp"))
    curves = tension_strain(model, weft, warp, begin(0))
    jumps = find_jumps(model, rows)
    optimum, largest = find_optimum(rows, scene.wire.yield_stress, jumps), equal_tension(rows, scene.wire.yield_stress)
    double = exact_model(scene, scene.solver.residual_tolerance)
    path = load_equally(double, largest, tension, begin(1))
    found_jumps = jumps_under_tension(double, path.rows)
    card, tensioned, where, loading = _card(double, optimum, path, found_jumps, tension, begin(2))
    service = service_points(scene, path, tension, card)
    answers = None if len(path.rows) < 2 else answers_of(double, path.rows, found_jumps)
    best = None if answers is None else answers["best"]
    heated = heat(scene, path, tension or (None if best is None else mean_tension(Row(**best))), begin(3))
    begin(4)
    knitted = states_at(model, [np.eye(2)])[0]
    found = Findings(
        scene=scene,
        notes=notes,
        model=model,
        rows=rows,
        optimum=optimum,
        jumps=jumps,
        requested=tension,
        equal_tension=largest,
        path=path,
        path_jumps=found_jumps,
        answers=None
        if answers is None
        else with_service(answers, service) | {"heat": [one for case in heated for one in case.answers]},
        heated=heated,
        service=service,
        curves=curves,
        where=where,
        card=card,
        loading=loading,
        tensioned=tensioned,
        knitted=None if isinstance(knitted, Diverged) else knitted,
        knitted_openings=[] if isinstance(knitted, Diverged) else openings(knitted),
        tensioned_openings=[] if tensioned is None else openings(tensioned),
        model_warnings=model_warnings(model, rows),
        earlier_kept=card is None and (out / CARD).exists(),
        codes=codes,
    )
    return found if found.earlier_kept else replace(found, file_notes=_write(found, out))


def _card(
    model: Mesh,
    optimum: Optimum | None,
    path: EqualTensionPath,
    path_jumps: Sequence[RowJump],
    tension: float | None,
    watch: Callable[[float], None],
) -> tuple[MaterialCard | None, Observables | None, str, Sequence[Row]]:
    """The card, its mesh, its state in words, and states on the way to it and beyond; or None and the reason.

    The states end before the first jump. path: of the model under equal tensions, with its jumps, for a card at a `tension`
    [N/m]. `watch` is called with the share that is done.
    """
    scene = model.scene
    if tension is not None:
        text = f"{exact(tension, 'N/m')} in both directions"
        load, beyond = (under_tension(scene, factor * tension) for factor in (1.0, BEYOND))
    elif optimum is not None:
        text, strains = "the optimum of the map", np.array([optimum.strain_weft, optimum.strain_warp])
        load, beyond = (under_strain(scene, np.diag(1.0 + factor * strains)) for factor in (1.0, BEYOND))
    else:
        return None, None, f"no card: the map has no optimum; {_another(scene, path)}, or widen [sweep]", ()
    try:
        if tension is not None:
            begin, rows = path.states.get(tension), list(path.rows)
            jumps = path_jumps
            passed = [jump for jump in jumps if mean_tension(jump[0]) < tension]
        else:
            way = LoadPath(model)
            rows = [row_of(record) for record in way.load(load, scene.output.frames, lambda share: watch(WAY * share))]
            begin, jumps = way.state, jumps_of(model, rows)
            passed = jumps
        if begin is None:
            raise Diverged(unreached_text(scene, path, tension or 0.0))
        card, mesh = _card_from(scene, begin, load, lambda share: watch(WAY + (1.0 - WAY) * share))
    except Diverged as error:
        if tension is None:
            return None, None, f"no card for {text}, which was not found again: {error}; {_another(scene, path)}", ()
        return None, None, f"no card for {text}: {error}", ()
    if jumps:
        rows = rows[: next(k for k, row in enumerate(rows, 1) if row is jumps[0][0])]
    else:
        with suppress(Diverged):
            rows.append(row_of(LoadPath(model, begin).to(beyond)))
    return replace(card, jumps=jump_text(passed) or ""), mesh, text, rows


def _another(scene: Scene, path: EqualTensionPath) -> str:
    """What to ask for in place of the optimum: the first service tension that the mesh carries elastically."""
    for tension in service_tensions(scene, None):
        if (row := path.at.get(tension)) is not None and row.stress_max_Pa <= scene.wire.yield_stress:
            return f'ask for a card at a tension, as --tension "{exact(tension, "N/m")}"'
    return "ask for a card at a tension that the mesh carries, with --tension"


def _card_from(scene: Scene, begin: PathState, load: Stage, watch: Callable[[float], None]) -> tuple[MaterialCard, Observables]:
    """The card under `load`, from a state under it that has converged to the tolerance of the scene. Raises `Diverged`."""
    try:
        return find_card(exact_model(scene), begin, load, watch)
    except Diverged:
        return find_card(exact_model(scene, ROUGH_TOLERANCE), begin, load, watch)


def _write(found: Findings, out: Path) -> tuple[str, ...]:
    """Write the report; return what is to be told of the files of its card."""
    notes = []
    names = [field.name for field in fields(CurvePoint)]
    table = {name: np.array([asdict(p)[name] for p in found.curves], dtype=object) for name in names}
    write_table(out / "tension_strain.csv", table)
    if found.card is not None:
        fe_cards = write_fe_cards(
            found.card, found.loading, found.scene, found.where, out, codes=found.codes, warnings=found.model_warnings
        )
        write_card(found.card, found.scene, found.where, out, found.model_warnings, fe_cards)
        notes = [f"no card for {code}: {result}" for code, result in fe_cards.items() if result not in FILES]
        earlier = [name for name in FILES if name not in fe_cards.values() and (out / name).exists()]
        for name in earlier:
            (out / name).unlink()
        if earlier:
            notes.append(f"removed, as of an earlier report: {', '.join(earlier)}")
    with write_aside(out / "answers.json") as file:
        json.dump(found.answers, file, indent=2, allow_nan=False)
    with write_aside(out / "report.html") as file:
        file.write(_page(found, _figures(found, out / "figures")).html())
    return tuple(notes)


def _page(found: Findings, figures: dict[str, Path]) -> Page:
    wire = found.scene.wire
    page = Page(f"{found.scene.name}: {wire.material} mesh, {wire_text(wire)}")
    for warning in found.model_warnings:
        page.warning(f"{warning[0].upper()}{warning[1:]}.")
    page.text(f"warpknit {__version__}, {date.today().isoformat()}, scene {found.scene.hash}")
    answers_section(page, found.scene, found.answers, found.path, found.equal_tension, figures)
    for case in found.heated:
        if case.ended:
            page.warning(f"{case.ended}.")
    if (jumped := jump_text(found.path_jumps)) is not None:
        page.warning(f"Under equal tensions {jumped}.")
    page.text(
        "Computed by warpknit for endless cloth, without friction. Pairs of the map and curves are loaded from the mesh as"
        " knitted in proportion to their strains, answers and service tensions under equal tensions. Weft is across the wales"
        " (axis 1, x), warp along them (axis 2, y). Tensions are forces per current width."
    )
    preset = found.scene.preset_in_force
    nodes = f"{found.scene.model.nodes_per_loop} nodes per loop" + (f" (preset {preset})" if preset else "")
    known = found.scene.preset_caveat
    page.text(f"Model: {found.scene.model.kind}, {found.scene.kind_reason}; {nodes}." + (f" At it {known}." if known else ""))
    if found.card is None:
        page.warning(f"{found.where[0].upper()}{found.where[1:]}.")
    load = found.scene.stages[0]
    page.text(f"The optimum, the curves and the card are at {celsius(load.temperature)}, the temperature of [load].")
    mesh_section(page, found.scene, found.model.cloth, found.knitted, found.card, found.notes, figures)
    outside = [point for point in found.service if point.strains and found.place_in_map(point) is None]
    map_section(page, found.scene, found.optimum, found.jumps, found.service, outside, found.found_again, figures["map"])
    page.text(f"The map has {found.sweep_text}.")
    for of_map in (unconverged_warning(found.rows, found.by_tension), jump_warning(found.jumps, found.by_tension)):
        if of_map is not None:
            page.warning(f"{of_map[0].upper()}{of_map[1:]}.")
    curve_section(page, found.curves, figures["curves"])
    card_section(page, found.scene, found.card, found.where)
    if (limit := found.limit_of_curves) is not None:
        page.warning(f"{limit[0].upper()}{limit[1:]}.")
    openings_section(page, found.knitted_openings, found.tensioned_openings, figures["openings"])
    electric = None if found.tensioned is None else (contact_resistances(found.tensioned), sheet_resistance(found.tensioned))
    electric_section(page, found.scene, electric, figures["resistance"])
    return page


def _figures(found: Findings, folder: Path) -> dict[str, Path]:
    from ..export.design_figures import openings_figure, resistance_figure, tension_figure, tension_strain_figure
    from ..export.heat_figure import heat_figure
    from ..export.knit_figure import knit_figure
    from ..export.map_figure import Marks, map_figure
    from ..export.mesh_figure import mesh_figure, state_title

    weft, warp = axes_of(found.rows)
    optimum, limit = found.optimum, found.scene.wire.yield_stress
    load = None if optimum is None else optimum.load
    marks = Marks(
        stress=grid(found.rows, "stress_max_Pa", weft, warp),
        yield_stress=limit,
        optimum=load,
        jumps=found.jumps,
        optimum_note=optimum_note(load, found.jumps, found_again=found.found_again),
        places=tuple(
            (f"{p.name}: {p.strain}, {p.active} active", found.place_in_map(p), p.active_percent)
            for p in found.service
            if p.strains is not None
        ),
    )
    curves = {load: _arrays([p for p in found.curves if p.load == load]) for load in dict.fromkeys(p.load for p in found.curves)}
    states = (("as knitted", found.knitted_openings), ("at the tension of the card", found.tensioned_openings))
    circles = [(name, max(o.circle for o in those)) for name, those in states if those]
    draw: dict[str, Callable[[Path], Path]] = {
        "map": lambda path: map_figure(
            path, weft, warp, grid(found.rows, "active_percent", weft, warp),
            title=f"{found.scene.name}: active contacts", label="active contacts", unit="% of pairs", marks=marks,
            warnings=found.model_warnings, by_tension=found.by_tension,
        ),
        "curves": lambda path: tension_strain_figure(curves, path, yield_stress=limit),
        "openings": lambda path: openings_figure(circles, BANDS, path),
        "resistance": lambda path: resistance_figure(curves["equal"], path),
    }  # fmt: skip
    if found.answers is not None:
        answers, path = found.answers, [vars(row) for row in found.path.rows]
        apart = [(mean_tension(one), mean_tension(other)) for one, other in found.path_jumps]
        draw["tension"] = lambda file: tension_figure(path, answers, file, yield_stress=limit, jumps=apart)
    if (cloth := found.model.cloth) is not None:
        draw["knit"] = lambda path: knit_figure(cloth, found.scene.wire.thickness, path, classes=contact_classes(found.scene))
    if (mesh := found.tensioned) is not None:
        frame = measure.frame(mesh, index=0, stage="card", load_factor=1.0, temperature=found.scene.stages[0].temperature)
        title = state_title(frame, measure.mesh_tension(mesh))
        draw["mesh"] = lambda path: mesh_figure(mesh.model.layout(), frame, path, title, yield_stress=limit)
    figures = {name: drawn(folder / f"report_{name}.png") for name, drawn in draw.items()}
    heated = [[vars(row) for row in case.rows] for case in found.heated]
    heat = heat_figure(heated, folder / "report_heat.png")
    return figures if heat is None else figures | {"heat": heat}


def _arrays(points: Sequence[CurvePoint]) -> dict[str, np.ndarray]:
    """Columns of numbers; nan where there is none."""
    names = [field.name for field in fields(CurvePoint) if field.name != "load"]
    return {name: np.array([getattr(p, name) for p in points], dtype=float) for name in names}
