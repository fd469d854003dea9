"""Fictitious masses of rods, with which steps of one second are stable.

They are banded along the wire. A diagonal mass that bounds the bending stiffness EI/h^3 of the shortest waves makes long waves
slow: their steps grow with the square of the nodes. A mass that is itself a difference operator along the wire moves waves of
all lengths at about the same rate (selective mass scaling: Olovsson, Simonsson and Unosson, Int. J. Numer. Methods Eng. 63,
2005). Per node n between segments a and b, with turning angle p, moment m and lengths l, and per segment with axial stiffness K
and tension T, the stiffness is bounded by

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
first and 1 + 1/COUPLING times the second. A quarter of the bound is the mass at the stability limit (kernels/rod_masses.py).

A uniform mass moves waves longer than `wave_length`, which carry almost no force.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import warp as wp

from ..compute.host import fetch, lanes, store, store_at, zeros
from ..kernels.rod_blocks import ROD_LANES
from ..kernels.rod_checks import slow_motion
from ..kernels.rod_masses import find_masses
from ..kernels.rod_sums import sum_mass_products
from ..mechanics.numerics import MASS_MARGIN, SPEED_SHARE
from .rod_step import CHECK_STEPS, EVALUATED, RodStepper
from .rods import Rods
from .step_bound import SLOPE_FACTOR

COUPLING = 0.5  # of displacements and twist
APPROACH = 2.4  # of two wires, over the largest displacement
# thicknesses: largest displacement a step of wires that may touch, and the least limit; up to FASTER times the speed
CONTACT_SPEED, LEAST_SPEED, FASTER = 0.1, 0.001, 1.5


class FictitiousMasses:
    """Masses of the dynamics of rods (kernels/banded_mass.py), the limit of speed, and kinetic energies."""

    def __init__(
        self, stepper: RodStepper, wave_length: float | None, spacing_of: Rods | None, *, keeps_arc_length: bool
    ) -> None:
        """wave_length, spacing_of: see `RodRelaxation`; keeps_arc_length: whether tensions strain the arcs of the segments."""
        self._stepper = stepper
        rods, device, mesh, clamps = stepper.rods, stepper.device, stepper.strip.whole, stepper.clamps
        spaced = spacing_of or mesh
        spacing = spaced.natural_length[spaced.following >= 0]
        least = float(spacing.min())
        limit = math.inf if stepper.contact is None else CONTACT_SPEED * rods.section.thickness
        self._largest_move = min(SPEED_SHARE * least, limit)  # [m] a step
        stepper.steering.set(drive=0.0, step_limit=least)
        is_sliding = np.zeros(rods.node_count, dtype=np.int32)
        if clamps is not None:
            is_sliding[clamps.sliding_node] = 1
        wave = 2.0 * math.pi / (float(mesh.wire_length.max()) if wave_length is None else wave_length)
        share, spin_share = (0.25 * MASS_MARGIN * (1.0 + x) for x in (COUPLING, 1.0 / COUPLING))
        constants = {"slope_factor": SLOPE_FACTOR, "hardening": rods.section.hardening, "spacing": float(spacing.mean())}
        constants |= {"share": share, "spin_share": spin_share, "wave_square": wave**2, "wave_fourth": wave**4}
        self._bound: dict[str, Any] = {name: wp.float64(value) for name, value in constants.items()}
        self._bound |= {"keeps_arc_length": wp.int32(keeps_arc_length), "threads_a_block": lanes(ROD_LANES, device)}
        self._bound["is_sliding"] = wp.array(is_sliding, dtype=wp.int32, device=device)
        self._slowed = zeros(stepper.worlds, wp.float64, device)  # [world] by which velocities are multiplied
        self._partial = zeros(len(stepper.arrays.block_first), wp.float64, device)  # [block]
        self._launch = stepper.launcher()

    def renew(self, rows: np.ndarray | None = None, *, loading: bool | np.ndarray = False) -> None:
        """Evaluate the state and renew its masses, without more kinetic energy. Of all worlds, or of `rows`.

        The speed is limited so that only contacts that the masses allow for can touch until the next convergence check. While
        loading [row], wires may move at any speed.
        """
        stepper, clamps = self._stepper, self._stepper.clamps
        with stepper.only(rows) as own:
            move = np.full(len(own), self._largest_move)
            if stepper.contact is not None:
                thickness = stepper.rods.section.thickness
                slow = np.maximum(FASTER * stepper.steering.speed_max[own], LEAST_SPEED * thickness)
                move = np.where(np.broadcast_to(loading, own.shape), move, np.minimum(move, slow))
                approach = np.minimum(APPROACH * CHECK_STEPS * move, EVALUATED * thickness)
                stepper.contact.list_near_pairs(CHECK_STEPS * move, own)
                stepper.evaluate(approach, rows=own)
                stepper.contact.bound_stiffness(own)
            else:
                stepper.evaluate(rows=own)
            stepper.steering.set(own, speed_limit=move)
            before = self.twice_kinetic_energy(own)
            self._set()
            now = self.twice_kinetic_energy(own)
            if np.any(now > before):
                slower = np.ones(stepper.worlds)
                slower[own] = np.sqrt(np.divide(before, now, out=np.ones(len(own)), where=now > before))
                store(self._slowed, slower)
                self._launch("slower", slow_motion, slowed=self._slowed)
                if clamps is not None:
                    each = len(fetch(clamps.velocity)) // stepper.worlds
                    store(clamps.velocity, np.repeat(slower, each) * fetch(clamps.velocity))

    def _set(self) -> None:
        """Set masses for the state last evaluated, by the bound above."""
        touches, threads = self._stepper.contact is not None, self._bound["threads_a_block"]
        self._launch(f"masses {touches}", find_masses, threads=threads, may_touch=wp.int32(touches), **self._bound)
        self._stepper.factor_masses()

    def twice_energy(self, move: wp.array, turn: wp.array, name: str, rows: np.ndarray) -> np.ndarray:
        """[row] [J] v . M v + w . I w of motions (node, 3) and [node]; `name` of both arrays."""
        self._launch(name, sum_mass_products, move=move, turn=turn, partial=self._partial)
        return self._stepper.sums.total(fetch(self._partial)[:, None], rows)[:, 0]

    def twice_kinetic_energy(self, rows: np.ndarray) -> np.ndarray:
        """[row] [J] of nodes and sections, with sliding clamps."""
        state, clamps = self._stepper.state, self._stepper.clamps
        if clamps is None or not clamps.need_forces:
            return self.twice_energy(state.velocity, state.spin, "energy", rows)
        velocity = fetch(state.velocity).copy()
        store_at(state.velocity, (clamps.sliding_node, 1), fetch(clamps.velocity)[clamps.sliding][:, None])
        energy = self.twice_energy(state.velocity, state.spin, "energy", rows)
        store(state.velocity, velocity)
        return energy
