"""The program behind the commands: options that they share, exit statuses, and one line for each exception, on all ranks."""

from __future__ import annotations

import atexit
import errno
import logging
import shutil
import signal
import sys
import traceback
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import wraps
from pathlib import Path
from typing import Any, NoReturn

import click

from ..base.errors import BAD_INPUT, FAULT, FINISHED, INTERRUPTED, OUT_OF_RESOURCES, WarpknitError
from ..compute import DEFAULT_DEVICE
from ..compute.ranks import Ranks, join_ranks, started_as

UNUSABLE_PATH = (errno.EACCES, errno.EPERM, errno.EROFS, errno.EEXIST, errno.ENOTDIR, errno.EISDIR, errno.ENAMETOOLONG)


def exit_status(error: BaseException) -> tuple[int, str] | None:
    """Exit status and line of an exception; None for a bug."""
    match error:
        case WarpknitError():
            return error.exit_code, str(error)
        case click.UsageError():
            command = "warpknit" if error.ctx is None or error.ctx.info_name is None else error.ctx.command_path
            return BAD_INPUT, f"{error.format_message().rstrip('. ')}. See '{command} --help'."
        case click.ClickException():
            return BAD_INPUT, error.format_message()
        case KeyboardInterrupt() | click.Abort():
            return INTERRUPTED, str(error) or str(error.__cause__ or "") or "interrupted"  # click puts Abort in its place
        case MemoryError():
            return OUT_OF_RESOURCES, f"memory ran out: {error or 'more is needed than available'}"
        case RuntimeError() if str(error).startswith("Failed to allocate"):  # Warp's arrays
            return OUT_OF_RESOURCES, f"memory ran out: {error}"
        case OSError() if error.errno in (errno.ENOSPC, errno.EDQUOT):
            return OUT_OF_RESOURCES, f"disk ran out: {_free(error.filename)}"
        case OSError() if error.errno in UNUSABLE_PATH and error.filename is not None:
            return BAD_INPUT, f"{error.filename}: {(error.strerror or '').lower()}; give a path that can be written to"
        case _:
            return None


def _free(path: str | None) -> str:
    for folder in Path(path).parents if path else ():
        if folder.is_dir():
            return f"{path} needs more than the available {shutil.disk_usage(folder).free / 1024:,.0f} KiB"
    return "no space left on the device"


class Program(click.Group):
    """A group of commands with exit statuses and errors of one line.

    With several ranks all end with the same status, and one of them prints the line.
    """

    def main(self, *args: Any, **options: Any) -> NoReturn:
        options["standalone_mode"] = False
        ranks: Ranks = Ranks()
        line = ""
        try:
            ranks = options["obj"] = join_ranks()
            status = super().main(*args, **options) or FINISHED
        except BaseException as error:
            known = exit_status(error)
            if known is None:
                if ranks.count == 1:
                    raise
                known = FAULT, traceback.format_exc()
            status, line = known
            if status != FAULT:
                line = f"warpknit: {' '.join(line.split())}"
        atexit.register(signal.signal, signal.SIGINT, signal.SIG_IGN)  # Ctrl-C while Python exits does not change the status
        status, speaks = ranks.leave(status)
        if line and speaks and (ranks.count > 1 or not started_as()):
            click.echo(line, err=True)
        ranks.end_all(status)
        sys.exit(status)


class StderrHandler(logging.Handler):
    """Writes to the current `sys.stderr`: above a progress bar, and into captured output."""

    def emit(self, record: logging.LogRecord) -> None:
        sys.stderr.write(f"{self.format(record)}\n")


def configure_logging(level: int) -> None:
    """Log lines of this package to stderr."""
    log = logging.getLogger("warpknit")
    log.handlers[:] = [StderrHandler()]
    log.setLevel(level)


@dataclass(frozen=True)
class Asked:
    """The scene of a command and its results, as typed."""

    scene: str
    overrides: tuple[str, ...] = ()
    preset: str | None = None
    device: str | None = None
    out: str | None = None
    resume: bool = False
    force: bool = False
    quiet: bool = False
    verbose: bool = False

    def __post_init__(self) -> None:
        if self.quiet and self.verbose:
            raise click.UsageError("--quiet: cannot be combined with --verbose; give one of them.")
        if self.resume and self.force:
            raise click.UsageError(
                "--resume: cannot be combined with --force; --resume continues the run in DIR, --force replaces it."
            )


SCENE_OPTIONS = (
    click.option("--verbose", is_flag=True, help="Print every row of the table and every warning."),
    click.option("--device", metavar="cpu|cuda:N", help=f"Default: {DEFAULT_DEVICE}."),
    click.option("--preset", metavar="draft|standard|reference", help="Accuracy preset, in place of solver.preset."),
    click.option(
        "--set",
        "overrides",
        multiple=True,
        metavar="KEY=VALUE",
        help='Set a key of the scene, such as wire.diameter="17 um". Repeatable.',
    ),
    click.argument("scene", metavar="SCENE"),
)
QUIET = click.option("--quiet", is_flag=True, help="Print errors only.")
RESULT_OPTIONS = (
    QUIET,
    click.option("--force", is_flag=True, help="Replace finished results in DIR."),
    click.option("--resume", is_flag=True, help="Continue an interrupted command in DIR."),
    click.option("--out", metavar="DIR", help="Directory of the results.  [default: runs/<scene name>]"),
)


def on_scene(*more: Callable[[Any], Any]) -> Callable[[Callable[..., Any]], Any]:
    """Add options of a scene and `more` to a command, as `Asked`."""

    def decorated(command: Callable[..., Any]) -> Any:
        @wraps(command)
        @click.pass_obj
        def called(ranks: Ranks, /, **given: Any) -> Any:
            asked = Asked(**{entry.name: given.pop(entry.name) for entry in fields(Asked) if entry.name in given})
            return command(ranks, asked, **given)

        for option in (*more, *SCENE_OPTIONS):
            called = option(called)
        return called

    return decorated
