"""The output of `warpknit report` in addition to a contact map: report.html, the material card, tension-strain curves.

The page states what is missing: a tension that the mesh does not reach, a state that did not converge.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields, replace
from datetime import date
from pathlib import Path

import numpy as np

from .. import __version__, measure
from ..errors import Diverged
from ..files import write_aside, write_table
from ..measure import Observables
from ..mesh.layout import contact_classes
from ..runner.progress_display import Progress
from ..scene import Scene, Sweep
from ..scene.capabilities import refuse
from ..sweep.contact_map import Jump, MapRow, Optimum, axes_of, find_jumps, find_optimum, grid, jump_warning, model_warnings
from ..sweep.states import Mesh, mesh_of
from ..text import celsius, exact
from .card import MaterialCard, find_card, find_card_at_tension
from .card_files import card_warnings, write_card
from .curves import CurvePoint, loading_path, tension_strain
from .equal_tension import EqualTensionRun, run_equal_tension
from .fe import CODES, FILES, write_fe_cards
from .fine_states import DIFFERENCE_TOLERANCE, ROUGH_TOLERANCE, exact_model, states_at
from .network import contact_resistances, sheet_resistance
from .opening_size import BANDS, Opening, openings
from .page import Page
from .sections import answers_section, card_section, curve_section, electric_section, map_section, mesh_section, openings_section
from .service import EqualTension, ServicePoint, equal_tension, service_points, strains_under_tension

UNDER_TENSION, SEARCHED = 0.3, 0.5  # of the time of a card at a tension: run under it, and search for its strains
DEFAULT_STRAINS = tuple(round(0.02 * k, 2) for k in range(11))  # of the map where the scene has no [sweep]


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
    run: EqualTensionRun  # to that tension, or the requested one
    service: Sequence[ServicePoint]
    curves: Sequence[CurvePoint]
    where: str  # state of the card, in words; or why there is none
    card: MaterialCard | None
    loading: Sequence[CurvePoint]  # states from the mesh as knitted to the card and beyond
    tensioned: Observables | None  # the mesh of the card
    knitted_openings: Sequence[Opening]
    tensioned_openings: Sequence[Opening]
    model_warnings: Sequence[str]  # where the states are outside the validity of their model

    @property
    def by_tension(self) -> bool:
        """Whether the map prescribes tensions."""
        return any(row.by_tension for row in self.rows)

    @property
    def card_state(self) -> str:
        """State and temperature of the card; or why there is none."""
        return self.where if self.card is None else f"{self.where}, at {celsius(self.card.temperature)}"

    @property
    def warnings(self) -> list[str]:
        """Limits to the use of the card."""
        return [] if self.card is None else list(card_warnings(self.card, self.scene))


def report_scene(scene: Scene) -> Scene:
    """`scene`, with the default sweep if it has none. Raises `SceneError` for a scene without a report."""
    scene = replace(scene, sweep=scene.sweep or Sweep(strain_weft=DEFAULT_STRAINS, strain_warp=DEFAULT_STRAINS))
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
    codes: FE codes that get the card (`fe.CODES`).
    Raises `ModelError`, `KnitError`.
    """
    show = progress or Progress()
    show.stage("tension-strain curves", number=1, of=5)
    model = mesh_of(scene)
    weft, warp = (max(vars(row)[f"strain_{side}"] or 0.0 for row in rows) for side in ("weft", "warp"))
    curves = tension_strain(model, weft, warp, lambda share: show.update(done=share, load_factor=share))
    show.stage("material card", number=2, of=5)
    optimum = find_optimum(rows, scene.wire.yield_stress)
    card, tensioned, where = _card(scene, optimum, tension, lambda share: show.update(done=share, load_factor=share))
    loading = [] if card is None else loading_path(model, card.strain_weft, card.strain_warp)
    show.stage("service tensions", number=3, of=5)
    service = service_points(scene, rows, tension, card, lambda share: show.update(done=share, load_factor=share))
    show.stage("equal tensions", number=4, of=5)
    equal = equal_tension(rows, scene.wire.yield_stress)
    largest = max(equal.largest, tension or 0.0)
    run = run_equal_tension(scene, largest, tension, service, lambda share: show.update(done=share, load_factor=share))
    show.stage("openings and page", number=5, of=5)
    knitted = states_at(model, [np.eye(2)])[0]
    found = Findings(
        scene=scene,
        notes=notes,
        model=model,
        rows=rows,
        optimum=optimum,
        jumps=find_jumps(model, rows),
        requested=tension,
        equal_tension=equal,
        run=run,
        service=service,
        curves=curves,
        where=where,
        card=card,
        loading=loading,
        tensioned=tensioned,
        knitted_openings=[] if isinstance(knitted, Diverged) else openings(knitted),
        tensioned_openings=[] if tensioned is None else openings(tensioned),
        model_warnings=model_warnings(model, rows),
    )
    _write(found, out, codes)
    return found


def _card(
    scene: Scene, optimum: Optimum | None, tension: float | None, watch: Callable[[float], None]
) -> tuple[MaterialCard | None, Observables | None, str]:
    """The card, its mesh, and its state in words; or None and the reason. `watch` is called with the share that is done."""
    if tension is not None:
        text = f"{exact(tension, 'N/m')} in both directions"
        try:
            start, tangent = strains_under_tension(scene, tension, lambda share: watch(UNDER_TENSION * share))
        except Diverged as error:
            return None, None, f"no card for {text}: {error}"

        def find(model: Mesh) -> tuple[MaterialCard, Observables]:
            return find_card_at_tension(model, tension, start, tangent, lambda share: watch(SEARCHED + (1 - SEARCHED) * share))

    elif optimum is not None:
        text, strains = "the optimum of the map", (optimum.strain_weft, optimum.strain_warp)

        def find(model: Mesh) -> tuple[MaterialCard, Observables]:
            return find_card(model, *strains, watch)

    else:
        return None, None, "no card: the map has no optimum; ask for a tension, or widen [sweep]"
    why = ""
    for tolerance in (DIFFERENCE_TOLERANCE, ROUGH_TOLERANCE):
        try:
            return *find(exact_model(scene, tolerance)), text
        except Diverged as error:
            why = str(error)
    return None, None, f"no card for {text}: {why}"


def _write(found: Findings, out: Path, codes: Sequence[str]) -> None:
    names = [field.name for field in fields(CurvePoint)]
    table = {name: np.array([asdict(p)[name] for p in found.curves], dtype=object) for name in names}
    write_table(out / "tension_strain.csv", table)
    for name in ("material_card.csv", "material_card.json", *FILES):
        (out / name).unlink(missing_ok=True)  # of an earlier report
    if found.card is not None:
        fe_cards = write_fe_cards(
            found.card, found.loading, found.scene, found.where, out, codes=codes, warnings=found.model_warnings
        )
        write_card(found.card, found.scene, found.where, out, found.model_warnings, fe_cards)
    with write_aside(out / "answers.json") as file:
        json.dump(found.run.answers, file, indent=2, allow_nan=False)
    with write_aside(out / "report.html") as file:
        file.write(_page(found, _figures(found, out / "figures")).html())


def _page(found: Findings, figures: dict[str, Path]) -> Page:
    wire = found.scene.wire
    page = Page(f"{found.scene.name}: {wire.material} mesh, {1e6 * wire.diameter:g} um wire")
    page.text(f"warpknit {__version__}, {date.today().isoformat()}, scene {found.scene.hash}")
    for warning in found.model_warnings:
        page.warning(f"{warning[0].upper()}{warning[1:]}.")
    answers_section(page, found.scene, found.run, found.equal_tension, figures.get("heat"))
    page.text(
        "Computed by warpknit for endless cloth, without friction; every state is loaded proportionally from the mesh as"
        " knitted. Weft is across the wales (axis 1, x), warp along them (axis 2, y). Tensions are forces per current width."
    )
    page.text(f"Model: {found.scene.model.kind}, {found.scene.kind_reason}.")
    if found.card is None:
        page.warning(f"{found.where[0].upper()}{found.where[1:]}.")
    load = found.scene.stages[0]
    page.text(f"The optimum, the curves and the card are at {celsius(load.temperature)}, the temperature of [load].")
    mesh_section(page, found.scene, found.model.cloth, found.card, found.notes, figures)
    map_section(page, found.scene, found.optimum, found.service, found.equal_tension, figures["map"])
    if (jumped := jump_warning(found.jumps, found.by_tension)) is not None:
        page.warning(f"{jumped[0].upper()}{jumped[1:]}.")
    curve_section(page, found.curves, figures["curves"])
    card_section(page, found.scene, found.card, found.where)
    openings_section(page, found.knitted_openings, found.tensioned_openings, figures["openings"])
    electric = None if found.tensioned is None else (contact_resistances(found.tensioned), sheet_resistance(found.tensioned))
    electric_section(page, found.scene, electric, figures["resistance"])
    return page


def _figures(found: Findings, folder: Path) -> dict[str, Path]:
    from ..export.curves_figure import heat_figure
    from ..export.design_figures import openings_figure, resistance_figure, tension_strain_figure
    from ..export.knit_figure import knit_figure
    from ..export.map_figure import Marks, map_figure
    from ..export.mesh_figure import mesh_figure, state_title

    weft, warp = axes_of(found.rows)
    optimum, limit = found.optimum, found.scene.wire.yield_stress
    marks = Marks(
        stress=grid(found.rows, "stress_max_Pa", weft, warp),
        yield_stress=limit,
        optimum=None if optimum is None else optimum.load,
        jumps=found.jumps,
        places=tuple(
            (f"{p.name}: {p.strain}, {p.active} active", load, p.active_percent)
            for p in found.service
            if (load := (p.tension, p.tension) if p.strains and found.by_tension else p.strains) is not None
            and weft[0] <= load[0] <= weft[-1]
            and warp[0] <= load[1] <= warp[-1]
        ),
    )
    curves = {load: _arrays([p for p in found.curves if p.load == load]) for load in dict.fromkeys(p.load for p in found.curves)}
    states = (("as knitted", found.knitted_openings), ("at the tension of the card", found.tensioned_openings))
    circles = [(name, max(o.circle for o in those)) for name, those in states if those]
    draw: dict[str, Callable[[Path], Path]] = {
        "map": lambda path: map_figure(
            path, weft, warp, grid(found.rows, "active_percent", weft, warp),
            title=f"{found.scene.name}: active contacts", label="active contacts [% of pairs]", percent=True, marks=marks,
            warnings=found.model_warnings, by_tension=found.by_tension,
        ),
        "curves": lambda path: tension_strain_figure(curves, path, yield_stress=limit),
        "openings": lambda path: openings_figure(circles, BANDS, path),
        "resistance": lambda path: resistance_figure(curves["equal"], path),
    }  # fmt: skip
    if (cloth := found.model.cloth) is not None:
        draw["knit"] = lambda path: knit_figure(cloth, found.scene.wire.diameter, path, classes=contact_classes(found.scene))
    if (mesh := found.tensioned) is not None:
        frame = measure.frame(mesh, index=0, stage="card", load_factor=1.0, temperature=found.scene.stages[0].temperature)
        title = state_title(frame, measure.mesh_tension(mesh))
        draw["mesh"] = lambda path: mesh_figure(mesh.model.layout(), frame, path, title, yield_stress=limit)
    figures = {name: drawn(folder / f"report_{name}.png") for name, drawn in draw.items()}
    heat = heat_figure([vars(row) for row in found.run.heated], folder / "report_heat.png") if found.run.heated else None
    return figures if heat is None else figures | {"heat": heat}


def _arrays(points: Sequence[CurvePoint]) -> dict[str, np.ndarray]:
    """Columns of numbers; nan where there is none."""
    names = [field.name for field in fields(CurvePoint) if field.name != "load"]
    return {name: np.array([getattr(p, name) for p in points], dtype=float) for name in names}
