"""The sections of report.html."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable, Sequence
from pathlib import Path

from scipy.constants import inch, speed_of_light

from .. import measure
from ..base.text import alike, celsius, engineering, percent, short_percent
from ..measure import Observables
from ..measure.network import contact_resistances, sheet_resistance, surface, wire_resistance
from ..reflection.table import NEAR_BEST
from ..results.finding import Finding, ResultWarning
from ..runner.answers_table import answer_findings
from ..runner.strength import limit_text
from ..runner.variants import Spread
from ..scene import Scene
from . import contact_map
from .card import AGREEMENT
from .card_files import card_values, card_warnings, definition, mesh_values, strength_values
from .curves import missing_points
from .findings import Findings
from .inputs import complete_openings, openings_per_length
from .opening_size import BANDS, FINE_ENOUGH

STYLE = """
body { font: 11pt/1.45 Georgia, 'Times New Roman', serif; max-width: 50em; margin: 2em auto; padding: 0 1em; color: #202020; }
p { overflow-wrap: anywhere; }
h1 { font-size: 1.6em; margin-bottom: 0.2em; } h2 { font-size: 1.2em; margin-top: 1.8em; border-bottom: 1px solid #C0C0C0; }
table { border-collapse: collapse; margin: 0.8em 0; }
td, th { padding: 0.2em 0.9em 0.2em 0; text-align: left; vertical-align: top; }
th { font-weight: normal; color: #505050; } thead th { border-bottom: 1px solid #909090; }
tbody th { white-space: nowrap; }
figure { margin: 1em 0; } img { max-width: 100%; max-height: 100vh; } figcaption { color: #505050; font-size: 0.92em; }
.warning { border-left: 4px solid #D55E00; padding-left: 0.8em; }
@media (max-width: 40em) {
  body { margin: 0.5em auto; } table { display: block; overflow-x: auto; } td, th { padding-right: 0.5em; }
  tbody th { white-space: normal; }
}
@media print {
  @page { size: A4; margin: 18mm; }
  body { margin: 0; padding: 0; max-width: none; font-size: 10pt; }
  h2 { break-after: avoid; } h2.new-page { break-before: page; } figure, tr, .warning { break-inside: avoid; }
  thead { display: table-header-group; } figure img { max-height: 215mm; }
}
"""


class Page:
    """An HTML page under construction; text is escaped, pictures are embedded."""

    def __init__(self, title: str) -> None:
        self._title = title
        self._parts = [f"<h1>{html.escape(title)}</h1>"]

    def heading(self, text: str, *, new_page: bool = False) -> None:
        """A heading; `new_page`: on a new page of paper."""
        mark = ' class="new-page"' if new_page else ""
        self._parts.append(f"<h2{mark}>{html.escape(text)}</h2>")

    def text(self, text: str) -> None:
        self._parts.append(f"<p>{html.escape(text)}</p>")

    def warning(self, warning: ResultWarning | str) -> None:
        """A warning, in its own paragraph."""
        text = str(warning)
        text = f"{text[0].upper()}{text[1:].removesuffix('.')}."
        self._parts.append(f'<p class="warning">{html.escape(text)}</p>')

    def table(self, rows: Iterable[Sequence[str]], headings: Sequence[str] = ()) -> None:
        """A table; the first cell of each row is its name."""
        lines = [_row(row, 1) for row in rows]
        head = f"<thead>{_row(headings, len(headings))}</thead>" if headings else ""
        self._parts.append(f"<table>{head}<tbody>{''.join(lines)}</tbody></table>")

    def figure(self, path: Path, caption: str) -> None:
        """Embed a PNG file."""
        data = base64.b64encode(path.read_bytes()).decode("ascii")
        words = html.escape(caption)
        image = f'<img alt="{words}" src="data:image/png;base64,{data}">'
        self._parts.append(f"<figure>{image}<figcaption>{words}</figcaption></figure>")

    def html(self) -> str:
        """The whole page."""
        body = "\n".join(self._parts)
        head = '<meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">'
        head += f"<title>{html.escape(self._title)}</title><style>{STYLE}</style>"
        return f'<!DOCTYPE html>\n<html lang="en">\n<head>{head}</head>\n<body>\n{body}\n</body>\n</html>\n'


def _row(cells: Sequence[str], headings: int) -> str:
    kinds = ["th"] * headings + ["td"] * (len(cells) - headings)
    return "<tr>" + "".join(f"<{kind}>{html.escape(cell)}</{kind}>" for kind, cell in zip(kinds, cells, strict=True)) + "</tr>"


BAND = " Bands: eight in ten of the meshes."
FOR_PEOPLE = {"Pa": (1e-6, "MPa"), "kg/m^2": (1e3, "g/m2"), "1/K": (1e6, "1e-6/K")}  # factor from SI, and unit


def answers_section(page: Page, found: Findings, figures: dict[str, Path]) -> None:
    """Answers to a designer's questions, first on the page."""
    scene, answers, path = found.scene, found.answers, found.path
    page.heading("In short")
    if answers is None:
        reason = f"the mesh as knitted did not converge ({path.ended})" if path.ended else "the map has none; change [sweep]"
        page.warning(f"no strains with equal tension in both directions: {reason}")
        return
    lines = answer_findings(answers, scene.wire.yield_stress, failed=path.failed)
    page.table([(line.name, line.text) for line in lines])
    half = "A class counts as closed where it is closed in half of the meshes. "
    of, band = (f"These answers are {found.of_meshes}. {half}", BAND) if found.of_meshes else ("", "")
    page.text(
        f"{of}The load path has equal tensions in weft and warp. It goes in {len(path.rows) - 1} load levels from the mesh as"
        f" knitted {path.end_text}. Another load path, as in a run or the map, may give other results. A class of contacts, A,"
        " B, ..., has all clasps of one shape; A has the tightest lens. A clasp, where two wires hook each other, has two pairs,"
        " one for each wire. The table below has the same shares at service tensions. The wire is elastic and free of stress as"
        f" knitted: the load alone causes its stress. First yield is at an {limit_text(scene)}."
    )
    page.figure(
        figures["tension"],
        "Active contacts and largest wire stress against equal tensions in weft and warp. The best tension is in the"
        " middle of its valid range: the widest range with the most active contacts below yield. Grey: snap-through to another"
        f" equilibrium.{band}{' Thin lines: with another friction.' if found.friction_text else ''}",
    )
    if "heat" in figures:
        page.figure(
            figures["heat"],
            f"The mesh while its temperature changes as in each [[path]]: under a held tension, and in a frame with an"
            f" expansion of {1e6 * scene.model.frame_expansion:g} x 1e-6/K (model.frame_expansion).",
        )
    elif found.no_heat:
        page.text(f"{found.no_heat[0].upper()}{found.no_heat[1:]}, so this page does not show the effect of heat.")


def mesh_section(page: Page, found: Findings, figures: dict[str, Path]) -> None:
    """Wire, knit and mass of the mesh, with its pictures."""
    scene, cloth, knitted, card = found.scene, found.model.cloth, found.knitted, found.card
    knit = scene.knit
    page.heading("The mesh")
    rows = [
        ("wire", mesh_values(scene)["wire"]),
        ("wales and courses", f"{0.01 / knit.wale_spacing:.3g} and {0.01 / knit.course_spacing:.3g} per cm"),
    ]
    if cloth is not None:
        bars = enumerate(knit.bars, 1)
        rows += [(f"guide bar {n}", f"chain {bar.chain}, threading {bar.threading}, shift {bar.shift}") for n, bar in bars]
        loops = len(cloth.stitches) / (cloth.wales * cloth.courses)
        lengths = f"{1e3 * cloth.wire_length:.3g} mm, {1e3 * cloth.stitch_length:.3g} mm in plan view"
        rows.append(("wire length per loop", f"{lengths}, {loops:g} per needle and course"))
        if knitted is not None:
            rows.append(("areal mass as knitted", f"{1e3 * measure.areal_mass(knitted):.3g} g/m2"))
        if (count := openings_per_length(scene)) is not None:
            counted = f"{complete_openings(scene)[0]} in a repeat, each with at least two thirds of the largest area"
            rows.append(
                ("openings as knitted", f"{count * inch:.3g} per inch: square root of the number per square inch; {counted}")
            )
    if card is not None:
        rows.append(("areal mass at the tension of the card", f"{1e3 * card.areal_mass:.3g} g/m2"))
    page.table(rows)
    for note in found.notes:
        page.text(note[0].upper() + note[1:] + ".")
    if "knit" in figures:
        page.figure(figures["knit"], "The mesh as knitted, in plan view, with its clasps.")
    if "mesh" in figures:
        page.figure(
            figures["mesh"],
            "The mesh at the tension of the card: stress of the wires at the nodes, active and open contacts. A star"
            " marks the largest stress, which may lie between two nodes, under a contact.",
        )


def map_section(page: Page, found: Findings, figure: Path) -> None:
    """The contact map, the optimum and the service tensions."""
    scene, optimum, jumps = found.scene, found.optimum, found.jumps
    outside = [point for point in found.service if point.strains and found.place_in_map(point) is None]
    page.heading("Active contacts and the optimum", new_page=True)
    page.figure(
        figure,
        "Active contacts over the loads of the map. A tile shows the state at its middle; a tile at the edge of the map shows the"
        " state on the edge. Markers of service tensions have the colour of their share of active contacts.",
    )
    if optimum is None:
        page.warning("No tensile load of the map has active contacts with the wire below its elastic limit.")
    else:
        note = contact_map.optimum_note(optimum.load, jumps, found_again=found.found_again)
        share = f"{percent(1.0 - optimum.stress_margin, 0)} of the {limit_text(scene)}"
        page.table([
            ("optimum strain, weft / warp", f"{percent(optimum.strain_weft)} / {percent(optimum.strain_warp)}{note}"),
            ("tension, weft / warp", _pair(optimum.tension_weft_N_per_m, optimum.tension_warp_N_per_m, "N/m")),
            ("active contacts", f"{percent(0.01 * optimum.active_percent)} of pairs"),
            ("largest wire stress", f"{engineering(optimum.stress_max_Pa, 'Pa')}, {share}"),
            *((line.name.strip().removeprefix("with "), line.text) for line in found.of_map),
            *((contact_map.drift_name(drift), contact_map.drift_text(drift)) for drift in optimum.drift),
        ])  # fmt: skip
    if outside:
        places = ", ".join(point.name for point in outside)
        page.warning(f"These service tensions are outside the map and have no marker: {places}. Use a wider [sweep].")
    page.text(
        "The optimum is the pair of loads of the map, equal or not, with the most active contacts while the wire stays"
        " below its elastic limit. The best tension above is under equal tensions: the middle of the widest range with the most"
        " active contacts. Use it for a mesh with the same tension in weft and warp."
    )
    for warning in contact_map.optimum_warnings(optimum, jumps):
        page.warning(warning)
    lines: list[tuple[str, ...]] = []
    for point in found.service:
        lines.append((point.name, *point.texts))
        lines += [] if point.range_texts is None else [("eight in ten meshes", *point.range_texts)]
        lines += [(found.friction_name(friction), *texts) for friction, texts in point.friction_texts.items()]
    page.table(
        lines,
        ("service tension, both directions", "strain, weft / warp", "active contacts", "largest wire stress"),
    )
    if found.of_meshes:
        page.text(
            f"The map is the mean over meshes with scattered loops. The service tensions are {found.of_meshes}."
            f"{found.friction_text} Openings, contact resistances and the picture at the tension of the card belong to the median"
            f" mesh.{scatter_text(found.rows, optimum)}"
        )
    page.text(f"The map has {found.sweep_text}.")
    limits = (*contact_map.unconverged_warning(found.rows, found.by_tension), *contact_map.jump_warning(jumps, found.by_tension))
    for of_map in (*limits, *found.branch_notes):
        page.warning(of_map)


def scatter_text(rows: Sequence[contact_map.MapRow], optimum: contact_map.Optimum | None) -> str:
    """Scatter of single meshes at the optimum as a sentence after a space; or nothing."""
    row = next((row for row in rows if optimum is not None and row.load == optimum.load and row.variants > 1), None)
    if row is None:
        return ""
    what, unit, size = (
        ("strain", "", (row.strain_weft, row.strain_warp)) if row.by_tension else ("tension", "_N_per_m", row.tension)
    )
    largest = max(row[f"std_{what}_{side}{unit}"] for side in ("weft", "warp"))
    scatter, stress = largest / max(map(abs, size)), row.std_stress_max_Pa / row.stress_max_Pa
    return (
        f" At the optimum {row.variants} meshes have standard deviations of {short_percent(scatter)} in {what} and"
        f" {short_percent(stress)} in the largest stress. The standard errors of their means are"
        f" {short_percent(scatter / row.variants**0.5)} and {short_percent(stress / row.variants**0.5)}."
    )


def curve_section(page: Page, found: Findings, figure: Path) -> None:
    """Tension-strain curves."""
    curves = found.curves
    page.heading("Tension against strain")
    page.figure(
        figure,
        "Tension in weft and warp. Orange: wire beyond its elastic limit, where the curves may leave the picture. Grey:"
        " compressed, where a real mesh wrinkles. Dotted: snap-through to another equilibrium."
        + (BAND if found.of_meshes else ""),
    )
    for warning in missing_points(curves):
        page.warning(warning)
    of = f" They are {found.of_meshes}." if found.of_meshes else ""
    page.text(f"The values are in tension_strain.csv.{of}")


def _shown(name: str, value: float, unit: str) -> tuple[str, str]:
    """A value of the card and its unit, for people."""
    if name == "stable":
        return "yes" if value else "no", "-"
    if name == "temperature":
        number, unit = celsius(value).split()
        return number, unit
    if name.startswith("prestrain") or name == "active":  # as everywhere on the page
        return percent(value).removesuffix(" %"), "%"
    if unit == "1" and not name.startswith("nu"):
        return f"{100 * value:.3g}", "%"
    factor, unit = FOR_PEOPLE.get(unit, (1.0, "-" if unit == "1" else unit))
    return f"{factor * value:.4g}", unit


def _range(spread: Spread | None, name: str, unit: str) -> str:
    """The range of a value of the card over the meshes, for people; empty for equal values."""
    if spread is None or spread.p10 == spread.p90:
        return ""
    return " to ".join(_shown(name, value, unit)[0] for value in (spread.p10, spread.p90))


def card_section(page: Page, found: Findings) -> None:
    """The material card, or why there is none."""
    scene, card, where = found.scene, found.card, found.where
    page.heading("Material card", new_page=True)
    if card is None:
        page.warning(where)
        return
    tensions = _pair(card.tension_weft, card.tension_warp, "N/m")
    strains = " / ".join(percent(strain) for strain in (card.strain_weft, card.strain_warp))
    page.text(
        f"Valid at {where}: {tensions} and strains of {strains} in weft / warp, with {percent(0.01 * card.active_percent)} of the"
        f" contacts active, at {celsius(card.temperature)}."
    )
    if card.ahead:
        page.text(f"Margin: {card.ahead}.")
    values = [*card_values(card), *strength_values(card, scene)]
    rows = [(name, *_shown(name, value, unit), meaning) for name, value, unit, meaning in values]
    if (mean := found.mean) is None:
        page.table(rows, ("", "value", "unit", "meaning"))
    else:
        frictions = list(dict.fromkeys(friction for of in mean.frictions.values() for friction in of))
        wider = []
        for row, (name, _value, unit, _meaning) in zip(rows, values, strict=True):
            others = mean.frictions.get(name, {})
            more = [_shown(name, others[one], unit)[0] if one in others else "" for one in frictions]
            wider.append((*row[:2], _range(mean.spread.get(name), name, unit), *more, *row[2:]))
        names = map(found.friction_name, frictions)
        page.table(wider, ("", "value", "range of eight in ten", *names, "unit", "meaning"))
        page.text(
            f"The card is the mean of {mean.meshes} meshes with scattered loops. The folders softest and stiffest have the"
            f" cards of the meshes with the least and the largest C11 + C22.{found.friction_text}"
        )
    page.text(
        definition(card) + " material_card.csv and material_card.json contain the same values, in SI units;"
        " the files material_card_*.* have them for FE codes."
    )
    for warning in card_warnings(card, scene):
        page.warning(warning)
    if card.difference <= AGREEMENT:
        page.text(
            f"The stiffness is uncertain by {percent(card.difference)} of its largest entry: the larger of its changes with twice"
            " the strain step and with C21 in place of C12."
        )
    for warning in found.limit_of_curves:
        page.warning(warning)


def openings_section(page: Page, found: Findings, figure: Path) -> None:
    """Size of the openings over the wavelength."""
    page.heading("Openings and wavelength", new_page=True)
    page.table(
        [
            (name, str(len(those)), f"{1e6 * those[0].area:.3g} mm2", f"{1e3 * max(o.circle for o in those):.3g} mm",
             f"{1e3 * those[0].width:.3g} x {1e3 * those[0].height:.3g} mm")
            for name, those in found.openings.items()
        ],
        ("", "openings and slits per repeat", "largest area", "largest inscribed circle", "largest opening, weft x warp"),
    )  # fmt: skip
    if not found.openings:
        return
    state, those = [*found.openings.items()][-1]
    circle = max(o.circle for o in those)
    page.table(
        [
            (f"{name}, {1e-9 * frequency:g} GHz", f"{1e3 * length:.3g} mm", f"1/{length / circle:.3g}")
            for name, frequency in BANDS
            for length in [speed_of_light / frequency]
        ],
        ("band", "wavelength", f"circle {state} over wavelength"),
    )
    page.figure(figure, "Diameter of the largest inscribed circle over the wavelength.")
    limits = ", ".join(
        f"1/{part:g} of the wavelength up to {speed_of_light / (part * circle) * 1e-9:.3g} GHz" for part in FINE_ENOUGH
    )
    page.text(
        f"The diameter of the circle {state} is at most {limits}. The transmission of a mesh also depends on its"
        " contacts, which this ratio does not include."
    )


def electric_section(page: Page, scene: Scene, tensioned: Observables | None, figure: Path) -> None:
    """Contact and sheet resistance. tensioned: the mesh at the tension of the card."""
    page.heading("Electrical resistance")
    rows = [("wire", f"{engineering(wire_resistance(scene.wire), 'ohm/m')}")]
    if tensioned is not None:
        resistances, sheet = contact_resistances(tensioned), sheet_resistance(tensioned)
        contacts = "none" if not len(resistances) else f"{_pair(resistances.min(), resistances.max(), 'ohm', ' to ')}"
        rows.append(
            (f"each of the {len(resistances)} points of a repeat where wires touch, at hooks and between stitches", contacts)
        )
        shown = " / ".join("does not conduct" if value is None else engineering(value, "ohm") for value in sheet)
        rows.append(("sheet resistance, weft / warp", shown + " per square"))
    page.table(rows)
    page.figure(figure, "Sheet resistance with both directions strained together. No value: no conduction in that direction.")
    metal = surface(scene.wire)
    page.text(
        "These values are for direct current through a network of wires and contacts, without a transverse field. Each contact"
        f" is one circular spot (Holm). The surface has a resistivity of {1e9 * metal.resistivity:.3g} nOhm m and a hardness of"
        f" {1e-9 * metal.hardness:g} GPa (wire.hardness), at 20 degC. Oxide films are not included. In the spatial model wires"
        " also touch between stitches. Shares of active contacts do not count these contacts. The planar model has none."
    )


def reflection_section(page: Page, lines: Sequence[Finding], figures: Sequence[Path]) -> None:
    """Reflection loss of the states of the map; nothing without lines."""
    if not lines:
        return
    page.heading("Reflection loss")
    page.table([(line.name, line.text) for line in lines])
    for figure in figures:
        page.figure(figure, "Reflection loss over the loads of the map, of the worse polarisation.")
    page.text(
        "A plane wave meets endless mesh of thin wires with skin effect. Each contact has Holm's constriction resistance and the"
        " film of [reflection]. Open: no contact conducts. Closed: all contacts, and gaps below the radius, are perfect. Least"
        f" tension: from it up to the elastic limit, all losses of the map lie within {NEAR_BEST} dB. reflection.csv has all"
        " values."
    )


def _pair(first: float, second: float, unit: str, between: str = " / ") -> str:
    return between.join(alike([first, second], unit))
