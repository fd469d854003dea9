"""The largest stable time step, from the stiffnesses and masses as they are now.

Central differences are stable up to w dt = 2. The highest frequency is bounded term by term,

    w^2 <= lambda_wire + lambda_contact
    lambda_wire    = (a + b)/2 + sqrt((a - b)^2/4 + a b sin^2 theta) + t
    a = 4 K/(h m)   b = 80/3 EI/(h^3 m)   t = 4 max(T, 0)/(h m)   lambda_contact = 2 k (1/m_body + 1/m)

(K axial stiffness, T tension, m node mass, h segment, k contact penalty, theta the largest turning angle). Stretch and
bending act across each other on a straight wire, so the larger rules there; a turn theta couples them, and
a b sin^2 theta bounds the product of the off-diagonal blocks. Tension stiffens sideways motion; compression only softens it
and is left out. A body has two pairs and a node at most two, and each pair's rank-one stiffness has the norm
k (1/m_body + sum w^2/m) with sum w^2 <= 1. A light body that bounces between its wires gains energy where its own frequency,
2 k/m_body = w_body^2, is at that limit: contacts that open and close within a step are not linear. So w_body dt <= 1 as well,
which rules only where a body weighs less than two or three nodes. The step is STEP_MARGIN times the bound, and is renewed at
every look at the state: the margin of 10 % covers a rise of w^2 by 23 % between two looks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .. import measure
from ..kernels import control as c
from ..kernels.bend import BEND_EIGENVALUE
from ..model.model import Model
from ..model.numerics import STEP_MARGIN
from ..model.state import State

BOUNCING = 4.0  # times w_body^2, at least, is reckoned with


@dataclass(frozen=True)
class FrequencyBound:
    """Bounds on w^2 [1/s2] by their cause."""

    stretch: float
    bending: float
    tension: float
    contact: float
    square: float  # [1/s2] all together

    @property
    def limited_by(self) -> str:
        parts = {"stretch": self.stretch, "bending": self.bending, "tension": self.tension, "contact": self.contact}
        return max(parts, key=lambda name: parts[name])


def frequency_bound(model: Model, reading: measure.Reading) -> FrequencyBound:
    """Bound on the highest frequency of a state."""
    table, panel = model.table, model.panel
    inverse_mass = model.rest.inverse_mass.numpy().astype(float)
    wire_axial = reading.wire_axial
    worst: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    for thread in np.unique(panel.wire_thread):
        wires = np.nonzero(panel.wire_thread == thread)[0]
        entry = slice(table.start[thread], table.start[thread] + table.nodes[thread])
        h = float(table.rest_length[entry].min())
        im = float(inverse_mass[entry].max())
        a = 4.0 * float(wire_axial[wires].max()) / h * im
        b = BEND_EIGENVALUE * model.bending_stiffness / h**3 * im
        nodes = np.concatenate([np.arange(panel.wire_first[w], panel.wire_first[w] + panel.wire_count[w]) for w in wires])
        t = 4.0 * max(0.0, float(reading.tension[nodes].max())) / h * im
        angle = np.abs(reading.turning[nodes] + reading.natural_angle[nodes]).max()
        sine = math.sin(min(float(angle), 0.5 * math.pi))
        square = 0.5 * (a + b) + math.sqrt(0.25 * (a - b) ** 2 + a * b * sine * sine) + t
        if square > worst[3]:
            worst = (a, b, t, square)
    contact = body = 0.0
    if model.pair_count:
        penalty = float(reading.control[int(c.CONTACT_STIFFNESS)])
        body = 2.0 * penalty * float(reading.control[int(c.BODY_INVERSE_MASS)])
        contact = body + 2.0 * penalty * float(inverse_mass.max())
    return FrequencyBound(*worst[:3], contact, max(worst[3] + contact, BOUNCING * body))


def stable_step(model: Model, state: State) -> float:
    """Time step [s] of a ramp for the present state."""
    reading = measure.read(model, state)
    square = model.ranks.from_first(lambda: frequency_bound(reading.model, reading).square)
    return STEP_MARGIN * 2.0 / math.sqrt(square)
