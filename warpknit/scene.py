"""The scene: what is knitted, how it is loaded and solved, as frozen objects in plain SI.

    scene = load_scene("scenes/atlas_patch.toml", overrides=["load.strain_warp=0.05"], preset="draft")

A scene file is TOML; `warpknit.scene_file` lists its keys. Whatever is wrong with it is a SceneError of one line.
The unit of a field stands in its annotation.
"""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import ValidationError
from pydantic_core import PydanticCustomError

from warpknit.errors import SceneError
from warpknit.materials import MATERIALS
from warpknit.outline import Outline
from warpknit.presets import PRESETS, Preset
from warpknit.scene_file import KnitTable, ModelTable, SceneFile, SolverTable, StageTable, SweepTable, WireTable
from warpknit.scene_hook import Hook, contact_values, hook_loads, hook_of
from warpknit.scene_overrides import Override, with_overrides
from warpknit.scene_panel import Cord, PanelError, PanelOptions, covering_repeats, panel_options
from warpknit.scene_report import dotted, first_error, scene_error
from warpknit.scene_resolved import resolved_toml, scene_hash
from warpknit.scene_values import STRAIN
from warpknit.units import shown, tidy
from warpknit.wire import Plating, Wire

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

__all__ = [
    "Bar",
    "Contact",
    "Cord",
    "Hook",
    "Knit",
    "Loop",
    "ModelOptions",
    "Output",
    "PanelOptions",
    "Plating",
    "Pull",
    "Scene",
    "SceneError",
    "Solver",
    "Stage",
    "Sweep",
    "Wire",
    "load_scene",
    "make_scene",
    "resolved_toml",
]


FARTHEST_PULL = 0.5  # of the width of a panel
NEAR_EDGE = 0.1  # of the width of a panel: a pull farther from its edge is a mistake
SPACING_RATIO = 10.0  # largest ratio of wale and course spacing, either way
SINGLE_NODES = 48  # nodes a loop above which double is the default: round-off grows as EI/h^2
SINGLE_TOLERANCE = 1e-3  # least residual tolerance that single precision can meet


@dataclass(frozen=True, kw_only=True)
class Bar:
    """A guide bar: its chain of links a-b, its threading of '|' and '.', its shift in needles."""

    chain: str
    threading: str
    shift: int


@dataclass(frozen=True, kw_only=True)
class Loop:
    """Proportions of the loops in units of the course spacing; `warpknit.knit.loops` says what they measure."""

    shape: str  # auto | circular-oval | general
    closed_radius: float
    closed_head: float
    open_head: float
    open_half_width: float
    closed_foot: float
    open_foot: float
    foot_radius: float
    tilt: float
    lateral_shift: float
    foot_half_width: float
    leg_half_width: float
    head_height: float


@dataclass(frozen=True, kw_only=True)
class Knit:
    """The pattern, its spacings, and how often it repeats along weft (x) and warp (y)."""

    bars: tuple[Bar, ...]
    wale_spacing: Annotated[float, "m"]
    course_spacing: Annotated[float, "m"]
    repeats: tuple[int, int]
    scatter: float
    seed: int
    loop: Loop

    @property
    def repeat(self) -> tuple[float, float]:
        """Width and height of one repeat [m]: it spans the common period of the threadings and of the chains."""
        wales = math.lcm(*(len(bar.threading) for bar in self.bars))
        courses = math.lcm(*(bar.chain.count("/") + 1 for bar in self.bars))
        return (wales * self.wale_spacing, courses * self.course_spacing)

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of all repeats [m]."""
        return (self.repeats[0] * self.repeat[0], self.repeats[1] * self.repeat[1])


@dataclass(frozen=True, kw_only=True)
class ModelOptions:
    """What is kept of the mesh."""

    kind: str  # planar
    boundary: str  # gripped | periodic
    nodes_per_loop: int
    body_radius: Annotated[float, "m"]
    merge_lenses: bool
    frame_expansion: Annotated[float, "1/K"]  # of what holds the edge


@dataclass(frozen=True, kw_only=True)
class Pull:
    """A place on the outline that is moved beside the load of the whole mesh."""

    at: tuple[float, float]  # [m] from the middle of the panel, at rest
    by: tuple[float, float]  # [m]
    width: Annotated[float, "m"] | None  # of the outline that moves along; None where net nodes hold it: the nearest moves


@dataclass(frozen=True, kw_only=True)
class Stage:
    """One stage of the loading, by its end: each direction by strain or by tension, the other of the two being None.

    A hook is driven by `displacement` alone, which its model carries as a shear of its frame (hook.py).
    """

    name: str
    strain_weft: float | None
    tension_weft: Annotated[float, "N/m"] | None
    strain_warp: float | None
    tension_warp: Annotated[float, "N/m"] | None
    shear: float
    temperature: Annotated[float, "K"]  # in the middle of the panel
    temperature_gradient: tuple[float, float]  # [K/m] along weft and warp
    pull: tuple[Pull, ...]
    displacement: Annotated[float, "m"] | None = None  # of the driven end of a hook


@dataclass(frozen=True, kw_only=True)
class Contact:
    """Contact of bodies with wires; a pair is active when closed with more force than the threshold."""

    friction: float
    threshold: Annotated[float, "N"]
    stiffness: Annotated[float, "N/m"] | None  # None: chosen by the model
    treatment: str  # how the contact of a hook is carried: treatment.py; what a treatment does not have is None
    spring_stiffness: Annotated[float, "N/m"] | None
    ring_radius: Annotated[float, "m"] | None
    plane_friction: float | None
    plane_load: Annotated[float, "N"] | None
    contact_point: float | None
    target_share: float | None
    body_mass: float | None  # over half the wire of a loop; None in a relaxation, where masses are fictitious


@dataclass(frozen=True, kw_only=True)
class Solver:
    """How the state is found. None: chosen by the solver."""

    preset: str
    drive: str  # relax | ramp
    precision: str  # single | double
    mass_scaling: float  # all masses times this, in a ramp
    target_time_step: Annotated[float, "s"] | None  # masses raised element by element to reach it, in a ramp
    axial_softening: float  # EA is divided by it in the dynamics
    damping: Annotated[float, "1/s"] | None
    loading_time: Annotated[float, "s"] | None  # of a stage, in a ramp
    residual_tolerance: float
    max_steps: int | None
    multipliers: bool  # take the error of the softened EA and of the contact penalty out again


@dataclass(frozen=True, kw_only=True)
class Output:
    """What is recorded and written."""

    frames: int  # recorded load levels
    usd: bool
    usd_full_every: int  # of the recorded frames hold every point; 0: the first and the ends of stages
    usd_points_per_tile: int
    vtk: bool
    figures: bool
    checkpoint_interval: Annotated[float, "s"]  # of wall time


@dataclass(frozen=True)
class Sweep:
    """The grid of strains of a contact map."""

    strain_weft: tuple[float, ...]
    strain_warp: tuple[float, ...]
    seeds: int  # meshes of scattered loops, from knit.seed on


@dataclass(frozen=True, kw_only=True)
class Scene:
    """Everything a run depends on. Equal scenes are equal wherever they were read from."""

    name: str
    path: Path = field(compare=False)
    wire: Wire
    knit: Knit  # where `hook` is given, nothing is knitted: no bars, and spacings of one radius, which scale what is small
    hook: Hook | None
    model: ModelOptions
    panel: PanelOptions
    stages: tuple[Stage, ...]  # [load], then each [[path]]
    contact: Contact
    solver: Solver
    output: Output
    sweep: Sweep | None

    @property
    def has_moving_edge(self) -> bool:
        """Whether the edge of the mesh does more than follow the load as a whole."""
        return self.panel.cord is not None or any(stage.pull for stage in self.stages)

    @property
    def depends_on_path(self) -> bool:
        """Whether the state depends on the way there, not on the load alone."""
        return self.contact.friction > 0.0 or self.wire.plastic

    @property
    def hash(self) -> str:
        """SHA-256 of the resolved values, in hex. The name and how the file is written do not enter."""
        return scene_hash(self)


def load_scene(path: str | os.PathLike[str], overrides: Sequence[Override] = (), preset: str | None = None) -> Scene:
    """The scene in the TOML file at `path`.

    overrides: "key=value" strings (the value is TOML, else a plain string) or (key, value) pairs; keys are dotted. A
    strain set this way takes the place of the file's tension in that direction, and so for other ways to say the same.
    preset: takes the place of `solver.preset`; keys that the file gives still stand.
    Raises SceneError.
    """
    path = Path(path)
    expected = "a scene file in TOML"
    try:
        table = tomllib.loads(path.read_bytes().decode("utf-8-sig"))
    except OSError as error:
        raise scene_error(path, "the file", (error.strerror or "an unreadable file").lower(), expected) from error
    except (ValueError, RecursionError) as error:
        raise scene_error(path, "the file", f"invalid TOML ({error})", expected) from error
    return make_scene(table, overrides, preset, path=path)


def make_scene(
    table: dict[str, Any],
    overrides: Sequence[Override] = (),
    preset: str | None = None,
    *,
    path: str | os.PathLike[str] = "scene.toml",
) -> Scene:
    """The scene of a table as read from TOML; `path` is for messages, and names a scene without `name`."""
    path = Path(path)
    if preset is not None:
        overrides = [*overrides, ("solver.preset", preset)]
    table = with_overrides(path, table, overrides)
    try:
        file = SceneFile.model_validate(table)
    except ValidationError as error:
        raise first_error(path, error) from error
    source = Source(path, table)
    wire = _wire(source, file.wire)
    hook = None if file.hook is None else hook_of(source, file, wire)
    knit = _knit(source, file.knit, wire) if hook is None else _nothing_knitted(file, hook)
    panel = _panel(source, file)
    if panel.outline != "rectangle":
        repeats = covering_repeats(panel.shape(knit.size), knit.repeat)
        if file.knit.repeats not in ((1, 1), repeats):
            allowed = f"nothing where panel.outline = {panel.outline!r} says how large the mesh is ({list(repeats)} cover it)"
            raise source.refusal(("knit", "repeats"), list(file.knit.repeats), allowed)
        knit = replace(knit, repeats=repeats)
    numerics = PRESETS[file.solver.preset]
    return Scene(
        name=file.name or path.stem,
        path=path,
        wire=wire,
        knit=knit,
        hook=hook,
        model=_model(source, file.model, wire, numerics),
        panel=panel,
        stages=tuple(_stages(source, file, wire, knit, panel) if hook is None else _hook_stages(source, file, wire, hook)),
        contact=Contact(**contact_values(source, file, wire)),
        solver=_solver(source, file.solver, numerics, file.model.nodes_per_loop or numerics.nodes_per_loop, hook),
        output=Output(**file.output.model_dump()),
        sweep=_sweep(source, file.sweep, knit),
    )


@dataclass(frozen=True)
class Source:
    """Where the values came from, as they were written, for messages."""

    path: Path
    table: dict[str, Any]

    def refusal(self, location: Sequence[int | str], value: Any, allowed: str) -> SceneError:
        """The error for a value that clashes with another; `value` is what was checked, shown if none was written."""
        given: Any = self.table
        for part in location:
            known = part < len(given) if isinstance(part, int) else part in given
            given = given[part] if known else value
            if not known:
                break
        return scene_error(self.path, dotted(location), shown(given), allowed)


def _wire(source: Source, table: WireTable) -> Wire:
    given = table.model_dump(exclude={"plating"})
    for key, value in given.items():
        if value is None:
            given[key] = getattr(MATERIALS[table.material], key)
    wire = Wire(**given, plating=None if table.plating is None else Plating(**table.plating.model_dump()))
    if wire.yield_stress > wire.tensile_strength:
        allowed = f"at most the tensile strength, {wire.tensile_strength:g} Pa"
        raise source.refusal(("wire", "yield_stress"), wire.yield_stress, allowed)
    if wire.plating is not None and wire.plating.thickness > wire.radius:
        allowed = f"at most the radius of the wire, {wire.radius:g} m"
        raise source.refusal(("wire", "plating", "thickness"), wire.plating.thickness, allowed)
    return wire


def _knit(source: Source, table: KnitTable, wire: Wire) -> Knit:
    spacing = {}
    for key, length, count_key, count, default in (
        ("wale_spacing", table.wale_spacing, "wales", table.wales, 1.7e-3),
        ("course_spacing", table.course_spacing, "courses", table.courses, 1.0e-3),
    ):
        spacing[key] = length if length is not None else default if count is None else 1 / count
        if not 2 * wire.diameter <= spacing[key] < math.inf:
            least = 2 * wire.diameter
            allowed = f"two diameters of the wire or more between loops, {least:g} m (wire.diameter is {wire.diameter:g} m)"
            raise source.refusal(("knit", key if count is None else count_key), spacing[key], allowed)
    ratio = spacing["wale_spacing"] / spacing["course_spacing"]
    if not 1 / SPACING_RATIO <= ratio <= SPACING_RATIO:
        key = "wales" if table.wales is not None else "wale_spacing"
        allowed = (
            f"between 1/{SPACING_RATIO:g} and {SPACING_RATIO:g} course spacings; this makes wales"
            f" {spacing['wale_spacing'] * 1e3:.4g} mm and courses {spacing['course_spacing'] * 1e3:.4g} mm apart"
            " (bare numbers are SI)"
        )
        raise source.refusal(("knit", key), spacing["wale_spacing"], allowed)
    return Knit(
        bars=tuple(Bar(**bar.model_dump()) for bar in table.bars),
        **spacing,
        repeats=table.repeats,
        scatter=table.scatter,
        seed=table.seed,
        loop=Loop(**table.loop.model_dump()),
    )


def _nothing_knitted(file: SceneFile, hook: Hook) -> Knit:
    """The knit of a hook scene: nothing, but the radius as the scale of lengths."""
    return Knit(
        bars=(),
        wale_spacing=hook.radius,
        course_spacing=hook.radius,
        repeats=(1, 1),
        scatter=0.0,
        seed=0,
        loop=Loop(**file.knit.loop.model_dump()),
    )


def _model(source: Source, table: ModelTable, wire: Wire, numerics: Preset) -> ModelOptions:
    given = table.model_dump()
    if given["nodes_per_loop"] is None:
        given["nodes_per_loop"] = numerics.nodes_per_loop
    if given["body_radius"] is None:
        given["body_radius"] = wire.diameter / 8
    elif given["body_radius"] > wire.diameter:
        allowed = f"at most the diameter of the wire, {wire.diameter:g} m"
        raise source.refusal(("model", "body_radius"), given["body_radius"], allowed)
    return ModelOptions(**given)


def _panel(source: Source, file: SceneFile) -> PanelOptions:
    if file.model.boundary == "periodic" and file.panel != type(file.panel)():
        raise source.refusal(("model", "boundary"), "periodic", "'gripped' with [panel]: a periodic tile has no outline")
    if file.solver.drive == "ramp" and file.contact.friction:
        raise source.refusal(("contact", "friction"), file.contact.friction, "0 with solver.drive = 'ramp'")
    if file.solver.drive == "ramp" and file.wire.plastic:
        raise source.refusal(("wire", "plastic"), file.wire.plastic, "false with solver.drive = 'ramp'")
    if file.solver.drive == "ramp" and file.panel.cord is not None:
        raise scene_error(source.path, "panel.cord", "a cord", "nothing with solver.drive = 'ramp'")
    try:
        panel = panel_options(file.panel, source.path.parent)
    except PanelError as error:
        key = dotted(("panel", error.key))
        raise scene_error(source.path, key, shown(error.given), error.allowed) from error
    return panel


def _solver(
    source: Source, table: SolverTable, numerics: Preset, nodes_per_loop: int, hook: Hook | None = None
) -> Solver:
    given = table.model_dump()
    ramp = "ramp_" if given["drive"] == "ramp" else ""
    for key, name in (
        ("precision", f"{ramp}precision"),
        ("axial_softening", f"{ramp}axial_softening"),
        ("residual_tolerance", "residual_tolerance"),
    ):
        if given[key] is None:
            given[key] = getattr(numerics, name)
    if hook is not None or (table.precision is None and nodes_per_loop > SINGLE_NODES):
        given["precision"] = "double"
    if given["precision"] == "single" and given["residual_tolerance"] < SINGLE_TOLERANCE:
        allowed = f"{SINGLE_TOLERANCE:g} or more in single precision, whose round-off hides less; or precision = \"double\""
        raise source.refusal(("solver", "residual_tolerance"), given["residual_tolerance"], allowed)
    return Solver(**given)


def _sweep(source: Source, table: SweepTable | None, knit: Knit) -> Sweep | None:
    if table is None:
        return None
    if table.seeds > 1 and knit.scatter == 0.0:
        raise source.refusal(("sweep", "seeds"), table.seeds, "1, as without knit.scatter all seeds knit the same mesh")
    return Sweep(tuple(table.strain_weft), tuple(table.strain_warp), table.seeds)


def _stages(source: Source, file: SceneFile, wire: Wire, knit: Knit, panel: PanelOptions) -> Iterator[Stage]:
    """[load] and each [[path]], a stage taking over from the one before what it leaves out."""
    load = _unloaded(wire)
    outline = panel.shape(knit.size)
    by_path = file.contact.friction > 0.0 or file.wire.plastic
    for location, name, table in _named_stages(source, file):
        given = table.model_dump(exclude={"name"}, exclude_none=True)
        if "displacement" in given:
            load |= _displaced(source, (*location, "displacement"), given.pop("displacement"), knit)
        for side in ("weft", "warp"):
            if f"strain_{side}" in given or f"tension_{side}" in given:
                load |= _direction(side, given.pop(f"strain_{side}", None), given.pop(f"tension_{side}", None))
        _check_uneven(source, file, location, given)
        if "pull" in given:
            given["pull"] = tuple(Pull(**pull) for pull in table.model_dump()["pull"])
            for index, pull in enumerate(given["pull"]):
                _check_pull(source, file, (*location, "pull", index), pull, outline)
        load |= given
        _check_warmth(source, location, load, outline)
        for side in ("weft", "warp"):
            if by_path and load[f"tension_{side}"] is not None:
                allowed = "strains with friction or yield: a search for tension would be part of the path"
                raise source.refusal((*location, f"tension_{side}"), load[f"tension_{side}"], allowed)
        yield Stage(name=name, **load)


def _check_uneven(source: Source, file: SceneFile, location: tuple[int | str, ...], given: dict[str, Any]) -> None:
    """Refuse what differs from place to place where nothing can follow it."""
    for key in ("temperature_gradient", "pull"):
        value = given.get(key)
        if not value or value == (0.0, 0.0):
            continue
        if file.model.boundary == "periodic":
            raise source.refusal((*location, key), value, "nothing with model.boundary = 'periodic', which has no edge")
        if file.solver.drive == "ramp":
            raise source.refusal((*location, key), value, "nothing with solver.drive = 'ramp'")
        if key == "temperature_gradient" and not file.solver.multipliers:
            raise source.refusal((*location, key), value, "nothing with solver.multipliers = false, which bring it in")


def _check_warmth(source: Source, location: tuple[int | str, ...], load: dict[str, Any], outline: Outline) -> None:
    """Refuse a gradient that leaves the temperatures there are."""
    from_middle = outline.corners - (outline.low + 0.5 * outline.size)
    there = load["temperature"] + from_middle @ np.array(load["temperature_gradient"])
    if there.min() <= 0.0 or there.max() > 4000.0:
        allowed = f"what keeps the edge between 0 K and 4000 K: this makes {there.min():.4g} K to {there.max():.4g} K"
        raise source.refusal((*location, "temperature_gradient"), load["temperature_gradient"], allowed)


def _check_pull(
    source: Source, file: SceneFile, location: tuple[int | str, ...], pull: Pull, outline: Outline
) -> None:
    size = float(outline.size.min())
    if math.hypot(*pull.by) > FARTHEST_PULL * size:
        allowed = f"at most {FARTHEST_PULL:g} of the panel's width, {FARTHEST_PULL * size:.3g} m"
        raise source.refusal((*location, "by"), pull.by, allowed)
    middle = outline.low + 0.5 * outline.size
    _, away = outline.nearest((middle + np.array(pull.at))[None])
    if away[0] > NEAR_EDGE * size:
        allowed = f"a place on the edge of the panel, or within {NEAR_EDGE * size:.3g} m of it; this is {away[0]:.3g} m away"
        raise source.refusal((*location, "at"), pull.at, allowed)
    if (pull.width is None) == (file.panel.grip_pitch is None):
        allowed = "left out with panel.grip_pitch (net nodes are moved)" if pull.width else "a length: how much of the edge moves"
        raise source.refusal((*location, "width"), pull.width or 0.0, allowed)


def _hook_stages(source: Source, file: SceneFile, wire: Wire, hook: Hook) -> Iterator[Stage]:
    """The stages of a hook."""
    for load in hook_loads(source, _named_stages(source, file), wire, hook):
        yield Stage(**{**_unloaded(wire), **load})


def _unloaded(wire: Wire) -> dict[str, Any]:
    """What the first stage starts from."""
    return {
        **_direction("weft", 0.0, None),
        **_direction("warp", 0.0, None),
        "shear": 0.0,
        "temperature": wire.reference_temperature,
        "temperature_gradient": (0.0, 0.0),
        "pull": (),
    }


def _named_stages(source: Source, file: SceneFile) -> Iterator[tuple[tuple[int | str, ...], str, StageTable]]:
    """Where each stage stands in the file, its name and its table."""
    tables: list[tuple[tuple[int | str, ...], StageTable]] = [(("load",), file.load)]
    tables += [(("path", index), table) for index, table in enumerate(file.path)]
    names: set[str] = set()
    for number, (location, table) in enumerate(tables, start=1):
        name = table.name or ("load" if number == 1 else f"stage-{number}")
        if name in names:
            raise source.refusal((*location, "name"), name, "a name that no other stage has")
        names.add(name)
        yield location, name, table


def _direction(side: str, strain: float | None, tension: float | None) -> dict[str, float | None]:
    return {f"strain_{side}": strain, f"tension_{side}": tension}


def _displaced(
    source: Source, location: Sequence[int | str], displacement: float, knit: Knit
) -> dict[str, float | None]:
    """The strains of every side moved outward by `displacement` [m]."""
    load: dict[str, float | None] = {}
    for side, size in zip(("weft", "warp"), knit.size, strict=True):
        strain = tidy(2 * displacement / size)
        try:
            STRAIN(strain)
        except PydanticCustomError as error:
            allowed = (
                f"what makes a strain {STRAIN.allowed.removeprefix('a number ')}; this makes {strain:.3g} in {side}"
            )
            raise source.refusal(location, displacement, allowed) from error
        load |= _direction(side, strain, None)
    return load
