"""Loops that are set in part: the natural curvature of the wire, taken step by step from that as knitted to a share of it.

At once, spatial wires would spring into each other. A run with `wire.set_fraction` takes the same steps before its first record;
this is for meshes whose loads a study finds itself.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from warpknit.compute.host import fetch, store
from warpknit.solve.simulate import Simulation

STEP = 0.02  # of the curvature as knitted


def releases(simulation: Simulation, fraction: float) -> Iterator[float]:
    """Change the natural curvature of a mesh to `fraction` of itself, in steps. Yields the share after each step,
    for its equilibrium.
    """
    arrays = simulation.mechanics.stepper.arrays
    curvature, twist = fetch(arrays.natural_curvature).copy(), fetch(arrays.natural_twist).copy()
    count = math.ceil((1.0 - fraction) / STEP - 1e-9)
    for number in range(1, count + 1):
        share = 1.0 + number / count * (fraction - 1.0)
        store(arrays.natural_curvature, share * curvature)
        store(arrays.natural_twist, share * twist)
        yield share
