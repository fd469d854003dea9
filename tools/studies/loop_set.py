"""Loops that are set in part: the natural curvature of the wire, taken step by step from that as knitted to a share of it.

`wire.set_fraction` takes the whole step at once. In space wires then spring into each other, and the first level diverges or
wires overlap; in steps of 2 % it converges.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from warpknit.host import fetch, store
from warpknit.solve.simulate import Simulation

STEP = 0.02  # of the curvature as knitted


def releases(simulation: Simulation, fraction: float) -> Iterator[float]:
    """Take the natural curvature of a spatial mesh, built with stress-free loops, to `fraction` of it; yields the share after
    each step, for its equilibrium to be found."""
    arrays = simulation.mechanics.stepper.arrays
    curvature, twist = fetch(arrays.natural_curvature).copy(), fetch(arrays.natural_twist).copy()
    count = math.ceil((1.0 - fraction) / STEP - 1e-9)
    for number in range(1, count + 1):
        share = 1.0 + number / count * (fraction - 1.0)
        store(arrays.natural_curvature, share * curvature)
        store(arrays.natural_twist, share * twist)
        yield share
