"""The text of a new scene file: a knit by name, a wire, a load, and a comment for each key.

    request = SceneRequest(knit="tricot", diameter="30 um", load="6 %, 2 N/m")
    scene_text(request, "tricot.toml")

Values are text as people type it. They are checked as in a scene, and stand in the file as they were typed.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from importlib.resources import files
from string import Template
from typing import Any

from pydantic_core import PydanticCustomError

from ..base.errors import InputError
from ..base.text import exact
from ..knit.lapping import KnitError
from ..knit.named import GuideBar, NamedKnit, named_knit
from .keys import Table
from .knit import KnitTable
from .materials import MATERIALS
from .options import SIDES, ModelOptions, Stage
from .scene import SceneFile
from .units import has_unit, is_quantity, shown, si
from .wire import Plating, Wire

LOAD = "write a strain such as '6 %', a tension such as '2 N/m', or both, '6 %, 2 N/m', for weft and warp"
PLATING = "write a metal and the thickness of its coating, such as 'gold, 0.2 um'"
SPACING = "write a count per length such as '26 /inch', a count an inch such as 26, or a distance such as '0.98 mm'"
COMMENTS_AT = 28  # column of the comments behind keys
SWEPT = (0.25, 0.5, 1.0, 1.75, 2.5)  # tensions of a map over the tension of the scene
NO_PLATING = "none"


@dataclass(frozen=True)
class SceneRequest:
    """Request of a new scene, as typed; "": the default of the knit. Raises `InputError`, which names the option."""

    knit: str = "double-atlas"
    material: str = "molybdenum"
    diameter: str = "30 um"
    ends: str = "1"
    plating: str = NO_PLATING
    wales: str = ""
    courses: str = ""
    load: str = ""
    model: str = "auto"

    def __post_init__(self) -> None:
        for entry in fields(self):
            if (given := getattr(self, entry.name)) != entry.default:
                _CHECKS[entry.name](given)

    @property
    def filled_in(self) -> SceneRequest:
        """The request with the defaults of its knit."""
        knit = _knit(self.knit)
        wales, courses = self.wales or f"{knit.wales} /inch", self.courses or f"{knit.courses} /inch"
        return replace(self, wales=wales, courses=courses, load=self.load or f"{knit.strain} %")


def check_file_name(name: str) -> None:
    """Check a file name, which also names the directory of results. Raises `InputError`."""
    if not name.isprintable():  # such as a byte that is no UTF-8
        raise _refused("FILE", name, "cannot be shown", "write a name of printable characters")
    _accept("FILE", name, name.removesuffix(".toml"), SceneFile, "name")


def _refused(option: str, given: str, wrong: str, instead: str) -> InputError:
    return InputError(f"{option}: {shown(given)} {wrong}; {instead}")


def _accept(option: str, given: str, value: Any, table: type[Table], key: str, instead: str = "") -> Any:
    """A value in SI, by the check of its key. `given`: the whole text of an option; instead: what to write for it."""
    check = table.keys[key].check
    assert check is not None
    try:
        return check(value)
    except PydanticCustomError as error:
        context = error.context or {}
        wrong = "cannot be used" if instead else context["wrong"]
        raise _refused(option, given, wrong, instead or context["instead"]) from error


def _knit(given: str) -> NamedKnit:
    try:
        return named_knit(given)
    except KnitError as error:
        raise _refused("--knit", given, "is no knit", error.instead) from error


def _diameter(given: str) -> str:
    if not has_unit(given):
        raise _refused("--diameter", given, "has no unit", "write a length with its unit, such as '30 um'")
    _accept("--diameter", given, given, Wire, "diameter")
    return given


def _ends(given: str) -> int:
    is_whole = given.strip().isdecimal() and len(given.strip()) <= 9
    return int(_accept("--ends", given, int(given) if is_whole else given, Wire, "ends"))


def _plating(given: str) -> tuple[str, str]:
    """Metal and thickness of a coating; of an example where there is none."""
    if given == NO_PLATING:
        return "gold", "0.2 um"
    parts = re.split(r"\s*,\s*|\s+", given.strip(), maxsplit=1)
    if len(parts) < 2 or not has_unit(parts[1]):
        raise _refused("--plating", given, "lacks a metal or a thickness with its unit", PLATING)
    metal, thickness = parts
    _accept("--plating", given, metal, Plating, "material", f"{PLATING}, of {', '.join(MATERIALS)}")
    _accept("--plating", given, thickness, Plating, "thickness", PLATING)
    return metal, thickness


def _spacing(kind: str) -> Callable[[str], tuple[str, str]]:
    def checked(given: str) -> tuple[str, str]:
        """Key and value of a spacing: a count per length, or the distance itself."""
        text = given.replace(" per ", " /") if has_unit(given) else f"{given.strip()} /inch"
        key = f"{kind}s" if is_quantity(text, "per_length") else f"{kind}_spacing"
        _accept(f"--{kind}s", given, text, KnitTable, key, SPACING)
        return key, text

    return checked


def _load(given: str) -> tuple[tuple[str, str], ...]:
    parts = [part.strip() for part in given.split(",")]
    if len(parts) > 2:
        raise _refused("--load", given, f"has {len(parts)} parts", LOAD)
    return tuple(_load_of(direction, part) for direction, part in zip(SIDES, (parts * 2)[:2], strict=True))


def _load_of(direction: str, given: str) -> tuple[str, str]:
    if not is_quantity(given, "number"):
        _accept("--load", given, given if has_unit(given) else None, Stage, f"tension_{direction}", LOAD)
        return f"tension_{direction}", _toml(given)
    strain = si(given, "number")
    if not has_unit(given) and abs(strain) >= 1.0:
        instead = f"write a strain such as '{given} %' or {strain / 100:g}, or a tension such as '{given} N/m'"
        raise _refused("--load", given, "has no unit", instead)
    _accept("--load", given, given, Stage, f"strain_{direction}", LOAD)
    return f"strain_{direction}", _toml(given) if has_unit(given) else repr(strain)


_CHECKS: dict[str, Callable[[str], Any]] = {
    "knit": _knit,
    "material": lambda given: _accept("--material", given, given, Wire, "material"),
    "diameter": _diameter,
    "ends": _ends,
    "plating": _plating,
    "wales": _spacing("wale"),
    "courses": _spacing("course"),
    "load": _load,
    "model": lambda given: _accept("--model", given, given, ModelOptions, "kind"),
}


# --- the file ---------------------------------------------------------------------------------------------------------


def scene_text(request: SceneRequest, file_name: str) -> str:
    """The scene file of a request, in TOML: the template new_scene.template with its values."""
    request = request.filled_in
    knit, metal, loads = _knit(request.knit), MATERIALS[request.material], _load(request.load)
    coating, thickness = _plating(request.plating)
    is_net = any(bar.threading != "|" for bar in knit.bars)
    values = {
        "title": knit.title[0].upper() + knit.title[1:],
        "about": knit.about,
        "file": shlex.quote(file_name),
        "material": _toml(request.material),
        "diameter": _toml(_diameter(request.diameter)),
        "ends": str(_ends(request.ends)),
        "plating_off": "# " if request.plating == NO_PLATING else "",
        "metal": _toml(coating),
        "coating": _toml(thickness),
        "modulus": _toml(exact(metal.youngs_modulus, "Pa")),
        "limit": _toml(exact(metal.yield_stress, "Pa")),
        "bars": _bars(knit.bars),
        "loop": "closed_radius = 0.6" if is_net else "leg_half_width = 0.24",
        "kind": _toml(request.model),
        "sweep": _sweep(loads),
    }
    for kind, given in (("wale", request.wales), ("course", request.courses)):
        key, value = _spacing(kind)(given)
        what = f"{kind}s per length" if key == f"{kind}s" else f"distance of the {kind}s"
        values |= {f"{kind}_key": key, f"{kind}s": _toml(value), f"{kind}_what": what}
    for key, value in loads:
        kind, _, side = key.partition("_")
        what, other = ("relative to the mesh as knitted", "tension") if kind == "strain" else ("force per width", "strain")
        values |= {f"{side}_key": key, side: value, f"{side}_what": f"{what}; or {other}_{side}"}
    template = files("warpknit.scene").joinpath("new_scene.template").read_text(encoding="utf-8")
    template = re.sub(r"^\?net (.*\n)", r"\1" if is_net else "", template, flags=re.MULTILINE)
    text = Template(template).substitute(values)
    return re.sub(r"^((?:# )?\w+ = .*?)  # ", lambda line: f"{line[1]:<{COMMENTS_AT}}  # ", text, flags=re.MULTILINE)


def _bars(bars: Sequence[GuideBar]) -> str:
    places = ("the only bar",) if len(bars) == 1 else ("back bar", *("middle bar",) * (len(bars) - 2), "front bar")
    lines = []
    for bar in bars:
        threading = f", threading = {_toml(bar.threading)}" if bar.threading != "|" else ""
        lines.append(f"    {{chain = {_toml(bar.chain)}{threading}{f', shift = {bar.shift}' if bar.shift else ''}}},")
    width = max(map(len, lines))
    return "\n".join(f"{line:<{width}}  # {place}" for line, place in zip(lines, places, strict=True))


def _sweep(loads: Sequence[tuple[str, str]]) -> str:
    """Loads of a map: tensions about the tension of the scene, or strains."""
    tensions = [si(value.strip('"'), "tension") if key.startswith("tension") else 0.0 for key, value in loads]
    if min(tensions) == 0.0:
        return "\n".join(f"# strain_{side} = [0.0, 0.02, 0.04, 0.06, 0.08, 0.1]  # or tension_{side}" for side in SIDES)
    shares = (
        (side, ", ".join(f"{share * tension:.4g}" for share in SWEPT)) for side, tension in zip(SIDES, tensions, strict=True)
    )
    return "\n".join(f"# tension_{side} = [{values}]  # N/m; or strain_{side}" for side, values in shares)


def _toml(text: str) -> str:
    import tomli_w

    return tomli_w.dumps({"x": text.strip()}).partition("=")[2].strip()
