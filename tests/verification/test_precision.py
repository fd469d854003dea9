"""Slow motion far from the origin, in the single precision that stores displacements as counts of a unit.

x = 50 mm,  v = 1 mm/s,  dt = 10 ns:  a step is 1e-11 m, where float32 at x resolves 4e-9 m
"""

import numpy as np
import pytest
from verification.wires import Rig, panel_of_wires, straight, table_of_wires

TIME_STEP = 1e-8
STEPS = 4000


@pytest.mark.parametrize("speed", [1e-3, 1e-4, 3e-6])
def test_slow_motion_is_not_lost(speed: float, device: str) -> None:
    """After n steps a free wire has moved by n v dt, to two counts and what float32 leaves of v."""
    table = table_of_wires([straight(20, 100e-6) + [50e-3, -20e-3]])
    rig = Rig(table, panel_of_wires(table), device, precision="single")
    rig.set_time_step(TIME_STEP)
    rig.set_velocity(np.full_like(rig.rest, speed) * [1.0, -1.0])
    rig.step(STEPS)
    moved = (rig.position() - rig.rest) * [1.0, -1.0]
    way = STEPS * TIME_STEP * speed
    assert np.float32(50e-3 + TIME_STEP * speed) == np.float32(50e-3)
    assert np.max(np.abs(moved - way)) < 2 * rig.model.precision.unit + 1e-6 * way
