"""`warpknit report` as a function."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from ..base.errors import INTERRUPTED, Diverged, InputError, naming_arguments
from ..base.text import either
from ..reflection.study import read_findings
from ..results.finding import Finding, ResultTable
from ..results.row import Values, write_json
from ..results.run import Run
from ..runner.progress_display import Display
from ..runner.run_directory import CommandResult, read_summary
from ..scene import Scene, load_scene
from ..scene.units import DIMENSIONS, QuantityError, has_unit, shown, si
from ..studies.contact_map import MapSummary, friction_findings, map_table, read_map
from ..studies.fe_codes import CODES
from ..studies.findings import Findings, report_scene
from ..studies.inputs import Fitted, Known, fitted_overrides, with_known, write_fit
from ..studies.report import write_report
from ..studies.sweep import run_map as sweep_scene
from .run import Directory, Source, finished_run, with_reflection


def make_report(
    scene: Source,
    out: Directory | None = None,
    *,
    tension: str | float | None = None,
    openings: str | float | None = None,
    fit_loop_length: str | float | Sequence[str | float] | None = None,
    fit_curve: Directory | None = None,
    areal_mass: str | float | None = None,
    cards: str | Sequence[str] | None = None,
    force: bool = False,
    quiet: bool = False,
) -> Run:
    """Write the design report of a scene into `out`; return the results.

        run = warpknit.make_report("scenes/contact_map.toml", "runs/report", tension="40 mN/m")
        run.card["values"]["C11"], run.directory / "report.html"      # stiffness [N/m], and the page

    tension: of the material card, in both directions; default: at the optimum of the map.
    openings: scale wales and courses to this density, "12 /inch". areal_mass: compare with this value, "10 g/m^2".
    fit_loop_length: fit the loops to their wire length, "5.6 mm", or each bar to its wire a course, ("4.6 mm", "4.9 mm").
    fit_curve: fit the loops to a biaxial test, a CSV file with the columns strain_weft, strain_warp, tension_weft_N_per_m,
    tension_warp_N_per_m. `run.scene` is then the fitted scene; `run.fit` has the factor on its loops, the rms error and notes.
    cards: FE codes for which the card is written, "nastran, abaqus" or a list; default: all of docs/fe_cards.md.
    Quantities are strings with their unit or numbers in SI. scene, out, force, quiet and exceptions: as in `run`. A map of the
    same scene in `out` is used. Raises Diverged if no state carries the tension of the card.
    """
    with naming_arguments():
        asked = report_request(
            tension=tension, openings=openings, fit_loop_length=fit_loop_length, fit_curve=fit_curve, areal_mass=areal_mass,
            cards=cards,
        )  # fmt: skip
    loaded = load_scene(scene, command="report")

    def command(where: Path, *, force: bool, progress: Display, **_resumed: bool) -> CommandResult[MapSummary]:
        return report_command(loaded, where, asked, force=force, progress=progress).result

    return finished_run(loaded, out, quiet, command, resume=True, force=force)


@dataclass(frozen=True)
class ReportRequest:
    """Options of a report."""

    tension: float | None = None  # [N/m]
    known: Known = Known()
    codes: tuple[str, ...] = tuple(CODES)  # FE codes of the cards

    def __post_init__(self) -> None:
        if unknown := set(self.codes) - set(CODES):
            raise InputError(f"--cards: {', '.join(map(repr, sorted(unknown)))} is unknown; give {either(list(CODES))}")
        if self.known.loop_length is not None and self.known.curve is not None:
            raise InputError("--fit-curve: cannot be combined with --fit-loop-length; give one of them")


def report_request(
    *,
    tension: str | float | None,
    openings: str | float | None,
    fit_loop_length: str | float | Sequence[str | float] | None,
    fit_curve: Directory | None,
    areal_mass: str | float | None,
    cards: str | Sequence[str] | None,
) -> ReportRequest:
    """The options of a report, checked. Raises `InputError`, which names the option."""
    return ReportRequest(
        _positive("--tension", tension, "tension"),
        Known(
            openings=_positive("--openings", openings, "per_length"),
            loop_length=lengths_of("--fit-loop-length", fit_loop_length),
            curve=None if fit_curve is None else Path(fit_curve),
            areal_mass=_positive("--areal-mass", areal_mass, "areal_mass"),
        ),
        tuple(CODES) if cards is None else tuple(dict.fromkeys(map(str.strip, _parts(cards)))),
    )


@dataclass(frozen=True)
class Report:
    """A report, its map, and how the scene was fitted."""

    result: CommandResult[MapSummary]
    notes: tuple[str, ...]
    page: Findings | None  # None where the map or the page was interrupted


def report_command(
    scene: Scene, out: Path, asked: ReportRequest, *, force: bool, progress: Display, device: str | None = None
) -> Report:
    """`warpknit report`: fits, map and page; exit status 3 where no state carries the tension of the card."""
    begin, known = time.perf_counter(), asked.known
    loaded = report_scene(scene)
    fitted = Fitted(loaded)
    if known.openings or known.loop_length:  # another knit, on which defaults may depend
        fitted = with_known(loaded, Known(known.openings, known.loop_length))
        loaded = report_scene(load_scene(scene, fitted_overrides(fitted.scene.knit), command="report"))
    fitted = fitted.then(with_known(loaded, Known(curve=known.curve, areal_mass=known.areal_mass), progress))
    notes, mapped = fitted.notes, time.perf_counter()
    command = partial(
        sweep_scene, fitted.scene, out=out, device=device, resume=not force, force=force, progress=progress, command="report",
        keep_states=fitted.scene.reflection is not None,
    )  # fmt: skip
    result = with_reflection(fitted.scene, out, progress, command)
    if result.exit_code != 0:
        return Report(result, notes, None)
    times = {"map": time.perf_counter() - mapped}
    rows = read_map(out / "map.csv", out / "map_details.csv")
    try:
        page = write_report(
            fitted.scene, rows, out, tension=asked.tension, notes=notes, codes=asked.codes, progress=progress,
            of_map=list(friction_findings(result.summary)), reflection=read_findings(out, fitted.scene),
        )  # fmt: skip
    except KeyboardInterrupt:
        return Report(CommandResult(INTERRUPTED, result.summary, f"interrupted; the map is kept in {out}"), notes, None)
    elapsed = Values(wall_s=time.perf_counter() - begin, stages_s=Values(**times, **page.times))
    known_waves = read_summary(out, "map.json") or {}
    waves = {name: known_waves[name] for name in ("reflection", "answers") if name in known_waves}
    summary = result.summary.changed(report=elapsed, **waves)
    if not page.earlier_kept:
        write_fit(fitted, out)
        write_json(out / "map.json", summary)
    if asked.tension is not None and page.card is None:
        return Report(CommandResult(Diverged.exit_code, summary, page.card_state), notes, page)
    return Report(CommandResult(0, summary), notes, page)


def report_table(done: Report, directory: Path) -> ResultTable:
    """The table of a report whose page is written."""
    page, summary = done.page, done.result.summary
    assert page is not None and summary is not None
    of_map = map_table(summary)
    lines = list(of_map.findings) + [Finding("mesh", note) for note in done.notes]
    lines += [*page.answer_lines, *page.reflection]
    lines.append(Finding("map", page.sweep_text))
    if done.result.exit_code == 0:
        lines.append(Finding("material card", page.card_state, short=True))
        lines += [Finding("", note) for note in page.file_notes]
    where = "not written: the earlier report is kept" if page.earlier_kept else str(directory / "report.html")
    lines.append(Finding("page", where, short=True))
    return ResultTable(tuple(lines), (*of_map.warnings, *page.warnings), "report.html")


def lengths_of(option: str, given: str | float | Sequence[str | float] | None) -> tuple[float, ...] | None:
    """Lengths in SI, or None where none was given: one, or several as a list or with commas. Raises `InputError`."""
    if given is None:
        return None
    parts = [given] if isinstance(given, int | float) else _parts(given)
    return tuple(value for part in parts if (value := _positive(option, part, "length")) is not None)


def _parts(given: str | Sequence[Any]) -> Sequence[Any]:
    return given.split(",") if isinstance(given, str) else given


def _positive(option: str, given: str | float | None, dimension: str) -> float | None:
    """A quantity in SI, or None where none was given. Raises `InputError` unless it is positive, and has a unit as text."""
    if given is None:
        return None
    if isinstance(given, str) and not has_unit(given.strip()):
        raise InputError(f"{option}: {shown(given)} has no unit; give {DIMENSIONS[dimension]}")
    try:
        value = si(given, dimension)
    except QuantityError as error:
        raise InputError(f"{option}: {error}") from error
    if value <= 0.0:
        raise InputError(f"{option}: {shown(given)} is not above 0; give {DIMENSIONS[dimension]}")
    return value
