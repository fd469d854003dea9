"""The tables [model], [contact], [solver], [output], [load], [[path]] and [sweep], as frozen objects in plain SI."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import degrees, exp
from typing import Annotated, Any

from pydantic import Field, model_validator

from ..base.text import celsius, either, exact
from . import values
from .keys import Table, key
from .presets import DEFAULT_PRESET
from .units import shown
from .values import TREATMENTS, Choice, Integer, Pair, Quantity, refused

AUTO = "auto"  # model.kind, resolved by capabilities.py; output.frames (solve/relax.py)
DEFAULT_LEVELS = 20
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
class KindOfModel:
    """Differences between kinds of model for scenes, meshes and messages."""

    # thicknesses of the wire by which hooked wires pass each other at rest, as in a knit; None: they lie in one plane
    crossing: float | None
    single_positions: str  # what displacements are in single precision
    has_branches: bool  # a tight knit may have several equilibria under one load, without friction too
    friction: float  # coefficient by default: docs/studies/friction.md
    own_loops: bool  # worlds side by side may have loops, wires and friction of their own
    leaves_plane: bool  # nodes move out of the plane
    carries_friction: bool  # a large mesh takes over the friction of one repeat


KINDS = {
    "planar": KindOfModel(
        crossing=None,
        single_positions="32-bit fixed point",
        has_branches=False,
        friction=0.0,
        own_loops=False,
        leaves_plane=False,
        carries_friction=False,
    ),
    "spatial": KindOfModel(
        crossing=1.3,
        single_positions="float64",
        has_branches=True,
        friction=0.2,
        own_loops=True,
        leaves_plane=True,
        carries_friction=True,
    ),
}


@dataclass(frozen=True, kw_only=True)
class ModelOptions(Table):
    """[model]: the kind of model and its discretisation."""

    kind: Annotated[str, Choice(("auto", "planar", "spatial"))] = key(
        "`planar`: two coordinates per node, contact bodies where wires hook. `spatial`: three coordinates, with twist and"
        " contact of round wires ([theory](theory/contact.md#round-wires)); required with `[wires]`. `auto`: spatial,"
        " unless only the planar model has a feature of the scene or the command ([below](#the-kind-of-model)). See"
        " [capabilities.md](capabilities.md) for the features of each.",
        AUTO,
    )
    boundary: Annotated[str, Choice(("gripped", "periodic"))] = key(
        "`gripped`: cut along an outline, with every cut wire end clamped. `periodic`: one tile of an endless mesh.", "gripped"
    )
    nodes_per_loop: Annotated[int, Integer(8, 100_000)] = key("Nodes per loop of wire.", None, left_out="the preset's")
    body_radius: values.Length = key(
        "Planar model: radius of the contact body between two hooked wires. At d/8 both contacts close when the wires are 1.25 d"
        " apart.",
        None,
        left_out="diameter/8",
    )
    merge_lenses: values.Flag = key(
        "true: one contact body for nested lenses of the same two wires. false: a body for each lens.", True
    )
    frame_expansion: values.Expansion = key(
        "Thermal expansion of the frame that holds the mesh. Strains refer to the frame at the reference temperature. 0: the"
        " frame does not expand.",
        0.0,
    )

    @property
    def of_kind(self) -> KindOfModel:
        """Properties of the kind of model."""
        return KINDS[self.kind]


@dataclass(frozen=True, kw_only=True)
class Contact(Table):
    """[contact]: contact between wires; a pair is active when its force exceeds the threshold."""

    friction: Annotated[float, Quantity("number", least=0.0, most=5.0)] = key(
        'Coulomb friction coefficient; in the planar model `drive = "relax"` only. The state then depends on the load history:'
        " [theory](theory/contact.md#planar-friction).",
        None,
        left_out="0.2 spatial, 0 planar",
    )
    threshold: Annotated[float, Quantity("force", least=0.0)] = key(
        "A pair is active when its force exceeds this value (and 1e-4 EI/W^2, the unbalanced force of a converged state).", 0.0
    )
    stiffness: Annotated[float, Quantity("tension", above=0.0)] | None = key(
        "Contact penalty. The multipliers of a relaxation correct its error.", None, left_out="chosen"
    )
    treatment: values.Treatment = key(
        "Contact carrier or constraint of a `[hook]`, see below. A knit has free bodies.", "free-body"
    )
    spring_stiffness: Annotated[float, Quantity("tension", above=0.0, usual="1 mN/m")] | None = key(
        "`spring-point`, `spring-cylinder`, `ring`: stiffness of the spring to the ground; at most the contact penalty.",
        None,
        left_out="0.001 N/m",
    )
    ring_radius: values.Length | None = key(
        "`ring`: inner radius, at least the radius of the wire.", None, left_out="the wire's diameter"
    )
    plane_friction: values.Coefficient | None = key("`friction-plane`: friction coefficient.", None, left_out="0.1")
    plane_load: Annotated[float, Quantity("force", above=0.0)] | None = key(
        "`friction-plane`: normal force of the body on the plane.", None, left_out="10 uN"
    )
    contact_point: values.Fraction | None = key(
        "`point`: place on the left wire, over its length, rounded to the nearest node.", None, left_out="0.5"
    )
    target_share: Annotated[float, Quantity("number", least=0.05, most=1.0)] | None = key(
        "`point`: part of the right wire that the point can touch, about the middle of this wire, over its length.",
        None,
        left_out="1",
    )
    body_mass: Annotated[float, Quantity("number", above=0.0, most=100.0)] | None = key(
        "Ramp: mass of a contact body over the mass of half a loop of wire; with `[hook]`, over the mass of half a wire.",
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

    preset: values.PresetName = key("Sets the defaults of the keys below.", DEFAULT_PRESET)
    drive: values.Drive = key("`relax`: equilibrium at each load level. `ramp`: real time with true or scaled masses.", "relax")
    precision: Annotated[str, Choice(("single", "double"))] = key(
        "`single`: float32, with positions in 32-bit fixed point (spatial: float64). `double`: float64.",
        None,
        left_out="the preset's; `double` above 48 nodes per loop, and for wires so thin that s (d/W)^2 is below 0.001 with the"
        " softening s",
    )
    mass_scaling: values.Factor = key("Ramp: factor on all masses.", 1.0)
    target_time_step: values.TimeStep | None = key("Ramp: raise masses, node by node, until this time step is stable.", None)
    axial_softening: values.Factor = key(
        "Largest allowed divisor of the axial stiffness in the dynamics. A run uses a smaller one where bending limits it, and"
        " for taut wires. `summary.json` has the initial value.",
        None,
        left_out="the preset's",
    )
    damping: Annotated[float, Quantity("rate", least=0.0)] | None = key(
        "Ramp: mass-proportional damping. Default: the frequency of the slowest bending mode.", None, left_out="chosen"
    )
    loading_time: Annotated[float, Quantity("time", above=0.0, usual="10 ms")] | None = key(
        "Ramp: duration of a load step. Default: ten periods of the slowest bending mode.", None, left_out="chosen"
    )
    residual_tolerance: values.Tolerance = key(
        "Relative residual below which a state is converged.", None, left_out="the preset's"
    )
    max_steps: Annotated[int, Integer(1, 10**15)] | None = key(
        "Relax: largest number of steps of a load level, or of an increment of a divided level. A run ends with exit status 3"
        " if this number is not enough.",
        None,
        left_out="500,000",
    )
    multipliers: values.Flag = key(
        "Relax: augmented Lagrangian multipliers correct the error of the softening and of the contact penalty.", True
    )


@dataclass(frozen=True, kw_only=True)
class Output(Table):
    """[output]: recorded levels and written files."""

    frames: Annotated[int | str, Integer(1, 100_000, "auto")] = key(
        "Recorded load levels per load step; each is converged when relaxing. Levels are also the increments of the load:"
        " with one to three, a mesh may reach another equilibrium. `auto`: few, and more where a class of contacts closes, the"
        " wire first yields, slack ends, or at a snap-through. Ramps and maps have 20, maps of several meshes 8.",
        AUTO,
    )
    load_tolerance: values.Tolerance = key(
        "With `frames = 'auto'`: these events are found to this share of the load of a load step.", 0.02
    )
    usd: values.Flag = key("Write scene.usda while running.", True)
    usd_full_every: Annotated[int, Integer(0, 100_000)] = key(
        "Interval of frames with all nodes; the first frame and the ends of load steps always have them. In between, `k8` is"
        " updated and `full` is not. 0: only the first frame and the ends of load steps.",
        1,
    )
    usd_points_per_tile: values.TileSize = key("Approximate number of nodes per prim of scene.usda.", 500_000)
    vtk: values.Flag = key("Write vtk/ at the end.", False)
    figures: values.Flag = key("Draw figures/ at the end.", True)
    service_tension: values.Tension | None = key(
        "Mean tension of weft and warp in service. Answers of a run and service points of a report give the share of active"
        " contacts there.",
        None,
        left_out="2, 3.4 and 4.9 N/m; a run uses the values that it reaches",
    )
    checkpoint_interval: Annotated[float, Quantity("time", above=0.0)] = key(
        "Wall time between checkpoints. It is longer if writing one takes more than a tenth of this time, and over a second.",
        60.0,
    )

    @property
    def levels(self) -> int:
        """Equal load levels of a stage where none are added: of a ramp, a map of a single mesh, a large mesh."""
        return DEFAULT_LEVELS if isinstance(self.frames, str) else self.frames


MOST_DEVIATIONS = 3.0  # of the wire of a mesh, in standard deviations
VARIANT_LEVELS = 8  # of each of several meshes, where levels are found automatically
SIDES = ("weft", "warp")


@dataclass(frozen=True, kw_only=True)
class Pull(Table):
    """[[load.pull]]: a place on the outline that is displaced in addition to the load."""

    at: values.Vector = key(
        "Position on or near the edge, relative to the centre of the bounding box of the mesh as knitted. Write"
        ' `pull = [{at = ["12 mm", "0 mm"], by = ["1 mm", "0 mm"], width = "10 mm"}]`.'
    )
    by: values.Vector = key("Displacement in addition to the load of the whole mesh. `pull = []` removes all pulls.")
    width: values.EdgeLength | None = key(
        "Width of the displaced part of the edge, with a cos^2 profile. Left out with `panel.grip_pitch`: the nearest net node"
        " moves.",
        None,
        left_out="required without net nodes",
    )


@dataclass(frozen=True, kw_only=True)
class Stage(Table, one_of=(("strain_weft", "tension_weft", "displacement"), ("strain_warp", "tension_warp", "displacement"))):
    """[load] and each [[path]]: one stage of the loading, by its final state. Missing keys are as in the load step before.

    Each direction is driven by strain or by tension; the other one is None. A hook is driven by `displacement` alone, which its
    model applies as a shear of its frame (mesh/hook_mesh.py); for a mesh, `displacement` is converted to strains on reading.
    """

    name: values.Name = key("Name of the load step in the results.", None, left_out="`load`, then `stage-2`, ...")
    strain_weft: values.Strain | None = key(
        "Strain at the end of the load step, relative to the knitted size.", None, left_out="0, then as in the previous load step"
    )
    tension_weft: values.Tension | None = key("Instead of `strain_weft`: force per current width.", None)
    strain_warp: values.Strain | None = key("The same in warp.", None, left_out="0, then as in the previous load step")
    tension_warp: values.Tension | None = key("Instead of `strain_warp`.", None)
    displacement: Annotated[float, Quantity("length", usual="1.2 mm")] | None = key(
        "Instead of both strains: outward displacement of every side. With `[hook]`: displacement of the driven end to the"
        " right.",
        None,
    )
    shear: values.Shear = key("Weft displacement over warp distance.", None, left_out="0, then as in the previous load step")
    clamp_rotation: Annotated[float, Quantity("angle", least=-1.6, most=1.6)] = key(
        "Counter-clockwise rotation of every clamp about the point where it holds its wire. Gripped meshes with"
        ' `drive = "relax"` only, without cord or pull.',
        None,
        left_out="0, then as in the previous load step",
    )
    temperature: values.Temperature = key(
        "Temperature at the end of the load step, at the middle of the mesh.",
        None,
        left_out="the reference temperature, then as in the previous load step",
    )
    temperature_gradient: Annotated[tuple[float, float], Pair(Quantity("temperature_gradient"))] = key(
        'Temperature gradient along weft and warp. Gripped meshes with `drive = "relax"` only.',
        None,
        left_out="none, then as in the previous load step",
    )
    pull: tuple[Pull, ...] = key("Displaced places of the edge.", None, left_out="none, then as in the previous load step")

    @property
    def by_tension(self) -> tuple[bool, bool]:
        """Whether weft and warp are driven by tension."""
        return self.strain_weft is None, self.strain_warp is None

    @property
    def text(self) -> str:
        """The state at its end in words: what drives weft and warp, or a hook, and the temperature."""
        driven = ((self.strain_weft, self.tension_weft), (self.strain_warp, self.tension_warp))
        sides = [
            f"strain {100.0 * strain:.6g} %" if strain is not None else f"tension {exact(tension or 0.0, 'N/m')}"
            for strain, tension in driven
        ]
        equal = sides[0] == sides[1]
        parts = [f"{sides[0]} in weft and warp"] if equal else [f"{sides[0]} in weft", f"{sides[1]} in warp"]
        if self.displacement is not None:
            parts = [f"displacement {exact(self.displacement, 'm')}"]
        elif self.shear:
            parts.append(f"shear {100.0 * self.shear:.6g} %")
        if self.clamp_rotation:
            parts.append(f"clamps rotated by {degrees(self.clamp_rotation):.6g} deg")
        if self.pull:
            parts.append(f"{len(self.pull)} pull{'s' if len(self.pull) > 1 else ''} of the edge")
        gradient = ", with a gradient" if any(self.temperature_gradient) else ""
        return f"{', '.join(parts)}, at {celsius(self.temperature)}{gradient}"


@dataclass(frozen=True, kw_only=True)
class Sweep(Table, one_of=(("strain_weft", "tension_weft"), ("strain_warp", "tension_warp"))):
    """[sweep]: the grid of strains, or of tensions, that `warpknit map` runs."""

    strain_weft: Annotated[tuple[values.Strain, ...], Field(min_length=1)] | None = key(
        "Weft strains; `warpknit map` combines each with every warp strain.", None, left_out="required, or tensions"
    )
    strain_warp: Annotated[tuple[values.Strain, ...], Field(min_length=1)] | None = key(
        "Warp strains.", None, left_out="required, or tensions"
    )
    tension_weft: Annotated[tuple[values.Tension, ...], Field(min_length=1)] | None = key(
        "Instead of both strains: weft tensions, each combined with every warp tension.", None
    )
    tension_warp: Annotated[tuple[values.Tension, ...], Field(min_length=1)] | None = key("Warp tensions.", None)

    @model_validator(mode="before")
    @classmethod
    def _strains_or_tensions(cls, data: Any) -> Any:
        if isinstance(data, dict):
            quantity = "tension" if any(f"tension_{side}" in data for side in SIDES) else "strain"
            for side in SIDES:
                if f"{quantity}_{side}" not in data:
                    raise refused(
                        "is missing", "write a list with at least one entry", key=f"{quantity}_{side}", given="the list"
                    )
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
        """Strains, or tensions [N/m], of the two axes: weft and warp, each value once, in order."""
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
class Variants(Table):
    """[variants]: meshes that are alike but for what scatters; results are means over them, with their range."""

    count: Annotated[int, Integer(1, 1000)] = key(
        "Number of meshes with scattered loops; results are their mean. 1: a single mesh, with `knit.scatter`.",
        None,
        left_out="16 for a spatial tile without `knit.scatter`, `--error`, `trade` and `mpirun`; else 1",
    )
    standard_error: values.Fraction = key(
        "Largest standard error of tension (or strain, where tension drives), active contacts and largest stress. A run adds"
        " meshes up to four times `count` to reach it, a map up to `count`. Half of `count` meshes are enough where the error is"
        " below 0.4 times this value. 0: exactly `count` meshes.",
        0.05,
    )
    scatter: values.Scatter = key("Relative standard deviation of the loop proportions, in place of `knit.scatter`.", 0.02)
    friction: values.Fraction = key("Standard deviation of the logarithm of `contact.friction` between the meshes.", 0.0)
    wire: values.Scatter = key(
        "Standard deviation of the logarithm of `wire.diameter` between the meshes, limited to three standard deviations."
        " Contact bodies scale with the wire.",
        0.0,
    )
    seed: values.Seed = key("Random seed of the first mesh; the next meshes have the next seeds.", 0)
    sensitivity: values.Flag = key(
        "Estimate the error of the means (`quality.estimated_error`). Two meshes run again with fewer nodes, and with half and"
        " twice the friction. A planar tile is compared with three meshes of the spatial model (`spatial_model`), where that"
        " takes seconds.",
        True,
    )
    overshoot: values.Fraction = key(
        "Share of the first load by which `sensitivity` strains the meshes further before unloading.", 0.0
    )

    @property
    def thickest(self) -> float:
        """Largest diameter over `wire.diameter`; its inverse is the smallest one."""
        return exp(MOST_DEVIATIONS * self.wire)


@dataclass(frozen=True, kw_only=True)
class Reflection(Table):
    """[reflection]: a plane wave on the mesh, as an endless sheet of thin wires."""

    frequencies: values.FrequencyList = key(
        'Frequencies, below the first grating lobe of the repeat; `["10 GHz", "30 GHz"]`, or `"1 to 40 GHz, 50"` for 50 of them.',
        allowed="a frequency from 1 MHz to 1 THz, a list, or a range with their number, such as `1 to 40 GHz, 50`",
    )
    theta: Annotated[float, Quantity("angle", least=0.0, most=1.5)] = key("Angle of incidence, from the normal of the mesh.", 0.0)
    phi: values.Angle = key(
        "Direction in which the wave goes along the mesh, from weft towards warp. At normal incidence, TE has its field along the"
        " warp and TM along the weft for phi = 0.",
        0.0,
    )
    contacts: Annotated[str, Choice(("computed", "open", "closed"))] = key(
        "State of the contacts. `computed`: resistance from the contact force; `open` and `closed` are computed as well, for"
        " comparison."
        " `open`: no contact conducts. `closed`: all contacts are perfect.",
        "computed",
    )
    film_resistance: Annotated[float, Quantity("resistance", least=0.0)] = key(
        "Resistance of a film on each contact, in series with its constriction ([how-to](how-to/corroding_contacts.md)).", 0.0
    )
    branch_length: values.Length | None = key(
        "Longest branch of wire in the field solver, of two straight halves; at least one wire diameter.",
        None,
        left_out="1/72 of the wire of a loop",
    )
