"""Steps of worlds: states of one model, each under its own load.

The worlds of a mesh of elastic wires without friction are stepped by one launch on the CPU, in which a thread takes all steps of
a world (kernels/world_steps.py). Others are stepped one after the other, each by its own `Stepper`; so is a single large mesh,
whose steps threads share. The order of summation is the same.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import warp as wp

from ..compute.host import fetch, store_at
from ..compute.launch import Launch, bind
from ..compute.team import Team
from ..kernels.world_steps import step_worlds
from ..mechanics.numerics import CORES, thread_count
from .model import Model, body_blocks, contact_batches
from .state import State, initial_state, initial_worlds
from .step import Stage, Stepper, contact_stage
from .strip_step import StripStepper

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
        self._launches = [self._steps(rows) for rows in self._rows] if self.is_by_world else []

    def _steps(self, rows: wp.array) -> wp.Launch:
        """The launch that takes all steps of some worlds."""
        model = self.model
        return bind(
            step_worlds, 1, model.rest, model.mesh, self.state, model.constants, worlds=rows, last_step=self._last_step,
            batches=contact_batches(model), body_blocks=body_blocks(model), parity=self._parity,
        ).record(model.device)  # fmt: skip

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
            work = {row: self.steppers[row].work(stages)[0] for row in rows.tolist()}
            self._team.each([work[row] for row in rows.tolist()])

    def probe(self, rows: np.ndarray, *stages: Stage) -> None:
        """Find the accelerations f/m of worlds by a step that moves nothing; continue with other stages."""
        control = self.state.control
        kept = fetch(control)[rows]
        self.state.steering.set(rows, **PROBING)
        self.run(rows, self._probe, *stages, contact=True)
        store_at(control, rows, kept)

    def _probe(self, stepper: Stepper, part: int) -> list[Launch]:
        """Stage of work, after the contact forces: a step whose control array holds PROBING."""
        block, blocks = stepper.blocks_of(part)
        found, unused = self.accelerations[stepper.world], self._unused
        return [stepper.wire_launch(stepper.state.parity, block, blocks, *found, unused[0], unused[1])]


def steps_by_world(model: Model) -> bool:
    """Whether one thread may take all steps of a world: kernels/world_steps.py."""
    scene, panel = model.scene, model.panel
    is_free = model.treatment.is_free and not len(panel.sliding_clamp) and not scene.has_moving_edge
    is_elastic = not model.yield_moment and not scene.contact.friction
    return model.device == "cpu" and model.strip is None and is_free and is_elastic
