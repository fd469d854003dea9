"""Forces in the plane wires of a state, in NumPy and written anew: what kernels/wire_forces.py is compared with.

Positions are x = F X + u, segments e = x_next - x, and with t = e/|e| and nu its left normal

    T = offset + K (|e| - L)/L                              tension, L the natural length times the length factor f
    theta = angle from the edge before to the edge after    a = theta - theta0, of it a_e elastic
    g = EI a_e/(l f)                                        moment of the turn, l the wire that the node stands for
    M = g - EI slope/l [L (g_next - g) - L_before (g - g_before)]
    B = bow f theta (w_after T L + w_before T_before L_before)/f
    n = T t + (M + B - M_next - B_next)/|e| nu              force of the segment

With kinematic hardening a_e = a - a_p less (1 - h) of what |a - a_p - back| has beyond the yield turn. Clamps hold the first
and the last segment of an open wire and give the next ones another length, angle and hinge (kernels/clamp.py).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from warpknit.kernels import clamp
from warpknit.planar.model import Model
from warpknit.planar.state import State


@dataclass(frozen=True)
class WireForces:
    """[node], segments at the node that starts them."""

    edge: np.ndarray  # (node, 2) [m]
    tension: np.ndarray  # [N]
    turning: np.ndarray  # [rad] theta - theta0
    elastic: np.ndarray  # [rad]
    moment_of_turns: np.ndarray  # [N m]
    moment: np.ndarray  # [N m] M
    bow_moment: np.ndarray  # [N m] B
    segment_force: np.ndarray  # (node, 2) [N]


def wire_forces(model: Model, state: State) -> WireForces:
    """Forces of the state as it is, wire by wire."""
    wires = [_of_wire(model, state, wire) for wire in range(len(model.panel.wire_first))]
    return WireForces(*(np.concatenate(parts) for parts in zip(*wires, strict=True)))


def _of_wire(model: Model, state: State, wire: int) -> tuple[np.ndarray, ...]:
    panel, table = model.panel, model.table
    first, count, closed = (int(values[wire]) for values in (panel.wire_first, panel.wire_count, panel.wire_closed))
    nodes = slice(first, first + count)
    entry = panel.node_entry[nodes]
    control = state.steering.read()
    gradient, factor = state.gradient, control.length_factor
    u = np.stack([a[state.parity].numpy()[nodes].astype(float) for a in (state.node_ux, state.node_uy)], axis=1)
    step = np.roll(u, -1, axis=0) - u
    edge = np.stack([table.rest_x[entry], table.rest_y[entry]], axis=1) @ gradient.T + model.precision.unit * step
    natural, rest_angle = table.rest_length[entry].copy(), table.rest_angle[entry].copy()
    hinge_length = table.hinge_length[entry].copy()
    weight_before, weight_after = np.ones(count), np.ones(count)
    gripped = model.is_gripped
    rigid = np.zeros(count, dtype=bool)
    if gripped:
        for far in (False, True):
            numbers = panel.wire_clamp[wire, int(far)]
            outer, own, at, following = (count - 2, count - 3, count - 2, count - 3) if far else (0, 1, 1, 2)
            rigid[outer] = True
            edge[outer] = numbers[[clamp.TANGENT_X, clamp.TANGENT_Y]]
            edge[own] += numbers[[clamp.LEVER_X, clamp.LEVER_Y]]
            natural[own] = numbers[clamp.LENGTH]
            rest_angle[[at, following]] = numbers[[clamp.ANGLE, clamp.NEXT_ANGLE]]
            hinge_length[[at, following]] /= numbers[[clamp.HINGE, clamp.NEXT_HINGE]]
            towards, beyond = (weight_before, weight_after) if far else (weight_after, weight_before)
            towards[at] += numbers[clamp.BOW_WEIGHT]
            beyond[following] += numbers[clamp.NEXT_BOW_WEIGHT]
            towards[following] += numbers[clamp.BEYOND_BOW_WEIGHT]
    is_segment = np.full(count, True) if closed else np.arange(count) < count - 1
    is_hinge = is_segment & (bool(closed) | (np.arange(count) > 0))
    edge[~is_segment] = 0.0

    def before(values: np.ndarray) -> np.ndarray:
        return np.roll(values, 1, axis=0)

    def after(values: np.ndarray) -> np.ndarray:
        return np.roll(values, -1, axis=0)

    length = np.hypot(*edge.T)
    bears = is_segment & ~rigid
    stiffness = float(state.wire_axial.numpy()[wire])
    offset = state.tension_offset.numpy()[nodes].astype(float)
    tension = np.where(bears, offset + stiffness * (length - natural * factor) / (natural * factor), 0.0)

    last = before(edge)
    theta = np.where(is_hinge, np.arctan2(last[:, 0] * edge[:, 1] - last[:, 1] * edge[:, 0], np.sum(last * edge, axis=1)), 0.0)
    turning = np.where(is_hinge, theta - rest_angle, 0.0)
    elastic = turning
    if model.yield_moment:
        trial = turning - state.plastic_turn.numpy()[nodes]
        beyond = trial - state.back_turn.numpy()[nodes]
        over = np.maximum(np.abs(beyond) - model.yield_moment * hinge_length * factor / model.bending_stiffness, 0.0)
        elastic = np.where(is_hinge, trial - np.sign(beyond) * over * (1.0 - model.scene.wire.hardening), 0.0)
    turns = model.bending_stiffness * elastic / (hinge_length * factor)
    rise = np.where(bears, natural * (after(turns) - turns), 0.0)
    slope = control.slope_factor * model.bending_stiffness / hinge_length
    moment = np.where(is_hinge, turns - slope * (rise - before(rise)), 0.0)
    pull = tension * natural * factor
    bow = control.bow_moment
    bows = np.where(is_hinge, bow * theta * (weight_after * pull + weight_before * before(pull)), 0.0)

    with np.errstate(divide="ignore", invalid="ignore"):
        shear = (moment + bows - after(moment + bows)) / length
        tangent = edge / length[:, None]
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
    force = np.where(is_segment[:, None], tension[:, None] * tangent + shear[:, None] * normal, 0.0)
    return edge, tension, turning, elastic, turns, moment, bows, force
