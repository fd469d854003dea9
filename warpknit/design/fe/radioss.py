"""Radioss: /MAT/LAW58 (FABR_A) with curves of weft and warp, in fields of 10 and 20 columns."""

from __future__ import annotations

from .fe_card import FABRIC, FeCard, fabric_note, heading
from .tangent import NoConstants, density, megapascal
from .yarn_curves import YarnCurve

CRIMP = 1e-6  # straightening strain of a yarn; blank is 0.1, which would shift the curves
COMPRESSION = 0.01  # stiffness of a yarn in compression over that in tension


def text(fe: FeCard) -> str:
    """Starter blocks to include in a model. Raises `NoConstants`."""
    if fe.curves is None:
        raise NoConstants(fe.no_curves)
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
        lines += _curve(identity, curve)
    return "\n".join([*heading(fe, "Radioss", "#", notes), *lines, ""])


def _curve(identity: int, curve: YarnCurve) -> list[str]:
    """/FUNCT of nominal stress over nominal strain."""
    points = [_reals(x - 1.0, megapascal(y)) for x, y in zip(curve.stretch, curve.nominal, strict=True)]
    return [f"/FUNCT/{identity}", f"tension along direction {identity}", *points]


def _reals(*values: float) -> str:
    return "".join(f"{value:20.12E}" for value in values)
