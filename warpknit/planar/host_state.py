"""State of a planar mesh on the host, with derived values of nodes.

`read_strip` copies what is needed to the host once; observables.py says what a mesh in this state shows.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import warp as wp

from ..compute.host import lanes, take
from ..compute.launch import Launch, bind
from ..compute.steering import Steering
from ..kernels import clamp
from ..kernels.contact_friction import LOOSE, TANGENTIAL
from ..kernels.energy import evaluate_wires
from ..kernels.wire_forces import WIRE_LANES
from ..knit.crossings import plan_cross as cross
from ..measure.strain import Boundary
from .model import Model
from .state import State

OPTIONAL = ("strain", "edge_x", "edge_y", "elastic", "moment", "bow_moment")  # optional outputs of evaluate_wires
NUMBERS_OF_PAIRS = ("pair_force", "pair_offset", "pair_gap", "pair_wake", "pair_u")
OF_NODES = (  # nodes, wires and clamps are in the order of the wires
    "u", "edge", "tension", "segment_force", "moment", "bow_moment", "turning", "wire_axial", "thermal_strain", "clamp_shift",
)  # fmt: skip


@dataclass(frozen=True)
class HostState(Boundary):
    """Host copies of a state, float64. Segment values stand at the node that starts the segment."""

    model: Model
    control: Steering
    u: np.ndarray  # [node, 2] [m] displacement from the affinely mapped rest shape
    body_u: np.ndarray  # [body, 2] [m]
    clamp_shift: np.ndarray  # [clamp, 2] [m] displacement of the clamps from the affinely mapped outline
    thermal_strain: np.ndarray  # [wire, 2] see State.wire_thermal_strain
    edge: np.ndarray  # [node, 2] [m] zero behind the last node of an open wire
    tension: np.ndarray  # [node] [N]
    wire_axial: np.ndarray  # [wire] [N] softened axial stiffness
    segment_force: np.ndarray  # [node, 2] [N] gradient of the energy by the edge (kernels/native/wire_forces.h)
    moment: np.ndarray  # [node] [N m] bending moment: of the turns, plus the slope of the moment (kernels/bend.py)
    bow_moment: np.ndarray  # [node] [N m] by which tension unbends arcs that keep their length (kernels/bend.py)
    turning: np.ndarray  # [node] [rad] turning angle less its natural value
    elastic: np.ndarray  # [node, or none without yield] [rad] part of it that is elastic
    plastic_turn: np.ndarray  # [node, or one without yield] [rad] plastic part at the last equilibrium
    back_turn: np.ndarray  # [node, or one] [rad] back turning of kinematic hardening
    pair_force: np.ndarray  # [pair] [N]
    pair_offset: np.ndarray  # [pair] [N] augmented Lagrangian multiplier, part of the force
    pair_stuck: np.ndarray  # [pair, or none without friction] where a contact sticks to its wire (kernels/contact_friction.py)
    pair_gap: np.ndarray  # [pair] [m] valid where the force is not zero
    pair_node: np.ndarray  # [pair]
    pair_wake: np.ndarray  # [pair] [m] travel since the last neighbour search up to which the pair sleeps
    pair_slide: np.ndarray  # [pair]
    pair_u: np.ndarray  # [pair]
    pair_nodal: np.ndarray  # [pair, 4, 2] [N] zero where the force is zero

    @cached_property
    def entry(self) -> np.ndarray:
        """[node] entry of the rest table."""
        return self.model.panel.node_entry

    @property
    def elastic_turning(self) -> np.ndarray:
        """[node] [rad] part of the turning that is elastic (kernels/bend.py)."""
        return self.elastic if len(self.elastic) else self.turning

    @property
    def yield_turn(self) -> np.ndarray:
        """[node] [rad] yield limit of the elastic turning."""
        return self.model.scene.wire.yield_curvature * self.hinge_length * self.length_factor

    # rest data of the nodes, from the table except next to clamps

    @property
    def natural_length(self) -> np.ndarray:
        """[node] [m] of the segment that starts at the node, at the reference temperature."""
        values = self.model.table.rest_length[self.entry]
        if self.model.is_gripped:
            panel = self.model.panel
            for far, node in enumerate((panel.wire_first + 1, panel.wire_first + panel.wire_count - 3)):
                values[node] = panel.wire_clamp[:, far, clamp.LENGTH]
        return values

    @property
    def hinge_length(self) -> np.ndarray:
        """[node] [m] wire length of the hinge at the node, at the reference temperature."""
        values = self.model.table.hinge_length[self.entry]
        if self.model.is_gripped:
            panel = self.model.panel
            for far, end, inward in ((0, panel.wire_first, 1), (1, panel.wire_first + panel.wire_count - 1, -1)):
                for following in (0, 1):
                    values[end + inward * (1 + following)] /= panel.wire_clamp[:, far, clamp.HINGE + following]
        return values


def pair_levers(r: HostState, pairs: np.ndarray) -> np.ndarray:
    """Rest positions of the bodies of `pairs` relative to their four nodes (pair, 4, 2) [m]."""
    model = r.model
    table, panel = model.table, model.panel
    body = np.repeat(panel.body_rest, 2, axis=0)[pairs] - panel.pair_shift[pairs]
    entry = (panel.pair_table[pairs] + r.pair_slide[pairs])[:, None] + np.arange(-1, 3)
    return body[:, None, :] - np.stack([table.x[entry], table.y[entry]], axis=2)


def read_strip(model: Model, state: State) -> HostState:
    """Evaluate the wires, and copy the strip of this rank to the host."""
    names = ("tension", "turning", "force_x", "force_y", *OPTIONAL[1:])
    out = {n: wp.zeros(model.panel.node_count, dtype=model.precision.real, device=model.device) for n in names}
    evaluation(model, state, out, (0, len(model.panel.block_first))).run(model.device)
    now = state.parity
    unit = model.precision.unit

    def double(values: wp.array) -> np.ndarray:
        return take(values).astype(np.float64)

    def columns(ax: wp.array, ay: wp.array) -> np.ndarray:
        pair = np.empty((len(ax), 2))  # filled in place: the arrays of a large mesh are many
        pair[:, 0], pair[:, 1] = take(ax), take(ay)
        return pair

    def metres(ax: wp.array, ay: wp.array) -> np.ndarray:
        pair = columns(ax, ay)
        pair *= unit
        return pair

    force = double(state.pair_force)
    nodal = columns(state.pair_nodal_x, state.pair_nodal_y)
    return HostState(
        model=model,
        control=Steering(state.steering.values.copy()),
        u=metres(state.node_ux[now], state.node_uy[now]),
        body_u=metres(state.body_ux, state.body_uy),
        clamp_shift=state.clamp_shift,
        thermal_strain=take(state.wire_thermal_strain).copy(),
        edge=columns(out["edge_x"], out["edge_y"]),
        segment_force=columns(out["force_x"], out["force_y"]),
        elastic=double(out["elastic"]) if model.yield_moment else np.zeros(0),
        pair_nodal=np.where(force[:, None, None] > 0, nodal.reshape(-1, 4, 2), 0.0),
        **{name: double(out[name]) for name in ("tension", "moment", "bow_moment", "turning")},
        **{name: double(getattr(state, name)) for name in ("wire_axial", "plastic_turn", "back_turn", *NUMBERS_OF_PAIRS)},
        **{name: take(getattr(state, name)).copy() for name in ("pair_node", "pair_slide", "pair_stuck")},
    )


def joined(state: HostState) -> HostState:
    """State of the global mesh on the first rank; the strip on the others."""
    model = state.model
    join = Join(model)
    first_node = 0 if model.strip is None else model.strip.nodes.start
    of_nodes = (*OF_NODES, *(("plastic_turn", "back_turn", "elastic") if model.yield_moment else ()))
    of_pairs = (*NUMBERS_OF_PAIRS, "pair_slide", "pair_nodal", *(("pair_stuck",) if len(state.pair_stuck) else ()))
    parts: dict[str, Any] = {name: join.nodes(getattr(state, name)) for name in of_nodes}
    parts |= {name: join.pairs(getattr(state, name)) for name in of_pairs}
    parts |= {"pair_node": join.pairs(state.pair_node + first_node), "body_u": join.bodies(state.body_u)}
    return replace(state, model=model.global_model, **parts) if model.ranks.is_first else state


def evaluation(model: Model, state: State, out: dict[str, wp.array], blocks: tuple[int, int]) -> Launch:
    """Launch of kernels/energy.py for (first block, number of blocks); `out`: output arrays [node] by name."""
    threads = lanes(WIRE_LANES, model.device)
    unused = {name: wp.empty(0, dtype=model.precision.real, device=model.device) for name in OPTIONAL if name not in out}
    return bind(
        evaluate_wires, blocks[1] * threads, model.rest, model.mesh, state, model.constants, first_block=blocks[0],
        threads_a_block=threads, ux=state.node_ux[state.parity], uy=state.node_uy[state.parity], **out, **unused,
    )  # fmt: skip


def friction_force(r: HostState) -> np.ndarray:
    """[pair] [N] friction force on the contact points along their wires."""
    force = np.zeros(len(r.pair_force))
    if not len(r.pair_stuck):
        return force
    sticks = np.flatnonzero((r.pair_stuck != float(LOOSE)) & (r.pair_force > 0))
    slip = (r.pair_slide + r.pair_u - r.pair_stuck)[sticks] * r.model.table.rest_length[r.model.panel.pair_table[sticks]]
    limit = r.model.scene.contact.friction * r.pair_force[sticks]
    force[sticks] = np.clip(-float(TANGENTIAL) * r.control.contact_stiffness * slip, -limit, limit)
    return force


def friction_energy(r: HostState) -> float:
    """[J] elastic energy of sticking contacts: F_t^2/(2 k_t) each."""
    return float(np.sum(0.5 * friction_force(r) ** 2) / (float(TANGENTIAL) * r.control.contact_stiffness))


class Join:
    """Gathers arrays of all ranks on the first one, or `everywhere`; a collective call. With one rank it returns its arrays.

    On ranks without a result the arrays are empty.
    """

    def __init__(self, model: Model, *, everywhere: bool = False) -> None:
        self._strip, self._panel = model.strip, model.global_model.panel
        self._collect: Callable[[np.ndarray], list[np.ndarray]] = model.ranks.everyone if everywhere else model.ranks.gather
        if model.strip is not None:
            self._body_places = self._collect(model.strip.body[: model.strip.owned_bodies])
            self._pair_places = self._collect(model.strip.pair_of_whole)

    def nodes(self, values: np.ndarray) -> np.ndarray:
        """[node, ...] of the global mesh; nodes are in the order of the wires."""
        if self._strip is None:
            return values
        parts = self._collect(values)
        return np.concatenate(parts) if parts else values[:0]

    wires = nodes

    def bodies(self, values: np.ndarray) -> np.ndarray:
        """[body, ...]"""
        if self._strip is None:
            return values
        return self._placed(values[: self._strip.owned_bodies], self._body_places, self._panel.body_count)

    def pairs(self, values: np.ndarray) -> np.ndarray:
        """[pair, ...]"""
        if self._strip is None:
            return values
        return self._placed(values[self._strip.pair], self._pair_places, 2 * self._panel.body_count)

    def _placed(self, values: np.ndarray, places: list[np.ndarray], count: int) -> np.ndarray:
        """(count, ...) with the values of each rank at its places."""
        parts = self._collect(values)
        joined = np.empty((count if parts else 0, *values.shape[1:]), dtype=values.dtype)
        for part, place in zip(parts, places, strict=True):
            joined[place] = part
        return joined


def bending_moments(r: HostState) -> tuple[np.ndarray, np.ndarray]:
    """Moments [N m] by statics at the nodes [node], and under bodies [closed pair]; positive to the left of the knitted shape.

    The equations are in docs/theory/stress.md. The moment peaks under a body: nodes at a distance h from each other miss up to
    F h/4 of it.
    """
    model, panel = r.model, r.model.panel
    moment = r.moment + r.bow_moment
    pair = np.nonzero(r.pair_force > 0)[0]
    first, count, closed = (values[panel.pair_wire[pair]] for values in (panel.wire_first, panel.wire_count, panel.wire_closed))
    local = r.pair_node[pair][:, None] + np.arange(-1, 3) - first[:, None]
    local = np.where(closed[:, None], local % count[:, None], np.clip(local, 0, count[:, None] - 1))
    nodes = first[:, None] + local  # (pair, 4)
    force = normal_forces(r, pair)
    node, after = nodes[:, 1], nodes[:, 2]
    # vectors from the contact point: p = c - n (gap + reach), n from the wire to the body
    normal = -force.sum(axis=1)
    normal /= np.hypot(normal[:, 0], normal[:, 1])[:, None]
    body = normal * (r.pair_gap[pair] + model.treatment.reach * r.length_factor)[:, None]
    from_nodes = pair_levers(r, pair) @ r.gradient.T + r.body_u[pair // 2][:, None, :] - r.u[nodes]
    place = body[:, None, :] - from_nodes
    begin, end = place[:, 1], place[:, 2]
    if model.is_gripped:  # the segment next to a clamp begins, or ends, at the clamp
        at_low = ~closed & (local[:, 1] == 1)
        at_high = ~closed & (local[:, 1] == count - 3)
        begin = np.where(at_low[:, None], end - r.edge[node], begin)
        end = np.where(at_high[:, None], begin + r.edge[node], end)
    pulled = r.segment_force[node] + force[:, 0] + force[:, 1]  # in the wire before p
    under = moment[after] - cross(place[:, 3] - place[:, 2], force[:, 3]) + cross(end, pulled - force.sum(axis=1))
    if model.is_gripped:  # loads on held nodes do not act on the wire
        by_low = moment[node] - cross(place[:, 1] - place[:, 0], force[:, 0]) + cross(begin, pulled)
        under = np.where(at_high, by_low, under)
    here, there = moment[node], moment[after]
    np.add.at(moment, node, under - cross(begin, pulled) - here)
    np.add.at(moment, after, under - cross(end, pulled - force.sum(axis=1)) - there)
    return moment, under


def normal_forces(r: HostState, pair: np.ndarray) -> np.ndarray:
    """(pair, 4, 2) [N] normal contact forces on the nodes.

    Friction acts at the two nodes beside the contact point (kernels/contact_friction.py). The force on the body is N n + T t,
    with t the normal n turned by -90 degrees times the side.
    """
    force = r.pair_nodal[pair]
    if not len(r.pair_stuck):
        return force
    tangential = r.model.panel.pair_side[pair] * friction_force(r)[pair]
    both, pushed = -force.sum(axis=1), r.pair_force[pair]
    normal = np.stack([pushed * both[:, 0] - tangential * both[:, 1], tangential * both[:, 0] + pushed * both[:, 1]], axis=1)
    normal /= (pushed**2 + tangential**2)[:, None]
    friction = tangential[:, None] * np.stack([normal[:, 1], -normal[:, 0]], axis=1)
    share = np.stack([0.0 * tangential, 1.0 - r.pair_u[pair], r.pair_u[pair], 0.0 * tangential], axis=1)
    return force + share[:, :, None] * friction[:, None, :]
