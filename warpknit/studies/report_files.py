"""The files of a report: report.html with its figures, answers, tension-strain curves and the material card."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from datetime import date
from pathlib import Path
from typing import Any

from .. import __version__, measure
from ..base.files import write_aside
from ..base.text import celsius, of_sides
from ..measure import peak_position
from ..results.row import Row, columns_of, write_json, write_rows
from ..runner.estimates import FRICTIONS
from ..runner.history import mean_tension
from ..runner.strength import assumed_text
from . import sections
from .card import MaterialCard
from .card_files import earlier_state, mesh_values, write_card
from .contact_map import axes_of, grid, optimum_note
from .equal_tension import jump_text
from .fe_codes import FILES, missing_cards, write_fe_cards
from .findings import Findings
from .opening_size import BANDS


def write_files(found: Findings, out: Path) -> tuple[str, ...]:
    """Write the report; return messages on the files of its card."""
    notes = []
    write_rows(out / "tension_strain.csv", found.curves, [*vars(found.curves[0])])
    if found.card is not None:
        before = earlier_state(out)
        several = () if found.mean is None else (found.mean.spread, found.mean.frictions, found.mean.meshes)
        fe_cards = _write_cards(found, found.card, found.loading, found.where, out, *several)
        write_other_cards(found, out)
        notes = list(missing_cards(fe_cards))
        if before not in (None, found.where):
            notes.append(f"replaced: the earlier material card, for {before}; --out keeps both")
        earlier = [name for name in FILES if name not in fe_cards.values() and (out / name).exists()]
        for name in earlier:
            (out / name).unlink()
        if earlier:
            notes.append(f"removed, as of an earlier report: {', '.join(earlier)}")
    write_json(out / "answers.json", found.answers)
    with write_aside(out / "report.html") as file:
        file.write(_page(found, _figures(found, out / "figures")).html())
    return tuple(notes)


def write_other_cards(found: Findings, out: Path) -> None:
    """Write further cards, each in a folder: softest mesh, stiffest mesh, further loading."""
    mean = found.mean
    of = "" if mean is None else f" of {mean.meshes} meshes"
    cards = {
        "softest": (None if mean is None else mean.softest, f"softest{of}"),
        "stiffest": (None if mean is None else mean.stiffest, f"stiffest{of}"),
        "loading": (None if found.card is None else found.card.of_loading, "further loading"),
    }
    for name, (card, state) in cards.items():
        shutil.rmtree(out / name, ignore_errors=True)
        if card is None:
            continue
        (out / name).mkdir()
        _write_cards(found, card, (), f"{found.where}, {state}", out / name)


def _write_cards(
    found: Findings, card: MaterialCard, loading: Sequence[Row], where: str, out: Path, *several: Any
) -> dict[str, str]:
    """Write a card and its files for FE codes; return the name of each, or why there is none."""
    fe_cards = write_fe_cards(card, loading, found.scene, where, out, codes=found.codes, warnings=found.model_warnings)
    write_card(card, found.scene, where, out, found.model_warnings, fe_cards, *several)
    return fe_cards


def _page(found: Findings, figures: dict[str, Path]) -> sections.Page:
    mesh = mesh_values(found.scene)
    page = sections.Page(f"{found.scene.name}: mesh of {mesh['wire'].replace(',', ' wire,', 1)}")
    for warning in found.model_warnings:
        page.warning(warning)
    page.text(f"warpknit {__version__}, {date.today().isoformat()}, scene {found.scene.hash}")
    sections.answers_section(page, found, figures)
    if found.heat_note:
        page.text(f"Heat is {found.heat_note}.")
    for case in found.heated:
        if case.ended:
            page.warning(case.ended)
    if (jumped := jump_text(found.path_jumps)) is not None:
        page.warning(f"under equal tensions {jumped}")
    friction = f"{found.scene.contact.friction:g}{assumed_text(found.scene, 'contact.friction')}"
    page.text(
        f"Computed by warpknit for endless cloth, with a friction of {friction}. Pairs of the map and curves are loaded from the"
        " mesh as knitted in proportion to their strains, answers and service tensions under equal tensions. Weft is across the"
        " wales (axis 1, x), warp along them (axis 2, y). Tensions are forces per current width."
    )
    known = f" Accuracy of {found.scene.preset_caveat}." if found.scene.preset_caveat else ""
    page.text(f"Model: {found.scene.model.kind} ({found.scene.kind_reason}). Preset: {mesh['preset']}.{known}")
    if found.card is None:
        page.warning(found.where)
    load = found.scene.stages[0]
    page.text(f"The optimum, the curves and the card are at {celsius(load.temperature)}, the temperature of [load].")
    sections.mesh_section(page, found, figures)
    sections.map_section(page, found, figures["map"])
    sections.curve_section(page, found, figures["curves"])
    sections.card_section(page, found)
    sections.openings_section(page, found, figures["openings"])
    sections.electric_section(page, found.scene, found.tensioned, figures["resistance"])
    sections.reflection_section(page, found.reflection, sorted(figures["map"].parent.glob("reflection_map_*.png")))
    return page


def _figures(found: Findings, folder: Path) -> dict[str, Path]:
    from ..export.curves_figure import heat_figure
    from ..export.design_figures import openings_figure, resistance_figure, tension_figure, tension_strain_figure
    from ..export.knit_figure import knit_figure
    from ..export.map_figure import Marks, map_figure
    from ..export.mesh_figure import mesh_figure, state_title

    weft, warp = axes_of(found.rows)
    optimum, limit = found.optimum, found.scene.wire.yield_stress
    load = None if optimum is None else optimum.load
    marks = Marks(
        stress=grid(found.rows, "stress_max_Pa", weft, warp),
        yield_stress=limit,
        is_assumed="wire.yield_stress" in found.scene.assumed,
        optimum=load,
        jumps=found.jumps,
        optimum_note=optimum_note(load, found.jumps, found_again=found.found_again),
        places=tuple(
            (f"{p.name}: {of_sides(p.texts[0].split(' / '))}, {p.texts[1]} active", found.place_in_map(p), p.row.active_percent)
            for p in found.service
            if p.row is not None
        ),
    )
    loads = dict.fromkeys(point.load for point in found.curves)
    curves = {load: columns_of(vars(point) for point in found.curves if point.load == load) for load in loads}
    circles = [(name, max(o.circle for o in those)) for name, those in found.openings.items()]
    draw: dict[str, Callable[[Path], Path]] = {
        "map": lambda path: map_figure(
            path, weft, warp, grid(found.rows, "active_percent", weft, warp),
            title=f"{found.scene.name}: active contacts", label="active contacts", unit="% of pairs", marks=marks,
            warnings=list(map(str, found.model_warnings)), by_tension=found.by_tension,
        ),
        "curves": lambda path: tension_strain_figure(curves, path, yield_stress=limit),
        "openings": lambda path: openings_figure(circles, BANDS, path),
        "resistance": lambda path: resistance_figure(curves["both"], path),
    }  # fmt: skip
    if found.answers is not None:
        answers, path = found.answers, columns_of(map(vars, found.path.rows))
        apart = [(mean_tension(one), mean_tension(other)) for one, other in found.path_jumps]
        others = {name: found.friction_name(name) for name in FRICTIONS}
        draw["tension"] = lambda file: tension_figure(path, answers, file, yield_stress=limit, jumps=apart, frictions=others)
    if (cloth := found.model.cloth) is not None:
        draw["knit"] = lambda path: knit_figure(cloth, found.scene.wire.thickness, path)
    if (mesh := found.tensioned) is not None:
        frame = measure.frame(mesh, index=0, stage="card", load_factor=1.0, temperature=found.scene.stages[0].temperature)
        title = state_title(frame, measure.mesh_tension(mesh))
        peak = measure.largest_stress(mesh), *peak_position(mesh).tolist()
        draw["mesh"] = lambda path: mesh_figure(mesh.model.layout(), frame, path, title, yield_stress=limit, peak=peak)
    figures = {name: drawn(folder / f"report_{name}.png") for name, drawn in draw.items()}
    behind = {id(after) for case in found.heated for _, after in case.jumps}
    heated = [columns_of({**vars(row), "jump": id(row) in behind} for row in case.rows) for case in found.heated]
    heat = heat_figure(heated, folder / "report_heat.png")
    return figures if heat is None else figures | {"heat": heat}
