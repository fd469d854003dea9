"""One time step of rods: table of contents of the spatial physics.

    update_frames   edges, tangents and directors of the displaced nodes
    contact         forces between wires, where there is a contact
    find_rod_forces bending, twist and stretch, and the sum of all forces
    move_rods       accelerations by the masses, which couple neighbours along the wire; update of nodes and sections
    clamps          motion of moving and sliding clamps, if any
    update_controls control array of the next step

Many steps are captured once as a graph and replayed without Python in between. On the CPU several threads share the blocks,
contacts and wires of a step; sums do not depend on their number.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import chain, pairwise
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from ..compute.arrays import DOUBLE, Precision
from ..compute.host import fetch, store
from ..compute.kept import rows_of
from ..compute.launch import Launch, bind, fewer_rows, replay
from ..compute.steering import Steering
from ..compute.team import SharedLaunches, Team
from ..kernels.control import STATUS, update_controls
from ..kernels.rod_frames import AHEAD, ALWAYS, UNLESS_AHEAD
from ..mechanics.numerics import thread_count
from ..mesh.strip import even_shares
from .bending import Yielding
from .contact_arrays import TouchArrays, take_turns
from .rod_arrays import (
    RodArrays,
    RodState,
    StepForces,
    declare_overloads,
    factor_launches,
    force_launch,
    frames_launch,
    motion_launch,
    rest_state,
    upload_rods,
)
from .rods import Rods
from .strip import RodStrip, WireSums

GRAPH_STEPS = (5, 1)  # of one graph replay: capturing more takes longer than replaying few more often
NODES_A_THREAD = 2_000  # fewer nodes a thread cost more in waiting than they save
NODES_IN_CACHE = 1_000  # of worlds that take their steps before others do
PARTS = 2  # a thread, of worlds, as some have converged before others
CHECK_STEPS = 25  # steps between convergence checks
EVALUATED = 0.3  # thicknesses: gap up to which an evaluation finds closest points
GROUP_NODES = 4096  # of a group, or one longer wire: their forces take 64 B a node
UNEVEN = 1.2  # nodes of the wires of a thread over their mean, above which threads share the forces of a wire


class WireGroup(NamedTuple):
    """Consecutive wires, whose forces stay in a thread's cache until they move the nodes."""

    wires: range
    blocks: range
    nodes: range
    stored: StepForces


class RodStepper:
    """Steps rods in time; `contact` adds the forces between wires, `clamps` move held nodes."""

    def __init__(
        self,
        rods: Rods,
        device: str = "cpu",
        state: RodState | None = None,
        precision: Precision = DOUBLE,
        strip: RodStrip | None = None,
        worlds: int = 1,
    ) -> None:
        """state: of the rods, in this precision; default: at rest. strip: which of them are stepped here; default: all.

        worlds: of the rods (`rods.joined`). Each thread steps some, a few at a time; a single one is shared.
        """
        self.rods = rods
        self.strip = strip or RodStrip.alone(rods)
        self.device = device
        self.precision = precision
        declare_overloads(precision)
        self.worlds, self.rows = worlds, np.arange(worlds)
        self._only = self.rows  # others are left out of what is launched
        self.arrays: RodArrays = upload_rods(rods, device, precision, worlds)
        self.state: RodState = rest_state(rods, device, precision, worlds) if state is None else state
        self.steering = Steering(self.state.control)  # [world]
        self.steering.set(last_step=np.inf)
        # `WireContact` and `MovingClamps` set themselves
        self.contact: Any = None
        self.clamps: Any = None
        self._step_stress: Callable[[WireGroup, StepForces, int], list[Launch]] = lambda _group, _stored, _row: []
        self.counts_stress = False
        pieces = rods.node_count // NODES_A_THREAD if worlds == 1 else worlds
        self.team = Team(thread_count(pieces) if device == "cpu" else 1, device)
        each = max(1, NODES_IN_CACHE * worlds // rods.node_count)
        self.parts = self.team.threads if worlds == 1 else min(worlds, max(PARTS * self.team.threads, -(-worlds // each)))
        own, status = [self.share_of(range(worlds), part) for part in range(self.parts)], self.steering.values[:, int(STATUS)]
        self._status = [status[share.start : share.stop] for share in own]  # [part] of its worlds, on a CPU as it changes
        # threads that share the launches of a check
        self.few = min(thread_count(rods.node_count // NODES_A_THREAD), self.team.threads)
        self._no_contact = TouchArrays.of(rods.node_count, device, precision)
        rows = self.parts if worlds == 1 else worlds
        self.stress_count = wp.zeros((rows, 4), dtype=wp.int64, device=device)  # of the stress of a step (kernels/rod_stress.py)
        # of each part: a graph, and its launches, whose arrays it does not keep
        self._graphs: dict[tuple[tuple[int, ...], Any], list[tuple[wp.Graph, Any]]] = {}
        block_wire, wires = fetch(self.arrays.block_wire), self.strip.wires
        self.blocks = range(*np.searchsorted(block_wire, [wires.start, wires.stop]).tolist())  # of the own wires
        self.sums = WireSums(self.strip, rods, block_wire, self.blocks, worlds)
        self.yielding = Yielding(rods, self.arrays, self.state, self.sums, worlds)
        if worlds == 1:
            self._groups = self._wire_groups(wires, block_wire, self.parts)
        else:
            self._groups = [self._wire_groups(self.share_of(wires, part), block_wire, 1)[0] for part in range(self.parts)]
        most = max(sum(len(group.nodes) for group in groups) for groups in self._groups)
        self._share_wires = worlds == 1 and most * self.parts > UNEVEN * rods.wire_count[wires.start : wires.stop].sum()
        shares = [self.team.share_of(wires, part, self.few) for part in range(self.few)]
        self._factor = [replay(factor_launches(self.arrays, self.state, share), device) for share in shares if share]
        self.factor_masses()
        self._frames = frames_launch(self.arrays, self.state).record(device)

    def share_of(self, items: range, part: int) -> range:
        """Share of a part in items of all worlds: some items, or all items of some worlds."""
        if self.worlds == 1:
            return self.team.share_of(items, part)
        own, each = self.team.share_of(range(self.worlds), part, self.parts), len(items) // self.worlds
        return items[own.start * each : own.stop * each]

    def _wire_groups(self, wires: range, block_wire: np.ndarray, parts: int) -> list[list[WireGroup]]:
        """Groups of wires of each thread, with similar numbers of nodes.

        Groups of a thread share the memory of their forces; on a GPU there is one. block_wire: wire of each block.
        """
        rods, state, on_cpu = self.rods, self.state, self.device == "cpu"
        first_node = np.append(rods.wire_first, rods.node_count)
        first_block = np.searchsorted(block_wire, np.arange(len(first_node)))
        largest, shares = GROUP_NODES if on_cpu else rods.node_count, []
        first, count = (values[wires.start : wires.stop] for values in (rods.wire_first, rods.wire_count))
        for begin, end in pairwise((wires.start + even_shares(first - first_node[wires.start], count, parts)).tolist()):
            cuts = [begin]
            while cuts[-1] < end:
                behind = int(np.searchsorted(first_node, first_node[cuts[-1]] + largest, side="right")) - 1
                cuts.append(min(max(cuts[-1] + 1, behind), end))
            most = int(np.diff(first_node[cuts]).max(initial=0)) if on_cpu else 0
            memory = [wp.empty(most, dtype=of.dtype, device=of.device) for of in (state.force, state.torque, state.sweep)]
            ranges = [[range(*of[[a, b]].tolist()) for of in (first_block, first_node)] for a, b in pairwise(cuts)]
            shares.append([
                WireGroup(range(*own), blocks, nodes, StepForces(nodes.start, *memory))
                for own, (blocks, nodes) in zip(pairwise(cuts), ranges, strict=True)
            ])  # fmt: skip
        return shares

    def add_up_stress(self, launches_of: Callable[[WireGroup, StepForces, int], list[Launch]]) -> None:
        """Sum the nominal stress in each step: launches of a group, its forces, and the row of the counts."""
        self._step_stress, self.counts_stress = launches_of, True
        self._graphs.clear()

    def threads_of(self, steps: int) -> int:
        """Threads that share `steps` steps of the active worlds."""
        return 1 + len(self._only) * self.arrays.world_nodes * steps // (2 * NODES_A_THREAD)

    def _wait(self) -> list[Launch]:
        """Launches that make the threads of a shared world wait for each other."""
        return self.team.barrier() if self.worlds == 1 else []

    def launcher(self) -> Callable[..., None]:
        """A function that launches a kernel for the own blocks or nodes; recorded once by name."""
        launches = SharedLaunches(self.team, self.device, self.few)

        def launch(name: str, kernel: wp.Kernel, *sources: object, threads: int = 1, **named: Any) -> None:
            by_block = any(argument.label == "first_block" for argument in kernel.adj.args)
            by, items = ("first_block", self.blocks) if by_block else ("first_node", self.strip.nodes)
            launches.run(name, kernel, by, items, self.arrays, self.state, *sources, threads=threads, **named)

        return launch

    def by_world(self, array: wp.array) -> np.ndarray:
        """(world, ...) the array on the host."""
        host = fetch(array)
        return host.reshape(self.worlds, -1, *host.shape[1:])

    def store_rows(self, array: wp.array, rows: np.ndarray, values: Any) -> None:
        """Set worlds' parts of an array to values that broadcast to (row, ...)."""
        host = self.by_world(array)
        host[rows] = values
        if self.device != "cpu":
            store(array, host.reshape(fetch(array).shape))

    @contextmanager
    def only(self, rows: np.ndarray | None) -> Iterator[np.ndarray]:
        """Launch for the worlds `rows` only, default all."""
        before = self._only
        rows = before if rows is None else rows
        if len(rows) == len(before):  # `rows` are some of those
            yield rows
            return
        is_other = np.ones(self.worlds, dtype=bool)
        is_other[rows] = False
        others = np.flatnonzero(is_other)
        kept = self.steering.status[others]
        self.steering.set(others, status=Steering.WAITING)
        self._only = rows
        try:
            yield rows
        finally:
            self.steering.set(others, status=kept)
            self._only = before

    def part(self, array: wp.array, world: int) -> wp.array:
        """The part of an array that belongs to a world."""
        return array[rows_of(array, world, self.worlds)]

    def _contact_launches(self, part: int, when: int = ALWAYS) -> tuple[list[Launch], TouchArrays]:
        """Launches of one thread's frames and contacts, in order; its contact arrays."""
        arrays, state, wait = self.arrays, self.state, self._wait()
        touch, contact = self._no_contact, []
        if self.contact is not None:
            touch, contact = self.contact.touch, [*self.contact.launches(part, self.parts), *wait]
        blocks = self.share_of(range(len(arrays.block_first)), part)
        return [frames_launch(arrays, state, blocks, when), *wait, *contact], touch

    def launches(self, part: int = 0, *, is_first: bool = True, is_last: bool = True) -> list[Launch]:
        """The launches of one thread's part of a step; of a shared world the first thread also moves clamps and control."""
        launches = self._motion_launches(part, is_first=is_first, is_last=is_last)
        worlds = self.share_of(range(self.worlds), part) if self.worlds > 1 else range(part == 0)
        if len(worlds):
            launches += self.clamps.launches(worlds) if self.clamps is not None else ()
            launches += self._control_launches(self.state.partial, worlds)
        return [*launches, *self._wait()]

    def _control_launches(self, partial: wp.array, worlds: range) -> list[Launch]:
        """Launches that update the control array of worlds by sums of wires."""
        sums, rows = fewer_rows(partial) if self.worlds == 1 else ([], partial)
        named = {"first_world": worlds.start, "world_rows": len(rows) // self.worlds, "wire_partial": rows}
        named |= {"stress_rows": len(self.stress_count) // self.worlds, "stress_count": self.stress_count}
        return [*sums, bind(update_controls, len(worlds), control=self.state.control, **named)]

    def _motion_launches(self, part: int, *, is_first: bool, is_last: bool) -> list[Launch]:
        """Launches of one thread's part of a step up to the motion.

        The forces of a group of wires move its nodes at once. On a CPU the next group then takes their memory, and all steps but
        the last compute the next frames, while all is in the cache; not where clamps move by forces. Threads share the forces of
        wires that are too long for one of them; then each moves its wires.
        """
        in_cache = self.device == "cpu" and not self._share_wires and (self.clamps is None or not self.clamps.need_forces)
        launches, touch = self._contact_launches(part, UNLESS_AHEAD if in_cache and not is_first else ALWAYS)
        row = part if self.worlds == 1 else -1  # of the counts of the stress
        if self._share_wires:
            blocks = self.share_of(self.blocks, part)
            launches += [force_launch(self.rods, self.arrays, self.state, touch, blocks), *self._wait()]
        for group in self._groups[part]:
            stored = group.stored if in_cache else StepForces.of(self.state)
            if not self._share_wires:
                launches.append(force_launch(self.rods, self.arrays, self.state, touch, group.blocks, stored))
            launches += [*self._step_stress(group, stored, row), motion_launch(self.arrays, self.state, group.wires, stored)]
            if in_cache and not is_last:
                launches.append(frames_launch(self.arrays, self.state, group.blocks, AHEAD))
        return [*launches, *self._wait()]

    def step(self, count: int) -> None:
        """Take `count` steps, fewer where the state freezes (kernels/control.py)."""
        for size in GRAPH_STEPS:
            if count >= size:
                self._replay(size, count // size)
            count %= size

    def evaluate(self, gap: Any = None, *, accepting: bool = False, rows: np.ndarray | None = None) -> None:
        """Compute positions, frames and forces of all worlds, or of `rows`, without a step.

        gap [m] or [row]: up to which closest points of wires are found; default: EVALUATED thicknesses; accepting: see
        `WireContact`.
        """
        gap = EVALUATED * self.rods.section.thickness if gap is None else gap
        status = Steering.ACCEPTING if accepting else Steering.EVALUATING
        with self.only(rows) as own:
            kept = self.steering.status[own]
            self.steering.set(own, status=status, evaluated_gap=gap)
            self._replay(0, 1)
            self.steering.set(own, status=kept)

    def sync(self) -> None:
        """Update the copies of other ranks' wires; a collective call."""

    def check_border(self, reach: float) -> None:
        """Check that no other wires are within `reach` [m at rest] of own ones; a collective call."""

    def update_frames(self, rows: np.ndarray | None = None) -> None:
        """Compute positions and frames of the current state, without forces."""
        with self.only(rows) as own:
            kept = self.steering.status[own]
            self.steering.set(own, status=Steering.EVALUATING)
            self._frames.launch()
            self.steering.set(own, status=kept)

    def _replay(self, steps: int, times: int) -> None:
        """Replay graphs of `steps` steps in all threads, until the state freezes; 0: forces alone."""

        def launches_of(part: int) -> list[list[Launch]]:
            if steps == 0:
                launches, touch = self._contact_launches(part)
                forces = force_launch(self.rods, self.arrays, self.state, touch, self.share_of(self.blocks, part))
                return [[*launches, forces, *self._wait()]]
            if steps == 1:
                return [self.launches(part)]
            between = self.launches(part, is_first=False, is_last=False)
            begin, end = (self.launches(part, is_first=first, is_last=not first) for first in (True, False))
            return [begin, *[between] * (steps - 2), end]

        graphs = self._graphs_of(steps, launches_of)
        if self.worlds == 1:
            self.team.replay([[graph] * times for graph in graphs], self.state.control)
        else:
            self.team.replay_worlds(graphs, times, self._status, self.threads_of(max(1, steps) * times))

    def _graphs_of(self, name: Any, launches_of: Callable[[int], list[list[Launch]]]) -> list[wp.Graph]:
        """The graph of each part, captured once by name and version of the contact; launches_of: of the steps of a part."""
        key = (self.contact.version if self.contact is not None else (), name)
        if key not in self._graphs:
            # graphs of lists that have grown since are not used again, and hold their arrays
            kept = {k: graphs for k, graphs in self._graphs.items() if k[0] == key[0] or take_turns(k[0], key[0])}
            self._graphs = kept | {key: []}
            for part in range(self.parts):
                steps = launches_of(part)  # equal steps are recorded once
                recorded = {id(step): [launch.record(self.device) for launch in step if launch.threads] for step in steps}
                with wp.ScopedCapture(device=self.device) as capture:
                    for command in chain.from_iterable(recorded[id(step)] for step in steps):
                        command.launch()
                self._graphs[key].append((capture.graph, recorded))
        return [graph for graph, _ in self._graphs[key]]

    # --- the state on the host ---

    def set_time_step(self, time_step: float, damping: float = 0.0, look_ahead: float = 0.0) -> None:
        """Set the step [s], mass-proportional damping [1/s] and look-ahead [steps] (kernels/control.py)."""
        half = 0.5 * damping * time_step
        self.steering.set(
            time_step=time_step,
            damping=damping,
            look_ahead=look_ahead,
            velocity_factor=(1 - half) / (1 + half),
            force_factor=time_step / (1 + half),
        )

    def set_masses(self, **masses: np.ndarray) -> None:
        """Set masses of the dynamics, by the names of the arrays of the state (kernels/banded_mass.py); those left out are 0."""
        for name in ("node_mass", "next_mass", "second_mass", "spin_inertia", "next_inertia"):
            store(getattr(self.state, name), masses.get(name, 0.0))
        self.factor_masses()

    def factor_masses(self) -> None:
        """Factor the masses of the dynamics, after they have changed."""
        self.team.together(self._factor)

    def place(self, position: np.ndarray, turn: np.ndarray | None = None) -> None:
        """Move nodes to positions (node, 3) [m] and rotate sections by angles [node] [rad]; frames follow."""
        affine = self.rods.position.copy()
        affine[:, :2] = affine[:, :2] @ self.state.gradient.T
        self.shift(np.asarray(position) - affine - fetch(self.state.displacement), turn)
        if self.contact is not None:
            self.contact.list_near_pairs()
        self.evaluate()

    def shift(
        self, move: np.ndarray, turn: np.ndarray | None = None, smooth: np.ndarray | None = None, strain: float = 0.0
    ) -> None:
        """Move nodes by (node, 3) [m] and rotate sections by angles [node] [rad]; frames follow.

        smooth: the part of the motion that changes little from node to node, with `strain` as in `PairSearch.carry`.
        """
        square = np.sum((move if smooth is None else move - smooth) ** 2, axis=1)
        moved = math.sqrt(self.strip.largest_of_nodes(square))
        store(self.state.displacement, fetch(self.state.displacement) + move)
        if turn is not None:
            store(self.state.pending_turn, turn)
            moved += float(self.steering.lever.max()) * self.strip.largest_of_nodes(np.abs(turn))
        if self.contact is not None:
            if smooth is not None:
                moved += self.contact.carry(smooth, strain)
            self.contact.follow(moved)

    def forces(self) -> tuple[np.ndarray, np.ndarray]:
        """Forces (node, 3) [N] and torques of the segments [node] [N m] of the current state."""
        self.evaluate()
        return fetch(self.state.force).copy(), fetch(self.state.torque).copy()
