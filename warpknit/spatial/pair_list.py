"""The list of segment pairs that may touch until the next search."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import warp as wp

from ..host import fetch, store, zeros
from ..kernels.wire_closest import PLACES

PAIR_ARRAYS = ("first", "second", "shift", "arc_separation", "wake_travel", "renewal_travel", "found")
SLIP_ARRAYS = ("slip_step", "slip_place", "elastic_slip")
NODE_ARRAYS = ("start", "count")


class PairList:
    """Device arrays of a list of at most `capacity` segment pairs; `number` identifies the list."""

    def __init__(self, capacity: int, nodes: int, device: str, number: int, *, with_slip: bool) -> None:
        def make(dtype: type, count: int = capacity) -> wp.array:
            return zeros(count, dtype, device)

        self.capacity, self.number = capacity, number
        self.start, self.count = make(wp.int32, nodes), make(wp.int32, nodes)
        self.total = make(wp.int32, 1)
        self.first, self.second = make(wp.int32), make(wp.int32)
        self.shift = make(wp.vec3d)
        self.arc_separation, self.wake_travel = make(wp.float64), make(wp.float64)
        self.renewal_travel, self.found, self.is_near = make(wp.float64), make(wp.int32), make(wp.int32)
        # launches of every thread, once they are recorded: of `find_segment_pairs` and `mark_near_pairs`
        self.find: list[wp.Launch] = []
        self.mark: list[Callable[[], None]] = []
        self.by_second = np.zeros(0, dtype=np.int32)  # the pairs in the order of their second segments
        self.second_start = np.zeros(nodes + 1, dtype=np.int64)  # where those of each segment begin
        self.place = make(wp.vec2d, PLACES * capacity)
        # elastic slip of friction: two contacts a pair, double-buffered by the parity of the step
        slips = (2, 2 * capacity if with_slip else 0)
        self.slip_step = wp.full(slips, -1, dtype=wp.int32, device=device)
        self.slip_place = zeros(slips, wp.vec2d, device)
        self.elastic_slip = zeros(slips, wp.vec3d, device)

    def order(self, total: int) -> None:
        """Order the pairs by their second segments, after the list has been filled with so many."""
        second = fetch(self.second)[:total]
        self.by_second = np.argsort(second, kind="stable").astype(np.int32)
        self.second_start = np.searchsorted(second[self.by_second], np.arange(len(self.second_start)))

    def named(self, *names: str) -> dict[str, wp.array]:
        """Arrays by the names of the kernel arguments."""
        return {f"pair_{name}": getattr(self, name) for name in names}

    def state_dict(self) -> dict[str, np.ndarray]:
        """Arrays for a checkpoint, with the elastic slips."""
        count = int(fetch(self.total)[0])
        kept = {f"pairs_{name}": fetch(getattr(self, name))[:count].copy() for name in PAIR_ARRAYS}
        kept["pairs_place"] = fetch(self.place)[: PLACES * count].copy()
        kept |= {f"pairs_{name}": fetch(getattr(self, name))[:, : 2 * count].copy() for name in SLIP_ARRAYS}
        return kept | {f"pairs_{name}": fetch(getattr(self, name)).copy() for name in NODE_ARRAYS}

    def load_state_dict(self, kept: dict[str, np.ndarray]) -> None:
        """Restore what `state_dict` returned, into a list of at least its capacity."""
        total = len(kept["pairs_first"])
        for name in (*PAIR_ARRAYS, "place", *SLIP_ARRAYS):
            array, values = getattr(self, name), kept[f"pairs_{name}"]
            filled = fetch(array).copy()
            if name in SLIP_ARRAYS:
                filled[:, : values.shape[1]] = values
            else:
                filled[: len(values)] = values
            store(array, filled)
        for name in NODE_ARRAYS:
            store(getattr(self, name), kept[f"pairs_{name}"])
        store(self.total, total)
        self.order(total)
