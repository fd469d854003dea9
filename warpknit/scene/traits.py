"""Features that a scene or a command may request: the traits of the table of compatibilities (capabilities.py)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

from warpknit.scene.materials import MATERIALS
from warpknit.scene.wire import Wire

if TYPE_CHECKING:
    from warpknit.scene.file import SceneFile
    from warpknit.scene.loads import Stage
    from warpknit.scene.scene import Scene

Location = tuple[int | str, ...]
Place = tuple[Location, Any]  # a key, and its value


@dataclass(frozen=True)
class Case:
    """A scene, as in its file or resolved, with the command, device and ranks."""

    scene: Scene | SceneFile
    command: str = ""
    device: str | None = None  # that was named
    ranks: int = 1

    @property
    def stages(self) -> Iterator[tuple[Location, Stage]]:
        """Where each stage stands, and the stage; of a map and a report the first one, which is all that they run."""
        for number, stage in enumerate(self.scene.stages[:1] if self.command in ("map", "report") else self.scene.stages):
            yield ("load",) if number == 0 else ("path", number - 1), stage


Asked = Callable[[Case], Iterable[Place]]


@dataclass(frozen=True)
class Trait:
    """A feature that a scene or a command may request."""

    words: str
    key: str  # that requests it
    asked: Asked  # the keys that request it in a case; empty if none does
    example: dict[str, Any] = field(default_factory=dict)  # tables of a scene that requests it
    needs: tuple[str, ...] = ()  # traits that it implies


class Words(str):
    """A value shown unquoted, because it is not the value of a key."""


# --- requests of a trait -----------------------------------------------------------------------------------------


def _value(key: str, case: Case) -> Any:
    """The value of a dotted key, None where there is no such table."""
    value: Any = case.scene
    for part in key.split("."):
        value = None if value is None else getattr(value, part)
    return value


def _is(key: str, wanted: Any) -> Asked:
    """Where a key has this value."""
    return lambda case: [(tuple(key.split(".")), wanted)] if _value(key, case) == wanted else []


def _given(key: str, *nothing: Any) -> Asked:
    """Where a key has a value other than None and these."""
    return lambda case: (
        [(tuple(key.split(".")), value)] if (value := _value(key, case)) is not None and value not in nothing else []
    )


def _staged(*keys: str, nothing: tuple[Any, ...] = ()) -> Asked:
    """Where a stage has one of these keys."""
    return lambda case: [
        ((*location, key), value)
        for location, stage in case.stages
        for key in keys
        if (value := getattr(stage, key)) is not None and value not in nothing
    ]


def _is_knit(case: Case) -> bool:
    return case.scene.hook is None and case.scene.wires is None


def _wires(case: Case) -> Iterable[Place]:
    wires = case.scene.wires
    return [] if wires is None else [(("wires", "file"), PurePath(wires.file).name)]


def _panel(case: Case) -> Iterable[Place]:
    panel = case.scene.panel
    return [(("panel",), panel)] if panel != type(panel)() else []


def _turned_and_pulled(case: Case) -> Iterable[Place]:
    for location, stage in case.stages:
        if stage.clamp_rotation and stage.pull:
            yield (*location, "clamp_rotation"), stage.clamp_rotation


def _other_poisson(case: Case) -> Iterable[Place]:
    wire = case.scene.wire
    usual = wire.poissons_ratio in (None, MATERIALS[wire.material].poissons_ratio)
    return [] if usual else [(("wire", "poissons_ratio"), wire.poissons_ratio)]


def _other_body_radius(case: Case) -> Iterable[Place]:
    radius = case.scene.model.body_radius
    usual = radius is None or math.isclose(radius, case.scene.wire.diameter / 8)
    return [] if usual else [(("model", "body_radius"), radius)]


# --- the traits -------------------------------------------------------------------------------------------------------


def _choice(key: str, value: str) -> Trait:
    table, name = key.split(".")
    return Trait(f'`{key} = "{value}"`', key, _is(key, value), {table: {name: value}})


def _key(words: str, key: str, value: Any, *nothing: Any, needs: tuple[str, ...] = ()) -> Trait:
    """Requested by a key with a value other than `nothing`, such as `value`."""
    *above, last = key.split(".")
    example: dict[str, Any] = {last: value}
    for part in reversed(above):
        example = {part: example}
    return Trait(words, key, _given(key, *nothing), example, needs)


def _load(words: str, key: str, value: Any, *others: str, nothing: tuple[Any, ...] = ()) -> Trait:
    """Requested by a key of a stage."""
    return Trait(words, f"load.{key}", _staged(key, *others, nothing=nothing), {"load": {key: value}})


def _command(words: str, *commands: str, needs: tuple[str, ...] = (), example: dict[str, Any] | None = None) -> Trait:
    asked: Asked = lambda case: [((case.command,), Words("a scene"))] if case.command in commands else []  # noqa: E731
    return Trait(words, commands[0], asked, example or {}, needs)


PULL = {"at": ["1.7 mm", "0 mm"], "by": ["0.1 mm", "0 mm"], "width": "1 mm"}  # one repeat of the default knit is 3.4 mm wide
CORD = {"grip_pitch": "2 mm", "cord": {"tension": "1 N", "stiffness": "1 kN"}}
SWEEP = {"strain_weft": [0.0, 0.1], "strain_warp": [0.0]}
TENSION_SWEEP = {"tension_weft": [0.05], "tension_warp": [0.05]}

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
    "knit": Trait("a knit", "knit", lambda case: [(("knit",), case.scene.knit)] if _is_knit(case) else []),
    "hook": Trait("two hooked wires", "hook", _given("hook"), {"hook": {}}, ("gripped",)),
    "wires": Trait("wires from a file", "wires", _wires, {"wires": {"file": "plain_knit.csv"}}, ("spatial",)),
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
        "clamp rotation and pulls in one stage",
        "load.clamp_rotation",
        _turned_and_pulled,
        {"load": {"clamp_rotation": 0.1, "pull": [PULL]}},
        ("rotation", "pull"),
    ),
    "path": Trait(
        "stages after the first",
        "path",
        lambda case: [(("path",), Words("stages"))] if len(case.scene.stages) > 1 else [],
        {"path": [{"name": "second"}]},
    ),
    # the wire and the knit
    "friction": _key("friction", "contact.friction", 0.2, 0.0),
    "elastic": Trait("elastic wire", "wire.plastic", _is("wire.plastic", False)),
    "plastic": _key("plastic wire", "wire.plastic", True, False),
    "hardening": _key("hardening", "wire.hardening", 0.2, Wire.hardening),
    "poisson": Trait("own Poisson's ratio", "wire.poissons_ratio", _other_poisson, {"wire": {"poissons_ratio": 0.4}}),
    "plating": _key("plating", "wire.plating", {"thickness": "0.2 um"}),
    "even loops": Trait("uniform loops", "knit.scatter", _is("knit.scatter", 0.0)),
    "scatter": _key("scattered loops", "knit.scatter", 0.05, 0.0, needs=("knit",)),
    "seed": _key("seed", "knit.seed", 3, 0, needs=("knit",)),
    # the edge
    "panel": Trait("an outline, net, or surface", "panel", _panel, {"panel": {"active_threshold": 50}}),
    "outline": Trait(
        "an outline other than a rectangle",
        "panel.outline",
        _given("panel.outline", "rectangle"),
        {"panel": {"outline": "disc", "size": "10 mm"}},
        ("panel",),
    ),
    "cord": Trait("edge cords", "panel.cord", _given("panel.cord"), {"panel": CORD}, ("panel",)),
    "focal length": _key("held on a paraboloid", "panel.focal_length", "1 m", needs=("panel",)),
    # contact
    "stiffness": _key("contact penalty", "contact.stiffness", "10 N/m"),
    "body radius": Trait("own body radius", "model.body_radius", _other_body_radius, {"model": {"body_radius": "3 um"}}),
    "treatment": _key("contact treatment", "contact.treatment", "ring", "free-body", needs=("hook",)),
    "body mass": _key("body mass", "contact.body_mass", 0.3, needs=("ramp",)),
    "crossing distance": _key("crossing distance of hooked wires", "hook.crossing_distance", "20 um", needs=("hook", "spatial")),
    "file repeats": _key("repeats of a file", "wires.repeats", [2, 1], (1, 1), needs=("wires", "periodic")),
    # the solver
    "single": _key("single precision", "solver.precision", "single", "double"),
    "no multipliers": Trait(
        "no multipliers", "solver.multipliers", _is("solver.multipliers", False), {"solver": {"multipliers": False}}
    ),
    "mass scaling": _key("scaled masses", "solver.mass_scaling", 100.0, 1.0, needs=("ramp",)),
    "target time step": _key("target time step", "solver.target_time_step", "1 us", needs=("ramp",)),
    "loading time": _key("given loading time", "solver.loading_time", "10 ms", needs=("ramp",)),
    "damping": _key("given damping", "solver.damping", "100 /s"),
    "max steps": _key("step limit", "solver.max_steps", 10_000),
    # the sweep
    "no sweep": Trait(
        "no sweep", "sweep", lambda case: [(("sweep",), Words("a scene without [sweep]"))] if case.scene.sweep is None else []
    ),
    "sweep": Trait("a sweep", "sweep", _given("sweep"), {"sweep": SWEEP}),
    "sweep by tension": Trait(
        "a sweep by tension", "sweep.tension_weft", _given("sweep.tension_weft"), {"sweep": TENSION_SWEEP}, ("sweep",)
    ),
    "seeds": Trait(
        "several seeds", "sweep.seeds", _given("sweep.seeds", 1), {"sweep": {**SWEEP, "seeds": 2}}, ("sweep", "scatter")
    ),
    # commands, and options besides the scene
    "map": _command("`warpknit map`", "map", "report", needs=("sweep", "relax")),
    "trade": _command("`warpknit trade`", "trade"),
    "report": _command("`warpknit report`", "report", needs=("map", "periodic")),
    "error": _command("`run --error`", "error", needs=("relax",)),
    "ranks": Trait("`mpirun`", "mpirun", lambda case: [(("mpirun",), Words(f"{case.ranks} ranks"))] if case.ranks > 1 else []),
    "cuda": Trait("a GPU", "--device", lambda case: [(("--device",), case.device)] if case.device not in (None, "cpu") else []),
}
AT_COMMAND = frozenset({"map", "trade", "report", "error", "ranks", "cuda"})
COLUMNS = (*GROUPS[1], *GROUPS[2], *GROUPS[3], *GROUPS[0], "map", "trade", "report", "error", "ranks", "cuda")
