"""Measures: pure functions of a model and a reading of its state (reading.py).

Everything is NumPy in float64. Strain measures refer to the rest shape; the tension of the mesh is a force per current width
(Cauchy).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..frame import Frame, curve_parts
from ..kernels import control as c
from ..measure.strain import couple_of, rotation, true_stress
from ..measure.wire_curve import planar_curve
from ..scene import Wire
from .bending import BendingMoments, bending_moments
from .friction import friction_energy
from .model import Model
from .observables import PlanarObservables, pair_levers

INTERIOR = 0.25  # of the mesh's width and height from each edge


# --- energies ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Energies:
    """Stored and kinetic energy of the mesh [J]."""

    stretch: float
    bend: float
    contact: float
    kinetic: float

    @property
    def stored(self) -> float:
        return self.stretch + self.bend + self.contact


def energies(r: PlanarObservables) -> Energies:
    """T^2 L/(2 EA) a segment, EI theta^2/(2 l) a node, (F - offset)^2/(2 k) a pair, and what its friction is drawn out by;
    kinetic from the last step.

    A softened segment stores T^2 L s/(2 EA) unless its running multiplier took the softening out.
    """
    natural = r.natural_length * r.length_factor
    stiffness = r.control[int(c.CONTACT_STIFFNESS)]
    return Energies(
        stretch=float(np.sum(0.5 * r.tension**2 * natural / _stretch_stiffness(r))),
        bend=float(np.sum(0.5 * r.moment * r.elastic_turning)) + hardened_energy(r),
        contact=float(np.sum(0.5 * (r.pair_force - r.pair_offset) ** 2 * (r.pair_force > 0)) / stiffness) + friction_energy(r),
        kinetic=0.5 * float(r.control[int(c.KINETIC_TWICE)]),
    )


def _stretch_stiffness(r: PlanarObservables) -> np.ndarray | float:
    """[N] true axial stiffness where multipliers took the softening out, else the softened one [node]."""
    solver = r.model.scene.solver
    if solver.multipliers and solver.drive == "relax":
        return r.model.axial_stiffness
    return np.repeat(r.wire_axial, r.model.panel.wire_count)


def hardened_energy(r: PlanarObservables) -> float:
    """[J] that kinematic hardening stores: H kappa_p^2/2 a length, with H = EI kept/(1 - kept)."""
    kept = r.model.scene.wire.hardening
    if not r.model.yield_moment or kept == 1.0:
        return 0.0
    hardening = r.model.bending_stiffness * kept / (1.0 - kept)
    return float(np.sum(0.5 * hardening * r.plastic_turn**2 / (r.hinge_length * r.length_factor)))


def plastic_extremes(r: PlanarObservables) -> tuple[float, float]:
    """Share of the nodes that have yielded, and the largest strain of a fibre that stays."""
    if not r.model.yield_moment:
        return 0.0, 0.0
    strain = np.abs(r.plastic_turn) / r.hinge_length * r.model.scene.wire.radius
    return float(np.mean(r.plastic_turn != 0.0)), float(strain.max())


def energy_scale(model: Model) -> float:
    """EI/W a loop [J]: what energies are compared with where little is stored."""
    loops = model.panel.node_count / model.scene.model.nodes_per_loop
    return model.bending_stiffness / model.scene.knit.wale_spacing * loops


# --- loads ------------------------------------------------------------------------------------------------------------


def nominal_stress(r: PlanarObservables) -> np.ndarray:
    """Work-conjugate of the deformation gradient (2, 2) [N/m]: force per rest width.

    P = (1/A0) [sum over segments n (x) E0 + sum over pairs and their four nodes f (x) (X_body - X_node)
    + sum over held nodes f (x) (X - c)], f the forces on the nodes: the derivative of the energy by F, in which a clamp
    moves with F c.
    """
    table, panel = r.model.table, r.model.panel
    rest_edge = np.stack([table.rest_x[r.entry], table.rest_y[r.entry]], axis=1)
    inside = np.any(r.edge != 0.0, axis=1)
    sum_ = np.einsum("ia,ib->ab", r.segment_force[inside], rest_edge[inside])
    touching = np.nonzero(r.pair_force > 0)[0]
    if len(touching):
        sum_ += np.einsum("pka,pkb->ab", r.pair_nodal[touching], pair_levers(r, touching))
    if len(panel.held_node):
        sum_ += np.einsum("ia,ib->ab", held_forces(r), panel.held_lever)
    return sum_ / panel.area


def held_forces(r: PlanarObservables) -> np.ndarray:
    """Forces (held, 2) [N] of the wires and of contacts on the held nodes."""
    panel = r.model.panel
    node = panel.held_node
    n = r.segment_force
    first = np.isin(node, panel.wire_first)
    before = np.where((first & ~_closed_at(r.model, node))[:, None], 0.0, n[node - 1])
    touching = np.nonzero((r.pair_force > 0) & ~panel.wire_closed[panel.pair_wire])[0]
    reached = r.pair_node[touching][:, None] + np.arange(-1, 3)
    place = np.searchsorted(node, reached)
    held = place < len(node)
    held[held] = node[place[held]] == reached[held]
    contact = np.zeros((len(node), 2))
    np.add.at(contact, place[held], r.pair_nodal[touching][held])
    return n[node] - before + contact


def _closed_at(model: Model, node: np.ndarray) -> np.ndarray:
    wire = np.searchsorted(model.panel.wire_first, node, side="right") - 1
    return model.panel.wire_closed[wire]


def thermal_force(r: PlanarObservables) -> float:
    """Derivative of the energy by the length factor of the wires [J]: what heating works against."""
    model = r.model
    natural = r.natural_length
    stretch = -np.sum(natural * (r.tension + 0.5 * r.tension**2 / _stretch_stiffness(r)))
    bend = -0.5 * np.sum(r.moment * r.elastic_turning) / r.length_factor
    return float(stretch + bend + np.sum(r.pair_force) * model.contact_reach)


def edge_force(r: PlanarObservables) -> np.ndarray:
    """(clamp, 2) [N] derivative of the energy by the displacement of the clamps: with what force they hold the wires."""
    total = np.zeros((len(r.model.panel.clamp_position), 2))
    np.add.at(total, r.model.panel.held_clamp, held_forces(r))
    return -total


def warmth_force(r: PlanarObservables) -> np.ndarray:
    """(wire, 2) [J] derivative of the energy by the warmth of the wires (`PlanarObservables.warmth`)."""
    panel = r.model.panel
    pull = -r.tension * r.natural_length * r.length_factor
    local = np.arange(panel.node_count) - np.repeat(panel.wire_first, panel.wire_count)
    return np.stack([np.add.reduceat(pull, panel.wire_first), np.add.reduceat(pull * local, panel.wire_first)], axis=1)


def boundary_stress(r: PlanarObservables) -> np.ndarray:
    """Nominal stress (2, 2) [N/m] in the frame in which the boundary is strained by `PlanarObservables.stretch`."""
    return rotation(r.clamp_rotation) @ nominal_stress(r)


def clamp_couple(r: PlanarObservables) -> float:
    """[N/m] moment that turns the clamps counter-clockwise, over the area at rest: derivative of the energy by their rotation.

    F = R^T U, so the derivative of F by the angle is F turned by a right angle clockwise.
    """
    return couple_of(nominal_stress(r), r.gradient)


def mesh_tension(r: PlanarObservables) -> tuple[float, float]:
    """Tension in weft and warp [N/m], force per current width: diagonal of P F^T / det F, in the frame of the boundary."""
    cauchy = true_stress(boundary_stress(r), r.stretch)
    return float(cauchy[0, 0]), float(cauchy[1, 1])


def mean_boundary_force(r: PlanarObservables) -> float:
    """Mean force of a clamp [N]; on a periodic tile the tension over one wale and one course, averaged."""
    panel = r.model.panel
    if len(panel.held_node):
        total = edge_force(r)
        return float(np.mean(np.hypot(total[:, 0], total[:, 1])))
    weft, warp = mesh_tension(r)
    knit = r.model.scene.knit
    return 0.5 * (abs(weft) * knit.course_spacing + abs(warp) * knit.wale_spacing)


def force_scale(model: Model) -> float:
    """EI/W^2 [N]: what forces are compared with where little is loaded."""
    return model.bending_stiffness / model.scene.knit.wale_spacing**2


def tension_scale(model: Model) -> float:
    """EI/C^3 [N/m]: the stiffness of a loose mesh, and the measure of a small tension."""
    return model.bending_stiffness / model.scene.knit.course_spacing**3


def residual(r: PlanarObservables) -> float:
    """Rms out-of-balance nodal force over the larger of the mean boundary force and EI/W^2."""
    free = r.model.panel.node_count + r.model.panel.body_count - len(r.model.panel.held_node)
    rms = np.sqrt(r.control[int(c.FORCE_SQUARE)] / free)
    return float(rms / max(mean_boundary_force(r), force_scale(r.model)))


# --- contacts ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Contacts:
    """Active pairs and bodies of a set of bodies."""

    bodies: int
    pairs: int
    active: int  # pairs closed with more than the threshold
    active_bodies: int  # bodies both of whose pairs are

    @property
    def active_percent(self) -> float:
        return 100.0 * self.active / self.pairs if self.pairs else 0.0


def pair_active(r: PlanarObservables) -> np.ndarray:
    """[pair] closed with more than the threshold force; a body that drifts against one wire carries none."""
    return r.pair_force > active_threshold(r.model)


def active_threshold(model: Model) -> float:
    """The scene's threshold [N], but not below 1e-4 EI/W^2, about what a steady state leaves out of balance."""
    return max(model.scene.contact.threshold, 1e-4 * force_scale(model))


def contacts(r: PlanarObservables, bodies: np.ndarray | None = None) -> Contacts:
    """Contacts of `bodies`; default all."""
    active = pair_active(r).reshape(-1, 2)
    if bodies is not None:
        active = active[bodies]
    return Contacts(len(active), active.size, int(active.sum()), int(active.all(axis=1).sum()))


def pairs_at_reach_end(r: PlanarObservables) -> int:
    """Closed pairs whose contact point stands at the end of the stretch of wire that it may slide on.

    Beyond it the wire is continued straight, which pushes a body that has slid off; such contacts are not to be believed.
    """
    panel = r.model.panel
    at_low = (r.pair_slide <= panel.pair_low) & (r.pair_u < 1e-3)
    at_high = (r.pair_slide >= panel.pair_high) & (r.pair_u > 1.0 - 1e-3)
    return int(np.count_nonzero((r.pair_force > active_threshold(r.model)) & (at_low | at_high)))


def penetration(r: PlanarObservables) -> float:
    """Largest penetration over the wire diameter; negative gaps of closed pairs."""
    closed = r.pair_force > 0
    if not closed.any():
        return 0.0
    return float(max(0.0, np.max(-r.pair_gap[closed])) / r.model.scene.wire.diameter)


# --- wires ------------------------------------------------------------------------------------------------------------


def section(wire: Wire) -> tuple[float, float]:
    """Outer radius [m] and stress per tension [1/m2] of the wire itself: E/EA, plating and parallel ends included."""
    return wire.diameter / 2, wire.youngs_modulus / wire.axial_stiffness


def wire_stress(r: PlanarObservables) -> np.ndarray:
    """[node] [Pa] E (d/2) |M|/EI + |N| E/EA, with the larger tension of the two segments at the node."""
    return _node_stress(r, bending_moments(r))


def _node_stress(r: PlanarObservables, moments: BendingMoments) -> np.ndarray:
    before = np.roll(r.tension, 1)
    panel = r.model.panel
    last = panel.wire_first + panel.wire_count - 1
    before[panel.wire_first] = np.where(panel.wire_closed, r.tension[last], r.tension[panel.wire_first])
    axial = np.where(np.abs(r.tension) > np.abs(before), r.tension, before)
    return _stress(r, moments.node, axial)


def contact_stress(r: PlanarObservables) -> np.ndarray:
    """[touching pair] [Pa] stress of the wire under a body, where bending peaks between two nodes."""
    return _contact_stress(r, bending_moments(r))


def _contact_stress(r: PlanarObservables, moments: BendingMoments) -> np.ndarray:
    return _stress(r, moments.contact, r.tension[r.pair_node[r.pair_force > 0]])


def _stress(r: PlanarObservables, moment: np.ndarray, tension: np.ndarray) -> np.ndarray:
    """[Pa] in the outermost fibre."""
    wire = r.model.scene.wire
    radius, per_tension = section(wire)
    return wire.youngs_modulus * radius / r.model.bending_stiffness * np.abs(moment) + np.abs(tension) * per_tension


def stress_extremes(r: PlanarObservables) -> tuple[float, float, float]:
    """Largest stress and 99th percentile [Pa], and the share of the wire above the yield stress."""
    moments = bending_moments(r)
    stress, peak = _node_stress(r, moments), _contact_stress(r, moments)
    largest = max(float(stress.max()), float(peak.max(initial=0.0)))
    above = float(np.mean(stress > r.model.scene.wire.yield_stress))
    return largest, float(np.percentile(stress, 99)), above


def interior_stress(r: PlanarObservables) -> float:
    """Largest stress [Pa] farther than INTERIOR of the mesh's size from its edge, where gripping does not show."""
    stress = wire_stress(r)
    if r.model.panel.boundary == "periodic":
        return float(stress.max())
    node, _ = positions(r)
    low, high = node[:, :2].min(axis=0), node[:, :2].max(axis=0)
    share = (node[:, :2] - low) / (high - low)
    inside = np.all((share > INTERIOR) & (share < 1.0 - INTERIOR), axis=1)
    return float(stress[inside].max(initial=0.0))


def axial_strain(r: PlanarObservables) -> np.ndarray:
    """[node] mechanical axial strain of the segments, T/EA."""
    return r.tension / r.model.axial_stiffness


def areal_mass(r: PlanarObservables) -> float:
    """Mass of wire per current area [kg/m2]."""
    model = r.model
    length = float(np.sum(model.panel.wire_length))
    return length * model.scene.wire.linear_density / (model.panel.area * float(np.linalg.det(r.gradient)))


# --- what is recorded -------------------------------------------------------------------------------------------------


def positions(r: PlanarObservables) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (node, 3) and bodies (body, 3) [m] relative to the corner of the mesh; z is the rest height."""
    panel, table = r.model.panel, r.model.table
    origin = np.repeat(panel.block_origin, panel.block_count, axis=0)
    rest = np.stack([table.x[r.entry], table.y[r.entry]], axis=1) + origin
    corner = rest.min(axis=0) if panel.boundary == "periodic" else panel.clamp_position.min(axis=0)
    turned = rotation(r.clamp_rotation)
    node = np.einsum("ia,ba->ib", rest - corner, r.stretch) + r.u @ turned.T
    body = np.einsum("ia,ba->ib", panel.body_rest + panel.body_origin - corner, r.stretch) + r.body_u @ turned.T
    height = table.z[r.entry]
    seed_height = height[r.model.panel.pair_seed].reshape(-1, 2).mean(axis=1)
    return np.column_stack([node, height]), np.column_stack([body, seed_height])


def frame(r: PlanarObservables, *, index: int, stage: str, load_factor: float, temperature: float) -> Frame:
    """The recorded state for the exports."""
    node, body = positions(r)
    f = r.stretch
    parts = curve_parts(len(node), r.model.scene.model.nodes_per_loop)
    between = np.zeros((0, 0, 3), dtype=np.float32)
    if parts > 1:
        between = planar_curve(r.model.layout(), node, f, r.model.table.curve[r.entry]).between(parts)
    return Frame(
        index=index,
        stage=stage,
        load_factor=load_factor,
        strain_weft=float(f[0, 0] - 1.0),
        strain_warp=float(f[1, 1] - 1.0),
        shear=float(f[0, 1]),
        temperature=temperature,
        node_position=node,
        node_stress=wire_stress(r),
        body_position=body,
        pair_force=r.pair_force,
        pair_active=pair_active(r),
        between=between,
    )
