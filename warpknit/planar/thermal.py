"""Thermal strain of the wires in a temperature field."""

from __future__ import annotations

import numpy as np

from .model import Model


def wire_thermal_strain(model: Model, temperature: float, gradient: tuple[float, float]) -> np.ndarray:
    """(wire, 2): relative excess of the length factor at the first node of each wire, and its increment a node.

    The temperature [K] is that of the centre of the panel, its gradient [K/m] is along weft and warp at rest. Along a wire it
    is interpolated linearly from end to end: the loops deviate from that by less than a stitch.
    """
    panel, table, wire = model.panel, model.table, model.scene.wire
    block = np.searchsorted(panel.block_wire, np.arange(len(panel.wire_first)))
    last_block = np.append(block[1:], len(panel.block_wire)) - 1
    middle = panel.low + 0.5 * panel.size
    excess = []
    for b, entry in (
        (block, panel.block_table[block]),
        (last_block, panel.block_table[last_block] + panel.block_count[last_block] - 1),
    ):
        place = np.stack([table.x[entry], table.y[entry]], axis=1) + panel.block_origin[b] - middle
        excess.append(place @ np.array(gradient))
    factor = wire.length_factor(temperature)
    first, last = (wire.expansion * e / factor for e in excess)
    return np.stack([first, (last - first) / (panel.wire_count - 1)], axis=1)
