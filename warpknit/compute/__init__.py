"""Where a run computes: device and memory, launches of kernels, threads, arrays on the host, ranks that share a mesh."""

from __future__ import annotations

# below, a GPU takes about as long as the CPU: an H100 beside 16 cores, meshes of 10,000 nodes
LEAST_NODES = 10_000
DEFAULT_DEVICE = f"the first CUDA device for meshes of {LEAST_NODES:,} nodes or more, else the CPU"


def device_of_mesh(nodes: int, device: str) -> str:
    """The device, or the CPU for a mesh of so few nodes that it is faster there."""
    return device if nodes >= LEAST_NODES else "cpu"
