"""A closed trefoil of elastic rod that grows thicker: how short a rod can be for its thickness.

The rod is straight without load, resists bending and hardly twist, and does not stretch. Scenes have no load that tightens a
closed wire: heat makes it thicker and longer alike. Here the distance d at which it touches itself grows from level to level at
the same length L. The contact forces grow without bound as L/d comes near its least value: 32.86 radii, L/d = 16.43, for an
elastic trefoil (Starostin and van der Heijden 2014), 16.37 for the ideal one. A thin rod tends to a circle that is covered
twice, with the bending energy 8 pi^2 B/L.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from warpknit.compute.steering import Steering
from warpknit.spatial.multipliers import ContactMultipliers
from warpknit.spatial.rod_relaxation import RodRelaxation
from warpknit.spatial.rod_step import CHECK_STEPS, RodStepper
from warpknit.spatial.rods import Section, rods_of
from warpknit.spatial.wire_contact import WireContact

THICKNESS = 1.0  # [m] of the section: of its EA, not of the contact
STIFFNESS = 1.0  # [N m2] B
STRETCH = 1e5  # EA d^2/B
TWIST = 0.1  # GJ/B; with far less, sections would turn against each other from segment to segment
PENALTY = 30.0  # [B/d^3] of contact
TOLERANCE = 5e-3  # force out of balance over the mean contact force
MOST_CHECKS = 500  # of 25 steps a level
LOCAL = 10.0  # largest force out of balance over its root mean square that counts


@dataclass(frozen=True)
class TrefoilRow:
    """One state; forces over B/d^2."""

    nodes: int
    length_d: float  # L/d of the rod as it is, stretched by less than AXIAL_ERROR
    energy: float  # of bending, over the doubly covered circle's
    contact_force: float  # of all contacts
    tension: float  # mean
    curvature: float  # largest, times d
    contacts: int
    overlap: float  # largest, over d
    residual: float  # largest of three errors over what is allowed: forces, stretch and overlaps
    steps: int
    wall_s: float


def trefoil_points(length: float, nodes: int) -> np.ndarray:
    """Nodes (nodes, 3) evenly spaced along a torus knot (2, 3) of this length [d]."""
    t = np.linspace(0.0, 2.0 * np.pi, 4001)
    around = 1.0 + 0.35 * np.cos(3 * t)
    curve = np.stack([around * np.cos(2 * t), around * np.sin(2 * t), 0.35 * np.sin(3 * t)], axis=1)
    arc = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1)))
    at = np.interp(np.arange(nodes) / nodes * arc[-1], arc, t)
    around = 1.0 + 0.35 * np.cos(3 * at)
    points = np.stack([around * np.cos(2 * at), around * np.sin(2 * at), 0.35 * np.sin(3 * at)], axis=1)
    return length / arc[-1] * points


def advance(stepper: RodStepper, contact: WireContact) -> None:
    """Take CHECK_STEPS steps with searches when due, fewer if the state diverges."""
    end = stepper.state.steering.step + CHECK_STEPS
    while (now := stepper.state.steering.read()).step < end and now.status != Steering.DIVERGED:
        if now.status == Steering.STALE:
            contact.refresh()
        stepper.step(int(end - now.step))


def tightened_trefoil(lengths: Sequence[float], nodes: int) -> Iterator[TrefoilRow]:
    """States at falling L/d. The rod has the length of the first, the distance d grows."""
    begin = time.perf_counter()
    length = lengths[0]
    section = Section(STRETCH * STIFFNESS, STIFFNESS, TWIST * STIFFNESS, 1.0, 0.1, THICKNESS)
    rods = rods_of(section, [trefoil_points(length, nodes)], [np.zeros(3)])
    rods = replace(rods, natural_curvature=np.zeros((nodes, 2)))
    stepper, steps = RodStepper(rods), 0
    for now in lengths:
        d = length / now
        stepper.rods = replace(rods, section=replace(section, thickness=d))
        contact = WireContact(stepper, PENALTY * STIFFNESS / d**3)
        contact.search()
        rest = RodRelaxation(stepper, softening=STRETCH * (d / length) ** 2)
        multipliers = ContactMultipliers(contact, PENALTY * STIFFNESS / d**3)
        for check in range(MOST_CHECKS):
            advance(stepper, contact)
            steps += CHECK_STEPS
            stepper.evaluate()
            rest.damping.renew(stepper.rows)
            sums, contacts = rest.sums(of_mean=True), contact.sums()
            ratio = np.array([np.inf])
            if contacts.pushing[0]:
                rms = np.sqrt(sums.unbalanced_square / sums.free_nodes)
                balance = np.maximum(rms, sums.unbalanced_max / LOCAL) / contacts.mean_push
                ratio = np.max([balance / TOLERANCE, sums.excess_ratio, multipliers.error_ratio(contacts)], axis=0)
            rest.multipliers.monitor_progress(ratio, sums.excess_ratio, stepper.rows)
            if ratio[0] < 1.0 and check > 8:
                break
            rest.multipliers.renew(sums.mean_excess, stepper.rows)
            multipliers.renew(contacts, rest.multipliers.rate(stepper.rows), stepper.rows, loading=np.array([False]))
            rest.masses.renew()
            rest.damping.keep_motion(stepper.rows)
        stepper.evaluate()
        touching = contact.read_contacts()
        unit, force = STIFFNESS / d**2, touching.force
        bend = np.linalg.norm(np.asarray(stepper.state.curvature.numpy()), axis=1) / rods.node_length
        arc = float(np.sum(rods.natural_arc * (1.0 + rest.tension() / section.axial_stiffness)))
        yield TrefoilRow(
            nodes, arc / d, 0.5 * float(np.sum(bend**2 * rods.node_length)) * length / (8.0 * np.pi**2),
            float(force.sum()) / unit, float(rest.tension().mean()) / unit, float(bend.max()) * d, len(force),
            float(touching.overlap.max(initial=0.0)) / d, float(ratio[0]), steps, time.perf_counter() - begin,
        )  # fmt: skip
