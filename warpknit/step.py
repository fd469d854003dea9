"""One time step: the table of contents of the physics.

A `Stepper` holds the launches of a step, recorded once for either parity of the displacement buffers, and graphs of many
steps, which Warp replays without Python in between, on the CPU as on a GPU.
"""

from __future__ import annotations

import warp as wp

from .kernels import control as c
from .kernels.bodies import BODY_BLOCK, step_bodies
from .kernels.contact import find_contact_forces
from .kernels.control import update_control
from .kernels.grip import move_held_nodes
from .kernels.wires import step_wires_by_node
from .kernels.wires_by_block import BLOCK_SIZE, step_wires_by_block
from .model import Model, block_threads, body_blocks
from .state import State

KERNELS = (find_contact_forces, step_wires_by_block, step_wires_by_node, step_bodies, move_held_nodes, update_control)


GRAPH_STEPS = (50, 2)  # steps that are replayed at once


class Stepper:
    """Takes steps of a model's state."""

    def __init__(self, model: Model, state: State, *, by_node: bool | None = None) -> None:
        """`by_node` picks the wire kernel; default: a thread a node on a GPU, a thread a block on the CPU."""
        self.model = model
        self.state = state
        self.by_node = model.device != "cpu" if by_node is None else by_node
        self._launches = [self._record(0), self._record(1)]
        self._graphs: dict[int, wp.Graph] = {}

    @property
    def wire_kernel(self) -> tuple[wp.Kernel, int, list[int]]:
        """The wire kernel, its threads, and what its arguments end with."""
        if self.by_node:
            return step_wires_by_node, block_threads(self.model), [BLOCK_SIZE]
        return step_wires_by_block, len(self.model.panel.block_first), []

    def step(self, count: int) -> None:
        """Take `count` steps; they do nothing once the state is frozen (see kernels/control.py)."""
        if count and self.state.parity == 1:
            self._step_once(1)
            self.state.parity = 0
            count -= 1
        for size in GRAPH_STEPS:
            for _ in range(count // size):
                wp.capture_launch(self._graph(size))
            count %= size
        if count:
            self._step_once(0)
            self.state.parity = 1

    def _graph(self, steps: int) -> wp.Graph:
        """So many steps, an even number, from parity 0."""
        if steps not in self._graphs:
            with wp.ScopedCapture(device=self.model.device) as capture:
                for _ in range(steps // 2):
                    self._step_once(0)
                    self._step_once(1)
            self._graphs[steps] = capture.graph
        return self._graphs[steps]

    def _step_once(self, parity: int) -> None:
        if self.by_node:
            self.state.wire_partial.zero_()
        for launch in self._launches[parity]:
            launch.launch()

    def evaluate_contact(self) -> None:
        """Contact forces of the current state, without a step."""
        if self.model.pair_count:
            self._launches[self.state.parity][0].launch()

    def _record(self, parity: int) -> list[wp.Launch]:
        """Contact, then wires, bodies and grips, then the numbers of the next step."""
        model, state = self.model, self.state
        now, then = parity, 1 - parity
        wire_kernel, threads, size = self.wire_kernel
        work = [
            (find_contact_forces, model.pair_count, contact_arguments(model, state, now)),
            (
                wire_kernel,
                threads,
                [*wire_arguments(model, state, now, then), *size],
            ),
            (step_bodies, body_blocks(model), body_arguments(model, state)),
            (move_held_nodes, len(model.panel.held_node), grip_arguments(model, state, then)),
            (update_control, 1, [state.wire_partial, state.body_partial, state.control]),
        ]
        return [
            wp.launch(kernel, dim=dim, inputs=arguments, device=model.device, record_cmd=True)
            for kernel, dim, arguments in work
            if dim > 0
        ]


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
            arguments = wire_arguments(model, state, parity, parity)
            arguments[-5:] = [self.acceleration_x, self.acceleration_y, *unused, state.wire_partial]
            kernel, threads, size = stepper.wire_kernel
            self._launches.append(
                wp.launch(kernel, dim=threads, inputs=[*arguments, *size], device=device, record_cmd=True)
            )

    def evaluate(self) -> None:
        kept = self.state.read_control().copy()
        self.state.write_control({c.VELOCITY_FACTOR: 0.0, c.FORCE_FACTOR: 1.0, c.TIME_STEP: 0.0})
        self._stepper.evaluate_contact()
        self._launches[self.state.parity].launch()
        self.state.control.assign(kept)


def contact_arguments(model: Model, state: State, now: int) -> list:
    rest, mesh, real = model.rest, model.mesh, model.precision.real
    return [
        state.control, real(model.precision.unit), real(model.contact_reach),
        rest.table_x, rest.table_y, rest.rest_x, rest.rest_y, rest.curve,
        mesh.pair_wire, mesh.pair_seed, mesh.pair_table, mesh.pair_low, mesh.pair_high, mesh.pair_side,
        mesh.pair_rest_x, mesh.pair_rest_y, state.pair_wake, state.pair_offset,
        mesh.wire_first, mesh.wire_count, mesh.wire_closed,
        state.node_ux[now], state.node_uy[now], state.body_ux, state.body_uy,
        state.pair_slide, state.pair_u,
        state.pair_node, state.pair_gap, state.pair_force, state.pair_body_x, state.pair_body_y,
        state.pair_nodal_x, state.pair_nodal_y,
    ]  # fmt: skip


def wire_arguments(model: Model, state: State, now: int, then: int) -> list:
    rest, mesh, real = model.rest, model.mesh, model.precision.real
    return [
        mesh.block_first, mesh.block_count, mesh.block_table, mesh.block_wire,
        mesh.block_pair_start, mesh.block_held_start, mesh.wire_first, mesh.wire_count, mesh.wire_closed,
        mesh.wire_hinge, state.wire_axial, state.wire_mass, state.control, real(model.precision.unit),
        rest.rest_x, rest.rest_y, rest.rest_length, rest.inverse_length, rest.rest_angle, rest.hinge_stiffness,
        rest.inverse_mass, rest.node_mass,
        state.tension_offset,
        mesh.block_pair, state.pair_node, state.pair_force, state.pair_nodal_x, state.pair_nodal_y, mesh.held_node,
        state.node_ux[now], state.node_uy[now], state.node_vx, state.node_vy,
        state.node_ux[then], state.node_uy[then], state.wire_partial,
    ]  # fmt: skip


def body_arguments(model: Model, state: State) -> list:
    return [
        state.control, model.precision.real(model.precision.unit), BODY_BLOCK,
        int(model.scene.solver.drive == "relax"),
        state.pair_force, state.pair_body_x, state.pair_body_y,
        state.body_ux, state.body_uy, state.body_vx, state.body_vy, state.body_partial,
    ]  # fmt: skip


def grip_arguments(model: Model, state: State, then: int) -> list:
    mesh = model.mesh
    return [
        state.control, model.precision.real(model.precision.unit),
        mesh.held_node, mesh.held_lever_x, mesh.held_lever_y, state.node_ux[then], state.node_uy[then],
    ]  # fmt: skip
