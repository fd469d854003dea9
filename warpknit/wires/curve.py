"""A centre line as its file has it, in the file's unit: cubic pieces in Bezier form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

MOST_POINTS = 2_000_000  # of a file
NAMED = 3  # of what is not used in a file, in a note
MOST = 1e9  # of a coordinate, in the file's unit
LEAST = 1e-15  # of a distance between points that differ, in the file's unit


class BadFile(Exception):
    """A file is not what its name says: `given`, such as 'a file that ends in its header'."""


@dataclass(frozen=True, eq=False)
class Curve:
    """pieces (piece, 4, 3): Bezier control points, each piece beginning where the last one ended.

    A closed curve ends where it begins; a periodic one ends at its beginning moved by `shift` repeats.
    """

    pieces: np.ndarray
    kind: str  # open | closed | periodic
    shift: tuple[int, int] = (0, 0)
    slack: np.ndarray | None = None  # (piece,) length free of stress over length
    # of a wire that goes on, at the beginnings of its pieces: natural turn as a vector on the section at rest (piece, 3) [rad];
    # twist at rest less natural twist (piece,) [rad]
    natural_turn: np.ndarray | None = None
    twist: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class CurveFile:
    """What a reader found. Lengths are in the file's unit."""

    curves: tuple[Curve, ...]
    metres: float | None = None  # in a unit of the file, where it says so
    radius: np.ndarray | None = None  # (curve,) where the file says it
    no_radius: str = ""  # why widths of the file are no radius of each curve
    period: np.ndarray | None = None  # (2,)
    notes: tuple[str, ...] = ()  # what the file states and is not used


def some_of(names: list[str]) -> str:
    """The first of these names, and how many more there are."""
    more = f"; {len(names) - NAMED:,} more" if len(names) > NAMED else ""
    return "; ".join(names[:NAMED]) + more


def check_points(points: np.ndarray) -> np.ndarray:
    """`points` (point, 3) as doubles. Raises `BadFile` where a coordinate is no number, or beyond MOST."""
    points = np.asarray(points, dtype=np.float64)
    bad = ~(np.abs(points) <= MOST).all(axis=-1)
    if bad.any():
        number = int(np.argmax(bad))
        raise BadFile(f"point {number + 1} at {', '.join(f'{x:g}' for x in points[number])}")
    return points


def check_count(count: int) -> None:
    """Raises `BadFile` for more points than are read; called before memory is taken."""
    if count > MOST_POINTS:
        raise BadFile(f"{count:,} points, more than {MOST_POINTS:,}")
