"""One time step: the table of contents of the physics.

A `Stepper` holds the launches of a step, recorded once for either parity of the displacement buffers, and graphs of many
steps, which Warp replays without Python in between, on the CPU as on a GPU. On the CPU several threads may share a step;
sums are taken in the same order whatever their number, so results do not depend on it.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import TypeAlias

import warp as wp

from ..kernels import control as c
from ..kernels.anchored_bodies import step_anchored_bodies
from ..kernels.barrier import wait_for_all
from ..kernels.bodies import BODY_BLOCK, step_bodies
from ..kernels.contact import find_contact_forces
from ..kernels.contact_by_batch import PAIR_BATCH, find_contact_forces_by_batch
from ..kernels.contact_node import follow_contact_node, lend_contact_force
from ..kernels.control import update_control
from ..kernels.friction import add_friction
from ..kernels.grip import move_held_nodes
from ..kernels.slide import slide_clamps
from ..kernels.wires import step_wires_by_node
from ..kernels.wires_by_block import BLOCK_SIZE, step_wires_by_block
from .model import Model, body_blocks, contact_batches
from .state import State

GRAPH_STEPS = (50, 10, 1)  # steps that are replayed at once
CORES = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else set(range(os.cpu_count() or 1))
FIRST_OF_CONTACT = 3  # place of the first pair or batch among the arguments of contact
NODES_A_THREAD = 4_000  # fewer nodes are not worth the waiting
PROBING = {c.VELOCITY_FACTOR: 0.0, c.FORCE_FACTOR: 1.0, c.TIME_STEP: 0.0}  # a step leaves f/m as velocities and moves nothing

LaunchData: TypeAlias = tuple[wp.Kernel, int, list]  # kernel, threads and arguments


class Stepper:
    """Takes steps of a model's state."""

    def __init__(self, model: Model, state: State, *, by_node: bool | None = None, threads: int | None = None) -> None:
        """`by_node` picks the kernels of wires and contact: a thread a node and a pair, as on a GPU, or what is fast on a CPU, a
        thread a block of nodes and a batch of pairs. Default: by the device.

        `threads` share the work of a step on the CPU; default: as many as the machine has and the mesh is worth.
        """
        self.model = model
        self.state = state
        self.by_node = model.device != "cpu" if by_node is None else by_node
        # what a treatment does to its few bodies is in no part of a step that threads could share
        alone = model.device != "cpu" or not model.treatment.is_free
        self.threads = 1 if alone else threads or thread_count(model.panel.node_count)
        self._barrier = wp.zeros(64, dtype=wp.int32, device=model.device)
        self._launches = [[self._record(parity, part) for parity in (0, 1)] for part in range(self.threads)]
        self._contact = [
            [partial(_launch_all, self._commands(self._contact_work(parity, part))) for part in range(self.threads)]
            for parity in (0, 1)
        ]
        self._graphs: dict[tuple[int, int], list[wp.Graph]] = {}
        self._helpers = ThreadPoolExecutor(self.threads - 1, "step") if self.threads > 1 else None

    @property
    def wire_kernel(self) -> tuple[wp.Kernel, int, list[int]]:
        """The wire kernel, its threads a block, and what its arguments end with."""
        return (step_wires_by_node, BLOCK_SIZE, [BLOCK_SIZE]) if self.by_node else (step_wires_by_block, 1, [])

    def step(self, count: int) -> None:
        """Take `count` steps; they do nothing once the state is frozen (see kernels/control.py)."""
        for size in GRAPH_STEPS:
            for _ in range(count // size):
                self._replay(self.state.parity, size)
                self.state.parity = (self.state.parity + size) % 2
            count %= size

    def _replay(self, parity: int, steps: int) -> None:
        """Have every thread replay its part of so many steps."""
        self.together([partial(wp.capture_launch, graph) for graph in self._graphs_of(parity, steps)])

    def together(self, parts: Sequence[Callable[[], object]]) -> None:
        """Call one part in each thread at a time, and return when all are done."""
        waiting = [self._helpers.submit(part) for part in parts[1:]] if self._helpers is not None else []
        parts[0]()
        for helper in waiting:
            helper.result()

    def shares(self, count: int) -> list[tuple[int, int]]:
        """Begin and number of what each thread takes of `count` things."""
        return [self._share(count, part) for part in range(self.threads)]

    def _graphs_of(self, parity: int, steps: int) -> list[wp.Graph]:
        """A graph for each thread: so many steps from `parity`."""
        if (parity, steps) not in self._graphs:
            graphs: list[wp.Graph] = []
            for launches in self._launches:
                with wp.ScopedCapture(device=self.model.device) as capture:
                    for k in range(steps):
                        if self.by_node:
                            self.state.wire_partial.zero_()
                        for launch in launches[(parity + k) % 2]:
                            launch.launch()
                graphs.append(capture.graph)
            self._graphs[parity, steps] = graphs
        return self._graphs[parity, steps]

    def evaluate_contact(self) -> None:
        """Contact forces of the current state, without a step."""
        if self.model.pair_count:
            self.together(self._contact[self.state.parity])

    def _contact_launch(self, parity: int, part: int) -> LaunchData:
        """Kernel, threads and arguments that find one part of the contact forces."""
        model, state = self.model, self.state
        if self.by_node:
            pair, pairs = self._share(model.pair_count, part)
            return find_contact_forces, pairs, contact_arguments(model, state, parity, pair, ())
        cache = (state.cached_slide, state.cached_node, state.cached_number)
        batch, batches = self._share(contact_batches(model), part)
        return find_contact_forces_by_batch, batches, contact_arguments(model, state, parity, batch, cache)

    def _contact_work(self, parity: int, part: int) -> list[LaunchData]:
        """The launches that find one part of the contact forces, with friction and what a treatment does to them."""
        found = self._contact_launch(parity, part)
        treated = contact_launches(self.model, self.state, part)
        if not len(self.state.pair_stuck):
            return [found, *treated]
        kernel, dim, arguments = found
        first = arguments[FIRST_OF_CONTACT]
        if kernel is find_contact_forces_by_batch:
            first, end = first * PAIR_BATCH, min((first + dim) * PAIR_BATCH, self.model.pair_count)
            dim = max(0, end - first)
        return [found, (add_friction, dim, friction_arguments(self.model, self.state, first)), *treated]

    def _commands(self, work: list[LaunchData]) -> list[wp.Launch]:
        """Launches that can be repeated, of those that have anything to do."""
        return [
            wp.launch(kernel, dim=dim, inputs=arguments, device=self.model.device, record_cmd=True)
            for kernel, dim, arguments in work
            if dim > 0
        ]

    def _share(self, count: int, part: int) -> tuple[int, int]:
        """Begin and number of what a part takes of `count` things."""
        begin, end = count * part // self.threads, count * (part + 1) // self.threads
        return begin, end - begin

    def _record(self, parity: int, part: int) -> list[wp.Launch]:
        """One thread's part of a step: contact, then wires and bodies, then the first thread alone grips and the numbers
        of the next step."""
        end = [(update_control, 1, [self.state.wire_partial, self.state.body_partial, self.state.control])]
        work = [*self._contact_work(parity, part), *self._wait(), *self._motion(parity, part)]
        return self._commands([*work, *(end if part == 0 else []), *self._wait()])

    def _motion(self, parity: int, part: int) -> list[LaunchData]:
        """One thread's part of what moves: wires and bodies, then the first thread alone grips."""
        model, state = self.model, self.state
        now, then = parity, 1 - parity
        wire_kernel, size, last = self.wire_kernel
        block, blocks = self._share(len(model.panel.block_first), part)
        body, bodies = self._share(body_blocks(model), part)
        return [
            (wire_kernel, blocks * size, [*wire_arguments(model, state, now, then, block), *last]),
            *body_launches(model, state, then, body, bodies),
            *self._wait(),
            *(self._grips(then) if part == 0 else []),
        ]

    def _grips(self, then: int) -> list[LaunchData]:
        model, state = self.model, self.state
        return [
            (slide_clamps, len(model.panel.sliding_clamp), slide_arguments(model, state, then)),
            (move_held_nodes, model.mesh.held_node.shape[0], grip_arguments(model, state, then)),
        ]

    def _wait(self) -> list[LaunchData]:
        """What the threads wait for each other with."""
        return [(wait_for_all, 1, [self.threads, _yield_address(), self._barrier])] if self.threads > 1 else []


def _launch_all(launches: list[wp.Launch]) -> None:
    for launch in launches:
        launch.launch()


def _yield_address() -> int:
    """Address of the C library's sched_yield, 0 where it has none."""
    try:
        return ctypes.cast(ctypes.CDLL(None).sched_yield, ctypes.c_void_p).value or 0
    except (AttributeError, OSError, TypeError):
        return 0


def thread_count(nodes: int) -> int:
    """Threads that share a step of so many nodes on the CPU: WARPKNIT_THREADS, or one a core that has NODES_A_THREAD."""
    cores = len(CORES)
    given = os.environ.get("WARPKNIT_THREADS", "")
    wanted = int(given) if given.isdecimal() else cores
    return max(1, min(wanted, cores, nodes // NODES_A_THREAD))


class ForceProbe:
    """Accelerations f/m of the current state, without a step: the same kernels with VELOCITY_FACTOR = TIME_STEP = 0."""

    def __init__(self, model: Model, state: State, stepper: Stepper) -> None:
        self.state = state
        real, nodes, device = model.precision.real, model.panel.node_count, model.device
        self.acceleration_x = wp.zeros(nodes, dtype=real, device=device)
        self.acceleration_y = wp.zeros(nodes, dtype=real, device=device)
        unused = [wp.zeros(nodes, dtype=model.precision.coordinate, device=device) for _ in range(2)]
        self._stepper = stepper
        self._launches = []
        for parity in (0, 1):
            kernel, size, last = stepper.wire_kernel
            parts = []
            for block, blocks in stepper.shares(len(model.panel.block_first)):
                arguments = wire_arguments(model, state, parity, parity, block)
                arguments[-5:] = [self.acceleration_x, self.acceleration_y, *unused, state.wire_partial]
                launch = wp.launch(kernel, dim=size * blocks, inputs=[*arguments, *last], device=device, record_cmd=True)
                parts.append(launch.launch)
            self._launches.append(parts)

    def evaluate(self) -> None:
        kept = self.state.read_control().copy()
        self.state.write_control(PROBING)
        self.launch()
        self.state.control.assign(kept)

    def launch(self) -> None:
        """Evaluate while the control array says PROBING."""
        self._stepper.evaluate_contact()
        self._stepper.together(self._launches[self.state.parity])


def contact_arguments(model: Model, state: State, now: int, first: int, cache: tuple[wp.array, ...]) -> list:
    """`first` pair or batch; `cache`: what the kernel by batch keeps."""
    rest, mesh, real = model.rest, model.mesh, model.precision.real
    return [
        state.control, real(model.precision.unit), real(model.contact_reach), first,
        rest.table_x, rest.table_y, rest.rest_x, rest.rest_y, rest.curve,
        mesh.pair_wire, mesh.pair_seed, mesh.pair_table, mesh.pair_low, mesh.pair_high, mesh.pair_side,
        mesh.pair_rest_x, mesh.pair_rest_y, state.pair_wake, state.pair_offset,
        mesh.wire_first, mesh.wire_count, mesh.wire_closed,
        state.node_ux[now], state.node_uy[now], state.body_ux, state.body_uy,
        state.pair_slide, state.pair_u, *cache,
        state.pair_node, state.pair_gap, state.pair_force, state.pair_body_x, state.pair_body_y,
        state.pair_nodal_x, state.pair_nodal_y,
    ]  # fmt: skip


def friction_arguments(model: Model, state: State, first: int) -> list:
    mesh = model.mesh
    return [
        state.control, wp.float64(model.scene.contact.friction), first, mesh.pair_side, mesh.pair_table, model.rest.rest_length,
        state.pair_stuck, state.pair_slide, state.pair_u, state.pair_force,
        state.pair_body_x, state.pair_body_y, state.pair_nodal_x, state.pair_nodal_y,
    ]  # fmt: skip


def wire_arguments(model: Model, state: State, now: int, then: int, first_block: int) -> list:
    rest, mesh, real = model.rest, model.mesh, model.precision.real
    return [
        mesh.block_first, mesh.block_count, mesh.block_table, mesh.block_wire,
        mesh.block_pair_start, mesh.block_held_start, mesh.wire_first, mesh.wire_count, mesh.wire_closed,
        mesh.wire_clamp, state.wire_axial, state.wire_mass, state.control, real(model.precision.unit),
        first_block, int(model.is_gripped),
        rest.rest_x, rest.rest_y, rest.rest_length, rest.inverse_length, rest.rest_angle, rest.hinge_stiffness,
        rest.inverse_mass, rest.node_mass,
        state.tension_offset, real(model.yield_moment), real(model.scene.wire.hardening), state.plastic_turn, state.back_turn,
        mesh.block_pair, state.pair_node, state.pair_force, state.pair_nodal_x, state.pair_nodal_y, mesh.held_node,
        state.node_ux[now], state.node_uy[now], state.node_vx, state.node_vy,
        state.node_ux[then], state.node_uy[then], state.wire_partial,
    ]  # fmt: skip


def body_arguments(model: Model, state: State, first_block: int, bodies: slice, partial_sums: wp.array) -> list:
    """`first_block` counts from the first of the `bodies`."""
    pairs = slice(2 * bodies.start, 2 * bodies.stop)

    def part(values: wp.array, which: slice) -> wp.array:
        return values[which] if which.stop > which.start else values  # Warp has no empty slices

    return [
        state.control, model.precision.real(model.precision.unit), BODY_BLOCK,
        first_block, int(model.scene.solver.drive == "relax"),
        *(part(values, pairs) for values in (state.pair_force, state.pair_body_x, state.pair_body_y)),
        *(part(values, bodies) for values in (state.body_ux, state.body_uy, state.body_vx, state.body_vy)),
        partial_sums,
    ]  # fmt: skip


def contact_launches(model: Model, state: State, part: int) -> list[LaunchData]:
    """What a treatment does to contact forces that were just found: kernels, threads, arguments."""
    treatment, mesh = model.treatment, model.mesh
    if treatment.contact_node is None or part > 0:
        return []
    arguments = [
        state.control, wp.float64(treatment.pinball), mesh.contact_node, mesh.pair_low, mesh.pair_high,
        state.pair_slide, state.pair_u, state.pair_node, state.pair_gap, state.pair_force,
        state.pair_body_x, state.pair_body_y, state.pair_nodal_x, state.pair_nodal_y,
    ]  # fmt: skip
    return [(lend_contact_force, model.panel.body_count, arguments)]


def body_launches(model: Model, state: State, then: int, first: int, blocks: int) -> list[LaunchData]:
    """The step of `blocks` blocks of bodies from the `first` on, by the treatment."""
    treatment = model.treatment
    if treatment.is_free:
        owned = slice(0, model.owned_bodies)
        arguments = body_arguments(model, state, first, owned, state.body_partial)
        return [(step_bodies, blocks if model.owned_bodies else 0, arguments)]
    if treatment.anchored:
        return [(step_anchored_bodies, min(blocks, 1), anchor_arguments(model, state))]
    nodes = [state.control, model.mesh.contact_node, state.node_ux[then], state.node_uy[then], state.body_ux, state.body_uy]
    return [(follow_contact_node, model.panel.body_count if blocks else 0, nodes)]


def ground_arguments(model: Model, state: State) -> list:
    mesh, treatment = model.mesh, model.treatment
    limits = [wp.float64(treatment.spring_stiffness), wp.float64(treatment.spring_limit)]
    return [state.control, *limits, mesh.body_origin_x, mesh.body_origin_y]


def anchor_arguments(model: Model, state: State) -> list:
    return [
        *ground_arguments(model, state), state.pair_force, state.pair_body_x, state.pair_body_y,
        state.anchor_x, state.anchor_y, state.body_ux, state.body_uy, state.body_vx, state.body_vy, state.body_partial,
    ]  # fmt: skip


def slide_arguments(model: Model, state: State, then: int) -> list:
    mesh = model.mesh
    return [
        state.control, mesh.slide_node, mesh.slide_block, mesh.slide_lever_x, mesh.slide_lever_y,
        mesh.block_table, mesh.block_wire, model.rest.inverse_mass, state.wire_mass,
        state.slide_vy, state.node_vx, state.node_vy, state.node_ux[then], state.node_uy[then], state.wire_partial,
    ]  # fmt: skip


def grip_arguments(model: Model, state: State, then: int) -> list:
    mesh = model.mesh
    return [
        state.control, model.precision.real(model.precision.unit),
        mesh.held_node, mesh.held_lever_x, mesh.held_lever_y, mesh.held_clamp, state.clamp_from, state.clamp_to,
        state.node_ux[then], state.node_uy[then],
    ]  # fmt: skip
