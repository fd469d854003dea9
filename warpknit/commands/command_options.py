"""Options of the command line that several commands share, and the values of options; imports on demand."""

from __future__ import annotations

from typing import Any

import click

from warpknit.compute.device_choice import DEFAULT_DEVICE


def scene_options(command: Any) -> Any:
    """The argument and options of the scene."""
    for option in (
        click.option("--device", metavar="cpu|cuda:N", help=f"Default: {DEFAULT_DEVICE}."),
        click.option("--preset", metavar="draft|standard|reference", help="Accuracy against time; over solver.preset."),
        click.option(
            "--set",
            "overrides",
            multiple=True,
            metavar="KEY=VALUE",
            help='Another value for a dotted key of the scene, such as wire.diameter="17 um". Repeatable.',
        ),
        click.argument("scene", metavar="SCENE"),
    ):
        command = option(command)
    return command


def result_options(command: Any) -> Any:
    """The options of the output directory."""
    for option in (
        click.option("--quiet", is_flag=True, help="No progress, no log; results and warnings are printed."),
        click.option("--force", is_flag=True, help="Replace finished results in DIR."),
        click.option("--resume", is_flag=True, help="Continue an interrupted command in DIR."),
        click.option("--out", metavar="DIR", help="Where the results go.  [default: runs/<scene name>]"),
    ):
        command = option(command)
    return command


def refuse_both(resume: bool, force: bool) -> None:
    """Refuse --resume together with --force."""
    if resume and force:
        raise click.UsageError(
            "--resume: cannot be combined with --force; --resume continues the run in DIR, --force replaces it."
        )


def positive_lengths(option: str, given: str | None) -> tuple[float, ...] | None:
    """Lengths of an option in SI, with commas between them, or None."""
    if given is None:
        return None
    return tuple(value for text in given.split(",") if (value := positive_quantity(option, text.strip(), "length")) is not None)


def positive_quantity(option: str, given: str | None, dimension: str) -> float | None:
    """Value of an option in SI, or None; raises unless it has a unit and is positive."""
    from warpknit.commands.report import positive
    from warpknit.scene.units import DIMENSIONS, has_unit, shown

    if given is not None and not has_unit(given):
        raise click.UsageError(f"{option}: {shown(given)} has no unit; give {DIMENSIONS[dimension]}.")
    return positive(option, given, dimension)


class ExportFormat(click.ParamType):
    """An export format; the table is imported on demand."""

    name = "format"

    @property
    def _choice(self) -> click.Choice[str]:
        from warpknit.export import FORMATS

        return click.Choice(tuple(FORMATS))

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The format; raises for other names."""
        return self._choice.convert(value, param, ctx)

    def get_metavar(self, *where: Any, **more: Any) -> str | None:
        """The names for the usage line."""
        return self._choice.get_metavar(*where, **more)

    def get_missing_message(self, *where: Any, **more: Any) -> str | None:
        """The names for the error of a missing option."""
        return self._choice.get_missing_message(*where, **more)
