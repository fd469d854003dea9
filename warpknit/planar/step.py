"""One time step: the table of contents of the physics.

A `Stepper` records the launches of a step once for each parity of the displacement buffers, and graphs of many steps, which
Warp replays without Python in between, on CPU and GPU. On the CPU several threads may share a step; the order of summation,
and so the result, does not depend on their number.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import cached_property
from itertools import chain
from typing import Any

import numpy as np
import warp as wp

from ..compute.host import lanes
from ..compute.launch import Launch, bind, fewer_rows, replay
from ..compute.steering import Steering
from ..compute.team import StepSharing, Team
from ..kernels.anchored_bodies import step_anchored_bodies
from ..kernels.bodies import BODY_BLOCK, step_bodies
from ..kernels.contact import find_contact_forces
from ..kernels.contact_by_batch import PAIR_BATCH, find_contact_forces_by_batch
from ..kernels.contact_friction import add_friction
from ..kernels.contact_node import apply_contact_force, follow_contact_node
from ..kernels.contact_search import find_nearest_segments
from ..kernels.control import update_control
from ..kernels.grip import move_held_nodes
from ..kernels.slide import slide_clamps
from ..kernels.sums import count_stress_of_pairs
from ..kernels.wire_forces import WIRE_LANES
from ..kernels.wires import step_wires
from ..mechanics.numerics import thread_count
from .model import Model, body_blocks, contact_batches
from .state import State

GRAPH_STEPS = (10, 1)  # steps of one graph replay: capturing more takes longer than replaying few more often
LONG_STEP_NODES = 100_000  # from there on a step takes longer than threads wait for each other
NODES_A_THREAD = 2_500  # fewer nodes a thread cost more in waiting than they save
SAG = 0.15  # of the node spacing: largest distance of a wire from the chord of a segment (radius 0.8 spacings)
MARGIN = 0.1  # in course spacings: largest approach of a body and a wire before the next search
# launches of one part of a stage of work, for a stepper and the number of its part
Stage = Callable[["Stepper", int], list[Launch]]


class Stepper:
    """Takes steps of a model's state."""

    def __init__(
        self, model: Model, state: State, *, by_pair: bool | None = None, threads: int | None = None, world: int = 0
    ) -> None:
        """`by_pair`: contact with a thread a pair (GPU), else a thread a batch of pairs (CPU). Default: by the device.

        `threads` of a step on the CPU; default: by cores and mesh size, and where a step is short, by what is faster.
        `world`: which one of many the state is.
        """
        self.model, self.state, self.world = model, state, world
        self.counts_stress = False  # for strains that tensions drive
        self.by_pair = model.device != "cpu" if by_pair is None else by_pair
        # hook contact constraints are not split between threads
        alone = model.device != "cpu" or not model.treatment.is_free
        self.threads = 1 if alone else threads or thread_count(model.panel.node_count // NODES_A_THREAD)
        self.team = Team(self.threads, model.device)
        short = threads is None and self.threads > 1 and model.panel.node_count < LONG_STEP_NODES and model.strip is None
        self._alone = Stepper(model, state, threads=1, world=world) if short else None
        self._faster: Stepper = self
        self._sharing = StepSharing()
        self._graphs: dict[tuple[int, int], list[wp.Graph]] = {}
        self._recorded: list[list[list[wp.Launch]]] = []
        self._runs: dict[tuple[Any, ...], list[Callable[[], None]]] = {}

    def count_stress(self) -> None:
        """Let steps sum the nominal stress of the pairs; the wires have theirs."""
        if self.counts_stress:
            return
        self.counts_stress = True
        self._graphs.clear()
        self._runs.clear()
        if self._alone is not None:
            self._alone.count_stress()

    def step(self, count: int) -> None:
        """Take `count` steps; a frozen state (kernels/control.py) does not change."""
        if self._alone is None:
            self._take(count)
            return
        shared, begin = self._sharing.is_shared(), time.perf_counter()
        self._faster = self if shared else self._alone
        self._faster._take(count)
        self._sharing.note_time(shared, (time.perf_counter() - begin) / max(1, count))

    def _take(self, count: int) -> None:
        for size in GRAPH_STEPS:
            if count >= size:
                self._replay(size, count // size)
            count %= size

    def _replay(self, steps: int, times: int) -> None:
        """Replay graphs `times` times in all threads, until the state freezes."""
        state = self.state
        graphs = [self._graphs_of((state.parity + k * steps) % 2, steps) for k in range(times)]
        taken = self.team.replay(list(zip(*graphs, strict=True)), state.control)
        state.parity = (state.parity + taken * steps) % 2

    def blocks_of(self, part: int) -> tuple[int, int]:
        """First block of a thread's part of the wires, and their number."""
        return self.team.share(len(self.model.panel.block_first), part)

    def _graphs_of(self, parity: int, steps: int) -> list[wp.Graph]:
        """A graph for each thread: `steps` steps from `parity`."""
        if (parity, steps) not in self._graphs:
            graphs: list[wp.Graph] = []
            device, both = self.model.device, (parity, 1 - parity)
            for part in range(self.threads):
                launches = [[one.record(device) for one in self.launches(now, part) if one.threads > 0] for now in both]
                with wp.ScopedCapture(device=device) as capture:
                    for k in range(steps):
                        for launch in launches[k % 2]:
                            launch.launch()
                graphs.append(capture.graph)
                self._recorded.append(launches)  # a graph does not keep arguments
            self._graphs[parity, steps] = graphs
        return self._graphs[parity, steps]

    def run(self, *stages: Stage, contact: bool = False) -> None:
        """Run stages of work, which threads share as they do steps; with `contact` after the contact forces of the state.

        They are captured at the first call at a parity, and again for other stages: functions that compare equal.
        """
        faster = self._faster
        faster.team.together(faster.work((contact_stage, *stages) if contact else stages))

    def work(self, stages: tuple[Stage, ...]) -> list[Callable[[], None]]:
        """Functions for stages of work at the present parity, one a thread."""
        key = (stages, self.state.parity)
        if key not in self._runs:
            self._runs[key] = []
            for part in range(self.threads):
                first, *later = [stage(self, part) for stage in stages]
                launches = [*first, *chain.from_iterable([*self.team.barrier(), *launches] for launches in later)]
                self._runs[key].append(replay(launches, self.model.device))
        return self._runs[key]

    def evaluate_contact(self) -> None:
        """Contact forces of the current state, without a step."""
        if self.model.pair_count:
            self.run(contact=True)

    def _contact_work(self, parity: int, part: int) -> list[Launch]:
        """Launches of one part of the contact forces, with friction and constraint."""
        model, state = self.model, self.state
        sources = (model.rest, model.mesh, state, model.constants)
        coordinates = {"ux": state.node_ux[parity], "uy": state.node_uy[parity]}
        if self.by_pair:
            pair, pairs = self.team.share(model.pair_count, part)
            search = bind(find_contact_forces, pairs, *sources, first_pair=pair, **coordinates)
        else:
            batch, batches = self.team.share(contact_batches(model), part)
            search = bind(find_contact_forces_by_batch, batches, *sources, first_batch=batch, **coordinates)
            pair, end = batch * PAIR_BATCH, min((batch + batches) * PAIR_BATCH, model.pair_count)
            pairs = max(0, end - pair)
        friction = [bind(add_friction, pairs, *sources, first_pair=pair)] if len(state.pair_stuck) else []
        node = model.treatment.contact_node is not None and part == 0
        pinball = wp.float64(model.treatment.pinball)
        point = [bind(apply_contact_force, model.panel.body_count, model.mesh, state, pinball=pinball)] if node else []
        return [search, *friction, *point]

    def launches(self, parity: int, part: int = 0) -> list[Launch]:
        """One thread's part of a step: contact, wires and bodies; the first thread also grips and control."""
        (wires, wire_partial), (bodies, body_partial) = map(fewer_rows, (self.state.wire_partial, self.state.body_partial))
        rows = {"wire_partial": wire_partial, "body_partial": body_partial}
        end = [*wires, *bodies, bind(update_control, 1, control=self.state.control, **rows)]
        work = [*self._contact_work(parity, part), *self.team.barrier(), *self._motion(parity, part)]
        return [*work, *(end if part == 0 else []), *self.team.barrier()]

    def _motion(self, parity: int, part: int) -> list[Launch]:
        """One thread's part of the motion: wires and bodies; the first thread also grips."""
        model, state, then = self.model, self.state, 1 - parity
        body, bodies = self.team.share(body_blocks(model), part)
        speeds, moved = {"vx": state.node_vx, "vy": state.node_vy}, {"ux": state.node_ux[then], "uy": state.node_uy[then]}
        wires = self.wire_launch(parity, part, *speeds.values(), *moved.values())
        work = [wires, *body_launches(model, state, then, body, bodies)]
        if self.counts_stress:  # of the pairs, as rows of the sums of bodies
            of_row = {"first_row": body, "row_pairs": -(-model.pair_count // body_blocks(model))}
            work.append(bind(count_stress_of_pairs, bodies, model.rest, model.mesh, state, model.constants, **of_row))
        work += self.team.barrier()
        if part == 0:
            sources, sliding, held = (model.mesh, state), len(model.panel.sliding_clamp), model.mesh.held_node.shape[0]
            work.append(bind(slide_clamps, sliding, model.rest, *sources, partial=state.wire_partial, **speeds, **moved))
            work.append(bind(move_held_nodes, held, *sources, model.constants, **moved))
        return work

    def wire_launch(self, now: int, part: int, vx: wp.array, vy: wp.array, ux_out: wp.array, uy_out: wp.array) -> Launch:
        """Step of one thread's part of the wires from displacements of parity `now`; updates `vx`, `vy`."""
        model, state, (first_block, blocks) = self.model, self.state, self.blocks_of(part)
        threads = lanes(WIRE_LANES, model.device)
        return bind(
            step_wires, blocks * threads, model.rest, model.mesh, state, model.constants, first_block=first_block,
            threads_a_block=threads,
            ux_in=state.node_ux[now], uy_in=state.node_uy[now], vx=vx, vy=vy, ux_out=ux_out, uy_out=uy_out,
            partial=state.wire_partial,
        )  # fmt: skip


def contact_stage(stepper: Stepper, part: int) -> list[Launch]:
    """Stage of work: contact forces of the state."""
    return stepper._contact_work(stepper.state.parity, part)


def body_launch(model: Model, state: State, blocks: int, first_block: int, bodies: slice, partial_sums: wp.array) -> Launch:
    """The step of blocks of bodies; `first_block` counts from the first of the `bodies`."""
    pairs = slice(2 * bodies.start, 2 * bodies.stop)

    def part(values: wp.array, which: slice) -> wp.array:
        return values[which] if which.stop > which.start else values  # Warp has no empty slices

    forces = {name: part(getattr(state, name), pairs) for name in ("pair_force", "pair_body_x", "pair_body_y")}
    moved = {name: part(getattr(state, f"body_{name}"), bodies) for name in ("ux", "uy", "vx", "vy")}
    constants, control = model.constants, state.control
    threads = lanes(BODY_BLOCK, model.device)
    return bind(
        step_bodies, blocks * threads, constants, control=control, first_block=first_block, threads_a_block=threads,
        partial=partial_sums, **forces, **moved,
    )  # fmt: skip


def body_launches(model: Model, state: State, then: int, first: int, blocks: int) -> list[Launch]:
    """Step of `blocks` blocks of bodies from `first`, by the contact constraint."""
    treatment = model.treatment
    if treatment.is_free:
        owned = slice(0, model.owned_bodies)
        return [body_launch(model, state, blocks if model.owned_bodies else 0, first, owned, state.body_partial)]
    if treatment.anchored:
        return [anchor_launch(step_anchored_bodies, min(blocks, 1), model, state)]
    bodies = model.panel.body_count if blocks else 0
    nodes = {"node_ux": state.node_ux[then], "node_uy": state.node_uy[then]}
    return [bind(follow_contact_node, bodies, model.mesh, state, **nodes)]


def anchor_launch(kernel: wp.Kernel, threads: int, model: Model, state: State) -> Launch:
    """A launch of one of kernels/anchored_bodies.py."""
    treatment = model.treatment
    stiffness, limit = wp.float64(treatment.spring_stiffness), wp.float64(treatment.spring_limit)
    return bind(kernel, threads, model.mesh, state, stiffness=stiffness, limit=limit)


class NeighbourSearch:
    """The search for the initial segment of each pair; the kernel is in kernels/contact_search.py."""

    KEPT = ("searches",)

    def __init__(self, model: Model, state: State) -> None:
        self.model = model
        self.state = state
        self.margin = MARGIN * model.scene.knit.course_spacing
        # the nearer node of a touched segment is within half a (stretched) spacing along the wire
        self.radius = model.treatment.reach + self.margin + 0.75 * float(model.table.spacing.max())
        self.searches = 0
        # half of the relative motion of a body and a wire by a unit strain of the load, at rest within twice the radius
        state.steering.set(pair_reach=self.radius)

    def search(self) -> None:
        """Seed every open pair, and reset the travel budget.

        Pairs of a hook with another contact constraint never sleep and need no search.
        """
        budget = 0.5 * self.margin if self.model.pair_count else np.inf
        self.state.steering.set(travel=0.0, travel_limit=budget, status=Steering.RUNNING)
        if self.model.pair_count and self.model.treatment.is_free:
            self._launches[self.state.parity].launch()
        self.searches += 1

    @cached_property
    def _launches(self) -> list[wp.Launch]:
        """The search from the displacements of each parity."""
        model, state = self.model, self.state
        real, spacing = model.precision.real, float(model.table.spacing.max())
        return [
            bind(
                find_nearest_segments, model.pair_count, model.rest, model.mesh, state, model.constants,
                radius=real(self.radius), half_chord=real(0.6 * spacing), sag=real(SAG * spacing),
                reach=real(model.treatment.reach), ux=state.node_ux[parity], uy=state.node_uy[parity],
            ).record(model.device)
            for parity in (0, 1)
        ]  # fmt: skip
