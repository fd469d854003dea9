"""Device of a run, start of Warp, and compile times."""

from __future__ import annotations

import logging
import os
import re
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from types import SimpleNamespace

import warp as wp

from ..base.errors import DeviceError
from ..base.text import either
from . import device_of_mesh

_log = logging.getLogger(__name__)

NO_DRIVER = "Could not find or load the NVIDIA CUDA driver"  # what Warp's library prints on a machine without a GPU

COMPILED = r" took ([\d.]+) ms +\(compiled\)"  # in Warp's report of a compiled module


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
            wrong = f"no kernels can be written there ({(error.strerror or '').lower()})"
            raise DeviceError(
                f"{wp.config.kernel_cache_dir}: {wrong}; set WARP_CACHE_PATH to a directory that can be written to"
            ) from error
        finally:
            os.dup2(kept, 2)
            os.close(kept)
        said.seek(0)
        for line in said.read().decode(errors="replace").splitlines():
            if line.strip() and NO_DRIVER not in line:
                _log.warning("warning W65: Warp: %s", line)


@contextmanager
def compile_times() -> Iterator[list[float]]:
    """Compile times [s] of kernel modules, as Warp reports them; modules from the cache do not count."""
    logger, level = wp.get_logger(), wp.config.log_level
    times: list[float] = []

    def note(message: str) -> None:
        if found := re.search(COMPILED, message):
            times.append(1e-3 * float(found[1]))
        if level <= wp.LOG_INFO:
            logger.info(message)

    wp.set_logger(SimpleNamespace(debug=logger.debug, info=note, warning=logger.warning, error=logger.error))
    wp.config.log_level = min(level, wp.LOG_INFO)
    try:
        yield times
    finally:
        wp.config.log_level = level
        wp.set_logger(logger)


def devices() -> list[str]:
    """The Warp names of the devices of this machine."""
    start_warp()
    return [str(device) for device in wp.get_devices()]


def find_device(name: str | None, place: int = 0, nodes: Callable[[], int] | None = None) -> str:
    """Warp name of a device; None: the first CUDA device for meshes with enough `nodes`, else the CPU. The ranks of a machine,
    with `place` of this one among them, get its devices in turn. Raises `DeviceError`.
    """
    available = devices()
    if name is None:
        graphics = [d for d in available if d.startswith("cuda")]
        if not graphics:
            return "cpu"
        turn = graphics[place % len(graphics)]
        return turn if nodes is None else device_of_mesh(nodes(), turn)
    if name not in available:
        raise DeviceError(f"--device: {name!r} is not on this machine; write {either(available)}")
    return name
