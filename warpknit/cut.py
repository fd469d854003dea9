"""Where the boundary of a gripped mesh cuts the threads of endless cloth, as arc lengths on their true centre lines.

Nothing here knows of nodes: the same wires come out however finely they are divided afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .knit.cloth import Cloth
from .thread_curve import ThreadCurve


@dataclass(frozen=True)
class Cut:
    """Wires between two cuts each: runs of strands. A strand is thread t in column c of repeats, its arc length unrolled
    over the rows. Sorted by thread, column and arc."""

    columns: np.ndarray  # [column] columns of repeats that reach into the boundary
    rows: np.ndarray  # [row]
    thread: np.ndarray  # [wire]
    column: np.ndarray  # [wire]
    begin: np.ndarray  # [wire] [m] arc length where it is cut
    end: np.ndarray  # [wire] [m]


def cut_rectangle(cloth: Cloth, low: np.ndarray, high: np.ndarray) -> Cut:
    """Cut endless cloth along the rectangle from `low` to `high`, both (2,) [m]."""
    width, height = cloth.size
    columns = np.arange(int(np.floor(low[0] / width)) - 2, int(np.ceil(high[0] / width)) + 2)
    rows = np.arange(int(np.floor(low[1] / height)) - 1, int(np.ceil(high[1] / height)) + 1)
    found: list[tuple[np.ndarray, ...]] = []
    for t, thread in enumerate(cloth.threads):
        curve = ThreadCurve(thread, height)
        across = np.concatenate([curve.arcs_at_y(y) for y in (low[1], high[1])])
        periods = np.arange(np.floor(across.min() / curve.length), np.ceil(across.max() / curve.length))
        for column in columns:
            left, right = low[0] - column * width, high[0] - column * width
            along = np.concatenate([curve.arcs_at_x(x) for x in (left, right)])
            breaks = np.unique(np.concatenate([across, (along + periods[:, None] * curve.length).ravel()]))
            middle = curve(0.5 * (breaks[:-1] + breaks[1:]))
            inside = (middle[:, 0] > left) & (middle[:, 0] < right) & (middle[:, 1] > low[1]) & (middle[:, 1] < high[1])
            change = np.diff(inside.astype(np.int8), prepend=0, append=0)
            begin, end = breaks[np.nonzero(change == 1)[0]], breaks[np.nonzero(change == -1)[0]]
            found.append((np.full(len(begin), t), np.full(len(begin), column), begin, end))
    thread_of, column_of, begin, end = (np.concatenate(part) for part in zip(*found, strict=True))
    return Cut(columns, rows, thread_of, column_of, begin, end)
