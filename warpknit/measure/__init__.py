"""Measures: pure functions of the observables of a state, the same for both models; NumPy in float64.

Strain measures refer to the rest shape; the tension of the mesh is a force per current width (Cauchy).

    record = list(Simulation(build_model(scene)).run())[-1]
    state = record.observables
    measure.mesh_tension(state)                              # weft, warp [N/m], force per current width
    measure.contacts(state).active_percent                   # [%] of the pairs
    measure.stress_extremes(state)                           # largest and 99 % stress [Pa], share of wire above the yield stress
    state.energies.stored                                    # [J]

`record.observables` belong to a recorded state; `planar.observables.read(model, state)` evaluates any state.
`measure.table.values(state, names)` has measures by the names of the columns of history.csv.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..knit.cloth import CLASS_NAMES, Cloth
from ..results.frame import Frame
from ..scene import Wire
from .observables import MeshModel, Observables
from .observables import WireStress as WireStress
from .strain import clamp_rotation as clamp_rotation
from .strain import rotation, true_stress
from .strain import stretch as stretch


def wires_slid(displacement: np.ndarray, wire_start: np.ndarray) -> float:
    """[m] largest difference between the mean displacements of two wires along one axis.

    displacement: (node, 2 or 3) [m] from the place to which the load carries a node by itself; wire_start: [wire] first nodes.
    """
    total = np.add.reduceat(displacement, wire_start, axis=0)
    count = np.diff(np.append(wire_start, len(displacement)))
    return float(np.ptp(total / count[:, None], axis=0).max())


EXCEEDED = 0.01  # of the wire, for the stress reported beside the largest
INTERIOR = 0.25  # of the mesh's width and height from each edge
LEAST_FORCE = 1e-4  # of EI/W^2, about the residual force of an equilibrium: smaller contact forces do not count


# --- scales -----------------------------------------------------------------------------------------------------------


def energy_scale(model: MeshModel) -> float:
    """EI/W a loop [J]: the scale of energies."""
    loops = model.panel.node_count / model.scene.model.nodes_per_loop
    return model.bending_stiffness / model.scene.knit.wale_spacing * loops


def force_scale(model: MeshModel) -> float:
    """EI/W^2 [N]: the scale of forces."""
    return model.bending_stiffness / model.scene.knit.wale_spacing**2


def tension_scale(model: MeshModel) -> float:
    """EI/C^3 [N/m]: the scale of tensions, the stiffness of a loose mesh."""
    return model.bending_stiffness / model.scene.knit.course_spacing**3


# --- loads ------------------------------------------------------------------------------------------------------------


def boundary_stress(r: Observables) -> np.ndarray:
    """Nominal stress (2, 2) [N/m] in the frame of the stretched boundary."""
    return rotation(r.clamp_rotation) @ r.nominal_stress


def mesh_tension(r: Observables) -> tuple[float, float]:
    """Tension in weft and warp [N/m], force per current width: diagonal of P F^T / det F, in the frame of the boundary.

    The force is that between the outermost clamps.
    """
    cauchy = true_stress(boundary_stress(r) / r.model.panel.clamp_share, r.stretch)
    return float(cauchy[0, 0]), float(cauchy[1, 1])


def fragment_tension(r: Observables) -> tuple[float | None, float | None]:
    """Part of `mesh_tension` [N/m] of cut wire ends at the grips: wires of less than a loop between two grips.

    Of a wire with the clamps X1 and X2 and their forces f1 and f2 on it, P = (f2 - f1)/2 (x) (X2 - X1)/A0. None without such
    wires.
    """
    panel, is_short = r.model.panel, short_wires(r.model)
    if not is_short.any():
        return None, None
    force, clamp = (array[:, :2].reshape(-1, 2, 2)[is_short] for array in (r.edge_force, panel.clamp_position))
    pull = 0.5 * np.einsum("ia,ib->ab", force[:, 1] - force[:, 0], clamp[:, 1] - clamp[:, 0]) / panel.area
    cauchy = true_stress(rotation(r.clamp_rotation) @ pull, r.stretch)
    return float(cauchy[0, 0]), float(cauchy[1, 1])


def short_wires(model: MeshModel) -> np.ndarray:
    """[wire] whether it is shorter than a loop, and gripped at both ends."""
    panel, cloth = model.panel, model.cloth
    return panel.wire_length < (0.0 if cloth is None or panel.boundary == "periodic" else cloth.stitch_length)


def clamp_couple(r: Observables) -> float:
    """[N/m] counter-clockwise couple on the clamps per rest area: derivative of the energy by their rotation.

    F = R^T U, so the derivative of F by the angle is F turned by a right angle clockwise.
    """
    clockwise = np.array([[0.0, 1.0], [-1.0, 0.0]])
    return float(np.sum(r.nominal_stress * (clockwise @ r.gradient)))


def mean_boundary_force(r: Observables) -> float:
    """Mean force of a clamp [N]; on a periodic tile the tension over one wale and one course, averaged."""
    if len(r.clamp_force):
        return float(np.mean(r.clamp_force))
    weft, warp = mesh_tension(r)
    knit = r.model.scene.knit
    return 0.5 * (abs(weft) * knit.course_spacing + abs(warp) * knit.wale_spacing)


def residual(r: Observables) -> float:
    """Rms out-of-balance nodal force over boundary force or EI/W^2. The larger of both, the boundary force as a mean."""
    return float(r.unbalanced_force / max(mean_boundary_force(r), force_scale(r.model)))


# --- contacts ---------------------------------------------------------------------------------------------------------
# Contacts of a class are places of one shape (knit/cloth.py), which close together in a mesh of equal loops. Where an equilibrium
# breaks the symmetry of the mesh, a part of a class is closed.


@dataclass(frozen=True)
class Contacts:
    """Active pairs and bodies of a set of bodies."""

    bodies: int
    pairs: int
    active: int  # pairs closed with more than the threshold
    active_bodies: int  # bodies both of whose pairs are

    @property
    def active_percent(self) -> float:
        """Of the pairs; 0 where there are none."""
        return 100.0 * self.active / self.pairs if self.pairs else 0.0

    @property
    def active_bodies_percent(self) -> float:
        """Of the bodies; 0 where there are none."""
        return 100.0 * self.active_bodies / max(1, self.bodies)


def least_force(model: MeshModel) -> float:
    """[N] 1e-4 EI/W^2, about the residual force of an equilibrium: smaller contact forces do not count."""
    return LEAST_FORCE * force_scale(model)


def active_threshold(model: MeshModel) -> float:
    """The threshold of the scene [N], at least `least_force`."""
    return max(model.scene.contact.threshold, least_force(model))


def pair_active(r: Observables) -> np.ndarray:
    """[pair] whether the force exceeds the threshold."""
    return r.pair_force > active_threshold(r.model)


def contacts(r: Observables, bodies: np.ndarray | None = None) -> Contacts:
    """Contacts of `bodies`; default all."""
    active = pair_active(r).reshape(-1, 2)
    if bodies is not None:
        active = active[bodies]
    return Contacts(len(active), active.size, int(active.sum()), int(active.all(axis=1).sum()))


def class_of_pair(model: MeshModel) -> np.ndarray:
    """[pair] number of its class; one class for all where nothing is knitted."""
    if model.cloth is None:
        return np.zeros(model.pair_count, dtype=np.int64)
    return np.repeat(model.cloth.classes[model.panel.body_clasp], 2)


def classes_of(model: MeshModel) -> dict[str, int]:
    """Pairs in each class of contact, by its name A, B; none of two hooked wires."""
    counts = np.bincount(class_of_pair(model)).tolist() if model.scene.hook is None else []
    return {CLASS_NAMES[number]: count for number, count in enumerate(counts) if count}


def class_active_percent(r: Observables, name: str) -> float | None:
    """Share of the active pairs of a class; None where the mesh has none of it."""
    pairs = _pairs_of_class(r, name)
    return None if pairs is None else 100.0 * float(np.mean(pair_active(r)[pairs]))


def class_median_force(r: Observables, name: str) -> float | None:
    """Contact force [N] that half of a class's pairs reach, the upper median; None without pairs."""
    pairs = _pairs_of_class(r, name)
    return None if pairs is None else float(np.sort(r.pair_force[pairs])[len(pairs) // 2])


def _pairs_of_class(r: Observables, name: str) -> np.ndarray | None:
    if r.model.scene.hook is not None:
        return None
    number, model = CLASS_NAMES.index(name), r.model
    if number > (0 if model.cloth is None else model.cloth.classes.max(initial=0)):
        return None
    pairs = np.flatnonzero(class_of_pair(model) == number)
    return pairs if len(pairs) else None


def largest_contact_force(r: Observables) -> float:
    """[N] of a pair, active or not."""
    return float(r.pair_force.max(initial=0.0))


def active_forces(r: Observables) -> np.ndarray:
    """[active pair] [N]"""
    return r.pair_force[pair_active(r)]


# --- wires ------------------------------------------------------------------------------------------------------------


def section(wire: Wire) -> tuple[float, float]:
    """Outer radius [m] and stress per tension E/EA [1/m2], plating and parallel ends included."""
    return wire.diameter / 2, wire.youngs_modulus / wire.axial_stiffness


def stress_extremes(r: Observables) -> tuple[float, float, float]:
    """Largest stress [Pa], stress exceeded by 1 % of the wire [Pa], share above the yield stress."""
    return largest_stress(r), exceeded_stress(r), yield_share(r)


def largest_stress(r: Observables) -> float:
    """Largest stress [Pa] of the wires."""
    return max(float(r.wire_stress.node.max()), float(r.wire_stress.contact.max(initial=0.0)))


def exceeded_stress(r: Observables) -> float:
    """Stress [Pa] exceeded by a share EXCEEDED of the wire. Shares are by length, because spatial nodes are close together at
    bends.
    """
    stress, length = r.wire_stress.node, r.node_length
    order = np.argsort(-stress)
    last = int(np.searchsorted(np.cumsum(length[order]), EXCEEDED * float(np.sum(length))))
    return float(stress[order[min(last, len(order) - 1)]])


def yield_share(r: Observables) -> float:
    """Share of the wire above the yield stress; a node is where a place behind it is."""
    highest = r.wire_stress.node.copy()
    np.maximum.at(highest, r.wire_stress.contact_node, r.wire_stress.contact)
    return _wire_share(r, highest > r.model.scene.wire.yield_stress)


def _wire_share(r: Observables, nodes: np.ndarray) -> float:
    return float(np.sum(r.node_length[nodes]) / np.sum(r.node_length))


def interior_stress(r: Observables) -> float:
    """Largest stress [Pa] away from the grips: beyond INTERIOR of the mesh size from its edge."""
    stress, peak = r.wire_stress.node, r.wire_stress.contact
    if r.model.panel.boundary == "periodic":
        return largest_stress(r)
    inside = np.ones(len(stress), dtype=bool)
    for place in r.node_position[:, :2].T:
        low, high = place.min(), place.max()
        edge = INTERIOR * (high - low)
        inside &= (place > low + edge) & (place < high - edge)
    peaks = peak[inside[r.wire_stress.contact_node]]
    return max(float(stress[inside].max(initial=0.0)), float(peaks.max(initial=0.0)))


def plastic_extremes(r: Observables) -> tuple[float | None, float | None]:
    """Share of the wire that has yielded, and its largest plastic strain; None for elastic wires."""
    if not r.model.scene.wire.plastic:
        return None, None
    return _wire_share(r, r.plastic_strain > 0.0), float(r.plastic_strain.max())


def slid(r: Observables) -> float:
    """[m] by which whole wires have slid along each other; 0 where clamps hold them."""
    periodic = r.model.panel.boundary == "periodic"
    return wires_slid(r.displacement, r.model.layout().wire_start[:-1]) if periodic else 0.0


def areal_mass(r: Observables) -> float:
    """Mass of wire per current area [kg/m2]."""
    return r.wire_mass / (r.model.panel.area * float(np.linalg.det(r.gradient)))


# --- place of the largest stress --------------------------------------------------------------------------------------
# Heights in a loop are in course spacings above the foot line of the course. The head lies above HEAD. From the head outwards,
# the foot begins where the leg comes below FOOT, and the underlap where the wire leaves the foot line: downwards before the loop,
# upwards behind it.

HEAD, FOOT = 1.0, 0.2  # [C]


def part_of_loop(cloth: Cloth, thread: int, arc: float) -> str:
    """Part of a loop at a plan arc length [m] of a thread, in words: "head of a closed loop"."""
    line = cloth.threads[thread]
    count = len(line.points)
    here = int(np.floor(arc / line.spacing)) % count
    stitch = cloth.stitches[line.stitch[here]]
    if stitch.kind == "inlay":
        return "inlay"
    own = line.stitch == line.stitch[here]
    starts = np.flatnonzero(own & ~np.roll(own, 1))
    start = int(starts[0]) if len(starts) else 0
    if start + np.count_nonzero(own) > count:
        start -= count  # a loop begins before its thread does, with half an underlap
    samples = start + np.arange(np.count_nonzero(own), dtype=np.float64)
    height = line.at(samples * line.spacing, cloth.size[1])[:, 1] * cloth.courses / cloth.size[1] - stitch.course
    place, head = (here - start) % count, int(np.argmax(height))
    from_head = height[place : head + 1][::-1] if place < head else height[head : place + 1]
    return f"{_part(from_head, before=place < head)} of {'an' if stitch.kind == 'open' else 'a'} {stitch.kind} loop"


def _part(height: np.ndarray, *, before: bool) -> str:
    """Part between head and entry, or (not `before`) exit of the loop. height: (sample,) [C] along the path."""
    low = np.flatnonzero(height < FOOT)
    if not len(low):
        return "head" if height[-1] > HEAD else "leg"
    beyond = height[low[0] :]
    return "underlap" if np.any(beyond < -FOOT if before else beyond > FOOT) else "foot"


def peak_node(r: Observables) -> int:
    """Node with the largest stress, or the node before its place."""
    stress = r.wire_stress
    node, place = int(np.argmax(stress.node)), int(np.argmax(stress.contact)) if len(stress.contact) else -1
    return int(stress.contact_node[place]) if place >= 0 and stress.contact[place] > stress.node[node] else node


def peak_wire(r: Observables) -> int:
    """The wire of `peak_node`."""
    return int(np.searchsorted(r.model.layout().wire_start, peak_node(r), side="right") - 1)


def peak_position(r: Observables) -> np.ndarray:
    """(2,) [m] weft and warp position of `peak_node` from the corner of the mesh; of a periodic one within its tile."""
    place = np.asarray(r.node_position[peak_node(r), :2] - r.corner[:2])
    if r.model.panel.boundary != "periodic":
        return place
    tile = r.stretch @ np.diag(r.model.panel.size)
    return np.asarray(tile @ (np.linalg.solve(tile, place) % 1.0))


def peak_part(r: Observables) -> str | None:
    """Part of the loop at `peak_node`, in words; None where nothing is knitted."""
    model, node = r.model, peak_node(r)
    if model.cloth is None:
        return None
    wire = peak_wire(r)
    first, end = model.layout().wire_start[wire : wire + 2]
    panel = model.panel
    begin = panel.wire_begin[wire] if len(panel.wire_begin) else 0.0
    share = (node - first) / max(1, end - first - (not panel.wire_closed[wire]))
    return part_of_loop(model.cloth, int(panel.wire_thread[wire]), float(begin + share * panel.wire_length[wire]))


# --- what is recorded -------------------------------------------------------------------------------------------------


def positions(r: Observables) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (node, 3) and bodies (body, 3) [m] relative to the mesh corner; planar z is the rest height."""
    return r.node_position - r.corner, r.body_position - r.corner


def frame(r: Observables, *, index: int, stage: str, load_factor: float, temperature: float) -> Frame:
    """The recorded state for the exports."""
    node, body = positions(r)
    f, places = r.stretch, {}
    if r.model.scene.model.boundary == "periodic" and r.model.cloth is not None:
        found = r.contact_places
        share = found.arc / found.wire_length[found.wire]
        places = {"contact_force": found.force, "contact_wires": found.wire, "contact_share": share}
    return Frame(
        index=index,
        stage=stage,
        load_factor=load_factor,
        strain_weft=float(f[0, 0] - 1.0),
        strain_warp=float(f[1, 1] - 1.0),
        shear=float(f[0, 1]),
        temperature=temperature,
        node_position=node,
        node_stress=r.wire_stress.node,
        body_position=body,
        pair_force=r.pair_force,
        pair_active=pair_active(r),
        between=r.between,
        elsewhere_position=r.elsewhere_position - r.corner,
        elsewhere_force=r.elsewhere_force,
        elsewhere_wires=r.elsewhere_wires,
        **places,
    )
