"""The tables and keys of a scene file, with their defaults. Values are SI once checked.

None means that the value follows from others: `warpknit.scene` fills in what it can, the model chooses the rest.
"""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from warpknit.knit.loops import RANGES
from warpknit.scene.materials import MATERIALS
from warpknit.scene.presets import DEFAULT_PRESET
from warpknit.scene.units import shown
from warpknit.scene.values import (
    TREATMENTS,
    Angle,
    AxialStiffness,
    BodyMass,
    Chain,
    Choice,
    Coefficient,
    Density,
    Ends,
    Expansion,
    Factor,
    FileName,
    Flag,
    Force,
    Fraction,
    FrameCount,
    FrameInterval,
    Friction,
    Length,
    LengthUnit,
    Name,
    NodesPerLoop,
    Number,
    Percent,
    Period,
    PerLength,
    PoissonsRatio,
    PositiveForce,
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
    Stress,
    Temperature,
    TemperatureGradient,
    Tension,
    Threading,
    TileSize,
    Time,
    Tolerance,
    Turn,
    Vector,
    WireRepeats,
    proportion,
    refused,
)

ROOM_TEMPERATURE = 293.15  # [K]

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

MaterialName = Annotated[str, BeforeValidator(Choice(tuple(MATERIALS)))]
Drive = Annotated[str, BeforeValidator(Choice(("relax", "ramp")))]
Precision = Annotated[str, BeforeValidator(Choice(("single", "double")))]
Kind = Annotated[str, BeforeValidator(Choice(("planar", "spatial")))]
Boundary = Annotated[str, BeforeValidator(Choice(("gripped", "periodic")))]
OutlineName = Annotated[str, BeforeValidator(Choice(("rectangle", "hexagon", "triangle", "disc", "polygon")))]
Treatment = Annotated[str, BeforeValidator(Choice(TREATMENTS))]
Interpolation = Annotated[str, BeforeValidator(Choice(("spline", "linear")))]
LoopShape = Annotated[str, BeforeValidator(Choice(("auto", "circular-oval", "general")))]


class Table(BaseModel):
    """A table of the scene file: unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


def _exclusive(data: Any, *groups: tuple[str, ...]) -> Any:
    """Refuse two keys of one group in the raw table `data`."""
    for group in groups:
        given = [key for key in group if isinstance(data, dict) and key in data]
        if len(given) > 1:
            first, second = given[:2]
            raise refused(
                f"one of {', '.join(group)}",
                key=second,
                given=f"{shown(data[second])} beside {first} = {shown(data[first])}",
            )
    return data


class PlatingTable(Table):
    """[wire] plating: a coat that adds stiffness and mass."""

    material: MaterialName = "gold"
    thickness: Length


class WireTable(Table):
    """[wire]: what is knitted. The material's values stand unless given here."""

    material: MaterialName = "tungsten"
    youngs_modulus: Stress | None = None
    poissons_ratio: PoissonsRatio | None = None
    density: Density | None = None
    expansion: Expansion | None = None
    yield_stress: Stress | None = None
    tensile_strength: Stress | None = None
    hardness: Stress | None = None
    diameter: Length = 15e-6
    ends: Ends = 1
    plating: PlatingTable | None = None
    plastic: Flag = False
    hardening: Fraction = 0.1
    set_fraction: Fraction = 1.0
    reference_temperature: Temperature = ROOM_TEMPERATURE


class BarTable(Table):
    """One guide bar of [knit] bars."""

    chain: Chain
    threading: Threading = "|"
    shift: Shift = 0


class LoopTable(Table):
    """[knit.loop]: proportions in units of the course spacing; `warpknit.knit.loops` says what they measure and their ranges."""

    shape: LoopShape = "auto"
    closed_radius: Annotated[float, proportion(*RANGES["closed_radius"])] = 0.6
    closed_head: Annotated[float, proportion(*RANGES["closed_head"])] = 0.55
    open_head: Annotated[float, proportion(*RANGES["open_head"])] = 0.5
    open_half_width: Annotated[float, proportion(*RANGES["open_half_width"])] = 0.26
    closed_foot: Annotated[float, proportion(*RANGES["closed_foot"])] = 0.1
    open_foot: Annotated[float, proportion(*RANGES["open_foot"])] = 0.19
    foot_radius: Annotated[float, proportion(*RANGES["foot_radius"])] = 0.1
    tilt: Annotated[float, proportion(*RANGES["tilt"])] = 0.1
    lateral_shift: Annotated[float, proportion(*RANGES["lateral_shift"])] = 0.02
    foot_half_width: Annotated[float, proportion(*RANGES["foot_half_width"])] = 0.12
    leg_half_width: Annotated[float, proportion(*RANGES["leg_half_width"])] = 0.24
    head_height: Annotated[float, proportion(*RANGES["head_height"])] = 0.22


class KnitTable(Table):
    """[knit]: the double atlas net of the paper where a key is left out."""

    bars: Annotated[list[BarTable], Field(min_length=1)] = [
        BarTable(chain="1-0/1-2/2-3/2-1", threading="|.", shift=0),
        BarTable(chain="2-3/2-1/1-0/1-2", threading="|.", shift=1),
    ]
    wale_spacing: Length | None = None
    wales: PerLength | None = None
    course_spacing: Length | None = None
    courses: PerLength | None = None
    repeats: Repeats = (1, 1)
    scatter: Scatter = 0.0
    seed: Seed = 0
    loop: LoopTable = LoopTable()

    @model_validator(mode="before")
    @classmethod
    def _one_spacing(cls, data: Any) -> Any:
        return _exclusive(data, ("wale_spacing", "wales"), ("course_spacing", "courses"))


class HookTable(Table):
    """[hook], in place of [knit]: two arcs of wire that hook each other."""

    radius: Length = 1e-3
    length: Length | None = None  # a third of a circle
    overlap: Length | None = None  # a fifth of the radius
    crossing_distance: Length | None = None  # in space: 1.3 thicknesses of the wire


class WiresTable(Table):
    """[wires], in place of [knit]: a file of centre lines that others made."""

    file: FileName
    unit: LengthUnit | None = None
    node_spacing: Length | None = None  # the diameter of the wire
    loop_size: Length | None = None  # 20 diameters of the wire
    interpolation: Interpolation = "spline"
    closed: Flag = False
    period: Period | None = None
    repeats: WireRepeats = (1, 1)
    time: Number | None = None


class ModelTable(Table):
    """[model]."""

    kind: Kind = "planar"
    boundary: Boundary = "gripped"
    nodes_per_loop: NodesPerLoop | None = None  # the preset's
    body_radius: Length | None = None  # diameter / 8: both pairings of a body close where the wires are 1.25 d apart
    merge_lenses: Flag = True
    frame_expansion: Expansion = 0.0


class CordTable(Table):
    """[panel.cord]: an elastic cord along the outline, between the net nodes."""

    tension: Force
    stiffness: AxialStiffness


class PanelTable(Table):
    """[panel]: what a gripped mesh is cut along and held by, and the surface it should make."""

    outline: OutlineName = "rectangle"
    size: Length | None = None
    corners: list[Vector] | None = None
    file: FileName | None = None
    rotation: Angle = 0.0
    grip_pitch: Length | None = None
    cord: CordTable | None = None
    focal_length: Length | None = None
    tension_threshold: Tension | None = None
    active_threshold: Percent | None = None


class PullTable(Table):
    """[[load.pull]]: a place on the outline that is moved beside the load of the whole mesh."""

    at: Vector
    by: Vector
    width: Length | None = None


class StageTable(Table):
    """[load] and each [[path]]: what is left out is as in the stage before."""

    name: Name | None = None
    strain_weft: Strain | None = None
    tension_weft: Tension | None = None
    strain_warp: Strain | None = None
    tension_warp: Tension | None = None
    displacement: SignedLength | None = None
    shear: Shear | None = None
    clamp_rotation: Turn | None = None
    temperature: Temperature | None = None
    temperature_gradient: TemperatureGradient | None = None
    pull: list[PullTable] | None = None

    @model_validator(mode="before")
    @classmethod
    def _one_drive_a_direction(cls, data: Any) -> Any:
        return _exclusive(data, ("strain_weft", "tension_weft", "displacement"), ("strain_warp", "tension_warp", "displacement"))


class ContactTable(Table):
    """[contact]."""

    friction: Friction = 0.0
    threshold: Force = 0.0
    stiffness: Stiffness | None = None
    treatment: Treatment = "free-body"
    spring_stiffness: Stiffness | None = None
    ring_radius: Length | None = None
    plane_friction: Coefficient | None = None
    plane_load: PositiveForce | None = None
    contact_point: Fraction | None = None
    target_share: Share | None = None
    body_mass: BodyMass | None = None

    @model_validator(mode="before")
    @classmethod
    def _keys_of_the_treatment(cls, data: Any) -> Any:
        if isinstance(data, dict):
            treatment = data.get("treatment", "free-body")
            for key, users in TREATMENT_KEYS.items():
                if key in data and treatment in TREATMENTS and treatment not in users:
                    names = " or ".join(repr(name) for name in users)
                    raise refused(f"only with contact.treatment = {names}", key=key, given=shown(data[key]))
        return data


class SolverTable(Table):
    """[solver]: what is left out follows from the preset, or is chosen by the solver."""

    preset: PresetName = DEFAULT_PRESET
    drive: Drive = "relax"
    precision: Precision | None = None
    mass_scaling: Factor = 1.0
    target_time_step: Time | None = None
    axial_softening: Factor | None = None
    damping: Rate | None = None
    loading_time: Time | None = None
    residual_tolerance: Tolerance | None = None
    max_steps: StepCount | None = None
    multipliers: Flag = True

    @model_validator(mode="before")
    @classmethod
    def _real_time_only_in_a_ramp(cls, data: Any) -> Any:
        if isinstance(data, dict) and data.get("drive", "relax") == "relax":
            for key in ("target_time_step", "loading_time"):
                if key in data:
                    raise refused("only with drive = 'ramp' (a relaxation has no real time)", key=key, given=shown(data[key]))
            if data.get("mass_scaling", 1) != 1:
                raise refused(
                    "1 with drive = 'relax' (its masses are fictitious), 1 or more with drive = 'ramp'",
                    key="mass_scaling",
                    given=shown(data["mass_scaling"]),
                )
        return data


class OutputTable(Table):
    """[output]."""

    frames: FrameCount = 20
    usd: Flag = True
    usd_full_every: FrameInterval = 1
    usd_points_per_tile: TileSize = 500_000
    vtk: Flag = False
    figures: Flag = True
    checkpoint_interval: Time = 60.0


class SweepTable(Table):
    """[sweep]: the grid of strains that `warpknit map` runs."""

    strain_weft: Annotated[list[Strain], Field(min_length=1)]
    strain_warp: Annotated[list[Strain], Field(min_length=1)]
    seeds: Seeds = 1  # meshes of scattered loops: knit.seed and on


class SceneFile(Table):
    """A whole scene file."""

    name: Name | None = None
    wire: WireTable = WireTable()
    knit: KnitTable = KnitTable()
    hook: HookTable | None = None
    wires: WiresTable | None = None
    model: ModelTable = ModelTable()
    panel: PanelTable = PanelTable()
    load: StageTable = StageTable()
    path: list[StageTable] = []
    contact: ContactTable = ContactTable()
    solver: SolverTable = SolverTable()
    output: OutputTable = OutputTable()
    sweep: SweepTable | None = None

    @model_validator(mode="before")
    @classmethod
    def _one_kind_of_mesh(cls, data: Any) -> Any:
        return _exclusive(data, ("knit", "hook", "wires"))
