"""Wires of diameter 1 that touch: what tests of contact and of friction share."""

import numpy as np

from reference.rods import SECTION, update
from warpknit.compute.steering import Steering
from warpknit.spatial.rod_relaxation import RodRelaxation
from warpknit.spatial.rod_step import RodStepper
from warpknit.spatial.rods import rods_of
from warpknit.spatial.wire_contact import WireContact

STIFFNESS = 100.0  # [N/m]


def line(begin: list[float], way: list[float], nodes: int) -> np.ndarray:
    """Nodes (nodes, 3) on a straight line, `way` apart."""
    return np.asarray(begin, dtype=float) + np.arange(nodes)[:, None] * np.asarray(way, dtype=float)


def touching(wires: list[np.ndarray], **options: float) -> tuple[RodStepper, WireContact]:
    """Wires of diameter 1 as they are, with their contacts found."""
    stepper = RodStepper(rods_of(SECTION, wires))
    contact = WireContact(stepper, STIFFNESS, **options)
    contact.search()
    stepper.evaluate()
    return stepper, contact


def advance(contact: WireContact, steps: int) -> int:
    """Take steps, with searches where the travel budget is used up; the steps taken, fewer where the state diverged."""
    taken, steering = 0, contact.stepper.state.steering
    while taken < steps:
        before = int(steering.step)
        contact.stepper.step(steps - taken)
        now = steering.read()
        taken += int(now.step) - before
        if now.status == Steering.DIVERGED:
            return taken
        if now.status == Steering.STALE:
            contact.refresh()
    return taken


def plies(spacing: float, hardness: float = 1.0, friction: float = 0.0) -> tuple[WireContact, RodRelaxation, int]:
    """Two wires wound round each other, pressed into each other by 0.02 d and held at their ends, after 4000 steps towards rest;
    hardness: of contact, over that of bending. And the nodes of each."""
    pitch, turns, radius = 10.0, 3.0, 0.49
    nodes = round(turns * np.hypot(2 * np.pi * radius, pitch) / spacing) + 1
    angle = np.linspace(0.0, 2 * np.pi * turns, nodes)
    wires = [np.stack([r * np.cos(angle), r * np.sin(angle), pitch * angle / (2 * np.pi)], axis=1) for r in (radius, -radius)]
    ends = [0, 1, nodes - 2, nodes - 1]
    rods = rods_of(SECTION, wires).holding([*ends, *(nodes + e for e in ends)], [0, nodes - 2, nodes, 2 * nodes - 2])
    stiffness = hardness * 4 * SECTION.bending_stiffness / spacing**3
    stepper = RodStepper(rods)
    contact = WireContact(stepper, stiffness, friction=friction)
    contact.search()
    rest = RodRelaxation(stepper, softening=max(1.0, 4 * spacing**2))
    for _ in range(160):
        advance(contact, 25)
        update(rest)
        rest.masses.renew()
        rest.damping.keep_motion(rest.stepper.rows)
    return contact, rest, nodes
