"""Diagnostics of a state between steps: sums over nodes and pairs for a convergence check.

They are summed on the device (kernels/sums.py); one row a wire and a few values are copied to the host. Records use
the full state on the host (observables.read).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from ..compute.host import Entries, fetch
from ..compute.launch import Launch, bind
from ..kernels import sums as k
from ..mesh.panel import Panel
from .host_state import evaluation
from .model import Model
from .state import State
from .step import Stepper


@dataclass(frozen=True)
class Sums:
    """Sums of a convergence check; with replicas the first axis is the replica, scalars are arrays [replica]."""

    strain_max: np.ndarray  # [wire] largest |strain| of an arc
    error_mean: np.ndarray  # [wire] |mean of strain - tension/EA|
    tension_max: np.ndarray  # [wire] [N]
    turning_max: np.ndarray  # [wire] [rad] largest change of a turning angle
    error_largest: np.ndarray | float  # largest |strain - tension/EA| over all wires of the mesh
    error_square: np.ndarray | float  # summed over all segments
    tension_largest: np.ndarray | float  # [N]
    turning_largest: np.ndarray | float  # [rad]
    tension_square: np.ndarray | float  # [N2] over all segments
    turning_square: np.ndarray | float  # [rad2] over all nodes
    closed: np.ndarray | float  # pairs that carry force
    force_mean: np.ndarray | float  # [N] of those
    gap_max: np.ndarray | float  # [m] largest gap or overlap of those
    gap_square: np.ndarray | float  # [m2] summed over those
    stress: np.ndarray  # (2, 2) [N/m] nominal stress of the mesh; see `Observables.nominal_stress`


def first_blocks(panel: Panel) -> np.ndarray:
    """[wire] first block of each wire."""
    return np.searchsorted(panel.block_wire, np.arange(len(panel.wire_first)))


def sum_up(model: Model, first: np.ndarray, wires: np.ndarray, pairs: np.ndarray, held_stress: np.ndarray) -> Sums:
    """Sums of the partial sums of kernels/sums.py: rows (..., block, WIRE_COLUMNS) and (..., pair block, PAIR_COLUMNS).

    `first` [wire]: see `first_blocks`.
    `held_stress` (..., 2, 2) [N m] is the contribution of held nodes. A leading axis counts replicas.
    """
    panel, ranks = model.panel, model.ranks
    largest = np.maximum.reduceat(wires, first, axis=-2)
    error_sum = np.add.reduceat(wires[..., int(k.ERROR_SUM)], first, axis=-1)
    total, contact = wires.sum(axis=-2), pairs.sum(axis=-2)
    stress = total[..., int(k.WIRE_STRESS) :] + contact[..., int(k.PAIR_STRESS) :]
    stress = stress.reshape(*stress.shape[:-1], 2, 2) + held_stress
    sums = [total[..., int(column)] for column in (k.ERROR_SQUARE, k.TENSION_SQUARE, k.TURNING_SQUARE)]
    sums += [contact[..., int(column)] for column in (k.CLOSED, k.FORCE_SUM, k.GAP_SQUARE)]
    sums += [stress[..., a, b] for a, b in np.ndindex(2, 2)]
    error_square, tension_square, turning_square, closed, force, gap_square, *stresses = ranks.sum(np.stack(sums))
    most = [largest[..., int(column)].max(axis=-1) for column in (k.ERROR_MAX, k.TENSION_MAX, k.TURNING_MAX)]
    *most, gap_max = ranks.largest(np.stack([*most, pairs[..., int(k.GAP_MAX)].max(axis=-1)]))
    return Sums(
        strain_max=largest[..., int(k.STRAIN_MAX)],
        error_mean=np.abs(error_sum) / panel.wire_count,
        tension_max=largest[..., int(k.TENSION_MAX)],
        turning_max=largest[..., int(k.TURNING_MAX)],
        error_largest=most[0],
        error_square=error_square,
        tension_largest=most[1],
        turning_largest=most[2],
        tension_square=tension_square,
        turning_square=turning_square,
        closed=closed,
        force_mean=force / np.maximum(1.0, closed),
        gap_max=gap_max,
        gap_square=gap_square,
        stress=np.stack(stresses, axis=-1).reshape(stress.shape) / panel.area,
    )


class Diagnostics:
    """`strain`, `tension` and `turning` of the last check stay on the device, [node]; see kernels/energy.py."""

    def __init__(self, model: Model, state: State, stepper: Stepper) -> None:
        self.model = model
        self.state = state
        panel, real, device = model.panel, model.precision.real, model.device
        names = ("force_x", "force_y", "strain", "tension", "turning")
        arrays = {name: wp.zeros(panel.node_count, dtype=real, device=device) for name in names}
        self._force_x, self._force_y, self.strain, self.tension, self.turning = arrays.values()
        self.stepper, self._arrays = stepper, arrays
        pair, held = _pairs_at_clamps(model), panel.held_node
        self._held_entries = Entries(np.concatenate([held, np.maximum(held - 1, 0)]), device)
        self._clamp_pairs = Entries(pair, device) if len(pair) else None
        self._clamp_nodal = Entries((4 * pair[:, None] + np.arange(4)).ravel(), device) if len(pair) else None
        self._held_first = np.isin(panel.held_node, panel.wire_first)
        self._first_block = first_blocks(panel)
        self._wires = wp.zeros((len(panel.block_first), k.WIRE_COLUMNS), dtype=wp.float64, device=device)
        self._pairs = wp.zeros((max(1, -(-model.pair_count // k.PAIR_BLOCK)), k.PAIR_COLUMNS), dtype=wp.float64, device=device)
        self._squares = wp.zeros(len(panel.block_first), dtype=wp.float64, device=device)

    def sums(self) -> Sums:
        """Diagnostics of the current state: wire rows of this rank's strip, all other sums of the global mesh."""
        self.stepper.run(self.evaluate, self.sum)
        return self.last_sums()

    def last_sums(self) -> Sums:
        """Those of the state in which the stages `evaluate` and `sum` were run last."""
        return sum_up(self.model, self._first_block, *self.partial_sums())

    def evaluate(self, stepper: Stepper, part: int) -> list[Launch]:
        """Stage of work: forces, strains, tensions and turnings of the nodes."""
        return [evaluation(self.model, self.state, self.state.parity, self._arrays, stepper.blocks_of(part))]

    def sum(self, stepper: Stepper, part: int) -> list[Launch]:
        """Stage of work: their sums, and those of the pairs."""
        sources = (self.model.rest, self.model.mesh, self.state, self.model.constants)
        block, blocks = stepper.blocks_of(part)
        pair, pairs = stepper.team.share(self._pairs.shape[0], part)
        rows = {"pair_block": k.PAIR_BLOCK, "partial": self._pairs}
        return [
            bind(k.sum_wires, blocks, *sources, first_block=block, partial=self._wires, **self._arrays),
            bind(k.sum_pairs, pairs, *sources, first_block=pair, **rows),
        ]

    def partial_sums(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Partial sums of the last check, for `sum_up`: of wires, of pairs, of held nodes."""
        return fetch(self._wires), fetch(self._pairs), self.held_stress()

    def held_stress(self) -> np.ndarray:
        """(2, 2) [N m] contribution of held nodes, which move with their clamp."""
        panel = self.model.panel
        if not len(panel.held_node):
            return np.zeros((2, 2))
        return np.einsum("ia,ib->ab", self._held_forces(), panel.held_lever)

    def clamp_forces(self) -> np.ndarray:
        """(clamp, 2) [N] forces of the wires on their clamps, at the last check."""
        panel = self.model.panel
        total = np.zeros((len(panel.clamp_position), 2))
        np.add.at(total, panel.held_clamp, self._held_forces())
        return total

    def _held_forces(self) -> np.ndarray:
        """(held, 2) [N] forces of wires and contacts on held nodes."""
        state, node = self.state, self.model.panel.held_node
        both = np.stack([self._held_entries.fetch(array) for array in (self._force_x, self._force_y)], axis=1).astype(np.float64)
        force, before = both[: len(node)], both[len(node) :]
        before[self._held_first] = 0.0
        total = force - before
        if self._clamp_pairs is None or self._clamp_nodal is None:
            return total
        # contacts that reach over a held node
        acts = self._clamp_pairs.fetch(state.pair_force) > 0
        reached = self._clamp_pairs.fetch(state.pair_node)[acts][:, None] + np.arange(-1, 3)
        place = np.minimum(np.searchsorted(node, reached), len(node) - 1)
        held = node[place] == reached
        nodal = [self._clamp_nodal.fetch(array).reshape(-1, 4)[acts] for array in (state.pair_nodal_x, state.pair_nodal_y)]
        np.add.at(total, place[held], np.stack(nodal, axis=2)[held])
        return total

    def distance_from_chord(self) -> np.ndarray:
        """[wire] [m] root mean square distance of the nodes of a wire from the straight line through its ends."""
        model, state, panel, table = self.model, self.state, self.model.panel, self.model.table
        unit, now = model.precision.unit, state.parity
        ux, uy = state.node_ux[now], state.node_uy[now]
        first, last = panel.wire_first, panel.wire_first + panel.wire_count - 1
        block = self._first_block
        last_block = np.append(block[1:], len(panel.block_wire)) - 1
        host_x, host_y = ux.numpy(), uy.numpy()

        def place(block: np.ndarray, node: np.ndarray) -> np.ndarray:
            entry = panel.block_table[block] + node - panel.block_first[block]
            return np.stack([table.x[entry], table.y[entry]], axis=1) + panel.block_origin[block]

        start = place(block, first)
        gradient = state.gradient
        moved = np.stack([host_x[last] - host_x[first], host_y[last] - host_y[first]], axis=1).astype(np.float64) * unit
        chord = np.einsum("ab,ib->ia", gradient, place(last_block, last) - start) + moved
        length = np.maximum(np.hypot(chord[:, 0], chord[:, 1]), 1e-30)
        normal = np.stack([-chord[:, 1], chord[:, 0]], axis=1) / length[:, None]
        starts: wp.array = wp.array(start, dtype=wp.vec2d, device=model.device)
        normals: wp.array = wp.array(normal, dtype=wp.vec2d, device=model.device)
        bind(
            k.sum_distances_from_chords, len(panel.block_first), model.rest, model.mesh, model.constants, ux=ux, uy=uy,
            start=starts, normal=normals, gradient=wp.mat22d(*gradient.ravel()), square=self._squares,
        ).run(model.device)  # fmt: skip
        return np.sqrt(np.add.reduceat(self._squares.numpy(), block) / panel.wire_count)


def _pairs_at_clamps(model: Model) -> np.ndarray:
    """Pairs whose contact may reach over a held node."""
    panel = model.panel
    if not len(panel.held_node):
        return np.zeros(0, dtype=np.int64)
    first, count = panel.wire_first[panel.pair_wire], panel.wire_count[panel.pair_wire]
    low, high = panel.pair_seed + panel.pair_low - 1 - first, panel.pair_seed + panel.pair_high + 2 - first
    return np.nonzero(((low <= 1) | (high >= count - 2)) & (panel.pair_wire >= 0))[0]
