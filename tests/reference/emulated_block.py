"""Kernels whose threads share a CUDA block, on the CPU: what they do under `__CUDA_ARCH__`, with a fiber a thread.

    use(folder, reversed_lanes=False)       before the kernels are imported, in a process with a kernel cache of its own

Warp's CPU blocks run each thread of a block as a fiber. They are replaced here by emulated_block.c, which has the exchanges of
warps as well, and runs the threads between two barriers in either order: a barrier that is missing changes the result. A compiler
of C is needed.
"""

from __future__ import annotations

import ctypes
import subprocess
from pathlib import Path
from typing import Any

import warp as wp
from warp._src import codegen, context

SOURCE = Path(__file__).with_suffix(".c")
# what native functions use of CUDA, where threads share a block; `mask`: of the lanes of a warp that take part
CUDA = r"""
#if WP_TILE_BLOCK_DIM > 1
#pragma clang diagnostic ignored "-Wpass-failed"
#define EMULATED_CUDA 1
#define __shared__ static
#define __device__
struct emulated_index { unsigned x; };
#define threadIdx (emulated_index{ (unsigned)wp_cpu_get_thread_idx() })
#define blockDim (emulated_index{ WP_TILE_BLOCK_DIM })
#define __syncthreads() wp_cpu_tile_sync()
struct emulated_exchange { unsigned long long value, result; unsigned mask; int source; };
template <typename T> static T emulated_of_lane(unsigned mask, T value, int source)
{
    emulated_exchange one = { 0, 0, mask, source };
    __builtin_memcpy(&one.value, &value, sizeof(T));
    wp_cpu_run_block(-1, 0, nullptr, nullptr, 0, &one);
    __builtin_memcpy(&value, &one.result, sizeof(T));
    return value;
}
static int emulated_lane() { return wp_cpu_get_thread_idx() % 32; }
template <typename T> static T __shfl_sync(unsigned mask, T value, int source, int width = 32)
{
    return emulated_of_lane(mask, value, emulated_lane() / width * width + source % width);
}
template <typename T> static T __shfl_xor_sync(unsigned mask, T value, int other, int width = 32)
{
    return emulated_of_lane(mask, value, emulated_lane() ^ other);
}
template <typename T> static T __shfl_up_sync(unsigned mask, T value, int lanes, int width = 32)
{
    const int own = emulated_lane(), source = own - lanes;
    return emulated_of_lane(mask, value, source < own / width * width ? own : source);
}
template <typename T> static T __shfl_down_sync(unsigned mask, T value, int lanes, int width = 32)
{
    const int own = emulated_lane(), source = own + lanes;
    return emulated_of_lane(mask, value, source >= own / width * width + width ? own : source);
}
static unsigned __ballot_sync(unsigned mask, bool is)
{
    emulated_exchange one = { is, 0, mask, 0 };
    wp_cpu_run_block(-2, 0, nullptr, nullptr, 0, &one);
    return (unsigned)one.result;
}
static void __syncwarp(unsigned mask = 0xffffffffu) { __ballot_sync(mask, false); }
static int min(int a, int b) { return a < b ? a : b; }
static int __ffs(unsigned bits) { return bits ? __builtin_ctz(bits) + 1 : 0; }
#endif
"""


def use(folder: Path, *, reversed_lanes: bool = False) -> None:
    """Build the fibers in `folder`, and have kernels that are imported from now on take the way of a GPU."""
    library = folder / "emulated_block.so"
    subprocess.run(["cc", "-O2", "-shared", "-fPIC", "-o", str(library), str(SOURCE)], check=True)
    fibers = ctypes.CDLL(str(library))
    fibers.emulated_block_order(int(reversed_lanes))
    fibers.emulated_block_runtime.restype = ctypes.c_void_p
    wp.init()
    if not context.runtime.llvm.wp_llvm_set_cpu_block_runtime(fibers.emulated_block_runtime()):
        raise RuntimeError("Warp did not take the fibers")
    wp.config.enable_cpu_blocks = True
    codegen.cpu_module_header += CUDA.replace("{", "{{").replace("}", "}}")
    native = wp.func_native

    def of_gpu(snippet: str, *given: Any, **named: Any) -> Any:
        return native(snippet.replace("__CUDA_ARCH__", "EMULATED_CUDA"), *given, **named)

    wp.func_native = of_gpu
