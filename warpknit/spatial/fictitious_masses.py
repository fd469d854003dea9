"""Fictitious masses of a dynamic relaxation, banded along the wire, for which a step of one second is stable.

A diagonal mass that bounds the bending stiffness EI/h^3 of the shortest waves makes long waves slow: their steps grow with the
square of the nodes. A mass that is itself a difference operator along the wire moves waves of all lengths at about the same rate
(selective mass scaling: Olovsson, Simonsson and Unosson, Int. J. Numer. Methods Eng. 63, 2005). Per node n between segments a
and b, with turning angle p, moment m and lengths l, and per segment with axial stiffness K and tension T, the stiffness is
bounded by

    (1 + e) (B/l_n + bow) |dx_b/l_b - dx_a/l_a|^2                 bending across; bow = (T_a l_a + T_b l_b)/24, kernels/bend.py
    [(1 + 1/e) B + GJ] p^2/(2 l_n) (|dx_a|^2/l_a^2 + |dx_b|^2/l_b^2)        turning edges: the normals of a and b differ by p,
                                                                  |n_b . v - n_a . u|^2 <= (1 + e)|v - u|^2 + (1 + 1/e) p^2 ...
    |m| (|dx_a|^2/l_a^2 + |dx_b|^2/l_b^2)                         second derivative of the angle
    (K + T)/l |dx|^2                                              stretch along the segment, tension across
    k (sum of |w n|) |w_i n_x| dx_i^2, ...                        a contact k (w n . dx)^2 of normal n, by Cauchy and Schwarz,
                                                                  and the same along y and z

with the difference dx of the displacements of the two nodes of a segment and B = 19/9 EI, by which slopes of moments stiffen the
shortest waves (kernels/rod_forces.py); and of twist by EI/l_n (df_b - df_a)^2, as a sharp turn couples bending and twist, and
B p^2/(2 l_n) (df_a^2 + df_b^2). Displacements and twist are coupled: the stiffness of both is bounded by 1 + COUPLING times the
first and 1 + 1/COUPLING times the second. A quarter of the bound is the mass at the stability limit.

A uniform mass moves waves longer than `wave_length`, which carry almost no force.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import warp as wp

from ..host import fetch, store
from ..kernels.banded_mass import HELD_NODE, HELD_TURN
from ..kernels.bend import BOW
from ..kernels.rod_sums import sum_mass_products
from ..launch import bind
from ..numerics import MASS_MARGIN
from .rod_arrays import RodArrays, RodState
from .rods import Rods
from .step_bound import SLOPE_FACTOR

TURNED = 2.0  # e of the bound
COUPLING = 0.5  # of displacements and twist
MORE_TURN = 0.15  # [rad] allowance for turns sharpened until the next update
MORE_TENSION = 1.2  # the same for tensions


@dataclass(frozen=True)
class Masses:
    """Masses [kg] and spin inertias [kg m2], arrays [node]: diagonals and couplings (kernels/banded_mass.py)."""

    node: np.ndarray  # (node, 3) along x, y and z
    next: np.ndarray
    second: np.ndarray
    spin: np.ndarray
    next_spin: np.ndarray

    @staticmethod
    def diagonal(node: np.ndarray, spin: np.ndarray) -> Masses:
        """Masses without couplings, node [node] the same along x, y and z."""
        none = np.zeros(len(node))
        return Masses(np.repeat(node[:, None], 3, axis=1), none, none, spin, none)


class BandedMasses:
    """Fictitious masses of rods for the state they are in."""

    def __init__(self, rods: Rods, wave_length: float, sliding: np.ndarray) -> None:
        """wave_length [m] of the slowest wave; sliding: nodes of clamps that move."""
        self._rods = rods
        after, before = rods.following, rods.previous
        self._segment = np.flatnonzero(after >= 0)
        self._end = after[self._segment]
        self._inner = np.flatnonzero((after >= 0) & (before >= 0))
        self._before, self._after = before[self._inner], after[self._inner]
        self._natural = rods.natural_length
        self._node_length = rods.node_length[self._inner]
        is_sliding = np.zeros(rods.node_count, dtype=bool)
        is_sliding[sliding] = True
        # (x + y)^2 <= 2 x^2 + 2 y^2 where a clamp that moves is not coupled with its wire
        self._bend_share = 1.0 + (is_sliding[self._before] | is_sliding[self._inner] | is_sliding[self._after])
        self._stretch_share = 1.0 + (is_sliding[self._segment] | is_sliding[self._end])
        self._free = (rods.held & int(HELD_NODE)) == 0
        turns = (rods.held & int(HELD_TURN)) == 0
        self._next_free = self._free & (after >= 0) & self._free[after]
        self._second_free = self._free & (after >= 0) & (after[after] >= 0) & self._free[after[after]]
        self._next_turns = turns & (after >= 0) & (after[after] >= 0) & turns[after]
        wave, section = 2.0 * math.pi / wave_length, rods.section
        spacing = float(self._natural[self._segment].mean())
        self._slow_mass = section.bending_stiffness * wave**4 * spacing
        self._slow_inertia = section.twist_stiffness * wave**2 * spacing

    def at(
        self,
        *,
        stretch_stiffness: np.ndarray,
        turning: np.ndarray,
        moment: np.ndarray,
        tension: np.ndarray,
        contact: np.ndarray,
        contact_turn: np.ndarray,
        keeps_arc_length: bool,
    ) -> Masses:
        """The masses; arrays [node]: softened EA [N], turning angle [rad], moment [N m], tension [N], and the bounds of contact
        on the stiffness of a node (node, 3) [N/m] and of a section [N m]."""
        section, inner, before, after = self._rods.section, self._inner, self._before, self._after
        own, previous = self._natural[inner], self._natural[before]
        pull = MORE_TENSION * np.maximum(tension, 0.0)
        turn_square = (turning[inner] + MORE_TURN) ** 2
        # bending across
        stiffest = SLOPE_FACTOR * section.bending_stiffness
        bend = stiffest / self._node_length
        if keeps_arc_length:
            weight, next_weight = self._rods.bow_weights
            bend = bend + 2.0 * float(BOW) * (pull[before] * previous * next_weight[before] + pull[inner] * own * weight[inner])
        bend = (1.0 + TURNED) * self._bend_share * bend
        a, c = 1.0 / previous, 1.0 / own
        b = -(a + c)
        nodes = self._rods.node_count
        mass, next_mass, second_mass = (np.zeros(nodes) for _ in range(3))
        for node, weight in ((before, a), (inner, b), (after, c)):
            mass += np.bincount(node, bend * weight**2, nodes)
        next_mass += np.bincount(before, bend * a * b, nodes) + np.bincount(inner, bend * b * c, nodes)
        second_mass += np.bincount(before, bend * a * c, nodes)
        # along the segments
        turned = ((1.0 + 1.0 / TURNED) * stiffest + section.twist_stiffness) * turn_square / (2.0 * self._node_length)
        turned = turned + np.abs(moment[inner])
        edge = np.bincount(before, turned * a**2, nodes) + np.bincount(inner, turned * c**2, nodes)
        segment, end = self._segment, self._end
        edge = self._stretch_share * (edge + (stretch_stiffness + pull) / self._natural)[segment]
        mass += np.bincount(segment, edge, nodes) + np.bincount(end, edge, nodes)
        next_mass -= np.bincount(segment, edge, nodes)
        # twist
        twist = max(section.twist_stiffness, section.bending_stiffness) / self._node_length
        spin = np.bincount(before, twist, nodes) + np.bincount(inner, twist, nodes)
        next_spin = -np.bincount(before, twist, nodes)
        bent = stiffest * turn_square / (2.0 * self._node_length)
        spin += np.bincount(before, bent, nodes) + np.bincount(inner, bent, nodes)
        share, spin_share = (0.25 * MASS_MARGIN * (1.0 + x) for x in (COUPLING, 1.0 / COUPLING))
        return Masses(
            share * (mass[:, None] + contact + self._slow_mass),
            share * np.where(self._next_free, next_mass, 0.0),
            share * np.where(self._second_free, second_mass, 0.0),
            spin_share * (spin + contact_turn + self._slow_inertia),
            spin_share * np.where(self._next_turns, next_spin, 0.0),
        )


class MassProduct:
    """Products of the masses of the dynamics with motions."""

    def __init__(self, arrays: RodArrays, state: RodState) -> None:
        device, nodes = str(state.control.device), len(state.torque)
        self._move = wp.zeros(nodes, dtype=wp.vec3d, device=device)
        self._turn = wp.zeros(nodes, dtype=wp.float64, device=device)
        self._partial = wp.zeros(len(arrays.block_first), dtype=wp.float64, device=device)
        motion = {"move": self._move, "turn": self._turn, "partial": self._partial}
        self._sum = bind(sum_mass_products, len(self._partial), arrays, state, **motion).record(device)

    def twice_energy(self, move: np.ndarray, turn: np.ndarray) -> float:
        """v . M v + w . I w of motions (node, 3) and [node], zero where held."""
        store(self._move, move)
        store(self._turn, turn)
        self._sum.launch()
        return float(fetch(self._partial).sum())
