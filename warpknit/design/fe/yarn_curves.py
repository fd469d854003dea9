"""Curves for the laws of woven fabrics, in which either direction has a tension of its own strain alone.

A mesh is no such fabric: its tensions depend on both strains. The curves hold on one path, that from the mesh as knitted to the
card. There they give both tensions, at the card its prestress.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...base.text import alike, percent
from ...runner.history import Row
from ..card import MaterialCard
from .tangent import NoConstants

APART = 0.02  # of a tension: nearer states are that of the card, less exact
FIRST = 0.05  # of the strain of the card: points nearer to the mesh as knitted, of one that contracted before, are left out
MISFIT = 0.1  # of the tension of the card: largest difference of a curve from a state on the way to the card


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
    """Curves along weft and warp. path: states on the way to the card, and beyond, up to the first jump to another equilibrium.

    Raises `NoConstants` where a direction is not stretched or carries no tension, where the mesh resists no shear or jumps on the
    way to the card, and where a tension is no rising function of the strain along it.
    """
    if min(card.strain_weft, card.strain_warp, card.tension_weft, card.tension_warp) <= 0.0:
        strains, tensions = (card.strain_weft, card.strain_warp), (card.tension_weft, card.tension_warp)
        values = f"strain {' / '.join(map(percent, strains))}, tension {' / '.join(alike(tensions, 'N/m'))}"
        raise NoConstants(f"a direction of the mesh is not stretched or carries no tension ({values} in weft / warp)")
    if card.stiffness[2, 2] <= 0.0:
        raise NoConstants("its shear stiffness is not positive")
    if card.jumps:
        raise NoConstants("the mesh jumps to another equilibrium on the way to the card")
    kept = (card.strain_weft, card.strain_warp, card.tension_weft, card.tension_warp)
    rows = [kept]
    for row in path:
        tension = (row.tension_weft_N_per_m, row.tension_warp_N_per_m)
        if max(abs(one / other - 1.0) for one, other in zip(tension, kept[2:], strict=True)) > APART:
            rows.append((row.strain_weft, row.strain_warp, *tension))
    strain_weft, strain_warp, weft, warp = np.array(rows).T
    along_weft, along_warp = 1.0 + strain_weft, 1.0 + strain_warp
    return _rising("weft", along_weft, weft * along_warp), _rising("warp", along_warp, warp * along_weft)


def _rising(side: str, stretch: np.ndarray, nominal: np.ndarray) -> YarnCurve:
    """The curve by stretch, from the mesh as knitted and through the first of these points, without others that make it fall.

    Raises `NoConstants` where the others of less tension than the first are far off the curve.
    """
    points = [(stretch[0], nominal[0])]
    order, least = np.argsort(stretch), 1.0 + FIRST * (stretch[0] - 1.0)
    for i in order[::-1]:
        if least < stretch[i] < points[0][0] and 0.0 < nominal[i] < points[0][1]:
            points.insert(0, (stretch[i], nominal[i]))
    for i in order:
        if stretch[i] > points[-1][0] and nominal[i] > points[-1][1]:
            points.append((stretch[i], nominal[i]))
    curve = YarnCurve(*np.array([(1.0, 0.0), *points]).T)
    before = nominal < nominal[0]
    off = np.abs(np.interp(stretch[before], curve.stretch, curve.nominal) - nominal[before])
    if off.max(initial=0.0) > MISFIT * nominal[0]:
        raise NoConstants(f"the tension in {side} does not rise with the strain in {side} on the way to the card")
    return curve
