"""A device `cuda:0` that is the CPU, in this process: runs take the way of a GPU, and what the host reads are copies.

    cd tests && python -m pytest -p reference.emulated_device -m gpu        tests that need a GPU, on this one

To be imported before what uses warpknit/compute/host.py. A launch refuses arrays of another device, where it would fail on a GPU.
"""

from __future__ import annotations

import importlib
import sys
from typing import Any

import warp as wp
from warp._src import context

DEVICE = "cuda:0"

if "warpknit.compute.launch" in sys.modules:
    raise ImportError("emulated_device: imported behind what uses warpknit/compute/host.py")
wp.init()
wp.config.launch_array_access_mode = wp.config.LaunchArrayAccessMode.STRICT
_cpu, _gpu = context.runtime.cpu_device, context.Device(context.runtime, DEVICE)
context.runtime.device_map[DEVICE] = _gpu
_cpu.pinned_allocator = _cpu.default_allocator  # pinned memory needs a driver
wp.get_devices = lambda: [_cpu, _gpu]
wp.is_cuda_available = lambda: True
wp.synchronize_stream = lambda _stream: None
context.Device.__eq__ = lambda self, other: self is other or self.alias == other  # type: ignore[method-assign, assignment]
_numpy, _copy = wp.array.numpy, wp.copy


def _read(array: wp.array) -> Any:
    return _numpy(array).copy() if array.device is _gpu else _numpy(array)


def _copy_contiguous(dest: wp.array, src: wp.array, *given: Any, **named: Any) -> None:
    """Warp itself would ask for the stream of the device, which is none."""
    between = dest.device is not src.device and not src.is_contiguous
    _copy(dest, src.contiguous() if between else src, *given, **named)


wp.array.numpy = _read  # type: ignore[method-assign]
wp.copy = _copy_contiguous
host = importlib.import_module("warpknit.compute.host")
host.is_in_place = lambda device: wp.get_device(device) is _cpu  # type: ignore[attr-defined]
