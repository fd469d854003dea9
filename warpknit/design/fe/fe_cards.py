"""The table of FE codes, and the files for them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

from ...base.files import write_aside
from ...base.text import engineering
from ...runner.history import Row, mean_tension
from ...scene import Scene
from ..card import MaterialCard
from ..card_files import card_warnings, mesh_values
from . import abaqus, ansys, calculix, lsdyna, nastran, radioss
from .fe_card import FeCard
from .tangent import NoConstants
from .yarn_curves import APART, yarn_curves

CODES: dict[str, tuple[str, Callable[[FeCard], str]]] = {
    "nastran": ("material_card_nastran.bdf", nastran.text),
    "abaqus": ("material_card_abaqus.inp", abaqus.text),
    "calculix": ("material_card_calculix.inp", calculix.text),
    "ansys": ("material_card_ansys.inp", ansys.text),
    "lsdyna": ("material_card_lsdyna.k", lsdyna.text),
    "radioss": ("material_card_radioss.inc", radioss.text),
}
NONE = "none: "  # before the reason, in place of a file
FILES = tuple(file for file, _ in CODES.values())
WITH_CURVES = {"abaqus": "Abaqus", "lsdyna": "LS-DYNA", "radioss": "Radioss"}  # codes with FABRIC, and their names
ONLY_CURVES = "radioss"  # has no card without curves


def missing_cards(fe_cards: Mapping[str, str]) -> Iterator[str]:
    """Why an FE code has no card, a sentence each. fe_cards: what `write_fe_cards` returned."""
    for code, result in fe_cards.items():
        if result not in FILES:
            yield f"no card for {code}: {result.removeprefix(NONE)}"


def why_no_curves(card: MaterialCard, path: Sequence[Row]) -> str:
    """Why the files have no curves; empty where they have. path: as for `write_fe_cards`."""
    try:
        yarn_curves(card, path)
    except NoConstants as error:
        return str(error)
    return ""


def limit_of_curves(card: MaterialCard, path: Sequence[Row], codes: Sequence[str], *, at_jump: bool) -> str | None:
    """That the files for these codes have no curves, or where their curves end; None where they go on beyond the card.

    path: as for `write_fe_cards`. at_jump: whether it ends at a jump.
    """
    why = why_no_curves(card, path)
    names = [name for code, name in WITH_CURVES.items() if code in codes and not (why and code == ONLY_CURVES)]
    if not names:
        return f"no card for {ONLY_CURVES}: {why}" if why and ONLY_CURVES in codes else None
    files = f"the files for {' and '.join([', '.join(names[:-1]), names[-1]] if names[1:] else names)}"
    if why:
        return f"{files} have no tension-strain curves (FABRIC): {why}"
    at_card = 0.5 * (card.tension_weft + card.tension_warp)
    end = max(at_card, mean_tension(path[-1]))
    if end > (1.0 + APART) * at_card and not at_jump:
        return None
    reason = "the mesh jumps to another equilibrium beyond" if at_jump else "the relaxation did not converge beyond the card"
    tension = f"{engineering(end, 'N/m')}, mean of weft and warp"
    return f"the tension-strain curves (FABRIC) of {files} end at {tension}: {reason}"


def write_fe_cards(
    card: MaterialCard,
    path: Sequence[Row],
    scene: Scene,
    where: str,
    out: Path,
    *,
    codes: Sequence[str] = tuple(CODES),
    warnings: Sequence[str] = (),
) -> dict[str, str]:
    """Write the file of each of `codes` into `out`; return its name, or why there is none.

    path: states on the way to the card, and beyond, up to the first jump. where: state of the card, in words.
    warnings: of the model.
    """
    no_curves = why_no_curves(card, path)
    curves = None if no_curves else yarn_curves(card, path)
    all_warnings = [*warnings, *card_warnings(card, scene)]
    fe = FeCard(scene.name, where, card, curves, no_curves, all_warnings, mesh_values(scene))
    written = {}
    for code in codes:
        name, text = CODES[code]
        try:
            content = text(fe)
        except NoConstants as error:
            written[code] = f"{NONE}{error}"
            continue
        with write_aside(out / name) as file:
            file.write(content)
        written[code] = name
    return written
