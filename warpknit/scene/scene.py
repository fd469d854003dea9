"""A whole scene file, checked, and the scene that its tables make: frozen objects in plain SI.

A field made by `key` is a key of the file; keys.py says what follows from it. What a key of the file may leave out is there once
`warpknit.scene.scene_loader` has filled it in; None in a scene means that the model chooses. The tables are in wire.py, knit.py,
wire_file.py, panel_options.py and options.py.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import InitVar, dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from random import Random
from typing import Any

from pydantic import TypeAdapter

from ..base.errors import SceneError
from ..base.text import exact
from .keys import Table, given_values, key
from .knit import Hook, Knit, KnitTable
from .options import GIVEN, VARIANT_LEVELS, Contact, ModelOptions, Output, Reflection, Solver, Stage, Sweep, Variants
from .panel_options import PanelOptions, PanelTable
from .presets import COMPARED_NODES, HISTORY_INCREMENTS, MEASURED, PRESETS, Measured, Preset
from .values import Name
from .wire import Wire
from .wire_file import WireArrays, WireFile, WiresTable


@dataclass(frozen=True, kw_only=True)
class SceneFile(Table, one_of=(("knit", "hook", "wires"),)):
    """A whole scene file."""

    name: Name | None = key("Names the run and its directory.", None, left_out="the file's name without .toml")
    wire: Wire = key("What is knitted.", Wire())
    knit: KnitTable = key("Guide bars, spacings and repeats.", KnitTable())
    hook: Hook | None = key("In place of `[knit]`: two arcs of wire that hook each other.", None)
    wires: WiresTable | None = key("In place of `[knit]`: a file of wire centre lines.", None)
    model: ModelOptions = key("Kind of model and boundary.", ModelOptions())
    panel: PanelTable = key("Outline and edge of a gripped mesh.", PanelTable())
    load: Stage = key("The first stage.", Stage())
    path: tuple[Stage, ...] = key("Load steps after [load].", ())
    contact: Contact = key("How wires touch.", Contact())
    solver: Solver = key("Solver of the states.", Solver())
    output: Output = key("What is written.", Output())
    variants: Variants = key("Number of meshes in the mean.", Variants())
    sweep: Sweep | None = key("Loads of `warpknit map`.", None)
    reflection: Reflection | None = key("Plane waves for the reflection loss.", None)

    @property
    def stages(self) -> tuple[Stage, ...]:
        """[load], then each [[path]], with what they take over; of a direction, the way that was given last."""
        stages: list[Stage] = []
        so_far: Mapping[str, Any] = {}
        for table in (self.load, *self.path):
            given = given_values(table)
            replaced = {key for group in Stage.one_of if given.keys() & set(group) for key in group}
            kept = so_far.keys() - replaced - {"name", "displacement"}
            so_far = {key: value for key, value in so_far.items() if key in kept} | given
            stages.append(Stage(**so_far))
        return tuple(stages)


FILE = TypeAdapter(SceneFile)  # checks a table as read from TOML


def _plain(value: Any) -> Any:
    """A frozen object as nested dicts and lists."""
    if is_dataclass(value):
        return {entry.name: _plain(getattr(value, entry.name)) for entry in fields(value) if entry.compare}
    if isinstance(value, tuple):
        return [_plain(entry) for entry in value]
    return value


Override = str | tuple[str, Any]
Overrides = Sequence[Override] | Mapping[str, Any]  # values of dotted keys: a mapping, or "key=value" strings and pairs


@dataclass(frozen=True, kw_only=True)
class Scene:
    """All inputs of a run: frozen tables of plain SI numbers, named as the keys of docs/scenes.md.

        scene.wire.diameter                              # [m]
        scene.stages[-1].strain_warp
        thicker = scene.changed({"wire.diameter": "17 um"})

    Made by `load_scene`. Keys that the file leaves out have their defaults. None means that the model or the solver chooses, or
    that the feature is off. A scene has a knit, a hook or wires. Equal scenes compare equal, whatever file they were read from.
    """

    name: str
    path: Path = field(compare=False)
    wire: Wire
    knit: Knit  # beside `hook` or `wires` nothing is knitted: no bars, and spacings of one length, which scales what is small
    hook: Hook | None
    wires: WireFile | None
    model: ModelOptions
    panel: PanelOptions
    stages: tuple[Stage, ...]  # [load], then each [[path]]
    contact: Contact
    solver: Solver
    output: Output
    variants: Variants
    sweep: Sweep | None
    reflection: Reflection | None = None
    kind_reason: str = field(default=GIVEN, compare=False)  # of `model.kind`, see capabilities.py
    assumed: tuple[str, ...] = field(default=(), compare=False)  # dotted keys left out whose value a designer would give
    is_empty: bool = field(default=False, compare=False)  # whether its file holds no key
    bare_temperatures: tuple[float, ...] = field(default=(), compare=False)  # [K] that were given as numbers without a unit
    even_chains: tuple[str, ...] = field(default=(), compare=False)  # chains in even numbers and how they were read, in words
    remake: InitVar[Callable[..., Scene] | None] = None  # from what was written; lost where a scene is replaced in part

    def __post_init__(self, remake: Callable[..., Scene] | None) -> None:
        object.__setattr__(self, "_remake", remake)

    def __repr__(self) -> str:
        mesh = f"{self.knit.repeats[0]} x {self.knit.repeats[1]} repeats"
        if self.hook is not None:
            mesh = "two hooked wires"
        elif self.wires is not None:
            mesh = f"wires of {self.wires.file_name}"
        wire = f"{self.wire.material} {exact(self.wire.diameter, 'm')}"
        stages = "1 stage" if len(self.stages) == 1 else f"{len(self.stages)} stages"
        return f"<Scene {self.name!r}: {wire}, {mesh}, {self.model.kind}, {self.model.boundary}, {stages}>"

    @property
    def is_as_written(self) -> bool:
        """Whether `changed` is available: not of a scene that was put together from parts of others."""
        return self.__dict__["_remake"] is not None

    def changed(self, overrides: Overrides = (), preset: str | None = None, *, command: str = "", ranks: int = 1) -> Scene:
        """A scene with other values for some keys; all defaults and checks follow the new values.

            scene.changed({"wire.diameter": "17 um", "load.strain_warp": 0.05}, preset="draft")

        overrides, preset, command, ranks: as in `load_scene`. Raises `SceneError`, which names the key.
        """
        remake = self.__dict__["_remake"]
        if remake is None:
            raise SceneError(f"{self.path}: a scene put together from parts cannot be changed; use load_scene(scene, overrides)")
        scene: Scene = remake(overrides, preset, command=command, ranks=ranks)
        return scene

    @property
    def levels(self) -> int:
        """Load levels of each mesh of a map, to the largest load."""
        return self.variant(0).output.levels if self.variants.count > 1 else self.output.levels

    @property
    def of_even_loops(self) -> Scene:
        """The scene of a single mesh with equal loops, about which [variants] scatter."""
        return replace(self, knit=replace(self.knit, scatter=0.0), variants=replace(self.variants, count=1))

    def variant(self, number: int) -> Scene:
        """One of its [variants]: a scene of a single mesh, with loops, friction and wire of its own."""
        variants, seed = self.variants, self.variants.seed + number
        random = Random(seed)
        friction, thickness = (math.exp(random.gauss(0.0, spread)) for spread in (variants.friction, variants.wire))
        thickness = min(variants.thickest, max(1.0 / variants.thickest, thickness))
        knit = replace(self.knit, scatter=variants.scatter, seed=seed)
        contact = replace(self.contact, friction=self.contact.friction * friction)
        wire = replace(self.wire, diameter=self.wire.diameter * thickness)
        model = replace(self.model, body_radius=self.model.body_radius * thickness)
        frames = VARIANT_LEVELS if isinstance(self.output.frames, str) else self.output.frames
        output = replace(self.output, frames=frames)
        of_one = replace(variants, count=1)
        return replace(self, knit=knit, contact=contact, wire=wire, model=model, output=output, variants=of_one)

    @property
    def has_moving_edge(self) -> bool:
        """Whether the edge moves away from the affine load: by pulls, cords, or out of the plane to a paraboloid."""
        is_raised = self.panel.focal_length is not None and self.model.of_kind.leaves_plane
        return is_raised or self.panel.cord is not None or any(stage.pull for stage in self.stages)

    @property
    def preset_in_force(self) -> str | None:
        """The preset that matches the numerics of a relaxation, regardless of `solver.preset`; None if none matches."""
        model, solver = self.model, self.solver
        if solver.drive != "relax" or not solver.multipliers or self.hook is not None or self.wires is not None:
            return None
        numerics = Preset(model.nodes_per_loop, solver.axial_softening, solver.precision, solver.residual_tolerance)
        return next((name for name, presets in PRESETS.items() if presets[model.kind, "relax"] == numerics), None)

    @property
    def preset_measured(self) -> Measured | None:
        """Accuracy and cost of the preset in force; None without one."""
        name = self.preset_in_force
        return None if name is None else MEASURED[name, self.model.kind]

    @property
    def preset_error_text(self) -> str:
        """Preset in force, its measured error and the measured knit, in words."""
        double_atlas = "on the double atlas tile" + ("" if self.knit.bars == Knit().bars else ", not measured on this knit")
        assert self.preset_measured is not None
        return f"preset {self.preset_in_force}: error {self.preset_measured.error_percent:g} % {double_atlas}"

    @property
    def preset_caveat(self) -> str:
        """Sentence, without its point, on tight knits at the preset in force; or empty."""
        measured = self.preset_measured
        if measured is None or measured.tight_error_percent is None:
            return ""
        return (
            f"tight knits: tensions within {measured.tight_error_percent:g} % of preset reference at nine of ten loads, another"
            f" equilibrium at the others; compare with model.nodes_per_loop = {COMPARED_NODES} and other output.frames"
        )

    @property
    def depends_on_path(self) -> bool:
        """Whether the state depends on the load history."""
        return self.contact.friction > 0.0 or self.wire.plastic

    @property
    def history_increment(self) -> float:
        """Largest strain from one equilibrium to the next; infinite where the state does not depend on the load history."""
        return HISTORY_INCREMENTS[self.solver.preset] if self.depends_on_path else math.inf

    @property
    def hash(self) -> str:
        """SHA-256 in hex of the resolved values, independent of the file's layout."""
        table = {key: value for key, value in _plain(self).items() if key != "name"}
        return hashlib.sha256(json.dumps(table, sort_keys=True, allow_nan=False).encode()).hexdigest()


RESOLVED = "# Left to the model and the solver:"  # begins every resolved scene


def may_vary(scene: Scene | SceneFile) -> bool:
    """Whether meshes of a scene can have loops, friction and wire of their own: it is a tile, and relaxed."""
    is_tile = scene.hook is None and scene.wires is None and scene.model.boundary == "periodic"
    return is_tile and scene.model.of_kind.own_loops and scene.solver.drive == "relax"


def resolved_toml(scene: Scene) -> str:
    """The scene as a TOML file with all defaults in SI units; it loads to an equal scene.

    Wires from arrays are in the file wires.npz, which a run writes beside it.
    """
    import tomli_w

    left_out: list[str] = []
    table: dict[str, object] = {"name": scene.name}
    mesh = "hook" if scene.hook is not None else "wires" if scene.wires is not None else "knit"
    for name in ("wire", mesh, "model", *(("panel",) if mesh == "knit" else ())):
        table[name] = _written(getattr(scene, name), name, left_out)
    stages = [_written(stage, "", []) for stage in scene.stages]
    if scene.hook is not None:
        stages = [{name: stage[name] for name in ("name", "displacement", "temperature")} for stage in stages]
    table["load"] = stages[0]
    if stages[1:]:
        table["path"] = stages[1:]
    for name in ("contact", "solver", "output", "variants"):
        table[name] = _written(getattr(scene, name), name, left_out)
    for name in ("sweep", "reflection"):
        if getattr(scene, name) is not None:
            table[name] = _written(getattr(scene, name), name, left_out)
    digest = "" if scene.wires is None else f"# SHA-256 of the wires: {scene.wires.digest}\n"
    return f"{RESOLVED} {', '.join(left_out)}\n{digest}\n" + tomli_w.dumps(table)


def _written(value: Any, place: str, left_out: list[str]) -> Any:
    """A frozen object as a table of TOML values. Keys without a value are named in `left_out`."""
    if isinstance(value, tuple):
        return [_written(entry, f"{place}[{index}]", left_out) for index, entry in enumerate(value)]
    if not isinstance(value, Table):
        return value.name if isinstance(value, WireArrays) else value
    table = {}
    for name, entry in type(value).keys.items():
        content, below = getattr(value, name), f"{place}.{name}"
        if content is None:
            left_out.append(below)
        else:
            table[name] = f"{content!r} {entry.unit}" if entry.unit else _written(content, below, left_out)
    return table
