"""The scene as frozen objects in plain SI: what is knitted, how it is loaded and solved.

The unit of a field stands in its annotation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from warpknit.scene.digest import digest
from warpknit.scene.hook import Hook
from warpknit.scene.panel import PanelOptions
from warpknit.scene.presets import preset_like
from warpknit.scene.wire import Wire
from warpknit.scene.wires import WireFile


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
    clamp_rotation: Annotated[float, "rad"]  # counter-clockwise, of each clamp where it is
    temperature: Annotated[float, "K"]  # in the middle of the panel
    temperature_gradient: tuple[float, float]  # [K/m] along weft and warp
    pull: tuple[Pull, ...]
    displacement: Annotated[float, "m"] | None = None  # of the driven end of a hook

    @property
    def by_tension(self) -> tuple[bool, bool]:
        """Whether weft and warp are driven by tension."""
        return self.strain_weft is None, self.strain_warp is None


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
