"""The largest stable time step at the current stiffnesses and masses.

Central differences are stable up to w dt = 2, with w bounded by frequency.py. Contacts that may close before the next check count
as closed. A light body that bounces between its wires gains energy where its own frequency, w_body^2 = 2 k/m_body, is near that
limit, as contacts that open and close within a step are not linear. So w_body dt <= 1 as well, which matters only for bodies
lighter than two or three nodes. The step is STEP_MARGIN times the bound: the margin of 10 % covers a rise of w^2 by 23 % between
two checks, and avoids energy gain of strongly excited nodes near the limit.
"""

from __future__ import annotations

import math

from ..mechanics.numerics import STEP_MARGIN
from .frequency import frequency_square
from .model import Model
from .observables import PlanarObservables, read
from .state import State

BOUNCING = 4.0  # lower bound of w^2 over w_body^2
FASTER = 2.0  # largest speed before the next check over the current one
NEAR = 0.02  # of the reach of a contact: smaller gaps count as closed


def largest_step(host: PlanarObservables, steps: int) -> float:
    """Largest stable step [s] of the next `steps` steps."""
    model, control = host.model, host.control
    move = FASTER * float(control.speed_max * control.time_step)
    approach = NEAR * abs(model.contact_reach) + 2.0 * steps * move
    body = 2.0 * float(control.contact_stiffness * control.body_inverse_mass)
    square = max(frequency_square(host, approach), BOUNCING * body * (model.pair_count > 0))
    return 2.0 / math.sqrt(square)


def stable_step(model: Model, state: State, steps: int) -> float:
    """Time step [s] of a ramp for the next `steps` steps."""
    host = read(model, state)
    return STEP_MARGIN * model.ranks.from_first(lambda: largest_step(host, steps))
