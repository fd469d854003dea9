"""Checks the rules that kernels follow and that no general linter knows.

    python tools/lint/lint_kernels.py [FILE]...          all of kernels/ without a FILE; exit status 1 where a rule is broken

* A kernel file begins with a docstring and does not print.
* It imports `typing`, `warp` and its neighbours, nothing else; the loader of C++ also `collections`, `pathlib` and `re`.
* C++ stands in files of native/, never in a string.
* Arguments of a kernel and of a native function stand in groups, each under a comment; every argument has a type.
* The comment above arrays begins with what happens to them: "in", "out" or "in and out" (or "state in" ...), and it is what the
  body does: an array "in" is read and never written, one "out" is written and never read but to add to it, one "in and out"
  both. Functions that an array is handed to are followed; a native function writes through pointers that are not const.
* Arguments that end in `_in` stand in a group "in", those that end in `_out` in one "out", and no argument of a group "in"
  comes behind one of a group "out".
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import ClassVar

KERNELS = Path(__file__).parents[2] / "kernels"
ALLOWED_IMPORTS = {"typing", "warp"}
LOADER, IMPORTS_OF_LOADER = "native_text", {"collections", "pathlib", "re"}
STATEMENTS = re.compile(r";[ \t]*(?://.*)?\n")  # ends of lines of C++
DIRECTION = re.compile(r"(?:state )?(in and out|in|out)(?=$|[:,])")
READ, WRITTEN, ADDED, MAYBE_READ = "read", "written", "added to", "perhaps read"
Effects = frozenset[str]


def faults(path: Path) -> Iterator[str]:
    """A line for every rule that a kernel file breaks."""
    file = KernelFile(path)
    if not ast.get_docstring(file.tree):
        yield f"{path}:1: no docstring"
    for node in ast.walk(file.tree):
        if isinstance(node, ast.Call) and ast.unparse(node.func) in ("print", "wp.print", "wp.printf", "printf"):
            yield f"{path}:{node.lineno}: prints"
        for name in imported(node):
            if name not in ALLOWED_IMPORTS | (IMPORTS_OF_LOADER if path.stem == LOADER else set()):
                yield f"{path}:{node.lineno}: imports {name}"
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and len(STATEMENTS.findall(node.value)) > 1:
            yield f"{path}:{node.lineno}: C++ in a string: put it into a file of native/, and load it with {LOADER}"
        if isinstance(node, ast.FunctionDef) and (is_a(node, "wp.kernel") or is_a(node, "wp.func_native")):
            for line, text in argument_faults(node, file):
                yield f"{path}:{line}: {node.name}: {text}"


def imported(node: ast.AST) -> list[str]:
    """Top-level packages that an import statement names; one dot is a neighbour, two leave the folder."""
    if isinstance(node, ast.Import):
        return [alias.name.split(".")[0] for alias in node.names]
    if isinstance(node, ast.ImportFrom):
        if node.level > 1:
            return ["." * node.level + (node.module or "")]
        return [] if node.level else [(node.module or "").split(".")[0]]
    return []


def is_a(function: ast.FunctionDef, decorator: str) -> bool:
    return any(ast.unparse(d).split("(")[0] == decorator for d in function.decorator_list)


def is_array(argument: ast.arg) -> bool:
    return argument.annotation is not None and ast.unparse(argument.annotation).startswith("wp.array")


def argument_faults(function: ast.FunctionDef, file: KernelFile) -> Iterator[tuple[int, str]]:
    """Line and fault of the arguments of a kernel or native function."""
    effects = file.effects(function)
    group, written = "", False
    previous = function.lineno
    for argument in function.args.args:
        above = [text.strip() for text in file.lines[previous : argument.lineno - 1]]
        comments = [text.lstrip("# ") for text in above if text.startswith("#")]
        group = comments[0] if comments else group
        previous = argument.lineno
        found = DIRECTION.match(group)
        direction = found[1] if found else ""
        line = argument.lineno
        if not group and is_a(function, "wp.kernel"):
            yield line, f"argument {argument.arg} stands in no group: put a comment above it"
        if argument.annotation is None:
            yield line, f"argument {argument.arg} has no type"
        if argument.arg.endswith("_in") and direction != "in":
            yield line, f"argument {argument.arg} stands in group '{group}', which does not say 'in'"
        if argument.arg.endswith("_out") and direction != "out":
            yield line, f"argument {argument.arg} stands in group '{group}', which does not say 'out'"
        if is_array(argument):
            for text in array_faults(direction, effects[argument.arg]):
                yield line, f"array {argument.arg} of group '{group}' {text}"
        if written and direction == "in":
            yield line, f"argument {argument.arg} is read but stands behind what is written"
        written |= direction == "out"


def array_faults(direction: str, effects: Effects) -> Iterator[str]:
    """Faults of an array whose group disagrees with its function."""
    is_read, is_written = effects & {READ, ADDED, MAYBE_READ}, effects & {WRITTEN, ADDED}
    if not effects:
        yield "is not used"
    elif not direction:
        yield f"is {' and '.join(sorted(effects))}: begin the group's comment with 'in', 'out' or 'in and out'"
    elif direction == "in" and is_written:
        yield "is written"
    elif direction == "out" and READ in effects:
        yield "is read"
    elif direction in ("out", "in and out") and not is_written:
        yield "is never written"
    elif direction == "in and out" and not is_read:
        yield "is never read"


class KernelFile:
    """A kernel file, and what its functions do to their arrays."""

    known: ClassVar[dict[Path, KernelFile]] = {}

    def __init__(self, path: Path) -> None:
        source = path.read_text(encoding="utf-8")
        self.path, self.tree, self.lines = path, ast.parse(source), source.splitlines()
        self._effects: dict[int, dict[str, Effects]] = {}

    @cached_property
    def functions(self) -> dict[str, list[tuple[KernelFile, ast.FunctionDef]]]:
        """Functions by their name here, with their file; overloads share a name."""
        found: dict[str, list[tuple[KernelFile, ast.FunctionDef]]] = {}
        for node in self.tree.body:
            if isinstance(node, ast.FunctionDef) and (is_a(node, "wp.func") or is_a(node, "wp.func_native")):
                found.setdefault(node.name, []).append((self, node))
            if isinstance(node, ast.ImportFrom) and node.level == 1 and node.module:
                path = self.path.parent / f"{node.module}.py"
                there = self.known.setdefault(path, KernelFile(path)) if path.exists() else None
                for alias in node.names if there else ():
                    found[alias.asname or alias.name] = there.functions.get(alias.name, [])
        return found

    def effects(self, function: ast.FunctionDef) -> dict[str, Effects]:
        """Effects of a function on each of its arrays."""
        if id(function) not in self._effects:
            native = is_a(function, "wp.func_native")
            self._effects[id(function)] = self._of_text(function) if native else self._of_body(function)
        return self._effects[id(function)]

    def _of_body(self, function: ast.FunctionDef) -> dict[str, Effects]:
        arrays = {argument.arg for argument in function.args.args if is_array(argument)}
        found: dict[str, set[str]] = {name: set() for name in arrays}

        def base(node: ast.AST) -> str | None:
            """The array that a name or an element of it belongs to."""
            while isinstance(node, ast.Subscript):
                node = node.value
            return node.id if isinstance(node, ast.Name) and node.id in arrays else None

        def visit(node: ast.AST) -> None:
            if isinstance(node, ast.Subscript) and (name := base(node)):
                found[name].add(WRITTEN if isinstance(node.ctx, ast.Store) else READ)
            elif isinstance(node, ast.AugAssign) and (name := base(node.target)):
                found[name].add(ADDED)
                visit(node.value)
                return
            elif isinstance(node, ast.Call):
                call(node)
                return
            elif isinstance(node, ast.Name) and node.id in arrays:
                found[node.id].add(READ)
            elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
                return  # shape, dtype
            # the array of an element is no use of its own
            for child in ast.iter_child_nodes(node):
                if not (isinstance(node, ast.Subscript) and child is node.value and base(child)):
                    visit(child)

        def call(node: ast.Call) -> None:
            text = ast.unparse(node.func)
            callees = self.functions.get(text, [])
            for number, argument in enumerate(node.args):
                name = base(argument)
                takers = [(f, c.args.args[number]) for f, c in callees if number < len(c.args.args)]
                if name and text.startswith("wp.atomic_") and number == 0:
                    found[name].add(ADDED)
                elif name and any(is_array(taker) for _, taker in takers):
                    for (file, callee), (_, taker) in zip(callees, takers, strict=False):
                        found[name] |= file.effects(callee).get(taker.arg, frozenset())
                else:
                    visit(argument)

        for statement in function.body:
            visit(statement)
        return {name: frozenset(found[name]) for name in arrays}

    def _of_text(self, function: ast.FunctionDef) -> dict[str, Effects]:
        """The same of a native function, by its C++ text."""
        calls = [node for d in function.decorator_list for node in ast.walk(d) if isinstance(node, ast.Call)]
        names = [ast.literal_eval(call.args[0]) for call in calls if ast.unparse(call.func) == LOADER]
        text = "\n".join(native_source(self.path.parent / "native", name) for name in names)
        found = {}
        for argument in function.args.args:
            name, effects = argument.arg, set()
            if not is_array(argument):
                continue
            pointer = re.compile(rf"(const )?\w+\* (?:__restrict )?\w+ = (?:\(\w[\w ]*\*\))?\(?{name}\.data\b")
            for match in pointer.finditer(text):
                effects |= {READ} if match[1] else {WRITTEN, MAYBE_READ}
            for match in re.finditer(rf"\b{name}\.data\[", text):
                behind = text[closing(text, match.end()) :].lstrip()
                is_stored = behind.startswith("=") and not behind.startswith("==")
                effects.add(WRITTEN if is_stored else ADDED if behind.startswith("+=") else READ)
            effects |= {ADDED for _ in re.finditer(rf"\batomic_\w+\({name}\b", text)}
            effects |= {MAYBE_READ for _ in re.finditer(rf"\bfetch\w*\([^;]*\b{name}\.data\b", text)}
            found[name] = frozenset(effects)
        return found


def native_source(folder: Path, name: str) -> str:
    """C++ of a file of native/ with the files that it includes."""
    text = (folder / f"{name}.h").read_text(encoding="utf-8")
    return re.sub(r'#include "(\w+)\.h"', lambda found: native_source(folder, found[1]), text)


def closing(text: str, begin: int) -> int:
    """Place behind the bracket that closes the one opened before `begin`."""
    depth = 1
    while depth:
        depth += {"[": 1, "]": -1}.get(text[begin], 0)
        begin += 1
    return begin


def main(arguments: list[str]) -> int:
    paths = [Path(argument) for argument in arguments] or sorted(KERNELS.glob("*.py"))
    found = [fault for path in paths for fault in faults(path)]
    for fault in found:
        print(fault)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
