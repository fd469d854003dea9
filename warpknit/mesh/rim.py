"""The edge of a gripped mesh: stations along its outline that are held or hang on an elastic cord.

Between two stations the edge moves as a straight line does; the clamps at the ends of the wires go with it. Where the mesh is
held all along its outline every station is given; with net nodes at a pitch only these are, and between them a cord pulls.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import sparse

from ..base.errors import ModelError
from ..base.text import engineering
from ..scene import Cord, Pull, Scene
from ..scene.outline import Outline
from .panel import Panel


@dataclass(frozen=True)
class LoadPoint:
    """A deformation gradient, temperatures and pulls."""

    gradient: np.ndarray  # (2, 2)
    temperature: float  # [K] in the middle
    temperature_gradient: tuple[float, float] = (0.0, 0.0)  # [K/m]
    stations: np.ndarray | None = None  # (station, 2) [m] displacement of the rim (rim.py) from the affinely mapped outline
    tension: np.ndarray | None = None  # (2,) [N/m] wanted in weft and warp, nan where the strain is given
    raised: float = 0.0  # share of the height of the paraboloid (`panel.focal_length`) at which the edge is held

    def is_as_knitted(self, reference_temperature: float) -> bool:
        """Whether this is the unloaded state at a temperature [K]."""
        moved = self.raised > 0.0 or (self.stations is not None and bool(self.stations.any()))
        even = not any(self.temperature_gradient) and self.temperature == reference_temperature
        return np.array_equal(self.gradient, np.eye(2)) and even and not moved and self.tension is None


REPEATS_A_CELL = 2  # of the grid of a membrane: finer ones would see the stiffness of the edges
CORNER = 0.5  # rad by which an outline turns where a net node must stand
STATIONS_AT_LEAST = 2  # of a cord between two net nodes
SOFT = 1e-6  # of the stiffness along the cord: keeps a slack one from moving without bound


@dataclass(frozen=True)
class Rim:
    """Stations along an outline, and the weights with which clamps follow them."""

    outline: Outline
    arc: np.ndarray  # [station] [m], ascending
    place: np.ndarray  # [station, 2] [m] at rest
    given: np.ndarray  # [station] bool: held by the net or a frame; the others hang on the cord
    clamps: sparse.csr_matrix  # (clamp, station) weights
    cord: Cord | None

    @property
    def is_free(self) -> bool:
        """Whether any station is free."""
        return not bool(self.given.all())

    def held(self) -> Rim:
        """The same, held everywhere."""
        return replace(self, given=np.ones(len(self.arc), dtype=bool), cord=None)

    def weights(self, arc: np.ndarray) -> sparse.csr_matrix:
        """(place, station) linear weights of the two stations around places on the outline [m]."""
        n = len(self.arc)
        arc = np.where(arc < self.arc[0], arc + self.outline.length, arc)  # the last stretch ends at the first station
        before = np.searchsorted(self.arc, arc, side="right") - 1
        span = np.diff(np.append(self.arc, self.arc[0] + self.outline.length))
        share = (arc - self.arc[before]) / span[before]
        rows = np.arange(len(arc))
        entries = np.concatenate([1.0 - share, share])
        columns = np.concatenate([before, (before + 1) % n])
        return sparse.csr_matrix((entries, (np.tile(rows, 2), columns)), shape=(len(arc), n))

    def pulled(self, pulls: Sequence[Pull]) -> np.ndarray:
        """Displacement (station, 2) [m] of the given stations by pulls at places of the outline.

        With net nodes the nearest one moves; else the outline within half a width does, as cos^2.
        """
        moved = np.zeros((len(self.arc), 2))
        for pull in pulls:
            middle = 0.5 * (2.0 * self.outline.low + self.outline.size)
            at = middle + np.array(pull.at)
            if pull.width is None:
                net = np.nonzero(self.given)[0]
                share = np.zeros(len(self.arc))
                share[net[np.argmin(np.sum((self.place[net] - at) ** 2, axis=1))]] = 1.0
            else:
                arc, _ = self.outline.nearest(at[None])
                away = np.abs(self.arc - arc[0])
                away = np.minimum(away, self.outline.length - away)
                share = np.where(away < 0.5 * pull.width, np.cos(np.pi * away / pull.width) ** 2, 0.0)
            moved += share[:, None] * np.array(pull.by)
        return moved

    @cached_property
    def chords(self) -> sparse.csr_matrix:
        """(station, given station) weights with which the outline is straight between given stations."""
        return replace(self, arc=self.arc[self.given], place=self.place[self.given]).weights(self.arc)

    def strain(self, moved: np.ndarray) -> float:
        """Largest strain of the outline between two stations that are moved by (station, 2) [m]."""
        apart = np.linalg.norm(np.roll(self.place, -1, axis=0) - self.place, axis=1)
        return float((np.linalg.norm(np.roll(moved, -1, axis=0) - moved, axis=1) / apart).max())

    # --- the cord ---

    def cord_forces(self, gradient: np.ndarray, moved: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Forces (station, n) [N] and tensions [N] behind each station of the cord.

        Stations are displaced by `moved` (station, n) [m] from the outline under the deformation gradient (2, 2): n = 2 in its
        plane, 3 also out of it.
        """
        _, tension, unit = self._cord(gradient, moved)
        pull = tension[:, None] * unit
        return pull - np.roll(pull, 1, axis=0), tension

    def cord_stiffness(self, gradient: np.ndarray, moved: np.ndarray) -> sparse.csr_matrix:
        """(n station, n station) [N/m] derivative of minus the forces by the displacements (station, n) [m]."""
        assert self.cord is not None
        length, tension, unit = self._cord(gradient, moved)
        n, axes = moved.shape
        along = unit[:, :, None] * unit[:, None, :]
        stiffness = self.cord.stiffness / length
        across = np.maximum(tension / length, SOFT * stiffness)
        k = stiffness[:, None, None] * along + across[:, None, None] * (np.eye(axes) - along)
        here = np.arange(n)
        following = sparse.csr_matrix((np.ones(n), (here, (here + 1) % n)), shape=(n, n))
        behind = sparse.kron(following - sparse.identity(n), sparse.identity(axes))  # from a station to the next one
        pieces = sparse.bsr_matrix((k, np.arange(n), np.arange(n + 1)))
        return (behind.T @ pieces @ behind).tocsr().sorted_indices()

    def _cord(self, gradient: np.ndarray, moved: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Lengths on the outline [m], tensions [N] (none where slack) and directions (station, n) of the cord behind each
        station. Out of its plane, the outline is straight between the given stations."""
        assert self.cord is not None
        height = self.chords @ moved[self.given, 2:]
        outline, away = np.hstack([self.place @ gradient.T, height]), np.hstack([moved[:, :2], moved[:, 2:] - height])
        straight = np.roll(outline, -1, axis=0) - outline
        edge = straight + np.roll(away, -1, axis=0) - away
        natural, length = np.linalg.norm(straight, axis=1), np.linalg.norm(edge, axis=1)
        tension = np.maximum(self.cord.tension + self.cord.stiffness * (length / natural - 1.0), 0.0)
        return natural, tension, edge / length[:, None]


def build_rim(panel: Panel, scene: Scene) -> Rim:
    """Stations along the outline of a gripped panel, including net nodes.

    Those on a cord are as far apart as the nodes of the grid of a membrane (membrane.py), others a repeat.
    Raises `ModelError` where the pitch leaves fewer than three net nodes.
    """
    outline, options = panel.outline, scene.panel
    spacing = (REPEATS_A_CELL if options.cord else 1) * min(scene.knit.repeat)
    assert outline is not None
    corners = _corners(outline)
    ends = np.append(corners, corners[0] + outline.length)
    arcs, given = [], []
    for begin, end in itertools.pairwise(ends):
        spans = max(1, round((end - begin) / (options.grip_pitch or end - begin)))
        pieces = max(STATIONS_AT_LEAST if options.cord else 1, round((end - begin) / spans / spacing))
        place = np.arange(spans * pieces)
        arcs.append(begin + (end - begin) * place / len(place))
        given.append(place % pieces == 0 if options.cord else np.ones(len(place), dtype=bool))
    arc, held = np.mod(np.concatenate(arcs), outline.length), np.concatenate(given)
    order = np.argsort(arc)
    arc, held = arc[order], held[order]
    if held.sum() < 3:
        length = f"an outline of {engineering(outline.length, 'm')} has {held.sum()} net nodes, fewer than 3"
        raise ModelError(f"panel.grip_pitch: {length}; write less")
    rim = Rim(outline, arc, outline.place(arc), held, sparse.csr_matrix((0, len(arc))), options.cord)
    clamp_arc, _ = outline.nearest(panel.clamp_position)
    return Rim(outline, arc, rim.place, held, rim.weights(clamp_arc), options.cord)


def net_nodes(outline: Outline, pitch: float) -> tuple[int, float]:
    """Number of net nodes for a pitch [m], and largest distance along the outline [m]."""
    corners = _corners(outline)
    sides = np.diff(np.append(corners, corners[0] + outline.length))
    spans = np.maximum(1, np.round(sides / pitch))
    return int(spans.sum()), float((sides / spans).max())


def _corners(outline: Outline) -> np.ndarray:
    """Arc lengths [m] of corners with turns above CORNER; else of the first corner."""
    edge, before = outline.edges, np.roll(outline.edges, 1, axis=0)
    turn = np.arctan2(before[:, 0] * edge[:, 1] - before[:, 1] * edge[:, 0], np.sum(before * edge, axis=1))
    found = outline.arcs[np.abs(turn) > CORNER]
    return found if len(found) else outline.arcs[:1]
