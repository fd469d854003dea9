"""Rods made by hand for the verification tests: energies, gradients and stiffness matrices by differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from warpknit.compute.host import fetch
from warpknit.spatial.rod_relaxation import RodRelaxation
from warpknit.spatial.rod_step import CHECK_STEPS, RodStepper
from warpknit.spatial.rods import Rods, Section


def round_section(diameter: float, youngs_modulus: float, poissons_ratio: float, density: float) -> Section:
    """The section of a solid round wire; SI units."""
    area = np.pi * diameter**2 / 4
    inertia = np.pi * diameter**4 / 64
    shear = youngs_modulus / (2 * (1 + poissons_ratio))
    return Section(
        axial_stiffness=youngs_modulus * area,
        bending_stiffness=youngs_modulus * inertia,
        twist_stiffness=shear * 2 * inertia,
        linear_density=density * area,
        rotary_inertia=density * 2 * inertia,
        thickness=diameter,
    )


SECTION = round_section(1.0, 1e4, 0.3, 1.0)


class Pose:
    """A stepper held at a pose: nodes move and sections turn from there, and come back to it."""

    def __init__(self, rods: Rods, device: str = "cpu") -> None:
        self.rods = rods
        self.stepper = RodStepper(rods, device)
        self.has_segment = rods.following >= 0
        self.stepper.evaluate()
        self.keep()

    def keep(self) -> None:
        """Take the state as it is for the pose."""
        state = self.stepper.state
        self.position = state.position.numpy().copy()
        self._frames = state.tangent.numpy().copy(), state.director.numpy().copy()

    @property
    def tangent(self) -> np.ndarray:
        """(node, 3) of the segments."""
        return self._frames[0]

    def bend_by(self, move: np.ndarray, turn: np.ndarray) -> None:
        """Move nodes by (node, 3) and turn sections by [node]; that is the pose from now on."""
        self.at(move, turn)
        self.keep()

    def at(self, move: np.ndarray, turn: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Energy, forces and torques at the pose moved and turned."""
        state = self.stepper.state
        for array, kept in zip((state.tangent, state.director), self._frames, strict=True):
            array.assign(kept)
        self.stepper.place(self.position + move, turn)
        torque = np.where(self.has_segment, state.torque.numpy(), 0.0)
        return energy(self.stepper), state.force.numpy().copy(), torque

    def unknowns(self) -> int:
        return 3 * self.rods.node_count + int(self.has_segment.sum())

    def split(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Moves (node, 3) and turns [node] of a vector of all unknowns."""
        nodes = self.rods.node_count
        turn = np.zeros(nodes)
        turn[self.has_segment] = values[3 * nodes :]
        return values[: 3 * nodes].reshape(nodes, 3), turn

    def join(self, force: np.ndarray, torque: np.ndarray) -> np.ndarray:
        return np.concatenate([force.ravel(), torque[self.has_segment]])

    def gradient(self, step: float) -> np.ndarray:
        """Forces and torques as minus the central difference of the energy."""
        found = np.zeros(self.unknowns())
        for k in range(len(found)):
            way = np.zeros(len(found))
            way[k] = step
            found[k] = -(self.at(*self.split(way))[0] - self.at(*self.split(-way))[0]) / (2 * step)
        return found

    def stiffness(self, step: float) -> np.ndarray:
        """Hessian of the energy at the pose, which must be at rest, by central differences of forces."""
        rows = []
        for k in range(self.unknowns()):
            way = np.zeros(self.unknowns())
            way[k] = step
            ahead, behind = (self.join(*self.at(*self.split(sign * way))[1:]) for sign in (1, -1))
            rows.append((behind - ahead) / (2 * step))
        return np.array(rows)


def helix(radius: float, pitch: float, nodes: int, turns: float = 1.0) -> np.ndarray:
    """Nodes (nodes, 3) of a helix about z without its last point; `pitch` a turn."""
    angle = 2 * np.pi * turns * np.arange(nodes) / nodes
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), pitch * angle / (2 * np.pi)], axis=1)


def straight(rods: Rods) -> Rods:
    """The same wires, naturally straight and without twist."""
    return replace(rods, natural_curvature=np.zeros((rods.node_count, 2)), natural_twist=np.zeros(rods.node_count))


def set_masses(stepper: RodStepper, node_mass: float, spin_inertia: float) -> None:
    """Equal masses at all nodes and segments."""
    nodes = stepper.rods.node_count
    stepper.set_masses(node_mass=np.full((nodes, 1), node_mass), spin_inertia=np.full(nodes, spin_inertia))


def energy(stepper: RodStepper) -> float:
    """[J] energy of stretch, bending and twist in the state last evaluated."""
    rods, state = stepper.rods, stepper.state
    natural = rods.natural_length * state.steering.length_factor
    strain = fetch(state.length) / natural - 1.0
    stretch = natural * (fetch(state.tension_offset) * strain + 0.5 * fetch(state.stretch_stiffness) * strain**2)
    bent = stepper.yielding.elastic_energy + stepper.yielding.plastic_potential()
    return float((stepper.sums.of_nodes(np.where(rods.following >= 0, stretch, 0.0)) + bent)[0])


def update(rest: RodRelaxation) -> None:
    """What a convergence check does to a relaxation without contact multipliers."""
    rows = rest.stepper.rows
    rest.stepper.evaluate()
    rest.damping.renew(rows)
    rest.multipliers.renew(rest.sums(of_mean=False).mean_excess, rows)
    rest.stepper.evaluate()
    rest.damping.keep_motion(rows)


def residual_of(rest: RodRelaxation) -> float:
    """[N] the largest force out of balance, torques taken as couples of a segment's length."""
    rods = rest.stepper.rods
    spacing = float(rods.natural_length[rods.following >= 0].min())
    state, sliding = rest.stepper.state, np.zeros((0, 3)) if rest.stepper.clamps is None else rest.stepper.clamps.force
    couple = float(np.abs(fetch(state.torque)[rods.can_turn]).max(initial=0.0)) / spacing
    force = np.concatenate([fetch(state.force)[rods.is_free], sliding])
    return max(float(np.linalg.norm(force, axis=1).max(initial=0.0)), couple)


def relaxed(rest: RodRelaxation, tolerance: float, strain_tolerance: float = 1e-6, most_steps: int = 500_000) -> int:
    """Steps taken until no force out of balance is above `tolerance` [N] and what softening does is below `strain_tolerance`."""
    for steps in range(0, most_steps, CHECK_STEPS):
        rest.stepper.step(CHECK_STEPS)
        update(rest)
        if steps % (2 * CHECK_STEPS) == 0:
            rest.masses.renew()
        if residual_of(rest) < tolerance and float(rest.sums(of_mean=False).excess_max.max()) < strain_tolerance:
            return steps + CHECK_STEPS
    raise AssertionError(f"{residual_of(rest):.3g} N out of balance after {most_steps:,} steps")
