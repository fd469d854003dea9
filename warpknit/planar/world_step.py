"""Steps of worlds: states of one model, each under its own load.

The worlds of a mesh of elastic wires without friction are stepped by one launch on the CPU, in which a thread takes all steps of
a world (kernels/world_steps.py). Others are stepped one after the other, each by its own `Stepper`; so is a single large mesh,
whose steps threads share. The order of summation is the same.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import warp as wp

from ..compute.host import Mirror, fetch, store_at
from ..compute.launch import Launch, bind, fewer_rows
from ..compute.team import Team
from ..kernels.bodies import BODY_BLOCK
from ..kernels.border import collect_forces, distribute_forces
from ..kernels.control import PARTIAL_COUNT, sum_partials, update_control
from ..kernels.world_steps import step_worlds
from ..mechanics.numerics import CORES, thread_count
from .model import Model, body_blocks, contact_batches
from .state import State, initial_state, initial_worlds
from .step import Stage, Stepper, body_launch, contact_stage

VALUES_A_PAIR = 3  # force and its components


class StripStepper(Stepper):
    """Takes steps of a strip's state, together with the other ranks.

        contact of the pairs on own wires -> exchange forces on shared bodies -> wires, bodies, grips -> exchange sums -> control

    A shared body is stepped in both strips with the same two forces, added in the same order as in the global mesh, and every
    rank updates its control array from the same rows. Nodes and bodies are therefore bit-identical to a run on one rank. Only the
    order of partial sums differs.
    """

    def __init__(self, model: Model, state: State, **how: Any) -> None:
        """how: see `Stepper`."""
        strip = model.strip
        assert strip is not None
        # buffers for the shared pairs, neighbour after neighbour
        counts = [VALUES_A_PAIR * len(n.own_pair) for n in strip.neighbours]
        self._border = sum(counts) // VALUES_A_PAIR

        def pairs(name: str) -> wp.array:
            joined = np.concatenate([np.zeros(0, dtype=np.int32), *(getattr(n, name) for n in strip.neighbours)])
            return wp.array(joined.astype(np.int32), dtype=wp.int32, device=model.device)

        self._own_pair, self._foreign_pair = pairs("own_pair"), pairs("foreign_pair")
        self._sent, self._received = (Mirror((sum(counts),), model.precision.real, model.device) for _ in range(2))
        parts = [slice(end - count, end) for count, end in zip(counts, np.cumsum(counts).tolist(), strict=True)]
        peers = [(n.rank, part, part) for n, part in zip(strip.neighbours, parts, strict=True)]
        self._exchange_forces = model.ranks.channel(self._sent.host, self._received.host, peers)
        self._row = Mirror((1, PARTIAL_COUNT), wp.float64, model.device)
        self._rows = Mirror((model.ranks.count, PARTIAL_COUNT), wp.float64, model.device)
        self._collect_rows = model.ranks.table(self._row.host, self._rows.host)
        self._no_rows = wp.zeros((0, PARTIAL_COUNT), dtype=wp.float64, device=model.device)
        shared = model.panel.body_count - model.owned_bodies
        self._shared_blocks = -(-shared // BODY_BLOCK)
        self._unused_rows = wp.zeros((max(1, self._shared_blocks), PARTIAL_COUNT), dtype=wp.float64, device=model.device)
        super().__init__(model, state, **how)

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


# a step then stores f/m as velocities and moves nothing
PROBING = {"velocity_factor": 0.0, "force_factor": 1.0, "time_step": 0.0}


class Accelerations(NamedTuple):
    """f/m of the nodes of a world, as last probed."""

    acceleration_x: wp.array  # [node] [m/s2]
    acceleration_y: wp.array


class WorldStepper:
    """Takes steps of worlds, and runs stages of work for them. `rows` are indices of some worlds.

    `state` has the world as the first axis of every array; `states` are the worlds one by one.
    """

    def __init__(
        self,
        model: Model,
        count: int = 1,
        state: State | None = None,
        *,
        by_pair: bool | None = None,
        threads: int | None = None,
    ) -> None:
        """`state`: of a single world; default: as knitted. `by_pair`: see `Stepper`.

        `threads` share the worlds, or the step of a single one; default: WARPKNIT_THREADS, or one a core.
        """
        self.model = model
        if count == 1:
            self.states = [initial_state(model) if state is None else state]
            self.state = self.states[0].alone()
        else:
            self.state = initial_worlds(model, count)
            self.states = [self.state.world(world) for world in range(count)]
        is_small = steps_by_world(model) and not by_pair
        a_step = 1 if is_small and count > 1 else threads
        kind = Stepper if model.strip is None else StripStepper
        self.steppers = [
            kind(model, state, by_pair=by_pair, threads=a_step, world=world) for world, state in enumerate(self.states)
        ]
        self.is_by_world = is_small and self.steppers[0].threads == 1
        sharing = min(threads, len(CORES), count) if threads else thread_count(count)
        self._team = Team(sharing if self.is_by_world else 1, model.device)
        real, coordinate, nodes = model.precision.real, model.precision.coordinate, model.panel.node_count
        x, y = (wp.zeros((count, nodes), dtype=real, device=model.device) for _ in range(2))
        self.accelerations = [Accelerations(x[world], y[world]) for world in range(count)]
        self._unused = wp.zeros((2, nodes), dtype=coordinate, device=model.device)
        self._parity = wp.zeros(count, dtype=wp.int32, device=model.device)
        self._last_step = wp.zeros(count, dtype=wp.float64, device=model.device)
        self._rows = [wp.zeros(count, dtype=wp.int32, device=model.device) for _ in range(self._team.threads)]
        # the launches that take all steps of some worlds
        self._launches = [
            bind(
                step_worlds, 1, model.rest, model.mesh, self.state, model.constants, worlds=rows, last_step=self._last_step,
                batches=contact_batches(model), body_blocks=body_blocks(model), parity=self._parity,
            ).record(model.device) for rows in self._rows if self.is_by_world
        ]  # fmt: skip

    def step(self, rows: np.ndarray, last_step: np.ndarray) -> None:
        """Step worlds until each has taken `last_step` [row] steps, or is frozen."""
        if not self.is_by_world:
            for row, last in zip(rows.tolist(), last_step.tolist(), strict=True):
                self.steppers[row].step(int(last - self.states[row].steering.step))
            return
        parity = fetch(self._parity)
        parity[rows] = [self.states[row].parity for row in rows.tolist()]
        fetch(self._last_step)[rows] = last_step
        launches = []
        for part, (launch, rows_of_part) in enumerate(zip(self._launches, self._rows, strict=True)):
            if len(own := rows[part :: self._team.threads]):
                fetch(rows_of_part)[: len(own)] = own
                launch.set_dim(len(own))
                launches.append(launch.launch)
        self._team.together(launches)
        for row, now in zip(rows.tolist(), parity[rows].tolist(), strict=True):
            self.states[row].parity = now

    def run(self, rows: np.ndarray, *stages: Stage, contact: bool = False) -> None:
        """Run stages of work for worlds, with `contact` after their contact forces; see `Stepper.run`."""
        if not self.is_by_world:
            for row in rows.tolist():
                self.steppers[row].run(*stages, contact=contact)
        elif len(rows):
            stages = (contact_stage, *stages) if contact else stages
            self._team.each([self.steppers[row].work(stages)[0] for row in rows.tolist()])

    def probe(self, rows: np.ndarray, *stages: Stage) -> None:
        """Find the accelerations f/m of worlds by a step that moves nothing; continue with other stages."""
        control = self.state.control
        kept = fetch(control)[rows]
        self.state.steering.set(rows, **PROBING)
        self.run(rows, self._probe, *stages, contact=True)
        store_at(control, rows, kept)

    def _probe(self, stepper: Stepper, part: int) -> list[Launch]:
        """Stage of work, after the contact forces: a step whose control array holds PROBING."""
        found, unused = self.accelerations[stepper.world], self._unused
        return [stepper.wire_launch(stepper.state.parity, part, *found, unused[0], unused[1])]


def steps_by_world(model: Model) -> bool:
    """Whether one thread may take all steps of a world: kernels/world_steps.py."""
    scene, panel = model.scene, model.panel
    is_free = model.treatment.is_free and not len(panel.sliding_clamp) and not scene.has_moving_edge
    is_elastic = not model.yield_moment and not scene.contact.friction
    return model.device == "cpu" and model.strip is None and is_free and is_elastic
