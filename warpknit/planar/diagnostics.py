"""Convergence check of worlds: sums over nodes and pairs, residual, damping.

They are summed on the device (kernels/sums.py, kernels/rayleigh.py); one row a wire and a few values are copied to the host.
Records use the full state on the host (observables.read). The first axis of an array on the host counts worlds; `rows` are
indices of some of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import warp as wp

from .. import measure
from ..compute.host import Entries, fetch
from ..compute.launch import Launch, bind
from ..compute.steering import Steering
from ..kernels import sums as k
from ..kernels.control import STRESS_UNIT
from ..kernels.rayleigh import sum_rayleigh
from ..mechanics.numerics import ENERGY_FLOOR, FORCE_FLOOR, LOCAL_ALLOWANCE, SLOWEST_WAVE, renewed_damping, slowest_damping
from .host_state import evaluation
from .model import Model
from .step import Stepper
from .world_step import WorldStepper

ROUND_OFF_RMS = 3.0  # rms residual over an edge's round-off: 1.7 of its length, two edges a force
ROUND_OFF_LARGEST = 4.0  # the same for the largest residual
ROUND_OFF_SHARE = 0.1  # of the mean contact force: larger round-off needs double precision


@dataclass(frozen=True)
class Sums:
    """Sums of a convergence check, by world."""

    strain_max: np.ndarray  # [row, wire] largest |strain| of an arc
    error_mean: np.ndarray  # [row, wire] |mean of strain - tension/EA|
    tension_max: np.ndarray  # [row, wire] [N]
    turning_max: np.ndarray  # [row, wire] [rad] largest change of a turning angle
    error_largest: np.ndarray  # [row] largest |strain - tension/EA| over all wires of the mesh
    error_square: np.ndarray  # [row] summed over all segments
    tension_largest: np.ndarray  # [row] [N]
    turning_largest: np.ndarray  # [row] [rad]
    tension_square: np.ndarray  # [row] [N2] over all segments
    turning_square: np.ndarray  # [row] [rad2] over all nodes
    closed: np.ndarray  # [row] pairs that carry force
    force_mean: np.ndarray  # [row] [N] of those
    gap_max: np.ndarray  # [row] [m] largest gap or overlap of those
    gap_square: np.ndarray  # [row] [m2] summed over those
    stress: np.ndarray  # (row, 2, 2) [N/m] nominal stress of the mesh; see `Observables.nominal_stress`

    def of(self, which: np.ndarray) -> Sums:
        """The sums of some of the rows."""
        return Sums(**{one.name: getattr(self, one.name)[which] for one in fields(self)})


class Diagnostics:
    """Evaluates worlds: forces, strains, tensions and turnings of the nodes stay on the device; see kernels/energy.py."""

    def __init__(self, stepper: WorldStepper) -> None:
        self.stepper, self.model = stepper, stepper.model
        model, worlds = self.model, len(stepper.states)
        panel, real, device = model.panel, model.precision.real, model.device
        names = ("force_x", "force_y", "strain", "tension", "turning")
        arrays = {name: wp.zeros((worlds, panel.node_count), dtype=real, device=device) for name in names}
        # of each world, arrays [node] as last evaluated: force_x, force_y [N], strain, tension [N], turning [rad]
        self.of_nodes = [{name: array[world] for name, array in arrays.items()} for world in range(worlds)]
        # pairs whose contact may reach over a held node
        first, count, held = panel.wire_first[panel.pair_wire], panel.wire_count[panel.pair_wire], panel.held_node
        low, high = panel.pair_seed + panel.pair_low - 1 - first, panel.pair_seed + panel.pair_high + 2 - first
        pair = np.flatnonzero(((low <= 1) | (high >= count - 2)) & (panel.pair_wire >= 0) & (len(held) > 0))
        self._held_entries = Entries(np.concatenate([held, np.maximum(held - 1, 0)]), device)
        self._clamp_pairs = Entries(pair, device) if len(pair) else None
        self._clamp_nodal = Entries((4 * pair[:, None] + np.arange(4)).ravel(), device) if len(pair) else None
        self._held_first = np.isin(panel.held_node, panel.wire_first)
        self._first_block = np.searchsorted(panel.block_wire, np.arange(len(panel.wire_first)))  # [wire]
        pair_blocks = max(1, -(-model.pair_count // k.PAIR_BLOCK))
        self._wires = wp.zeros((worlds, len(panel.block_first), k.WIRE_COLUMNS), dtype=wp.float64, device=device)
        self._pairs = wp.zeros((worlds, pair_blocks, k.PAIR_COLUMNS), dtype=wp.float64, device=device)
        self._squares = wp.zeros(len(panel.block_first), dtype=wp.float64, device=device)

    def sums(self, rows: np.ndarray) -> Sums:
        """Sums of the current states: wire rows of this rank's strip, all others of the global mesh."""
        self.stepper.run(rows, self._evaluate, self._sum)
        panel, ranks = self.model.panel, self.model.ranks
        wires, pairs = fetch(self._wires)[rows], fetch(self._pairs)[rows]
        largest = np.maximum.reduceat(wires, self._first_block, axis=1)
        error_sum = np.add.reduceat(wires[..., int(k.ERROR_SUM)], self._first_block, axis=1)
        total, contact = wires.sum(axis=1), pairs.sum(axis=1)
        stress = (total[:, int(k.WIRE_STRESS) :] + contact[:, int(k.PAIR_STRESS) :]).reshape(-1, 2, 2)
        unit = fetch(self.stepper.state.control)[rows, int(STRESS_UNIT)][:, None, None]
        if len(panel.held_node):
            # held nodes move with their clamp
            forces = np.stack([self._held_forces(row) for row in rows.tolist()])
            stress += np.rint(np.einsum("ria,ib->riab", forces, panel.held_lever) / unit[..., None]).sum(axis=1)
        sums = [total[:, int(column)] for column in (k.ERROR_SQUARE, k.TENSION_SQUARE, k.TURNING_SQUARE)]
        sums += [contact[:, int(column)] for column in (k.CLOSED, k.FORCE_SUM, k.GAP_SQUARE)]
        sums += [stress[:, a, b] for a, b in np.ndindex(2, 2)]
        error_square, tension_square, turning_square, closed, force, gap_square, *stresses = ranks.sum(np.stack(sums))
        most = [largest[..., int(column)].max(axis=1) for column in (k.ERROR_MAX, k.TENSION_MAX, k.TURNING_MAX)]
        *most, gap_max = ranks.largest(np.stack([*most, pairs[..., int(k.GAP_MAX)].max(axis=1)]))
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
            stress=np.stack(stresses, axis=-1).reshape(-1, 2, 2) * unit / panel.area,
        )

    def _evaluate(self, stepper: Stepper, part: int) -> list[Launch]:
        """Stage of work: forces, strains, tensions and turnings of the nodes."""
        state = stepper.state
        return [evaluation(self.model, state, self.of_nodes[stepper.world], stepper.blocks_of(part))]

    def _sum(self, stepper: Stepper, part: int) -> list[Launch]:
        """Launches of the sums of wires and pairs."""
        sources, world = (self.model.rest, self.model.mesh, stepper.state, self.model.constants), stepper.world
        block, blocks = stepper.blocks_of(part)
        pair, pairs = stepper.team.share(self._pairs.shape[1], part)
        rows = {"pair_block": k.PAIR_BLOCK, "partial": self._pairs[world]}
        return [
            bind(k.sum_wires, blocks, *sources, first_block=block, partial=self._wires[world], **self.of_nodes[world]),
            bind(k.sum_pairs, pairs, *sources, first_block=pair, **rows),
        ]

    def clamp_forces(self, world: int) -> np.ndarray:
        """(clamp, 2) [N] forces of the wires on their clamps, at the last check."""
        panel = self.model.panel
        total = np.zeros((len(panel.clamp_position), 2))
        np.add.at(total, panel.held_clamp, self._held_forces(world))
        return total

    def _held_forces(self, world: int) -> np.ndarray:
        """(held, 2) [N] forces of wires and contacts on held nodes."""
        state, node, of_nodes = self.stepper.states[world], self.model.panel.held_node, self.of_nodes[world]
        both = np.stack([self._held_entries.fetch(of_nodes[name]) for name in ("force_x", "force_y")], axis=1).astype(np.float64)
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

    def distance_from_chord(self, world: int) -> np.ndarray:
        """Rms distance of the nodes of a wire from its chord [wire] [m]."""
        model, state, panel, table = self.model, self.stepper.states[world], self.model.panel, self.model.table
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


class SlowestMode:
    """Damping near critical for the slowest active mode. By Rayleigh quotients of the change since the last check."""

    KEPT = ("_last",)

    def __init__(self, stepper: WorldStepper) -> None:
        self.stepper, self.model = stepper, stepper.model
        model, worlds = self.model, len(stepper.states)
        h = float(model.table.spacing.min())
        wave = SLOWEST_WAVE * model.scene.model.nodes_per_loop * h
        heaviest = 1.0 / float(model.rest.inverse_mass.numpy().min())
        self._slowest = slowest_damping(model.bending_stiffness, wave, h, heaviest)
        nodes, device = model.panel.node_count, model.device
        kinds = [model.precision.coordinate] * 2 + [model.precision.real] * 2
        self._last = [wp.zeros((worlds, nodes), dtype=kind, device=device) for kind in kinds]
        self._partial = wp.zeros((worlds, len(model.panel.block_first), 2), dtype=wp.float64, device=device)

    def measure(self, rows: np.ndarray) -> None:
        """Sum the changes since the last check, and store the states."""
        self.stepper.probe(rows, self._sum)

    def _sum(self, stepper: Stepper, part: int) -> list[Launch]:
        """Stage of work after the probe."""
        model, state, world, (block, blocks) = self.model, stepper.state, stepper.world, stepper.blocks_of(part)
        names = ("last_ux", "last_uy", "last_acceleration_x", "last_acceleration_y")
        kept = {name: array[world] for name, array in zip(names, self._last, strict=True)}
        return [
            bind(
                sum_rayleigh, blocks, model.rest, model.mesh, state, model.constants, self.stepper.accelerations[world],
                first_block=block, ux=state.node_ux[state.parity], uy=state.node_uy[state.parity],
                partial=self._partial[world], **kept,
            )
        ]  # fmt: skip

    def renew_damping(self, rows: np.ndarray, boundary: Sequence[np.ndarray] = ()) -> None:
        """Set the damping by the last sums; unchanged without motion. boundary: see `DrivenStrain.motion`."""
        steering, partial = self.stepper.state.steering, fetch(self._partial)
        blocks = partial[rows].swapaxes(0, 1)
        total = self.model.ranks.exact_sum(blocks.reshape(len(blocks), -1)).reshape(-1, 2)
        if len(boundary):
            total += np.stack(boundary, axis=1)
        renewed = renewed_damping(steering.damping[rows], total[:, 0], total[:, 1], self._slowest)
        steering.set(rows, damping=renewed)


def residual(model: Model, control: Steering, sums: Sums, axial: np.ndarray) -> np.ndarray:
    """[row] the larger of balance and motion, for solver.residual_tolerance.

    `axial` [row, wire] [N]: the stiffnesses of the dynamics.

    Balance: rms nodal residual over the mean contact force, and a share of the largest one, limited by round-off.
    Motion: root of kinetic over stored energy, which measures soft modes with small residual forces.
    """
    tolerance, mesh = model.scene.solver.residual_tolerance, model.global_model.panel
    scale = np.maximum(sums.force_mean, FORCE_FLOOR * measure.force_scale(model))
    round_off_rms, round_off_max = round_off(model, axial)
    free = mesh.node_count + mesh.body_count - len(mesh.held_node)
    rms, largest = np.sqrt(control.force_square / free), control.force_max
    limit = ROUND_OFF_SHARE * scale
    local = max(LOCAL_ALLOWANCE, free**0.25)  # one isolated residual changes the mean fourth power of all by this
    balance = np.maximum(
        rms / np.maximum(scale, np.minimum(round_off_rms, limit) / tolerance),
        largest / (local * np.maximum(scale, np.minimum(round_off_max, limit) / tolerance)),
    )
    h = float(model.table.spacing.min())
    stretch, bend = h / model.axial_stiffness, model.bending_stiffness / h
    stored = 0.5 * sums.tension_square * stretch + 0.5 * sums.turning_square * bend
    least = ENERGY_FLOOR * measure.energy_scale(model.global_model)
    motion = np.sqrt(0.5 * control.kinetic_twice / np.maximum(stored, least))
    return np.maximum(balance, motion)


def round_off(model: Model, axial: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """[row] residuals [N] due to round-off, rms and largest; `axial` as in `residual`."""
    # rounding of an edge times the stretching and the bending stiffness of a segment
    epsilon = float(np.finfo(np.float32 if model.precision.name == "single" else np.float64).eps) / 2
    bending = 4 * model.bending_stiffness / float(model.table.spacing.min()) ** 2
    force = epsilon * np.hypot(axial.astype(np.float64), bending)  # [row, wire]
    square = model.ranks.sum(np.sum(force**2 * model.panel.wire_count, axis=1)) / model.global_model.panel.node_count
    return ROUND_OFF_RMS * np.sqrt(square), ROUND_OFF_LARGEST * model.ranks.largest(force.max(axis=1))


def is_lost_in_round_off(model: Model, sums: Sums, axial: np.ndarray) -> np.ndarray:
    """[row] whether round-off exceeds the allowed out-of-balance forces; `axial` as in `residual`."""
    scale = np.maximum(sums.force_mean, FORCE_FLOOR * measure.force_scale(model))
    return np.asarray(round_off(model, axial)[0] > ROUND_OFF_SHARE * scale)
