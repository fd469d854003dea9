"""Measures of the design as a whole, with the values that are wanted: how much there is, and how often it is said.

    python tools/lint/measures.py [FOLDER]          of the project in FOLDER; exit status 0 whatever they are

A line each: measure, value now, value wanted. Names are read from the syntax trees of warpknit/ and kernels/.
"""

from __future__ import annotations

import ast
import re
import sys
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

ROOT = Path(__file__).parents[2]
KINDS = {"planar", "spatial"}  # kinds of model
KIND_FILE = "warpknit.model"  # the only one that distinguishes kinds
CONTROL_FILE = "warpknit.compute.steering"  # which has the typed class
NO_ROOMS = {"__init__.py", "__main__.py", "py.typed", "__pycache__"}
STATEMENTS = re.compile(r";[ \t]*(?://.*)?\n")  # ends of lines of C++
SMALL = 130  # lines of a file


@dataclass(frozen=True)
class Module:
    """A Python file: its name with dots, as it is imported, its text and its syntax tree."""

    name: str
    path: Path

    @cached_property
    def text(self) -> str:
        return self.path.read_text(encoding="utf-8")

    @cached_property
    def nodes(self) -> list[ast.AST]:
        return list(ast.walk(ast.parse(self.text)))

    @property
    def lines(self) -> int:
        return self.text.count("\n")

    @property
    def room(self) -> str:
        return self.name.rpartition(".")[0]

    def imported(self, known: set[str]) -> Iterator[str]:
        """Modules among `known` that it imports, wherever the statement stands."""
        is_folder = self.path.name == "__init__.py"
        package = self.name.split(".") if is_folder else self.name.split(".")[:-1]
        for node in self.nodes:
            if isinstance(node, ast.Import):
                yield from (alias.name for alias in node.names if alias.name in known)
            if isinstance(node, ast.ImportFrom):
                above = package[: len(package) - node.level + 1] if node.level else []
                base = ".".join([*above, *([node.module] if node.module else [])])
                inside = {f"{base}.{alias.name}" for alias in node.names} & known
                yield from inside or {base} & known


def modules(folder: Path, package: str) -> list[Module]:
    found = []
    for path in sorted(folder.rglob("*.py")):
        parts = [package, *path.relative_to(folder).with_suffix("").parts]
        found.append(Module(".".join(parts[:-1] if parts[-1] == "__init__" else parts), path))
    return found


def is_protocol(node: ast.AST) -> bool:
    return isinstance(node, ast.ClassDef) and any(
        re.fullmatch(r"(typing\.)?Protocol(\[.*\])?", ast.unparse(base)) for base in node.bases
    )


def flags(every: list[Module]) -> set[str]:
    """Names of the constants by which classes say what kind they are: `name: ClassVar[bool]`."""
    nodes = [node for module in every for node in module.nodes if isinstance(node, ast.AnnAssign)]
    return {ast.unparse(node.target) for node in nodes if ast.unparse(node.annotation) == "ClassVar[bool]"}


def tells_kinds_apart(node: ast.AST, flags: set[str]) -> bool:
    """A comparison with a kind of model, a look-up by it, or a flag."""
    if isinstance(node, ast.Compare):
        return any(isinstance(part, ast.Constant) and part.value in KINDS for part in [node.left, *node.comparators])
    if isinstance(node, ast.Subscript):
        return ast.unparse(node.slice).endswith("model.kind")
    return isinstance(node, ast.Attribute) and node.attr in flags


def is_state_dict(node: ast.AST) -> bool:
    return isinstance(node, ast.FunctionDef) and node.name == "state_dict"


def is_untyped(node: ast.AST) -> bool:
    return isinstance(node, ast.Subscript) and ast.unparse(node) == "dict[str, Any]"


def is_entry_of_vars(node: ast.AST) -> bool:
    return isinstance(node, ast.Subscript) and ast.unparse(node.value).startswith("vars(")


def control_entries(module: Module) -> int:
    """Reads of `c.NAME`, where c is kernels/control.py."""
    imports = [node for node in module.nodes if isinstance(node, ast.ImportFrom) and (node.module or "").endswith("kernels")]
    names = {alias.asname or alias.name for node in imports for alias in node.names if alias.name == "control"}
    reads = (node for node in module.nodes if isinstance(node, ast.Attribute) and node.attr.isupper())
    return sum(ast.unparse(node.value) in names for node in reads)


def cpp_lines(module: Module) -> int:
    """Lines of strings that are C++."""
    strings = [node.value for node in module.nodes if isinstance(node, ast.Constant) and isinstance(node.value, str)]
    return sum(text.strip().count("\n") + 1 for text in strings if len(STATEMENTS.findall(text)) > 1)


def repeated_classes(every: list[Module]) -> int:
    """Class names that two modules or more define."""
    named = [{node.name for node in module.nodes if isinstance(node, ast.ClassDef)} for module in every]
    return sum(count > 1 for count in Counter(name for names in named for name in names).values())


def small_files(every: list[Module]) -> int:
    """Files of fewer than SMALL lines whose one importer stands in their own room."""
    importers = defaultdict(set)
    for module in every:
        for name in module.imported({module.name for module in every}):
            importers[name].add(module.name)
    room = {module.name: module.room for module in every}
    found = [module for module in every if module.lines < SMALL and len(importers[module.name]) == 1]
    return sum(room[next(iter(importers[module.name]))] == module.room for module in found)


def measures(root: Path) -> Iterator[tuple[str, int, int]]:
    """Name of each measure, its value and the most that is wanted."""
    host, kernels = modules(root / "warpknit", "warpknit"), modules(root / "kernels", "warpknit.kernels")
    every = host + kernels

    def count(found: Callable[[ast.AST], bool], among: list[Module] = host) -> int:
        return sum(found(node) for module in among for node in module.nodes)

    rooms = [path for path in (root / "warpknit").iterdir() if path.name not in NO_ROOMS]
    yield "lines in warpknit/", sum(module.lines for module in host), 32_000
    yield "lines in kernels/ (Python)", sum(module.lines for module in kernels), 8_000
    yield "rooms at the top of warpknit/", len(rooms), 18
    yield "Protocol classes", count(is_protocol), 6
    elsewhere = [module for module in host if module.name != KIND_FILE]
    by_kind = count(partial(tells_kinds_apart, flags=flags(host)), elsewhere)
    yield "branches and look-ups by the kind of model outside one file", by_kind, 0
    yield "class names defined in two or more modules", repeated_classes(every), 8
    yield "state_dict methods", count(is_state_dict), 8
    untyped = [module for module in host if module.name != CONTROL_FILE]
    yield "c.NAME of the control array outside one typed class", sum(map(control_entries, untyped)), 0
    yield "dict[str, Any]", count(is_untyped), 30
    yield "vars(row)[...]", count(is_entry_of_vars), 0
    yield "lines of C++ inside Python strings", sum(map(cpp_lines, kernels)), 0
    yield f"files under {SMALL} lines with a single importer in their own room", small_files(every), 0


def main(arguments: list[str]) -> int:
    print(f"{'measure':70} {'now':>7} {'wanted':>9}")
    for name, now, wanted in measures(Path(arguments[0]) if arguments else ROOT):
        print(f"{name:70} {now:7,} {'<= ' if wanted else ''}{wanted:{6 if wanted else 9},}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
