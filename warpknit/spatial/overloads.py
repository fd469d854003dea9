"""The overloads of the kernels of rods in a precision.

A module is compiled with the overloads that are known when it is loaded, and anew for each one that comes later: all of a
precision are declared before the first launch.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import warp as wp

from ..compute.precision import DOUBLE, Precision
from ..kernels import (
    banded_mass,
    contact_checks,
    membrane_transfer,
    rod_border,
    rod_checks,
    rod_clamps,
    rod_forces,
    rod_frames,
    rod_masses,
    rod_motion,
    rod_sums,
    rod_turns,
    wire_closest,
    wire_contact_by_batch,
    wire_contact_forces,
    wire_pairs,
)

KERNELS = (
    banded_mass.factor_masses,
    banded_mass.factor_borders,
    contact_checks.bound_contact_stiffness,
    membrane_transfer.gather_forces,
    rod_border.copy_nodes,
    rod_checks.sum_states,
    rod_checks.find_motion,
    rod_checks.keep_motion,
    rod_checks.slow_motion,
    rod_clamps.move_clamps,
    rod_forces.find_rod_forces,
    rod_frames.update_frames,
    rod_masses.find_masses,
    rod_motion.move_rods,
    rod_sums.sum_mass_products,
    rod_turns.find_turns,
    rod_turns.turn_sections,
    wire_closest.mark_near_pairs,
    wire_closest.find_closest_places,
    wire_contact_by_batch.find_followed_contacts,
    wire_contact_forces.find_contact_forces,
    wire_pairs.place_segments_in_hash,
    wire_pairs.find_segment_pairs,
)
NUMBERS = ("pending_turn", "spin", "angle", "torque", "turn")  # the other arguments of any type are vectors
OF_FOUR = ("mass_factor", "mass_border", "sweep")


@cache
def declare_overloads(precision: Precision) -> None:
    """Declare the overloads of KERNELS for the arrays of rods in this precision."""
    for kernel in KERNELS:
        _declare(kernel, precision)
    _declare(rod_sums.sum_mass_products, DOUBLE)  # of motions between checks


def _declare(kernel: wp.Kernel, precision: Precision) -> None:
    types: dict[str, Any] = {}
    for argument in kernel.adj.args:
        name, kind = argument.label, precision.vec3
        if name in NUMBERS:
            kind = precision.real
        elif name in OF_FOUR:
            kind = precision.vec4
        if isinstance(argument.type, wp.array) and argument.type.dtype is Any:
            types[name] = wp.array(dtype=kind, ndim=argument.type.ndim)
    wp.overload(kernel, types)
