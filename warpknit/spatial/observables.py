"""A state of the mesh in space on the host, and what follows from it: energies, tension, contacts, stress.

A site (sites.py) stands for a body of the planar model and has two pairs of equal force: what one wire pushes with is what the
other is pushed back with. So counts and shares mean the same in both models.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..hermite import hermite
from ..kernels import control as c
from ..measure import strain
from ..measure.wire_curve import WireCurve
from ..planar.measures import INTERIOR
from .contact import TouchingPairs, WireContact
from .mesh import SpatialMesh
from .rest import Rest
from .rest_curve import offsets_at, spatial_curve
from .sites import NOWHERE, Sites

NEAR = 1.25  # thicknesses: the distance of centre lines at which the paper takes a contact for active
LEAST_FORCE = 1e-4  # of EI/W^2, about what a steady state leaves out of balance: no contact counts below


@dataclass(frozen=True)
class SpatialObservables:
    """Arrays [node], those of segments too, are of the state last evaluated."""

    mesh: SpatialMesh
    sites: Sites
    control: np.ndarray
    position: np.ndarray  # (node, 3) [m]
    director: np.ndarray  # (node, 3) across the segment
    tension: np.ndarray  # [N] of the segments, 0 of those that a clamp holds rigid
    clamp_pull: float  # [J] by those: tension times length as knitted, in the plane
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
    warmth: np.ndarray  # [node] excess of the length factor of the segments over that of the middle, relative
    touching: TouchingPairs  # contacts with a force
    near: TouchingPairs  # contacts closer than NEAR

    @property
    def model(self) -> SpatialMesh:
        """What was read, by the name that a planar reading has for it."""
        return self.mesh

    @property
    def gradient(self) -> np.ndarray:
        """(2, 2) deformation gradient of the boundary, against which the clamps keep their direction."""
        return self.control[int(c.GRADIENT) : int(c.GRADIENT) + 4].reshape(2, 2)

    @property
    def clamp_rotation(self) -> float:
        """[rad] by which the clamps are turned against the boundary, as in the plane (measure/reading.py)."""
        return strain.clamp_rotation(self.gradient)

    @property
    def stretch(self) -> np.ndarray:
        """(2, 2) deformation gradient of the boundary but for the rotation of the clamps."""
        return strain.stretch(self.gradient)

    @cached_property
    def place(self) -> np.ndarray:
        """(node, 3) [m] positions, turned back to where the boundary is strained by `stretch`."""
        turned = self.position.copy()
        turned[:, :2] = turned[:, :2] @ strain.rotation(self.clamp_rotation).T
        return turned

    @property
    def length_factor(self) -> float:
        return float(self.control[int(c.LENGTH_FACTOR)])

    @property
    def force_scale(self) -> float:
        """EI/W^2 [N]."""
        return self.mesh.rods.section.bending_stiffness / self.mesh.scene.knit.wale_spacing**2

    @property
    def threshold(self) -> float:
        """[N] above which a contact is active."""
        return max(self.mesh.scene.contact.threshold, LEAST_FORCE * self.force_scale)

    @cached_property
    def curve(self) -> WireCurve:
        """On which the wires touch."""
        return spatial_curve(self.mesh.layout(), self.position, self.gradient, self.director, self.mesh.curve, self.length_factor)

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
    def site_active(self) -> np.ndarray:
        """[site] carries more than the threshold."""
        return self.site_force > self.threshold

    @cached_property
    def site_near(self) -> np.ndarray:
        """[site] its wires are closer than NEAR: the paper's measure."""
        found = np.zeros(self.sites.count, dtype=bool)
        site, _ = self.sites.of(self.near.first, self.near.second)
        found[site[site != NOWHERE]] = True
        return found

    @property
    def elsewhere(self) -> np.ndarray:
        """[contact] [N] forces of active contacts that belong to no site."""
        force = self.touching.force[self.touching_site[0] == NOWHERE]
        return force[force > self.threshold]

    @cached_property
    def nominal_stress(self) -> np.ndarray:
        """(2, 2) [N/m] work-conjugate of the deformation gradient, force per rest width.

        P = (1/A0) [sum over segments n (x) E0 - sum over contacts f (x) (P0 - Q0) + sum over held nodes f (x) (X - c)], c
        being the clamp; f of a contact is the force on the first wire at the point
        whose rest place is P0, Q0 that of the second wire.
        """
        rods, t = self.mesh.rods, self.touching
        total = np.einsum("ia,ib->ab", self.segment_force[:, :2], rods.rest_edge[:, :2])
        if len(t.force):
            lever = self.rest_place(t.first, t.place[:, 0]) - self.rest_place(t.second, t.place[:, 1]) - t.shift
            push = t.force[:, None] * t.normal + t.friction
            total = total - np.einsum("ia,ib->ab", push[:, :2], lever[:, :2])
        held = self.mesh.wires.held_node
        total = total + np.einsum("ia,ib->ab", self.force[held, :2], self.mesh.wires.held_lever)
        return total / self.mesh.panel.area

    def rest_place(self, node: np.ndarray, place: np.ndarray) -> np.ndarray:
        """(contact, 3) [m] at rest of a place on the segment behind a node, by the shares of kernels/wire_curve.py."""
        rods = self.mesh.rods
        edge = rods.rest_edge
        after = rods.following[node]
        here = edge[node]
        before = np.where((rods.previous[node] >= 0)[:, None], edge[rods.previous[node]], here)
        behind = np.where((rods.following[after] >= 0)[:, None], edge[after], here)
        h10, h01, h11 = hermite(place[:, None])
        return rods.position[node] + 0.5 * h10 * (before + here) + h01 * here + 0.5 * h11 * (here + behind)

    @property
    def mesh_tension(self) -> tuple[float, float]:
        """Weft and warp [N/m], force per current width: diagonal of P F^T/det F, in the frame of the boundary."""
        cauchy = strain.true_stress(self.boundary_stress, self.stretch)
        return float(cauchy[0, 0]), float(cauchy[1, 1])

    @property
    def boundary_stress(self) -> np.ndarray:
        """(2, 2) [N/m] nominal stress in the frame in which the boundary is strained by `stretch`."""
        return strain.rotation(self.clamp_rotation) @ self.nominal_stress

    @property
    def clamp_couple(self) -> float:
        """[N/m] moment that turns the clamps counter-clockwise, over the area at rest."""
        return strain.couple_of(self.nominal_stress, self.gradient)

    @property
    def areal_mass(self) -> float:
        """[kg/m2] of the strained mesh."""
        mesh = self.mesh
        length = float(mesh.rods.wire_length.sum())
        return length * mesh.scene.wire.linear_density / (mesh.panel.area * float(np.linalg.det(self.gradient)))

    @property
    def thermal_force(self) -> float:
        """[J] derivative of the energy by the length factor of the wires."""
        rods, ea = self.mesh.rods, self.stretch_stiffness
        pull = np.where(rods.following >= 0, rods.natural_length * (self.tension + 0.5 * self.tension**2 / ea), 0.0)
        held = self.mesh.wires.held_node
        clamped = float(np.sum(self.force[held, :2] * self.mesh.wires.held_lever)) + self.clamp_pull
        return float(-pull.sum() - self.bend_energy / self.length_factor) + self.contact_growth - clamped

    @property
    def warmth_force(self) -> np.ndarray:
        """[node] [J] derivative of the energy by the warmth of the segments."""
        rods = self.mesh.rods
        return np.where(rods.following >= 0, -self.tension * rods.natural_length * self.length_factor, 0.0)

    @property
    def stress(self) -> np.ndarray:
        """[node] [Pa] E (d/2) |kappa - kappa0| + N E/EA, with the larger tension of the two segments."""
        wire, rods = self.mesh.scene.wire, self.mesh.rods
        bending = wire.youngs_modulus * wire.radius * np.linalg.norm(self.curvature_change, axis=1)
        own = np.abs(self.tension)
        before = np.where(rods.previous >= 0, own[rods.previous], 0.0)
        return bending + np.maximum(own, before) * wire.youngs_modulus / wire.axial_stiffness

    @property
    def plastic_strain(self) -> np.ndarray:
        """[node] of the outermost fibre, that stays."""
        return self.mesh.scene.wire.radius * np.linalg.norm(self.plastic_curvature, axis=1)

    @property
    def interior_stress(self) -> float:
        """[Pa] the largest stress farther than INTERIOR of the mesh's size from its edge."""
        if self.mesh.panel.boundary == "periodic":
            return float(self.stress.max())
        place = self.place[:, :2]
        share = (place - place.min(axis=0)) / np.ptp(place, axis=0)
        inside = np.all((share > INTERIOR) & (share < 1.0 - INTERIOR), axis=1)
        return float(self.stress[inside].max(initial=0.0))

    @property
    def shear_stress(self) -> np.ndarray:
        """[node] [Pa] G (d/2) |twist - twist0|."""
        wire = self.mesh.scene.wire
        return wire.youngs_modulus / (2 * (1 + wire.poissons_ratio)) * wire.radius * np.abs(self.twist_change)

    @property
    def contact_energy(self) -> float:
        """[J] of the penalty."""
        return float(0.5 * np.sum(self.touching.force * self.touching.overlap))

    @property
    def moved(self) -> np.ndarray:
        """(node, 2) [m] in the plane, from where the boundary carries the node by itself."""
        return self.place[:, :2] - self.mesh.rods.position[:, :2] @ self.stretch.T

    @property
    def kinetic_energy(self) -> float:
        """[J] of the last step."""
        return 0.5 * float(self.control[int(c.KINETIC_TWICE)])

    @property
    def stored(self) -> float:
        """[J]"""
        return self.stretch_energy + self.bend_energy + self.hardened_energy + self.contact_energy

    @property
    def penetration(self) -> float:
        """Largest overlap over the thickness."""
        return float(self.touching.overlap.max(initial=0.0)) / self.mesh.rods.section.thickness

    @property
    def residual(self) -> float:
        """Rms out-of-balance force of a node over the larger of EI/W^2 and the mean force of a clamp, or of a course and a
        wale."""
        held = self.mesh.wires.held_node
        if len(held):
            mean = float(np.linalg.norm(self.force[held].reshape(-1, 2, 3).sum(axis=1), axis=1).mean())
        else:
            knit = self.mesh.scene.knit
            weft, warp = self.mesh_tension
            mean = 0.5 * (abs(weft) * knit.course_spacing + abs(warp) * knit.wale_spacing)
        free = np.delete(self.force, held, axis=0)
        return float(np.sqrt(np.mean(np.sum(free**2, axis=1))) / max(mean, self.force_scale))


def read(mesh: SpatialMesh, sites: Sites, rest: Rest, contact: WireContact) -> SpatialObservables:
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
        mesh=mesh,
        sites=sites,
        control=state.read_control().copy(),
        position=state.position.numpy().copy(),
        director=state.director.numpy().copy(),
        tension=tension,
        clamp_pull=float(np.sum((carried - tension)[:, None] * tangent[:, :2] * rods.rest_edge[:, :2])),
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
        warmth=rest.warmth,
        touching=touching,
        near=contact.near((NEAR - 1.0) * section.thickness),
    )


def _contact_growth(mesh: SpatialMesh, t: TouchingPairs, tangent: np.ndarray, director: np.ndarray) -> float:
    """[J] N (r_p + r_q - n . (a_p - a_q)) over all contacts, a being what sections carry of the curve there as knitted."""
    if not len(t.force):
        return 0.0
    rods = mesh.rods
    own, other = (
        offsets_at(rods, mesh.curve, tangent, director, node, t.place[:, k]) for k, node in enumerate((t.first, t.second))
    )
    thick = rods.wire_radius[rods.wire_of[t.first]] + rods.wire_radius[rods.wire_of[t.second]]
    return float(np.sum(t.force * (thick - np.sum(t.normal * (own - other), axis=1))))
