"""Run the notebooks of the documents and keep their outputs; the site shows these, it runs nothing.

python tools/notebooks.py [NOTEBOOK ...]        default: all of docs/notebooks
"""

from __future__ import annotations

import base64
import io
import os
import re
import sys
import tempfile
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
NOTEBOOKS = ROOT / "docs" / "notebooks"
LIMIT = 600  # [s] of a cell
COLOURS = 128  # of a kept picture
KEPT = ("image/png", "text/html", "text/plain")


def main(chosen: list[str]) -> None:
    for path in [Path(name) for name in chosen] or sorted(NOTEBOOKS.glob("*.ipynb")):
        notebook = executed(path)
        for number, cell in enumerate(notebook.cells):
            tidy(cell)
            cell.id = f"{path.stem.replace('_', '-')}-{number}"
        notebook.metadata = {"kernelspec": notebook.metadata["kernelspec"], "language_info": {"name": "python"}}
        nbformat.write(notebook, path)
        print(f"{path.name}: {path.stat().st_size / 1024:.0f} KiB", flush=True)


def executed(path: Path) -> nbformat.NotebookNode:
    """The notebook after a run in an empty folder."""
    notebook = nbformat.read(path, as_version=4)
    os.environ["PYTHONPATH"] = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    with tempfile.TemporaryDirectory() as folder:
        NotebookClient(notebook, timeout=LIMIT, resources={"metadata": {"path": folder}}).execute()
    return notebook


def tidy(cell: nbformat.NotebookNode) -> None:
    """Leave out what changes from run to run: counts, times, progress; reduce pictures."""
    cell.metadata = {}
    if cell.cell_type != "code":
        return
    cell.execution_count = None
    outputs: list[nbformat.NotebookNode] = []
    for one in cell.outputs:
        if one.get("name") == "stderr" or one.get("data", {}).get("text/html") == "":
            continue
        if one.output_type == "stream" and outputs and outputs[-1].output_type == "stream":
            outputs[-1].text += one.text
        else:
            outputs.append(one)
    for one in outputs:
        if "execution_count" in one:
            one["execution_count"] = None
        if "data" in one:
            one["metadata"] = {}
            one["data"] = {kind: one["data"][kind] for kind in KEPT if kind in one["data"]}
            if picture := one["data"].get("image/png"):
                one["data"]["image/png"] = reduced(picture)
            for kind in KEPT[1:]:
                if kind in one["data"]:
                    one["data"][kind] = re.sub(re.escape(tempfile.gettempdir()) + r"/\w+", "runs", "".join(one["data"][kind]))
    cell.outputs = outputs


def reduced(picture: str) -> str:
    """A picture in few colours."""
    out = io.BytesIO()
    with Image.open(io.BytesIO(base64.b64decode(picture))) as image:
        image.convert("RGB").quantize(COLOURS, method=Image.Quantize.MAXCOVERAGE).save(out, "PNG", optimize=True)
    return base64.b64encode(out.getvalue()).decode()


if __name__ == "__main__":
    main(sys.argv[1:])
