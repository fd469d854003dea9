"""The linter of words finds house words, long sentences, long first lines, house names and warnings without a code."""

from pathlib import Path

import pytest
from lint import words

FILE = '''"""A module."""


def measure(load):
    """{summary}"""
    # {comment}
    raise ValueError(f"{message}")
'''


def faults(tmp_path: Path, name: str, text: str) -> list[str]:
    """Lines and faults of a file with this text."""
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return [fault.partition(f"{name}:")[2] for fault in words.faults(path)]


@pytest.mark.parametrize(
    ("part", "text", "line"),
    [
        ("summary", "Tension of a mesh, and that of its wires.", 5),
        ("summary", "A first line that goes on and on, and does not come to any end for a long time.", 5),
        ("comment", "the mesh jumps here", 6),
        ("message", "more levels tell the tension", 7),
        ("message", "{load} " + "word " * 30, 7),
    ],
)
def test_a_fault_is_found_in_its_line(tmp_path: Path, part: str, text: str, line: int) -> None:
    parts = {"summary": "Tension of a mesh [N/m].", "comment": "shape (node, 3)", "message": "use {load}"}
    assert faults(tmp_path, "good.py", FILE.format(**parts)) == []
    (found,) = faults(tmp_path, "bad.py", FILE.format(**parts | {part: text}))
    assert found.startswith(f"{line}: ")


@pytest.mark.parametrize(
    ("source", "count"),
    [
        ('ResultWarning("W12", "text")', 0),
        ('ResultWarning("text of a warning")', 1),
        ('_log.warning("warning W62: use %s", 1)', 0),
        ('_log.warning("warning: use %s", 1)', 1),
        ("def watch(): ...", 1),
        ("def load(watch): ...", 1),
        ('key = "steady"', 0),
        ('"in space".split("in space")', 2),
        ('x = "is `told` or \\"told\\""', 0),
    ],
)
def test_warnings_names_and_quoted_words(tmp_path: Path, source: str, count: int) -> None:
    assert len(faults(tmp_path, "part.py", f'"""A module."""\n\n{source}\n')) == count


def test_pages_are_read_outside_of_their_code(tmp_path: Path) -> None:
    page = "# Load\n\nThe run tells\n`told` [what](told.md).\n\n```bash\ntold\n```\n\nA level, one\nof which converged.\n"
    assert [fault.split(":")[0] for fault in faults(tmp_path, "page.md", page)] == ["3", "11"]
