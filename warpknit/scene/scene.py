"""The scene that the tables of a scene file make, a frozen object in plain SI.

A field made by `key` is a key of the file; keys.py says what follows from it. What a key of the file may leave out is there once
`warpknit.scene.scene_loader` has filled it in. The tables are in wire.py, knit.py, hook.py, wire_file.py, panel_options.py,
loads.py and options.py; file.py puts them together.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import InitVar, dataclass, field
from pathlib import Path
from typing import Any

from warpknit.base.text import exact
from warpknit.errors import SceneError
from warpknit.scene.digest import digest
from warpknit.scene.hook import Hook
from warpknit.scene.knit import Knit
from warpknit.scene.loads import Stage, Sweep
from warpknit.scene.options import GIVEN, Contact, ModelOptions, Output, Solver
from warpknit.scene.panel_options import PanelOptions
from warpknit.scene.presets import PRESETS, preset_like, tight_knits
from warpknit.scene.wire import Wire
from warpknit.scene.wire_file import WireFile

Override = str | tuple[str, Any]
Overrides = Sequence[Override] | Mapping[str, Any]  # values of dotted keys: a mapping, or "key=value" strings and pairs


@dataclass(frozen=True, kw_only=True)
class Scene:
    """All inputs of a run: frozen tables of plain SI numbers, named as the keys of docs/scenes.md.

        scene.wire.diameter                              # [m]
        scene.stages[-1].strain_warp
        thicker = scene.changed({"wire.diameter": "17 um"})

    Made by `load_scene`. What the file leaves out has its default; None means that the model or the solver chooses, or that the
    feature is off. A scene has a knit, a hook or wires. Equal scenes compare equal, whatever file they were read from.
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
    sweep: Sweep | None
    kind_reason: str = field(default=GIVEN, compare=False)  # of `model.kind`, see capabilities.py
    assumed: tuple[str, ...] = field(default=(), compare=False)  # dotted keys of the wire with the value of its material
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
            mesh = f"wires of {Path(self.wires.file).name}"
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
    def has_moving_edge(self) -> bool:
        """Whether the edge has pulls or cords, so that it deviates from the affine load."""
        return self.panel.cord is not None or any(stage.pull for stage in self.stages)

    @property
    def preset_in_force(self) -> str | None:
        """The preset that matches the numerics of a relaxation, regardless of `solver.preset`; None if none matches."""
        model, solver = self.model, self.solver
        if solver.drive != "relax" or not solver.multipliers or self.hook is not None or self.wires is not None:
            return None
        numerics = (solver.axial_softening, solver.precision, solver.residual_tolerance)
        return preset_like(model.kind, model.nodes_per_loop, *numerics)

    @property
    def preset_error_percent(self) -> float | None:
        """[%] measured error of the preset in force; None without one."""
        name = self.preset_in_force
        return None if name is None else PRESETS[name].of(self.model.kind, self.solver.drive).error_percent

    @property
    def preset_caveat(self) -> str:
        """What is known of tight knits at the preset in force, as a sentence without its point; empty if nothing is."""
        name = self.preset_in_force
        return "" if name is None else tight_knits(name, self.model.kind)

    @property
    def depends_on_path(self) -> bool:
        """Whether the state depends on the load history."""
        return self.contact.friction > 0.0 or self.wire.plastic

    @property
    def hash(self) -> str:
        """SHA-256 of the resolved values, in hex, independent of the name and the layout of the file."""
        return digest(self, without="name")
