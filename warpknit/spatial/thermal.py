"""Temperatures that differ from place to place: how much longer each segment is there than at the temperature of the middle."""

from __future__ import annotations

import numpy as np

from .model import SpatialModel


def segment_thermal_strain(mesh: SpatialModel, temperature: float, gradient: np.ndarray) -> np.ndarray:
    """[node] excess of the length factor over that of the middle, relative, of the segment behind each node.

    The temperature [K] is that of the middle of the panel, its gradient (2,) [K/m] is along weft and warp at rest.
    """
    wire, panel = mesh.scene.wire, mesh.panel
    middle = mesh.rods.position[:, :2] + 0.5 * mesh.rods.rest_edge[:, :2]
    excess = (middle - (np.asarray(panel.low) + 0.5 * np.asarray(panel.size))) @ gradient
    return wire.expansion * excess / wire.length_factor(temperature)
