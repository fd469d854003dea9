"""Device arrays on the host: views on the CPU, copies in pinned buffers that are used again from a GPU.

A copy into fresh memory waits for the system to provide its pages, several times as long as for the transfer.
"""

from __future__ import annotations

import bisect
import copyreg
import ctypes
from collections import deque
from threading import Lock
from typing import Any

import numpy as np
import warp as wp

LEAST_BYTES = 2**20  # of an array that takes a buffer
MOST_FREE_BYTES = 2**32  # of the buffers that wait for an array
MOST_EMPTY = 2.0  # largest size of a buffer over the size of its array


class Buffers:
    """Pinned buffers by size."""

    def __init__(self) -> None:
        self._free: list[tuple[int, int]] = []  # (size [B], address), sorted
        self._all: dict[int, wp.array] = {}  # by address
        # addresses of buffers whose last view is gone, which may happen at any time
        self._returned: deque[int] = deque()
        self._lock = Lock()

    def copy(self, array: wp.array) -> np.ndarray:
        """Host copy of a GPU array. Its buffer is reused after its last view."""
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
        """Collect free buffers, and free the smallest of too many."""
        while self._returned:
            address = self._returned.popleft()
            bisect.insort(self._free, (self._all[address].capacity, address))
        total = sum(size for size, _ in self._free)
        while total > MOST_FREE_BYTES:
            size, address = self._free.pop(0)
            total -= size
            del self._all[address]


_BUFFERS = Buffers()


_VIEW = "host_view"  # attribute of an array on the CPU: its view, made once


def is_in_place(device: wp.DeviceLike) -> bool:
    """Whether the host shares the memory of device arrays, as on CPUs."""
    return bool((wp.get_device(device) if device is None or isinstance(device, str) else device).is_cpu)


def lanes(on_gpu: int, device: wp.DeviceLike) -> int:
    """Threads that share the work of one CPU thread: several on a GPU (kernels/native/sharing.h)."""
    return 1 if is_in_place(device) else on_gpu


def fetch(array: wp.array) -> np.ndarray:
    """The array on the host: a view on the CPU, a copy from a GPU.

    The view does not keep the array: values that outlive it are copied.
    """
    view: np.ndarray | None = array.__dict__.get(_VIEW)
    if view is not None:
        return view
    host = take(array)
    if not is_in_place(array.device) or not array.is_contiguous:
        return host
    if not host.nbytes:
        view = host.copy()
    else:
        # a view that refers to its array, which keeps it, would never be freed: NumPy's arrays are no part of garbage collection
        memory = (ctypes.c_char * host.nbytes).from_address(array.ptr)
        view = np.frombuffer(memoryview(memory), dtype=host.dtype).reshape(host.shape)
    array.__dict__[_VIEW] = view
    return view


def take(array: wp.array) -> np.ndarray:
    """Values of an array on the host.

    In its memory, or a copy of a GPU's; nothing else may write to it.
    """
    on_host = is_in_place(array.device) or array.capacity < LEAST_BYTES
    return np.asarray(array.numpy()) if on_host else _BUFFERS.copy(array)


def number_at(array: wp.array, place: int) -> int:
    """An entry of an array of whole numbers."""
    return int(fetch(array)[place] if is_in_place(array.device) else array[place : place + 1].numpy()[0])


class Entries:
    """Some entries of device arrays: the only ones that the host reads."""

    def __init__(self, index: np.ndarray, device: wp.DeviceLike) -> None:
        """index: [entry] along the first axis, at least one."""
        self._index: Any = index if is_in_place(device) else wp.array(index, dtype=wp.int32, device=device)

    def fetch(self, array: wp.array) -> np.ndarray:
        """[entry] a copy of these entries."""
        if isinstance(self._index, np.ndarray):
            return np.asarray(fetch(array)[self._index])
        return np.asarray(array[self._index].numpy())


class Mirror:
    """A device array with its host buffer for exchange: the same memory on the CPU, a pinned copy on a GPU."""

    def __init__(self, shape: tuple[int, ...], dtype: type, device: str) -> None:
        self._device = device
        self.array = wp.zeros(shape, dtype=dtype, device=device)
        self._pinned = None if is_in_place(device) else wp.zeros(shape, dtype=dtype, device="cpu", pinned=True)
        self.host: np.ndarray = (self.array if self._pinned is None else self._pinned).numpy()

    def copy_to_host(self) -> None:
        """Copy the array to the host, and wait."""
        if self._pinned is not None:
            wp.copy(self._pinned, self.array)
            wp.synchronize_stream(self._device)

    def copy_to_device(self) -> None:
        if self._pinned is not None:
            wp.copy(self.array, self._pinned)


def shared(values: np.ndarray, kind: type, device: str) -> wp.array:
    """Read-only values on the device; on the CPU in the same memory if the types agree."""
    return wp.array(values, dtype=kind, device=device, copy=False)


# models go to other processes with their arrays
copyreg.pickle(wp.array, lambda array: (shared, (take(array), array.dtype, str(array.device))))


def zeros(shape: int | tuple[int, ...], kind: type, device: str) -> wp.array:
    """An array of zeros of this kind.

    On the CPU its memory is NumPy's, which asks the system for large pages: meshes of many nodes step faster with them.
    """
    if not is_in_place(device):
        return wp.zeros(shape, dtype=kind, device=device)
    parts, number = _numbers_of(kind)
    return shared(np.zeros((*((shape,) if isinstance(shape, int) else shape), *parts), dtype=number), kind, device)


def _numbers_of(kind: type) -> tuple[tuple[int, ...], Any]:
    """Shape and NumPy type of the numbers in such a value."""
    return getattr(kind, "_shape_", ()), wp.dtype_to_numpy(getattr(kind, "_wp_scalar_type_", kind))


def store(array: wp.array, values: Any) -> None:
    """Set all entries of an array to values that broadcast to it."""
    if is_in_place(array.device):
        fetch(array)[...] = values
        return
    parts, number = _numbers_of(array.dtype)
    _assign(array, np.ascontiguousarray(np.broadcast_to(values, (*array.shape, *parts)), dtype=number))


def store_at(array: wp.array, key: Any, values: Any) -> None:
    """Set the entries of the array at a NumPy key."""
    host = fetch(array)
    host[key] = values
    if not is_in_place(array.device):
        _assign(array, host)


def _assign(array: wp.array, host: np.ndarray) -> None:
    """Copy values to a GPU; wait if they are in pinned memory, which may be overwritten next."""
    array.assign(host)
    if array.capacity >= LEAST_BYTES:
        wp.synchronize_stream(array.device)
