"""Checks the rules that kernels follow and that no general linter knows.

    python tools/lint/lint_kernels.py [FILE]...          all of kernels/ without a FILE; exit status 1 where a rule is broken

* A kernel file begins with a docstring and does not print.
* It imports `typing`, `warp` and its neighbours, nothing else.
* Arguments of a kernel stand in groups, each under a comment (`# state in`); the first argument has one too, and every
  argument has a type.
* Arguments that end in `_in` stand in a group that says "in", those that end in `_out` in one that says "out", and no
  argument of a group "in" comes behind one of a group "out".
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path

KERNELS = Path(__file__).parents[2] / "kernels"
ALLOWED_IMPORTS = {"typing", "warp"}


def faults(path: Path) -> Iterator[str]:
    """A line for every rule that a kernel file breaks."""
    source = path.read_text(encoding="utf-8")
    tree = ast.parse(source)
    lines = source.splitlines()
    if not ast.get_docstring(tree):
        yield f"{path}:1: no docstring"
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and ast.unparse(node.func) in ("print", "wp.print", "wp.printf", "printf"):
            yield f"{path}:{node.lineno}: prints"
        for name in imported(node):
            if name not in ALLOWED_IMPORTS:
                yield f"{path}:{node.lineno}: imports {name}"
        if isinstance(node, ast.FunctionDef) and is_kernel(node):
            for line, text in kernel_faults(node, lines):
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


def is_kernel(function: ast.FunctionDef) -> bool:
    return any(ast.unparse(d).split("(")[0] == "wp.kernel" for d in function.decorator_list)


def kernel_faults(function: ast.FunctionDef, lines: list[str]) -> Iterator[tuple[int, str]]:
    """Line and text of what is wrong with a kernel's arguments."""
    group, written = "", False
    previous = function.lineno
    for argument in function.args.args:
        above = [text.strip() for text in lines[previous : argument.lineno - 1]]
        comments = [text.lstrip("# ") for text in above if text.startswith("#")]
        group = comments[-1] if comments else group
        previous = argument.lineno
        if not group:
            yield argument.lineno, f"argument {argument.arg} stands in no group: put a comment above it"
        if argument.annotation is None:
            yield argument.lineno, f"argument {argument.arg} has no type"
        reads, writes = says(group, "in"), says(group, "out")
        if argument.arg.endswith("_in") and (writes or not reads):
            yield argument.lineno, f"argument {argument.arg} stands in group '{group}', which does not say 'in'"
        if argument.arg.endswith("_out") and (reads or not writes):
            yield argument.lineno, f"argument {argument.arg} stands in group '{group}', which does not say 'out'"
        if written and reads and not writes:
            yield argument.lineno, f"argument {argument.arg} is read but stands behind what is written"
        written |= writes and not reads


def says(group: str, word: str) -> bool:
    return re.search(rf"\b{word}\b", group) is not None


def main(arguments: list[str]) -> int:
    paths = [Path(argument) for argument in arguments] or sorted(KERNELS.glob("*.py"))
    found = [fault for path in paths for fault in faults(path)]
    for fault in found:
        print(fault)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
