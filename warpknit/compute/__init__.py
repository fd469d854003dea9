"""Where a run computes: device and memory, launches of kernels, threads, arrays on the host, ranks that share a mesh."""
