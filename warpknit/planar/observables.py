"""Observables of a planar mesh (measure/observables.py): energies, loads, contacts, stress, positions."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from ..base.text import short_repr
from ..measure import active_threshold, pair_active, section
from ..measure.drawn_curve import planar_curve
from ..measure.observables import ContactPlaces, Energies, HookContact, PanelMap, WireStress, arcs_along
from ..measure.strain import rotation
from ..measure.tiles import Tiles, has_map, panel_map_of
from ..mesh.hook_mesh import LEFT, RIGHT, RIGHT_TOP
from ..results.frame import curve_parts
from .host_state import HostState, bending_moments, friction_energy, joined, pair_levers, read_strip
from .model import Model
from .state import State

NODES_AT_ONCE = 1_000_000  # of a panel map


@dataclass(frozen=True)
class PlanarObservables(HostState):
    """The state of the global mesh. Arrays [node] except the stress are computed on demand, to save memory."""

    __repr__ = short_repr

    # --- energies

    @cached_property
    def energies(self) -> Energies:
        """Elastic, contact and kinetic energies: T^2 L/(2 EA) a segment, EI theta^2/(2 l) a node, (F - offset)^2/(2 k) a pair
        with elastic slip; kinetic from the last step.

        A softened segment stores T^2 L s/(2 EA) unless its multiplier corrects the softening.
        """
        natural = self.natural_length * self.length_factor
        stiffness = self.control.contact_stiffness
        pressed = np.sum(0.5 * (self.pair_force - self.pair_offset) ** 2 * (self.pair_force > 0))
        return Energies(
            stretch=float(np.sum(0.5 * self.tension**2 * natural / self._stretch_stiffness)),
            bend=float(np.sum(0.5 * self.moment * self.elastic_turning)) + self.hardened_energy,
            contact=float(pressed / stiffness) + friction_energy(self),
            kinetic=self.kinetic_energy,
        )

    @property
    def _stretch_stiffness(self) -> np.ndarray | float:
        """[N] axial stiffness: true with multipliers, else the softened one [node]."""
        solver = self.model.scene.solver
        if solver.multipliers and solver.drive == "relax":
            return self.model.axial_stiffness
        return np.repeat(self.wire_axial, self.model.panel.wire_count)

    @property
    def hardened_energy(self) -> float:
        """[J] stored by kinematic hardening: H kappa_p^2/2 a length, with H = EI kept/(1 - kept)."""
        kept = self.model.scene.wire.hardening
        if not self.model.yield_moment or kept == 1.0:
            return 0.0
        hardening = self.model.bending_stiffness * kept / (1.0 - kept)
        return float(np.sum(0.5 * hardening * self.plastic_turn**2 / (self.hinge_length * self.length_factor)))

    # --- loads

    @cached_property
    def nominal_stress(self) -> np.ndarray:
        """(2, 2) [N/m] work-conjugate of the deformation gradient: force per rest width (docs/theory/membrane.md)."""
        table, panel = self.model.table, self.model.panel
        # behind the last node of an open wire there is no segment, and no force
        rest_edge = [rest[self.entry] for rest in (table.rest_x, table.rest_y)]
        sum_ = np.array([[self.segment_force[:, a] @ rest for rest in rest_edge] for a in range(2)])
        touching = np.nonzero(self.pair_force > 0)[0]
        sum_ += np.einsum("pka,pkb->ab", self.pair_nodal[touching], pair_levers(self, touching))
        sum_ += np.einsum("ia,ib->ab", self.held_forces, panel.held_lever)
        return sum_ / panel.area

    @property
    def held_forces(self) -> np.ndarray:
        """(held, 2) [N] forces of the wires and of contacts on the held nodes."""
        panel = self.model.panel
        node = panel.held_node
        n = self.segment_force
        first = np.isin(node, panel.wire_first)
        closed = panel.wire_closed[np.searchsorted(panel.wire_first, node, side="right") - 1]
        before = np.where((first & ~closed)[:, None], 0.0, n[node - 1])
        touching = np.nonzero((self.pair_force > 0) & ~panel.wire_closed[panel.pair_wire])[0]
        reached = self.pair_node[touching][:, None] + np.arange(-1, 3)
        place = np.searchsorted(node, reached)
        held = place < len(node)
        held[held] = node[place[held]] == reached[held]
        contact = np.zeros((len(node), 2))
        np.add.at(contact, place[held], self.pair_nodal[touching][held])
        return n[node] - before + contact

    @property
    def edge_force(self) -> np.ndarray:
        """(clamp, 2) [N] forces of the clamps on the wires: derivative of the energy by their displacement."""
        total = np.zeros((len(self.model.panel.clamp_position), 2))
        np.add.at(total, self.model.panel.held_clamp, self.held_forces)
        return -total

    @property
    def clamp_force(self) -> np.ndarray:
        """[clamp] [N] magnitude of the clamp forces."""
        return np.hypot(*self.edge_force.T)

    @property
    def thermal_force(self) -> float:
        """[J] derivative of the energy by the length factor of the wires."""
        stored = 0.5 * self.natural_length * self.tension**2 / self._stretch_stiffness
        stretch = np.sum(stored - self.tension * self._chord / self.length_factor)
        bend = -0.5 * np.sum(self.moment * self.elastic_turning) / self.length_factor
        return float(stretch + bend + np.sum(self.pair_force) * self.model.treatment.reach)

    @property
    def thermal_strain_force(self) -> np.ndarray:
        """(wire, 2) [J] derivative of the energy by `thermal_strain`."""
        panel = self.model.panel
        pull = -self.tension * self._chord
        local = np.arange(panel.node_count) - np.repeat(panel.wire_first, panel.wire_count)
        return np.stack([np.add.reduceat(pull, panel.wire_first), np.add.reduceat(pull * local, panel.wire_first)], axis=1)

    @property
    def _chord(self) -> np.ndarray:
        """[node] [m] length of the segments. Heat lengthens their arcs, and the chord of an arc that straightens with them."""
        return np.hypot(self.edge[:, 0], self.edge[:, 1])

    @property
    def unbalanced_force(self) -> float:
        """[N] rms over free nodes and bodies."""
        panel = self.model.panel
        free = panel.node_count + panel.body_count - len(panel.held_node)
        return float(np.sqrt(self.control.force_square / free))

    # --- contacts

    @property
    def pairs_at_reach_end(self) -> int:
        """Active pairs at the end of their sliding range.

        Beyond it the wire is continued straight and pushes a body that slid off; forces of such contacts are not valid.
        """
        panel = self.model.panel
        at_low = (self.pair_slide <= panel.pair_low) & (self.pair_u < 1e-3)
        at_high = (self.pair_slide >= panel.pair_high) & (self.pair_u > 1.0 - 1e-3)
        return int(np.count_nonzero((self.pair_force > active_threshold(self.model)) & (at_low | at_high)))

    @property
    def penetration(self) -> float:
        """Largest penetration over the wire diameter; negative gaps of closed pairs."""
        return float(np.max(-self.pair_gap[self.pair_force > 0], initial=0.0) / self.model.scene.wire.diameter)

    body_near = contact_elsewhere = None  # planar wires touch only at bodies
    elsewhere_position, elsewhere_force, elsewhere_wires = np.zeros((0, 3)), np.zeros(0), np.zeros((0, 2), dtype=np.int64)

    @property
    def contact_places(self) -> ContactPlaces:
        """One place for each body both of whose pairs are active."""
        panel, table = self.model.panel, self.model.table
        both = pair_active(self).reshape(-1, 2).all(axis=1)
        pairs = np.flatnonzero(np.repeat(both, 2))
        u = self.pair_u[pairs]
        knitted = np.stack([table.x, table.y], axis=1)
        towards = np.stack([table.rest_x, table.rest_y], axis=1)

        def place(entry: np.ndarray) -> np.ndarray:
            return np.asarray(knitted[entry] + u[:, None] * towards[entry])

        # [m] as knitted, in the repeat of the body and of the wire
        at_body = place(panel.pair_table[pairs] + self.pair_slide[pairs]) + panel.pair_shift[pairs]
        origin = np.repeat(panel.block_origin, panel.block_count, axis=0)[self.pair_node[pairs]]
        at_wire = place(self.entry[self.pair_node[pairs]]) + origin
        wires = len(panel.wire_first)
        chords = np.add.reduceat(self.natural_length, panel.wire_first)
        arc_per_chord = np.repeat(panel.wire_length / chords, panel.wire_count)
        lengths = self.length_factor * self.natural_length * arc_per_chord
        wire = panel.pair_wire[pairs]
        return ContactPlaces(
            force=self.pair_force.reshape(-1, 2)[both].mean(axis=1),
            wire=wire.reshape(-1, 2),
            arc=arcs_along(lengths, panel.wire_first, wire, self.pair_node[pairs], u).reshape(-1, 2),
            rest=at_wire.reshape(-1, 2, 2),
            reach=at_body[1::2] - at_body[::2],
            wire_length=np.add.reduceat(lengths, panel.wire_first),
            wire_period=np.tile([0.0, panel.size[1]], (wires, 1)),
        )

    @cached_property
    def hook_contact(self) -> HookContact | None:
        """The contact of two hooked wires."""
        model, panel = self.model, self.model.panel
        if model.scene.hook is None:
            return None
        height = model.scene.hook.height
        # the first node is one spacing before the lower clamp
        local = panel.pair_seed - panel.wire_first[panel.pair_wire] + self.pair_slide - 1
        arc = (local + self.pair_u) * model.table.spacing[panel.pair_wire]
        on_wires = self.pair_nodal[self.pair_force > 0.0].sum(axis=(0, 1))
        return HookContact(
            displacement=float(self.gradient[0, 1]) * height,
            drive_force=float(self.edge_force[RIGHT_TOP, 0]),
            force_left=float(self.pair_force[LEFT]),
            force_right=float(self.pair_force[RIGHT]),
            arc_left=float(arc[LEFT]),
            arc_right=float(arc[RIGHT]),
            # both pairs of a single contact point act on wires, with opposite forces
            ground_force=float(np.hypot(*on_wires)) if model.treatment.anchored else 0.0,
            body=self.body_position[0, :2],
            threshold=active_threshold(model),
        )

    # --- wires

    @cached_property
    def wire_stress(self) -> WireStress:
        """Stress E (d/2) |M|/EI + |N| E/EA [Pa] at nodes and under bodies. With the larger tension of both segments."""
        at_nodes, under_bodies = bending_moments(self)
        before = np.roll(self.tension, 1)
        panel = self.model.panel
        last = panel.wire_first + panel.wire_count - 1
        before[panel.wire_first] = np.where(panel.wire_closed, self.tension[last], self.tension[panel.wire_first])
        axial = np.where(np.abs(self.tension) > np.abs(before), self.tension, before)
        under = self.pair_node[self.pair_force > 0]
        return WireStress(self._fibre_stress(at_nodes, axial), self._fibre_stress(under_bodies, self.tension[under]), under)

    def _fibre_stress(self, moment: np.ndarray, tension: np.ndarray) -> np.ndarray:
        """[Pa] in the outermost fibre."""
        wire = self.model.scene.wire
        radius, per_tension = section(wire)
        bent = wire.youngs_modulus * radius / self.model.bending_stiffness * np.abs(moment)
        return bent + np.abs(tension) * per_tension

    shear_stress = None  # planar wires do not twist

    @property
    def axial_strain(self) -> np.ndarray:
        """[node] mechanical axial strain of the segments, T/EA."""
        return self.tension / self.model.axial_stiffness

    @property
    def plastic_strain(self) -> np.ndarray:
        """[node] plastic strain of the outermost fibre; empty for elastic wires."""
        if not self.model.yield_moment:
            return np.zeros(0)
        return np.abs(self.plastic_turn) / self.hinge_length * self.model.scene.wire.radius

    @property
    def node_length(self) -> np.ndarray:
        """[node] [m] wire that a node stands for."""
        return self.model.node_length

    @property
    def wire_length(self) -> float:
        """[m] of all wires as knitted."""
        return float(np.sum(self.model.panel.wire_length))

    @property
    def wire_mass(self) -> float:
        """[kg] of all wires."""
        return self.wire_length * self.model.scene.wire.linear_density

    # --- places, from the corner of the mesh

    @cached_property
    def node_position(self) -> np.ndarray:
        """(node, 3) [m] in the frame of `stretch`; z is the rest height."""
        node = np.empty((self.model.panel.node_count, 3))
        node[:, :2] = (self.model.node_rest - self._rest_corner) @ self.stretch.T
        node[:, :2] += self.u @ rotation(self.clamp_rotation).T
        node[:, 2] = self.model.table.z[self.entry]
        return node

    @property
    def body_position(self) -> np.ndarray:
        """(body, 3) [m] in the same frame."""
        panel, table = self.model.panel, self.model.table
        turned = rotation(self.clamp_rotation)
        rest = panel.body_rest + panel.body_origin - self._rest_corner
        body = np.einsum("ia,ba->ib", rest, self.stretch) + self.body_u @ turned.T
        height = table.z[self.entry][panel.pair_seed].reshape(-1, 2).mean(axis=1)
        return np.column_stack([body, height])

    @property
    def _rest_corner(self) -> np.ndarray:
        """(2,) [m] lower corner of the mesh at rest."""
        panel = self.model.panel
        return self.model.node_rest.min(axis=0) if panel.boundary == "periodic" else panel.clamp_position.min(axis=0)

    corner = np.zeros(3)  # (3,) [m] origin of the positions

    @property
    def between(self) -> np.ndarray:
        """(node, parts - 1, 3) [m] points on the curve to the next node, relative to the node; none in a large mesh."""
        model = self.model
        parts = curve_parts(model.panel.node_count, model.scene.model.nodes_per_loop)
        if parts == 1:
            return np.zeros((0, 0, 3), dtype=np.float32)
        return planar_curve(model.layout(), self.node_position, self.stretch, model.table.curve[self.entry]).between(parts)

    @property
    def displacement(self) -> np.ndarray:
        """(node, 2) [m] from the affine prediction."""
        return self.u

    thickness = None  # the rest height of a planar mesh is for pictures only

    @property
    def panel_map(self) -> PanelMap | None:
        """The map of a gripped panel of enough repeats."""
        return find_panel_map(self) if has_map(self.model) else None


def read(model: Model, state: State) -> PlanarObservables:
    """Evaluate the wires and copy the state to the host.

    With several ranks a collective call; the first rank gets the global mesh.
    """
    host = joined(read_strip(model, state))
    return PlanarObservables(**{field.name: getattr(host, field.name) for field in fields(host)})


def find_panel_map(r: PlanarObservables) -> PanelMap:
    """The map of a gripped panel."""
    panel, table = r.model.panel, r.model.table
    tiles = Tiles.of(r.model)
    virial, stress_max = tiles.zeros(2, 2), tiles.zeros()
    force, stress = r.segment_force, r.wire_stress.node
    inside = np.any(r.edge != 0.0, axis=1)
    origin = np.repeat(np.arange(len(panel.block_first)), panel.block_count)
    for begin in range(0, panel.node_count, NODES_AT_ONCE):
        part = slice(begin, begin + NODES_AT_ONCE)
        entry = r.entry[part]
        where = tiles.at(np.stack([table.x[entry], table.y[entry]], axis=1) + panel.block_origin[origin[part]])
        np.maximum.at(stress_max, where, stress[part])
        rest_edge = np.where(inside[part, None], np.stack([table.rest_x[entry], table.rest_y[entry]], axis=1), 0.0)
        tiles.add(virial, where, np.einsum("na,nb->nab", force[part], rest_edge))
    del force, stress
    touching = np.nonzero(r.pair_force > 0)[0]
    lever = np.einsum("pka,pkb->pab", r.pair_nodal[touching], pair_levers(r, touching))
    tiles.add(virial, tiles.of_body[touching // 2], lever)
    held = np.einsum("na,nb->nab", r.held_forces, panel.held_lever)
    tiles.add(virial, tiles.at(panel.clamp_position[panel.held_clamp]), held)
    return panel_map_of(r, tiles, virial, stress_max, r.body_u)
