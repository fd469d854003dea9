"""Curves for the laws of woven fabrics, in which either direction has a tension of its own strain alone.

A mesh is no such fabric: its tensions depend on both strains. The curves hold on one path, that from the mesh as knitted to the
card. There they give both tensions, at the card its prestress.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...runner.history import Row
from ..card import MaterialCard
from .tangent import NoConstants

APART = 0.02  # of a tension: nearer states are that of the card, less exact


@dataclass(frozen=True)
class YarnCurve:
    """Tension along one direction, rising; the first point is the mesh as knitted, without tension."""

    stretch: np.ndarray  # (point,) over the length as knitted
    nominal: np.ndarray  # (point,) [N/m] force over the width as knitted

    @property
    def slope(self) -> float:
        """[N/m] largest of the curve."""
        return float((np.diff(self.nominal) / np.diff(self.stretch)).max())


def yarn_curves(card: MaterialCard, path: Sequence[Row]) -> tuple[YarnCurve, YarnCurve]:
    """Curves along weft and warp. path: states on the way to the card, and beyond.

    Raises `NoConstants` where a direction is not stretched or carries no tension, or the mesh resists no shear.
    """
    if min(card.strain_weft, card.strain_warp, card.tension_weft, card.tension_warp) <= 0.0:
        raise NoConstants("the mesh is not stretched and tensioned both ways")
    if card.stiffness[2, 2] <= 0.0:
        raise NoConstants("its shear stiffness is not positive")
    kept = (card.strain_weft, card.strain_warp, card.tension_weft, card.tension_warp)
    rows = [kept]
    for row in path:
        tension = (row.tension_weft_N_per_m, row.tension_warp_N_per_m)
        if max(abs(one / other - 1.0) for one, other in zip(tension, kept[2:], strict=True)) > APART:
            rows.append((row.strain_weft, row.strain_warp, *tension))
    strain_weft, strain_warp, weft, warp = np.array(rows).T
    return _rising(1.0 + strain_weft, weft * (1.0 + strain_warp)), _rising(1.0 + strain_warp, warp * (1.0 + strain_weft))


def _rising(stretch: np.ndarray, nominal: np.ndarray) -> YarnCurve:
    """The curve by stretch, from the mesh as knitted and through the first of these points, without others that make it fall."""
    points = [(stretch[0], nominal[0])]
    order = np.argsort(stretch)
    for i in order[::-1]:
        if 1.0 < stretch[i] < points[0][0] and 0.0 < nominal[i] < points[0][1]:
            points.insert(0, (stretch[i], nominal[i]))
    for i in order:
        if stretch[i] > points[-1][0] and nominal[i] > points[-1][1]:
            points.append((stretch[i], nominal[i]))
    return YarnCurve(*np.array([(1.0, 0.0), *points]).T)
