"""The tables of a scene file and the scene that they make, as frozen objects in plain SI.

A field made by `key` is a key of the file; keys.py says what follows from it. What a key of the file may leave out is there once
`warpknit.scene.load` has filled it in. Each table of a file stands beside what makes it: the wire in wire.py, the hook in
hook.py, the panel in panel.py, wires from a file in wires.py; file.py puts them together.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, model_validator

from warpknit.knit.loops import RANGES, LoopProportions
from warpknit.scene.digest import digest
from warpknit.scene.hook import Hook
from warpknit.scene.keys import Table, key
from warpknit.scene.panel_options import PanelOptions
from warpknit.scene.presets import DEFAULT_PRESET, preset_like
from warpknit.scene.units import shown
from warpknit.scene.values import (
    TREATMENTS,
    BodyMass,
    Boundary,
    Chain,
    Coefficient,
    Drive,
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
    StepCount,
    Stiffness,
    Strain,
    Temperature,
    TemperatureGradient,
    Tension,
    Threading,
    TileSize,
    Time,
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
        "Links a-b of a guide bar, course by course: the overlap runs from gap a to gap b. a = b lays the wire in without a loop."
    )
    threading: Threading = key("Guides along the bar, threaded and empty, repeated.", "|")
    shift: Shift = key("Needles by which the bar is set to the right.", 0)


@dataclass(frozen=True, kw_only=True)
class Loop(Table):
    """[knit.loop]: proportions in units of the course spacing; `warpknit.knit.loops` says what they measure and their ranges."""

    shape: LoopShape = key(
        "`auto` takes `circular-oval` for two bars in opposition with one loop on each needle and course and closed and open"
        " courses in turn, else `general`.",
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
        "The guide bars. Left out: the two of the double atlas.",
        (
            Bar(chain="1-0/1-2/2-3/2-1", threading="|.", shift=0),
            Bar(chain="2-3/2-1/1-0/1-2", threading="|.", shift=1),
        ),
    )
    wale_spacing: Length = key("Distance of the wales (along weft, x).", 1.7e-3)
    course_spacing: Length = key("Distance of the courses (along warp, y).", 1.0e-3)
    repeats: Repeats = key("Pattern repeats along weft and warp.", (1, 1))
    scatter: Scatter = key(
        "Relative standard deviation of the proportions in `[knit.loop]`, each loop of the mesh having its own.", 0.0
    )
    seed: Seed = key("Which scattered mesh: the same seed gives the same loops.", 0)
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
    """[model]: what is kept of the mesh."""

    kind: Kind = key(
        "With `[wires]` `spatial`, and nothing else. `planar`: two coordinates a node, bodies where wires hook. `spatial`: three,"
        " with twist and contact of round wires ([physics.md](physics.md#the-spatial-model)). [capabilities.md](capabilities.md)"
        " says what goes with which.",
        "planar",
    )
    boundary: Boundary = key(
        "`gripped`: cut along an outline, every cut wire end held. `periodic`: one tile of an endless mesh.", "gripped"
    )
    nodes_per_loop: NodesPerLoop = key("Nodes on the wire of one loop.", None, left_out="the preset's")
    body_radius: Length = key(
        "Planar model: radius of the body between two hooked wires: at d/8 both its contacts close where the wires are 1.25 d"
        " apart.",
        None,
        left_out="diameter/8",
    )
    merge_lenses: Flag = key("One body for nested lenses of the same two wires; else one for each.", True)
    frame_expansion: Expansion = key(
        "Thermal expansion of what holds the mesh: strains are of its edge at the reference temperature. 0: held edges stand"
        " still whatever the temperature.",
        0.0,
    )


@dataclass(frozen=True, kw_only=True)
class Pull(Table):
    """[[load.pull]]: a place on the outline that is moved beside the load of the whole mesh."""

    at: Vector = key(
        "A place on the edge, or near it, from the middle of the box around the mesh as knitted. Write"
        ' `pull = [{at = ["12 mm", "0 mm"], by = ["1 mm", "0 mm"], width = "10 mm"}]`.'
    )
    by: Vector = key("By how much it moves beside the load of the whole mesh. `pull = []` moves all back.")
    width: Length | None = key(
        "How much of the edge moves along, as cos^2. With `panel.grip_pitch` it is left out: the nearest net node moves.",
        None,
        left_out="required without net nodes",
    )


@dataclass(frozen=True, kw_only=True)
class Stage(Table):
    """[load] and each [[path]]: one stage of the loading, by its end. What is left out is as in the stage before.

    Each direction goes by strain or by tension, the other of the two being None. A hook is driven by `displacement` alone, which
    its model carries as a shear of its frame (hook.py); of a mesh, `displacement` is turned into strains when it is read.
    """

    name: Name = key("Names the stage in the results.", None, left_out="`load`, then `stage-2`, ...")
    strain_weft: Strain | None = key(
        "Strain at the end of the stage, against the knitted size.", None, left_out="0, then the stage's before"
    )
    tension_weft: Tension | None = key("Instead of `strain_weft`: force per current width at the end of the stage.", None)
    strain_warp: Strain | None = key("The same in warp.", None, left_out="0, then the stage's before")
    tension_warp: Tension | None = key("Instead of `strain_warp`.", None)
    displacement: SignedLength | None = key(
        "Instead of both strains: every side moves outward by so much. Of a `[hook]`: the driven end moves right by so much.",
        None,
    )
    shear: Shear = key("Weft displacement over warp distance.", None, left_out="0, then the stage's before")
    clamp_rotation: Turn = key(
        "Counter-clockwise, of every clamp where it holds its wire; without it clamps keep their direction. Gripped meshes at"
        ' rest only (`drive = "relax"`), without cord or pull.',
        None,
        left_out="0, then the stage's before",
    )
    temperature: Temperature = key(
        "Temperature at the end of the stage, in the middle of the mesh.",
        None,
        left_out="the reference temperature, then the stage's before",
    )
    temperature_gradient: TemperatureGradient = key(
        'How it grows along weft and warp. Gripped meshes at rest only (`drive = "relax"`).',
        None,
        left_out="none, then the stage's before",
    )
    pull: tuple[Pull, ...] = key("Places of the edge that are moved.", None, left_out="none, then the stage's before")

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
    """[contact]: contact of bodies with wires; a pair is active when closed with more force than the threshold."""

    friction: Friction = key(
        "Coulomb friction between bodies and wires, by relaxation. The state then depends on the path:"
        " [physics.md](physics.md#paths).",
        0.0,
    )
    threshold: Force = key(
        "A pair is active when it carries more force than this (and more than 1e-4 EI/W^2, which a steady state leaves out of"
        " balance).",
        0.0,
    )
    stiffness: Stiffness | None = key(
        "Contact penalty. The multipliers of a relaxation take its error out.", None, left_out="chosen"
    )
    treatment: Treatment = key("How the contact of a `[hook]` is carried, see below. A knit has free bodies.", "free-body")
    spring_stiffness: Stiffness | None = key(
        "`spring-point`, `spring-cylinder`, `ring`: of the spring to the ground; at most the contact penalty.",
        None,
        left_out="0.001 N/m",
    )
    ring_radius: Length | None = key("`ring`: its inner radius, at least that of the wire.", None, left_out="the wire's diameter")
    plane_friction: Coefficient | None = key("`friction-plane`: its friction coefficient.", None, left_out="0.1")
    plane_load: PositiveForce | None = key("`friction-plane`: what presses the body on it.", None, left_out="10 uN")
    contact_point: Fraction | None = key(
        "`point`: its place on the left wire, over the wire's length; the nearest node.", None, left_out="0.5"
    )
    target_share: Share | None = key("`point`: how much of the right wire, about its middle, is its target.", None, left_out="1")
    body_mass: BodyMass | None = key(
        "Ramp: mass of a contact body over that of half a loop of wire; in a `[hook]`, over half of one of its wires.",
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
    """[solver]: how the state is found. None: chosen by the solver."""

    preset: PresetName = key("Stands for the values below.", DEFAULT_PRESET)
    drive: Drive = key("`relax`: each load level is brought to rest. `ramp`: real time and real or scaled masses.", "relax")
    precision: Precision = key(
        "`single`: 32-bit fixed-point displacements and float32. `double`: float64.",
        None,
        left_out="the preset's; `double` above 48 nodes a loop, and of wires so thin that s (d/W)^2 is below 0.001, s being the"
        " softening",
    )
    mass_scaling: Factor = key("Ramp: all masses times this.", 1.0)
    target_time_step: Time | None = key("Ramp: masses raised, node by node, until this step is stable.", None)
    axial_softening: Factor = key("The axial stiffness is divided by it in the dynamics.", None, left_out="the preset's")
    damping: Rate | None = key(
        "Ramp: mass-proportional damping. Left out: the frequency of the slowest bending mode.", None, left_out="chosen"
    )
    loading_time: Time | None = key(
        "Ramp: time of a stage. Left out: ten periods of the slowest bending mode.", None, left_out="chosen"
    )
    residual_tolerance: Tolerance = key("What counts as steady.", None, left_out="the preset's")
    max_steps: StepCount | None = key(
        "Relax: a level that is not steady after so many steps ends the run with exit status 3.", None, left_out="no limit"
    )
    multipliers: Flag = key("Relax: take out the error of the softening and of the contact penalty.", True)


@dataclass(frozen=True, kw_only=True)
class Output(Table):
    """[output]: what is recorded and written."""

    frames: FrameCount = key("Recorded load levels of a stage; each is steady when relaxing.", 20)
    usd: Flag = key("Write scene.usda while running.", True)
    usd_full_every: FrameInterval = key(
        "Every so many frames hold all nodes; the first one and the ends of stages always do. Between them the level `full`"
        " stands still and `k8` moves. 0: only those.",
        1,
    )
    usd_points_per_tile: TileSize = key("About how many nodes one prim of scene.usda holds.", 500_000)
    vtk: Flag = key("Write vtk/ at the end.", False)
    figures: Flag = key("Draw figures/ at the end.", True)
    checkpoint_interval: Time = key("Of wall time, between checkpoints.", 60.0)


@dataclass(frozen=True)
class Sweep(Table):
    """[sweep]: the grid of strains that `warpknit map` runs."""

    strain_weft: Annotated[tuple[Strain, ...], Field(min_length=1)] = key(
        "Weft strains; `warpknit map` runs each with each warp strain."
    )
    strain_warp: Annotated[tuple[Strain, ...], Field(min_length=1)] = key("Warp strains.")
    seeds: Seeds = key("With `knit.scatter`: meshes, from `knit.seed` on, over which the map is the mean.", 1)


@dataclass(frozen=True, kw_only=True)
class Scene:
    """Everything a run depends on. Equal scenes are equal wherever they were read from."""

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

    @property
    def has_moving_edge(self) -> bool:
        """Whether the edge of the mesh does more than follow the load as a whole."""
        return self.panel.cord is not None or any(stage.pull for stage in self.stages)

    @property
    def preset_in_force(self) -> str | None:
        """The preset whose numerics a relaxation has, whatever `solver.preset` says; None where keys of its own change them."""
        if self.solver.drive != "relax" or not self.solver.multipliers or self.hook is not None:
            return None
        solver = self.solver
        return preset_like(self.model.nodes_per_loop, solver.axial_softening, solver.precision, solver.residual_tolerance)

    @property
    def depends_on_path(self) -> bool:
        """Whether the state depends on the way there, not on the load alone."""
        return self.contact.friction > 0.0 or self.wire.plastic

    @property
    def hash(self) -> str:
        """SHA-256 of the resolved values, in hex. The name and how the file is written do not enter."""
        return digest(self, without="name")
