"""Natural curvature and twist of a file at nodes at equal arc length."""

from __future__ import annotations

import numpy as np

from warpknit.wires.arc_length import PARTS, ArcLength
from warpknit.wires.curve import Curve
from warpknit.wires.directors import transported


def natural_turns(curve: Curve, arc: ArcLength, points: np.ndarray) -> np.ndarray | None:
    """(node, 3) [rad] natural turns of a wire that goes on, as vectors on its section at rest; None: as at rest.

    points (node, 3): its nodes. The turns of the file, over the length of their points, are interpolated along the wire and
    transported to the tangents of the nodes.
    """
    if curve.natural_turn is None:
        return None
    own, here, after, share = _places(arc, len(points))
    rate = curve.natural_turn / own[:, None]
    at_points = _tangents(curve.pieces[:, 3] - curve.pieces[:, 0])
    at_nodes = _tangents(np.concatenate([points[1:], points[:1] + curve.pieces[-1, 3] - curve.pieces[0, 0]]) - points)
    first = transported(rate[here], at_points[here], at_nodes)
    return (first + share[:, None] * (transported(rate[after], at_points[after], at_nodes) - first)) * arc.length / len(points)


def twist_strains(curve: Curve, arc: ArcLength, count: int) -> np.ndarray | None:
    """[node] [rad] twist at rest less natural twist of `count` nodes; None: the natural twist is that at rest."""
    if curve.twist is None:
        return None
    own, here, after, share = _places(arc, count)
    rate = curve.twist / own
    return np.asarray((rate[here] + share * (rate[after] - rate[here])) * arc.length / count)


def _places(arc: ArcLength, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """[piece] length that belongs to its first point; [node] the points before and behind, and the place between them."""
    knots = arc.knots[::PARTS]
    length = np.diff(knots)
    place = np.arange(count) * (arc.length / count)
    here = np.clip(np.searchsorted(knots, place, side="right") - 1, 0, len(length) - 1)
    return 0.5 * (length + np.roll(length, 1)), here, (here + 1) % len(length), (place - knots[here]) / length[here]


def _tangents(edge: np.ndarray) -> np.ndarray:
    """(point, 3) unit vectors between the directions of the edges (point, 3) before and behind."""
    along = edge / np.linalg.norm(edge, axis=1)[:, None]
    both = along + np.roll(along, 1, axis=0)
    return np.asarray(both / np.linalg.norm(both, axis=1)[:, None])
