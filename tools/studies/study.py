"""Common parts of studies: command line, runs without files, tables, figures."""

from __future__ import annotations

import argparse
import csv
import math
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from warpknit.compute.device import start_warp
from warpknit.mechanics.protocols import Model
from warpknit.scene import Scene, make_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Record, Simulation

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

SCENES = Path(__file__).parents[2] / "scenes"
RESULTS = Path(__file__).parent / "results"
PICTURES = Path(__file__).parents[2] / "docs" / "images"
T = TypeVar("T")
Options: TypeAlias = Callable[[str, argparse.ArgumentParser], None]
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
CROSSES: dict[str, Any] = {"linestyle": "none", "marker": "x", "markersize": 8}  # a reference beside curves


def new_parser(text: str | None) -> argparse.ArgumentParser:
    """The command line of a study, described by the docstring of its file."""
    return argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)


def add_directory(parser: argparse.ArgumentParser, quick: str | None = None) -> None:
    """Add the argument DIR, and --quick with its effect where there is one."""
    text = "where tables and pictures go.  [default: tools/studies/results and docs/images, where they are kept]"
    parser.add_argument("directory", metavar="DIR", nargs="?", type=Path, help=text)
    if quick:
        parser.add_argument("--quick", action="store_true", help=quick)


def start_study(parser: argparse.ArgumentParser) -> argparse.Namespace:
    """Read the arguments of a study with stored tables, and start Warp; `--quick` needs a DIR."""
    given = parser.parse_args()
    if given.quick and given.directory is None:
        parser.error("--quick: give a DIR, the stored results are for the whole study")
    start_warp()
    return given


def run_one_of(text: str | None, studies: dict[str, Callable[[argparse.Namespace], None]], add: Options) -> int:
    """Run the study of a file that the command line names; `add` adds its arguments."""
    parser = new_parser(text)
    parsers = parser.add_subparsers(required=True, metavar=" | ".join(studies))
    for name, study in studies.items():
        each = parsers.add_parser(name)
        each.set_defaults(study=study)
        add(name, each)
    given = parser.parse_args()
    start_warp()
    given.study(given)
    return 0


def table_path(given: argparse.Namespace, name: str) -> Path:
    return (given.directory or RESULTS) / name


def picture_path(given: argparse.Namespace, name: str) -> Path:
    return (given.directory or PICTURES) / name


def scene_of(file: str, *overrides: str, path: Sequence[dict[str, Any]] = (), **tables: dict[str, Any]) -> Scene:
    """Scene in scenes/`file`, with `tables` merged, `path` as load steps after [load], and overrides.

    It is planar unless it names a model.
    """
    table = tomllib.loads((SCENES / file).read_text(encoding="utf-8"))
    for name, values in tables.items():
        table[name] = table.get(name, {}) | values
    table["model"] = {"kind": "planar"} | table.get("model", {})
    if path:
        table["path"] = list(path)
    return make_scene(table, overrides, path=SCENES / file)


def run(scene: Scene) -> Iterator[Record]:
    """The records of a run without files. Raises Diverged."""
    return run_model(build_model(scene))


def run_model(model: Model) -> Iterator[Record]:
    """The same of a model."""
    yield from Simulation(model).run()


def write_rows(path: Path, rows: Sequence[Any]) -> None:
    """A CSV file of dataclasses of one kind; numbers to five digits, as no result here holds more."""
    path.parent.mkdir(parents=True, exist_ok=True)
    aside = path.with_suffix(".part")
    with open(aside, "w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, [field.name for field in fields(rows[0])], lineterminator="\n")
        table.writeheader()
        for row in rows:
            table.writerow({key: _short(value) for key, value in asdict(row).items()})
    os.replace(aside, path)


def without_nan(row: Any) -> Any:
    """The same with None for missing numbers, which leaves cells empty."""
    none = [f.name for f in fields(row) if isinstance(value := getattr(row, f.name), float) and math.isnan(value)]
    return replace(row, **dict.fromkeys(none))


def _short(value: Any) -> Any:
    return f"{value:.5g}" if isinstance(value, float | np.floating) else value


def read_rows(path: Path, kind: type[T]) -> list[T]:
    """Rows of a CSV file by `write_rows`, as dataclasses; none without a file."""
    if not path.exists():
        return []
    kinds = {field.name: {"str": str, "int": int, "float": float}[str(field.type)] for field in fields(kind)}
    with open(path, newline="", encoding="utf-8") as file:
        return [kind(**{name: kinds[name](text or "nan") for name, text in line.items()}) for line in csv.DictReader(file)]


def show_rows(rows: Sequence[Any]) -> None:
    """The same rows on the screen, in columns."""
    cells = [[field.name for field in fields(rows[0])]]
    cells += [[str(_short(value)) for value in asdict(row).values()] for row in rows]
    widths = [max(len(line[k]) for line in cells) for k in range(len(cells[0]))]
    for line in cells:
        print("  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip())
    print(flush=True)


def new_figure(width: float, height: float, rows: int, columns: int) -> tuple[Figure, np.ndarray]:
    """A figure (sizes in inches) and its axes (rows, columns)."""
    figure = Figure(figsize=(width, height), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(rows, columns, squeeze=False)
    return figure, panels


def tidy(panels: np.ndarray, legend: bool = True) -> None:
    """Grid, no frame, legends."""
    axes: Axes
    for axes in panels.ravel():
        axes.grid(color="#DDDDDD", linewidth=0.6)
        axes.set_axisbelow(True)
        axes.spines[["top", "right"]].set_visible(False)
        if legend and axes.get_legend_handles_labels()[0]:
            axes.legend(frameon=False, fontsize=8)
