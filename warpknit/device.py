"""The device of a run, and a quiet start of Warp."""

from __future__ import annotations

import logging
import math
import os
import sys
import tempfile
from collections.abc import Callable
from functools import cache

import warp as wp

from .errors import DeviceError

_log = logging.getLogger(__name__)

LEAST_NODES = 100_000  # below, the launches of a step take a GPU longer than the whole step takes the CPU; not measured
NO_DRIVER = "Could not find or load the NVIDIA CUDA driver"  # what Warp's library prints on a machine without a GPU


@cache
def start_warp() -> None:
    """Initialise Warp. Its library writes to the stderr of the process; all but the lack of a GPU is passed on as a warning."""
    sys.stderr.flush()
    kept = os.dup(2)
    with tempfile.TemporaryFile() as said:
        os.dup2(said.fileno(), 2)
        try:
            wp.init()
        except OSError as error:
            where = f"the kernel cache {wp.config.kernel_cache_dir}"
            raise DeviceError(
                f"{where}: given {(error.strerror or '').lower()}, allowed: a directory to write to, as WARP_CACHE_PATH"
            ) from error
        finally:
            os.dup2(kept, 2)
            os.close(kept)
        said.seek(0)
        for line in said.read().decode(errors="replace").splitlines():
            if line.strip() and NO_DRIVER not in line:
                _log.warning("%s", line)


def devices() -> list[str]:
    """The Warp names of the devices of this machine."""
    start_warp()
    return [str(device) for device in wp.get_devices()]


def find_device(name: str | None, place: int = 0, nodes: Callable[[], int] | None = None) -> str:
    """The Warp name of a device; None takes the first CUDA device if there is one and the mesh has LEAST_NODES `nodes` or more.
    The ranks of a machine (this one stands at `place` among them) take them in turn. Raises `DeviceError`."""
    available = devices()
    if name is None:
        graphics = [d for d in available if d.startswith("cuda")]
        if graphics and nodes is not None and nodes() < LEAST_NODES:
            return "cpu"
        return graphics[place % len(graphics)] if graphics else "cpu"
    if name not in available:
        raise DeviceError(f"--device {name}: not on this machine; allowed: {', '.join(available)}")
    return name


def free_memory(name: str) -> float:
    """[bytes] of memory that is free on a GPU; infinite for the CPU, whose memory is that of the machine (memory.py)."""
    return math.inf if name == "cpu" else float(wp.get_device(name).free_memory)
