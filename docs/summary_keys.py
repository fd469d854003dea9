"""Reference pages from the code that writes the results: docs/reference/summary.md (keys) and warnings.md.

python docs/summary_keys.py        writes both
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from textwrap import fill
from typing import Any, get_args, get_origin, get_type_hints

from warpknit.measure import table
from warpknit.reflection.table import LeastTension, LossRow
from warpknit.results import row
from warpknit.results.warning_kinds import INPUT, INVALID, KINDS, LIMITED
from warpknit.runner import answers, other_model, summary, variants

PAGE = Path(__file__).parent / "reference" / "summary.md"
WARNINGS_PAGE = PAGE.with_name("warnings.md")
FIELD = re.compile(r"^    (\w+): .*?  # (.*)$")
KEY = re.compile(r'^ {8,12}"?(\w+)"?[=:] ?.*?,  # (.*)$')
TABLE = re.compile(r'^ {8}(?:values\[)?"?(\w+)"?(?:\]? = \{|=Values\()$')
GROUPS = ("", "scene", "model", "solver", "quality", "mesh", "contacts", "wire", "hook")
MAPS = {"map": "map.csv", "details": "map_details.csv"}
TOP = ("version", "device", "stop_reason", "message", "warnings", "variants", "spatial_model", "jumps", "answers", "stages")
OF_CLASS = {
    "active": "share of the active pairs of a class",
    "force": "contact force that half of the pairs of a class reach",
}


def answers_rows(kind: type = answers.Answers, before: str = "") -> Iterator[tuple[str, str]]:
    """Keys of the answers and their meanings, from the fields of their types."""
    for part in reversed(kind.__mro__[: kind.__mro__.index(row.Row if issubclass(kind, row.Row) else row.Values)]):
        types = get_type_hints(part)
        for name, words in commented(part, FIELD).items():
            yield f"{before}{name}", words
            for inner, place in _types_in(types[name]):
                if name != "first_yield_interior" and inner.__module__ != row.__name__:
                    yield from answers_rows(inner, f"{before}{name}{place}.")


def _types_in(hint: Any) -> Iterator[tuple[type, str]]:
    """The types of values in a type: in a sequence at the place `[]`, else at ``."""
    if isinstance(hint, type) and issubclass(hint, row.Values):
        yield hint, ""
    for inner in get_args(hint):
        yield from ((one, "[]" if get_origin(hint) is Sequence else place) for one, place in _types_in(inner))


def commented(item: object, pattern: re.Pattern[str]) -> dict[str, str]:
    """Names and their comments in the source of a class or function. In a table after its name and a point."""
    found: dict[str, str] = {}
    table = ""
    for line in inspect.getsource(item).split("\n"):
        if inside := TABLE.match(line):
            table = f"{inside[1]}."
        elif start := pattern.match(line):
            found[table + start[1]] = start[2]
        elif re.match(r"^        [)}],?$", line):
            table = ""
        elif found and re.match(r"^ +# ", line):
            found[list(found)[-1]] += f" {line.strip(' #')}"
    return found


def meanings_of_measures() -> dict[str, str]:
    """Names and meanings of the measures, for every class of contact."""
    found = commented(row.Row, FIELD)
    for line in table.MEASURES:
        if of_class := re.fullmatch(r"(active|force)_([A-Z])_(percent|N)", line.name):
            found[line.name] = OF_CLASS[of_class[1]]
    return found


def summary_rows() -> list[tuple[str, str]]:
    """Every key of summary.json once, with its meaning, group by group."""
    fields, tables, errors = (
        commented(summary.Summary, FIELD), commented(summary.run_summary, KEY), commented(summary.Estimate, FIELD)
    )  # fmt: skip
    of_measures = meanings_of_measures()
    keys = {name: fields[name] for name in TOP} | tables | {"quality.estimated_error": errors.pop("error")}
    keys |= {f"quality.estimated_errors.{name}": words for name, words in errors.items()} | {"probes": of_measures["probes"]}
    for line in table.MEASURES:
        if line.summary:
            keys[f"{line.summary}.{line.name}"] = of_measures[line.name]
    grouped = [pair for group in GROUPS for pair in keys.items() if pair[0].rpartition(".")[0].partition(".")[0] == group]
    return [*grouped, *((f"panel.{name}", words) for name, words in panel_keys().items())]


def panel_keys() -> dict[str, str]:
    """Keys of the section `panel`."""
    found = commented(summary.panel_of, KEY)
    return dict(sorted(found.items(), key=lambda one: one[0].startswith("surface.")))


def _table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    lines = [head, tuple("---" for _ in head), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


def summary_table() -> str:
    """summary.json, in Markdown."""
    return _table(("key", "meaning"), [(f"`{name}`", words) for name, words in summary_rows()])


def answers_table() -> str:
    """The section `answers`."""
    return meanings_table([*answers_rows(), *answers_rows(LeastTension, "reflection[].")])


def meanings_table(rows: Iterable[tuple[str, str]]) -> str:
    """Keys and their meanings."""
    return _table(("key", "meaning"), [(f"`{name}`", words) for name, words in rows])


def history_table() -> str:
    """The columns of history.csv, and the tables of a map that have the same."""
    of_measures, rows = meanings_of_measures(), {}
    for line in table.MEASURES:
        if (line.history or line.map) and not re.search(r"_[B-Z]_(percent|N)$", line.name):
            history, maps = rows.get(line.name, (False, ""))
            rows[line.name] = history or line.history, MAPS.get(line.map, maps)
    cells = [(f"`{name}`", of_measures[name], "x" if history else "", maps) for name, (history, maps) in rows.items()]
    return _table(("name", "meaning", "history.csv", "map"), cells)


TEXT = """# Names of the results

Generated from the code that writes them, by `python docs/summary_keys.py`. A name ends in its unit.
Measures that do not apply to a mesh or a model are left out of its files.
[Scenes and results](../scenes.md#output-of-a-run) describes the files.

## summary.json

The values at the top level belong to the last load step. `stages` has the groups from `quality` on for each load step.

{summary_table}

## answers

The section `answers` of `summary.json`. [Definitions](../scenes.md#answers). A state has `strain_weft`, `strain_warp`,
`tension_weft_N_per_m`, `tension_warp_N_per_m` and `temperature_K`.
Scenes with `[reflection]` also have `reflection`, here and in `map.json`.

{answers_table}

## variants

A run with `variants.count` above 1 has the section `variants` in `summary.json`. Each value, such as
`tension_weft_N_per_m` or `active_percent`, has these keys:

{spread_table}

{means_table}

In `history.csv` the columns `p10_...` and `p90_...` are these percentiles of each record.
`variants.csv` has one row for each mesh and record.

## spatial_model

A planar tile has the section `spatial_model` in `summary.json`: means of the spatial model under the same load.
It is left out if this would take more than seconds.

{spatial_table}

## history.csv and map.csv

`history.csv` has one row for each record; a map has the tables `map.csv` and `map_details.csv`. `x` or a file name marks the
columns of each. A name with `A` stands for such a column of each class of contact.

{history_table}

## reflection.csv

One row for each state, frequency and state of the contacts, with `[reflection]` ([theory](../theory/reflection.md)).
The section `reflection` of `summary.json` and `map.json` has the columns from `frequency_Hz` on, for one state. For a run this is
the last state. For a map it is the state at the least tension for the highest frequency. In this section `loss_open_te_dB`,
`loss_open_tm_dB`, `loss_closed_te_dB` and `loss_closed_tm_dB` are with all contacts open and all closed; they are null where
they were not solved.

{reflection_table}
"""


def page() -> str:
    """The text of docs/reference/summary.md."""
    return TEXT.format(
        summary_table=summary_table(),
        answers_table=answers_table(),
        means_table=meanings_table(answers_rows(variants.Means)),
        spread_table=meanings_table(answers_rows(variants.Spread)),
        spatial_table=meanings_table(answers_rows(other_model.SpatialMeans)),
        history_table=history_table(),
        reflection_table=_table(("name", "meaning"), [(f"`{name}`", words) for name, words in commented(LossRow, FIELD).items()]),
    )


WARNINGS = """# Warnings

Generated from `warpknit/results/warning_kinds.py`, by `python docs/summary_keys.py`.

A warning has a code, a fact and an advice. The three most serious are printed below the table; `--verbose`, `summary.json` and
`map.json` have all.

{contents}

## General limits

These limits apply to every run of their kind, so no run prints them.

- **Tight knits have several equilibria.** With other nodes or load levels, a tricot or a locknit may find another equilibrium
  under the same load. `warpknit plan --verbose` shows the measured accuracy of the preset. Compare with
  `model.nodes_per_loop = 40` and other `output.frames`. [Choose the accuracy](../how-to/accuracy.md)
- **A gripped patch leaves out cut pieces of wire** without a clasp, or shorter than a quarter of a loop. `--verbose` and
  `model.notes` in `summary.json` have their number.
- **A load level may take several increments** where a larger increment did not converge: `solver.notes`.
- **A map and a material card are at the temperature of `[load]`.** They do not run the load steps of `[[path]]`. For another
  temperature use `--set load.temperature`.

## The warnings

{sections}
"""
RANKS = {
    INVALID: "**Do not use the result** before you have resolved these:",
    LIMITED: "**Use the result with care:**",
    INPUT: "**Check the scene:**",
}
WIDTH = 130  # of a line


def _links(rank: int) -> str:
    """A list of the warnings of a rank."""
    return "\n".join(f"- [{code}](#{code.lower()}) {kind.title}" for code, kind in KINDS.items() if kind.rank == rank)


def warnings_page() -> str:
    """The text of docs/reference/warnings.md."""
    sections = (
        f"({code.lower()})=\n### {code}: {kind.title}\n\n{fill(kind.meaning, WIDTH)}\n\n**Advice.** {kind.advice}"
        for code, kind in KINDS.items()
    )
    contents = "\n\n".join(f"{words}\n\n{_links(rank)}" for rank, words in RANKS.items())
    return WARNINGS.format(contents=contents, sections="\n\n".join(sections))


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    WARNINGS_PAGE.write_text(warnings_page(), encoding="utf-8")
