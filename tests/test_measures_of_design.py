"""What the measures of the design count, in a small project."""

from pathlib import Path

import pytest
from lint import measures

FILES = {
    "warpknit/__init__.py": "",
    "warpknit/py.typed": "",
    "warpknit/model.py": "def is_flat(scene):\n    return scene.model.kind == 'planar'\n",
    "warpknit/both.py": (
        "from typing import Any, ClassVar, Protocol\n\nfrom .kernels import control as c\n\n\n"
        "class Row(Protocol):\n    flat: ClassVar[bool]\n\n    def state_dict(self) -> dict[str, Any]: ...\n\n\n"
        "def find(scene, table, row):\n    if scene.model.kind != 'spatial' and row.flat:\n"
        "        return table[scene.model.kind]\n    return c.TRAVEL, vars(row)['x']\n"
    ),
    "warpknit/compute/__init__.py": "",
    "warpknit/compute/steering.py": "from ..kernels import control as c\n\nSTEP = c.STEP\n",
    "warpknit/room/__init__.py": "",
    "warpknit/room/one.py": "from .two import Row\n",
    "warpknit/room/two.py": "class Row:\n    pass\n",
    "warpknit/room/three.py": "from . import one\nfrom .. import both\nfrom ..model import is_flat\n",
    "kernels/__init__.py": '"""Kernels."""\n',
    "kernels/control.py": 'STEP = 0\nTRAVEL = 1\nTEXT = """\ndouble x = 1;\nreturn x;\n"""\n',
}
NOW = {
    "lines in warpknit/": 26,
    "lines in kernels/ (Python)": 7,
    "rooms at the top of warpknit/": 4,
    "Protocol classes": 1,
    "branches and look-ups by the kind of model outside one file": 3,
    "class names defined in two or more modules": 1,
    "state_dict methods": 1,
    "c.NAME of the control array outside one typed class": 1,
    "dict[str, Any]": 1,
    "vars(row)[...]": 1,
    "lines of C++ inside Python strings": 2,
    "files under 130 lines with a single importer in their own room": 2,  # both of them in warpknit/room/
}


def test_measures_of_a_small_project(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, text in FILES.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    assert {name: now for name, now, _ in measures.measures(tmp_path)} == NOW
    assert measures.main([str(tmp_path)]) == 0
    assert len(capsys.readouterr().out.splitlines()) == len(NOW) + 1
