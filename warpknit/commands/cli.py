"""The command line: `warpknit run`, `warpknit plan`, `warpknit map`, `warpknit trade`, `warpknit report`, `warpknit export`,
`warpknit view`, `warpknit new`.

program.py turns exceptions into an exit status and one line.
"""

from __future__ import annotations

import json
import logging
import os
import webbrowser
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from warpknit.commands.command_options import (
    ExportFormat,
    positive_lengths,
    positive_quantity,
    refuse_both,
    result_options,
    scene_options,
)
from warpknit.commands.program import Program, configure_logging
from warpknit.compute.ranks import Ranks
from warpknit.errors import FINISHED, INTERRUPTED, Diverged

if TYPE_CHECKING:
    from warpknit.runner.run_directory import CommandResult
    from warpknit.scene import Scene

# NumPy's threads would take memory and cores from the time steps
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


@click.group(cls=Program, invoke_without_command=True, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="warpknit", message="%(prog)s %(version)s")
@click.pass_context
def main(context: click.Context) -> None:
    """Mechanics of knitted metal meshes, wire by wire and contact by contact.

    SCENE is a TOML file. Exit status: 0 finished, 2 bad scene, key, value, unit, device or file, 3 diverged, 4 out of
    memory or disk, 130 interrupted.
    """
    if not context.obj.is_first and context.invoked_subcommand != "run":
        context.exit()  # the first rank is enough
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


def open_scene(
    scene: str, overrides: tuple[str, ...], preset: str | None, out: str | None, command: str, *, quiet: bool, ranks: int = 1
) -> tuple[Scene, Path]:
    """Load the scene, refuse what does not go with the command (scene/capabilities.py), choose the directory, set up the log."""
    configure_logging(logging.WARNING if quiet else logging.INFO)
    from warpknit.commands.carried_out import default_directory
    from warpknit.scene import load_scene
    from warpknit.scene.capabilities import refuse

    loaded = load_scene(Path(scene), overrides, preset, command=command, ranks=ranks)
    if command == "report":
        from warpknit.design.findings import report_scene

        report_scene(loaded, ranks=ranks)  # which has a sweep by default
    else:
        refuse(loaded, command, ranks=ranks)
    return loaded, Path(out) if out else default_directory(loaded)


def unfinished(result: CommandResult, *, resume: bool, force: bool) -> int:
    """Print why a command did not finish, and how an interrupted one goes on; return its exit status.

    resume: whether it already resumes, of itself or by the option.
    """
    from warpknit.runner.interrupts import to_continue

    go_on = to_continue("command", resume=resume, force=force) if result.exit_code == INTERRUPTED else ""
    click.echo(f"warpknit: {result.message}{go_on}", err=True)
    return int(result.exit_code)


def finished(lines: Iterable[tuple[str, str]], directory: Path) -> int:
    """Print the table of a finished command; return its exit status."""
    from warpknit.runner.summary_table import print_table

    print_table([*lines, ("results in", str(directory))])
    return FINISHED


@main.command()
@scene_options
@result_options
@click.option("--error", metavar="PERCENT", help="Choose the cheapest settings within this error, and estimate the error.")
@click.pass_obj
def run(
    ranks: Ranks,
    scene: str,
    overrides: tuple[str, ...],
    preset: str | None,
    device: str | None,
    error: str | None,
    out: str | None,
    resume: bool,
    force: bool,
    quiet: bool,
) -> int:
    """Run SCENE and write its results to DIR."""
    refuse_both(resume, force)
    if error is not None and preset is not None:
        raise click.UsageError("--error: cannot be combined with --preset; give one of them.")
    quiet = quiet or not ranks.is_first
    command = "run" if error is None else "error"
    loaded, directory = open_scene(scene, overrides, preset, out, command, quiet=quiet, ranks=ranks.count)

    from warpknit.commands.carried_out import naming_the_file
    from warpknit.commands.run import run_command
    from warpknit.runner.progress_display import progress_for

    with naming_the_file(loaded), progress_for(quiet=quiet) as progress:
        result = run_command(
            loaded, directory, device=device, error=error, resume=resume, force=force, progress=progress, ranks=ranks
        )
    if not ranks.is_first:
        return int(result.exit_code)
    from warpknit.runner.summary_table import print_summary

    if result.exit_code == FINISHED or (result.exit_code == Diverged.exit_code and result.summary.get("stages")):
        print_summary(result.summary, directory)
    return FINISHED if result.exit_code == FINISHED else unfinished(result, resume=resume, force=force)


@main.command("map")
@scene_options
@result_options
@click.pass_obj
def contact_map(
    ranks: Ranks,
    scene: str,
    overrides: tuple[str, ...],
    preset: str | None,
    device: str | None,
    out: str | None,
    resume: bool,
    force: bool,
    quiet: bool,
) -> int:
    """Run the strains of SCENE's [sweep] and write the contact map to DIR."""
    refuse_both(resume, force)
    loaded, directory = open_scene(scene, overrides, preset, out, "map", quiet=quiet, ranks=ranks.count)

    from warpknit.commands.carried_out import naming_the_file
    from warpknit.commands.map import map_command
    from warpknit.runner.progress_display import progress_for
    from warpknit.studies.map_table import map_lines

    with naming_the_file(loaded), progress_for(quiet=quiet) as progress:
        result = map_command(loaded, directory, resume=resume, force=force, progress=progress, device=device)
    if result.exit_code != FINISHED:
        return unfinished(result, resume=resume, force=force)
    return finished(map_lines(result.summary), directory)


@main.command()
@scene_options
@result_options
@click.option("--against", type=click.Choice(["planar", "spatial"]), help="Model of the reference.  [default: the scene's]")
@click.pass_obj
def trade(
    ranks: Ranks,
    scene: str,
    overrides: tuple[str, ...],
    preset: str | None,
    device: str | None,
    against: str | None,
    out: str | None,
    resume: bool,
    force: bool,
    quiet: bool,
) -> int:
    """Measure speed against accuracy: run SCENE at many settings, write errors and costs to DIR."""
    refuse_both(resume, force)
    loaded, directory = open_scene(scene, overrides, preset, out, "trade", quiet=quiet, ranks=ranks.count)

    from warpknit.commands.carried_out import naming_the_file
    from warpknit.runner.progress_display import progress_for
    from warpknit.studies.study import run_trade
    from warpknit.studies.trade_summary import trade_lines

    with naming_the_file(loaded), progress_for(quiet=quiet) as progress:
        result = run_trade(
            lambda more, other: loaded.changed(more, other, command="trade"),
            out=directory, against=against, device=device, resume=resume, force=force, progress=progress,
        )  # fmt: skip
    if result.exit_code != FINISHED:
        return unfinished(result, resume=resume, force=force)
    return finished(trade_lines(result.summary), directory)


@main.command()
@scene_options
@click.option(
    "--tension", metavar="TENSION", help='Equibiaxial tension of the material card, such as "2 N/m".  [default: the optimum]'
)
@click.option("--openings", metavar="COUNT", help='Scale wales and courses to this density of openings, such as "12 /inch".')
@click.option(
    "--fit-loop-length",
    metavar="LENGTH",
    help='Fit the loops to their wire length, such as "5.6 mm", or by bar to the wire a course: "4.6 mm, 4.9 mm".',
)
@click.option("--fit-curve", metavar="FILE", help="Fit the loops to the biaxial test in a CSV file.")
@click.option("--areal-mass", metavar="MASS", help='Compare with a measured mass, such as "10 g/m^2".')
@click.option("--cards", metavar="CODE,...", help="FE codes to write the card for, such as nastran,abaqus.  [default: all]")
@click.option("--quiet", is_flag=True, help="No progress, no log; results and warnings are printed.")
@click.option("--force", is_flag=True, help="Replace finished results in DIR.")
@click.option("--out", metavar="DIR", help="Where the results go.  [default: runs/<scene name>]")
@click.pass_obj
def report(
    ranks: Ranks,
    scene: str,
    overrides: tuple[str, ...],
    preset: str | None,
    device: str | None,
    tension: str | None,
    openings: str | None,
    fit_loop_length: str | None,
    fit_curve: str | None,
    areal_mass: str | None,
    cards: str | None,
    quiet: bool,
    force: bool,
    out: str | None,
) -> int:
    """Write SCENE's report for the designer to DIR: contact map, curves, material card, openings, resistance.

    A map of the same scene in DIR is reused.
    """
    from warpknit.commands.carried_out import naming_the_file
    from warpknit.commands.report import ReportRequest, codes_of, report_command
    from warpknit.design.inputs import Known
    from warpknit.runner.progress_display import progress_for

    known = Known(
        positive_quantity("--openings", openings, "per_length"),
        positive_lengths("--fit-loop-length", fit_loop_length),
        Path(fit_curve) if fit_curve else None,
        positive_quantity("--areal-mass", areal_mass, "areal_mass"),
    )
    asked = ReportRequest(positive_quantity("--tension", tension, "tension"), known, codes_of(cards))
    loaded, directory = open_scene(scene, overrides, preset, out, "report", quiet=quiet, ranks=ranks.count)
    with naming_the_file(loaded), progress_for(quiet=quiet) as progress:
        done = report_command(loaded, directory, asked, force=force, progress=progress, device=device)
    if done.page is None:
        return unfinished(done.result, resume=True, force=force)
    from warpknit.runner.summary_table import print_table
    from warpknit.studies.map_table import map_lines

    lines = [("mesh", note) for note in done.notes] + list(done.page.answer_lines)
    lines += map_lines(done.result.summary)
    lines.append(("map", done.page.sweep_text))
    if done.result.exit_code == FINISHED:
        lines.append(("material card", done.page.card_state))
        lines += [("", note) for note in done.page.file_notes]
    lines += [("warning", warning) for warning in done.page.warnings]
    if not done.page.earlier_kept:
        lines.append(("page", str(directory / "report.html")))
    print_table(lines)
    if done.result.exit_code != FINISHED:
        raise Diverged(done.result.message)
    return FINISHED


@main.command()
@scene_options
@click.option("--json", "as_json", is_flag=True, help="One JSON object instead of text.")
def plan(scene: str, overrides: tuple[str, ...], preset: str | None, device: str | None, as_json: bool) -> None:
    """Estimate a run of SCENE: nodes, physics and why, memory, time step, steps, time."""
    configure_logging(logging.WARNING)
    from warpknit.scene import load_scene

    loaded = load_scene(Path(scene), overrides, preset)
    from warpknit.commands.carried_out import naming_the_file
    from warpknit.commands.plan import make_plan

    with naming_the_file(loaded):
        planned = make_plan(loaded, device)
    click.echo(json.dumps(planned.as_dict(), allow_nan=False) if as_json else "\n".join(planned.lines()))


@main.command()
@click.argument("run_dir", metavar="RUN_DIR")
@click.option("--to", type=ExportFormat(), required=True, help="Which files to write.")
def export(run_dir: str, to: str) -> None:
    """Write the recorded states of the run in RUN_DIR in another format."""
    configure_logging(logging.INFO)
    from warpknit.export import export_run

    for path in export_run(Path(run_dir), to):
        click.echo(path)


@main.command()
@click.argument("run_dir", metavar="RUN_DIR")
@click.option("--host", default="localhost", show_default=True, help="Name or address that the page is served at.")
@click.option("--port", default=8080, type=click.IntRange(0, 65535), show_default=True, help="First port to try.")
@click.option("--browser/--no-browser", default=True, show_default=True, help="Open the page.")
def view(run_dir: str, host: str, port: int, browser: bool) -> None:
    """Show the records of the run in RUN_DIR in the browser, until Ctrl-C. Needs the extra `view`."""
    from warpknit.export.view import open_viewer

    viewer = open_viewer(Path(run_dir), host=host, port=port)
    click.echo(f"{viewer.url} shows {run_dir}; Ctrl-C ends")
    if browser:
        webbrowser.open(viewer.url)
    try:
        viewer.wait()
    except KeyboardInterrupt:
        viewer.stop()


@main.command()
@click.option("--force", is_flag=True, help="Replace an existing FILE.")
@click.option("--model", metavar="auto|planar|spatial", help="Kind of model.  [default: auto]")
@click.option(
    "--load",
    metavar="LOAD",
    help='A strain such as "6 %" or a tension such as "2 N/m"; "6 %, 2 N/m" in weft and warp.  [default: the knit\'s]',
)
@click.option(
    "--courses", metavar="COUNT", help='Courses, such as "30 /inch"; a bare number counts an inch.  [default: the knit\'s]'
)
@click.option("--wales", metavar="COUNT", help='Wales, such as "26 /inch"; a bare number counts an inch.  [default: the knit\'s]')
@click.option("--plating", metavar="METAL,LENGTH", help='Coating of a wire, such as "gold, 0.2 um".  [default: none]')
@click.option("--ends", metavar="N", help="Wires knitted as one yarn.  [default: 1]")
@click.option("--diameter", metavar="LENGTH", help='Diameter of a wire, such as "15 um".  [default: 30 um]')
@click.option("--material", metavar="NAME", help="tungsten, molybdenum or gold.  [default: molybdenum]")
@click.option("--knit", metavar="NAME", help="A knit of --list.  [default: double-atlas]")
@click.option("--list", "as_list", is_flag=True, help="List the knits with their chains, and write nothing.")
@click.argument("file", metavar="[FILE]", required=False)
def new(file: str | None, as_list: bool, force: bool, **values: str | None) -> None:
    """Write a scene to start from, with comments, to FILE.

    FILE is named after the knit by default. On a terminal, without --knit, it asks for what the options leave open.
    """
    configure_logging(logging.WARNING)
    from warpknit.commands.new import checked_request, file_of, knit_list, new_command
    from warpknit.commands.questions import ask, on_terminal
    from warpknit.runner.summary_table import print_table

    if as_list:
        click.echo("\n".join(knit_list()))
        return
    given = {name: value for name, value in values.items() if value is not None}
    request, path = checked_request(given), file_of(file, force=force) if file else None
    if "knit" not in given and on_terminal():
        request, path = ask(given, path, force=force)
    print_table(new_command(request, path or file_of(request.named.name, force=force), force=force))
