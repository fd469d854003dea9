"""Memory needed by a run, and memory available."""

from __future__ import annotations

import psutil

from .scene import Scene

LIBRARY_MEMORY = 512 * 2**20  # [bytes] of address space reserved for libraries: threads, compiler, USD
# peak bytes of a run on the CPU, by model.kind and solver.precision; spatial: with its list of segment pairs, twice as much of a
# tight knit
MEMORY_PER_NODE = {("planar", "single"): 420, ("planar", "double"): 520, ("spatial", "double"): 2_500}
USD_MEMORY_PER_NODE = 60  # bytes, of the process that writes scene.usda and its frame


def required_memory(scene: Scene, nodes: int) -> int:
    """Bytes for a mesh of this many nodes, bodies included."""
    wire = MEMORY_PER_NODE[scene.model.kind, scene.solver.precision]
    return (wire + USD_MEMORY_PER_NODE * scene.output.usd) * nodes


def available_memory() -> int:
    """Bytes of main memory available, within the limit of the process."""
    available = int(psutil.virtual_memory().available)
    process = psutil.Process()
    if hasattr(process, "rlimit"):
        limit, _ = process.rlimit(psutil.RLIMIT_AS)
        if limit != psutil.RLIM_INFINITY:
            available = min(available, max(0, limit - process.memory_info().vms - LIBRARY_MEMORY))
    return available
