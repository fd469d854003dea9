"""Scripts of tools use names of the package that exist."""

import ast
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

from warpknit.planar.observables import PlanarObservables
from warpknit.spatial.observables import SpatialObservables

TOOLS = Path(__file__).parents[1] / "tools"
OBSERVED = {name for kind in (PlanarObservables, SpatialObservables) for name in (*dir(kind), *kind.__dataclass_fields__)}


def missing(tree: ast.AST) -> Iterator[str]:
    """Attributes of modules and of observables that are not there."""
    names: dict[str, object] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("warpknit"):
            exec(ast.unparse(node), names)
    modules = {name: one for name, one in names.items() if isinstance(one, ModuleType)}
    for function in ast.walk(tree):
        if isinstance(function, ast.FunctionDef):
            given = {one.arg for one in function.args.args if ast.unparse(one.annotation or one).endswith("Observables")}
            for node in ast.walk(function):
                if isinstance(node, ast.Assign) and ast.unparse(node.value).endswith(".observables"):
                    given |= {ast.unparse(target) for target in node.targets}
            for node in ast.walk(function):
                if isinstance(node, ast.Attribute):
                    of = ast.unparse(node.value)
                    if (of in given or of.endswith(".observables")) and node.attr not in OBSERVED:
                        yield ast.unparse(node)
                    if of in modules and not hasattr(modules[of], node.attr):
                        yield ast.unparse(node)


@pytest.mark.parametrize("path", sorted(TOOLS.rglob("*.py")), ids=lambda path: path.stem)
def test_a_script_uses_names_that_exist(path: Path) -> None:
    assert not list(missing(ast.parse(path.read_text(encoding="utf-8"))))
