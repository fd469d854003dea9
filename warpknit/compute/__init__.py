"""Device and memory of a run, launches of kernels, threads, host arrays, ranks."""

from __future__ import annotations

# below, a GPU takes about as long as the CPU: an H100 beside 16 cores, meshes of 10,000 nodes
LEAST_NODES = 10_000
DEFAULT_DEVICE = f"the first CUDA device for meshes of {LEAST_NODES:,} nodes or more, else the CPU"


def device_of_mesh(nodes: int, device: str) -> str:
    """The device, or the CPU for meshes that are faster there."""
    return device if nodes >= LEAST_NODES else "cpu"
