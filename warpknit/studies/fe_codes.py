"""Material cards as input of FE codes: blocks to include in a model.

Each file states its units, the prestress, the stress and strain of its constants, and what it leaves out (docs/fe_cards.md).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np

from ..base.files import write_aside
from ..base.text import engineering
from ..results.finding import ResultWarning
from ..results.row import Row
from ..runner.history import mean_tension
from ..scene import Scene
from .card import MaterialCard
from .card_files import card_warnings, mesh_values
from .fe_card import (
    APART,
    ENGINEERING,
    FABRIC,
    GREEN,
    LINEAR,
    LOGARITHMIC,
    THICKNESS,
    TRUE,
    FeCard,
    NoConstants,
    Orthotropic,
    YarnCurve,
    density,
    expansion,
    fabric_note,
    heading,
    megapascal,
    number,
    orthotropic,
    tangent,
    yarn_curves,
)

Card: TypeAlias = tuple[list[str], list[str]]  # notes, paragraphs of the heading; lines behind it
MAT2 = {1: GREEN, 2: ENGINEERING}  # measure of each material and property
MAT8 = {11: GREEN, 12: ENGINEERING}
STATEMENT = {
    GREEN: "for a differential stiffness with all gradients of the displacement",
    ENGINEERING: "for a differential stiffness with rotations only, and for large rotations with small strains (SOL 106)",
}


def _nastran(fe: FeCard) -> Card:
    """Nastran: MAT2 and MAT8 with a PSHELL without bending, in fields of 16 columns.

    A card without a MAT8 states this. Solvers differ: a differential stiffness has either the stretches of an element or only its
    rotations. Each needs its own tangent, so there are two pairs.
    """
    card, notes, lines = fe.card, [], []
    rho, temperature = density(card.areal_mass), card.temperature
    for serial, measure in MAT2.items():
        notes.append(f"MAT2 {serial}, {STATEMENT[measure]}: {measure.text}.")
        c = megapascal(1.0) * tangent(card, measure)
        alpha = expansion(card, measure)
        lines += _entry("MAT2", serial, *c[0], *c[1, 1:], c[2, 2], rho, *alpha, temperature)
        lines += _shell(serial)
    for serial, measure in MAT8.items():
        try:
            o = orthotropic(card, measure)
        except NoConstants as error:
            notes.append(f"MAT8 {serial}: none, {error}.")
            continue
        nu12, shear = o.poissons_ratio[0], o.shear_modulus
        notes.append(f"MAT8 {serial}: as MAT2 {serial - 10}, without coupling of shear and extension.")
        lines += _entry("MAT8", serial, *o.modulus, nu12, shear, None, None, rho, *o.expansion, temperature)
        lines += _shell(serial)
    notes.append(
        "Apply the prestress by a preload (edge forces or SPCD): there is no entry for it. Include this file in the bulk data."
    )
    return notes, lines


def _entry(name: str, number: int, *values: float | np.floating | None) -> list[str]:
    """An entry of four fields of 16 columns a line."""
    fields = [f"{number:16d}", *(" " * 16 if value is None else f"{value:16.9E}" for value in values)]
    rows = ["".join(fields[i : i + 4]).rstrip() for i in range(0, len(fields), 4)]
    return [f"{name + '*':8}{rows[0]}", *(f"{'*':8}{row}" for row in rows[1:])]


def _shell(number: int) -> list[str]:
    """A property without bending (MID2 blank)."""
    return [f"{'PSHELL':8}{number:8d}{number:8d}{1e3 * THICKNESS:8.4f}"]


def _abaqus(fe: FeCard) -> Card:
    """Abaqus: *ELASTIC, TYPE=LAMINA for membranes, and *FABRIC with curves for Abaqus/Explicit. Raises `NoConstants`."""
    o = orthotropic(fe.card, LOGARITHMIC)
    notes = [
        f"{LINEAR}, for M3D elements with NLGEOM: {LOGARITHMIC.text}.",
        f"G13 and G23 of {LINEAR} are not used by a membrane. Coupling of shear and extension is not carried.",
        fabric_note(fe, "for Abaqus/Explicit, nominal stress over nominal strain", "*INITIAL CONDITIONS, TYPE=REF COORDINATE"),
        "To be used with, for elements and an orientation of the model:",
    ]
    elastic = ["*ELASTIC, TYPE=LAMINA", _listed(*o.modulus, o.poissons_ratio[0], *3 * [o.shear_modulus])]
    lines = _input_lines(fe, o, elastic, section=", POISSON=0.5", zeros=", 0.")
    if not isinstance(fe.curves, str):
        lines += [f"*MATERIAL, NAME={FABRIC}", "*DENSITY", number(density(fe.areal_mass_knitted)), "*FABRIC"]
        for component, curve in zip("12", fe.curves, strict=True):
            lines += [f"*UNIAXIAL, COMPONENT={component}", "*LOADING DATA, DIRECTION=TENSION, TYPE=ELASTIC, EXTRAPOLATION=LINEAR"]
            strain, stress = curve.stretch - 1.0, megapascal(1.0) * curve.nominal
            lines += [_listed(y, x) for x, y in zip(strain, stress, strict=True)]
        shear = megapascal(fe.card.stiffness[2, 2] * fe.area_ratio)  # conjugate to the shear angle, in the volume as knitted
        lines += [
            "*UNIAXIAL, COMPONENT=SHEAR",
            "*LOADING DATA, TYPE=ELASTIC, EXTRAPOLATION=LINEAR",
            "0., 0.",
            f"{number(shear)}, 1.",
        ]
    return notes, lines


def _calculix(fe: FeCard) -> Card:
    """CalculiX: *ELASTIC, TYPE=ENGINEERING CONSTANTS for M3D elements, solids in plane stress. Raises `NoConstants`."""
    o = orthotropic(fe.card, GREEN)
    (e1, e2), shear = o.modulus, o.shear_modulus
    notes = [
        f"{LINEAR}, for M3D elements with NLGEOM: {GREEN.text}.",
        f"E3, nu13, nu23, G13 and G23 of {LINEAR} keep the thickness out of it. Coupling of shear and extension is not carried.",
        "To be used with, for elements and an orientation of the model (stress: a line for each element and integration point):",
    ]
    constants = _listed(e1, e2, e1, o.poissons_ratio[0], 0.0, 0.0, shear, shear)
    elastic = ["*ELASTIC, TYPE=ENGINEERING CONSTANTS", f"{constants},", number(shear)]
    return notes, _input_lines(fe, o, elastic, zeros=", 0., 0., 0., 0.", expansion=f", ZERO={number(fe.card.temperature)}")


def _input_lines(
    fe: FeCard, o: Orthotropic, elastic: Sequence[str], *, zeros: str, section: str = "", expansion: str = ""
) -> list[str]:
    """The linear material of Abaqus and CalculiX. Both count thermal strain from the initial temperature."""
    s1, s2 = fe.prestress
    return [
        f"** *MEMBRANE SECTION, ELSET=..., MATERIAL={LINEAR}, ORIENTATION=...{section}",
        f"** {1e3 * THICKNESS:g}",
        "** *INITIAL CONDITIONS, TYPE=STRESS",
        f"** ..., {number(s1)}, {number(s2)}{zeros}",
        "** *INITIAL CONDITIONS, TYPE=TEMPERATURE",
        f"** ..., {number(fe.card.temperature)}",
        f"*MATERIAL, NAME={LINEAR}",
        "*DENSITY",
        number(density(fe.card.areal_mass)),
        *elastic,
        f"*EXPANSION, TYPE=ORTHO{expansion}",
        _listed(*o.expansion, 0.0),
    ]


def _listed(*values: float) -> str:
    return ", ".join(map(number, values))


def _ansys(fe: FeCard) -> Card:
    """ANSYS Mechanical APDL: MP constants with SHELL181 as a membrane.

    Raises `NoConstants`. SHELL181 takes true stress and logarithmic strain, and updates its thickness. PRXZ = 1 - PRXY and PRYZ =
    1 - PRXY EY/EX keep the volume constant, so that the thickness follows the area. EZ keeps the material stable.
    """
    o, (s1, s2) = orthotropic(fe.card, LOGARITHMIC), fe.prestress
    (ex, ey), (nu12, nu21), shear = o.modulus, o.poissons_ratio, o.shear_modulus
    constants = {
        "DENS": density(fe.card.areal_mass),
        "EX": ex, "EY": ey, "EZ": 0.5 / ((1.0 - nu12) / ex + (1.0 - nu21) / ey),
        "PRXY": nu12, "PRXZ": 1.0 - nu12, "PRYZ": 1.0 - nu21,
        "GXY": shear, "GXZ": shear, "GYZ": shear,
        "REFT": fe.card.temperature, "ALPX": o.expansion[0], "ALPY": o.expansion[1], "ALPZ": 0.0,
    }  # fmt: skip
    notes = [
        f"Material 1, for SHELL181 as a membrane with NLGEOM,ON: {LOGARITHMIC.text}.",
        "EZ, PRXZ and PRYZ only rule the thickness; GXZ and GYZ are not used. Coupling of shear and extension is not carried.",
        "The x axis of the element coordinate system is weft. Prestress, for the elements selected, before SOLVE:",
    ]
    use = ["! INISTATE,SET,DTYP,STRE", f"! INISTATE,DEFINE,,,,,{number(s1)},{number(s2)},0,0,0,0"]
    lines = [f"MP,{name},1,{number(value)}" for name, value in constants.items()]
    lines += ["ET,1,SHELL181", "KEYOPT,1,1,1", "SECTYPE,1,SHELL", f"SECDATA,{1e3 * THICKNESS:g},1"]
    return notes, [*use, *lines]


COLUMN = 10


def _lsdyna(fe: FeCard) -> Card:
    """LS-DYNA: *MAT_FABRIC (034), linear (FORM 0) and with curves (FORM 14), in fields of 10 columns. Raises `NoConstants`."""
    card, o = fe.card, orthotropic(fe.card, TRUE)
    built = np.exp(-np.linalg.solve(tangent(card, TRUE)[:2, :2], [card.tension_weft, card.tension_warp]))
    notes = [
        f"{LINEAR} (1), FORM 0 with ISTUPD = 0: {TRUE.text}.",
        f"{LINEAR} is exact for equal tensions. Else C12 of the true stress differs between weft and warp by the difference of"
        " the tensions, and the mean is written. Coupling of shear and extension is not carried.",
        f"Prestress of {LINEAR} by a preload: build the elements with their size times {number(built[0])} along a and"
        f" {number(built[1])} along b, with RO = {number(density(card.areal_mass) / built.prod())}, and stretch them to size."
        " *INITIAL_STRESS_SHELL may have no effect on *MAT_FABRIC: check it before you use it instead.",
        f"Expansion of {LINEAR} by *MAT_ADD_THERMAL_EXPANSION: {number(o.expansion[0])} and {number(o.expansion[1])} 1/K along a"
        f" and b, from {number(card.temperature)} K.",
        fabric_note(fe, "(2), FORM 14, second Piola-Kirchhoff stress over Green-Lagrange strain", "*AIRBAG_REFERENCE_GEOMETRY"),
        "The a axis of the materials is the global x (AOPT = 2).",
    ]
    lines = ["*KEYWORD", "*SECTION_SHELL", _columns(1, 5), _columns(*4 * [1e3 * THICKNESS])]
    nu12, nu21 = o.poissons_ratio
    lines += _fabric(1, LINEAR, density(card.areal_mass), o.modulus, (nu21, nu12), o.shear_modulus, form=0)
    if not isinstance(fe.curves, str):
        slopes = megapascal(fe.curves[0].slope), megapascal(fe.curves[1].slope)
        shear = megapascal(card.stiffness[2, 2] / fe.area_ratio)  # of the same measure, over the mesh as knitted
        lines += [*_fabric(2, FABRIC, density(fe.areal_mass_knitted), slopes, (0.0, 0.0), shear, form=14), _columns(1, 2)]
        for identity, curve in enumerate(fe.curves, start=1):
            strain, stress = 0.5 * (curve.stretch**2 - 1.0), megapascal(1.0) * curve.nominal / curve.stretch
            lines += ["*DEFINE_CURVE", _columns(identity), *map(_reals, strain, stress)]
    return notes, [*lines, "*END"]


def _fabric(
    identity: int,
    title: str,
    rho: float,
    modulus: tuple[float, float],
    poissons_ratio: tuple[float, float],
    shear: float,
    form: int,
) -> list[str]:
    """*MAT_FABRIC without its curves; poissons_ratio: of a by stress along b, and of b by stress along a."""
    return [
        "*MAT_FABRIC_TITLE",
        title,
        _columns(identity, rho, *modulus, None, *poissons_ratio),
        _columns(shear, None, None, 0.0),
        _columns(2.0, None, None, None, None, form),
        _columns(None, None, None, 1.0, 0.0, 0.0),
        _columns(0.0, 0.0, 0.0),
    ]


def _columns(*values: float | None) -> str:
    """A line of fields of ten columns."""
    return "".join(" " * COLUMN if value is None else f"{_field(value):>{COLUMN}}" for value in values).rstrip()


def _field(value: float) -> str:
    """`value` with all the digits that ten columns hold."""
    if isinstance(value, int):
        return str(value)
    texts = [f"{value:.{digits}E}".replace("E-0", "E-").replace("E+0", "E+") for digits in range(8, 0, -1)]
    return next(text for text in (str(value), *texts) if len(text) <= COLUMN)


CRIMP = 1e-6  # straightening strain of a yarn; blank is 0.1, which would shift the curves
COMPRESSION = 0.01  # stiffness of a yarn in compression over that in tension


def _radioss(fe: FeCard) -> Card:
    """Radioss: /MAT/LAW58 (FABR_A) with curves of weft and warp, in fields of 10 and 20 columns. Raises `NoConstants`."""
    if isinstance(fe.curves, str):
        raise NoConstants(fe.curves)
    shear = megapascal(fe.card.stiffness[2, 2])
    notes = [
        fabric_note(fe, "nominal stress over nominal strain", "/XREF or /REFSTA"),
        "Direction 1 of the law, which Radioss calls warp, is axis 1, the weft of the mesh. Set the direction, one layer and the"
        " thickness in /PROP/TYPE16 with Ithick = 0 (constant).",
    ]
    weft, warp = (megapascal(curve.slope) for curve in fe.curves)
    lines = [
        "/UNIT/1",
        "units of warpknit",
        f"{'Mg':>20}{'mm':>20}{'s':>20}",
        "/MAT/LAW58/1/1",
        FABRIC,
        "#              RHO_I",
        _reals(density(fe.areal_mass_knitted)),
        "#                 E1                  B1                  E2                  B2                FLEX",
        _reals(weft, 0.0, warp, 0.0, COMPRESSION),
        "#                 G0                  GT              ALPHAT                 GSH             SENS_ID",
        _reals(shear, shear, 0.0, 0.0),
        "#                 DF                  DS               GFROT                              ZEROSTRESS",
        _reals(0.0, 0.0, 0.0) + " " * 20 + _reals(0.0),
        "#       N1        N2                  S1                  S2               FLEX1               FLEX2",
        f"{1:10d}{1:10d}" + _reals(CRIMP, CRIMP, COMPRESSION, COMPRESSION),
        "#  FCT_ID1                       FSCALE1",
        f"{1:10d}{'':10}" + _reals(1.0),
        "#  FCT_ID2                       FSCALE2",
        f"{2:10d}{'':10}" + _reals(1.0),
    ]
    for identity, curve in enumerate(fe.curves, start=1):
        points = map(_reals, curve.stretch - 1.0, megapascal(1.0) * curve.nominal)
        lines += [f"/FUNCT/{identity}", f"tension along direction {identity}", *points]
    return notes, lines


def _reals(*values: float) -> str:
    return "".join(f"{value:20.12E}" for value in values)


@dataclass(frozen=True)
class Code:
    """An FE code: its name, the file of its card, the mark of its comments, and the card."""

    name: str
    file: str
    mark: str
    card: Callable[[FeCard], Card]


CODES = {
    "nastran": Code("Nastran", "material_card_nastran.bdf", "$", _nastran),
    "abaqus": Code("Abaqus", "material_card_abaqus.inp", "**", _abaqus),
    "calculix": Code("CalculiX", "material_card_calculix.inp", "**", _calculix),
    "ansys": Code("ANSYS Mechanical APDL", "material_card_ansys.inp", "!", _ansys),
    "lsdyna": Code("LS-DYNA", "material_card_lsdyna.k", "$", _lsdyna),
    "radioss": Code("Radioss", "material_card_radioss.inc", "#", _radioss),
}
NONE = "none: "  # before the reason, in place of a file
FILES = tuple(code.file for code in CODES.values())
WITH_CURVES = {"abaqus", "lsdyna", "radioss"}  # codes with FABRIC; Radioss has no card without its curves


def missing_cards(fe_cards: Mapping[str, str]) -> Iterator[str]:
    """Sentences on FE codes without a card. fe_cards: result of `write_fe_cards`."""
    for code, result in fe_cards.items():
        if result not in FILES:
            yield f"no card for {code}: {result.removeprefix(NONE)}"


def curves_of(card: MaterialCard, path: Sequence[Row]) -> tuple[YarnCurve, YarnCurve] | str:
    """Tension-strain curves of files; or the reason why there are none. path: as for `write_fe_cards`."""
    try:
        return yarn_curves(card, path)
    except NoConstants as error:
        return str(error)


def limit_of_curves(card: MaterialCard, path: Sequence[Row], codes: Sequence[str], *, at_jump: bool) -> Iterator[ResultWarning]:
    """Warning that cards have no curves, or where their curves end; none beyond the card.

    path: as for `write_fe_cards`. at_jump: whether it ends at a jump.
    """
    if not WITH_CURVES & set(codes):
        return
    curves, at_card = curves_of(card, path), 0.5 * (card.tension_weft + card.tension_warp)
    if isinstance(curves, str):
        yield ResultWarning("W57", f"The FE cards have no tension-strain curves (FABRIC): {curves}.")
        return
    end = max(at_card, mean_tension(path[-1]))
    if end <= (1.0 + APART) * at_card or at_jump:
        reason = "snap-through to another equilibrium beyond" if at_jump else "the relaxation did not converge beyond the card"
        tension = f"{engineering(end, 'N/m')}, mean of weft and warp"
        yield ResultWarning("W57", f"The tension-strain curves (FABRIC) of the FE cards end at {tension}: {reason}.")


def write_fe_cards(
    card: MaterialCard,
    path: Sequence[Row],
    scene: Scene,
    where: str,
    out: Path,
    *,
    codes: Sequence[str] = tuple(CODES),
    warnings: Sequence[ResultWarning] = (),
) -> dict[str, str]:
    """Write the file of each of `codes` into `out`; return its name, or why there is none.

    path: states on the way to the card, and beyond, up to the first jump. where: state of the card, in words.
    warnings: of the model.
    """
    all_warnings = [*warnings, *card_warnings(card, scene)]
    fe = FeCard(scene.name, where, card, curves_of(card, path), all_warnings, mesh_values(scene))
    written = {}
    for name in codes:
        code = CODES[name]
        try:
            notes, lines = code.card(fe)
        except NoConstants as error:
            written[name] = f"{NONE}{error}"
            continue
        with write_aside(out / code.file) as file:
            file.write("\n".join([*heading(fe, code.name, code.mark, notes), *lines, ""]))
        written[name] = code.file
    return written
