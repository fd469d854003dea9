"""The spatial model: wires of a panel (mesh/panel.py) as rods."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..base.text import at_least, exact, short_repr
from ..compute.arrays import Precision, precision_of
from ..compute.device import start_warp
from ..compute.memory import refuse_beyond_memory
from ..compute.ranks import Ranks
from ..knit.cloth import Cloth
from ..mesh.hook_mesh import lay_out_hook
from ..mesh.layout import knit_scene, lay_out
from ..mesh.panel import Panel
from ..mesh.rest_table import Table
from ..mesh.strip import panel_of
from ..results.finding import ResultWarning
from ..results.frame import WireLayout, curve_parts
from ..results.row import Row
from ..scene import Scene
from ..scene.capabilities import refuse
from ..scene.messages import scene_error
from ..scene.wire import Wire
from ..wires.centre_lines import Wires
from ..wires.read import rest_wires, thickness_of
from .from_file import panel_of_wires
from .pair_search import search_cells
from .placed_wires import SpatialWires, hook_wires, place_wires
from .rest_curve import RestCurve, along_centre_line, catmull_rom, fit_rest_curve
from .rod_arrays import RodState, rest_state
from .rods import Rods, Section, rods_of
from .step_bound import RampNumerics, ramp_numerics
from .strip import RodStrip, cut_rods

ROUND_OFF = 1e-9  # relative, of lengths
LEAST_SPACING = 0.5  # smallest node spacing of wires from a file, in thicknesses of the wire
# dynamics of a relaxation, whose multipliers correct them: about as stiff as the loops, of length L
SOFT_STRETCH = 430.0  # axial stiffness over EI/L^2
SOFT_PENALTY = 1000.0  # contact penalty over EI/L^3
STRAIGHT_PENALTY = 5.0  # the same over the stiffness of a nearly straight wire, of length L
BORDER = 0.5  # wale spacings that wires of different strips may come nearer to each other along the weft
CONTACT_TO_BENDING = 1.0  # default contact penalty over the larger of 4 EI/h^3 and softened EA/h


@dataclass(frozen=True)
class SpatialModel:
    """A mesh of rods: everything that does not move. `panel` has the wires and the places where they hook each other.

    Wires from a file have no cloth and no table.
    """

    __repr__ = short_repr

    scene: Scene
    panel: Panel
    wires: SpatialWires
    rods: Rods
    curve: RestCurve  # of the wires between their nodes
    softening: float  # EA over the axial stiffness of the dynamics
    contact_stiffness: float  # [N/m] penalty of a ramp, and of friction
    soft_penalty: float  # [N/m] smallest penalty of a relaxation
    loop_length: float  # [m]
    device: str
    precision: Precision
    cloth: Cloth | None = None
    table: Table | None = None
    ranks: Ranks = field(default_factory=Ranks)  # ranks that share the mesh
    strip: RodStrip | None = None  # the wires that are stepped here, with several ranks
    whole: SpatialModel | None = None  # the model of all ranks; None: this one
    time_step: float = 1.0  # [s] initial one
    limited_by: str = "unit step"  # limit of the time step, in words
    loading_time: float = 0.0  # [s] of a stage of a ramp
    added_mass: float = 0.0  # by scaling, over the true mass
    ramp: RampNumerics | None = None  # masses and damping of a ramp
    base: SpatialModel | None = None  # a mesh of the same topology, whose solver constants it has; None: its own

    @property
    def bending_stiffness(self) -> float:
        """EI [N m2]; where wires differ, of the thickest one."""
        return self.scene.wire.bending_stiffness

    @property
    def curve_error(self) -> float:
        """[m] error of the rest curve between the nodes."""
        return self.curve.fit_error

    @property
    def global_model(self) -> SpatialModel:
        """The model of the mesh of all ranks."""
        return self.whole or self

    @property
    def bodies(self) -> np.ndarray:
        """[site] index of each site; only the global model has it, also for a strip."""
        return np.arange(self.panel.body_count)

    @property
    def node_count(self) -> int:
        """Number of nodes of the rods; the panel counts only nodes between clamps."""
        return self.rods.node_count

    @property
    def when_compressed(self) -> str:
        """Behaviour under compression that the model cannot show."""
        return "wrinkle over many repeats"

    def warnings(self, rows: Sequence[Row]) -> Iterator[ResultWarning]:
        """Warnings on the validity of the model: none."""
        yield from ()

    @property
    def pair_count(self) -> int:
        """Two for each site, as in the planar model."""
        return 2 * self.panel.body_count

    def beside(self, base: SpatialModel) -> SpatialModel:
        """This mesh as a world of several: solver constants of `base`, own wire sections."""
        thickest, whole = base.scene.variants.thickest, base.rods.section
        section, radius = replace(whole, thickness=whole.thickness / thickest), thickest * base.rods.largest_radius
        sections = () if self.rods.section == section else (self.rods.section,) * len(self.rods.wire_first)
        rods = replace(self.rods, section=section, sections=sections, radius_beside=radius)
        return replace(self, rods=rods, base=replace(base, rods=replace(base.rods, section=section, radius_beside=radius)))

    def held_shift(self, gradient: np.ndarray, length_factor: float = 1.0) -> np.ndarray:
        """(held, 2) [m] displacement of held nodes from their affine positions.

        The clamp moves affinely; its nodes keep its direction, and their distance from it expands as the wire does.
        """
        return self.wires.held_lever @ (length_factor * np.eye(2) - gradient).T

    def layout(self) -> WireLayout:
        """Layout of the wires for the exports; each site counts as a body."""
        p, rods, wires = self.panel, self.rods, self.scene.wires
        return WireLayout(
            wire_start=np.concatenate([rods.wire_first, [rods.node_count]]),
            wire_closed=rods.wire_closed,
            period=np.array(p.size),
            diameter=self.scene.wire.thickness,
            wire_diameter=2.0 * rods.wire_radius,
            body_radius=0.0,
            body_wires=p.pair_wire.reshape(-1, 2),
            rhombus_bodies=p.rhombus_bodies,
            repeats=np.array(self.scene.knit.repeats if wires is None else wires.repeats),
            wire_closing=self.rods.wire_period[:, :2],
            curve_parts=curve_parts(rods.node_count, self.scene.model.nodes_per_loop),
            body_class=np.zeros(0, dtype=np.int64) if self.cloth is None else self.cloth.classes[p.body_clasp],
        )


def initial_state(model: SpatialModel) -> RodState:
    """The knitted shape, without velocity and load."""
    return rest_state(model.rods, model.device, model.precision)


def wire_section(wire: Wire) -> Section:
    """The section of a wire or yarn."""
    names = ("axial_stiffness", "bending_stiffness", "twist_stiffness", "linear_density", "thickness", "radius", "hardening")
    return Section(
        rotary_inertia=wire.linear_density * wire.thickness**2 / 8,
        yield_curvature=wire.yield_curvature if wire.plastic else 0.0,
        **{name: getattr(wire, name) for name in names},
    )


def build_model(scene: Scene, device: str = "cpu", ranks: Ranks | None = None) -> SpatialModel:
    """Spatial model of a scene, or this rank's strip of it. Raises `ModelError`, `MemoryNeeded`, `KnitError`, `SceneError`."""
    start_warp()
    model = _whole_model(scene, device)
    return model if ranks is None or ranks.count == 1 else _strip_of(model, ranks)


def _strip_of(model: SpatialModel, ranks: Ranks) -> SpatialModel:
    """Model of this rank's strip. Only the global model has the places where wires hook each other."""
    refuse(model.scene, "run", ranks=ranks.count)
    reach = search_cells(model.rods, model.curve).radius + BORDER * model.scene.knit.wale_spacing
    strip = cut_rods(model.panel, model.rods, ranks, reach)
    rods, wires, wire = model.rods.copied(strip.wire, np.zeros((len(strip.wire), 3))), model.wires, strip.wire
    begin, last = strip.nodes_of_mesh[[strip.nodes.start, strip.nodes.stop - 1]]
    own = slice(*np.searchsorted(wires.held_node, [begin, last + 1]))
    return replace(
        model,
        panel=panel_of(model.panel, wire),
        rods=rods,
        curve=replace(model.curve, row=rods.row),
        wires=replace(
            wires,
            held_node=np.searchsorted(strip.nodes_of_mesh, wires.held_node[own]),
            held_lever=wires.held_lever[own],
            **{name: getattr(wires, name)[:0] for name in ("site_wire", "site_seed", "site_low", "site_high")},
            panel_begin=None if wires.panel_begin is None else wires.panel_begin[wire],
            panel_step=None if wires.panel_step is None else wires.panel_step[wire],
        ),
        ranks=ranks,
        strip=strip,
        whole=replace(model, ranks=ranks),
    )


def _whole_model(scene: Scene, device: str) -> SpatialModel:
    section, cloth, table = wire_section(scene.wire), None, None
    if scene.wires is not None:
        # the fictitious masses allow for few contacts at a node
        least, given_spacing = LEAST_SPACING * section.thickness, exact(scene.wires.node_spacing, "m")
        if scene.wires.node_spacing < least * (1.0 - ROUND_OFF):
            wrong = f"{given_spacing} is below half the thickness of the wire"
            raise scene_error(scene.path, "wires.node_spacing", wrong, f"write at least {at_least(least, 'm')}")
        found, loop_length = rest_wires(scene), scene.wires.loop_length
        refuse_beyond_memory(f"wires.node_spacing = {given_spacing}", scene, found.node_count, device)
        panel, wires, rods = panel_of_wires(_sections(scene, found), found, loop_length)
        curve, spacing = catmull_rom(rods), float(rods.natural_length[rods.following >= 0].min())
    else:
        if scene.hook is not None:
            table, panel, loop_length = lay_out_hook(scene, scene.hook)
            segments = scene.model.nodes_per_loop
            wires, spacing = hook_wires(scene.hook, panel, segments), loop_length / segments
        else:
            cloth = knit_scene(scene, device)
            table, panel, loop_length = lay_out(scene, cloth)
            wires = place_wires(cloth, table, panel, section.thickness, evenly=scene.solver.drive == "ramp")
            spacing = float(table.spacing.min())
        rods, curve = rods_of_wires(section, panel, wires)
    rods = replace(rods, set_fraction=scene.wire.set_fraction)
    axial, bending = rods.of_wires("axial_stiffness"), rods.of_wires("bending_stiffness")
    # with more softening, bending limits the step of a ramp and nothing is gained
    most = (2.0 * spacing / scene.wire.diameter) ** 2
    if scene.solver.drive == "relax":
        most = float(np.min(axial * loop_length**2 / (SOFT_STRETCH * bending)))
    softening = max(1.0, min(scene.solver.axial_softening, most))
    stiffest = float(max(axial.max() / softening / spacing, 4.0 * bending.max() / spacing**3))
    # about as stiff as a loop, or as the softest wire where all are nearly straight
    soft = max(SOFT_PENALTY * (float(bending.max()) / loop_length**3), STRAIGHT_PENALTY * rods.wire_stiffness.min() / loop_length)
    given = scene.contact.stiffness
    model = SpatialModel(
        scene=scene,
        panel=panel,
        wires=replace(wires, forms=None),  # nothing reads them any more
        rods=rods,
        curve=curve,
        softening=softening,
        contact_stiffness=CONTACT_TO_BENDING * stiffest if given is None else given,
        soft_penalty=float(soft) if given is None else given,
        loop_length=loop_length,
        device=device,
        precision=precision_of(scene.solver.precision, 1.0),
        cloth=cloth,
        table=table,
    )
    return model if scene.solver.drive == "relax" else replace(model, **ramp_numerics(model))


def _sections(scene: Scene, wires: Wires) -> list[Section]:
    """[wire] the section of each wire of a file."""
    thickness = thickness_of(scene, wires)
    by_thickness = {
        each: wire_section(scene.wire if each == scene.wire.thickness else scene.wire.with_thickness(each))
        for each in np.unique(thickness).tolist()
    }
    return [by_thickness[each] for each in thickness.tolist()]


def rods_of_wires(section: Section, panel: Panel, wires: SpatialWires) -> tuple[Rods, RestCurve]:
    """Rods of the wires of a panel at rest and the curve between nodes. Computed for each form, then copied."""
    forms = wires.forms
    assert forms is not None
    period = np.array([0.0, panel.size[1], 0.0]) if panel.boundary == "periodic" else None
    rods = along_centre_line(rods_of(section, forms.points, [period] * len(forms.points), tile=wires.tile), forms.line)
    node = rods.nodes_of(forms.form)  # of the form, for each node of the copies
    sections = node[wires.held_section]
    copies = rods.holding(node[wires.held_node], sections, clamped=sections).copied(forms.form, forms.origin)
    return copies, replace(fit_rest_curve(rods, forms.line), row=copies.row)
