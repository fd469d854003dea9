"""Refuses house words in texts for people, long sentences in messages, and warnings without a code.

    python tools/lint/words.py [FILE or FOLDER]...          the package, kernels, tools, README and docs without a FILE

* Strings with a space, docstrings, comments, and pages (Markdown, outside of code) have no word of `WORDS`.
* A sentence of a string has at most 30 words; a value in an f-string counts as one.
* A docstring begins with a clause of at most 14 words; units and shapes in brackets do not count.
* Functions, classes and arguments have no name of `NAMES`.
* A warning begins with its code, as in `ResultWarning("W12", ...)` and `logger.warning("W12 ...")`.

Exit status 1 where a rule is broken. Logs of studies and notebooks are left out.
"""

from __future__ import annotations

import ast
import io
import re
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
ROOMS = ("warpknit", "kernels", "tools", "README.md", "docs")
LEFT_OUT = (ROOT / "docs" / "studies" / "log", ROOT / "docs" / "notebooks", Path(__file__))
SENTENCE, SUMMARY = 30, 14  # most words
CLAUSE_END = re.compile(r"[.:;](?:\s|$)|\n")
SENTENCE_END = re.compile(r"[.!?](?:\s|$)|\n")
WARNINGS = {"ResultWarning", "_log.warning"}  # calls
CODE = re.compile(r"W\d\d")
QUOTED = re.compile(r"``.*?``|`[^`]*`|\"[^\"\n]*\"|(?<!\w)'[^'\n]*'(?!\w)|\]\([^)]*\)|https?://\S+", re.DOTALL)
WORDS = {
    r"tells?|told": "shows, reports, prints",
    r"of which|(?<!so )(?:that|those) of|the ones? that|the one of": "the noun again",
    r"taken by auto": "chosen automatically",
    r"in space|in the plane": "spatial model, planar model",
    r"contacts? elsewhere|active elsewhere|touch elsewhere": "contacts between stitches",
    r"(?:may|can|it) drifts?": "stays valid between .. and ..",
    r"pieces at the grips|fragments?": "cut wire ends at the grips",
    r"slack is taken up|strains freely": "the mesh is slack up to ..",
    r"steady(?! state| \\||$)": "converged",
    r"mesh(?:es)? jumps?|mesh(?:es)? snaps?(?! (?:through )?to another)|giv(?:es?|ing) way|gave way": "snap-through",
    r"use (?:a )?(?:closer|nearer|finer)|(?:closer|nearer|finer) (?:preset|settings?|levels|records|increments)": "key and value",
    r"so many|as many|one another": "the number; each other",
    r"g[ia]ve up|gives up|lends?|lent|the door": "fails, apply, public API",
    r"c[oa]mes? to rest|(?:brought|come) to rest|unrest|still to do|on the books": "reach equilibrium, residual, energy balance",
    r"knobs?": "parameters",
    r"lets? go": "releases",
    r"(?:is|are) no longer|used to be|up to now": "what is so, without history",
}
REFUSED = [(re.compile(rf"\b(?:{words})\b", re.IGNORECASE), instead) for words, instead in WORDS.items()]
NAMES = {"pace", "watch", "trial", "under", "took", "gave_up", "carried_out", "lend", "door"}


def faults(path: Path) -> Iterator[str]:
    """A line for every rule that a file breaks."""
    text = path.read_text(encoding="utf-8")
    for line, fault in python_faults(text) if path.suffix == ".py" else page_faults(text):
        yield f"{path.relative_to(ROOT) if path.is_relative_to(ROOT) else path}:{line}: {fault}"


def page_faults(text: str) -> Iterator[tuple[int, str]]:
    """Line and text of house words in a page, outside of its code."""
    blank = re.sub(r"^( *)(`{3,}|~{3,}).*?^ *\2", lambda code: "\n" * code[0].count("\n"), text, flags=re.DOTALL | re.MULTILINE)
    yield from word_faults(blank, 1)


def word_faults(text: str, line: int) -> Iterator[tuple[int, str]]:
    """Line and text of house words in prose that begins at `line`."""
    plain = QUOTED.sub(lambda quoted: "`" + "\n" * quoted[0].count("\n"), text)
    for words, instead in REFUSED:
        for found in words.finditer(re.sub(r"\s", lambda space: space[0] if space[0] == "\n" else " ", plain)):
            yield line + plain.count("\n", 0, found.start()), f"'{found[0]}': write {instead}"


def python_faults(source: str) -> Iterator[tuple[int, str]]:
    """Line and text of the faults of a Python file."""
    tree, docstrings = ast.parse(source), {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and (docstring := ast.get_docstring(node)):
            docstrings[id(node.body[0].value)] = docstring
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            yield from word_faults(token.string, token.start[0])
    yield from node_faults(tree, docstrings)


def node_faults(node: ast.AST, docstrings: dict[int, str]) -> Iterator[tuple[int, str]]:
    """Line and text of the faults of a node and all below it."""
    if id(node) in docstrings:
        yield from word_faults(docstrings[id(node)], node.lineno)
        summary = CLAUSE_END.split(docstrings[id(node)])[0]
        if (count := word_count(re.sub(r"\[[^]]*]|\([^)]*\)", "", summary))) > SUMMARY:
            yield node.lineno, f"docstring begins with {count} words: {summary[:60]}"
    elif (text := literal(node)) is not None:
        yield from message_faults(text, node.lineno)
        if isinstance(node, ast.JoinedStr):
            for value in node.values:
                if isinstance(value, ast.FormattedValue):
                    yield from node_faults(value.value, docstrings)
        return
    if isinstance(node, ast.FunctionDef | ast.ClassDef) and node.name.strip("_") in NAMES:
        yield node.lineno, f"name {node.name}: use a word of the field"
    if isinstance(node, ast.arg) and node.arg in NAMES:
        yield node.lineno, f"argument {node.arg}: use a word of the field"
    is_warning = isinstance(node, ast.Call) and node.args and ast.unparse(node.func) in WARNINGS
    if is_warning and not CODE.search(literal(node.args[0]) or "W00") and ".code" not in ast.unparse(node):
        yield node.lineno, "warning without a code such as W12"
    for child in ast.iter_child_nodes(node):
        yield from node_faults(child, docstrings)


def message_faults(text: str, line: int) -> Iterator[tuple[int, str]]:
    """Line and text of the faults of a string; one word is a key or a value, no message."""
    if " " not in text.strip():
        return
    yield from word_faults(text, line)
    for sentence in SENTENCE_END.split(text):
        if (count := word_count(sentence)) > SENTENCE:
            yield line, f"sentence of {count} words: {sentence[:60]}"


def word_count(text: str) -> int:
    """Number of words; numbers and signs are none."""
    return len(re.findall(r"[^\s]*[A-Za-z][^\s]*", text))


def literal(node: ast.AST) -> str | None:
    """Text of a string or an f-string, a value as one word; None for other nodes."""
    if isinstance(node, ast.Constant):
        return node.value if isinstance(node.value, str) else None
    if isinstance(node, ast.JoinedStr):
        return "".join(str(value.value) if isinstance(value, ast.Constant) else "VALUE" for value in node.values)
    return None


def main(arguments: list[str]) -> int:
    roots = [Path(argument) for argument in arguments or [str(ROOT / room) for room in ROOMS]]
    files = [path for root in roots for path in ([root] if root.is_file() else sorted(root.rglob("*")))]
    files = [path.resolve() for path in files if path.suffix in (".py", ".md")]
    found = [fault for path in files if not any(path.is_relative_to(out) for out in LEFT_OUT) for fault in faults(path)]
    for fault in found:
        print(fault)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
