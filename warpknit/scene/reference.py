"""Documents generated from the code: the tables of keys in docs/scenes.md, and docs/capabilities.md.

python -m warpknit.scene.reference docs        regenerates them
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

from .capabilities import AT_COMMAND, COLUMNS, GROUPS, RULES, TRAITS, compatibility
from .keys import Key, keys_below
from .scene import SceneFile

BEGIN, END = "<!-- keys of {}, written by warpknit.scene.reference -->", "<!-- end of keys -->"
SECTIONS = ("the file", *(name for name, entry in SceneFile.keys.items() if entry.table is not None and name != "path"))
HEADINGS = {"error": "run --error", "ranks": "mpirun", "cuda": "GPU"}  # of columns whose heading is not the name of their trait
UNSAID = {"elastic", "even loops", "no sweep"}  # defaults, which have no row


def with_key_tables(text: str) -> str:
    """Text of docs/scenes.md with its marked tables of keys replaced."""
    for section in SECTIONS:
        begin = BEGIN.format(section)
        if text.count(begin) != 1:
            raise ValueError(f"{begin}: stands {text.count(begin)} times; write it once")
        before, _, rest = text.partition(begin)
        _, end, after = rest.partition(END)
        text = "\n".join([before + begin, *key_rows(section), end + after])
    return text


def key_rows(section: str) -> Iterator[str]:
    """Lines of the table of keys for one table of a scene."""
    yield "| key | default | allowed | meaning |"
    yield "|---|---|---|---|"
    for name, entry in _keys(section):
        cells = (f"`{name}`", entry.default_text, allowed_text(entry), entry.about)
        yield row(cells)


def row(cells: Iterable[str]) -> str:
    """A row of a table in Markdown."""
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _keys(section: str) -> Iterator[tuple[str, Key]]:
    if section == SECTIONS[0]:
        yield from ((name, entry) for name, entry in SceneFile.keys.items() if entry.table is None)
        return
    table = SceneFile.keys[section].table
    assert table is not None
    for name, entry in keys_below(table, "" if section == "load" else f"{section}."):
        if entry.table is None:
            yield name.replace("[0]", "[]"), entry


def allowed_text(entry: Key) -> str:
    """Allowed values of a key; literals as code."""
    return re.sub(r"\['[^]]*'\]|'[^']*'", _as_code, entry.allowed)


def _as_code(found: re.Match[str]) -> str:
    text = found[0]
    return f"`{text[1:-1]}`" if text.startswith("'") else f"`{text.replace(chr(39), chr(34))}`"


CAPABILITIES = """# Compatibility of features

Generated from `warpknit/scene/capabilities.py` by `python -m warpknit.scene.reference docs`. Excluded combinations are refused
with a message of one line and exit status 2. Limits that depend on a size, a file or values of a model are not in this table.
A message states them. With `model.kind = "auto"` the model is spatial, unless the scene needs a feature of the planar model only.

An empty cell: the features are alternatives. *no effect*: the key changes nothing, and `warpknit plan` reports this. *partly*:
excluded together with a third feature, see below. A report includes a map, so features that exclude a map exclude a report.

"""


def capabilities_page() -> str:
    """The text of docs/capabilities.md."""
    return CAPABILITIES + "\n".join([*_matrix(), "", "## The limits", "", *_limits(), ""])


def _matrix() -> Iterator[str]:
    """Rows of traits, with columns for models, boundaries, drives, meshes and commands."""
    headings = [HEADINGS.get(name, name) for name in COLUMNS]
    yield row(["", "requested by", *headings])
    yield "|" + "---|" * (len(COLUMNS) + 2)
    for name, trait in TRAITS.items():
        if name not in AT_COMMAND and name not in UNSAID:
            cells = ("" if _alternatives(name, column) else compatibility(name, column) for column in COLUMNS)
            yield row([trait.words, f"`{trait.key}`", *cells])


def _limits() -> Iterator[str]:
    """The rules, what to write instead and why; equal ones share a row."""
    yield row(["", "not with", "instead", "why"])
    yield "|---|---|---|---|"
    alike: dict[tuple[str, ...], list[str]] = {}
    for rule in RULES:
        others = " and ".join(TRAITS[name].words for name in rule.others)
        alike.setdefault((others, rule.instead or "no effect", rule.why), []).append(TRAITS[rule.trait].words)
    for limit, traits in alike.items():
        yield row([", ".join(traits), *limit])


def _alternatives(one: str, other: str) -> bool:
    return one == other or any({one, other} <= set(group) for group in GROUPS)


def main(folder: Path) -> None:
    """Write the generated parts of the documents in `folder`."""
    path = folder / "scenes.md"
    path.write_text(with_key_tables(path.read_text(encoding="utf-8")), encoding="utf-8")
    (folder / "capabilities.md").write_text(capabilities_page(), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "docs"))
