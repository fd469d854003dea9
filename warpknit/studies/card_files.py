"""material_card.csv and material_card.json: the card as input for an FE model."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.constants import inch

from ..base.files import write_table
from ..base.text import engineering, exact, percent
from ..results.finding import ResultWarning
from ..results.row import Row, write_json
from ..runner.answers_table import ahead_texts
from ..runner.branches import Event, Jump, state_of
from ..runner.history import mean_tension
from ..runner.strength import assumed_text, exceeded_text
from ..runner.variants import Spread
from ..scene import Scene
from .card import AGREEMENT, CYCLE, HEATED, LEAST_STEP, MaterialCard, tension_slope_of

CARD = "material_card.json"
AXES = {"1": "weft (x)", "2": "warp (y)", "3": "shear, engineering shear strain 2 E12"}
DEFINITION = (
    "Tangent of the tensioned mesh: S = prestress + C (E - alpha (T - T0)), with C = dS/dE. S is the second Piola-Kirchhoff"
    " stress (force per width), E the Green-Lagrange strain. Both refer to the tensioned mesh, where they equal true tension and"
    " small strain. Apply the tension to the FE model as prestress: C, E1, E2, nu12 and nu21 exclude its geometric stiffness."
    " D11 to D22 include it. A test machine measures them: it strains the tensioned mesh in one direction and holds the other."
)
OF_HISTORY = (
    f" With friction or yield, C, D and the constants from them hold for small cycles of {percent(CYCLE, 2)} of strain, after"
    " unloading by twice this strain. loading_C and loading_D hold for further loading; rows are stresses, columns strains."
    f" alpha is measured by heating by {HEATED:g} K at constant S, cooling_alpha by cooling back."
)


def card_values(card: MaterialCard) -> Iterator[tuple[str, float, str, str]]:
    """Name, value, unit and meaning of each number."""
    c = card.stiffness
    yield "C11", float(c[0, 0]), "N/m", "stiffness in weft, warp held"
    yield "C12", float(c[0, 1]), "N/m", "coupling stiffness of weft and warp"
    yield "C22", float(c[1, 1]), "N/m", "stiffness in warp, weft held"
    yield "C33", float(c[2, 2]), "N/m", "shear stiffness"
    if card.is_stable:  # else the inverse has no physical meaning
        for axis, value, side in zip("12", card.moduli, ("weft", "warp"), strict=True):
            yield f"E{axis}", value, "N/m", f"modulus in {side} at constant transverse S"
        nu12, nu21 = card.poissons_ratios
        yield "nu12", nu12, "1", "contraction in warp over extension in weft, S in warp constant"
        yield "nu21", nu21, "1", "contraction in weft over extension in warp, S in weft constant"
    for (row, column), value in np.ndenumerate(card.tension_slope):
        by, of = ("weft", "warp")[column], ("weft", "warp")[row]
        yield f"D{row + 1}{column + 1}", float(value), "N/m", f"change of tension in {of} with strain in {by}"
    if card.is_stable:
        for axis, value, side in zip("12", card.expansion[:2].tolist(), ("weft", "warp"), strict=True):
            yield f"alpha{axis}", value, "1/K", f"thermal expansion in {side} at constant S"
    yield from _history_values(card)
    yield "areal_mass", card.areal_mass, "kg/m^2", "mass per area of the tensioned mesh"
    for axis, value, side in zip("12", (card.tension_weft, card.tension_warp), ("weft", "warp"), strict=True):
        yield f"prestress{axis}", value, "N/m", f"tension in {side}, force per current width"
    for axis, value, side in zip("12", (card.strain_weft, card.strain_warp), ("weft", "warp"), strict=True):
        yield f"prestrain{axis}", value, "1", f"strain in {side} relative to the mesh as knitted"
    yield "temperature", card.temperature, "K", "temperature of the mesh"
    yield "stress_max", card.stress_max, "Pa", "largest stress in the wire"
    yield "active", 0.01 * card.active_percent, "1", "fraction of active contacts"
    yield "stable", float(card.is_stable), "1", "whether the stiffness is positive definite (see the warnings)"
    yield ("difference", card.difference, "1", "error estimate of the stiffness, over the largest entry; unreliable above 5 %")


def _history_values(card: MaterialCard) -> Iterator[tuple[str, float, str, str]]:
    """Values of a mesh with friction or yield beside those for small cycles."""
    history = card.history
    if history is None:
        return
    sides = ("weft", "warp", "shear")
    for (row, column), value in np.ndenumerate(history.loading):
        if (row < 2 and column < 2) or row == column:
            yield f"loading_C{row + 1}{column + 1}", float(value), "N/m", f"loading: S in {sides[row]} with E in {sides[column]}"
    for (row, column), value in np.ndenumerate(tension_slope_of(history.loading, card.tension)):
        meaning = f"loading: change of tension in {sides[row]} with strain in {sides[column]}"
        yield f"loading_D{row + 1}{column + 1}", float(value), "N/m", meaning
    for axis, value, side in zip("12", history.cooling[:2].tolist(), sides[:2], strict=True):
        yield f"cooling_alpha{axis}", value, "1/K", f"thermal contraction in {side} at constant S, after heating by {HEATED:g} K"
    yield "loading_difference", history.difference, "1", "error estimate of loading_C, over the largest entry"


def definition(card: MaterialCard) -> str:
    """Definition of the values of a card, in words."""
    return DEFINITION + ("" if card.history is None else OF_HISTORY)


def card_warnings(card: MaterialCard, scene: Scene) -> Iterator[ResultWarning]:
    """Limits to the use of the card."""
    if not card.is_stable:
        yield _unstable(card)
    if card.history is not None and card.difference > AGREEMENT:
        size, change = percent(2.0 * card.difference_step, 2), percent(card.difference, 0)
        text = (
            f"The stiffness of the material card depends on the size of a load cycle. It changes by {change} for {size} strain."
        )
        yield ResultWarning("W52", text, "For larger changes of load use the card in loading/.")
    elif card.difference > AGREEMENT:
        yield ResultWarning(
            "W52",
            f"Stiffness and expansion of the material card are uncertain by {percent(card.difference, 0)} of the largest"
            f" stiffness, down to a strain step of {percent(LEAST_STEP, 3)}.",
        )
    if card.jumps:
        yield ResultWarning("W53", f"On the way to the state of the material card {card.jumps}.")
    if card.branch:
        yield ResultWarning("W54", card.branch)
    if card.shear_coupling > AGREEMENT:
        coupling = f"{percent(card.shear_coupling, 0)} of the largest stiffness"
        yield ResultWarning("W55", f"Shear and extension are coupled ({coupling}).")
    if beyond := exceeded_text(scene, card.stress_max):
        stress = engineering(card.stress_max, "Pa")
        yield ResultWarning("W56", f"At the tension of the card the largest wire stress is {stress}, {beyond}.")


def ahead_of_card(card: MaterialCard, first_yield: Event | None, jumps: Sequence[Jump]) -> str:
    """Distance of its tension from first yield and the next jump in words. Both are under rising equal tensions."""
    here = Row(
        tension_weft_N_per_m=card.tension_weft, tension_warp_N_per_m=card.tension_warp, temperature_K=card.temperature
    )  # fmt: skip
    following = next((jump for jump in jumps if mean_tension(jump[1]) > mean_tension(here)), None)
    sides = None if following is None else [state_of(row) for row in following]
    return "; ".join(ahead_texts(here, first_yield, sides))


def _unstable(card: MaterialCard) -> ResultWarning:
    """Warning for an unstable card: the unstable direction, and what to do."""
    row = card.softest
    value = f"C{row + 1}{row + 1} = {engineering(float(card.stiffness[row, row]), 'N/m')}"
    text = f"The material card is unstable in {AXES[str(row + 1)]}, {value}"
    least = card.least_wave_stiffness
    if least > 0.0:
        return ResultWarning(
            "W50",
            f"{text}; with its prestress the mesh is stable ({engineering(least, 'N/m')} against the softest plane wave).",
            "Apply the prestress with its geometric stiffness first in the FE model, or choose a larger --tension.",
        )
    return ResultWarning("W50", f"{text}, also with its prestress.")


def strength_values(card: MaterialCard, scene: Scene) -> Iterator[tuple[str, float, str, str]]:
    """Rows of the limits of the wire, and of the stress over each."""
    wire = scene.wire
    for name, limit, what in (
        ("yield_stress", wire.yield_stress, "elastic limit"),
        ("tensile_strength", wire.tensile_strength, "tensile strength"),
    ):
        yield name, limit, "Pa", f"{what} of the wire{assumed_text(scene, f'wire.{name}')}"
    yield "stress_over_yield", card.stress_max / wire.yield_stress, "1", "largest stress over the elastic limit"
    yield "stress_over_strength", card.stress_max / wire.tensile_strength, "1", "largest stress over the tensile strength"


def mesh_values(scene: Scene) -> dict[str, str]:
    """Wire, knit and preset of a scene, in words."""
    wire, knit = scene.wire, scene.knit
    plating = "" if wire.plating is None else f", plated with {1e6 * wire.plating.thickness:g} um of {wire.plating.material}"
    ends = "" if wire.ends == 1 else f"{wire.ends} x "
    bars = " and ".join(
        f"{bar.chain} threaded {bar.threading}" + (f" shifted by {bar.shift}" if bar.shift else "") for bar in knit.bars
    )
    gauge = f"{inch / knit.wale_spacing:.4g} wales and {inch / knit.course_spacing:.4g} courses an inch"
    nodes = f"{scene.model.nodes_per_loop} nodes a loop"
    return {
        "wire": f"{wire.material}, {ends}{exact(wire.diameter, 'm')}{plating}",
        "knit": f"{bars}, {gauge}",
        "preset": f"{scene.preset_in_force}, {nodes}" if scene.preset_in_force else f"none, {nodes}",
    }


def validity(scene: Scene, model_warnings: Sequence[ResultWarning]) -> tuple[str, float, str, str]:
    """Row on the validity of the model, with warnings, kind and mesh."""
    said = "; ".join(map(str, model_warnings)) or "1 if the model is valid for the knit, else 0"
    mesh = "; ".join([*(f"{name}: {text}" for name, text in mesh_values(scene).items()), *filter(None, [scene.preset_caveat])])
    return "model_valid", float(not model_warnings), "1", f"{said}; model: {scene.model.kind} ({scene.kind_reason}); {mesh}"


def earlier_state(out: Path) -> str | None:
    """The state in words of the material card in a directory; None without one that can be read."""
    try:
        return str(json.loads((out / CARD).read_text(encoding="utf-8"))["state"])
    except (OSError, ValueError, LookupError, TypeError):
        return None


def write_card(
    card: MaterialCard,
    scene: Scene,
    where: str,
    out: Path,
    model_warnings: Sequence[ResultWarning] = (),
    fe_cards: Mapping[str, str] | None = None,
    spread: Mapping[str, Spread] | None = None,
    frictions: Mapping[str, Mapping[str, float]] | None = None,
    meshes: int = 1,
) -> None:
    """Write both files into `out`; where: the state of the card, in words; model_warnings: of its map.

    fe_cards: the file for each FE code, or why there is none.
    spread: of the values over the cards of several `meshes`, by name; frictions: of each value its means with other frictions.
    """
    rows = [validity(scene, model_warnings), *card_values(card), *strength_values(card, scene)]
    columns = zip(("name", "value", "unit", "meaning"), zip(*rows, strict=True), strict=True)
    write_table(out / "material_card.csv", {heading: np.array(column, dtype=object) for heading, column in columns})
    warnings = list(card_warnings(card, scene))
    content = {
        "mesh": scene.name,
        **mesh_values(scene),
        "warnings": [*model_warnings, *warnings],
        "model": {"kind": scene.model.kind, "kind_reason": scene.kind_reason},
        "state": where,
        "margin": card.ahead,
        "temperature_K": card.temperature,
        "axes": AXES,
        "definition": definition(card),
        "meshes": meshes,
        "spread": spread or {},
        "frictions": frictions or {},
        "values": {name: value for name, value, _, _ in rows},
        "units": {name: unit for name, _, unit, _ in rows},
        "meaning": {name: meaning for name, _, _, meaning in rows},
        "quality": {
            "warnings": warnings,
            "positive_definite": card.is_stable,
            "asymmetry_of_largest": card.asymmetry,
            "step_difference_of_largest": card.step_difference,
            "difference_step": card.difference_step,
            "shear_coupling_of_largest": card.shear_coupling,
        },
        "fe_cards": dict(fe_cards or {}),
    }
    write_json(out / CARD, content)
