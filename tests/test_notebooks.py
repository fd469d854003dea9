"""The notebooks of docs/notebooks run from top to bottom. They are kept with their outputs, which the site shows."""

import json
import os
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
LIMIT = 600  # [s] of a cell
LARGEST, LARGEST_SOURCE = 256 * 2**10, 16 * 2**10  # [bytes]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_small_and_ends_in_a_picture(path: Path) -> None:
    """Its outputs name no folder of the machine that wrote them, and no counts that change from run to run."""
    text = path.read_text(encoding="utf-8")
    cells = json.loads(text)["cells"]
    assert len(text) < LARGEST and sum(len("".join(cell["source"])) for cell in cells) < LARGEST_SOURCE
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert all(cell["execution_count"] is None for cell in code)
    outputs = [output for cell in code for output in cell["outputs"]]
    assert "image/png" in outputs[-1]["data"] and code[-1]["outputs"], "python tools/notebooks.py"
    for output in outputs:
        data = {kind: value for kind, value in output.get("data", {}).items() if kind != "image/png"}
        assert not re.search(r"/(tmp|home|root|Users)/", json.dumps([data, output.get("text", "")]))


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for package in ("pandas", "xarray", "ipykernel"):
        pytest.importorskip(package, reason=f"{package} is not installed: pip install -e '.[notebooks]'")
    client = pytest.importorskip("nbclient", reason="nbclient is not installed: pip install -e '.[notebooks]'")
    import nbformat

    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]))
    notebook = nbformat.read(path, as_version=4)
    client.NotebookClient(notebook, timeout=LIMIT, resources={"metadata": {"path": str(tmp_path)}}).execute()
    assert any("image/png" in output.get("data", {}) for cell in notebook.cells for output in cell.get("outputs", []))
    if keep := os.environ.get("WARPKNIT_NOTEBOOKS"):  # a folder for the executed notebooks, to look at them
        nbformat.write(notebook, Path(keep) / path.name)
