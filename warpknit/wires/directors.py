"""Directors across wires: parallel transport, frames without twist, and the twist between two directors."""

from __future__ import annotations

import numpy as np


def even_directors(tangent: np.ndarray, first: np.ndarray, count: np.ndarray, closed: np.ndarray) -> np.ndarray:
    """Directors (n, 3) normal to unit tangents (n, 3): without twist, or with the closing angle distributed evenly.

    first, count, closed [wire]: segments of each wire, and whether it goes on at its first one.

    Any unit vectors across the tangents are references. Parallel transport along the wire turns them against each other; the
    directors are the references turned back by the sum of these angles, as a product of complex numbers.
    """
    side = np.zeros_like(tangent)
    side[np.arange(len(tangent)), np.argmin(np.abs(tangent), axis=1)] = 1.0
    reference = across(side, tangent)
    before = np.arange(len(tangent)) - 1
    before[first] = np.where(closed, first + count - 1, first)
    back = transported(reference[before], tangent[before], tangent)
    jump = dot(back, reference) + 1j * dot(np.cross(back, reference), tangent)
    closing = np.where(closed, jump[first], 1.0)
    jump[first] = 1.0
    total = np.cumprod(jump / np.abs(jump))
    turn = np.repeat(total[first], count) / total
    share = np.where(closed, np.angle(closing / turn[first + count - 1]) / count, 0.0)
    turn *= np.exp(1j * np.repeat(share, count) * (np.arange(len(tangent)) - np.repeat(first, count)))
    turn /= np.abs(turn)
    return turn.real[:, None] * reference + turn.imag[:, None] * np.cross(tangent, reference)


def twist(before: np.ndarray, now: np.ndarray, tangent_before: np.ndarray, tangent: np.ndarray) -> np.ndarray:
    """[n] [rad] angle from directors `before` (n, 3), transported to the tangents (n, 3), to directors `now` (n, 3)."""
    moved = transported(before, tangent_before, tangent)
    return np.arctan2(dot(np.cross(moved, now), tangent), dot(moved, now))


def transported(vector: np.ndarray, before: np.ndarray, now: np.ndarray) -> np.ndarray:
    """Parallel transport of vectors (n, 3), normal to unit tangents `before` (n, 3), to the tangents `now` (n, 3)."""
    axis, cosine = np.cross(before, now), dot(before, now)[:, None]
    moved = cosine * vector + np.cross(axis, vector) + axis * dot(axis, vector)[:, None] / (1.0 + cosine)
    return moved - dot(moved, now)[:, None] * now


def across(vector: np.ndarray, tangent: np.ndarray) -> np.ndarray:
    """Unit vectors (n, 3) along the parts of vectors (n, 3) normal to unit tangents (n, 3)."""
    part = vector - dot(vector, tangent)[:, None] * tangent
    return part / np.linalg.norm(part, axis=1, keepdims=True)


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """[n] scalar products of vectors (n, 3)."""
    return np.einsum("nc,nc->n", a, b)
