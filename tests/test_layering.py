"""The rules of the code: how modules may depend on each other, what the linter of kernels finds, and the documents.

Data flows one way and there are no circles, read from the imports. An import inside a function counts as much as one at
the top; what stands under `if TYPE_CHECKING` counts for circles alone.
"""

import ast
import graphlib
import importlib.util
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

from warpknit.commands.cli import main

TESTS = Path(__file__).parent
ROOT = TESTS.parent
HOST = ROOT / "warpknit"
KERNELS = ROOT / "kernels"

# A module imports from its own layer and from those above it in this list.
LAYERS = (
    # what everything may use
    {"base", "kernels"},
    # the pattern, and the form in which results leave
    {"knit", "results.frame", "results.row", "results.finding"},
    {"scene", "wires"},
    {"compute"},
    {"mesh"},
    {"measure"},
    {"mechanics"},
    {"planar", "spatial"},
    {"solve"},
    {"export"},
    {"runner"},
    {"studies.contact_map"},
    {"reflection"},
    {"studies"},
    {"results"},
    {"commands"},
    {"__main__"},
)
MAY_IMPORT_EXPORT = {
    "runner.recorder",
    "studies.sweep",
    "studies.trade",
    "reflection.study",
    "commands.cli",
    "studies.report_files",
    "results.run",
}
EXPORT_MAY_IMPORT = {"base", "results.frame", "results.row", "knit", "export"}
KERNELS_MAY_IMPORT = {"typing", "warp", ".kernels"}
LOADERS_MAY_IMPORT = {"kernels": {"pathlib"}, "kernels.native_text": {"collections", "pathlib", "re"}}  # which find files
STARTED_BY_THE_COMMAND_LINE = {"runner.run", "studies.sweep", "studies.trade", "studies.report", "commands.plan"}
ARRAYS_ONLY = {"knit": {"warp", "pydantic", "pxr"}}  # packages that are NumPy only, and what they may not import


def module_name(path: Path) -> str:
    """warpknit/knit/cloth.py as knit.cloth, kernels/bend.py as kernels.bend, a package as its folder."""
    relative = path.relative_to(HOST) if path.is_relative_to(HOST) else path.relative_to(ROOT)
    parts = relative.with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


FILES = {module_name(path): path for path in [*HOST.rglob("*.py"), *KERNELS.glob("*.py")]}
MODULES = sorted(name for name in FILES if name)  # without the public API, warpknit/__init__.py


def layer(name: str) -> int:
    placed = {member: number for number, members in enumerate(LAYERS) for member in members}
    return placed[name] if name in placed else placed[name.split(".", maxsplit=1)[0]]


def statements(tree: ast.AST, inside: bool = False, *, types: bool = False):
    """Imports with whether they stand in a function, those for type checking only where `types` asks for them."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.expr) or (not types and isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test)):
            continue
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield node, inside
        yield from statements(node, inside or isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda), types=types)


@cache
def imports(name: str, types: bool = False) -> list[tuple[str, bool]]:
    """(name, lazy) of all that a module imports; modules of this project begin with a dot: .knit.cloth."""
    path = FILES[name]
    package = ["warpknit", *name.split(".")]
    if path.name != "__init__.py":
        package = package[:-1]
    everything = []
    for node, lazy in statements(ast.parse(path.read_text(encoding="utf-8")), types=types):
        if isinstance(node, ast.Import):
            found = [alias.name for alias in node.names]
        else:
            above = package[: len(package) - node.level + 1] if node.level else []
            base = ".".join([*above, *([node.module] if node.module else [])])
            inside = [f"{base}.{alias.name}" for alias in node.names]
            found = [item if item.removeprefix("warpknit.") in FILES else base for item in inside]
        for item in found:
            if item == "warpknit":
                continue  # the public API, for its version
            everything.append((f".{item.removeprefix('warpknit.')}" if item.startswith("warpknit.") else item, lazy))
    return everything


def own_imports(name: str, *, types: bool = False) -> set[str]:
    return {item[1:] for item, _ in imports(name, types=types) if item.startswith(".")}


def offenders(name: str, refused: Callable[[str, bool], bool]) -> list[str]:
    """Imports of a module that a rule refuses, as "who imports what"."""
    return [f"{name} imports {item.removeprefix('.')}" for item, lazy in imports(name) if refused(item, lazy)]


def package_of(item: str) -> str:
    """The library or the package of this project (.knit) that an imported name stands in."""
    return ".".join(item.split(".")[: 2 if item.startswith(".") else 1])


def test_every_module_has_a_layer():
    placed = set().union(*LAYERS)
    assert {name.split(".")[0] for name in MODULES} == {name.split(".")[0] for name in placed}


def test_the_rules_name_what_there_is():
    """A rule on a module that was renamed would hold for nothing."""
    named = MAY_IMPORT_EXPORT | STARTED_BY_THE_COMMAND_LINE
    assert sorted(named - set(MODULES)) == []
    assert sorted((EXPORT_MAY_IMPORT | ARRAYS_ONLY.keys()) - set().union(*LAYERS)) == []


def test_imports_point_one_way():
    found = [
        f"{name} imports {other}" for name in MODULES for other in sorted(own_imports(name)) if layer(other) > layer(name)
    ]  # fmt: skip
    assert found == []


def test_the_two_models_know_nothing_of_each_other():
    both = {"planar", "spatial"}
    found = []
    for name in MODULES:
        other = {f".{package}" for package in both - {name.split(".")[0]}}
        if len(other) == 1:
            found += offenders(name, lambda item, _, other=other: package_of(item) in other)
    assert found == []


def test_there_are_no_import_circles():
    graph = {name: own_imports(name, types=True) - {name} for name in MODULES}
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as error:
        circle = error.args[1]
    else:
        circle = []
    assert circle == []


def test_kernels_know_arrays_only():
    """They import Warp, typing and one another."""
    found = []
    for name in MODULES:
        if name.startswith("kernels"):
            allowed = KERNELS_MAY_IMPORT | LOADERS_MAY_IMPORT.get(name, set())
            found += offenders(name, lambda item, _, allowed=allowed: package_of(item) not in allowed)
    assert found == []


def test_exports_know_layouts_and_frames_only():
    allowed = {f".{package}" for package in EXPORT_MAY_IMPORT}

    def refused(item: str, _lazy: bool) -> bool:
        return package_of(item) == "warp" or (item.startswith(".") and not {item, package_of(item)} & allowed)

    assert [fault for name in MODULES if name.startswith("export") for fault in offenders(name, refused)] == []


def test_exports_are_imported_lazily():
    """So that a run needs their libraries only for what it writes."""
    found = []
    for name in MODULES:
        if not name.startswith("export"):
            may = name in MAY_IMPORT_EXPORT
            found += offenders(name, lambda item, lazy, may=may: package_of(item) == ".export" and not (may and lazy))
    assert found == []


def test_the_knit_is_numpy_only():
    found = []
    for name in MODULES:
        refused = ARRAYS_ONLY.get(name.split(".")[0], set())
        found += offenders(name, lambda item, _, refused=refused: package_of(item) in refused)
    assert found == []


def test_only_the_command_line_starts_runs_and_plans():
    """What begins a run, a map, a trade, a report or a plan is called by nothing but the commands and the program."""
    refused = {f".{name}" for name in STARTED_BY_THE_COMMAND_LINE}
    others = [name for name in MODULES if package_of(f".{name}") != ".commands"]
    assert [fault for name in others for fault in offenders(name, lambda item, _: item in refused)] == []


def test_tests_import_no_test():
    """What tests share stands in tests/reference, which imports no test either."""
    tests = {path.stem for path in TESTS.rglob("test_*.py")} | {"conftest"}
    found = []
    for path in sorted(TESTS.rglob("*.py")):
        for node, _ in statements(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names]
            if isinstance(node, ast.ImportFrom):
                names = [f"{node.module or ''}.{name}" for name in names]
            found += [f"{path.relative_to(ROOT)} imports {name}" for name in names if tests & set(name.split("."))]
    assert found == []


# --- the linter of kernels, which .ci/run runs over all of them


def linter():
    """The module lint_kernels, wherever in tools/ it stands."""
    (path,) = (ROOT / "tools").rglob("lint_kernels.py")
    spec = importlib.util.spec_from_file_location("lint_kernels", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


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


# --- documents


def test_every_command_is_in_the_readme_and_every_option_in_the_reference():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    text = (ROOT / "docs" / "reference" / "commands.md").read_text(encoding="utf-8")
    for name, command in main.commands.items():
        assert f"warpknit {name} " in readme and f"warpknit {name} " in text
        for option in command.params:
            assert option.param_type_name == "argument" or option.opts[0] in text


def test_links_between_documents_lead_somewhere():
    """Pictures too; web addresses are not followed."""
    for path in [ROOT / "README.md", ROOT / "CHANGELOG.md", ROOT / "scenes" / "README.md", *(ROOT / "docs").glob("*.md")]:
        for target in re.findall(r"\]\(([^)#\s]+)", path.read_text(encoding="utf-8")):
            assert target.startswith("https://") or (path.parent / target).exists(), f"{path.name}: {target}"


PLACES = ("docs", "kernels", "scenes", "tests", "tools", "warpknit")  # folders of the project
PATH = re.compile(r"(?<![\w./<{*-])(?:[\w.-]+/)*[\w-]+\.(?:py|c|h|md|toml|csv|png)\b(?![\w/*(])")


def project_files() -> list[Path]:
    """All of them, but for what Python leaves beside its modules."""
    inside = [path for folder in PLACES for path in (ROOT / folder).rglob("*") if path.is_file()]
    return [path for path in [*ROOT.glob("*.*"), *inside] if "__pycache__" not in path.parts]


def test_files_named_in_docstrings_and_documents_exist():
    """Modules by their name, other files where a folder of the project stands before them.

    A name may leave out the folders in front, as in spatial/rods.py.
    """
    files = project_files()
    ends = {"/".join(path.relative_to(ROOT).parts[-n:]) for path in files for n in range(1, 7)}
    missing = []
    for path in files:
        if path.suffix not in (".py", ".md", ".toml", ".c", ".h") or path.name == "test_layering.py" or path.parent.name == "log":
            continue
        text = path.read_text(encoding="utf-8")
        if path.suffix == ".py":
            text = "\n".join(prose(text))
        if path.suffix == ".h":
            text = "\n".join(re.findall("//.*", text))
        for name in PATH.findall(text):
            is_module = name.endswith((".py", ".c", ".h")) and path.name != "CHANGELOG.md"
            if (is_module or name.split("/")[0] in PLACES) and name not in ends:
                missing.append(f"{path.relative_to(ROOT)}: {name}")
    assert missing == []


DOCSTRING = re.compile(r'^ *(?:r|f)?"""(.*?)"""', re.DOTALL | re.MULTILINE)


def prose(source: str) -> list[str]:
    """Docstrings and comments of a module, and texts in three quotes that begin a line."""
    return re.findall(r"(?<!\S)#.*", source) + DOCSTRING.findall(source)
