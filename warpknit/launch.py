"""Launches of kernels, whose arguments are given by name."""

from __future__ import annotations

from typing import Any, NamedTuple

import warp as wp


class Launch(NamedTuple):
    """A kernel with its threads and all its arguments, in their order."""

    kernel: wp.Kernel
    threads: int
    arguments: list[Any]

    def run(self, device: str) -> None:
        """Launch the kernel now."""
        wp.launch(self.kernel, dim=self.threads, inputs=self.arguments, device=device)

    def record(self, device: str) -> wp.Launch:
        """The launch as Warp's own command, to be repeated or captured in a graph."""
        return wp.launch(self.kernel, dim=self.threads, inputs=self.arguments, device=device, record_cmd=True)


def bind(kernel: wp.Kernel, threads: int, /, *sources: object, **named: object) -> Launch:
    """A launch of `kernel` by so many threads: every argument as `named`, or else the attribute of that name of one of `sources`.

    Raises:
        TypeError: an argument is missing, or stands in several sources; or a name is no argument of the kernel.
    """
    names = [argument.label for argument in kernel.adj.args]
    unknown = [name for name in named if name not in names]
    if unknown:
        raise TypeError(f"kernel {kernel.key} has no argument {', '.join(unknown)}; it takes {', '.join(names)}")
    return Launch(kernel, threads, [named[name] if name in named else _found(kernel, name, sources) for name in names])


def _found(kernel: wp.Kernel, name: str, sources: tuple[object, ...]) -> object:
    """The attribute `name` of the one source that has it."""
    holders = [source for source in sources if hasattr(source, name)]
    if len(holders) == 1:
        return getattr(holders[0], name)
    types = ", ".join(type(source).__name__ for source in (holders or sources)) or "no source"
    if holders:
        raise TypeError(f"argument {name} of kernel {kernel.key} is ambiguous: {types} have it")
    raise TypeError(f"argument {name} of kernel {kernel.key} is missing: not named, and not in {types}")
