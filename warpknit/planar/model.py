"""The model: all constant data of a mesh, as device arrays in the precision of the run.

`build_model(scene)` knits one repeat, samples it, lays out its copies, chooses the numerical stiffnesses and masses, and
uploads the result. Host copies stay in `table` and `panel` (float64) for the measures.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import SimpleNamespace

import numpy as np
import warp as wp

from ..base.errors import ModelError
from ..base.text import at_most, exact, percent, short_repr
from ..compute.arrays import Precision, precision_of
from ..compute.device import start_warp
from ..compute.ranks import Ranks
from ..kernels.bodies import BODY_BLOCK
from ..kernels.contact_by_batch import PAIR_BATCH
from ..kernels.wire_forces import BLOCK_SIZE
from ..knit.cloth import Cloth
from ..mesh.hook_mesh import Treatment, choose_treatment, lay_out_hook
from ..mesh.layout import knit_scene, lay_out
from ..mesh.panel import Panel
from ..mesh.rest_table import Table
from ..mesh.strip import Strip, cut_strip
from ..mesh.tight_loops import TIGHT, approach_at_touch, first_touch
from ..results.finding import ResultWarning
from ..results.frame import WireLayout, curve_parts
from ..results.row import Row
from ..scene import Scene
from .device_arrays import MeshArrays, RestArrays, upload_mesh, upload_rest
from .numerics import Numerics, choose_numerics

CORD_SAG = 0.2  # of the size of a mesh: largest distance of its edge from its outline
SLID = 1.0  # diameters by which wires slide along each other: the double atlas cell has 1e-3, a queen's cord 3.5
NODES_AT_CLAMP = 3  # at either end of a wire, which clamps may shorten


@dataclass(frozen=True)
class Model(Numerics):
    """A mesh ready to run. Stiffnesses and masses are initial ones; the control array holds the current ones."""

    __repr__ = short_repr

    scene: Scene
    cloth: Cloth | None  # None for wires that no pattern made
    table: Table
    panel: Panel
    precision: Precision
    device: str
    rest: RestArrays
    mesh: MeshArrays
    treatment: Treatment  # contact constraint; in a mesh its reach is body radius + half a wire thickness
    ranks: Ranks = field(default_factory=Ranks)  # ranks that share the mesh
    strip: Strip | None = None  # the part of the mesh in `panel` and all arrays, with several ranks

    @cached_property
    def global_model(self) -> Model:
        """Model of the global mesh on the host; its device arrays belong to the strip."""
        return self if self.strip is None else replace(self, panel=self.strip.whole, strip=None)

    @property
    def axial_stiffness(self) -> float:
        """[N] true EA."""
        return self.scene.wire.axial_stiffness

    @property
    def bending_stiffness(self) -> float:
        """[N m2] EI."""
        return self.scene.wire.bending_stiffness

    @property
    def node_count(self) -> int:
        """Number of nodes stepped."""
        return self.panel.node_count

    @property
    def loop_length(self) -> float:
        """[m] of wire: the nodes are evenly spaced."""
        return float(self.table.spacing.mean()) * self.scene.model.nodes_per_loop

    @property
    def is_gripped(self) -> bool:
        """Whether two clamps hold every wire (kernels/clamp.py)."""
        return len(self.panel.clamp_position) == 2 * len(self.panel.wire_first)

    @property
    def yield_moment(self) -> float:
        """[N m] of the yarn at which its outermost fibres reach the yield stress; 0 where the scene keeps it elastic."""
        wire = self.scene.wire
        return wire.yield_curvature * wire.bending_stiffness if wire.plastic else 0.0

    @cached_property
    def constants(self) -> SimpleNamespace:
        """Constants for kernels, in the run's precision unless the kernel takes double."""
        real, wire = self.precision.real, self.scene.wire
        return SimpleNamespace(
            unit=real(self.precision.unit),  # [m] of one count of a coordinate
            gripped=int(self.is_gripped),
            slow_when_free=int(self.scene.solver.drive == "relax"),  # whether masses are fictitious (kernels/bodies.py)
            reach_at_rest=real(self.treatment.reach),  # [m]
            yield_moment=real(self.yield_moment),  # [N m]
            kept_stiffness=real(wire.hardening),  # [-] share that is left of the bending stiffness where a wire yields
            true_stiffness=wp.float64(self.axial_stiffness),  # [N]
            friction=wp.float64(self.scene.contact.friction),  # [-] coefficient
            block_size=BLOCK_SIZE,
        )

    @property
    def curve_error(self) -> float:
        """[m] error of the rest curve between the nodes."""
        return self.table.curve_error

    @property
    def pair_count(self) -> int:
        """Two for each body."""
        return 2 * self.panel.body_count

    @cached_property
    def node_length(self) -> np.ndarray:
        """[node] [m] wire that a node stands for: half of both segments, between the clamps where the wire has some."""
        panel, table = self.panel, self.table
        if not len(panel.wire_begin):
            return table.node_length[panel.node_entry]
        # clamps are next to the ends
        first, count, spacing = panel.wire_first[:, None], panel.wire_count[:, None], table.spacing[panel.wire_thread][:, None]
        near, begin = np.arange(NODES_AT_CLAMP), panel.wire_begin[:, None]
        local = np.concatenate([np.minimum(near, count - 1), np.maximum(count - 1 - near, 0)], axis=1)
        arc = (panel.node_entry[first] - table.start[panel.wire_thread][:, None] + local) * spacing
        low, high = begin, begin + panel.wire_length[:, None]
        values = np.repeat(table.spacing[panel.wire_thread], panel.wire_count)
        values[first + local] = np.maximum(0.0, np.minimum(arc + 0.5 * spacing, high) - np.maximum(arc - 0.5 * spacing, low))
        return values

    @property
    def node_rest(self) -> np.ndarray:
        """(node, 2) [m] rest positions."""
        entry, origin = self.panel.node_entry, np.repeat(self.panel.block_origin, self.panel.block_count, axis=0)
        return np.stack([self.table.x[entry], self.table.y[entry]], axis=1) + origin

    @property
    def bodies(self) -> np.ndarray:
        """[body] index in the global mesh."""
        return np.arange(self.panel.body_count) if self.strip is None else self.strip.body

    @property
    def owned_bodies(self) -> int:
        """Number of the first bodies, which count in sums of this rank."""
        return self.panel.body_count if self.strip is None else self.strip.owned_bodies

    def layout(self) -> WireLayout:
        """Layout of the wires, for the exports."""
        p = self.panel
        return WireLayout(
            wire_start=np.concatenate([p.wire_first, [p.node_count]]),
            wire_closed=p.wire_closed,
            period=np.array(p.size),
            diameter=self.scene.wire.thickness,
            body_radius=self.scene.model.body_radius,
            body_wires=p.pair_wire.reshape(-1, 2),
            rhombus_bodies=p.rhombus_bodies,
            repeats=np.array(self.scene.knit.repeats if self.cloth is not None else (0, 0)),
            curve_parts=curve_parts(p.node_count, self.scene.model.nodes_per_loop),
            body_class=np.zeros(0, dtype=np.int64) if self.cloth is None else self.cloth.classes[p.body_clasp],
        )

    @property
    def when_compressed(self) -> str:
        """Behaviour under compression that the model lacks, in words."""
        return "wrinkle out of its plane"

    def warnings(self, rows: Sequence[Row]) -> Iterator[ResultWarning]:
        """Warnings where the planar model is not valid, the gravest first."""
        if self.cloth is not None:
            yield from slid_wires(self.scene, rows)
            yield from tight_loops(self.scene, self.cloth)


def build_model(scene: Scene, device: str = "cpu", ranks: Ranks | None = None) -> Model:
    """Build and upload the model of a scene, or this rank's strip of it. Raises `ModelError`, `MemoryNeeded`, `KnitError`."""
    start_warp()
    if scene.hook is not None:
        table, panel, length = lay_out_hook(scene, scene.hook)
        model = assemble_model(scene, table, panel, device=device, loop_length=length, displacement_range=2 * length)
        spring, limit = scene.contact.spring_stiffness, model.contact_stiffness
        if spring is not None and spring > limit:
            wrong = f"{exact(spring, 'N/m')} is above the contact penalty; write at most {at_most(limit, 'N/m')}"
            raise ModelError(f"contact.spring_stiffness: {wrong}")
        return model
    cloth = knit_scene(scene, device)
    table, panel, loop_length = lay_out(scene, cloth)
    # [m] largest distance of the edge from the affinely mapped outline
    pulled = max((math.hypot(*pull.by) for stage in scene.stages for pull in stage.pull), default=0.0)
    edge_travel = 2 * pulled + (CORD_SAG * max(scene.knit.size) if scene.panel.cord else 0.0)
    furthest = 2 * max(scene.knit.wale_spacing, scene.knit.course_spacing) + edge_travel
    return assemble_model(
        scene, table, panel, device=device, loop_length=loop_length, displacement_range=furthest, cloth=cloth, ranks=ranks
    )


def assemble_model(
    scene: Scene,
    table: Table,
    panel: Panel,
    *,
    device: str,
    loop_length: float,
    displacement_range: float,
    cloth: Cloth | None = None,
    ranks: Ranks | None = None,
) -> Model:
    """Choose the numerics and upload; `loop_length` [m] is the wire length of a loop, for the mass of a body.

    `ranks` share the panel in strips.
    """
    ranks = ranks or Ranks()
    strip = cut_strip(panel, ranks.rank, ranks.count) if ranks.count > 1 else None
    panel = panel if strip is None else strip.panel
    precision = precision_of(scene.solver.precision, displacement_range)
    numerics = choose_numerics(scene, table, loop_length)
    treatment = choose_treatment(scene, numerics.contact_stiffness)
    return Model(
        **vars(numerics),
        scene=scene,
        cloth=cloth,
        table=table,
        panel=panel,
        precision=precision,
        device=device,
        rest=upload_rest(table, precision, numerics, scene.wire.bending_stiffness, device),
        mesh=upload_mesh(panel, strip, precision, device, treatment),
        treatment=treatment,
        ranks=ranks,
        strip=strip,
    )


def body_blocks(model: Model) -> int:
    return max(1, -(-model.owned_bodies // BODY_BLOCK))


def contact_batches(model: Model) -> int:
    return -(-model.pair_count // int(PAIR_BATCH))


def slid_wires(scene: Scene, rows: Sequence[Row]) -> Iterator[ResultWarning]:
    """Warning where wires slid along each other, which invalidates the result."""
    slid = max((row.get("slid_max_m") or 0.0 for row in rows), default=0.0) / scene.wire.diameter
    if slid > SLID:
        yield ResultWarning("W01", f"Wires slid along each other by {slid:.2g} diameters; the planar result is not valid.")


def tight_loops(scene: Scene, cloth: Cloth) -> Iterator[ResultWarning]:
    """Warning where round wires touch long before planar lenses close."""
    share, loops = first_touch(scene), "Tight loops"
    if share >= TIGHT and scene.knit.scatter:
        wire, loops = scene.wire, "The tightest of the scattered loops"
        share = approach_at_touch(cloth, wire.thickness, wire.thickness + 2.0 * scene.model.body_radius)
    if share < TIGHT:
        yield ResultWarning(
            "W02",
            f"{loops}: the planar model closes contacts too late, and its tension is too small (round wires touch after"
            f" {percent(share, 0)} of its approach).",
        )
