"""Thermal strain of the segments in a temperature field, relative to the temperature at the middle of the mesh."""

from __future__ import annotations

import numpy as np

from .model import SpatialModel


def segment_thermal_strain(model: SpatialModel, temperature: float, gradient: np.ndarray) -> np.ndarray:
    """[node] thermal strain of the segment behind each node, relative to the middle of the panel.

    temperature [K] at the middle of the panel; its gradient (2,) [K/m] along weft and warp at rest.
    """
    wire, panel = model.scene.wire, model.panel
    middle = model.rods.position[:, :2] + 0.5 * model.rods.rest_edge[:, :2]
    excess = (middle - (np.asarray(panel.low) + 0.5 * np.asarray(panel.size))) @ gradient
    return wire.expansion * excess / wire.length_factor(temperature)
