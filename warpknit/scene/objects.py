"""The tables of a scene file and the scene that they make, as frozen objects in plain SI.

A field made by `key` is a key of the file; keys.py says what follows from it. What a key of the file may leave out is there once
`warpknit.scene.scene_loader` has filled it in. Each table of a file stands beside what makes it: the wire in wire.py, the hook in
hook.py, the panel in panel.py, wires from a file in wires.py; file.py puts them together.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import InitVar, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, model_validator

from warpknit.errors import SceneError
from warpknit.knit.loops import RANGES, LoopProportions
from warpknit.scene.digest import digest
from warpknit.scene.hook import Hook
from warpknit.scene.keys import Table, key
from warpknit.scene.panel_options import PanelOptions
from warpknit.scene.presets import DEFAULT_PRESET, PRESETS, preset_like, tight_knits
from warpknit.scene.units import shown
from warpknit.scene.values import (
    TREATMENTS,
    BodyMass,
    Boundary,
    Chain,
    Coefficient,
    Drive,
    EdgeLength,
    Expansion,
    Factor,
    Flag,
    Force,
    Fraction,
    FrameCount,
    FrameInterval,
    Friction,
    Kind,
    Length,
    LoadingTime,
    LoopLength,
    LoopScale,
    LoopShape,
    Name,
    NodesPerLoop,
    PerLength,
    PositiveForce,
    Precision,
    PresetName,
    Rate,
    Repeats,
    Scatter,
    Seed,
    Seeds,
    Share,
    Shear,
    Shift,
    SignedLength,
    SpringStiffness,
    StepCount,
    Stiffness,
    Strain,
    Temperature,
    TemperatureGradient,
    Tension,
    Threading,
    TileSize,
    Time,
    TimeStep,
    Tolerance,
    Treatment,
    Turn,
    Vector,
    exclusive,
    proportion,
    refused,
)
from warpknit.scene.wire import Wire
from warpknit.scene.wire_file import WireFile
from warpknit.text import exact

Override = str | tuple[str, Any]
Overrides = Sequence[Override] | Mapping[str, Any]  # values of dotted keys: a mapping, or "key=value" strings and pairs

# Keys of [contact] that only some treatments have.
TREATMENT_KEYS = {
    "spring_stiffness": ("spring-point", "spring-cylinder", "ring"),
    "ring_radius": ("ring",),
    "plane_friction": ("friction-plane",),
    "plane_load": ("friction-plane",),
    "contact_point": ("point",),
    "target_share": ("point",),
    "body_mass": ("free-body", "spring-point", "spring-cylinder", "ring", "friction-plane"),
}

MEAN = LoopProportions()  # what the loops are where a scene does not say


@dataclass(frozen=True, kw_only=True)
class Bar(Table):
    """One guide bar of [knit] bars: its chain of links a-b, its threading of '|' and '.', its shift in needles."""

    chain: Chain = key(
        "Links a-b of a guide bar, course by course: the overlap runs from gap a to gap b. a = b is an inlay without a loop."
    )
    threading: Threading = key("Threaded (`|`) and empty (`.`) guides along the bar, repeated.", "|")
    shift: Shift = key("Offset of the bar to the right, in needles.", 0)
    loop_scale: LoopScale = key(
        "Factor on the proportions of `[knit.loop]` that make a loop large, for the loops of this bar: bars of different run-in.",
        1.0,
    )


@dataclass(frozen=True, kw_only=True)
class Loop(Table):
    """[knit.loop]: proportions in units of the course spacing; `warpknit.knit.loops` says what they measure and their ranges."""

    shape: LoopShape = key(
        "`auto`: `circular-oval` for two bars in opposition with one loop per needle and course and alternating closed and open"
        " courses, else `general`.",
        MEAN.shape,
    )
    closed_radius: Annotated[float, proportion(*RANGES["closed_radius"])] = key(
        "Circular-oval: radius of a closed (circular) loop [C].", MEAN.closed_radius
    )
    closed_head: Annotated[float, proportion(*RANGES["closed_head"])] = key(
        "Circular-oval: top of a closed loop above the next course line [C].", MEAN.closed_head
    )
    open_head: Annotated[float, proportion(*RANGES["open_head"])] = key(
        "Circular-oval: top of an open (oval) loop above the next course line [C].", MEAN.open_head
    )
    open_half_width: Annotated[float, proportion(*RANGES["open_half_width"])] = key(
        "Circular-oval: half width of an open loop [C].", MEAN.open_half_width
    )
    closed_foot: Annotated[float, proportion(*RANGES["closed_foot"])] = key(
        "Circular-oval: half distance of the feet of a closed loop [C].", MEAN.closed_foot
    )
    open_foot: Annotated[float, proportion(*RANGES["open_foot"])] = key(
        "Circular-oval: half distance of the feet of an open loop [C].", MEAN.open_foot
    )
    foot_radius: Annotated[float, proportion(*RANGES["foot_radius"])] = key(
        "Circular-oval: radius of the bend at the exit foot [C].", MEAN.foot_radius
    )
    tilt: Annotated[float, proportion(*RANGES["tilt"])] = key(
        "Circular-oval: lean of an open loop towards its overlap.", MEAN.tilt
    )
    lateral_shift: Annotated[float, proportion(*RANGES["lateral_shift"])] = key(
        "Circular-oval: shift of a closed loop towards its underlaps [W].", MEAN.lateral_shift
    )
    foot_half_width: Annotated[float, proportion(*RANGES["foot_half_width"])] = key(
        "General: half distance of the feet [W].", MEAN.foot_half_width
    )
    leg_half_width: Annotated[float, proportion(*RANGES["leg_half_width"])] = key(
        "General: half distance of the legs [W].", MEAN.leg_half_width
    )
    head_height: Annotated[float, proportion(*RANGES["head_height"])] = key(
        "General: top of the head above the next course line [C].", MEAN.head_height
    )


@dataclass(frozen=True, kw_only=True)
class Knit(Table):
    """[knit]: the pattern, its spacings, and how often it repeats; the double atlas net of the paper where a key is left out."""

    bars: Annotated[tuple[Bar, ...], Field(min_length=1)] = key(
        "The guide bars. Default: the two of the double atlas.",
        (
            Bar(chain="1-0/1-2/2-3/2-1", threading="|.", shift=0),
            Bar(chain="2-3/2-1/1-0/1-2", threading="|.", shift=1),
        ),
    )
    wale_spacing: LoopLength = key("Distance between wales (along weft, x).", 1.7e-3)
    course_spacing: LoopLength = key("Distance between courses (along warp, y).", 1.0e-3)
    repeats: Repeats = key("Pattern repeats along weft and warp.", (1, 1))
    scatter: Scatter = key(
        "Relative standard deviation of the proportions in `[knit.loop]`, drawn for each loop of the mesh.", 0.0
    )
    seed: Seed = key("Random seed of the scatter.", 0)
    loop: Loop = key("The shape of the loops.", Loop())

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

    @property
    def even(self) -> Knit:
        """One repeat of the knit, without scatter."""
        return replace(self, scatter=0.0, seed=0, repeats=(1, 1))


@dataclass(frozen=True, kw_only=True)
class KnitTable(Knit):
    """[knit] as it stands in a file, with what says the same in another way."""

    wales: PerLength | None = key("Instead of `wale_spacing`: wales per length.", None)
    courses: PerLength | None = key("Instead of `course_spacing`: courses per length.", None)

    @model_validator(mode="before")
    @classmethod
    def _one_spacing(cls, data: Any) -> Any:
        return exclusive(data, ("wale_spacing", "wales"), ("course_spacing", "courses"))


@dataclass(frozen=True, kw_only=True)
class ModelOptions(Table):
    """[model]: the kind of model and its discretisation."""

    kind: Kind = key(
        "`planar`: two coordinates per node, contact bodies where wires hook. `spatial`: three coordinates, with twist and"
        " contact of round wires ([theory](theory/contact.md#round-wires-in-space)); required with `[wires]`. `auto`: the plane"
        " where it is good for the knit, else space ([below](#the-kind-of-model)). See [capabilities.md](capabilities.md) for the"
        " features of each.",
        "auto",
    )
    boundary: Boundary = key(
        "`gripped`: cut along an outline, with every cut wire end clamped. `periodic`: one tile of an endless mesh.", "gripped"
    )
    nodes_per_loop: NodesPerLoop = key("Nodes per loop of wire.", None, left_out="the preset's")
    body_radius: Length = key(
        "Planar model: radius of the contact body between two hooked wires. At d/8 both contacts close when the wires are 1.25 d"
        " apart.",
        None,
        left_out="diameter/8",
    )
    merge_lenses: Flag = key("One contact body for nested lenses of the same two wires; else one for each lens.", True)
    frame_expansion: Expansion = key(
        "Thermal expansion of the frame that holds the mesh. Strains refer to the frame at the reference temperature. 0: the"
        " frame does not expand.",
        0.0,
    )


@dataclass(frozen=True, kw_only=True)
class Pull(Table):
    """[[load.pull]]: a place on the outline that is displaced in addition to the load."""

    at: Vector = key(
        "Position on or near the edge, relative to the centre of the bounding box of the mesh as knitted. Write"
        ' `pull = [{at = ["12 mm", "0 mm"], by = ["1 mm", "0 mm"], width = "10 mm"}]`.'
    )
    by: Vector = key("Displacement in addition to the load of the whole mesh. `pull = []` removes all pulls.")
    width: EdgeLength | None = key(
        "Width of the displaced part of the edge, with a cos^2 profile. Left out with `panel.grip_pitch`: the nearest net node"
        " moves.",
        None,
        left_out="required without net nodes",
    )


@dataclass(frozen=True, kw_only=True)
class Stage(Table):
    """[load] and each [[path]]: one stage of the loading, by its final state. Missing keys are as in the stage before.

    Each direction is driven by strain or by tension; the other of the two is None. A hook is driven by `displacement` alone,
    which its model applies as a shear of its frame (hook.py); for a mesh, `displacement` is converted to strains when it is read.
    """

    name: Name = key("Name of the stage in the results.", None, left_out="`load`, then `stage-2`, ...")
    strain_weft: Strain | None = key(
        "Strain at the end of the stage, relative to the knitted size.", None, left_out="0, then as in the stage before"
    )
    tension_weft: Tension | None = key("Instead of `strain_weft`: force per current width at the end of the stage.", None)
    strain_warp: Strain | None = key("The same in warp.", None, left_out="0, then as in the stage before")
    tension_warp: Tension | None = key("Instead of `strain_warp`.", None)
    displacement: SignedLength | None = key(
        "Instead of both strains: outward displacement of every side. With `[hook]`: displacement of the driven end to the"
        " right.",
        None,
    )
    shear: Shear = key("Weft displacement over warp distance.", None, left_out="0, then as in the stage before")
    clamp_rotation: Turn = key(
        "Counter-clockwise rotation of every clamp about the point where it holds its wire. Gripped meshes with"
        ' `drive = "relax"` only, without cord or pull.',
        None,
        left_out="0, then as in the stage before",
    )
    temperature: Temperature = key(
        "Temperature at the end of the stage, at the middle of the mesh.",
        None,
        left_out="the reference temperature, then as in the stage before",
    )
    temperature_gradient: TemperatureGradient = key(
        'Temperature gradient along weft and warp. Gripped meshes with `drive = "relax"` only.',
        None,
        left_out="none, then as in the stage before",
    )
    pull: tuple[Pull, ...] = key("Displaced places of the edge.", None, left_out="none, then as in the stage before")

    @model_validator(mode="before")
    @classmethod
    def _one_drive_a_direction(cls, data: Any) -> Any:
        return exclusive(data, ("strain_weft", "tension_weft", "displacement"), ("strain_warp", "tension_warp", "displacement"))

    @property
    def by_tension(self) -> tuple[bool, bool]:
        """Whether weft and warp are driven by tension."""
        return self.strain_weft is None, self.strain_warp is None


@dataclass(frozen=True, kw_only=True)
class Contact(Table):
    """[contact]: contact between wires; a pair is active when its force exceeds the threshold."""

    friction: Friction = key(
        'Coulomb friction coefficient; `drive = "relax"` only. The state then depends on the load history:'
        " [theory](theory/contact.md#friction-in-the-plane).",
        0.0,
    )
    threshold: Force = key(
        "A pair is active when its force exceeds this value (and 1e-4 EI/W^2, the unbalanced force of a converged state).",
        0.0,
    )
    stiffness: Stiffness | None = key(
        "Contact penalty. The multipliers of a relaxation correct its error.", None, left_out="chosen"
    )
    treatment: Treatment = key("Contact carrier or constraint of a `[hook]`, see below. A knit has free bodies.", "free-body")
    spring_stiffness: SpringStiffness | None = key(
        "`spring-point`, `spring-cylinder`, `ring`: stiffness of the spring to the ground; at most the contact penalty.",
        None,
        left_out="0.001 N/m",
    )
    ring_radius: Length | None = key("`ring`: inner radius, at least that of the wire.", None, left_out="the wire's diameter")
    plane_friction: Coefficient | None = key("`friction-plane`: friction coefficient.", None, left_out="0.1")
    plane_load: PositiveForce | None = key("`friction-plane`: normal force of the body on the plane.", None, left_out="10 uN")
    contact_point: Fraction | None = key(
        "`point`: place on the left wire, over its length, rounded to the nearest node.", None, left_out="0.5"
    )
    target_share: Share | None = key(
        "`point`: target part of the right wire, about its middle, over its length.", None, left_out="1"
    )
    body_mass: BodyMass | None = key(
        "Ramp: mass of a contact body over that of half a loop of wire; with `[hook]`, over that of half a wire.",
        None,
        left_out="0.5",
    )

    @model_validator(mode="before")
    @classmethod
    def _keys_of_the_treatment(cls, data: Any) -> Any:
        if isinstance(data, dict):
            treatment = data.get("treatment", "free-body")
            for name, users in TREATMENT_KEYS.items():
                if name in data and treatment in TREATMENTS and treatment not in users:
                    names = " or ".join(repr(user) for user in users)
                    raise refused(f"only with contact.treatment = {names}", key=name, given=shown(data[name]))
        return data


@dataclass(frozen=True, kw_only=True)
class Solver(Table):
    """[solver]: solution method and numerics. None: chosen by the solver."""

    preset: PresetName = key("Sets the defaults of the keys below.", DEFAULT_PRESET)
    drive: Drive = key("`relax`: equilibrium at each load level. `ramp`: real time with true or scaled masses.", "relax")
    precision: Precision = key(
        "`single`: float32, with positions in 32-bit fixed point, in space in float64. `double`: float64.",
        None,
        left_out="the preset's; `double` above 48 nodes per loop, and for wires so thin that s (d/W)^2 is below 0.001 with the"
        " softening s",
    )
    mass_scaling: Factor = key("Ramp: factor on all masses.", 1.0)
    target_time_step: TimeStep | None = key("Ramp: raise masses, node by node, until this time step is stable.", None)
    axial_softening: Factor = key("Divisor of the axial stiffness in the dynamics.", None, left_out="the preset's")
    damping: Rate | None = key(
        "Ramp: mass-proportional damping. Default: the frequency of the slowest bending mode.", None, left_out="chosen"
    )
    loading_time: LoadingTime | None = key(
        "Ramp: duration of a stage. Default: ten periods of the slowest bending mode.", None, left_out="chosen"
    )
    residual_tolerance: Tolerance = key("Relative residual below which a state is converged.", None, left_out="the preset's")
    max_steps: StepCount | None = key(
        "Relax: a level, or an increment of one that is repeated in smaller increments, that has not converged after this many"
        " steps ends the run with exit status 3.",
        None,
        left_out="500,000",
    )
    multipliers: Flag = key(
        "Relax: augmented Lagrangian multipliers correct the error of the softening and of the contact penalty.", True
    )


@dataclass(frozen=True, kw_only=True)
class Output(Table):
    """[output]: recorded levels and written files."""

    frames: FrameCount = key("Recorded load levels per stage; each is converged when relaxing.", 20)
    usd: Flag = key("Write scene.usda while running.", True)
    usd_full_every: FrameInterval = key(
        "Interval of frames with all nodes; the first frame and the ends of stages always have them. In between, the level `full`"
        " is not updated and `k8` is. 0: only the first frame and the ends of stages.",
        1,
    )
    usd_points_per_tile: TileSize = key("Approximate number of nodes per prim of scene.usda.", 500_000)
    vtk: Flag = key("Write vtk/ at the end.", False)
    figures: Flag = key("Draw figures/ at the end.", True)
    service_tension: Tension | None = key(
        "Mean tension of weft and warp at which the answers of a run and the service points of a report give the share of active"
        " contacts.",
        None,
        left_out="2, 3.4 and 4.9 N/m, in a run where it reaches them",
    )
    checkpoint_interval: Time = key(
        "Wall time between checkpoints; longer where one takes more than a tenth of it and over a second.", 60.0
    )


SIDES = ("weft", "warp")


@dataclass(frozen=True, kw_only=True)
class Sweep(Table):
    """[sweep]: the grid of strains, or of tensions, that `warpknit map` runs."""

    strain_weft: Annotated[tuple[Strain, ...], Field(min_length=1)] | None = key(
        "Weft strains; `warpknit map` combines each with each warp strain.", None, left_out="required, or tensions"
    )
    strain_warp: Annotated[tuple[Strain, ...], Field(min_length=1)] | None = key(
        "Warp strains.", None, left_out="required, or tensions"
    )
    tension_weft: Annotated[tuple[Tension, ...], Field(min_length=1)] | None = key(
        "Instead of both strains: weft tensions, combined with each warp tension.", None
    )
    tension_warp: Annotated[tuple[Tension, ...], Field(min_length=1)] | None = key("Warp tensions.", None)
    seeds: Seeds = key(
        "With `knit.scatter`: number of meshes, with seeds from `knit.seed` on, over which the map is averaged.", 1
    )

    @model_validator(mode="before")
    @classmethod
    def _strains_or_tensions(cls, data: Any) -> Any:
        data = exclusive(data, *((f"strain_{one}", f"tension_{other}") for one in SIDES for other in SIDES))
        if isinstance(data, dict):
            quantity = "tension" if any(f"tension_{side}" in data for side in SIDES) else "strain"
            for side in SIDES:
                if f"{quantity}_{side}" not in data:
                    raise refused("a list with at least one entry", key=f"{quantity}_{side}", given="nothing")
        return data

    @property
    def by_tension(self) -> bool:
        """Whether the loads are tensions, not strains."""
        return self.tension_weft is not None

    @property
    def quantity(self) -> str:
        """The loads in a word."""
        return "tensions" if self.by_tension else "strains"

    @property
    def axes(self) -> tuple[list[float], list[float]]:
        """Strains, or tensions [N/m], in weft and in warp, each once and in their order."""
        weft, warp = (self.tension_weft, self.tension_warp) if self.by_tension else (self.strain_weft, self.strain_warp)
        return sorted(set(weft or ())), sorted(set(warp or ()))

    @property
    def pairs(self) -> list[tuple[float, float]]:
        """Loads of the map, weft and warp, line by line."""
        weft, warp = self.axes
        return [(x, y) for y in warp for x in weft]

    def stage(self, load: Stage, pair: tuple[float, float]) -> Stage:
        """`load`, with a pair of strains or tensions of the map."""
        strains, tensions = ((None, None), pair) if self.by_tension else (pair, (None, None))
        return replace(
            load, strain_weft=strains[0], strain_warp=strains[1], tension_weft=tensions[0], tension_warp=tensions[1],
            name=f"weft {pair[0]:g}, warp {pair[1]:g}",
        )  # fmt: skip


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
    kind_reason: str = field(default="as given", compare=False)  # of `model.kind`, which is resolved (model_choice.py)
    assumed: tuple[str, ...] = field(default=(), compare=False)  # dotted keys of the wire with the value of its material
    bare_temperatures: tuple[float, ...] = field(default=(), compare=False)  # [K] that were given as numbers without a unit
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
            raise SceneError(f"{self.path}: given a scene put together from parts, allowed: load_scene(scene, overrides)")
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
