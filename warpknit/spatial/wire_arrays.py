"""Rest data of wires that contact reads, on the device."""

from __future__ import annotations

from dataclasses import dataclass

import warp as wp

from ..compute.host import shared
from ..kernels.wire_curve import Bump
from .rest_curve import RestCurve
from .rods import Rods


@dataclass(frozen=True)
class WireArrays:
    """Arrays [node] unless noted; the curve is that on which wires touch."""

    node_arc: wp.array  # [m]
    node_radius: wp.array  # [m]
    rest_slope: wp.array
    rest_bump: wp.array
    rest_bulge: wp.array
    slope_weight: wp.array
    wire_length: wp.array  # [wire] [m]
    wire_period: wp.array  # [wire] [m]

    @classmethod
    def of(cls, rods: Rods, curve: RestCurve, device: str) -> WireArrays:
        """Arrays of rods that touch on a curve."""
        return cls(
            node_arc=shared(rods.arc, wp.float64, device),
            node_radius=shared(rods.wire_radius[rods.wire_of], wp.float64, device),
            rest_slope=shared(curve.slope, wp.vec2d, device),
            rest_bump=shared(curve.bump, Bump, device),
            rest_bulge=shared(curve.bulge, wp.float64, device),
            slope_weight=shared(curve.slope_weight, wp.vec4d, device),
            wire_length=shared(rods.wire_length, wp.float64, device),
            wire_period=shared(rods.wire_period, wp.vec3d, device),
        )
