"""Two hooked spatial wires: arcs of a hook (mesh/hook_mesh.py), turned to pass over and under.

In the planar model both arcs lie in one plane and cross twice. Here each arc is tilted about the horizontal axis through the
middle of the hook, the two in opposite directions: at the lower crossing the left wire lies `hook.crossing_distance` above the
right one, at the upper crossing as much below it. With the same order at both crossings the wires would not be hooked.
"""

from __future__ import annotations

import math

import numpy as np

from ..mesh.hook_mesh import LEFT, LEFT_TOP, RIGHT, RIGHT_TOP, Arc
from ..mesh.panel import Panel
from ..scene import Hook
from .placed_wires import SpatialWires, WireForms, line_along
from .rest_curve import CentreLine

BETWEEN = 0.5  # segments from the planar nodes, one at the clamp, to the nodes here, with the clamp midway between two


def tilt(hook: Hook) -> float:
    """[rad] tilt of each arc out of the plane."""
    assert hook.crossing_distance is not None
    half = hook.radius * math.sin(math.acos(1.0 - 0.5 * hook.overlap / hook.radius))
    return math.asin(0.5 * hook.crossing_distance / half)


class TiltedArc:
    """Centre line of a wire by its arc length s [m] from the lower clamp."""

    def __init__(self, hook: Hook, wire: int, angle: float) -> None:
        """angle [rad]: tilt of the upper end out of the plane."""
        self._arc, self._half, self._middle = Arc(hook, wire), 0.5 * hook.length, 0.5 * hook.height
        self._bulge, self._radius = self._arc.bulge, hook.radius
        self._up = np.array([math.cos(angle), math.sin(angle)])

    def __call__(self, s: np.ndarray) -> np.ndarray:
        """Points (m, 3) [m]."""
        place = self._arc(s)
        tilted = self._up * (place[:, 1:2] - self._middle)
        return np.column_stack([place[:, 0], self._middle + tilted[:, 0], tilted[:, 1]])

    def slope(self, s: np.ndarray) -> np.ndarray:
        """Unit vectors (m, 3) along it."""
        t = (np.asarray(s) - self._half) / self._radius
        return np.column_stack([-self._bulge * np.sin(t), np.cos(t)[:, None] * self._up])


def hook_wires(hook: Hook, panel: Panel, segments: int) -> SpatialWires:
    """Both wires with `segments` equal segments; each clamp is in the middle of one more segment."""
    step = hook.length / segments
    along = (np.arange(segments + 2) - 0.5) * step
    arcs = (TiltedArc(hook, LEFT, -tilt(hook)), TiltedArc(hook, RIGHT, tilt(hook)))
    lines = [line_along(arc, arc.slope(along), along, step) for arc in arcs]
    count = segments + 2
    held = np.array([[0, 1, count - 2, count - 1], [count, count + 1, 2 * count - 2, 2 * count - 1]])
    points = tuple(arc(along) for arc in arcs)
    lever = np.concatenate(points)[held.ravel(), :2] - np.repeat(panel.clamp_position, 2, axis=0)
    return SpatialWires(
        tile=np.zeros(3),
        forms=WireForms(points, CentreLine.joined(lines), np.arange(2), np.zeros((2, 3))),
        held_node=held.ravel(),
        held_lever=lever,
        held_section=held[:, [0, 2]].ravel(),
        site_wire=np.array([[LEFT, RIGHT]]),
        site_seed=(panel.pair_seed - panel.wire_first[panel.pair_wire] - BETWEEN)[None],
        site_low=panel.pair_low[None].astype(float),
        site_high=panel.pair_high[None].astype(float),
        sliding_clamp=np.array([LEFT_TOP, RIGHT_TOP]),
    )
