"""Kernel launches with arguments by name."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import warp as wp

from ..kernels.control import PARTIAL_COUNT
from ..kernels.row_sums import ROW_LANES, ROWS, sum_rows
from .host import is_in_place

SHARED_BY = "threads_a_block"  # argument of a kernel


class Launch(NamedTuple):
    """A kernel, its number of threads and its ordered arguments."""

    kernel: wp.Kernel
    threads: int
    arguments: list[Any]

    @property
    def block_dim(self) -> int | None:
        """Threads of a CUDA block: those that share arrays (kernels/native/sharing.h), or None for Warp's default."""
        names = [argument.label for argument in self.kernel.adj.args]
        return int(self.arguments[names.index(SHARED_BY)]) if SHARED_BY in names else None

    @property
    def overload(self) -> wp.Kernel:
        """The kernel, or its overload that accepts the arguments."""
        if not self.kernel.is_generic:
            return self.kernel
        types = (self.kernel, *((a.dtype, a.ndim) if isinstance(a, wp.array) else type(a) for a in self.arguments))
        if types not in _OVERLOADS:
            _OVERLOADS[types] = self.kernel.add_overload(self.kernel.infer_argument_types(self.arguments))
        return _OVERLOADS[types]

    def run(self, device: str) -> None:
        """Launch the kernel now."""
        if self.threads > 0:
            self.record(device).launch()

    def record(self, device: str) -> wp.Launch:
        """A recorded Warp launch, to repeat or to capture in a graph."""
        return wp.launch(
            self.overload, dim=self.threads, inputs=self.arguments, device=device, record_cmd=True, block_dim=self.block_dim
        )


def replay(launches: list[Launch], device: str) -> Callable[[], None]:
    """A function that repeats launches. It keeps the arguments, and costs a third of recorded launches on a CPU."""
    recorded = [launch.record(device) for launch in launches if launch.threads > 0]
    with wp.ScopedCapture(device=device) as capture:
        for one in recorded:
            one.launch()

    def repeat(_arguments: object = recorded) -> None:  # which a graph does not keep
        wp.capture_launch(capture.graph)

    return repeat


_OVERLOADS: dict[Any, wp.Kernel] = {}  # of generic kernels, by the types of the arguments, which are slow to resolve


def bind(kernel: wp.Kernel, threads: int, /, *sources: object, **named: object) -> Launch:
    """A launch of `kernel`: each argument is in `named`, or an attribute of exactly one of `sources`.

    Raises:
        TypeError: an argument is missing or ambiguous, or a name is not an argument of the kernel.
    """
    names = [argument.label for argument in kernel.adj.args]
    unknown = [name for name in named if name not in names]
    if unknown:
        raise TypeError(f"kernel {kernel.key} has no argument {', '.join(unknown)}; its arguments are {', '.join(names)}")
    launch = Launch(kernel, threads, [named[name] if name in named else _attribute(kernel, name, sources) for name in names])
    _ = launch.overload  # known before its module is compiled: one that comes later compiles all of the module again
    return launch


def _attribute(kernel: wp.Kernel, name: str, sources: tuple[object, ...]) -> object:
    """The attribute `name` of the one source that has it."""
    holders = [source for source in sources if hasattr(source, name)]
    if len(holders) != 1:
        types = ", ".join(type(source).__name__ for source in (holders or sources)) or "no source"
        fault = f"ambiguous: {types} have it" if holders else f"missing: neither named nor an attribute of {types}"
        raise TypeError(f"argument {name} of kernel {kernel.key} is {fault}")
    return getattr(holders[0], name)


FEW_ROWS = 64  # that one thread adds


def fewer_rows(partial: wp.array) -> tuple[list[Launch], wp.array]:
    """Launches that sum rows (row, PARTIAL_COUNT), and their at most FEW_ROWS results.

    None on the CPU, where a single thread adds them as fast.
    """
    launches: list[Launch] = []
    while not is_in_place(partial.device) and len(partial) > FEW_ROWS:
        rows = math.ceil(len(partial) / ROWS)
        fewer = wp.zeros((rows, int(PARTIAL_COUNT)), dtype=wp.float64, device=partial.device)
        launches.append(bind(sum_rows, rows * ROW_LANES, threads_a_block=ROW_LANES, partial=partial, fewer=fewer))
        partial = fewer
    return launches, partial
