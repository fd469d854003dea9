"""Steps of a strip: the ranks exchange border data between the parts of a step.

    contact of the pairs on own wires -> exchange forces on shared bodies -> wires, bodies, grips -> exchange sums -> control

A shared body is stepped in both strips with the same two forces, added in the same order as in the global mesh, and every rank
updates its control array from the same rows. Nodes and bodies are therefore bit-identical to a run on one rank. Only the order
of partial sums differs.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from ..compute.host import Mirror
from ..compute.launch import Launch, bind, fewer_rows
from ..kernels.bodies import BODY_BLOCK
from ..kernels.border import collect_forces, distribute_forces
from ..kernels.control import PARTIAL_COUNT, sum_partials, update_control
from ..mesh.strip import Strip
from .model import Model
from .state import State
from .step import Stage, Stepper, body_launch

VALUES_A_PAIR = 3  # force and its components


class StripStepper(Stepper):
    """Takes steps of a strip's state, together with the other ranks."""

    def __init__(self, model: Model, state: State, **how: Any) -> None:
        """how: see `Stepper`."""
        strip = model.strip
        assert strip is not None
        self._make_border(model, strip)
        self._row = Mirror((1, PARTIAL_COUNT), wp.float64, model.device)
        self._rows = Mirror((model.ranks.count, PARTIAL_COUNT), wp.float64, model.device)
        self._collect_rows = model.ranks.table(self._row.host, self._rows.host)
        self._no_rows = wp.zeros((0, PARTIAL_COUNT), dtype=wp.float64, device=model.device)
        shared = model.panel.body_count - model.owned_bodies
        self._shared_blocks = -(-shared // BODY_BLOCK)
        self._unused_rows = wp.zeros((max(1, self._shared_blocks), PARTIAL_COUNT), dtype=wp.float64, device=model.device)
        super().__init__(model, state, **how)

    def _make_border(self, model: Model, strip: Strip) -> None:
        """Buffers for the shared pairs, neighbour after neighbour."""
        real, device = model.precision.real, model.device
        self._border = sum(len(n.own_pair) for n in strip.neighbours)

        def pairs(name: str) -> wp.array:
            joined = np.concatenate([np.zeros(0, dtype=np.int32), *(getattr(n, name) for n in strip.neighbours)])
            return wp.array(joined.astype(np.int32), dtype=wp.int32, device=device)

        self._own_pair, self._foreign_pair = pairs("own_pair"), pairs("foreign_pair")
        self._sent, self._received = (Mirror((VALUES_A_PAIR * self._border,), real, device) for _ in range(2))
        peers, begin = [], 0
        for neighbour in strip.neighbours:
            end = begin + VALUES_A_PAIR * len(neighbour.own_pair)
            peers.append((neighbour.rank, slice(begin, end), slice(begin, end)))
            begin = end
        self._exchange_forces = model.ranks.channel(self._sent.host, self._received.host, peers)

    @property
    def border_bytes(self) -> int:
        """Bytes sent to the neighbours in a step."""
        return int(self._sent.host.nbytes)

    # --- parts of a step without communication, as stages of work

    def _contact(self, _stepper: Stepper, part: int) -> list[Launch]:
        collect = bind(collect_forces, self._border, self.state, own_pair=self._own_pair, sent=self._sent.array)
        return [*self._contact_work(self.state.parity, part), *self.team.barrier(), *([collect] if part == 0 else [])]

    def _move(self, _stepper: Stepper, part: int) -> list[Launch]:
        model, state = self.model, self.state
        if part > 0:
            return [*self.team.barrier(), *self._motion(state.parity, part)]
        shared = slice(model.owned_bodies, model.panel.body_count)
        move_shared = body_launch(model, state, self._shared_blocks, 0, shared, self._unused_rows)
        (wires, wire_partial), (bodies, body_partial) = map(fewer_rows, (state.wire_partial, state.body_partial))
        rows = {"wire_partial": wire_partial, "body_partial": body_partial}
        sums = [*wires, *bodies, bind(sum_partials, 1, row=self._row.array, **rows)]
        return [self._distribute(), *self.team.barrier(), move_shared, *self._motion(state.parity, part), *sums]

    def _control(self, _stepper: Stepper, part: int) -> list[Launch]:
        rows = {"wire_partial": self._rows.array, "body_partial": self._no_rows}
        return [bind(update_control, 1, control=self.state.control, **rows)] if part == 0 else []

    def _take(self, count: int) -> None:
        super().run(self._contact)
        for left in reversed(range(count)):
            self._exchange_at_border()
            super().run(self._move)
            self._row.copy_to_host()
            self._collect_rows()
            self._rows.copy_to_device()
            self.state.parity = 1 - self.state.parity
            super().run(self._control, *([self._contact] if left else []))

    def run(self, *stages: Stage, contact: bool = False) -> None:
        if contact:
            self.evaluate_contact()
        if stages:
            super().run(*stages)

    def evaluate_contact(self) -> None:
        super().run(self._contact)
        self._exchange_at_border()
        if self._border:
            self._distribute().run(self.model.device)

    def _distribute(self) -> Launch:
        """Launch that stores received forces at their pairs."""
        received = self._received.array
        return bind(distribute_forces, self._border, self.state, foreign_pair=self._foreign_pair, received=received)

    def _exchange_at_border(self) -> None:
        if self._border:
            self._sent.copy_to_host()
            self._exchange_forces()
            self._received.copy_to_device()
