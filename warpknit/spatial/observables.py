"""Observables of the spatial model (measure/observables.py): energies, loads, contacts, stress and places.

A site (sites.py) corresponds to a body of the planar model and has two pairs with equal forces (action and reaction), so that
counts and percentages are comparable between the models.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import warp as wp

from ..base.text import short_repr
from ..compute.host import fetch
from ..compute.steering import Steering
from ..measure import active_threshold, strain
from ..measure.observables import ContactPlaces, Energies, HookContact, PanelMap, SheetPlaces, WireStress, arcs_along
from ..measure.strain import Boundary
from ..measure.tiles import Tiles, has_map, panel_map_of
from ..mesh.hook_mesh import LEFT, RIGHT, RIGHT_TOP
from .bending import bending_moments, clamped_ends
from .contact_arrays import Contacts
from .model import SpatialModel
from .placed_wires import BETWEEN
from .rest_curve import SpatialCurve, rest_place, section_offsets, spatial_curve
from .rod_arrays import RodState
from .rod_relaxation import RodRelaxation
from .rods import Rods
from .sites import NOWHERE, Sites, site_places, touched_places
from .strip import RodStrip
from .wire_contact import WireContact

NEAR = 1.25  # thicknesses: distance of centre lines below which the paper counts a contact as active


@dataclass(frozen=True)
class SpatialObservables(Boundary):
    """Observables of the state last evaluated; arrays [node], segment data included."""

    __repr__ = short_repr

    model: SpatialModel
    sites: Sites
    control: Steering
    position: np.ndarray  # (node, 3) [m]
    director: np.ndarray  # (node, 3) across the segment
    tension: np.ndarray  # [N] of the segments; 0 of rigid ones between held nodes
    rigid_pull: float  # [J] of rigid segments: tension times in-plane rest length
    segment_tangent: np.ndarray  # (node, 3)
    chord: np.ndarray  # [m] length of the segments; what heat lengthens is their arcs
    half_in_clamp: np.ndarray  # [m] length of the wire inside clamps that stretches with the segments
    moment: np.ndarray  # (node, 3) [N m] against turns along the section directors, and twist
    plastic_curvature: np.ndarray  # (node, 2) [1/m] plastic
    twist_change: np.ndarray  # [1/m]
    segment_force: np.ndarray  # (node, 3) [N]
    force: np.ndarray  # (node, 3) [N] unbalanced
    stretch_energy: float  # [J] with the true stiffness, or the softened one in a ramp
    bend_energy: float  # [J] bending and twist, elastic
    hardened_energy: float  # [J] stored by hardening
    contact_energy: float  # [J] of the penalty
    thermal_strain: np.ndarray  # [node] relative excess of the length factor of segments over the middle's
    touching: Contacts  # contacts with a force
    near: Contacts  # contacts closer than NEAR

    # --- energies

    @cached_property
    def energies(self) -> Energies:
        """Energies [J]; kinetic of the last step, contact of the penalty."""
        return Energies(self.stretch_energy, self.bend_energy + self.hardened_energy, self.contact_energy, self.kinetic_energy)

    # --- loads

    @cached_property
    def nominal_stress(self) -> np.ndarray:
        """(2, 2) [N/m] work-conjugate of the deformation gradient, force per rest width.

        P = (1/A0) [sum over segments n (x) E0 - sum over contacts f (x) (P0 - Q0) + sum over held nodes f (x) (X - c)] with the
        clamp c; f of a contact is the force on the first wire, P0 and Q0 are the rest places of the contact on both wires.
        """
        terms = (np.einsum("ia,ib->ab", force[:, :2], lever[:, :2]) for _, force, lever in virial(self))
        return np.asarray(sum(terms) / self.model.panel.area)

    @property
    def contact_growth(self) -> float:
        """[J] derivative of the energy of contact by the length factor: wires and their curves grow.

        Sum over contacts of N (r_p + r_q - n . (a_p - a_q)), with the offsets a of `section_offsets`.
        """
        t, rods, curve = self.touching, self.model.rods, self.model.curve
        own, other = (
            section_offsets(rods, curve, self.segment_tangent, self.director, node, t.place[:, k]).sum(axis=1)
            for k, node in enumerate((t.first, t.second))
        )
        return float(np.sum(t.force * (rods.touch_distance(t.first, t.second) - np.sum(t.normal * (own - other), axis=1))))

    @property
    def thermal_force(self) -> float:
        """[J] derivative of the energy with respect to the length factor."""
        pulled = float(np.sum(self.tension * self.chord))
        held = self.model.wires.held_node
        clamped = float(np.sum(self.force[held, :2] * self.model.wires.held_lever)) + self.rigid_pull
        return (self.stretch_energy - pulled - self.bend_energy) / self.length_factor + self.contact_growth - clamped

    @property
    def thermal_strain_force(self) -> np.ndarray:
        """[node] [J] derivative of the energy with respect to `thermal_strain`."""
        return -self.tension * (self.chord + self.half_in_clamp)

    @property
    def edge_force(self) -> np.ndarray:
        """(clamp, 3) [N] forces of the clamps on the wires, by two nodes each."""
        return -self.force[self.model.wires.held_node].reshape(-1, 2, 3).sum(axis=1)

    @property
    def clamp_force(self) -> np.ndarray:
        """[clamp] [N] magnitude of the clamp forces."""
        return np.linalg.norm(self.edge_force, axis=1)

    @property
    def unbalanced_force(self) -> float:
        """[N] rms over free nodes."""
        free = np.delete(self.force, self.model.wires.held_node, axis=0)
        return float(np.sqrt(np.mean(np.sum(free**2, axis=1))))

    # --- contacts

    @cached_property
    def touching_site(self) -> tuple[np.ndarray, np.ndarray]:
        """Site and sign [contact] of the touching contacts (`Sites.of`)."""
        return self.sites.of(self.touching.first, self.touching.second, self.touching.shift, self.touching.place)

    @cached_property
    def site_force(self) -> np.ndarray:
        """[site] [N] contact force: magnitude of the sum over the contacts of the site."""
        total = np.zeros((self.sites.count, 3))
        t = self.touching
        site, sign = self.touching_site
        here = site != NOWHERE
        np.add.at(total, site[here], (sign[:, None] * t.push)[here])
        return np.linalg.norm(total, axis=1)

    @cached_property
    def pair_force(self) -> np.ndarray:
        """[pair] [N] contact forces, two equal ones for each site."""
        return np.repeat(self.site_force, 2)

    @cached_property
    def body_near(self) -> np.ndarray:
        """[site] whether its wires are closer than NEAR, the measure of the paper."""
        found = np.zeros(self.sites.count, dtype=bool)
        site, _ = self.sites.of(self.near.first, self.near.second, self.near.shift, self.near.place)
        found[site[site != NOWHERE]] = True
        return found

    @cached_property
    def _elsewhere(self) -> np.ndarray:
        """Active contacts without a site among `touching`, in the order of their segments."""
        t = self.touching
        found = np.flatnonzero((self.touching_site[0] == NOWHERE) & (t.force > active_threshold(self.model)))
        return found[np.lexsort((t.place[found, 0], t.second[found], t.first[found]))]

    @property
    def elsewhere_force(self) -> np.ndarray:
        """[contact] [N] forces of active contacts without a site."""
        return self.touching.force[self._elsewhere]

    contact_elsewhere = elsewhere_force

    @property
    def elsewhere_position(self) -> np.ndarray:
        """Places (contact, 3) [m] of active contacts without a site, in the first wire's tile."""
        return touched_places(self, self._elsewhere) @ self._turn.T

    @property
    def elsewhere_wires(self) -> np.ndarray:
        """(contact, 2) wires of active contacts without a site."""
        nodes = np.stack([self.touching.first, self.touching.second], axis=1)
        return np.asarray(self.model.rods.wire_of[nodes[self._elsewhere]])

    @property
    def pairs_at_reach_end(self) -> int:
        """0: contacts slide without limit."""
        return 0

    @property
    def penetration(self) -> float:
        """Largest penetration over the thickness."""
        t = self.touching
        return float(np.max(t.overlap / self.model.rods.touch_distance(t.first, t.second), initial=0.0))

    @property
    def contact_places(self) -> ContactPlaces:
        """Places of the contacts whose force exceeds the threshold."""
        rods, contacts = self.model.rods, self.touching
        kept = contacts.force > active_threshold(self.model)
        node = np.stack([contacts.first, contacts.second], axis=1)[kept]
        place, shift = contacts.place[kept], contacts.shift[kept]
        rest = np.stack([rest_place(rods, self.model.curve, node[:, side], place[:, side]) for side in (0, 1)], axis=1)
        lengths = rods.natural_arc * self.length_factor
        wire = rods.wire_of[node]
        return ContactPlaces(
            force=contacts.force[kept],
            wire=wire,
            arc=arcs_along(lengths, rods.wire_first, wire, node, place),
            rest=rest[..., :2],
            reach=(rest[:, 1] + shift - rest[:, 0])[:, :2],
            wire_length=np.add.reduceat(lengths, rods.wire_first),
            wire_period=rods.wire_period[:, :2],
        )

    @cached_property
    def hook_contact(self) -> HookContact | None:
        """The contact of a hook; without contact, its places are at the middle of the lens at rest.

        Hooked wires touch in two or three places, whose forces have opposite out-of-plane components. The contact force is their
        sum; its place along a wire is their mean, weighted by the in-plane component along that sum.
        """
        model, t = self.model, self.touching
        hook, rods = model.scene.hook, model.rods
        if hook is None:
            return None
        step = hook.length / model.scene.model.nodes_per_loop
        push = t.push  # on the left wire, whose nodes come first
        total = push.sum(axis=0)
        force = float(np.linalg.norm(total))
        arc = {wire: float(model.wires.site_seed[0, wire] + BETWEEN) * step for wire in (LEFT, RIGHT)}
        body = np.array([0.0, 0.5 * hook.height])
        if force > 0.0:
            share = (push[:, :2] @ total[:2]).clip(0.0)
            share = share / share.sum()
            for wire, nodes, place in ((LEFT, t.first, t.place[:, 0]), (RIGHT, t.second, t.place[:, 1])):
                arc[wire] = float(share @ (nodes - rods.wire_first[wire] + place - BETWEEN)) * step
            touched = self.position[t.first] + self.curve.offset(t.first, t.place[:, 0])
            body = share @ (touched - 0.5 * rods.section.thickness * t.normal)[:, :2]
        held = model.wires.held_node.reshape(-1, 2)[RIGHT_TOP]
        return HookContact(
            displacement=float(self.gradient[0, 1]) * hook.height,
            drive_force=-float(self.force[held, 0].sum()),
            force_left=force,
            force_right=force,
            arc_left=arc[LEFT],
            arc_right=arc[RIGHT],
            ground_force=0.0,
            body=body,
            threshold=active_threshold(self.model),
        )

    # --- wires

    @cached_property
    def wire_stress(self) -> WireStress:
        """[Pa] E (d/2) M/EI + N E/EA with the moments of bending.py; at nodes the larger tension of the two segments.

        The rigid segment of a clamp has the tension of the one beside it.
        """
        modulus, rods = self.model.scene.wire.youngs_modulus, self.model.rods
        own = np.abs(self.tension) * modulus / rods.of_nodes("axial_stiffness")
        first, last = clamped_ends(rods)
        own[first], own[last] = own[rods.following[first]], own[rods.previous[last]]
        before = np.where(rods.previous >= 0, own[rods.previous], 0.0)
        at_node, between, contact, node = bending_moments(self)
        per_moment = modulus * rods.of_nodes("radius") / rods.of_nodes("bending_stiffness")
        segment = np.flatnonzero(rods.slope_length > 0.0)
        peaks = (own[:, None] + per_moment[:, None] * between)[segment].ravel()
        return WireStress(
            np.maximum(own, before) + per_moment * at_node,
            np.concatenate([peaks, own[node] + per_moment[node] * contact]),
            np.concatenate([np.repeat(segment, between.shape[1]), node]),
        )

    @property
    def shear_stress(self) -> np.ndarray:
        """[node] [Pa] G (d/2) |twist - twist0|."""
        wire = self.model.scene.wire
        radius = self.model.rods.of_nodes("radius")
        return wire.youngs_modulus / (2 * (1 + wire.poissons_ratio)) * radius * np.abs(self.twist_change)

    @property
    def axial_strain(self) -> np.ndarray:
        """[node] mechanical axial strain of the segments, T/EA."""
        return self.tension / self.model.rods.of_nodes("axial_stiffness")

    @property
    def plastic_strain(self) -> np.ndarray:
        """[node] plastic strain of the outermost fibre."""
        return self.model.rods.of_nodes("radius") * np.linalg.norm(self.plastic_curvature, axis=1)

    @property
    def node_length(self) -> np.ndarray:
        """[node] [m] wire that a node stands for."""
        return self.model.rods.node_length

    @property
    def wire_length(self) -> float:
        """[m] total length of the wires as knitted."""
        return float(self.model.rods.wire_length.sum())

    @property
    def wire_mass(self) -> float:
        """[kg] mass of the wires."""
        rods = self.model.rods
        return float(np.sum(rods.wire_length * rods.of_wires("linear_density")))

    # --- places

    @cached_property
    def node_position(self) -> np.ndarray:
        """(node, 3) [m] positions without the rigid rotation of the boundary."""
        turned = self.position.copy()
        turned[:, :2] = turned[:, :2] @ strain.rotation(self.clamp_rotation).T
        return turned

    @cached_property
    def body_position(self) -> np.ndarray:
        """Contact points (site, 3) [m] of sites, or midpoints between their wires."""
        place = site_places(self) @ self._turn.T
        if self.hook_contact is not None:
            place[0, :2] = self.hook_contact.body + self.corner[:2]
        return place

    @property
    def _turn(self) -> np.ndarray:
        """(3, 3) rotation that removes the rigid rotation of the boundary."""
        back = np.eye(3)
        back[:2, :2] = strain.rotation(self.clamp_rotation)
        return back

    @property
    def corner(self) -> np.ndarray:
        """(3,) [m] lower corner of the mesh."""
        panel = self.model.panel
        low = self.model.rods.position[:, :2].min(axis=0) if panel.boundary == "periodic" else panel.low
        return np.append(self.stretch @ low, 0.0)

    @cached_property
    def curve(self) -> SpatialCurve:
        """The curve on which the wires touch."""
        return spatial_curve(
            self.model.layout(), self.position, self.gradient, self.director, self.model.curve, self.length_factor
        )

    @property
    def between(self) -> np.ndarray:
        """(node, parts - 1, 3) [m] points on the curve to the next node, relative to the node."""
        return self.curve.between(self.model.layout().curve_parts) @ self._turn.T.astype(np.float32)

    @property
    def displacement(self) -> np.ndarray:
        """In-plane displacement (node, 2) [m] from the affine prediction."""
        return self.node_position[:, :2] - self.model.rods.position[:, :2] @ self.stretch.T

    @property
    def thickness(self) -> float | None:
        """[m] thickness of the mesh, from the lowest to the highest fibre; None of a curved one."""
        if self.model.scene.panel.focal_length is not None:
            return None
        height, radius = self.position[:, 2], self.model.rods.wire_radius[self.model.rods.wire_of]
        return float((height + radius).max() - (height - radius).min())

    @property
    def panel_map(self) -> PanelMap | None:
        """Strain, tension, contacts and stress of each repeat."""
        return find_panel_map(self) if has_map(self.model) else None


def virial(r: Any) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Places at rest, forces and levers (n, 3) of segments, contacts and held nodes, see `SpatialObservables.nominal_stress`."""
    rods, wires, t = r.model.rods, r.model.wires, r.touching
    place, other = (rest_place(rods, r.model.curve, node, t.place[:, k]) for k, node in enumerate((t.first, t.second)))
    held = wires.held_node
    return [
        (rods.position, r.segment_force, rods.rest_edge),
        (place, -t.push, place - other - t.shift),
        (rods.position[held], r.force[held], wires.held_lever),
    ]


def find_panel_map(r: Any) -> PanelMap:
    """The map of a gripped panel (measure/tiles.py), from its virial tile by tile."""
    tiles = Tiles.of(r.model)
    stress, stress_max = tiles.zeros(2, 2), tiles.zeros()
    np.maximum.at(stress_max, tiles.at(r.model.rods.position[:, :2]), r.wire_stress.node)
    for place, force, lever in virial(r):
        tiles.add(stress, tiles.at(place[:, :2]), np.einsum("na,nb->nab", force[:, :2], lever[:, :2]))
    return panel_map_of(r, tiles, stress, stress_max, _moved(r), _sheet_places(r))


def _sheet_places(r: Any) -> SheetPlaces:
    """Mean places of the wires in cells of a stitch."""
    rods, panel, knit = r.model.rods, r.model.panel, r.model.scene.knit
    middle, cell = panel.low + 0.5 * panel.size, np.array([knit.wale_spacing, knit.course_spacing])
    rest = rods.position[:, :2] - middle
    now = r.position - np.append(r.gradient @ middle, 0.0) - rods.position * [0.0, 0.0, 1.0]
    _, here = np.unique(np.floor(rest / cell), axis=0, return_inverse=True)
    length = np.bincount(here, rods.node_length)
    mean = np.stack([np.bincount(here, rods.node_length * values) / length for values in np.hstack([rest, now]).T], axis=1)
    return SheetPlaces(cell, mean[:, :2], mean[:, 2:])


def _moved(r: Any) -> np.ndarray:
    """Displacement (site, 2) [m] from the affine prediction, the mean of both wires."""
    rods, wires = r.model.rods, r.model.wires
    last = rods.wire_count[wires.site_wire] - 1
    seed = np.clip(wires.site_seed, 0, last)
    segment = np.minimum(seed.astype(np.int64), last - 1)
    node, place = (rods.wire_first[wires.site_wire] + segment).ravel(), (seed - segment).ravel()
    rest = rest_place(rods, r.model.curve, node, place)[:, :2]
    now = (r.position[node] + r.curve.offset(node, place))[:, :2]
    return np.asarray((now - rest @ r.gradient.T).reshape(-1, 2, 2).mean(axis=1))


def read(
    model: SpatialModel, sites: Sites, relaxation: RodRelaxation, contact: WireContact, state: RodState, world: int
) -> SpatialObservables:
    """Evaluate a world and copy it to the host; with several ranks a collective call, by which the first gets the mesh."""
    stepper, rows = relaxation.stepper, np.array([world])
    stepper.evaluate(rows=rows)
    yielding = stepper.yielding
    strip = stepper.strip if stepper.worlds == 1 else RodStrip.alone(model.rods)
    if strip.ranks.is_first:
        model = model.global_model
    rods, factor = model.rods, stepper.steering.length_factor[world]

    def of_mesh(array: wp.array) -> np.ndarray:
        return strip.gathered(fetch(array))

    def own(values: np.ndarray) -> np.ndarray:
        return np.asarray(values.reshape(stepper.worlds, -1, *values.shape[1:])[world])

    inside = (rods.following >= 0) & (rods.previous >= 0)
    share = np.divide(1.0, rods.node_length * factor, out=np.zeros(rods.node_count), where=inside)
    natural_twist = own(fetch(stepper.arrays.natural_twist))[rods.row]
    twisted = share * (of_mesh(state.twist) - natural_twist)
    own_tension, tangent, director = own(relaxation.tension()), of_mesh(state.tangent), of_mesh(state.director)
    segment_tension, tension = (
        strip.gathered(values) for values in (own_tension, np.where(own(stepper.rods.can_stretch), own_tension, 0.0))
    )
    plastic = own(yielding.plastic) if yielding.yields else yielding.plastic
    stiffness = rods.of_nodes("axial_stiffness") / relaxation.multipliers.stored_softening
    half_in_clamp = factor * rods.half_in_clamp if relaxation.multipliers.keeps_arc_length else np.zeros(rods.node_count)
    length = np.where(rods.following >= 0, rods.natural_length * factor, 0.0) + half_in_clamp
    touching = strip.gathered_contacts(contact.read_contacts(world=world))
    return SpatialObservables(
        model=model,
        sites=sites,
        control=Steering(stepper.steering.values[world].copy()),
        position=of_mesh(state.position),
        director=director,
        tension=tension,
        rigid_pull=float(np.sum((segment_tension - tension)[:, None] * tangent[:, :2] * rods.rest_edge[:, :2])),
        segment_tangent=tangent,
        chord=of_mesh(state.length),
        half_in_clamp=half_in_clamp,
        moment=of_mesh(state.moment),
        plastic_curvature=share[:, None] * (strip.gathered(plastic) if yielding.yields else plastic),
        twist_change=twisted,
        segment_force=of_mesh(state.edge_force),
        force=of_mesh(state.force),
        stretch_energy=float(np.sum(0.5 * tension**2 * length / stiffness)),
        bend_energy=float(yielding.elastic_energy[world]),
        hardened_energy=float(yielding.hardened_energy[world]),
        contact_energy=_contact_energy(rods, of_mesh(state.contact_offset), touching),
        thermal_strain=strip.gathered(own(fetch(relaxation.multipliers.thermal_strain))),
        touching=touching,
        near=strip.gathered_contacts(contact.find_contacts((NEAR - 1.0) * rods.section.thickness, world)),
    )


def _contact_energy(rods: Rods, offset: np.ndarray, t: Contacts) -> float:
    """Sum over contacts of k g^2/2 [J]. g: overlap with the force N = k (g + o); `offset` [node] [m] gives o.

    Multipliers reduce overlaps and gaps to zero, and this energy with them.
    """
    if not len(t.force):
        return 0.0
    ends = [(offset[node], offset[rods.following[node]]) for node in (t.first, t.second)]
    offsets = sum((1.0 - place) * here + place * there for (here, there), place in zip(ends, t.place.T, strict=True))
    return float(np.sum(0.5 * t.force * t.overlap**2 / (t.overlap + offsets)))
