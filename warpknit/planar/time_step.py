"""The largest stable time step, from the stiffnesses and masses as they are now.

Central differences are stable up to w dt = 2, w being bounded by frequency.py. Contacts count as closed that may close before the
next look. A light body that bounces between its wires gains energy where its own frequency, w_body^2 = 2 k/m_body, is at that
limit: contacts that open and close within a step are not linear. So w_body dt <= 1 as well, which rules only where a body
weighs less than two or three nodes. The step is STEP_MARGIN times the bound: the margin of 10 % covers a rise of w^2 by 23 %
between two looks, and keeps off the limit where nodes that are shaken hard gain energy too.
"""

from __future__ import annotations

import math

from ..kernels import control as c
from ..numerics import STEP_MARGIN
from .frequency import frequency_square
from .model import Model
from .observables import PlanarObservables, read
from .state import State

BOUNCING = 4.0  # times w_body^2, at least, is reckoned with
FASTER = 2.0  # times the largest speed now, that something may have before the next look
NEAR = 0.02  # of the reach of a contact: nearer to closing than this counts as closed in any case


def largest_step(host: PlanarObservables, steps: int) -> float:
    """Step [s] up to which the next `steps` steps are stable."""
    model, control = host.model, host.control
    move = FASTER * float(control[int(c.SPEED_MAX)] * control[int(c.TIME_STEP)])
    approach = NEAR * abs(model.contact_reach) + 2.0 * steps * move
    body = 2.0 * float(control[int(c.CONTACT_STIFFNESS)] * control[int(c.BODY_INVERSE_MASS)])
    square = max(frequency_square(host, approach), BOUNCING * body * (model.pair_count > 0))
    return 2.0 / math.sqrt(square)


def stable_step(model: Model, state: State, steps: int) -> float:
    """Time step [s] of a ramp for the next `steps` steps from the present state on."""
    host = read(model, state)
    return STEP_MARGIN * model.ranks.from_first(lambda: largest_step(host, steps))
