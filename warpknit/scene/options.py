"""The tables [model], [contact], [solver] and [output], as frozen objects in plain SI."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pydantic import model_validator

from warpknit.base.text import either
from warpknit.scene.keys import Table, key
from warpknit.scene.presets import DEFAULT_PRESET
from warpknit.scene.units import shown
from warpknit.scene.values import (
    TREATMENTS,
    BodyMass,
    Boundary,
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
    LoadingTime,
    NodesPerLoop,
    PositiveForce,
    Precision,
    PresetName,
    Rate,
    Share,
    SpringStiffness,
    StepCount,
    Stiffness,
    Tension,
    TileSize,
    Time,
    TimeStep,
    Tolerance,
    Treatment,
    refused,
)

AUTO = "auto"  # model.kind, resolved by capabilities.py
GIVEN, DEFAULT = "chosen in the scene", "the default"  # reasons for the kind of model

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


@dataclass(frozen=True, kw_only=True)
class ModelOptions(Table):
    """[model]: the kind of model and its discretisation."""

    kind: Kind = key(
        "`planar`: two coordinates per node, contact bodies where wires hook. `spatial`: three coordinates, with twist and"
        " contact of round wires ([theory](theory/contact.md#round-wires-in-space)); required with `[wires]`. `auto`: spatial,"
        " unless only the planar model has what the scene or the command asks for ([below](#the-kind-of-model)). See"
        " [capabilities.md](capabilities.md) for the features of each.",
        AUTO,
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
                    names = either([repr(user) for user in users])
                    wrong = f"has no effect with contact.treatment = {treatment!r}"
                    raise refused(wrong, f"leave it out, or write contact.treatment = {names}", key=name, given=shown(data[name]))
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
    axial_softening: Factor = key(
        "Largest divisor of the axial stiffness in the dynamics that is allowed. A run takes less where bending limits it, and"
        " for taut wires; `summary.json` has the one that was used at its start.",
        None,
        left_out="the preset's",
    )
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
