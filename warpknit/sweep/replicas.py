"""Many states of one model side by side: replicas, which differ in their load only and know nothing of each other."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import warp as wp

from ..kernels import control as c
from ..kernels.replicas import step_replicas
from ..launch import bind
from ..planar.model import Model, body_blocks, contact_batches
from ..planar.state import State, initial_state
from ..planar.step import CORES


class Replicas:
    """`count` replicas of a model at rest, and how they are stepped together on the CPU.

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
        given = os.environ.get("WARPKNIT_THREADS", "")
        wanted = threads or (int(given) if given.isdecimal() else len(CORES))
        self.threads = max(1, min(wanted, len(CORES), count))
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
        return self.state.read_control()[:, int(c.STATUS)]

    def _record(self, rows: wp.array) -> wp.Launch:
        model = self.model
        return bind(
            step_replicas, 1, model.rest, model.mesh, self.state, model.constants, replicas=rows, last_step=self._last_step,
            batches=contact_batches(model), body_blocks=body_blocks(model), parity=self._parity,
            node_ux=self._ux, node_uy=self._uy,
        ).record(model.device)  # fmt: skip
