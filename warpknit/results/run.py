"""Results of a run, map, trade or report in its directory. States are read on use."""

from __future__ import annotations

import base64
import io
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from ..base.errors import RunDirectoryError, naming_arguments, needing_extra
from ..runner.run_directory import SUMMARIES, TABLES, Tree, directory_of, holds_killed_run
from ..runner.summary import Summary
from ..runner.summary_table import summary_table
from ..scene import Scene, load_scene
from ..studies.contact_map import MapSummary, map_table
from .finding import ResultTable
from .frame import Frame, WireLayout, state_file
from .table import AGAIN, Table, found, html_table, units

if TYPE_CHECKING:
    from ..export.run_record import RunRecord
    from ..export.view.viewer import Viewer

PICTURES = ("contact_map.png", "mesh.png", "hook.png", "trade.png", "curves.png")  # of figures/, the first that is there
PICTURE_WIDTH, PICTURE_COLOURS = 480, 128  # pixels, in a notebook
AXES = ("x", "y", "z")  # weft, warp, normal
PLACES = ("stage", "load_factor")  # columns that say where in the load history a record is
# of a frame: dimensions after the record, and unit; the number of contacts between stitches varies
FIELDS = {
    "node_position": (("node", "axis"), "m"),
    "node_stress": (("node",), "Pa"),
    "body_position": (("body", "axis"), "m"),
    "body_force": (("body",), "N"),
    "body_active": (("body",), ""),
    "pair_force": (("pair",), "N"),
    "pair_active": (("pair",), ""),
}


class States(Sequence[Frame]):
    """The recorded states of a run, one a row of its history: `states[-1].node_position`.

    Raises IndexError for a record that is not there, RunDirectoryError for a file that cannot be read.
    """

    def __init__(self, record: RunRecord | None) -> None:
        self._record = record

    @overload
    def __getitem__(self, which: int) -> Frame: ...
    @overload
    def __getitem__(self, which: slice) -> list[Frame]: ...
    def __getitem__(self, which: int | slice) -> Frame | list[Frame]:
        if isinstance(which, slice):
            return [self[index] for index in range(len(self))[which]]
        if self._record is None or not -len(self) <= which < len(self):
            instead = f"use {-len(self)} to {len(self) - 1}" if len(self) else "a map or an empty run has none"
            raise IndexError(f"states: {which} is not one of {len(self)} states; {instead}")
        return self._record.frame(which)

    def __len__(self) -> int:
        return 0 if self._record is None else len(self._record.states)

    def __repr__(self) -> str:
        return f"<{len(self)} states>"


class Series(Mapping[str, np.ndarray]):
    """Quantities of all records: columns of the history [record], and fields of the states, stacked [record, ...].

    A field is read from all states when it is asked for: `node_position` of a large mesh may not fit in memory.
    """

    def __init__(self, history: Table, states: States) -> None:
        self._history, self._states = history, states
        self._fields = FIELDS if len(states) else {}

    def __getitem__(self, name: str) -> np.ndarray:
        if name in self._fields:
            return np.stack([getattr(state, name) for state in self._states])
        return self._history[name] if name in self._history else found(dict.fromkeys(self, np.empty(0)), name)

    def __iter__(self) -> Iterator[str]:
        yield from self._history
        yield from self._fields

    def __len__(self) -> int:
        return len(self._history) + len(self._fields)

    def __repr__(self) -> str:
        return f"<{len(self)} quantities of {self._history.rows} records>"

    def to_xarray(self, names: Sequence[str] | None = None) -> Any:
        """An xarray.Dataset over `record`, by default of everything. Raises `MissingExtra` without xarray (extra `notebooks`).

        Coordinates: `record`, the index from 0; `stage` and `load_factor` of each record; `axis`, of positions: x, y, z.
        `attrs["units"]` of each variable is its unit (`units` in table.py); none for counts, shares and words.
        """
        with needing_extra("to_xarray()", "notebooks"):
            import xarray

        variables: dict[str, Any] = {}
        for name in self if names is None else names:
            dimensions, unit = FIELDS[name] if name in self._fields else ((), units(name).get("units", ""))
            variables[name] = (("record", *dimensions), self[name], {"units": unit} if unit else {})
        coordinates: dict[str, object] = {name: ("record", self[name]) for name in PLACES if name in self._history}
        coordinates["record"] = np.arange(self._history.rows)
        if any("axis" in variable[0] for variable in variables.values()):
            coordinates["axis"] = list(AXES)
        return xarray.Dataset({name: value for name, value in variables.items() if name not in coordinates}, coordinates)


class Run:
    """The results in a directory: `run`, `run_map`, `make_report` and `load_run` return one, in SI units.

        run = load_run("runs/atlas_cell")
        run.summary["mesh"]["tension_weft_N_per_m"], run.states[-1].node_position, run.observables["pair_force"]

    It has
        summary          nested dict: summary.json, or map.json, trade.json
        stop_reason      steady | finished | diverged | interrupted
        warnings         limits to the use of the results
        history          columns of history.csv by name, [record]; `to_pandas()`
        tables           every CSV file by name; of a map `tables["map"]`
        states           recorded states, by index; each a `Frame`: node_position (node, 3) [m], pair_force [pair] [N], ...
        observables      columns of the history and arrays of the states over all records, [record, ...]; `to_xarray()`
        layout           a `WireLayout`: which nodes make a wire, which wires a body hooks, the class of a contact
        answers          of a report or a run, as in answers.json
        scene, card, fit, figures, directory, export(to)
    Pairs 2b and 2b + 1 belong to body b, where two wires hook each other. help(run.states[-1]) has all fields of a state,
    help(run.layout) all fields of the layout.
    All but the summary is read on first access. docs/scenes.md explains each value.
    """

    def __init__(self, directory: Path, summary: Tree) -> None:
        self.directory = directory
        self.summary = summary  # summary.json, or map.json, or trade.json

    @property
    def name(self) -> str:
        """Name of the scene."""
        return str(self.summary["scene"]["name"])

    @property
    def stop_reason(self) -> str:
        """steady | finished | diverged | interrupted"""
        return str(self.summary["stop_reason"])

    @property
    def warnings(self) -> list[str]:
        """Limits to the use of the results, a sentence each."""
        return list(self.summary["warnings"])

    @cached_property
    def scene(self) -> Scene:
        """The scene, with every default written out."""
        return load_scene(self.directory / "scene.toml")

    @property
    def history(self) -> Table:
        """history.csv: one row a record. Of a map or a report without a run, a table without columns."""
        if "history" not in self.tables and self._has_records:
            raise RunDirectoryError(f"{self.directory / 'history.csv'}: no such file; {AGAIN}")
        return self.tables["history"] if "history" in self.tables else Table({})

    @cached_property
    def tables(self) -> Mapping[str, Table]:
        """Every CSV file of the directory, by its path without `.csv`: history, map, panel/map_000004."""
        return Tables(self.directory)

    @property
    def observables(self) -> Series:
        """Columns of the history and fields of the states, for all records; `to_xarray()` has them with their dimensions."""
        history, states = self.history, self.states
        if len(states) not in (0, history.rows):
            path = self.directory / "history.csv"
            raise RunDirectoryError(f"{path}: {history.rows} rows for {len(states)} states; {AGAIN}")
        return Series(history, states)

    @cached_property
    def states(self) -> States:
        """The recorded states, one a row of the history, each a `Frame`; none of a map. Where one is missing, all are refused."""
        return States(self._record if self._has_records else None)

    @property
    def layout(self) -> WireLayout:
        """Wires of nodes, wires of bodies, classes of contacts. Raises `RunDirectoryError` for a map."""
        return self._record.layout

    @property
    def _has_records(self) -> bool:
        """Whether it has recorded states: a run, not a map, a trade or a report."""
        return "stages" in self.summary and ("history" in self.tables or (self.directory / "states").is_dir())

    @cached_property
    def _record(self) -> RunRecord:
        """Layout and states, one a record. Raises RunDirectoryError where they are damaged or one is missing."""
        from ..export.run_record import read_run

        record = read_run(self.directory)
        for path in (state_file(self.directory, index) for index in range(max(len(record.states), self._records))):
            if not path.is_file():
                raise RunDirectoryError(f"{path}: no such file; {AGAIN}")
        return record

    @property
    def _records(self) -> int:
        """Number of rows of the history; 0 where it cannot be read."""
        try:
            return self.history.rows
        except RunDirectoryError:
            return 0

    @cached_property
    def card(self) -> Tree | None:
        """The material card of a report (material_card.json); None where there is none."""
        return _read_json(self.directory / "material_card.json")

    @cached_property
    def fit(self) -> Tree | None:
        """Fit of the scene to measured data (fit.json): factor, rms_error, notes; or None."""
        return _read_json(self.directory / "fit.json")

    @cached_property
    def answers(self) -> Tree | None:
        """The answers of a report (answers.json) or of a run (in its summary); None where there are none."""
        path = self.directory / "answers.json"
        return _read_json(path) if path.is_file() else self.summary.get("answers")

    @property
    def figures(self) -> list[Path]:
        """Pictures of the results."""
        return sorted((self.directory / "figures").glob("*.png"))

    def export(self, to: str) -> list[Path]:
        """Write the states as "usd", "vtk", "csv" or "png" into the directory; the files. Raises as `export_run` does."""
        from ..export import export_run

        with naming_arguments():
            return export_run(self.directory, to)

    def view(self, *, host: str = "localhost", port: int = 8080) -> Viewer:
        """Show the records in the browser and in a notebook, until its `stop()`. The result has the `url`.

        port: the first port to try. Needs the extra `view`. Raises `RunDirectoryError` for a map.
        """
        from ..export.view import open_viewer

        with naming_arguments():
            return open_viewer(self.directory, host=host, port=port)

    def __repr__(self) -> str:
        what = f"{self._records} records" if self._has_records else f"tables {', '.join(self.tables)}"
        return f"<Run {self.name!r}: {self.stop_reason}, {what}, in {self.directory}>"

    def _repr_html_(self) -> str:
        names = {path.name: path for path in self.figures}
        shown = [names[name] for name in PICTURES if name in names] or self.figures
        picture = ""
        if shown:
            data = base64.b64encode(_smaller(shown[0])).decode()
            picture = f'<img alt="{escape(shown[0].stem)}" width="{PICTURE_WIDTH}" src="data:image/png;base64,{data}"/>'
        return f"{html_table([(line.name, line.text) for line in self._table.lines()])}{picture}"

    @property
    def _table(self) -> ResultTable:
        if "cells" in self.summary:
            return map_table(MapSummary.of(self.summary))
        return summary_table(Summary.of(self.summary), self.directory)


def _smaller(picture: Path) -> bytes:
    """A PNG file at twice the width shown in a notebook, in few colours."""
    from PIL import Image  # of matplotlib

    data = io.BytesIO()
    with Image.open(picture) as image:
        image.thumbnail((2 * PICTURE_WIDTH, image.height))
        image.convert("RGB").quantize(PICTURE_COLOURS).save(data, "png", optimize=True)
    return data.getvalue()


def _read_json(path: Path) -> Tree | None:
    """The table in a JSON file; None where there is none. Raises RunDirectoryError."""
    try:
        table = json.loads(path.read_text(encoding="utf-8")) if path.exists() else None
    except (OSError, ValueError) as error:
        raise RunDirectoryError(f"{path}: unreadable ({error}); {AGAIN}") from error
    if not isinstance(table, dict | None):
        raise RunDirectoryError(f"{path}: not a file of a run; {AGAIN}")
    return table


class Tables(Mapping[str, Table]):
    """The CSV files of a directory, each read once when it is asked for."""

    def __init__(self, directory: Path) -> None:
        self._paths = {path.relative_to(directory).with_suffix("").as_posix(): path for path in sorted(directory.rglob("*.csv"))}
        self._read: dict[str, Table] = {}

    def __getitem__(self, name: str) -> Table:
        if name not in self._read:
            self._read[name] = Table.read(found(self._paths, name))
        return self._read[name]

    def __contains__(self, name: object) -> bool:
        return name in self._paths  # without reading it

    def __iter__(self) -> Iterator[str]:
        return iter(self._paths)

    def __len__(self) -> int:
        return len(self._paths)

    def __repr__(self) -> str:
        return f"<tables {', '.join(self)}>"


def load_run(out: str | os.PathLike[str]) -> Run:
    """Results of a run, map, trade or report in the directory `out`; also of an unfinished run.

        run = load_run("runs/atlas_cell")
        run.history["strain_weft"], run.history["tension_weft_N_per_m"]     # [record], [record] [N/m]

    help(warpknit.Run) lists the fields of the result. Raises RunDirectoryError if there are no results, if the run is in progress
    or was killed before it wrote a summary, or if a file cannot be read. History, tables, states, layout, observables and card
    are read on first access and raise the same error. The message names the file.
    """
    directory = directory_of(out, "load_run")
    for name in SUMMARIES:
        if (summary := _read_json(directory / name)) is not None:
            if not {"scene", "stop_reason", "warnings"} <= set(summary):
                raise RunDirectoryError(f"{directory / name}: not the summary of a run; {AGAIN}")
            return Run(directory, summary)
    if holds_killed_run(directory) or any((directory / name).is_file() for name in TABLES):
        raise RunDirectoryError(f"{directory}: the run has not ended; wait for it, or continue it with resume=True")
    wrong = "no results" if directory.is_dir() else "a file" if directory.exists() else "no such directory"
    raise RunDirectoryError(f"{directory}: {wrong}; give the directory of a run, map, trade or report")
