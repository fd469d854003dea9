"""Errors of the package, with their exit statuses.

The command line catches these in one place (`warpknit.commands.cli`). The text of an error is one line that a person can act on:
`FILE: KEY: what is wrong; what to write instead`, with the value that was given in the first part.

    try:
        warpknit.load_scene("scenes/atlas_cell.toml", {"wire.diameter": "15 kg"})
    except warpknit.errors.InputError as error:
        print(error)
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

FINISHED, FAULT, BAD_INPUT, DIVERGED, OUT_OF_RESOURCES, INTERRUPTED = 0, 1, 2, 3, 4, 130  # exit statuses


class WarpknitError(Exception):
    """Base of the errors that this package raises on purpose; `exit_code` is the status the command line returns."""

    exit_code = FAULT


class InputError(WarpknitError, ValueError):
    """An input is invalid: a scene, a key, a value, a unit, a device or a file."""

    exit_code = BAD_INPUT


class SceneError(InputError):
    """A scene file, or an override of it, that cannot be used. key: the dotted key at fault; "" of a whole file."""

    def __init__(self, message: str, key: str = "") -> None:
        super().__init__(message)
        self.key = key


class ModelError(InputError):
    """No model can be built from a valid scene."""


class MemoryNeeded(ModelError):
    """The model would not fit in memory; found when planned, before anything is allocated."""


class DeviceError(InputError):
    """The named device does not exist."""


class RunDirectoryError(InputError):
    """The run directory cannot be used: it contains a finished run, or it is not a directory."""


class ExportError(InputError):
    """There is no such export format, or its package is not installed."""


class MissingExtra(InputError, ImportError):
    """A package of an extra is not installed: the message names both."""


class Diverged(WarpknitError):
    """The run diverged: the message names the wire, the node, the load, the likely cause and what to change."""

    exit_code = DIVERGED
    is_final = False  # whether smaller increments of load would end so, too


class Overlapped(Diverged):
    """Wires overlap so deeply that they may pass through each other."""


class NoProgress(Diverged):
    """A load level made no progress towards convergence in many steps."""


class StepLimitExceeded(Diverged):
    """A load level took more steps than allowed: the message has its residual and the key to raise."""

    is_final = True


class NotCarried(Diverged):
    """A mesh strains without end under a tension that it cannot carry: the message has the largest tension that it carried."""

    is_final = True


class OutOfResources(WarpknitError):
    """Memory or disk ran out during a run: the message has the needed and the available amount."""

    exit_code = OUT_OF_RESOURCES


class BadValue(Exception):
    """A value that cannot be used, in a file not known here: key, fault and remedy."""

    def __init__(self, key: str, wrong: str, instead: str) -> None:
        super().__init__(f"{key}: {wrong}; {instead}")
        self.key, self.wrong, self.instead = key, wrong, instead


@contextmanager
def naming_arguments() -> Iterator[None]:
    """Name arguments in place of options in errors."""
    try:
        yield
    except InputError as error:
        raise type(error)(in_python(str(error))) from error


@contextmanager
def needing_extra(what: str, extra: str) -> Iterator[None]:
    """Raise `MissingExtra` for a package of `extra` that `what` needs."""
    try:
        yield
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        line = f'{what} needs the package {package} (extra "{extra}"); install it: pip install -e ".[{extra}]"'
        raise MissingExtra(line) from error


def in_python(message: str) -> str:
    """A message with options as arguments: --force as force=True, --fit-curve as fit_curve."""
    message = re.sub(r"(?<![\w-])--out (\S+?)(?=[:;,]?(?:\s|$))", r"out='\1'", message)
    message = re.sub(r"(?<![\w-])--(force|resume)\b", r"\1=True", message)
    return re.sub(r"(?<![\w-])--([a-z][a-z-]*)", lambda option: option[1].replace("-", "_"), message)
