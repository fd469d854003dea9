"""What a state of a mesh in space shows (measure/observables.py): energies, loads, contacts, stress and places.

A site (sites.py) stands for a body of the planar model and has two pairs of equal force: what one wire pushes with is what the
other is pushed back with. So counts and shares mean the same in both models.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..kernels import control as c
from ..measure import strain
from ..measure.boundary import Boundary
from ..measure.contact_places import ContactPlaces
from ..measure.hook_contact import HookContact
from ..measure.measures import active_threshold
from ..measure.observables import Energies, WireStress
from ..measure.wire_curve import WireCurve
from .contact_places import contact_places, site_places
from .hook_contact import hook_contact
from .model import SpatialModel
from .rest_curve import offsets_at, spatial_curve
from .rod_relaxation import RodRelaxation
from .sites import NOWHERE, Sites
from .wire_contact import TouchingPairs, WireContact

NEAR = 1.25  # thicknesses: the distance of centre lines at which the paper takes a contact for active


@dataclass(frozen=True)
class SpatialObservables(Boundary):
    """Arrays [node], those of segments too, are of the state last evaluated."""

    model: SpatialModel
    sites: Sites
    control: np.ndarray
    position: np.ndarray  # (node, 3) [m]
    director: np.ndarray  # (node, 3) across the segment
    tension: np.ndarray  # [N] of the segments, 0 of those that a clamp holds rigid
    rigid_pull: float  # [J] by those: tension times length as knitted, in the plane
    curvature_change: np.ndarray  # (node, 2) [1/m] that is elastic
    plastic_curvature: np.ndarray  # (node, 2) [1/m] that stays
    twist_change: np.ndarray  # [1/m]
    segment_force: np.ndarray  # (node, 3) [N]
    force: np.ndarray  # (node, 3) [N] out of balance
    stretch_stiffness: float  # [N] the true one, or what a ramp softens it to
    stretch_energy: float  # [J] with that stiffness
    bend_energy: float  # [J] bending and twist, elastic
    hardened_energy: float  # [J] that wires have hardened by
    contact_growth: float  # [J] derivative of the energy of contact by the length factor: wires grow thicker, and what is curved
    thermal_strain: np.ndarray  # [node] excess of the length factor of the segments over that of the middle, relative
    touching: TouchingPairs  # contacts with a force
    near: TouchingPairs  # contacts closer than NEAR

    # --- energies

    @cached_property
    def energies(self) -> Energies:
        """Kinetic energy is of the last step, that of contact is of the penalty."""
        pressed = float(0.5 * np.sum(self.touching.force * self.touching.overlap))
        return Energies(self.stretch_energy, self.bend_energy + self.hardened_energy, pressed, self.kinetic_energy)

    # --- loads

    @cached_property
    def nominal_stress(self) -> np.ndarray:
        """(2, 2) [N/m] work-conjugate of the deformation gradient, force per rest width.

        P = (1/A0) [sum over segments n (x) E0 - sum over contacts f (x) (P0 - Q0) + sum over held nodes f (x) (X - c)], c
        being the clamp; f of a contact is the force on the first wire at the point
        whose rest place is P0, Q0 that of the second wire.
        """
        rods, t = self.model.rods, self.touching
        total = np.einsum("ia,ib->ab", self.segment_force[:, :2], rods.rest_edge[:, :2])
        if len(t.force):
            lever = self.rest_place(t.first, t.place[:, 0]) - self.rest_place(t.second, t.place[:, 1]) - t.shift
            push = t.force[:, None] * t.normal + t.friction
            total = total - np.einsum("ia,ib->ab", push[:, :2], lever[:, :2])
        held = self.model.wires.held_node
        total = total + np.einsum("ia,ib->ab", self.force[held, :2], self.model.wires.held_lever)
        return total / self.model.panel.area

    def rest_place(self, node: np.ndarray, place: np.ndarray) -> np.ndarray:
        """(contact, 3) [m] at rest of a place on the segment behind a node, by the shares of kernels/wire_curve.py."""
        rods = self.model.rods
        edge = rods.rest_edge
        after = rods.following[node]
        here = edge[node]
        before = np.where((rods.previous[node] >= 0)[:, None], edge[rods.previous[node]], here)
        behind = np.where((rods.following[after] >= 0)[:, None], edge[after], here)
        s = place[:, None]
        h10, h01, h11 = s * (1 - s) ** 2, s * s * (3 - 2 * s), s * s * (s - 1)
        return rods.position[node] + 0.5 * h10 * (before + here) + h01 * here + 0.5 * h11 * (here + behind)

    @property
    def thermal_force(self) -> float:
        """[J] derivative of the energy by the length factor of the wires."""
        rods, ea = self.model.rods, self.stretch_stiffness
        pull = np.where(rods.following >= 0, rods.natural_length * (self.tension + 0.5 * self.tension**2 / ea), 0.0)
        held = self.model.wires.held_node
        clamped = float(np.sum(self.force[held, :2] * self.model.wires.held_lever)) + self.rigid_pull
        return float(-pull.sum() - self.bend_energy / self.length_factor) + self.contact_growth - clamped

    @property
    def thermal_strain_force(self) -> np.ndarray:
        """[node] [J] derivative of the energy by `thermal_strain`."""
        rods = self.model.rods
        return np.where(rods.following >= 0, -self.tension * rods.natural_length * self.length_factor, 0.0)

    @property
    def held_forces(self) -> np.ndarray:
        """(held, 3) [N] forces of the wires and of contacts on the held nodes."""
        return self.force[self.model.wires.held_node]

    @property
    def edge_force(self) -> np.ndarray:
        """(clamp, 3) [N] with what force the clamps hold the wires, by two nodes each."""
        return -self.held_forces.reshape(-1, 2, 3).sum(axis=1)

    @property
    def clamp_force(self) -> np.ndarray:
        """[clamp] [N] size of the force with which each clamp holds its wire."""
        return np.linalg.norm(self.edge_force, axis=1)

    @property
    def unbalanced_force(self) -> float:
        """[N] rms over free nodes."""
        free = np.delete(self.force, self.model.wires.held_node, axis=0)
        return float(np.sqrt(np.mean(np.sum(free**2, axis=1))))

    # --- contacts

    @cached_property
    def touching_site(self) -> tuple[np.ndarray, np.ndarray]:
        """[contact] of those that carry a force, and which side of the site their first wire is."""
        return self.sites.of(self.touching.first, self.touching.second)

    @cached_property
    def site_force(self) -> np.ndarray:
        """[site] [N] with which its two wires push each other: the size of the sum of their contacts there."""
        total = np.zeros((self.sites.count, 3))
        t = self.touching
        site, sign = self.touching_site
        here = site != NOWHERE
        np.add.at(total, site[here], (sign[:, None] * (t.force[:, None] * t.normal + t.friction))[here])
        return np.linalg.norm(total, axis=1)

    @cached_property
    def pair_force(self) -> np.ndarray:
        """[pair] [N] two of equal force for each site."""
        return np.repeat(self.site_force, 2)

    @cached_property
    def body_near(self) -> np.ndarray:
        """[site] its wires are closer than NEAR: the paper's measure."""
        found = np.zeros(self.sites.count, dtype=bool)
        site, _ = self.sites.of(self.near.first, self.near.second)
        found[site[site != NOWHERE]] = True
        return found

    @property
    def contact_elsewhere(self) -> np.ndarray:
        """[contact] [N] forces of active contacts that belong to no site."""
        force = self.touching.force[self.touching_site[0] == NOWHERE]
        return force[force > active_threshold(self.model)]

    @property
    def pairs_at_reach_end(self) -> int:
        """Contacts slide as far as they like."""
        return 0

    @property
    def penetration(self) -> float:
        """Largest overlap over the thickness."""
        return float(self.touching.overlap.max(initial=0.0)) / self.model.rods.section.thickness

    @property
    def contact_places(self) -> ContactPlaces:
        """A place for each contact with more than the threshold."""
        return contact_places(self)

    @cached_property
    def hook_contact(self) -> HookContact | None:
        """The contact of two hooked wires."""
        return None if self.model.scene.hook is None else hook_contact(self)

    # --- wires

    @cached_property
    def wire_stress(self) -> WireStress:
        """[Pa] E (d/2) |kappa - kappa0| + N E/EA at the nodes, with the larger tension of the two segments."""
        wire, rods = self.model.scene.wire, self.model.rods
        bending = wire.youngs_modulus * wire.radius * np.linalg.norm(self.curvature_change, axis=1)
        own = np.abs(self.tension)
        before = np.where(rods.previous >= 0, own[rods.previous], 0.0)
        node = bending + np.maximum(own, before) * wire.youngs_modulus / wire.axial_stiffness
        return WireStress(node, np.zeros(0))

    @property
    def shear_stress(self) -> np.ndarray:
        """[node] [Pa] G (d/2) |twist - twist0|."""
        wire = self.model.scene.wire
        return wire.youngs_modulus / (2 * (1 + wire.poissons_ratio)) * wire.radius * np.abs(self.twist_change)

    @property
    def axial_strain(self) -> np.ndarray:
        """[node] mechanical axial strain of the segments, T/EA."""
        return self.tension / self.model.rods.section.axial_stiffness

    @property
    def plastic_strain(self) -> np.ndarray:
        """[node] of the outermost fibre, that stays."""
        return self.model.scene.wire.radius * np.linalg.norm(self.plastic_curvature, axis=1)

    @property
    def wire_length(self) -> float:
        """[m] of all wires as knitted."""
        return float(self.model.rods.wire_length.sum())

    # --- places

    @cached_property
    def node_position(self) -> np.ndarray:
        """(node, 3) [m] turned back to where the boundary is strained by `stretch`."""
        turned = self.position.copy()
        turned[:, :2] = turned[:, :2] @ strain.rotation(self.clamp_rotation).T
        return turned

    @property
    def body_position(self) -> np.ndarray:
        """(site, 3) [m] where the wires of a site touch or are nearest to each other; of a hook where they press."""
        place = site_places(self) @ self._turn.T
        if self.hook_contact is not None:
            place[0, :2] = self.hook_contact.body + self.corner[:2]
        return place

    @property
    def _turn(self) -> np.ndarray:
        """(3, 3) back to where the boundary is strained by `stretch`."""
        back = np.eye(3)
        back[:2, :2] = strain.rotation(self.clamp_rotation)
        return back

    @property
    def corner(self) -> np.ndarray:
        """(3,) [m] lower corner of the mesh."""
        panel = self.model.panel
        rest = self.model.rods.position[:, :2] if panel.boundary == "periodic" else panel.clamp_position
        return np.append(self.stretch @ rest.min(axis=0), 0.0)

    @cached_property
    def curve(self) -> WireCurve:
        """On which the wires touch."""
        return spatial_curve(
            self.model.layout(), self.position, self.gradient, self.director, self.model.curve, self.length_factor
        )

    @property
    def between(self) -> np.ndarray:
        """(node, parts - 1, 3) [m] places on the curve to the next node, from the node."""
        return self.curve.between(self.model.layout().curve_parts) @ self._turn.T.astype(np.float32)

    @property
    def displacement(self) -> np.ndarray:
        """(node, 2) [m] from the affine prediction, in the plane."""
        return self.node_position[:, :2] - self.model.rods.position[:, :2] @ self.stretch.T

    @property
    def thickness(self) -> float:
        """[m] of the mesh, from the lowest to the highest fibre."""
        return float(np.ptp(self.position[:, 2])) + self.model.rods.section.thickness

    @property
    def panel_map(self) -> None:
        """Meshes in space are too small for one."""


def read(mesh: SpatialModel, sites: Sites, rest: RodRelaxation, contact: WireContact) -> SpatialObservables:
    """Evaluate the state and copy it to the host."""
    stepper = rest.stepper
    stepper.evaluate()
    state, rods = stepper.state, mesh.rods
    section = rods.section
    factor = float(state.read_control()[int(c.LENGTH_FACTOR)])
    inside = (rods.following >= 0) & (rods.previous >= 0)
    share = np.divide(1.0, rods.node_length * factor, out=np.zeros(rods.node_count), where=inside)
    yielding = stepper.yielding
    bent = share[:, None] * yielding.elastic
    twisted = share * (state.twist.numpy() - stepper.arrays.natural_twist.numpy())
    carried, tangent = rest.tension(), state.tangent.numpy()
    tension = np.where(rest.stretches, carried, 0.0)
    length = np.where(rods.following >= 0, rods.natural_length * factor, 0.0)
    touching = contact.near()
    hinge = section.bending_stiffness * np.sum(bent**2, axis=1) + section.twist_stiffness * twisted**2
    return SpatialObservables(
        model=mesh,
        sites=sites,
        control=state.read_control().copy(),
        position=state.position.numpy().copy(),
        director=state.director.numpy().copy(),
        tension=tension,
        rigid_pull=float(np.sum((carried - tension)[:, None] * tangent[:, :2] * rods.rest_edge[:, :2])),
        curvature_change=bent,
        plastic_curvature=share[:, None] * yielding.plastic,
        twist_change=twisted,
        segment_force=stepper.segment_forces(),
        force=state.force.numpy().copy(),
        stretch_stiffness=rest.stored_stiffness,
        stretch_energy=float(np.sum(0.5 * tension**2 * length / rest.stored_stiffness)),
        bend_energy=float(np.sum(0.5 * hinge * rods.node_length * factor)),
        hardened_energy=yielding.hardened_energy,
        contact_growth=_contact_growth(mesh, touching, tangent, state.director.numpy()),
        thermal_strain=rest.warmth,
        touching=touching,
        near=contact.near((NEAR - 1.0) * section.thickness),
    )


def _contact_growth(mesh: SpatialModel, t: TouchingPairs, tangent: np.ndarray, director: np.ndarray) -> float:
    """[J] N (r_p + r_q - n . (a_p - a_q)) over all contacts, a being what sections carry of the curve there as knitted."""
    if not len(t.force):
        return 0.0
    rods = mesh.rods
    own, other = (
        offsets_at(rods, mesh.curve, tangent, director, node, t.place[:, k]) for k, node in enumerate((t.first, t.second))
    )
    thick = rods.wire_radius[rods.wire_of[t.first]] + rods.wire_radius[rods.wire_of[t.second]]
    return float(np.sum(t.force * (thick - np.sum(t.normal * (own - other), axis=1))))
