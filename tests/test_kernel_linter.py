"""What the linter of kernels says of arrays that a kernel uses otherwise than the comment above them says."""

from pathlib import Path

import pytest
from lint import lint_kernels

FILE = '''"""A kernel file."""

import warp as wp


@wp.func
def put(value: wp.float64, target: wp.array(dtype=wp.float64)):
    target[0] = value


@wp.func_native(native_text("take"))
def take(
    # in
    source: wp.array(dtype=wp.float64),
    # out
    target: wp.array(dtype=wp.float64),
): ...


@wp.kernel
def work(
    # {a}
    a: wp.array(dtype=wp.float64),
    # {b}
    b: wp.array(dtype=wp.float64),
):
    i = wp.tid()
    {body}
'''


def said(tmp_path: Path, a: str, b: str, body: str) -> list[str]:
    """What is wrong with the arrays of a kernel."""
    (tmp_path / "native").mkdir()
    (tmp_path / "native" / "take.h").write_text('#include "pointers.h"\nto[0] = from[0];\n', encoding="utf-8")
    pointers = "const double* from = source.data;\ndouble* to = target.data;\n"
    (tmp_path / "native" / "pointers.h").write_text(pointers, encoding="utf-8")
    path = tmp_path / "work.py"
    path.write_text(FILE.format(a=a, b=b, body=body), encoding="utf-8")
    return [fault.split(": work: ")[1] for fault in lint_kernels.faults(path)]


@pytest.mark.parametrize(
    ("a", "b", "body"),
    [
        ("in", "out", "b[i] = a[i]"),
        ("in: weights", "in and out: sums [N]", "b[i] += a[i]"),
        ("state in", "out: added to", "wp.atomic_add(b, 0, a[i])"),
        ("in", "out", "put(a[i], b)"),
        ("in", "out", "take(a, b)"),
        ("in", "state in and out", "b[i] = 2.0 * b[i] + a[i]"),
        ("in", "out", "b[0] = wp.float64(a.shape[0]) + a[1]"),
    ],
)
def test_groups_that_say_what_happens(tmp_path, a, b, body):
    assert said(tmp_path, a, b, body) == []


@pytest.mark.parametrize(
    ("a", "b", "body", "fault"),
    [
        ("weights", "out", "b[i] = a[i]", "array a of group 'weights' "),
        ("in", "in", "b[i] = a[i]", "array b of group 'in' "),
        ("in", "in", "put(a[i], b)", "array b of group 'in' "),
        ("in", "in", "take(a, b)", "array b of group 'in' "),
        ("in", "in", "wp.atomic_max(b, 0, a[i])", "array b of group 'in' "),
        ("in", "out", "b[i] = b[0] + a[i]", "array b of group 'out' "),
        ("in", "in and out", "b[i] = a[i]", "array b of group 'in and out' "),
        ("in", "out", "x = a[i] + b[i]", "array b of group 'out' "),
        ("in", "in", "x = a[i] + a[0]", "array b of group 'in' "),
        ("out", "in", "a[i] = b[i]", "argument b "),
    ],
)
def test_groups_that_say_otherwise(tmp_path, a, b, body, fault):
    assert said(tmp_path, a, b, body)[0].startswith(fault)


def test_cpp_stands_in_no_string(tmp_path):
    path = tmp_path / "work.py"
    path.write_text('"""A kernel file."""\n\nTEXT = """\ndouble x = 1;\nreturn x;  // [m]\n"""\n', encoding="utf-8")
    assert [fault.split(":", 2)[2] for fault in lint_kernels.faults(path)] == [
        " C++ in a string: put it into a file of native/, and load it with native_text"
    ]
