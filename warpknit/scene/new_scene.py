"""The text of a new scene file: a knit by name, a wire, a load, and a comment for each key.

    request = SceneRequest(knit="tricot", diameter="30 um", load="6 %, 2 N/m")
    scene_text(request, "tricot.toml")

Values are text as people type it. They are checked as in a scene, and stand in the file as they were typed.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from pydantic_core import PydanticCustomError

from warpknit.base.text import exact
from warpknit.knit.chain import KnitError
from warpknit.knit.named import NamedKnit, named_knit
from warpknit.scene.file import SceneFile
from warpknit.scene.keys import Table, keys_of
from warpknit.scene.knit import KnitTable
from warpknit.scene.loads import Stage
from warpknit.scene.materials import MATERIALS
from warpknit.scene.options import ModelOptions
from warpknit.scene.units import QuantityError, has_unit, shown, si
from warpknit.scene.wire import Plating, Wire

LOAD = "write a strain such as '6 %', a tension such as '2 N/m', or both, '6 %, 2 N/m', for weft and warp"
PLATING = "write a metal and the thickness of its coating, such as 'gold, 0.2 um'"
SPACING = "write a count per length such as '26 /inch', a count an inch such as 26, or a distance such as '0.98 mm'"
COMMENT_COLUMN = 30  # of the comments behind keys
SWEPT = (0.25, 0.5, 1.0, 1.75, 2.5)  # tensions of a map over that of the scene: from 2 N/m to those in orbit


class Refused(ValueError):
    """A value that cannot stand in a scene: what was given, what is wrong with it and what to write instead."""

    def __init__(self, given: str, wrong: str, instead: str) -> None:
        super().__init__(f"{shown(given)} {wrong}; {instead}")


@dataclass(frozen=True)
class SceneRequest:
    """What a new scene is asked for, as typed; "": the default of the knit."""

    knit: str = "double-atlas"
    material: str = "molybdenum"
    diameter: str = "30 um"
    ends: str = "1"
    plating: str = ""  # none
    wales: str = ""
    courses: str = ""
    load: str = ""
    model: str = "auto"

    @property
    def named(self) -> NamedKnit:
        """The knit of the name; raises `Refused`."""
        return _knit(self.knit)

    @property
    def spacings(self) -> tuple[str, str]:
        """Wales and courses, with the defaults of the knit."""
        return self.wales or f"{self.named.wales} /inch", self.courses or f"{self.named.courses} /inch"

    @property
    def loading(self) -> str:
        """The load, with the default of the knit."""
        return self.load or f"{self.named.strain} %"


def check_value(name: str, given: str) -> None:
    """Check one value of a `SceneRequest`. Raises `Refused`."""
    _CHECKS[name](given)


def check_file_name(name: str) -> None:
    """Check the name of a file, which also names the directory of its results. Raises `Refused`."""
    if not name.isprintable():  # such as a byte that is no UTF-8
        raise Refused(name, "cannot be shown", "write a name of printable characters")
    _accept(name, name.removesuffix(".toml"), SceneFile, "name")


def _accept(given: str, value: Any, table: type[Table], key: str, instead: str = "") -> Any:
    """A value in SI, by the check of its key. `given`: of which it is a part; instead: what to write for the whole."""
    check = keys_of(table)[key].check
    assert check is not None
    try:
        return check(value)
    except PydanticCustomError as error:
        context = error.context or {}
        raise Refused(given, "cannot be used" if instead else context["wrong"], instead or context["instead"]) from error


def _knit(given: str) -> NamedKnit:
    try:
        return named_knit(given)
    except KnitError as error:
        raise Refused(given, "is no knit", error.instead) from error


def _diameter(given: str) -> str:
    if not has_unit(given):
        raise Refused(given, "has no unit", "write a length with its unit, such as '30 um'")
    _accept(given, given, Wire, "diameter")
    return given


def _ends(given: str) -> int:
    is_whole = given.strip().isdecimal() and len(given.strip()) <= 9
    return int(_accept(given, int(given) if is_whole else given, Wire, "ends"))


def _plating(given: str) -> tuple[str, str]:
    """Metal and thickness of a coating."""
    parts = re.split(r"\s*,\s*|\s+", given.strip(), maxsplit=1)
    if len(parts) < 2 or not has_unit(parts[1]):
        raise Refused(given, "lacks a metal or a thickness with its unit", PLATING)
    metal, thickness = parts
    _accept(given, metal, Plating, "material", f"{PLATING}, of {', '.join(MATERIALS)}")
    _accept(given, thickness, Plating, "thickness", PLATING)
    return metal, thickness


def _spacing(kind: str) -> Callable[[str], tuple[str, str]]:
    def checked(given: str) -> tuple[str, str]:
        """Key and value of a spacing: a count per length, or the distance itself."""
        text = given.replace(" per ", " /") if has_unit(given) else f"{given.strip()} /inch"
        key = f"{kind}s" if _is(text, "per_length") else f"{kind}_spacing"
        _accept(given, text, KnitTable, key, SPACING)
        return key, text

    return checked


def _load(given: str) -> tuple[tuple[str, str], ...]:
    """Keys and values of weft and warp."""
    parts = [part.strip() for part in given.split(",")]
    if len(parts) > 2:
        raise Refused(given, f"has {len(parts)} parts", LOAD)
    return tuple(_load_of(direction, part) for direction, part in zip(("weft", "warp"), (parts * 2)[:2], strict=True))


def _load_of(direction: str, given: str) -> tuple[str, str]:
    if not _is(given, "number"):
        _accept(given, given if has_unit(given) else None, Stage, f"tension_{direction}", LOAD)
        return f"tension_{direction}", _toml(given)
    strain = si(given, "number")
    if not has_unit(given) and abs(strain) >= 1.0:
        instead = f"write a strain such as '{given} %' or {strain / 100:g}, or a tension such as '{given} N/m'"
        raise Refused(given, "has no unit", instead)
    _accept(given, given, Stage, f"strain_{direction}", LOAD)
    return f"strain_{direction}", _toml(given) if has_unit(given) else repr(strain)


def _is(text: str, dimension: str) -> bool:
    """Whether a text is a quantity of this dimension."""
    try:
        si(text, dimension)
    except QuantityError:
        return False
    return True


_CHECKS: dict[str, Callable[[str], Any]] = {
    "knit": _knit,
    "material": lambda given: _accept(given, given, Wire, "material"),
    "diameter": _diameter,
    "ends": _ends,
    "plating": _plating,
    "wales": _spacing("wale"),
    "courses": _spacing("course"),
    "load": _load,
    "model": lambda given: _accept(given, given, ModelOptions, "kind"),
}


# --- the file ---------------------------------------------------------------------------------------------------------


def scene_text(request: SceneRequest, file_name: str) -> str:
    """The scene file of a request, in TOML. Raises `Refused` for a bad value."""
    parts = (
        _head(request, file_name),
        _wire(request),
        _knit_table(request),
        _model(request),
        _stages(request),
        _options(request),
    )
    return "\n".join("\n".join(lines) + "\n" for lines in parts)


def _head(request: SceneRequest, file_name: str) -> Iterator[str]:
    knit = request.named
    yield f"# {knit.title[0].upper()}{knit.title[1:]}: {knit.about}."
    yield "# One tile of an endless mesh, stretched in weft (across) and warp (along the wales)."
    yield "#"
    yield f"#     warpknit plan {shlex.quote(file_name)}    shows what would run"
    yield f"#     warpknit run {shlex.quote(file_name)}     runs it; --preset draft is faster"
    yield "#"
    yield "# Quantities are text with a unit. Lines that begin with # are comments: remove the # to use the key behind it."
    yield "# docs/scenes.md has all keys."


def _wire(request: SceneRequest) -> Iterator[str]:
    modulus = _toml(exact(MATERIALS[request.material].youngs_modulus, "Pa"))
    yield "[wire]"
    yield _key("material", _toml(request.material), "tungsten, molybdenum or gold: stiffness, density, expansion, strength")
    yield _key("diameter", _toml(_diameter(request.diameter)), "of one wire, without plating")
    yield _key("ends", str(_ends(request.ends)), "parallel wires, knitted as one yarn")
    metal, thickness = _plating(request.plating or "gold, 0.2 um")
    plating = f"{{material = {_toml(metal)}, thickness = {_toml(thickness)}}}"
    yield (_key if request.plating else _off)("plating", plating, "adds stiffness, mass and thickness")
    yield _off("youngs_modulus", modulus, "instead of that of the material; other constants in the same way")
    limit = _toml(exact(MATERIALS[request.material].yield_stress, "Pa"))
    yield _off("yield_stress", limit, "elastic limit, assumed: that of your wire decides first yield and best tension")
    if _strained(request):
        yield _off("plastic", "true", "the wire yields at yield_stress and keeps a set")


def _knit_table(request: SceneRequest) -> Iterator[str]:
    bars = request.named.bars
    fully_threaded = all(bar.threading == "|" for bar in bars)
    yield "[knit]"
    yield "# One line a guide bar. A chain has one link a-b a course: the guide laps from gap a to b, over the needle between."
    if not fully_threaded:
        yield "# threading: | a guide with a wire, . an empty one. shift: needles to the right."
    yield "# `warpknit new --list` has other knits."
    yield "bars = ["
    places = ("the only bar",) if len(bars) == 1 else ("back bar", *("middle bar",) * (len(bars) - 2), "front bar")
    lines = []
    for bar, place in zip(bars, places, strict=True):
        threading = f", threading = {_toml(bar.threading)}" if bar.threading != "|" else ""
        shift = f", shift = {bar.shift}" if bar.shift else ""
        lines.append((f"    {{chain = {_toml(bar.chain)}{threading}{shift}}},", place))
    width = max(len(line) for line, _ in lines)
    yield from (f"{line:<{width}}  # {place}" for line, place in lines)
    yield "]"
    for kind, given, across in zip(("wale", "course"), request.spacings, ("weft", "warp"), strict=True):
        key, value = _spacing(kind)(given)
        what = f"{kind}s per length" if key == f"{kind}s" else f"distance of the {kind}s"
        yield _key(key, _toml(value), f"{what} along {across}, of the mesh as knitted")
    yield _key("repeats", "[1, 1]", "repeats of the pattern along weft and warp")
    yield _off("scatter", "0.05", "loops of uneven shape, with this relative standard deviation")
    loop = "leg_half_width = 0.24" if fully_threaded else "closed_radius = 0.6"
    yield _off("loop", f"{{{loop}}}", "shape of the loops; see figures/knit.png of a run")


def _model(request: SceneRequest) -> Iterator[str]:
    yield "[model]"
    yield _key("kind", _toml(request.model), "planar, spatial, or auto: spatial unless a key exists only in the planar model")
    yield _key("boundary", '"periodic"', 'one tile of an endless mesh; "gripped": a patch, which needs more repeats')
    yield _off("nodes_per_loop", "48", "instead of the preset's")


def _stages(request: SceneRequest) -> Iterator[str]:
    yield "[load]"
    for key, value in _load(request.loading):
        kind, _, direction = key.partition("_")
        other = "tension" if kind == "strain" else "strain"
        what = "relative to the mesh as knitted" if kind == "strain" else "force per width"
        yield _key(key, value, f"{what}; or {other}_{direction}")
    yield _off("temperature", '"20 degC"', "of this stage")
    yield ""
    yield "# Further stages follow in order. Each keeps what it does not change."
    yield "# [[path]]"
    yield '# name = "cold"'
    yield '# temperature = "-190 degC"'
    yield "#"
    yield "# [[path]]"
    yield '# name = "hot"'
    yield '# temperature = "140 degC"'


def _options(request: SceneRequest) -> Iterator[str]:
    if _strained(request):
        yield "# [contact]"
        yield _off("friction", "0.2", "coefficient; the state then depends on the load history")
        yield ""
    yield "# [solver]"
    yield _off("preset", '"draft"', "draft, standard or reference")
    yield ""
    yield "# [output]"
    yield _off("frames", "20", "recorded load levels a stage; small increments follow the loading path")
    yield _off("usd", "false", "no scene.usda for Blender and usdview")
    yield _off("vtk", "true", "files for ParaView")
    yield ""
    yield "# For `warpknit map` and `warpknit report`: each load in weft with each in warp, instead of [load]."
    yield "# Meshes in orbit carry 2 to 4.9 N/m, at strains that differ from knit to knit: a report tells which map holds them."
    yield "# [sweep]"
    yield from _sweep(request)


def _sweep(request: SceneRequest) -> Iterator[str]:
    """Loads of a map: tensions about those of the scene, or strains."""
    tensions = [si(value.strip('"'), "tension") if key.startswith("tension") else 0.0 for key, value in _load(request.loading)]
    for side, tension in zip(("weft", "warp"), tensions, strict=True):
        if min(tensions) > 0.0:
            yield f"# tension_{side} = [{', '.join(f'{share * tension:.4g}' for share in SWEPT)}]  # N/m; or strain_{side}"
        else:
            yield f"# strain_{side} = [0.0, 0.02, 0.04, 0.06, 0.08, 0.1]  # or tension_{side}"


def _strained(request: SceneRequest) -> bool:
    """Whether both directions are driven by strain, as friction and yield require."""
    return all(key.startswith("strain") for key, _ in _load(request.loading))


def _key(name: str, value: str, comment: str) -> str:
    """A line of the file, with its comment."""
    return _behind(f"{name} = {value}", comment)


def _off(name: str, value: str, comment: str) -> str:
    """The same, commented out."""
    return _behind(f"# {name} = {value}", comment)


def _behind(line: str, comment: str) -> str:
    """A line with a comment behind it."""
    return f"{line:<{COMMENT_COLUMN - 2}}  # {comment}"


def _toml(text: str) -> str:
    """Text as a TOML string."""
    import tomli_w

    return tomli_w.dumps({"x": text.strip()}).partition("=")[2].strip()
