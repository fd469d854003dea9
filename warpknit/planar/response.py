"""Linear response of endless cloth: membrane stiffness, and the response within a repeat."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import warp as wp

from ..mechanics import CellState
from .host_state import read_strip
from .join import Join
from .model import Model
from .state import State

STRAIN = 2e-3  # strain increment of the finite differences
LEAST_STIFFNESS = 1e-2  # smallest eigenvalue of the tangent over the largest; lower ones are raised


def state_variables(model: Model, state: State) -> dict[str, np.ndarray]:
    """Variables of a state of the global mesh, on all ranks.

    [node] and [body] displacements [m], [node] tension [N] and softened strain, [pair] offset [N].
    """
    host = read_strip(model, state)
    offset = state.tension_offset.numpy().astype(np.float64)
    strain = (host.tension - offset) / np.repeat(host.wire_axial, model.panel.wire_count)
    join = Join(model, everywhere=True)
    of_nodes = {"x": host.u[:, 0], "y": host.u[:, 1], "tension": host.tension, "strain": strain}
    of_bodies = {"body_x": host.body_u[:, 0], "body_y": host.body_u[:, 1]}
    return {
        **{name: join.nodes(values) for name, values in of_nodes.items()},
        **{name: join.bodies(values) for name, values in of_bodies.items()},
        "offset": join.pairs(host.pair_offset),
    }


@dataclass(frozen=True)
class Response:
    """Derivatives of endless cloth by its deformation gradient F at a load; see `find_response`."""

    tangent: np.ndarray  # (2, 2, 2, 2) [N/m] dP/dF, symmetric and positive
    cell_node: wp.array  # [entry of the rest table] node of the repeat
    change: dict[str, wp.array]  # (4, ...) derivative of each value of a repeat by Fxx, Fxy, Fyx, Fyy

    def state_dict(self) -> dict[str, np.ndarray]:
        """Arrays for a checkpoint."""
        return {"response_tangent": self.tangent} | {f"response_{name}": v.numpy().copy() for name, v in self.change.items()}

    @property
    def of_nodes(self) -> dict[str, wp.array]:
        """Derivatives of displacements [m], tension [N] and softened strain of the nodes, by the names of the kernels."""
        return {f"cell_{name}": self.change[name] for name in ("x", "y", "tension", "strain")}

    @property
    def of_bodies(self) -> dict[str, wp.array]:
        """Derivatives of displacements [m] of the bodies and of offsets [N] of their pairs, by the names of the kernels."""
        return {f"cell_{name.removeprefix('body_')}": self.change[name] for name in ("body_x", "body_y", "offset")}


def find_response(cell_at: CellState, cell: Model, gradient: np.ndarray, temperature: float) -> Response:
    """Response of endless cloth, by finite differences of equilibria of one repeat.

    Raises `Diverged` where the repeat does not converge.
    """
    stress, values = cell_at(gradient, temperature)
    tangent = np.zeros((2, 2, 2, 2))
    change = {name: np.zeros((4, len(value))) for name, value in values.items()}
    for k, (c, d) in enumerate(np.ndindex(2, 2)):
        step = np.zeros((2, 2))
        step[c, d] = STRAIN
        there, moved = cell_at(gradient + step, temperature)
        tangent[:, :, c, d] = (there - stress) / STRAIN
        for name in values:
            change[name][k] = (moved[name] - values[name]) / STRAIN
    for node, body in (("x", "body_x"), ("y", "body_y")):
        drift = change[node].mean(axis=1, keepdims=True)  # remove rigid translation of the repeat
        change[node] -= drift
        change[body] -= drift
    matrix = tangent.reshape(4, 4)
    eigenvalues, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    eigenvalues = np.maximum(eigenvalues, LEAST_STIFFNESS * eigenvalues.max())
    return Response(
        ((vectors * eigenvalues) @ vectors.T).reshape(2, 2, 2, 2),
        _node_of_entry(cell),
        {name: wp.array(value, dtype=wp.float64, device=cell.device) for name, value in change.items()},
    )


def zero_response(cell: Model) -> Response:
    """A response of zero."""
    nodes, bodies, pairs = cell.panel.node_count, cell.panel.body_count, cell.pair_count
    lengths = {"x": nodes, "y": nodes, "tension": nodes, "strain": nodes, "body_x": bodies, "body_y": bodies, "offset": pairs}
    change = {name: wp.zeros((4, count), dtype=wp.float64, device=cell.device) for name, count in lengths.items()}
    return Response(np.zeros((2, 2, 2, 2)), _node_of_entry(cell), change)


def load_response(kept: dict[str, np.ndarray], cell: Model) -> Response:
    """The response from its `state_dict` in a checkpoint."""
    response = zero_response(cell)
    for name, value in response.change.items():
        value.assign(kept[f"response_{name}"])
    return replace(response, tangent=kept["response_tangent"])


def _node_of_entry(cell: Model) -> wp.array:
    """[entry of the rest table] node of one repeat."""
    table = cell.table
    ends = np.append(table.start[1:] - table.lead, len(table.x))
    entry = np.arange(len(table.x))
    thread = np.searchsorted(ends, entry, side="right")
    node = cell.panel.wire_first[thread] + np.mod(entry - table.start[thread], table.nodes[thread])
    return wp.array(node.astype(np.int32), dtype=wp.int32, device=cell.device)
