"""Texts of native functions: C++ of kernels/native/, which Warp compiles for CPU and GPU and for either precision.

A file holds the body of a function, or a part of one; arguments are the Python function's.
"""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import warp as wp

from . import control

FOLDER = Path(__file__).parent / "native"


def native_text(name: str, *namespaces: Mapping[str, Any]) -> str:
    """C++ of native/`name`.h with included files, behind the constants that it names.

    Constants are numbers in capital letters of control.py and of `namespaces`: `globals()`, or `vars` of another module.
    ValueError where two of them differ.
    """
    text = _with_includes(name)
    words = set(re.findall(r"\b[A-Z][A-Z0-9_]+\b", text))
    found: dict[str, float] = {}
    for namespace in (vars(control), *namespaces):
        for word in sorted(words & namespace.keys()):
            value = namespace[word]
            if isinstance(value, (int, float, wp.float32, wp.float64)) and found.setdefault(word, float(value)) != float(value):
                raise ValueError(f"native/{name}.h: two modules define {word} differently")
    return "".join(_declared(word, value) for word, value in found.items()) + _with_shared_arrays(text)


def _with_includes(name: str) -> str:
    text = (FOLDER / f"{name}.h").read_text(encoding="utf-8")
    return re.sub(r'^#include "(\w+)\.h"\n', lambda found: _with_includes(found[1]), text, flags=re.MULTILINE)


def _declared(name: str, value: float) -> str:
    if value == int(value) and abs(value) < 2**31:
        return f"enum {{ {name} = {int(value)} }};\n"
    return f"const double {name} = {value!r};\n"


def _with_shared_arrays(text: str) -> str:
    """The text with `SHARED type name[size], ...;` as members of one object on a GPU (native/sharing.h)."""
    head, mark, behind = text.partition("SHARED ")
    declaration = re.compile(r"\bSHARED (\w+) ([^;]+);")
    members = " ".join(f"{kind} {arrays};" for kind, arrays in declaration.findall(text))

    def declared(found: re.Match[str]) -> str:
        on_gpu = " ".join(f"auto& {name} = shared_by_all.{name};" for name in re.findall(r"(\w+)\[", found[2]))
        return f"\n#ifdef __CUDA_ARCH__\n{on_gpu}\n#else\n{found[1]} {found[2]};\n#endif\n"

    shared = f"\n#ifdef __CUDA_ARCH__\n__shared__ struct {{ {members} }} shared_by_all;\n#endif\n"
    return head + shared + declaration.sub(declared, mark + behind) if mark else text
