"""Values at the nodes of the rods and at those of the panel (mesh/panel.py), which divide clamped wires differently."""

from __future__ import annotations

import numpy as np
import warp as wp

from ..compute.host import take
from ..compute.launch import bind
from ..kernels.resample import resample_along_wires
from .model import SpatialModel


class PanelNodes:
    """Resamples values of nodes or segments along the wires."""

    def __init__(self, model: SpatialModel) -> None:
        self._device = device = model.device
        panel, rods, wires = model.panel, model.rods, model.wires
        self._is_same = wires.panel_begin is None
        if wires.panel_begin is None or wires.panel_step is None:
            return

        def index(values: np.ndarray) -> wp.array:
            return wp.array(values, dtype=wp.int32, device=device)

        def real(values: np.ndarray) -> wp.array:
            return wp.array(values, dtype=wp.float64, device=device)

        rod_first, panel_first = index(rods.wire_first), index(panel.wire_first)
        self._rods_from_panel = {
            "node_wire": index(rods.wire_of),
            "wire_first": rod_first,
            "other_first": panel_first,
            "other_count": index(panel.wire_count),
            "wire_begin": real(-wires.panel_begin / wires.panel_step),
            "wire_step": real(1.0 / wires.panel_step),
        }
        self._panel_from_rods = {
            "node_wire": index(np.repeat(np.arange(len(panel.wire_first)), panel.wire_count)),
            "wire_first": panel_first,
            "other_first": rod_first,
            "other_count": index(rods.wire_count),
            "wire_begin": real(wires.panel_begin),
            "wire_step": real(wires.panel_step),
        }

    def of_rods(self, values: np.ndarray, *, of_segments: bool = False) -> np.ndarray:
        """[rod node] from values [panel node]."""
        return values if self._is_same else self._resampled(self._rods_from_panel, values, of_segments)

    def of_panel(self, values: np.ndarray, *, of_segments: bool = False) -> np.ndarray:
        """[panel node] from values [rod node]."""
        return values if self._is_same else self._resampled(self._panel_from_rods, values, of_segments)

    def _resampled(self, arrays: dict[str, wp.array], values: np.ndarray, of_segments: bool) -> np.ndarray:
        other: wp.array = wp.array(values, dtype=wp.float64, device=self._device)
        value: wp.array = wp.zeros(len(arrays["node_wire"]), dtype=wp.float64, device=self._device)
        bind(resample_along_wires, len(value), of_segments=int(of_segments), other=other, value=value, **arrays).run(self._device)
        return take(value)
