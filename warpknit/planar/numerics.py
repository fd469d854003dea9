"""Initial numerics of a run: softening, contact penalty, masses, time step, loading time and damping.

relax: fictitious masses that are stable at unit step. ramp: real masses, optionally scaled, and a step from the highest
frequency.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..kernels.bend import BEND_EIGENVALUE, BOW
from ..kernels.contact_friction import TANGENTIAL
from ..mechanics.numerics import LOADING_PERIODS, MASS_MARGIN, STEP_MARGIN, TURN_ALLOWANCE, slowest_rate
from ..mesh.rest_table import Table
from ..scene import Scene

CONTACT_TO_AXIAL = 0.25  # contact stiffness over the softened axial stiffness of a segment, where the scene gives none
CONTACT_SHARE = 1.0  # of the penalty in a fictitious mass: half of two pairs at one node
HOOK_CONTACT = 100.0  # contact stiffness of two hooked wires in relax, over EI/R^3: large against the wires, small
# enough for the convergence of a body on a soft spring
BODY_MASS_SHARE = 0.5  # body mass over half a loop of wire, in a ramp (the paper: less)


@dataclass(frozen=True)
class Numerics:
    """Numerical constants of a run."""

    softening: float  # EA over the stiffness of the dynamics
    contact_stiffness: float  # [N/m]
    node_mass: np.ndarray  # [entry] [kg]
    body_mass: float  # [kg]; fictitious in relax
    added_mass: float  # share of mass added by scaling
    time_step: float  # [s] of the unloaded mesh; 1 in relax
    limited_by: str  # what limits the time step
    loading_time: float  # [s] of a stage, in a ramp
    damping: float  # [1/s] mass-proportional, in a ramp


def choose_numerics(scene: Scene, table: Table, loop_length: float) -> Numerics:
    """Softening, contact stiffness, masses and time step of the unloaded mesh; `loop_length` [m] of wire."""
    wire = scene.wire
    h = float(table.spacing.min())
    softening = scene.solver.axial_softening
    axial = wire.axial_stiffness / softening / h
    bend = wire.bending_stiffness / h**3
    contact = scene.contact.stiffness
    if scene.hook is not None and scene.solver.drive == "relax" and contact is None:
        contact = HOOK_CONTACT * wire.bending_stiffness / scene.hook.radius**3
    if scene.solver.drive == "relax":
        contact = CONTACT_TO_AXIAL * max(axial, 4 * bend) if contact is None else contact
        turn = np.abs(table.rest_angle)
        sharpest = np.maximum(turn, np.maximum(np.roll(turn, 1), np.roll(turn, -1))) + TURN_ALLOWANCE  # [entry] with neighbours
        soft, along = wire.axial_stiffness / softening, contact_along(scene)
        node = unit_step_mass(soft, wire.bending_stiffness, contact, h, sharpest, contact_along=along)
        return Numerics(softening, contact, node, MASS_MARGIN * contact, 0.0, 1.0, "unit step", 0.0, 0.0)
    true_mass = wire.linear_density * table.node_length
    mass = true_mass * scene.solver.mass_scaling
    contact = 20 * bend if contact is None else contact
    share = BODY_MASS_SHARE if scene.contact.body_mass is None else scene.contact.body_mass
    body_mass = share * wire.linear_density * 0.5 * loop_length * scene.solver.mass_scaling
    stiffness = max(4 * axial, BEND_EIGENVALUE * bend)
    target = scene.solver.target_time_step
    if target is not None:
        mass = np.maximum(mass, (stiffness + 2 * contact) * (target / (2 * STEP_MARGIN)) ** 2)
        body_mass = max(body_mass, 4 * contact * (target / (2 * STEP_MARGIN)) ** 2)
    added = float(mass.sum() / true_mass.sum() - 1.0)
    rates = {
        "stretch": 4 * axial / mass.min(),
        "bending": BEND_EIGENVALUE * bend / mass.min(),
        "contact": max((stiffness + 2 * contact) / mass.min(), 4 * contact / body_mass),
    }
    limited_by = max(rates, key=lambda k: rates[k])
    step = STEP_MARGIN * 2 / math.sqrt(max(rates.values()))
    slowest = slowest_rate(scene, loop_length)
    loading_time = scene.solver.loading_time or LOADING_PERIODS * 2.0 * math.pi / slowest
    damping = slowest if scene.solver.damping is None else scene.solver.damping
    return Numerics(softening, contact, mass, body_mass, added, step, limited_by, loading_time, damping)


def unit_step_mass(
    axial_stiffness: np.ndarray | float,
    bending_stiffness: float,
    contact_stiffness: np.ndarray | float,
    spacing: float,
    turning: np.ndarray | float = 0.0,
    tension: np.ndarray | float = 0.0,
    contact_along: float = 0.0,
) -> np.ndarray:
    """Node mass [kg] that is stable at a step of 1 s. Softened EA [N], EI [N m2], penalty [N/m], spacing [m].

    The eigenvalues a along the wire and b across it are in docs/theory/stepping.md. CONTACT_SHARE covers pairs of neighbouring
    bodies at one node; `contact_along` times that acts along the wire. A turn [rad] couples a and b.
    """
    pull = np.maximum(tension, 0.0)
    contact = 4.0 * CONTACT_SHARE * np.asarray(contact_stiffness)
    a = 4.0 * np.asarray(axial_stiffness) / spacing + contact_along * contact
    b = BEND_EIGENVALUE * bending_stiffness / spacing**3 + (64.0 * BOW + 4.0) * pull / spacing + contact
    sine = np.sin(np.minimum(turning, 0.5 * np.pi))
    return MASS_MARGIN * 0.25 * (0.5 * (a + b) + np.sqrt(0.25 * (a - b) ** 2 + a * b * sine**2))


def contact_along(scene: Scene) -> float:
    """Stiffness of a contact along the wire over its penalty: from friction, or the constraint of a hook."""
    if scene.hook is not None:
        return 1.0
    return float(TANGENTIAL) if scene.contact.friction > 0.0 else 0.0
