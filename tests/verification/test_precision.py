"""Slow motion far from the origin, in the single precision that stores displacements as counts of a unit.

x = 50 mm,  v = 1 mm/s,  dt = 10 ns:  a step is 1e-11 m, where float32 at x resolves 4e-9 m
"""

import numpy as np
import pytest

from reference.plane_wires import DIAMETER, Rig, panel_of_wires, straight, table_of_wires

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


@pytest.mark.slow
def test_creep_is_not_lost() -> None:
    """A pinned beam, overdamped, creeps back to straight 1 m from the origin: u = u0 exp(-(w^2/c) t) in its first mode.

    w^2 = (EI/mu) (pi/L)^4 (1 - b^2/6), b = pi/20, and the same of the next term in w^2/c^2. A step moves no node by more than a
    twentieth of a count, where float32 at 1 m resolves tens of thousands. float32 leaves 6e-8 of an edge, so 6e-8 rad of a
    turning angle, against (pi/L)^2 h u0 of it: a tolerance of 2e-3 on what is left of the mode.
    """
    segments, length = 20, 1e-3
    table = table_of_wires([straight(segments + 1, length / segments) + [1.0, 1.0]])
    softening = (2 * length / segments / DIAMETER) ** 2
    rig = Rig(table, panel_of_wires(table, held=[0, segments]), precision="single", axial_softening=softening)
    wire = rig.model.scene.wire
    shape = np.sin(np.pi * np.arange(segments + 1) / segments)
    start = 0.1 * DIAMETER
    square = wire.bending_stiffness / wire.linear_density * (np.pi / length) ** 4 * (1 - (np.pi / segments) ** 2 / 6)
    step = 0.5 / np.sqrt(16 * wire.bending_stiffness / wire.linear_density) * (length / segments) ** 2
    unit = rig.model.precision.unit
    damping = 20 * square * start * step / unit  # a twentieth of a count a step, at the start
    rate = square / damping * (1 + square / damping**2)
    rig.set_time_step(step, damping=damping)
    rig.place(rig.rest + start * np.stack([0 * shape, shape], axis=1))
    rig.set_velocity(-rate * start * np.stack([0 * shape, shape], axis=1))
    steps = int(0.3 / (rate * step))
    moves = rate * start * step
    assert moves < 0.051 * unit
    assert np.float32(1.0) + np.float32(moves) == np.float32(1.0)
    rig.step(steps)
    left = (rig.position() - rig.rest)[:, 1] @ shape / (shape @ shape)
    assert left == pytest.approx(start * np.exp(-rate * step * steps), abs=2e-3 * start)
    assert np.isfinite(rig.state.steering.kinetic_twice)
