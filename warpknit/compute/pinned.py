"""Copies of device arrays in pinned memory of the host, which buffers that are free again take in turn.

A copy into fresh memory waits for the system to provide its pages, several times as long as for the transfer.
"""

from __future__ import annotations

import bisect
from collections import deque
from threading import Lock

import numpy as np
import warp as wp

LEAST_BYTES = 2**20  # of an array that takes a buffer
MOST_FREE_BYTES = 2**32  # of the buffers that wait for an array
MOST_EMPTY = 2.0  # size of a buffer over that of the array in it


class Buffers:
    """Pinned buffers by size."""

    def __init__(self) -> None:
        self._free: list[tuple[int, int]] = []  # (size [B], address), sorted
        self._all: dict[int, wp.array] = {}  # by address
        # addresses of buffers whose last view is gone, which may happen at any time
        self._returned: deque[int] = deque()
        self._lock = Lock()

    def copy(self, array: wp.array) -> np.ndarray:
        """The array of a GPU on the host, in a buffer that is free again behind the last view of it."""
        source = array if array.is_contiguous else array.contiguous()
        target: wp.array = wp.array(
            ptr=self._take(source.capacity),
            dtype=array.dtype,
            shape=array.shape,
            device="cpu",
            pinned=True,
            deleter=lambda address, _size: self._returned.append(address),
        )
        wp.copy(target, source)
        wp.synchronize_stream(array.device)
        return np.asarray(target.numpy())

    def _take(self, size: int) -> int:
        """Address of a buffer of at least this size [B]."""
        with self._lock:
            self._sort_returned()
            place = bisect.bisect_left(self._free, (size, 0))
            if place < len(self._free) and self._free[place][0] <= MOST_EMPTY * size:
                return self._free.pop(place)[1]
            buffer = wp.empty(size, dtype=wp.uint8, device="cpu", pinned=True)
            self._all[buffer.ptr] = buffer
            return int(buffer.ptr)

    def _sort_returned(self) -> None:
        """Sort in the buffers that are free again, and give the memory of the smallest back where they are too many."""
        while self._returned:
            address = self._returned.popleft()
            bisect.insort(self._free, (self._all[address].capacity, address))
        total = sum(size for size, _ in self._free)
        while total > MOST_FREE_BYTES:
            size, address = self._free.pop(0)
            total -= size
            del self._all[address]


_BUFFERS = Buffers()


def copied(array: wp.array) -> np.ndarray:
    """The array of a GPU on the host: a copy, which keeps its memory."""
    return _BUFFERS.copy(array) if array.capacity >= LEAST_BYTES else np.asarray(array.numpy())
