"""docs/reference/summary.md: keys of results from the code that writes them, their meanings from the docstrings of its modules.

python docs/summary_keys.py        writes it
"""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

from warpknit.measure import table
from warpknit.runner import answers, panel_report, summary

PAGE = Path(__file__).parent / "reference" / "summary.md"
LINE = re.compile(r"^    (?! )(\S+)  +(\S.*)$")
GROUPS = ("", "scene", "model", "solver", "quality", "mesh", "contacts", "wire", "hook")
MAPS = {"map": "map.csv", "details": "map_details.csv"}


def meanings(module: ModuleType) -> list[tuple[str, str]]:
    """Names and meanings that stand in the docstring of a module, line by line; a meaning may go on over lines."""
    found: list[tuple[str, str]] = []
    for line in (module.__doc__ or "").split("\n"):
        if start := LINE.match(line):
            found.append((start[1], start[2]))
        elif found and line.startswith(" " * 8):
            found[-1] = found[-1][0], f"{found[-1][1]} {line.strip()}"
    return found


def meanings_of_measures() -> dict[str, str]:
    """The same of the measures, for every class of contact."""
    found = dict(meanings(table))
    for line in table.MEASURES:
        if of_class := re.fullmatch(r"(active|force)_([B-Z])_(percent|N)", line.name):
            found[line.name] = found[f"{of_class[1]}_A_{of_class[3]}"]
    return found


def written_keys() -> list[str]:
    """Keys of summary.json that no table has: those of the dicts in `run_summary` and `stage_summary`, in their order."""
    found: list[str] = []
    for function in (summary.run_summary, summary.stage_summary):
        tree = ast.parse(inspect.getsource(function))
        inside = {
            id(child) for node in ast.walk(tree) if isinstance(node, ast.Dict) for child in ast.walk(node) if child is not node
        }
        for node in ast.walk(tree):
            if isinstance(node, ast.Return | ast.Assign | ast.AugAssign) and isinstance(node.value, ast.Dict | ast.BinOp):
                section = _section(node)
                dicts = [one for one in ast.walk(node.value) if isinstance(one, ast.Dict) and id(one) not in inside]
                found += [name for one in dicts for name in _names(one, section)]
        found += [f"{key}.{name}" for key, name in _assigned(tree)]
    return [name for name in dict.fromkeys(found) if name not in ("name", "panel")]


def _section(node: ast.stmt) -> str:
    """`quality.` of `last["quality"] = {...}` and of `sections["quality"] |= {...}`."""
    target = node.targets[0] if isinstance(node, ast.Assign) else getattr(node, "target", None)
    return f"{target.slice.value}." if isinstance(target, ast.Subscript) and isinstance(target.slice, ast.Constant) else ""


def _names(node: ast.Dict, before: str) -> Iterator[str]:
    for key, value in zip(node.keys, node.values, strict=True):
        if not isinstance(key, ast.Constant):
            continue
        if isinstance(value, ast.Dict):
            yield from _names(value, f"{before}{key.value}.")
        else:
            yield f"{before}{key.value}"


def _assigned(tree: ast.AST) -> Iterator[tuple[str, str]]:
    """Section and name of `sections["wire"]["name"] = value`."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign) and isinstance(target := node.targets[0], ast.Subscript):
            inner = target.value
            if (
                isinstance(inner, ast.Subscript)
                and isinstance(target.slice, ast.Constant)
                and isinstance(inner.slice, ast.Constant)
            ):
                yield inner.slice.value, target.slice.value


def summary_rows() -> list[tuple[str, str]]:
    """Every key of summary.json once, with its meaning, group by group."""
    listed, of_measures = dict(meanings(summary)), meanings_of_measures()
    keys = {name: listed[name] for name in written_keys() if name in listed} | {"probes": listed["probes"]}
    for line in table.MEASURES:
        if line.summary:
            keys[f"{line.summary}.{line.name}"] = of_measures[line.name]
    grouped = [row for group in GROUPS for row in keys.items() if row[0].rpartition(".")[0].partition(".")[0] == group]
    return [*grouped, *((f"panel.{name}", words) for name, words in meanings(panel_report))]


def _table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    lines = [head, tuple("---" for _ in head), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


def summary_table() -> str:
    """summary.json, in Markdown."""
    return _table(("key", "meaning"), [(f"`{name}`", words) for name, words in summary_rows()])


def answers_table() -> str:
    """The section `answers`."""
    return _table(("key", "meaning"), [(f"`{name}`", words) for name, words in meanings(answers)])


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

Generated from the code that writes them, by `python docs/summary_keys.py`. A unit is the end of a name.
Measures that a mesh or a model does not have are left out of its files.
[Scenes and results](../scenes.md#output-of-a-run) describes the files.

## summary.json

The values at the top level are those of the last stage; `stages` has the groups from `quality` on for each stage.

{summary_table}

## answers

The section `answers` of `summary.json`. [How contacts close](../scenes.md#answers).

{answers_table}

## history.csv and map.csv

The columns of `history.csv`, one row for each recorded state, and those of the tables of a map. `x` marks a column.
Columns with an `A` stand for each class of contact.

{history_table}
"""


def page() -> str:
    """The text of docs/reference/summary.md."""
    return TEXT.format(summary_table=summary_table(), answers_table=answers_table(), history_table=history_table())


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
