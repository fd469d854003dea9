"""Curves for the laws of woven fabrics, in which either direction has a tension of its own strain alone.

A mesh is no such fabric: its tensions depend on both strains. The curves hold on one path, from the mesh as knitted in proportion
to the strains of the card. There they give both tensions, at the card its prestress.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..card import MaterialCard
from ..curves import CurvePoint
from .tangent import NoConstants


@dataclass(frozen=True)
class YarnCurve:
    """Tension along one direction, rising; the first point is the mesh as knitted, without tension."""

    stretch: np.ndarray  # (point,) over the length as knitted
    nominal: np.ndarray  # (point,) [N/m] force over the width as knitted

    @property
    def slope(self) -> float:
        """[N/m] largest of the curve."""
        return float((np.diff(self.nominal) / np.diff(self.stretch)).max())


def yarn_curves(card: MaterialCard, path: Sequence[CurvePoint]) -> tuple[YarnCurve, YarnCurve]:
    """Curves along weft and warp. path: states on the way to the strains of the card, and beyond.

    Raises `NoConstants` where a direction is not stretched or carries no tension, or the mesh resists no shear.
    """
    if min(card.strain_weft, card.strain_warp, card.tension_weft, card.tension_warp) <= 0.0:
        raise NoConstants("the mesh is not stretched and tensioned both ways")
    if card.stiffness[2, 2] <= 0.0:
        raise NoConstants("its shear stiffness is not positive")
    rows = [(0.0, 0.0, 0.0, 0.0), (card.strain_weft, card.strain_warp, card.tension_weft, card.tension_warp)]
    for p in path:
        if p.tension_weft_N_per_m is not None and p.tension_warp_N_per_m is not None:
            rows.append((p.strain_weft, p.strain_warp, p.tension_weft_N_per_m, p.tension_warp_N_per_m))
    strain_weft, strain_warp, weft, warp = np.array(sorted(rows)).T
    return (
        _rising(1.0 + strain_weft, weft * (1.0 + strain_warp), 1.0 + card.strain_weft),
        _rising(1.0 + strain_warp, warp * (1.0 + strain_weft), 1.0 + card.strain_warp),
    )


def _rising(stretch: np.ndarray, nominal: np.ndarray, kept: float) -> YarnCurve:
    """The curve without the points that would make it fall; the one at the stretch `kept` stays."""
    at = int(np.flatnonzero(stretch == kept)[0])
    points = [at]
    for i in range(at - 1, 0, -1):
        if 0.0 < nominal[i] < nominal[points[0]]:
            points.insert(0, i)
    for i in range(at + 1, len(stretch)):
        if nominal[i] > nominal[points[-1]]:
            points.append(i)
    return YarnCurve(stretch[[0, *points]], nominal[[0, *points]])
