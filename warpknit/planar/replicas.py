"""Replicas: many independent states of one model under different loads, side by side.

One launch steps all of them (kernels/replica_steps.py), and convergence checks are vectorised over them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, nullcontext
from functools import partial

import numpy as np
import warp as wp

from ..compute.launch import bind, replay
from ..compute.steering import Steering
from ..kernels.replica_steps import step_replicas
from ..mechanics.numerics import CORES, thread_count
from ..mechanics.protocols import Check
from .diagnostics import Sums, first_blocks, sum_up
from .mechanics import NEARLY_CONVERGED, PlanarMechanics
from .model import Model, body_blocks, contact_batches
from .multiplier_rules import MultiplierRules
from .state import State, initial_state
from .step import PROBING, Stage, contact_stage


class Replicas:
    """`count` replicas in the initial state, stepped together on the CPU.

    `state` has the replica as the first axis of every array (`initial_state`); `states` are its rows.
    """

    def __init__(self, model: Model, count: int, *, threads: int | None = None) -> None:
        """`threads` share the replicas; default: WARPKNIT_THREADS, or one a core."""
        self.model = model
        self.state = initial_state(model, replicas=count)
        coordinate, nodes, device = model.precision.coordinate, model.panel.node_count, model.device
        self._ux, self._uy = (wp.zeros((2, count, nodes), dtype=coordinate, device=device) for _ in range(2))
        self.state.node_ux = [self._ux[0], self._ux[1]]
        self.state.node_uy = [self._uy[0], self._uy[1]]
        self.states: list[State] = [self.state.replica(r) for r in range(count)]
        self._parity = wp.zeros(count, dtype=wp.int32, device=device)
        self._last_step = wp.zeros(count, dtype=wp.float64, device=device)
        self.threads = min(threads, len(CORES), count) if threads else thread_count(count)
        self._rows = [wp.zeros(count, dtype=wp.int32, device=device) for _ in range(self.threads)]
        self._launches = [self._record(rows) for rows in self._rows]
        self._pool = ThreadPoolExecutor(self.threads, "replicas")

    def step(self, rows: np.ndarray, last_step: np.ndarray) -> None:
        """Step replicas `rows` until each has taken `last_step` steps (row,) since its start, or is frozen."""
        self._last_step.numpy()[rows] = last_step
        launches = []
        for part, launch in enumerate(self._launches):
            mine = rows[part :: self.threads]
            self._rows[part].numpy()[: len(mine)] = mine
            if len(mine):
                launch.set_dim(len(mine))
                launches.append(launch.launch)
        self.together(launches)
        parity = self._parity.numpy()
        for row in rows.tolist():
            self.states[row].parity = int(parity[row])

    def together(self, parts: Sequence[Callable[[], object]]) -> None:
        """Call all parts, several at a time, and return when all are done."""
        waiting = [self._pool.submit(part) for part in parts[1:]]
        if parts:
            parts[0]()
        for one in waiting:
            one.result()

    @property
    def status(self) -> np.ndarray:
        """[replica] STATUS of kernels/control.py."""
        return self.state.steering.status

    def _record(self, rows: wp.array) -> wp.Launch:
        model = self.model
        return bind(
            step_replicas, 1, model.rest, model.mesh, self.state, model.constants, replicas=rows, last_step=self._last_step,
            batches=contact_batches(model), body_blocks=body_blocks(model), parity=self._parity,
            node_ux=self._ux, node_uy=self._uy,
        ).record(model.device)  # fmt: skip


class ReplicaGroup:
    """Replicas as a group of meshes (mechanics.py), each with the same steps and checks as a single mesh."""

    keeps_equilibria = False  # the rules of their multipliers do not return to earlier states

    def __init__(self, model: Model, count: int, *, threads: int | None = None) -> None:
        """`threads` share the replicas; default: see `Replicas`."""
        self.model = model
        self.replicas = Replicas(model, count, threads=threads)
        self.members = [PlanarMechanics(model, state) for state in self.replicas.states]
        self._steering = self.replicas.state.steering
        self._axial = self.replicas.state.wire_axial.numpy()
        self._mass = self.replicas.state.wire_mass.numpy()
        self._rules = MultiplierRules(model, count)
        self._first_block = first_blocks(model.panel)
        self._partial = [member.diagnostics.partial_sums()[:2] for member in self.members]
        self._moved = [member.slowest_mode.partial.numpy() for member in self.members]
        self._stiffer = [member.multipliers.axial.numpy() for member in self.members]
        self._work: dict[str, list[Callable[[], None]]] = {}
        for row, member in enumerate(self.members):
            member.begin_level = partial(self._begin_level, row)  # type: ignore[method-assign]

    def _begin_level(self, row: int) -> None:
        self._rules.begin_level(np.array([row]))

    # --- steps

    def together(self) -> AbstractContextManager[None]:
        return nullcontext()

    def search(self, rows: np.ndarray) -> None:
        for row in rows.tolist():
            self.members[row].search()

    def overlap(self, rows: np.ndarray) -> np.ndarray:
        return np.zeros(len(rows))

    def advance(self, rows: np.ndarray, steps: int) -> tuple[np.ndarray, np.ndarray]:
        all_rows, before = rows, self._steering.step
        goal = before + steps
        diverged = np.zeros(len(before), dtype=bool)
        while len(rows):
            self.replicas.step(rows, goal[rows])
            status = self.replicas.status
            for row in rows[status[rows] == Steering.STALE].tolist():
                self.members[row].search()
            lost = status[rows] == Steering.DIVERGED
            diverged[rows[lost]] = True
            rows = rows[~lost & (self._steering.step[rows] < goal[rows])]
        return (self._steering.step - before)[all_rows].astype(int), diverged[all_rows]

    def is_loading(self, rows: np.ndarray) -> np.ndarray:
        return np.asarray(self._steering.is_loading[rows])

    # --- convergence

    def check(self, rows: np.ndarray, checks: np.ndarray, loading: np.ndarray) -> Check:
        residual, ratio = np.full(len(rows), np.nan), np.full(len(rows), np.inf)
        kept = self._steering.values[rows]
        self._steering.set(rows, **PROBING)
        self._replay("check", rows)
        self._steering.values[rows] = kept
        checked = rows[~loading]
        if not len(checked):
            return Check(residual, ratio)
        damping = self._steering.damping[checked]
        moved = np.stack([self._moved[row].sum(axis=0) for row in checked])
        self._steering.set(checked, damping=self.members[0].slowest_mode.renewed(damping, moved))
        residual[~loading], ratio[~loading] = self._residual_ratio(checked)
        return Check(residual, ratio)

    def _residual_ratio(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals and residual ratios [row]; updates the multipliers."""
        solver = self.model.scene.solver
        sums = self._sums(rows)
        residual = self.members[0].residual.measure(Steering(self._steering.values[rows]), sums, self._axial[rows])
        ratio = residual / solver.residual_tolerance
        if solver.multipliers:
            ratio = np.maximum(ratio, self._move_multipliers(rows, sums, ratio < NEARLY_CONVERGED))
        return residual, ratio

    def _sums(self, rows: np.ndarray) -> Sums:
        wires, pairs = (np.stack(part) for part in zip(*(self._partial[row] for row in rows), strict=True))
        held = np.zeros((len(rows), 2, 2))
        if len(self.model.panel.held_node):
            held[:] = [self.members[row].diagnostics.held_stress() for row in rows]
        return sum_up(self.model, self._first_block, wires, pairs, held)

    def _move_multipliers(self, rows: np.ndarray, sums: Sums, nearly_converged: np.ndarray) -> np.ndarray:
        """`Multipliers.update` of all rows."""
        rules = self._rules
        stiffer = rules.renewed_axial_stiffness(self._axial[rows].astype(np.float64), sums, nearly_converged, rows)
        penalty = self._steering.contact_stiffness[rows]
        for row, axial in zip(rows.tolist(), stiffer, strict=True):
            self._stiffer[row][:] = axial
        self._steering.set(rows, multiplier_rate=rules.rate[rows])
        self._replay("move", rows)
        stiffened = rules.renewed_penalty(penalty, sums, rows)
        for row, value in zip(rows[stiffened != penalty].tolist(), stiffened[stiffened != penalty].tolist(), strict=True):
            self.members[row].state.stiffen_contact(value)
        self._mass[rows] = rules.renewed_mass(self._mass[rows].astype(np.float64), stiffer, stiffened, sums)
        self._axial[rows] = stiffer
        return rules.residual_ratio(sums, rows)

    def renew(self, rows: np.ndarray, checks: np.ndarray) -> None:
        if self.model.panel.boundary != "periodic":
            for row, count in zip(rows.tolist(), checks.tolist(), strict=True):
                self.members[row].renew(count)

    def stress(self, rows: np.ndarray) -> np.ndarray:
        self._replay("sums", rows)  # with the updated multipliers
        return self._sums(rows).stress

    # --- launches

    def _of_members(self, name: str) -> list[Callable[[], None]]:
        """What repeats the work of each replica; displacements are in the first buffers (CHECK_STEPS is even)."""
        if name not in self._work:
            self._work[name] = []
            for member in self.members:
                sums: list[Stage] = [member.diagnostics.evaluate, member.diagnostics.sum]
                probe = [contact_stage, member.slowest_mode.probe.stage, member.slowest_mode.sum]
                named: dict[str, list[Stage]] = {"check": probe + sums, "sums": sums, "move": [member.multipliers.move]}
                self._work[name].append(replay(member.stepper.all_launches(named[name]), self.model.device))
        return self._work[name]

    def _replay(self, name: str, rows: np.ndarray) -> None:
        """Do this work of `rows`."""
        work = self._of_members(name)
        parts = [rows[part :: self.replicas.threads].tolist() for part in range(self.replicas.threads)]
        self.replicas.together([partial(_call_all, [work[row] for row in part]) for part in parts if part])


def _call_all(calls: Sequence[Callable[[], None]]) -> None:
    for call in calls:
        call()
