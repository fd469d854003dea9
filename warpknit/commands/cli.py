"""The command line. program.py turns exceptions into an exit status and one line."""

from __future__ import annotations

import json
import logging
import os
import webbrowser
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .. import __version__
from ..base.errors import DIVERGED, FINISHED, INTERRUPTED
from ..compute.ranks import Ranks
from .program import QUIET, RESULT_OPTIONS, Asked, Program, configure_logging, on_scene

if TYPE_CHECKING:
    from ..results.finding import ResultTable
    from ..runner.run_directory import CommandResult
    from ..scene import Scene

# NumPy's threads would take memory and cores from the time steps
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


@click.group(cls=Program, invoke_without_command=True, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, message="%(prog)s %(version)s")
@click.pass_context
def main(context: click.Context) -> None:
    """Mechanics of knitted metal meshes, wire by wire and contact by contact.

    SCENE is a TOML file, or the name of a scene that ships with warpknit (see `warpknit new --list`).

    Exit status: 0 finished, 2 invalid scene, key, value, unit, device or file, 3 diverged, 4 out of memory or disk, 130
    interrupted.
    """
    if not context.obj.is_first and context.invoked_subcommand != "run":
        context.exit()  # the first rank is enough
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


def open_scene(asked: Asked, command: str, ranks: Ranks, *, quiet: bool | None = None) -> tuple[Scene, Path]:
    """Load and check the scene, choose the directory, set up the log. Refuses by scene/capabilities.py."""
    configure_logging(logging.WARNING if (asked.quiet if quiet is None else quiet) else logging.INFO)
    from ..scene import load_scene
    from ..scene.capabilities import refuse
    from .run import default_directory

    loaded = load_scene(Path(asked.scene), asked.overrides, asked.preset, command=command, ranks=ranks.count)
    if command == "report":
        from ..studies.findings import report_scene

        report_scene(loaded, ranks=ranks.count)  # which has a sweep by default
    else:
        refuse(loaded, command, ranks=ranks.count)
    return loaded, Path(asked.out) if asked.out else default_directory(loaded)


def status_of(result: CommandResult[Any], asked: Asked, *, resume: bool = False) -> int:
    """Exit status of a command; prints why it did not finish, and how to continue it. resume: whether it resumes of itself."""
    from ..runner.interrupts import to_continue

    if result.exit_code != FINISHED:
        is_cut = result.exit_code == INTERRUPTED and result.goes_on
        go_on = to_continue("command", resume=asked.resume or resume, force=asked.force) if is_cut else ""
        click.echo(f"warpknit: {result.message}{go_on}", err=True)
    return int(result.exit_code)


def show(table: ResultTable, asked: Asked) -> None:
    """Print the table of a command, unless it is quiet."""
    from ..runner.summary_table import print_table

    if not asked.quiet:
        print_table(table.lines(verbose=asked.verbose))


def show_results(table: ResultTable, directory: Path, asked: Asked) -> None:
    """Print the table of a finished command and where its results are."""
    from ..results.finding import Finding

    show(replace(table, findings=(*table.findings, Finding("results", str(directory), short=True))), asked)


@main.command()
@on_scene(
    click.option("--error", metavar="PERCENT", help="Choose the cheapest settings within this error, and estimate the error."),
    *RESULT_OPTIONS,
)
def run(ranks: Ranks, asked: Asked, error: str | None) -> int:
    """Run SCENE and write its results to DIR."""
    if error is not None and asked.preset is not None:
        raise click.UsageError("--error: cannot be combined with --preset; give one of them.")
    quiet = asked.quiet or not ranks.is_first
    loaded, directory = open_scene(asked, "run" if error is None else "error", ranks, quiet=quiet)

    from ..reflection.study import read_findings
    from ..runner.summary_table import summary_table
    from .run import at_work, run_command

    with at_work(loaded, quiet=quiet) as progress:
        result = run_command(
            loaded, directory, device=asked.device, error=error, resume=asked.resume, force=asked.force, progress=progress,
            ranks=ranks,
        )  # fmt: skip
    if not ranks.is_first:
        return int(result.exit_code)
    if result.summary and (result.exit_code == FINISHED or (result.exit_code == DIVERGED and result.summary.stages)):
        show(summary_table(result.summary, directory, read_findings(directory, loaded)), asked)
    return status_of(result, asked)


@main.command("map")
@on_scene(*RESULT_OPTIONS)
def contact_map(ranks: Ranks, asked: Asked) -> int:
    """Run all loads of [sweep] in SCENE; write the map to DIR."""
    loaded, directory = open_scene(asked, "map", ranks)

    from ..reflection.study import read_findings
    from ..studies.contact_map import map_table
    from .run import at_work, map_command

    with at_work(loaded, quiet=asked.quiet) as progress:
        result = map_command(loaded, directory, resume=asked.resume, force=asked.force, progress=progress, device=asked.device)
    if result.exit_code == FINISHED:
        show_results(map_table(result.summary, *read_findings(directory, loaded)), directory, asked)
    return status_of(result, asked)


@main.command()
@on_scene(
    click.option("--against", type=click.Choice(["planar", "spatial"]), help="Model of the reference.  [default: the scene's]"),
    *RESULT_OPTIONS,
)
def trade(ranks: Ranks, asked: Asked, against: str | None) -> int:
    """Run SCENE at many settings; write errors and costs to DIR."""
    loaded, directory = open_scene(asked, "trade", ranks)

    from ..studies.trade import run_trade, trade_table
    from .run import at_work

    with at_work(loaded, quiet=asked.quiet) as progress:
        result = run_trade(
            lambda more, other: loaded.changed(more, other, command="trade"),
            out=directory, against=against, device=asked.device, resume=asked.resume, force=asked.force, progress=progress,
        )  # fmt: skip
    if result.exit_code == FINISHED:
        show_results(trade_table(result.summary), directory, asked)
    return status_of(result, asked)


@main.command()
@on_scene(
    click.option("--out", metavar="DIR", help="Directory of the results.  [default: runs/<scene name>]"),
    click.option("--force", is_flag=True, help="Replace finished results in DIR."),
    QUIET,
    click.option("--cards", metavar="CODE,...", help="FE codes to write the card for, such as nastran,abaqus.  [default: all]"),
    click.option("--areal-mass", metavar="MASS", help='Compare with a measured mass, such as "10 g/m^2".'),
    click.option("--fit-curve", metavar="FILE", help="Fit the loops to the biaxial test in a CSV file."),
    click.option(
        "--fit-loop-length",
        metavar="LENGTH",
        help='Fit the loops to their wire length, such as "5.6 mm", or each bar to its wire a course: "4.6 mm, 4.9 mm".',
    ),
    click.option("--openings", metavar="COUNT", help='Scale wales and courses to this density of openings, such as "12 /inch".'),
    click.option(
        "--tension", metavar="TENSION", help='Equibiaxial tension of the material card, such as "2 N/m".  [default: the optimum]'
    ),
)
def report(ranks: Ranks, asked: Asked, **options: str | None) -> int:
    """Write the design report and the material card of SCENE to DIR.

    A map of the same scene in DIR is reused.
    """
    from .report import report_command, report_request, report_table
    from .run import at_work

    request = report_request(**options)
    loaded, directory = open_scene(asked, "report", ranks)
    with at_work(loaded, quiet=asked.quiet) as progress:
        done = report_command(loaded, directory, request, force=asked.force, progress=progress, device=asked.device)
    if done.page is not None:
        show(report_table(done, directory), asked)
    return status_of(done.result, asked, resume=True)


@main.command()
@on_scene(click.option("--json", "as_json", is_flag=True, help="One JSON object instead of text."))
def plan(_ranks: Ranks, asked: Asked, as_json: bool) -> None:
    """Show the size, physics, memory, steps and time of a run of SCENE."""
    configure_logging(logging.INFO)
    from ..scene import load_scene

    loaded = load_scene(Path(asked.scene), asked.overrides, asked.preset)
    from .plan import make_plan
    from .run import naming_the_file

    with naming_the_file(loaded):
        planned = make_plan(loaded, asked.device)
    if as_json:
        click.echo(json.dumps(planned.as_dict(), allow_nan=False))
    else:
        show(planned.table(), asked)


@main.command("reflect")
@QUIET
@click.option(
    "--set",
    "overrides",
    multiple=True,
    metavar="KEY=VALUE",
    help='Set a key of [reflection], such as reflection.frequencies="1 to 40 GHz, 50". Repeatable.',
)
@click.argument("run_dir", metavar="DIR")
def reflect_states(run_dir: str, overrides: tuple[str, ...], quiet: bool) -> None:
    """Compute the reflection loss of the states of a run or map."""
    configure_logging(logging.WARNING if quiet else logging.INFO)
    from ..results.finding import ResultTable
    from ..runner.progress_display import progress_for
    from .run import reflect_command

    with progress_for(quiet=quiet) as progress:
        result = reflect_command(Path(run_dir), overrides, progress)
    show_results(ResultTable(tuple(result.findings)), Path(run_dir), Asked(run_dir, quiet=quiet))


@main.command()
@click.argument("run_dir", metavar="RUN_DIR")
@click.option("--to", metavar="usd|vtk|csv|png", required=True, help="Format of the files.")
def export(run_dir: str, to: str) -> None:
    """Write the recorded states of a run in another format."""
    configure_logging(logging.INFO)
    from ..export import export_run

    for path in export_run(Path(run_dir), to):
        click.echo(path)


@main.command()
@click.argument("run_dir", metavar="RUN_DIR")
@click.option("--host", default="localhost", show_default=True, help="Host name or address of the page.")
@click.option("--port", default=8080, type=click.IntRange(0, 65535), show_default=True, help="First port to try.")
@click.option("--browser/--no-browser", default=True, show_default=True, help="Open the page.")
def view(run_dir: str, host: str, port: int, browser: bool) -> None:
    """Show the records of a run in the browser, until Ctrl-C. Requires `pip install -e ".[view]"`."""
    from ..export.view import open_viewer

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
    "--courses", metavar="COUNT", help='Courses, such as "30 /inch"; a bare number is per inch.  [default: the knit\'s]'
)
@click.option("--wales", metavar="COUNT", help='Wales, such as "26 /inch"; a bare number is per inch.  [default: the knit\'s]')
@click.option("--plating", metavar="METAL,LENGTH", help='Coating of a wire, such as "gold, 0.2 um".  [default: none]')
@click.option("--ends", metavar="N", help="Wires knitted as one yarn.  [default: 1]")
@click.option("--diameter", metavar="LENGTH", help='Diameter of a wire, such as "15 um".  [default: 30 um]')
@click.option("--material", metavar="NAME", help="tungsten, molybdenum or gold.  [default: molybdenum]")
@click.option("--knit", metavar="NAME", help="A knit of --list.  [default: double-atlas]")
@click.option("--from", "source", metavar="NAME", help="Copy a scene of --list.")
@click.option("--list", "as_list", is_flag=True, help="List the knits with their chains, and the scenes; write nothing.")
@click.argument("file", metavar="[FILE]", required=False)
def new(file: str | None, as_list: bool, source: str | None, force: bool, **values: str | None) -> None:
    """Write a scene to start from, with comments, to FILE.

    FILE is named after the knit or scene by default. On a terminal, without --knit, it prompts for the missing options.
    """
    configure_logging(logging.WARNING)
    from ..runner.summary_table import print_table
    from .new import SceneRequest, ask, copy_scene, file_of, named_knit, names_list, new_command, on_terminal

    if as_list:
        click.echo("\n".join(names_list()))
        return
    given = {name: value for name, value in values.items() if value is not None}
    if source is not None:
        if given:
            raise click.UsageError(f"--from: cannot be combined with --{min(given)}; change the copy.")
        print_table(copy_scene(source, file_of(file or source, force=force)))
        return
    request, path = SceneRequest(**given), file_of(file, force=force) if file else None
    if "knit" not in given and on_terminal():
        request, path = ask(given, path, force=force)
    print_table(new_command(request, path or file_of(named_knit(request.knit).name, force=force), force=force))
