"""Documents generated from the code: the tables of keys in docs/scenes.md, and docs/capabilities.md.

python docs/scene_reference.py        regenerates them
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from warpknit.scene.capabilities import AT_COMMAND, GROUPS, RULES, TRAITS
from warpknit.scene.keys import Key, keys_below
from warpknit.scene.scene import SceneFile

BEGIN, END = "<!-- keys of {}, written by docs/scene_reference.py -->", "<!-- end of keys -->"
SECTIONS = ("the file", *(name for name, entry in SceneFile.keys.items() if entry.table is not None and name != "path"))
COLUMNS = (*GROUPS[1], *GROUPS[2], *GROUPS[3], *GROUPS[0], "map", "trade", "report", "error", "ranks", "cuda")
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

Generated from `warpknit/scene/capabilities.py` by `python docs/scene_reference.py`. Excluded combinations are refused
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


def with_needs(names: Iterable[str]) -> frozenset[str]:
    """Traits and all that they imply."""
    found: set[str] = set()
    left = list(names)
    while left:
        name = left.pop()
        if name not in found:
            found.add(name)
            left += TRAITS[name].needs
    return frozenset(found)


def compatibility(one: str, other: str) -> str:
    """Whether two traits go together, whatever else a scene has: "yes", "no", "partly" (it depends on a third one), or "no
    effect"."""
    both = with_needs((one, other))
    if any(len(both & set(group)) > 1 for group in GROUPS) or any(rule.refused and rule.traits <= both for rule in RULES):
        return "no"
    between = [rule for rule in RULES if {one, other} == {rule.trait, *rule.others[:1]}]
    if any(rule.refused for rule in between):
        return "partly"
    return "no effect" if between else "yes"


def main(folder: Path) -> None:
    """Write the generated parts of the documents in `folder`."""
    path = folder / "scenes.md"
    path.write_text(with_key_tables(path.read_text(encoding="utf-8")), encoding="utf-8")
    (folder / "capabilities.md").write_text(capabilities_page(), encoding="utf-8")


if __name__ == "__main__":
    main(Path(__file__).parent)
