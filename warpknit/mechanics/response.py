"""Linear response of endless cloth: membrane stiffness, and the response within a repeat."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from .protocols import Mechanics

STRAIN = 2e-3  # strain increment of the finite differences
LEAST_STIFFNESS = 1e-2  # smallest eigenvalue of the tangent over the largest; lower ones are raised
UNCERTAINTY = 2.0  # the same over a negative one: in slack cloth the uncertainty of all
# nominal stress (2, 2) [N/m] of one periodic repeat in equilibrium, and what describes its state (`Mechanics.state_variables`)
CellState = tuple[np.ndarray, dict[str, np.ndarray]]
OF_BODIES = "body_"  # beginning of the names of fields of bodies


@dataclass
class Response:
    """Derivatives of endless cloth by its deformation gradient F at a load; see `find_response`."""

    KEPT = ("tangent", "change")

    tangent: np.ndarray  # (2, 2, 2, 2) [N/m] dP/dF, symmetric and positive; zero before the first load
    cell_node: wp.array  # [entry of the rest table] node of the repeat
    change: dict[str, wp.array]  # (4, ...) derivative of each field of a repeat by Fxx, Fxy, Fyx, Fyy
    no_change: wp.array  # (4, node of the repeat) zeros

    def of(self, name: str) -> wp.array:
        """(4, ...) derivative of a field; zero for one that does not respond."""
        return self.change.get(name, self.no_change)


def find_response(
    present: CellState,
    cell_at: Callable[[np.ndarray, float], CellState],
    cell: Any,
    gradient: np.ndarray,
    temperature: float,
    device: str,
) -> Response:
    """Response of endless cloth at a load. By finite differences of equilibria of one repeat, the model `cell`.

    present: the equilibrium at `gradient` (2, 2) and `temperature` [K]. cell_at: finds another one. device: of the mesh that
    responds; the repeat may have another.

    Raises `Diverged` where the repeat does not converge.
    """
    stress, values = present
    tangent = np.zeros((2, 2, 2, 2))
    change = {name: np.zeros((4, len(value))) for name, value in values.items()}
    for k, (c, d) in enumerate(np.ndindex(2, 2)):
        step = np.zeros((2, 2))
        step[c, d] = STRAIN
        there, moved = cell_at(gradient + step, temperature)
        tangent[:, :, c, d] = (there - stress) / STRAIN
        for name in values:
            change[name][k] = (moved[name] - values[name]) / STRAIN
    for name in ("x", "y", "z"):
        if name in change:
            drift = change[name].mean(axis=1, keepdims=True)  # remove rigid translation of the repeat
            for moving in (name, OF_BODIES + name):
                if moving in change:
                    change[moving] -= drift
    matrix = tangent.reshape(4, 4)
    eigenvalues, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    eigenvalues = np.maximum(eigenvalues, max(LEAST_STIFFNESS * eigenvalues.max(), -UNCERTAINTY * eigenvalues.min()))
    return _response(((vectors * eigenvalues) @ vectors.T).reshape(2, 2, 2, 2), change, cell, device)


def zero_response(repeat: Mechanics, device: str) -> Response:
    """Zero response of one repeat, for a mesh on the device."""
    change = {name: np.zeros((4, len(value))) for name, value in repeat.state_variables().items()}
    return _response(np.zeros((2, 2, 2, 2)), change, repeat.model, device)


def _response(tangent: np.ndarray, change: dict[str, np.ndarray], cell: Any, device: str) -> Response:
    table = cell.table
    ends = np.append(table.start[1:] - table.lead, len(table.x))
    entry = np.arange(len(table.x))
    thread = np.searchsorted(ends, entry, side="right")
    node = cell.panel.wire_first[thread] + np.mod(entry - table.start[thread], table.nodes[thread])
    return Response(
        tangent,
        wp.array(node.astype(np.int32), dtype=wp.int32, device=device),
        {name: wp.array(value, dtype=wp.float64, device=device) for name, value in change.items()},
        wp.zeros((4, cell.panel.node_count), dtype=wp.float64, device=device),
    )
