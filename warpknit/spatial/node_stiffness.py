"""Stiffness of the nodes of rods against bending and twist at sharp turns.

A node stands for the wire around it, with tangents t(s). A moment vector M bends and twists that wire by the relative rotation of
both segments

    phi = C M        C = integral of w (t t/GJ + (1 - t t)/EI) ds        w: hat function of the node

so a node between two segments that meet at a large angle p is twisted by moments about either of them. With n the axis of the
turn, b the unit vector between the tangents and c = b x n, the turn and the twist of kernels/rod_forces.py change by

    phi = J (da along A, da across it, dm)        J = diag(1, 2 sin(p/2)/p, cos(p/2)) along n, c, b

and the stiffness is J^T C^-1 J: EI, EI and GJ over the length of the node to second order in p. Where the line between the nodes
is not known, t is b. Where the wire may yield it stays the same in all directions across the wire.
"""

from __future__ import annotations

import numpy as np

from .rods import Rods

STRAIGHT = 1e-6  # [rad] turn below which its axis does not matter
AT_A_TIME = 4096  # segments, whose pieces stay in the cache
ENTRIES = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))  # of a symmetric matrix, in their order


def node_stiffness(rods: Rods, pieces: np.ndarray | None = None, places: np.ndarray | None = None) -> np.ndarray:
    """(node, 6) [N m] ENTRIES of the stiffness of nodes against turns along the section directors, and twist.

    pieces (node, part, 3) [m]: of the centre line behind a node, between `places` 0 .. 1 of the segment.
    """
    before, edge = rods.previous, rods.rest_edge
    tangent = edge / np.linalg.norm(edge, axis=1)[:, None]
    e, f = tangent[before], tangent
    inside = (before >= 0) & (rods.following >= 0)
    turn = np.where(inside, rods.rest_turning, 0.0)
    n, bisector, along = node_frame(e, f, rods.director[before], rods.director, turn > STRAIGHT)
    frame = np.stack([n, np.cross(bisector, n), bisector], axis=1)  # rows
    length = np.where(inside, rods.node_length, 1.0)
    ei, gj = rods.of_nodes("bending_stiffness"), rods.of_nodes("twist_stiffness")
    isotropic = rods.section.yield_curvature > 0.0 or rods.natural_curvature is not None
    compliance = np.stack([1.0 / ei, 1.0 / ei, 1.0 / gj], axis=1)[:, None, :] * np.eye(3)
    compliance *= length[:, None, None]
    if pieces is not None and places is not None and not isotropic:
        compliance = np.where(inside[:, None, None], _along_line(rods, pieces, places, frame), compliance)
    half = 0.5 * np.where(isotropic, 0.0, turn)
    scale = np.stack([np.ones_like(half), np.sinc(half / np.pi), np.cos(half)], axis=1)
    stiffness = scale[:, :, None] * np.linalg.inv(compliance) * scale[:, None, :]
    turned = np.zeros_like(stiffness)
    turned[:, :2, 0], turned[:, 2, 2] = along, 1.0
    turned[:, 0, 1], turned[:, 1, 1] = -along[:, 1], along[:, 0]
    stiffness = np.einsum("nai,nij,nbj->nab", turned, stiffness, turned)
    return np.stack([stiffness[:, a, b] for a, b in ENTRIES], axis=1)


def node_frame(
    e: np.ndarray, f: np.ndarray, before: np.ndarray, director: np.ndarray, bends: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Axis n of the turn, bisector b (node, 3), and n along the directors (node, 2).

    e, f (node, 3): tangents before and behind a node, with directors `before` and `director`; where it does not bend, n is any.
    """
    first, second = before + director, np.cross(e, before) + np.cross(f, director)
    b = (e + f) / np.maximum(np.linalg.norm(e + f, axis=1), 1e-300)[:, None]
    n = np.where(bends[:, None], np.cross(e, f), second)
    n -= np.sum(n * b, axis=1)[:, None] * b
    n /= np.maximum(np.linalg.norm(n, axis=1), 1e-300)[:, None]
    along = np.stack([np.sum(second * n, axis=1), -np.sum(first * n, axis=1)], axis=1)
    return n, b, along / np.maximum(np.linalg.norm(along, axis=1), 1e-300)[:, None]


def _along_line(rods: Rods, pieces: np.ndarray, places: np.ndarray, frame: np.ndarray) -> np.ndarray:
    """(node, 3, 3) compliance of the centre line around the nodes, in their frames (node, 3, 3), rows."""
    total, ei, gj = np.zeros((rods.node_count, 3, 3)), rods.of_nodes("bending_stiffness"), rods.of_nodes("twist_stiffness")
    segments = np.flatnonzero(rods.following >= 0)
    for first in range(0, len(segments), AT_A_TIME):
        begin = segments[first : first + AT_A_TIME]
        piece = pieces[begin]
        size = np.linalg.norm(piece, axis=2)
        share = (1.0 - 0.5 * (places[1:] + places[:-1])) * size  # of the node before the segment
        for node, part in ((begin, share), (rods.following[begin], size - share)):
            t = piece @ np.swapaxes(frame[node], 1, 2) / np.maximum(size, 1e-300)[:, :, None]
            twisted = np.swapaxes(part[:, :, None] * t, 1, 2) @ t
            bent = np.sum(part, axis=1)[:, None, None] * np.eye(3) - twisted
            total[node] += twisted / gj[node][:, None, None] + bent / ei[node][:, None, None]
    return total
