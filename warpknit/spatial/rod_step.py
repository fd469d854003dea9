"""One time step of rods: the table of contents of the physics in space.

    update_frames  edges, tangents and directors of the displaced nodes
    bend_rods      bending and twist at the nodes
    contact        forces between wires, where there is a contact
    sum_rod_forces stretch, and the sum of all forces
    find_accelerations    by the masses, which couple neighbours along the wire
    move_rods      update of nodes and sections
    clamps         motion of moving and sliding clamps, if any
    update_control control array of the next step

Many steps are captured once as a graph and replayed without Python in between.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import warp as wp

from ..kernels import control as c
from ..kernels.control import update_control
from ..launch import Launch, bind
from ..numerics import GRAPH_STEPS
from .fictitious_masses import Masses
from .rod_arrays import (
    RodArrays,
    RodState,
    bend_launch,
    factor_launch,
    force_launch,
    frames_launch,
    motion_launches,
    rest_state,
    upload_rods,
)
from .rods import Rods
from .yielding import Yielding

FROZEN = 3.0  # status in which a step computes forces and moves nothing


class Contact(Protocol):
    """Contact forces between the wires."""

    @property
    def version(self) -> int:
        """Number of the arrays that `launches` uses; launches are captured once per version."""

    def launches(self) -> Sequence[Launch]:
        """Launches that add to contact_force and contact_couple."""

    def stiffness_bounds(self, approach: float) -> tuple[np.ndarray, np.ndarray]:
        """Bounds on the stiffness of contacts: of nodes (node, 3) [N/m] along x, y, z, and of sections [node] [N m].

        Wires may approach each other by `approach` [m].
        """


class Clamps(Protocol):
    """Motion of held nodes."""

    def launches(self) -> Sequence[Launch]:
        """Launches that move held nodes after the step."""


class RodStepper:
    """Steps rods in time; `contact` adds the forces between wires, `clamps` move held nodes."""

    def __init__(self, rods: Rods, device: str = "cpu", state: RodState | None = None) -> None:
        """state: of the rods; default: at rest."""
        self.rods = rods
        self.device = device
        self.arrays: RodArrays = upload_rods(rods, device)
        self.state: RodState = rest_state(rods, device) if state is None else state
        self.yielding = Yielding(rods, self.arrays, self.state)
        self.contact: Contact | None = None
        self.clamps: Clamps | None = None
        self._graphs: dict[tuple[int, int], wp.Graph] = {}
        factor_launch(self.arrays, self.state).run(device)

    def _force_launches(self) -> list[Launch]:
        """The launches of all forces, in order."""
        arrays, state = self.arrays, self.state
        return [
            frames_launch(arrays, state),
            bend_launch(self.rods, arrays, state),
            *(self.contact.launches() if self.contact is not None else ()),
            force_launch(arrays, state),
        ]

    def _motion_launches(self) -> list[Launch]:
        """The launches of the motion, in order."""
        moved = motion_launches(self.arrays, self.state)
        return [*moved, *(self.clamps.launches() if self.clamps is not None else ())]

    def step(self, count: int) -> None:
        """Take `count` steps; they have no effect once the state is frozen (kernels/control.py)."""
        for size in GRAPH_STEPS:
            for _ in range(count // size):
                wp.capture_launch(self._graph(size))
            count %= size

    def evaluate(self) -> None:
        """Compute positions, frames and forces of the current state, without a step."""
        kept = float(self.state.read_control()[int(c.STATUS)])
        self.state.write_control({c.STATUS: FROZEN})
        wp.capture_launch(self._graph(0))
        self.state.write_control({c.STATUS: kept})

    def _launch(self, launches: list[Launch]) -> None:
        for launch in launches:
            if launch.threads:
                launch.run(self.device)

    def _graph(self, steps: int) -> wp.Graph:
        """A graph of so many steps; of the forces alone for none."""
        key = (self.contact.version if self.contact is not None else -1, steps)
        if key not in self._graphs:
            state = self.state
            control = bind(update_control, 1, state, wire_partial=state.partial, body_partial=state.no_bodies)
            with wp.ScopedCapture(device=self.device) as capture:
                if not steps:
                    self._launch(self._force_launches())
                for _ in range(steps):
                    state.partial.zero_()
                    self._launch([*self._force_launches(), *self._motion_launches(), control])
            self._graphs[key] = capture.graph
        return self._graphs[key]

    # --- the state on the host ---

    def set_time_step(self, time_step: float, damping: float = 0.0, look_ahead: float = 0.0) -> None:
        """Set the step [s], mass-proportional damping [1/s] and look-ahead [steps] (kernels/control.py)."""
        half = 0.5 * damping * time_step
        self.state.write_control(
            {
                c.TIME_STEP: time_step,
                c.DAMPING: damping,
                c.LOOK_AHEAD: look_ahead,
                c.VELOCITY_FACTOR: (1 - half) / (1 + half),
                c.FORCE_FACTOR: time_step / (1 + half),
            }
        )

    def set_masses(self, masses: Masses) -> None:
        """Set the masses of the dynamics."""
        state = self.state
        state.node_mass.assign(masses.node)
        state.next_mass.assign(masses.next)
        state.second_mass.assign(masses.second)
        state.spin_inertia.assign(masses.spin)
        state.next_inertia.assign(masses.next_spin)
        factor_launch(self.arrays, state).run(self.device)

    def masses(self) -> Masses:
        """The masses of the dynamics, on the host."""
        state = self.state
        return Masses(
            state.node_mass.numpy(), state.next_mass.numpy(), state.second_mass.numpy(),
            state.spin_inertia.numpy(), state.next_inertia.numpy(),
        )  # fmt: skip

    def place(self, position: np.ndarray, turn: np.ndarray | None = None) -> None:
        """Move nodes to positions (node, 3) [m] and rotate sections by angles [node] [rad]; frames follow."""
        affine = self.rods.position.copy()
        affine[:, :2] = affine[:, :2] @ self.state.gradient.T
        self.state.displacement.assign(np.asarray(position) - affine)
        if turn is not None:
            self.state.pending_turn.assign(turn)
        self.evaluate()

    def forces(self) -> tuple[np.ndarray, np.ndarray]:
        """Forces (node, 3) [N] and torques of the segments [node] [N m] of the current state."""
        self.evaluate()
        return self.state.force.numpy().copy(), self.state.torque.numpy().copy()

    def segment_forces(self) -> np.ndarray:
        """(node, 3) [N] force of each segment on its first node, in the state last evaluated."""
        rods, state = self.rods, self.state
        factor = float(state.read_control()[int(c.LENGTH_FACTOR)])
        strain = state.length.numpy() / (rods.natural_length * factor) - 1.0
        tension = state.tension_offset.numpy() + state.stretch_stiffness.numpy() * strain
        tangent, length = state.tangent.numpy(), state.length.numpy()[:, None]
        edge_force = (
            tension[:, None] * tangent + state.edge_gradient_after.numpy() + state.edge_gradient_before.numpy()[rods.following]
        )
        edge_force = edge_force + np.cross(tangent, state.contact_couple.numpy()) / length
        return np.where((rods.following >= 0)[:, None], edge_force, 0.0)

    def energy(self) -> float:
        """[J] energy of stretch, bending and twist in the state last evaluated."""
        rods, state = self.rods, self.state
        section = rods.section
        factor = float(state.read_control()[int(c.LENGTH_FACTOR)])
        has_segment, is_inside = rods.following >= 0, (rods.following >= 0) & (rods.previous >= 0)
        natural = rods.natural_length * factor
        strain = state.length.numpy() / natural - 1.0
        stretch = natural * (state.tension_offset.numpy() * strain + 0.5 * state.stretch_stiffness.numpy() * strain**2)
        share = np.divide(1.0, rods.node_length * factor, out=np.zeros(rods.node_count), where=is_inside)
        twisted = (state.twist.numpy() - self.arrays.natural_twist.numpy()) ** 2
        twist = 0.5 * share * section.twist_stiffness * twisted
        return float(stretch[has_segment].sum() + twist[is_inside].sum()) + self.yielding.potential()
