"""The rules of the code: how modules may depend on each other, what kernels look like, ruff's, and the documents.

Data flows one way and there are no circles, read from the imports. An import inside a function counts as much as one at
the top; only what stands under `if TYPE_CHECKING` does not.
"""

import ast
import graphlib
import importlib.util
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from warpknit.cli import main

ROOT = Path(__file__).parent.parent
HOST = ROOT / "warpknit"
KERNELS = ROOT / "kernels"

# A module imports from its own layer and from those above it in this list.
LAYERS = (
    # what everything may use
    {"errors", "files", "text", "processes", "kernels"},
    # ranks that share a mesh; the pattern; the form in which results leave
    {"ranks", "knit", "frame"},
    {"scene"},
    {"wires", "memory", "device"},
    {"mesh"},
    {"measure"},
    {"planar"},
    {"solve"},
    {"spatial"},
    {"export"},
    {"run", "plan"},
    {"sweep", "trade"},
    {"design"},
    {"program"},
    {"cli"},
    {"__main__"},
)
MAY_IMPORT_EXPORT = {"run.recorder", "sweep.sweep", "trade.study", "cli", "design.report"}
EXPORT_MAY_IMPORT = {"errors", "files", "frame", "knit", "processes", "export"}


def module_name(path: Path) -> str:
    """warpknit/knit/cloth.py as knit.cloth, kernels/bend.py as kernels.bend, a package as its folder."""
    relative = path.relative_to(HOST) if path.is_relative_to(HOST) else path.relative_to(ROOT)
    parts = relative.with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


FILES = {module_name(path): path for path in [*HOST.rglob("*.py"), *KERNELS.glob("*.py")]}
MODULES = sorted(name for name in FILES if name)  # without the door, warpknit/__init__.py


def layer(name: str) -> int:
    package = name.split(".")[0]
    return next(number for number, members in enumerate(LAYERS) if package in members)


def statements(tree: ast.AST, inside: bool = False):
    """Imports with whether they stand in a function, without those for type checking."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and ast.unparse(node.test) in ("TYPE_CHECKING", "typing.TYPE_CHECKING"):
            continue
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield node, inside
        yield from statements(node, inside or isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda))


def imports(name: str):
    """(name, lazy) of all that a module imports; modules of this project begin with a dot: .knit.cloth."""
    path = FILES[name]
    package = ["warpknit", *name.split(".")]
    if path.name != "__init__.py":
        package = package[:-1]
    for node, lazy in statements(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found = [alias.name for alias in node.names]
        else:
            above = package[: len(package) - node.level + 1] if node.level else []
            base = ".".join([*above, *([node.module] if node.module else [])])
            inside = [f"{base}.{alias.name}" for alias in node.names]
            found = [item if item.removeprefix("warpknit.") in FILES else base for item in inside]
        for item in found:
            if item == "warpknit":
                continue  # the door, for its version
            yield (f".{item.removeprefix('warpknit.')}" if item.startswith("warpknit.") else item), lazy


def own_imports(name: str) -> set[str]:
    return {item[1:] for item, _ in imports(name) if item.startswith(".")}


def test_every_module_has_a_layer():
    placed = set().union(*LAYERS)
    assert {name.split(".")[0] for name in MODULES} == placed


@pytest.mark.parametrize("name", MODULES)
def test_imports_point_one_way(name):
    assert [other for other in own_imports(name) if layer(other) > layer(name)] == []


def test_there_are_no_import_circles():
    graph = {name: own_imports(name) - {name} for name in MODULES}
    graphlib.TopologicalSorter(graph).prepare()  # raises CycleError, which names the circle


@pytest.mark.parametrize("name", [name for name in MODULES if name.startswith("kernels")])
def test_kernels_know_arrays_only(name):
    """They import Warp, typing and one another."""
    outside = {item for item, _ in imports(name) if not item.startswith(".kernels")}
    assert outside <= {"typing", "warp"}


@pytest.mark.parametrize("name", [name for name in MODULES if name.startswith("export")])
def test_exports_know_layouts_and_frames_only(name):
    assert {other.split(".")[0] for other in own_imports(name)} <= EXPORT_MAY_IMPORT
    assert "warp" not in {item.split(".")[0] for item, _ in imports(name)}


@pytest.mark.parametrize("name", [name for name in MODULES if not name.startswith("export")])
def test_exports_are_imported_lazily(name):
    """So that a run needs their libraries only for what it writes."""
    uses = [lazy for item, lazy in imports(name) if item.split(".")[1:2] == ["export"]]
    assert all(uses)
    assert not uses or name in MAY_IMPORT_EXPORT


@pytest.mark.parametrize("name", [name for name in MODULES if name.split(".")[0] == "knit"])
def test_the_knit_is_numpy_only(name):
    packages = {item.split(".")[0] for item, _ in imports(name)}
    assert not packages & {"warp", "pydantic", "pxr"}


def test_only_the_command_line_starts_runs_and_plans():
    users = {name for name in MODULES if own_imports(name) & {"run", "sweep", "plan"}}
    assert users <= {"cli"}


# --- kernels and ruff


def linter():
    """The module tools/lint_kernels.py."""
    spec = importlib.util.spec_from_file_location("lint_kernels", ROOT / "tools" / "lint_kernels.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_kernels_follow_their_rules():
    lint = linter()
    assert [fault for path in sorted(lint.KERNELS.glob("*.py")) for fault in lint.faults(path)] == []


GROUPED = '''"""Adds."""

import warp as wp


@wp.kernel
def add(
    # in
    x_in: wp.array(dtype=float),
    # out
    x_out: wp.array(dtype=float),
):
    x_out[wp.tid()] += x_in[wp.tid()]
'''


@pytest.mark.parametrize(
    ("before", "after", "fault"),
    [
        ("", "", None),
        ('"""Adds."""', "", "no docstring"),
        ("    # in\n", "", "stands in no group"),
        ("x_in: wp.array(dtype=float)", "x_in", "has no type"),
        ("    # out\n", "", "does not say 'out'"),
        ("    # in\n", "    # out\n", "does not say 'in'"),
        (
            "# out\n    x_out: wp.array(dtype=float),",
            "# out\n    y: int,\n    # in\n    z: int,",
            "behind what is written",
        ),
        ("    x_out[wp.tid()]", "    print(1)\n    x_out[wp.tid()]", "prints"),
        ("import warp", "import numpy\nimport warp", "imports numpy"),
        ("import warp", "from ..scene import Scene\nimport warp", "imports ..scene"),
    ],
)
def test_the_linter_finds(tmp_path, before, after, fault):
    path = tmp_path / "add.py"
    path.write_text(GROUPED.replace(before, after) if before else GROUPED, encoding="utf-8")
    found = list(linter().faults(path))
    assert found == [] if fault is None else any(fault in text for text in found)


def test_ruff_finds_nothing():
    if importlib.util.find_spec("ruff") is None and shutil.which("ruff") is None:
        pytest.skip("ruff is not installed")
    command = [sys.executable, "-m", "ruff"] if importlib.util.find_spec("ruff") else ["ruff"]
    done = subprocess.run(
        [*command, "check", "--quiet", "--output-format=concise", "."],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout


# --- documents


def test_every_command_and_option_is_in_the_readme():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    for name, command in main.commands.items():
        assert f"warpknit {name} " in text
        for option in command.params:
            assert option.param_type_name == "argument" or option.opts[0] in text


def test_links_between_documents_lead_somewhere():
    """Pictures too; web addresses are not followed."""
    for path in [ROOT / "README.md", ROOT / "CHANGELOG.md", ROOT / "scenes" / "README.md", *(ROOT / "docs").glob("*.md")]:
        for target in re.findall(r"\]\(([^)#\s]+)", path.read_text(encoding="utf-8")):
            assert target.startswith("https://") or (path.parent / target).exists(), f"{path.name}: {target}"
