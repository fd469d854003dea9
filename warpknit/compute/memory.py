"""Memory needed by a run, and memory available."""

from __future__ import annotations

import numpy as np
import psutil
import warp as wp

from ..base.errors import MemoryNeeded
from ..base.text import memory
from ..scene import Scene

LIBRARY_MEMORY = 512 * 2**20  # [bytes] of address space reserved for libraries: threads, compiler, USD
# peak bytes of a run on the CPU, and what friction between wires adds: slips and a second list of pairs; by model.kind and
# solver.precision; spatial: of a tight knit
MEMORY_PER_NODE = {
    ("planar", "single"): (420, 0),
    ("planar", "double"): (520, 0),
    ("spatial", "single"): (1_750, 1_000),
    ("spatial", "double"): (1_970, 1_000),
}
USD_MEMORY_PER_NODE = 60  # bytes, of the process that writes scene.usda and its frame


def required_memory(scene: Scene, nodes: int) -> int:
    """Bytes for a mesh of this many nodes, bodies included."""
    wire, friction = MEMORY_PER_NODE[scene.model.kind, scene.solver.precision]
    wire += friction * (scene.contact.friction > 0.0)
    return (wire + USD_MEMORY_PER_NODE * scene.output.usd) * nodes


def refuse_beyond_memory(size: str, scene: Scene, nodes: int, device: str = "cpu") -> None:
    """Raise `MemoryNeeded` for a mesh that does not fit in memory; size: its size in words.

    A mesh on a GPU is laid out in main memory first: it needs room in both.
    """
    needed, available = required_memory(scene, nodes), min(available_memory(), available_memory(device))
    if needed > available or nodes > np.iinfo(np.int32).max:
        room = f"{memory(needed)} of memory, and {memory(available)} are available"
        raise MemoryNeeded(f"{size}: {nodes:.3g} nodes need {room}; use a smaller mesh")


def available_memory(device: str = "cpu") -> int:
    """Bytes that are free where the arrays of a device lie: of main memory within the limit of the process, or on a GPU."""
    if device != "cpu":
        return int(wp.get_device(device).free_memory)
    available = int(psutil.virtual_memory().available)
    process = psutil.Process()
    if hasattr(process, "rlimit"):
        limit, _ = process.rlimit(psutil.RLIMIT_AS)
        if limit != psutil.RLIM_INFINITY:
            available = min(available, max(0, limit - process.memory_info().vms - LIBRARY_MEMORY))
    return available
