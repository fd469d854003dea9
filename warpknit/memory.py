"""Main memory that a run needs, and that there is."""

from __future__ import annotations

import psutil

from .scene import Scene

LIBRARY_MEMORY = 512 * 2**20  # [bytes] of addresses that libraries may still take: threads, compiler, USD
# bytes at the peak of a run on the CPU, by model.kind and solver.precision; in space with the pairs of segments near each other
MEMORY_PER_NODE = {("planar", "single"): 420, ("planar", "double"): 520, ("spatial", "double"): 1_500}
USD_MEMORY_PER_NODE = 60  # bytes, of the process that writes scene.usda and of the frame that is handed to it


def required_memory(scene: Scene, nodes: int) -> int:
    """Bytes for so many nodes with their share of bodies."""
    wire = MEMORY_PER_NODE[scene.model.kind, scene.solver.precision]
    return (wire + USD_MEMORY_PER_NODE * scene.output.usd) * nodes


def available_memory() -> int:
    """Bytes of main memory that a run may take now, a limit of the process included."""
    available = int(psutil.virtual_memory().available)
    process = psutil.Process()
    if hasattr(process, "rlimit"):
        limit, _ = process.rlimit(psutil.RLIMIT_AS)
        if limit != psutil.RLIM_INFINITY:
            available = min(available, max(0, limit - process.memory_info().vms - LIBRARY_MEMORY))
    return available
