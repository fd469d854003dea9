"""Load a scene from a file, text or a dict (keys: `warpknit.scene.scene`); every error is a `SceneError` of one line."""

from __future__ import annotations

import difflib
import math
import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from itertools import takewhile
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from ..base import toml
from ..base.errors import BadValue
from ..base.text import at_least, engineering
from .capabilities import kind_of_model, refuse
from .keys import as_object
from .knit import Knit, KnitTable
from .materials import MATERIALS
from .messages import Source, first_error, scene_error
from .options import GIVEN, TREATMENT_KEYS, Contact, ModelOptions, Solver, Variants
from .overrides import as_list, with_overrides
from .panel_options import PanelOptions, covering_repeats, panel_options
from .presets import PRESETS, Preset
from .scene import FILE, Overrides, Scene, SceneFile, may_vary, resolved_toml
from .stages import file_diameter, hook_of, stages_of, wire_file
from .units import has_unit, is_quantity, shown
from .values import LINKS
from .wire import Wire

PACKAGE = Path(__file__).parents[1]
FOLDER = next((folder for folder in (PACKAGE / "scenes", PACKAGE.parent / "scenes") if folder.is_dir()), PACKAGE / "scenes")
IN_CODE = Path("scene")  # names a scene that no file holds
SPACING_RATIO = 10.0  # largest ratio of wale and course spacing, either way
SINGLE_NODES = 48  # nodes a loop above which double is the default: round-off grows as EI/h^2
SINGLE_SLENDERNESS = 1e-3  # of s (d/W)^2, s being the softening, below which it is too: round-off grows as EA/s, forces as EI/W^2
VARIANTS = 16  # meshes of a spatial tile
OF_THE_METAL = ("youngs_modulus", "poissons_ratio", "density", "expansion", "yield_stress", "tensile_strength")
ASSUMED = (*(("wire", name) for name in OF_THE_METAL), ("contact", "friction"), ("variants", "count"))  # by default
SINGLE_TOLERANCE = 1e-3  # least residual tolerance that single precision can meet
_BARE_VALUE = re.compile(r"""[=\[,]\s*([^\s"'\[{][^,"'#\]}]*)""")
_WORD = re.compile(r"(?!(?:true|false|inf|nan)$)[A-Za-z][\w-]*")


def load_scene(
    source: str | os.PathLike[str] | Mapping[str, Any] | Scene,
    overrides: Overrides = (),
    preset: str | None = None,
    *,
    command: str = "",
    ranks: int = 1,
) -> Scene:
    """Checked scene of a file, a text or a dict, in SI.

        load_scene("scenes/atlas_cell.toml", {"wire.diameter": "17 um"}, preset="draft")
        load_scene({"wire": {"diameter": "17 um"}, "model": {"boundary": "periodic"}, "load": {"strain_warp": 0.1}})
        load_scene('''
            [load]
            strain_warp = 0.1
        ''')

    source: a path, TOML text, a dict, or a scene, which is then changed. A string is TOML if it has a line break, or "=" and is
        no file. Other strings are paths, or names of scenes that ship with the package, such as "atlas_patch". A file takes
        precedence over a name.
    overrides: values of dotted keys, as a mapping, or a list of "key=value" strings (the value is TOML, else a plain string) and
        of (key, value) pairs. An override replaces the keys of the file for the same quantity: a strain replaces the tension in
        this direction.
    preset: replaces `solver.preset`; keys given in the file take precedence.
    command, ranks: use of the scene, as in `refuse`. With `model.kind = "auto"` the model may depend on them.

    Quantities are strings with their unit or numbers in SI; docs/scenes.md has all keys.

    Raises SceneError: one line with the file, the key, what is wrong and what to write instead.
    """
    if isinstance(source, Scene):
        depends_on_command = source.kind_reason != GIVEN or "variants.count" in source.assumed
        if not overrides and preset is None and not (source.is_as_written and depends_on_command):
            return source
        if source.is_as_written:
            return source.changed(overrides, preset, command=command, ranks=ranks)
        path, table = source.path, toml.loads(resolved_toml(source))
        if source.wires is not None:
            table["wires"]["file"] = source.wires.file
    else:
        path, table = _read(source)
    return make_scene(table, overrides, preset, path=path, command=command, ranks=ranks)


def _read(source: str | os.PathLike[str] | Mapping[str, Any]) -> tuple[Path, Mapping[str, Any]]:
    """The name of a source, for messages, and its table."""
    if isinstance(source, Mapping):
        return IN_CODE, source
    if not isinstance(source, str | os.PathLike) or (isinstance(source, str) and not source):
        raise scene_error(IN_CODE, "", f"{shown(source)} is not a scene", "give a path, TOML text, a dict or a scene")
    is_text = isinstance(source, str) and ("\n" in source or ("=" in source and not os.path.exists(source)))
    path, expected = (IN_CODE, "give a scene in TOML") if is_text else (Path(source), "give a scene file in TOML")
    if not is_text and not path.is_file():
        path = shipped_scenes().get(str(path), path)
    text = ""
    try:
        text = str(source) if is_text else path.read_bytes().decode("utf-8-sig")
        return path, toml.loads(text)
    except OSError as error:
        wrong = "a directory" if path.is_dir() else (error.strerror or "unreadable").lower()
        name = nearest_scene(path)
        expected += f", or the name of a scene{f', such as {name}' if name else ' of warpknit new --list'}"
        raise scene_error(path, "", wrong, expected) from error
    except UnicodeDecodeError as error:
        wrong = f"a byte that is not UTF-8 ({error.object[error.start]:#x})"
        raise scene_error(path, "", wrong, "save the file as UTF-8") from error
    except (ValueError, RecursionError) as error:
        fault, quoted = _unquoted(text, str(error))
        raise scene_error(path, "", f"invalid TOML ({fault})", quoted or expected) from error


def _unquoted(text: str, fault: str) -> tuple[str, str]:
    """Fault of a text that is not TOML; remedy if its line is known."""
    place, lines = re.search(r"at line (\d+)", fault), text.splitlines()
    if place is not None and int(place[1]) <= len(lines) and not lines[int(place[1]) - 1].lstrip().startswith("["):
        for value in map(str.strip, _BARE_VALUE.findall(lines[int(place[1]) - 1])):
            if _WORD.fullmatch(value) or (is_quantity(value) and has_unit(value)):
                return f"line {place[1]}: {value} without quotes", f'write "{value}"'
    remedy = "give each key once" if "overwrite" in fault else "correct this line"
    return fault, "" if place is None else remedy


# --- scenes that ship with the package: in scenes/ of a clone, beside the modules in a wheel


def shipped_scenes() -> dict[str, Path]:
    """Files of the scenes by name, such as `atlas_patch`."""
    return {path.stem: path for path in sorted(FOLDER.rglob("*.toml"))}


def first_sentence(path: Path) -> str:
    """The first sentence of the comment on top of a scene."""
    lines = path.read_text(encoding="utf-8").splitlines()
    comment = " ".join(line.removeprefix("#").strip() for line in takewhile(lambda line: line.startswith("#"), lines))
    return re.split(r"(?<=[.:]) ", comment, maxsplit=1)[0].rstrip(":.")


def nearest_scene(path: Path) -> str | None:
    """The name of the scene nearest to a path, if one is close."""
    return next(iter(difflib.get_close_matches(path.stem, shipped_scenes(), n=1)), None)


# --- the scene of a table


def make_scene(
    table: Mapping[str, Any],
    overrides: Overrides = (),
    preset: str | None = None,
    *,
    path: str | os.PathLike[str] = "scene.toml",
    command: str = "",
    ranks: int = 1,
) -> Scene:
    """The scene of a table as read from TOML; `path` is for messages, and names a scene without `name`."""
    path = Path(path)
    is_empty = not table and path != IN_CODE
    if preset is not None:
        overrides = [*as_list(overrides), ("solver.preset", preset)]
    table = with_overrides(path, table, overrides)
    try:
        file = FILE.validate_python(table)
    except ValidationError as error:
        raise first_error(path, error) from error
    source = Source(path, table)
    kind, kind_reason = kind_of_model(file, command=command, ranks=ranks)
    file = replace(file, model=replace(file.model, kind=kind))
    refuse(file, source=source)
    diameter = file_diameter(source, file)
    wire = _wire(source, file.wire if diameter is None else replace(file.wire, diameter=diameter))
    panel = _panel(source, file)
    hook, wires = hook_of(source, file, wire), wire_file(source, file, wire, has_widths=diameter is not None)
    scale = hook.radius if hook is not None else wires.loop_size if wires is not None else None
    if scale is None:
        knit = _knit(source, file, wire, panel)
    else:  # nothing, but a scale of lengths [m]
        knit = Knit(bars=(), wale_spacing=scale, course_spacing=scale, loop=file.knit.loop)
    numerics = PRESETS[file.solver.preset][file.model.kind, file.solver.drive]
    if wires is not None:
        numerics = replace(numerics, nodes_per_loop=wires.nodes_per_loop)
    return Scene(
        name=file.name or path.stem,
        path=path,
        wire=wire,
        knit=knit,
        hook=hook,
        wires=wires,
        model=_model(source, file.model, wire, numerics),
        panel=panel,
        stages=tuple(stages_of(source, file, wire, knit, panel, hook)),
        contact=_contact(source, file, wire),
        solver=_solver(source, file, numerics, wire.diameter / knit.wale_spacing),
        output=file.output,
        variants=_variants(file, of_one_mesh=command in ("trade", "error") or ranks > 1),
        sweep=file.sweep,
        reflection=file.reflection,
        kind_reason=kind_reason,
        assumed=tuple(".".join(key) for key in ASSUMED if getattr(getattr(file, key[0]), key[1]) is None),
        is_empty=is_empty,
        bare_temperatures=tuple(_bare_temperatures(table)),
        even_chains=tuple(_even_chains(table, knit)),
        remake=partial(make_scene, table, path=path),
    )


def _bare_temperatures(table: Mapping[str, Any]) -> Iterator[float]:
    """[K] temperatures of a checked table that are numbers without a unit."""
    stages = [("temperature", stage) for stage in (table.get("load", {}), *table.get("path", ()))]
    for key, part in [*stages, ("reference_temperature", table.get("wire", {}))]:
        value = part.get(key, "20 degC")
        if not isinstance(value, str) or not has_unit(value):
            yield float(value)


def _even_chains(table: Mapping[str, Any], knit: Knit) -> Iterator[str]:
    """Chains in even numbers, with the same chains in needles."""
    for given, bar in zip(table.get("knit", {}).get("bars", ()), knit.bars, strict=False):
        if (chain := LINKS(given["chain"])) != bar.chain:
            yield f"{chain} as {bar.chain}"


def _wire(source: Source, table: Wire) -> Wire:
    metal = MATERIALS[table.material]
    surface = metal if table.plating is None else MATERIALS[table.plating.material]
    left_out = {name: getattr(metal, name) for name in OF_THE_METAL if getattr(table, name) is None}
    if table.hardness is None:
        left_out["hardness"] = surface.hardness
    wire = replace(table, **left_out)
    wrong = "is above the tensile strength"
    source.limit(("wire", "yield_stress"), wire.yield_stress, wrong, most=wire.tensile_strength, unit="Pa")
    if wire.plating is not None:
        location = ("wire", "plating", "thickness")
        source.limit(location, wire.plating.thickness, "is above the radius of the wire", most=wire.radius)
    return wire


def _knit(source: Source, file: SceneFile, wire: Wire, panel: PanelOptions) -> Knit:
    """The knit, with enough repeats to cover the panel."""
    knit = _one_knit(source, file.knit, wire)
    if panel.outline == "rectangle":
        return knit
    repeats = covering_repeats(panel.shape(knit.size), knit.repeat)
    if file.knit.repeats not in ((1, 1), repeats):
        wrong = f"do not fit panel.outline = {panel.outline!r}, which {list(repeats)} cover"
        raise source.refusal(("knit", "repeats"), list(file.knit.repeats), wrong, "leave them out")
    return replace(knit, repeats=repeats)


def _one_knit(source: Source, table: KnitTable, wire: Wire) -> Knit:
    spacing = {}
    for key, length, count_key, count in (
        ("wale_spacing", table.wale_spacing, "wales", table.wales),
        ("course_spacing", table.course_spacing, "courses", table.courses),
    ):
        spacing[key] = length if count is None else 1 / count
        if not 2 * wire.diameter <= spacing[key] < math.inf:
            wrong = "puts loops less than two wire diameters apart" if spacing[key] < 1.0 else "puts loops too far apart"
            instead = f"write {key} = '{at_least(2 * wire.diameter, 'm')}' or more"
            raise source.refusal(("knit", key if count is None else count_key), spacing[key], wrong, instead)
    ratio = spacing["wale_spacing"] / spacing["course_spacing"]
    if not 1 / SPACING_RATIO <= ratio <= SPACING_RATIO:
        kind, count = ("course", table.courses) if ratio > 1.0 else ("wale", table.wales)  # the denser of both
        key = f"{kind}_spacing" if count is None else f"{kind}s"
        wrong = (
            f"puts wales {engineering(spacing['wale_spacing'], 'm', 4)} and courses"
            f" {engineering(spacing['course_spacing'], 'm', 4)} apart"
        )
        instead = f"write spacings that differ by a factor of at most {SPACING_RATIO:g}"
        raise source.refusal(("knit", key), spacing[f"{kind}_spacing"], wrong, instead)
    return as_object(Knit, table, **spacing)


def _model(source: Source, table: ModelOptions, wire: Wire, numerics: Preset) -> ModelOptions:
    nodes = numerics.nodes_per_loop if table.nodes_per_loop is None else table.nodes_per_loop
    radius = wire.diameter / 8 if table.body_radius is None else table.body_radius
    source.limit(("model", "body_radius"), radius, "is above the diameter of the wire", most=wire.diameter)
    return replace(table, nodes_per_loop=nodes, body_radius=radius)


def _contact(source: Source, file: SceneFile, wire: Wire) -> Contact:
    """[contact] with the defaults of its treatment; what the treatment does not have is None."""
    table = file.contact
    if table.ring_radius is not None:
        wrong = "is below the radius of the wires, which pass through the ring"
        source.limit(("contact", "ring_radius"), table.ring_radius, wrong, least=wire.radius)
    defaults = {
        "friction": file.model.of_kind.friction,
        "spring_stiffness": 1e-3,
        "ring_radius": wire.diameter,
        "plane_friction": 0.1,
        "plane_load": 1e-5,
        "contact_point": 0.5,
        "target_share": 1.0,
    }
    every = (table.treatment,)  # of keys that belong to no treatment
    chosen = {name for name in defaults if table.treatment in TREATMENT_KEYS.get(name, every) and getattr(table, name) is None}
    return as_object(Contact, table, **{name: defaults[name] for name in chosen})


def _variants(file: SceneFile, *, of_one_mesh: bool) -> Variants:
    if file.variants.count is not None:
        return file.variants
    differ = file.variants.scatter or file.variants.friction or file.variants.wire
    several = may_vary(file) and differ and not of_one_mesh and not file.knit.scatter
    return replace(file.variants, count=VARIANTS if several else 1)


def _panel(source: Source, file: SceneFile) -> PanelOptions:
    try:
        return panel_options(file.panel, source.path.parent)
    except BadValue as error:
        raise scene_error(source.path, f"panel.{error.key}", error.wrong, error.instead) from error


def _solver(source: Source, file: SceneFile, numerics: Preset, slenderness: float) -> Solver:
    """The options of [solver]; `slenderness` is the diameter of the wire over the wale spacing."""
    table = file.solver
    given = {}
    for key in ("precision", "axial_softening", "residual_tolerance"):
        given[key] = getattr(numerics if getattr(table, key) is None else table, key)
    nodes = file.model.nodes_per_loop or numerics.nodes_per_loop
    coarse = nodes <= SINGLE_NODES and given["axial_softening"] * slenderness**2 >= SINGLE_SLENDERNESS
    if file.hook is not None or (table.precision is None and not coarse):
        given["precision"] = "double"
    if given["precision"] == "single" and given["residual_tolerance"] < SINGLE_TOLERANCE:
        wrong = "is below the round-off of single precision"
        instead = f'write {SINGLE_TOLERANCE:g} or more, or solver.precision = "double"'
        raise source.refusal(("solver", "residual_tolerance"), given["residual_tolerance"], wrong, instead)
    return replace(table, **given)
