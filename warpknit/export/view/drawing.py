"""Drawing of a record in 3D: tubes of its wires, its contacts, and picking.

Lengths in mm, stress in MPa, forces in uN.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ...results.frame import Floats, Frame, Integers, WireLayout, curve_position, drawn_frame, drawn_layout
from ..plots import tile_copies

SIDES = (12, 8, 5)  # of a tube, the first with which a drawing has at most TUBE_VERTICES
TUBE_VERTICES = 300_000  # beyond, wires are lines
LINES = 100_000  # straight pieces, at most: of larger meshes points are left out
SPHERES = 20_000  # contacts that are drawn at a time
STEEP = 0.1  # of a tangent across the height, below which another direction begins its circle
COPIED = 80_000  # points of the copies of a periodic tile that are drawn, at most
COPIES, MOST_COPIES = 2, 8  # along the longer side of the tile; along the other, at most
REACH = 3.0  # radii of a wire, or a contact, from a ray that still meets it


@dataclass(frozen=True, eq=False)
class Drawing:
    """Pieces of wires and contacts."""

    radius: float  # [mm] of the wires
    points: Floats  # (point, 3) [mm]
    stress: Floats  # [point] [MPa]
    wire: Integers  # [point]
    index: Integers  # [point] in the drawn curves of the run
    start: Integers  # [piece + 1] points of piece p are start[p]:start[p + 1]
    place: Floats  # (contact, 3) [mm] hooks, and active contacts between stitches
    force: Floats  # [contact] [uN] between the two wires
    is_active: np.ndarray  # [contact] bool
    number: Integers  # [contact] of the body; elsewhere body_count + first wire * wire_count + second wire

    @cached_property
    def segment(self) -> Integers:
        """[segment] first point of each straight piece; its second is the next point."""
        goes_on = np.ones(len(self.points), dtype=bool)
        goes_on[self.start[1:] - 1] = False
        return np.flatnonzero(goes_on)

    @property
    def sides(self) -> int:
        """Sides of the tubes that there is room for; 0: draw lines."""
        return next((sides for sides in SIDES if sides * len(self.points) <= TUBE_VERTICES), 0)

    def tubes(self, sides: int) -> tuple[Floats, Integers]:
        """Vertices (point * sides, 3) around each point in turn, and triangles (face, 3)."""
        edge = np.diff(self.points, axis=0)
        ahead, behind = np.zeros_like(self.points), np.zeros_like(self.points)
        ahead[self.segment], behind[self.segment + 1] = edge[self.segment], edge[self.segment]
        tangent = ahead + behind
        tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-300)
        across = np.cross([0.0, 0.0, 1.0], tangent)
        is_steep = np.linalg.norm(across, axis=1) < STEEP
        across[is_steep] = np.cross([1.0, 0.0, 0.0], tangent[is_steep])
        across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)
        third = np.cross(tangent, across)
        angle = 2.0 * np.pi * np.arange(sides) / sides
        circle = np.cos(angle)[:, None] * across[:, None] + np.sin(angle)[:, None] * third[:, None]
        vertices = (self.points[:, None] + self.radius * circle).reshape(-1, 3)
        corner = self.segment[:, None] * sides + np.arange(sides)
        beside = self.segment[:, None] * sides + (np.arange(sides) + 1) % sides
        faces = np.stack([corner, beside, corner + sides, beside, beside + sides, corner + sides], axis=-1)
        return vertices, faces.reshape(-1, 3)

    def thinned(self) -> Drawing:
        """Every nth point and the last point of each wire: about LINES straight pieces."""
        every = -(-len(self.segment) // LINES)
        inside = np.arange(len(self.points)) - np.repeat(self.start[:-1], np.diff(self.start))
        keeps = inside % every == 0
        keeps[self.start[1:] - 1] = True
        return self._taken(np.flatnonzero(keeps), np.concatenate([[0], np.cumsum(keeps)])[self.start], np.arange(len(self.place)))

    def copied(self, shifts: Floats) -> Drawing:
        """Copies with these shifts (copy, 2) [mm]."""
        many, points, contacts = len(shifts), np.arange(len(self.points)), np.arange(len(self.place))
        start = np.concatenate([[0], *(self.start[1:] + copy * len(points) for copy in range(many))])
        every = self._taken(np.tile(points, many), start, np.tile(contacts, many))
        for places, count in ((every.points, len(points)), (every.place, len(contacts))):
            places[:, :2] += np.repeat(shifts, count, axis=0)
        return every

    def within(self, low: Floats, high: Floats) -> Drawing:
        """The part between two corners (2,) [mm] of a rectangle."""
        keeps, contacts = (
            np.all((places[:, :2] >= low) & (places[:, :2] <= high), axis=1) for places in (self.points, self.place)
        )
        is_first = np.zeros(len(self.points) + 1, dtype=bool)
        is_first[self.start] = True
        is_first[1:-1] |= keeps[1:] & ~keeps[:-1]
        start = np.append(np.flatnonzero(is_first[:-1][keeps]), np.count_nonzero(keeps))
        return self._taken(np.flatnonzero(keeps), start, np.flatnonzero(contacts))

    def _taken(self, points: Integers, start: Integers, contacts: Integers) -> Drawing:
        """These points, with their pieces, and these contacts."""
        taken: dict[str, Any] = {name: getattr(self, name)[points] for name in ("points", "stress", "wire", "index")}
        taken |= {name: getattr(self, name)[contacts] for name in ("place", "force", "is_active", "number")}
        return Drawing(radius=self.radius, start=start, **taken)

    def pick(self, origin: Floats, direction: Floats, reach: float) -> tuple[int | None, int | None]:
        """Contact and point that a ray of sight meets first within `reach` [mm]; a contact goes before the wire under it."""
        contact, ahead = _first(self.place, origin, direction, max(reach, REACH * self.radius))
        point, behind = _first(self.points, origin, direction, max(reach, REACH * self.radius))
        if contact is not None and (point is None or ahead < behind + 4.0 * REACH * self.radius):
            return contact, None
        return None, point


def drawing_of(layout: WireLayout, frame: Frame) -> Drawing:
    """The drawing of a record; a small periodic tile is drawn in copies, about as wide as high, up to the edge of a rectangle."""
    curves, drawn, elsewhere = drawn_layout(layout), drawn_frame(layout, frame), frame.elsewhere_wires
    drawing = Drawing(
        radius=0.5e3 * layout.diameter,
        points=1e3 * np.asarray(curve_position(curves, drawn), dtype=float),
        stress=1e-6 * np.asarray(drawn.node_stress, dtype=float)[curves.curve_node],
        wire=np.repeat(np.arange(curves.wire_count), np.diff(curves.curve_start)),
        index=np.arange(len(curves.curve_node)),
        start=curves.curve_start,
        place=1e3 * np.concatenate([frame.body_position, frame.elsewhere_position], dtype=float),
        force=1e6 * np.concatenate([frame.body_force, frame.elsewhere_force], dtype=float),
        is_active=np.append(frame.body_active, np.ones(len(elsewhere), dtype=bool)),
        number=np.append(np.arange(layout.body_count), layout.body_count + elsewhere @ [layout.wire_count, 1]),
    )
    if not layout.wire_closed.any():
        return drawing
    tile = 1e3 * frame.deformation @ np.diag(layout.period)
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * _copies(layout.period, len(drawing.points)) @ tile.T
    low, high = corners.min(axis=0), corners.max(axis=0)
    return drawing.copied(tile_copies(drawing.points[:, :2], tile, low, high)).within(low, high)


def _copies(period: Floats, points: int) -> Integers:
    """Drawn copies (2,) of a tile with `points` points, in weft and warp."""
    copies = np.clip(np.round(COPIES * period.max() / period), COPIES, MOST_COPIES).astype(int)
    return copies if points * np.prod(copies) <= COPIED else np.ones(2, dtype=int)


def _first(places: Floats, origin: Floats, direction: Floats, reach: float) -> tuple[int | None, float]:
    """Nearest place to the eye within `reach` of a ray, and its distance."""
    if not len(places):
        return None, np.inf
    direction = np.asarray(direction, dtype=float) / np.linalg.norm(direction)
    away = places - np.asarray(origin, dtype=float)
    along = away @ direction
    beside = np.linalg.norm(away - along[:, None] * direction, axis=1)
    there = np.flatnonzero((beside <= reach) & (along > 0.0))
    if not len(there):
        return None, np.inf
    # of those about as near to the eye as the first, the one nearest to the ray
    there = there[along[there] <= along[there].min() + reach]
    best = int(there[np.argmin(beside[there])])
    return best, float(along[best])
