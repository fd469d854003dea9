"""Compatibility of meshes, models, drives, boundaries, features and commands, in one table.

`TRAITS` are features that a scene or a command may request, `RULES` the combinations that are excluded.
From these follow the refusals (`refuse`, called when a scene is read and by each command), the keys without effect
(`without_effect`, shown by `warpknit plan`), the kind of model of `model.kind = "auto"` (`kind_of_model`), and
docs/capabilities.md (docs/scene_reference.py).
Limits that depend on a size, a file or values of a model are checked where these are known: in wires/read.py, mesh/,
planar/model.py, spatial/.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, cast

from ..base.errors import SceneError
from .keys import Table
from .materials import MATERIALS
from .messages import dotted, scene_error, value_text
from .options import AUTO, DEFAULT, GIVEN
from .wire import Wire

if TYPE_CHECKING:
    from .messages import Source
    from .options import Stage
    from .scene import Scene, SceneFile


Location = tuple[int | str, ...]
Place = tuple[Location, Any]  # a key, and its value if the message has it


@dataclass(frozen=True)
class Case:
    """A scene (of the file or resolved) with command, device and ranks."""

    scene: Scene | SceneFile
    command: str = ""
    device: str | None = None  # that was named
    ranks: int = 1

    @property
    def stages(self) -> Iterator[tuple[Location, Stage]]:
        """Location of each load step, and the step; only the first for a map and a report."""
        for number, stage in enumerate(self.scene.stages[:1] if self.command in ("map", "report") else self.scene.stages):
            yield ("load",) if number == 0 else ("path", number - 1), stage


Asked = Callable[[Case], Iterable[Place]]


@dataclass(frozen=True)
class Trait:
    """A feature that a scene or a command may request."""

    words: str
    key: str  # that requests it
    asked: Asked  # the keys that request it in a case; empty if none does
    example: Mapping[str, Any] = field(default_factory=dict)  # tables of a scene that requests it
    needs: tuple[str, ...] = ()  # traits that it implies


# --- requests of a trait -----------------------------------------------------------------------------------------


def _value(key: str, case: Case) -> Any:
    """The value of a dotted key, or None without its table."""
    value: Any = case.scene
    for part in key.split("."):
        value = None if value is None else getattr(value, part)
    return value


def _turned_and_pulled(case: Case) -> Iterable[Place]:
    for location, stage in case.stages:
        if stage.clamp_rotation and stage.pull:
            yield (*location, "clamp_rotation"), stage.clamp_rotation


def _other_poisson(case: Case) -> bool:
    wire = case.scene.wire
    return wire.poissons_ratio not in (None, MATERIALS[wire.material].poissons_ratio)


def _other_body_radius(case: Case) -> bool:
    radius = case.scene.model.body_radius
    return radius is not None and not math.isclose(radius, case.scene.wire.diameter / 8)


# --- the traits -------------------------------------------------------------------------------------------------------


def _choice(key: str, value: str) -> Trait:
    table, name = key.split(".")
    places: Asked = lambda case: [((table, name), value)] if _value(key, case) == value else []  # noqa: E731
    return Trait(f'`{key} = "{value}"`', key, places, {table: {name: value}})


def _if(words: str, key: str, condition: Callable[[Case], Any], example: Mapping[str, Any] | None = None, *needs: str) -> Trait:
    """Trait of a key, or of an option of a command; messages do not have its value."""
    return Trait(words, key, lambda case: [(tuple(key.split(".")), None)] if condition(case) else [], example or {}, needs)


def _key(words: str, key: str, value: Any, *nothing: Any, needs: tuple[str, ...] = (), **beside: Any) -> Trait:
    """Trait of a key whose value is not `nothing`. Its example is `value`, with the keys `beside` it."""
    *above, last = key.split(".")
    example = {last: value, **beside}
    for part in reversed(above):
        example = {part: example}

    def asked(case: Case) -> Iterable[Place]:
        found = _value(key, case)
        return [] if found is None or found in nothing else [((*above, last), found)]

    return Trait(words, key, asked, example, needs)


def _load(words: str, key: str, value: Any, *others: str, nothing: tuple[Any, ...] = ()) -> Trait:
    def asked(case: Case) -> Iterable[Place]:
        steps = [((*location, name), getattr(stage, name)) for location, stage in case.stages for name in (key, *others)]
        return [(place, found) for place, found in steps if found is not None and found not in nothing]

    return Trait(words, f"load.{key}", asked, {"load": {key: value}})


def _command(words: str, *commands: str, needs: tuple[str, ...] = ()) -> Trait:
    return Trait(words, commands[0], lambda case: [((case.command,), None)] if case.command in commands else [], needs=needs)


PULL = {"at": ["1.7 mm", "0 mm"], "by": ["0.1 mm", "0 mm"], "width": "1 mm"}  # one repeat of the default knit is 3.4 mm wide
CORD = {"tension": "1 N", "stiffness": "1 kN"}
SWEEP = {"strain_weft": [0.0, 0.1], "strain_warp": [0.0]}

# A scene has one of each group, by default the first.
GROUPS = (
    ("knit", "hook", "wires"),
    ("planar", "spatial"),
    ("gripped", "periodic"),
    ("relax", "ramp"),
    ("no sweep", "sweep"),
    ("even loops", "scatter"),
    ("elastic", "plastic"),
)
TRAITS = {
    # the mesh, the model, its edge, how it is driven
    "knit": _if("a knit", "knit", lambda case: case.scene.hook is None and case.scene.wires is None),
    "hook": _key("two hooked wires", "hook", {}, needs=("gripped",)),
    "wires": _if("wires from a file", "wires", lambda case: case.scene.wires, {"wires": {"file": "plain_knit.csv"}}, "spatial"),
    "planar": _choice("model.kind", "planar"),
    "spatial": _choice("model.kind", "spatial"),
    "gripped": _choice("model.boundary", "gripped"),
    "periodic": _choice("model.boundary", "periodic"),
    "relax": _choice("solver.drive", "relax"),
    "ramp": _choice("solver.drive", "ramp"),
    # loads
    "strain": _load("loads by strain", "strain_weft", 0.1, "strain_warp"),
    "tension": _load("loads by tension", "tension_weft", 0.1, "tension_warp"),
    "displacement": _load("load by displacement", "displacement", "0.1 mm"),
    "shear": _load("shear", "shear", 0.1),
    "temperature": _load("temperature", "temperature", "-190 degC"),
    "gradient": _load("temperature gradient", "temperature_gradient", [100.0, 0.0], nothing=((0.0, 0.0),)),
    "pull": _load("pulls at the edge", "pull", [PULL], nothing=((),)),
    "rotation": _load("clamp rotation", "clamp_rotation", 0.1, nothing=(0.0,)),
    "rotation and pull": Trait(
        "clamp rotation and pulls in one load step",
        "load.clamp_rotation",
        _turned_and_pulled,
        {"load": {"clamp_rotation": 0.1, "pull": [PULL]}},
        ("rotation", "pull"),
    ),
    "path": _if("load steps after the first", "path", lambda case: len(case.scene.stages) > 1, {"path": [{"name": "second"}]}),
    # the wire and the knit
    "friction": _key("friction", "contact.friction", 0.2, 0.0),
    "elastic": _if("elastic wire", "wire.plastic", lambda case: not case.scene.wire.plastic),
    "plastic": _key("plastic wire", "wire.plastic", True, False),
    "hardening": _key("hardening", "wire.hardening", 0.2, Wire.hardening),
    "poisson": _if("own Poisson's ratio", "wire.poissons_ratio", _other_poisson, {"wire": {"poissons_ratio": 0.4}}),
    "plating": _key("plating", "wire.plating", {"thickness": "0.2 um"}),
    "even loops": _if("equal loops", "knit.scatter", lambda case: not case.scene.knit.scatter),
    "scatter": _key("scattered loops", "knit.scatter", 0.05, 0.0, needs=("knit",)),
    "seed": _key("seed", "knit.seed", 3, 0, needs=("knit",)),
    "variants": _key("variants", "variants.count", 2, 1, needs=("knit",)),
    # the edge
    "panel": _if(
        "an outline, net, or surface",
        "panel",
        lambda case: case.scene.panel != type(case.scene.panel)(),
        {"panel": {"active_threshold": 50}},
    ),
    "outline": _key("an outline other than a rectangle", "panel.outline", "disc", "rectangle", needs=("panel",), size="10 mm"),
    "cord": _key("edge cords", "panel.cord", CORD, needs=("panel",), grip_pitch="2 mm"),
    "focal length": _key("held on a paraboloid", "panel.focal_length", "1 m", needs=("panel",)),
    # contact
    "stiffness": _key("contact penalty", "contact.stiffness", "10 N/m"),
    "body radius": _if("own body radius", "model.body_radius", _other_body_radius, {"model": {"body_radius": "3 um"}}),
    "treatment": _key("contact treatment", "contact.treatment", "ring", "free-body", needs=("hook",)),
    "body mass": _key("body mass", "contact.body_mass", 0.3, needs=("ramp",)),
    "crossing distance": _key("crossing distance of hooked wires", "hook.crossing_distance", "20 um", needs=("hook", "spatial")),
    "file repeats": _key("repeats of a file", "wires.repeats", [2, 1], (1, 1), needs=("wires", "periodic")),
    # the solver
    "single": _key("single precision", "solver.precision", "single", "double"),
    "no multipliers": _if(
        "no multipliers", "solver.multipliers", lambda case: not case.scene.solver.multipliers, {"solver": {"multipliers": False}}
    ),
    "mass scaling": _key("scaled masses", "solver.mass_scaling", 100.0, 1.0, needs=("ramp",)),
    "target time step": _key("target time step", "solver.target_time_step", "1 us", needs=("ramp",)),
    "loading time": _key("given loading time", "solver.loading_time", "10 ms", needs=("ramp",)),
    "damping": _key("given damping", "solver.damping", "100 /s"),
    "max steps": _key("step limit", "solver.max_steps", 10_000),
    # the sweep
    "no sweep": _if("no sweep", "sweep", lambda case: case.scene.sweep is None),
    "sweep": _key("a sweep", "sweep", SWEEP),
    "sweep by tension": _key("a sweep by tension", "sweep.tension_weft", [0.05], needs=("sweep",), tension_warp=[0.05]),
    "reflection": _key("a reflected wave", "reflection", {"frequencies": ["10 GHz"]}),
    # commands, and options besides the scene
    "map": _command("`warpknit map`", "map", "report", needs=("sweep", "relax")),
    "trade": _command("`warpknit trade`", "trade"),
    "report": _command("`warpknit report`", "report", needs=("map", "periodic")),
    "error": _command("`run --error`", "error", needs=("relax",)),
    "ranks": _if("`mpirun`", "mpirun", lambda case: case.ranks > 1),
    "cuda": _if("a GPU", "--device", lambda case: case.device not in (None, "cpu")),
}
AT_COMMAND = frozenset({"map", "trade", "report", "error", "ranks", "cuda"})


@dataclass(frozen=True)
class Rule:
    """A trait that excludes others."""

    trait: str  # whose key the message names
    others: tuple[str, ...]  # all of them together; the first gives the column of the table
    instead: str  # what to write; empty: the combination is accepted, but the trait has no effect
    why: str

    @property
    def traits(self) -> frozenset[str]:
        return frozenset((self.trait, *self.others))

    @property
    def refused(self) -> bool:
        """Whether the combination is refused."""
        return bool(self.instead)


NOT_BUILT = "not implemented"
LEAVE_OUT = "leave it out"
NO_EFFECT = ""
RELAX, GRIPPED, SPATIAL = (f"write '{word}'" for word in ("relax", "gripped", "spatial"))
KNIT, KNIT_OR_HOOK = "use a scene with [knit]", "use a scene with [knit] or [hook]"
ONE_RANK = "run it without mpirun"
ENDS = "only the two upper ends of a hook move"
SIZE = "the size of the mesh is known only when the file is read"
NO_EDGE = "a periodic tile has no edge, and its load is uniform"
ALONE = "a map strains its mesh uniformly"
FICTITIOUS = "the masses of a relaxation are fictitious, and it has no real time"
OWN_CONTACT = "spatial wires touch each other directly, without bodies"

RULES = (
    # the mesh and its model
    Rule("planar", ("wires",), SPATIAL, "its wires are spatial curves"),
    Rule("periodic", ("hook",), GRIPPED, "both wires of a hook are held at their ends"),
    Rule("panel", ("hook",), LEAVE_OUT, "the wires have no outline"),
    Rule("panel", ("wires",), LEAVE_OUT, "the wires have no outline"),
    Rule("sweep", ("hook",), LEAVE_OUT, "two hooked wires have no strain"),
    Rule("sweep", ("wires",), LEAVE_OUT, NOT_BUILT),
    Rule("ramp", ("wires",), RELAX, NOT_BUILT),
    Rule("reflection", ("hook",), LEAVE_OUT, "two hooked wires are no sheet"),
    Rule("reflection", ("wires",), LEAVE_OUT, "wires of a file may differ in diameter"),
    Rule("reflection", ("gripped",), "write model.boundary = 'periodic'", "the wave meets an endless mesh"),
    Rule("file repeats", ("gripped",), "write [1, 1], or model.boundary = 'periodic'", "wires held at their ends do not repeat"),
    Rule("crossing distance", ("planar",), LEAVE_OUT, "both wires lie in one plane"),
    Rule("scatter", ("variants",), "write it as variants.scatter", "loops scatter from mesh to mesh"),
    Rule("seed", ("variants",), "write it as variants.seed", "each mesh has another seed"),
    Rule("variants", ("ramp",), "write 1", "meshes side by side are relaxed"),
    # contact
    Rule("treatment", ("spatial",), LEAVE_OUT, OWN_CONTACT),
    Rule("treatment", ("knit",), "write 'free-body'", "the other treatments apply to a single contact, in a [hook]"),
    Rule("body mass", ("spatial",), LEAVE_OUT, OWN_CONTACT),
    Rule("body mass", ("relax",), LEAVE_OUT, FICTITIOUS),
    Rule("body radius", ("spatial",), NO_EFFECT, OWN_CONTACT),
    Rule("friction", ("treatment",), "write 0, or contact.treatment = 'free-body'", "each treatment is studied without friction"),
    # friction and yield
    Rule("friction", ("planar", "ramp"), "write 0", NOT_BUILT),
    Rule("plastic", ("ramp",), "write false", NOT_BUILT),
    Rule("hardening", ("elastic",), NO_EFFECT, "it applies only with wire.plastic = true"),
    Rule("poisson", ("planar",), NO_EFFECT, "planar wires do not twist"),
    Rule("seed", ("even loops",), NO_EFFECT, "it applies only with knit.scatter"),
    # loads
    *(
        Rule(trait, ("hook",), "write displacement and temperature alone", ENDS)
        for trait in ("strain", "tension", "shear", "gradient", "pull", "rotation")
    ),
    *(
        Rule(trait, ("wires",), "write strains, tensions, shear and temperature alone", SIZE)
        for trait in ("displacement", "gradient", "pull")
    ),
    *(Rule(trait, ("periodic",), LEAVE_OUT, NO_EDGE) for trait in ("gradient", "pull", "rotation")),
    *(Rule(trait, ("ramp",), LEAVE_OUT, NOT_BUILT) for trait in ("gradient", "pull", "rotation", "cord")),
    Rule("rotation", ("cord",), LEAVE_OUT, "the clamps hang on the cord"),
    *(Rule("rotation", ("spatial", trait), LEAVE_OUT, NOT_BUILT) for trait in ("pull", "focal length")),
    Rule("focal length", ("spatial", "ramp"), LEAVE_OUT, NOT_BUILT),
    Rule("rotation and pull", ("pull",), LEAVE_OUT, "both move the clamps"),
    Rule("gradient", ("no multipliers",), LEAVE_OUT, "the multipliers apply it"),
    Rule("path", ("sweep",), NO_EFFECT, "a map runs only [load]"),
    # the solver
    Rule("single", ("hook",), "write 'double'", "double precision costs nothing with few nodes"),
    Rule("no multipliers", ("spatial",), "write true", NOT_BUILT),
    *(Rule(trait, ("relax",), LEAVE_OUT, FICTITIOUS) for trait in ("target time step", "loading time", "mass scaling")),
    Rule("damping", ("relax",), NO_EFFECT, "it applies only to a ramp"),
    Rule("max steps", ("ramp",), NO_EFFECT, "it applies only to a relaxation"),
    # rules for a whole table, after those for its keys
    Rule("periodic", ("panel",), GRIPPED, "a tile has no outline"),
    # commands
    Rule("wires", ("map",), KNIT, NOT_BUILT),
    Rule("wires", ("trade",), KNIT_OR_HOOK, NOT_BUILT),
    Rule("wires", ("error",), KNIT_OR_HOOK, "settings are tried on a smaller mesh, which requires a knit"),
    Rule("hook", ("map",), KNIT, "two hooked wires have no strain"),
    Rule("hook", ("ranks",), ONE_RANK, "two wires are too few for several ranks"),
    Rule("no sweep", ("map",), "add [sweep], with strains or tensions in weft and warp", "a map reads its loads from [sweep]"),
    Rule("ramp", ("map",), RELAX, "a map consists of equilibria"),
    Rule("ramp", ("error",), RELAX, "errors are estimated for equilibria only"),
    Rule("spatial", ("error", "hook"), "write 'planar'", "errors of spatial hooks are not known"),
    *(Rule(trait, ("spatial", "ranks"), ONE_RANK, NOT_BUILT) for trait in ("ramp", "wires")),
    Rule("gripped", ("report",), "write 'periodic'", "a card describes endless cloth"),
    *(Rule(trait, ("map",), LEAVE_OUT, ALONE) for trait in ("pull", "rotation", "gradient", "cord")),
    Rule("cuda", ("map",), "write --device cpu", "small meshes fit the caches of a CPU"),
    Rule("ranks", ("trade",), ONE_RANK, "its meshes are small"),
    Rule("ranks", ("map",), ONE_RANK, "its meshes are small"),
    Rule("ranks", ("variants",), ONE_RANK, "its meshes are small"),
    Rule("variants", ("trade",), "write 1", "errors refer to one mesh"),
    Rule("variants", ("error",), "write 1", "errors are estimated for one mesh"),
)


def refuse(
    scene: Scene | SceneFile, command: str = "", *, device: str | None = None, ranks: int = 1, source: Source | None = None
) -> None:
    """Raise `SceneError` for the first rule that excludes this scene or command.

    command: run | map | trade | report | error (`run --error`), or empty. device: as named. ranks: processes that share it.
    source: of the values as written, for messages.
    """
    case = Case(scene, command, device, ranks)
    for rule in RULES:
        if rule.refused and bool(command) == bool(rule.traits & AT_COMMAND):
            for location, value in _places(rule, case):
                raise _refusal(case, rule, location, value, source)


def without_effect(scene: Scene) -> Iterator[str]:
    """Keys of the scene without effect, a sentence each."""
    case = Case(scene)
    for rule in RULES:
        if not rule.refused:
            for location, _ in _places(rule, case):
                yield f"without effect: {dotted(location)} ({rule.why})"


def kind_of_model(file: SceneFile, *, command: str = "", ranks: int = 1) -> tuple[str, str]:
    """Kind of model of a scene file, and the reason in words.

    `auto` is spatial, unless the spatial model lacks a feature of the scene or the command that the planar model has.
    command, ranks: as in `refuse`.
    """
    if file.model.kind != AUTO:
        return file.model.kind, GIVEN
    cases = {
        kind: Case(replace(file, model=replace(file.model, kind=kind)), command, ranks=ranks) for kind in ("spatial", "planar")
    }
    spatial, planar = (
        [rule for rule in RULES if kind in rule.traits and list(_places(rule, case))] for kind, case in cases.items()
    )
    if not spatial or any(rule.refused for rule in planar):
        return "spatial", DEFAULT
    return "planar", f"only in the planar model: {', '.join(dict.fromkeys(map(_other_traits, spatial)))}"


def _other_traits(rule: Rule) -> str:
    return " with ".join(TRAITS[name].words for name in TRAITS if name in rule.traits - {"spatial"})


def _places(rule: Rule, case: Case) -> Iterable[Place]:
    """The keys that a rule names; none unless the case has all its traits."""
    if any(not list(TRAITS[name].asked(case)) for name in rule.others):
        return ()
    return TRAITS[rule.trait].asked(case)


def _refusal(case: Case, rule: Rule, location: Location, value: Any, source: Source | None) -> SceneError:
    others = " and ".join(TRAITS[name].words for name in rule.others).replace("`", "").replace('"', "'")
    wrong = f"cannot be combined with {others} ({rule.why})"
    key, path = dotted(location), cast("Scene", case.scene).path if source is None else source.path
    if rule.trait == "no sweep":
        return scene_error(path, key, f"missing for {others}", rule.instead)
    if value is None or isinstance(value, Table):
        return scene_error(path, key, wrong, rule.instead)
    if source is not None:
        return source.refusal(location, value, wrong, rule.instead)
    return scene_error(path, key, f"{value_text(location, value)} {wrong}", rule.instead)
