"""Nodes at equal arc length along a curve of cubic pieces.

Each piece is halved twice; the length of a part is a Gauss-Legendre sum of eight points. The parameter of a node is found by
Newton's method on the arc length inside its part, whose derivative is the speed. The nodes lie on the curve; how equal their
distances are depends on the quadrature alone.
"""

from __future__ import annotations

import numpy as np

from warpknit.wires.curve import Curve

PARTS = 4  # of a piece
NEWTON_STEPS = 6
FOUND = 1e-9  # of a piece: a step shorter than this leaves its square
BLOCK = 1 << 15  # pieces or nodes at once: bounds the memory
PLACES, WEIGHTS = np.polynomial.legendre.leggauss(8)
PLACES, WEIGHTS = 0.5 * (PLACES + 1.0), 0.5 * WEIGHTS  # on [0, 1]


class ArcLength:
    """Arc length along the pieces (piece, 4, 3) of a curve."""

    def __init__(self, curve: Curve) -> None:
        self.pieces = curve.pieces
        parts = np.empty((len(self.pieces), PARTS))
        for first in range(0, len(self.pieces), BLOCK):
            block = self.pieces[first : first + BLOCK, None]
            start = np.arange(PARTS) / PARTS
            parts[first : first + BLOCK] = _lengths(block, start, start + 1.0 / PARTS)
        self.parts = parts.ravel()
        self.knots = np.concatenate([[0.0], np.cumsum(self.parts)])  # arc length at the ends of the parts

    @property
    def length(self) -> float:
        return float(self.knots[-1])

    def points(self, arcs: np.ndarray) -> np.ndarray:
        """(node, 3) at arc lengths (node,) between 0 and `length`."""
        blocks = [self._points(arcs[first : first + BLOCK]) for first in range(0, len(arcs), BLOCK)]
        return np.concatenate(blocks) if blocks else np.empty((0, 3))

    def _points(self, arcs: np.ndarray) -> np.ndarray:
        part = np.clip(np.searchsorted(self.knots, arcs, side="right") - 1, 0, len(self.parts) - 1)
        wanted = np.clip(arcs - self.knots[part], 0.0, self.parts[part])
        pieces, start = self.pieces[part // PARTS], (part % PARTS) / PARTS
        end = start + 1.0 / PARTS
        share = np.divide(wanted, self.parts[part], out=np.zeros_like(wanted), where=self.parts[part] > 0.0)
        place = start + share / PARTS
        for _ in range(NEWTON_STEPS):
            speed = np.linalg.norm(_derivative(pieces, place), axis=-1)
            excess = _lengths(pieces, start, place) - wanted
            step = np.divide(excess, speed, out=np.zeros_like(excess), where=speed > 0.0)
            place = np.clip(place - step, start, end)
            if np.abs(step).max(initial=0.0) < FOUND:
                break
        return _value(pieces, place)


def _lengths(pieces: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Arc length (...) of pieces (..., 4, 3) between parameters (...)."""
    span = np.asarray(end - start)
    places = start[..., None] + span[..., None] * PLACES
    speed = np.linalg.norm(_derivative(pieces[..., None, :, :], places), axis=-1)
    return np.asarray(span * (speed @ WEIGHTS))


def _value(pieces: np.ndarray, t: np.ndarray) -> np.ndarray:
    """(..., 3) by de Casteljau's steps."""
    t = t[..., None, None]
    for _ in range(3):
        pieces = pieces[..., :-1, :] + t * np.diff(pieces, axis=-2)
    return np.asarray(pieces[..., 0, :])


def _derivative(pieces: np.ndarray, t: np.ndarray) -> np.ndarray:
    """(..., 3) by the parameter."""
    rise = 3.0 * np.diff(pieces, axis=-2)
    t = t[..., None, None]
    for _ in range(2):
        rise = rise[..., :-1, :] + t * np.diff(rise, axis=-2)
    return np.asarray(rise[..., 0, :])


def segment_count(length: float, kind: str, spacing: float) -> int:
    """Segments of equal length nearest to `spacing`; two at least, four of a wire that goes on."""
    return max(2 if kind == "open" else 4, round(length / spacing))


def resample(curve: Curve, arc: ArcLength, count: int) -> tuple[np.ndarray, np.ndarray | None]:
    """Nodes at equal arc length, `count` segments of them, and the lengths (segment,) free of stress of these straight segments:
    so much shorter or longer than they are as the wire is along its curve.

    The first node is where the curve begins; of an open curve the last is where it ends.
    """
    places = np.linspace(0.0, arc.length, count + 1)
    points = arc.points(places if curve.kind == "open" else places[:-1])
    points[0] = curve.pieces[0, 0]
    if curve.kind == "open":
        points[-1] = curve.pieces[-1, 3]
    if curve.slack is None:
        return points, None
    free = np.concatenate([[0.0], np.cumsum(np.repeat(curve.slack, PARTS) * arc.parts)])
    along = np.diff(np.interp(places, arc.knots, free)) / (arc.length / count)
    ends = points if curve.kind == "open" else np.concatenate([points, points[:1] + curve.pieces[-1, 3] - curve.pieces[0, 0]])
    return points, along * np.linalg.norm(np.diff(ends, axis=0), axis=1)
