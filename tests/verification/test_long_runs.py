"""Long runs stay right: a mesh that is shaken keeps its energy, one that rests stays where it is, and both to the bit.

tools/studies/long_run.py takes ten million steps of the same; docs/studies/extremes.md says what becomes of them.
"""

from __future__ import annotations

import numpy as np
import pytest
from long_run import kinetic, mesh, shake, speeds_of, stored
from stepping import advance

from warpknit import measure
from warpknit.planar.observables import read
from warpknit.planar.step import NeighbourSearch, Stepper
from warpknit.planar.time_step import stable_step

TOLERANCE = 1e-3  # residual of what is brought to rest


@pytest.mark.slow
def test_undamped_motion_keeps_its_energy() -> None:
    """m v(n - 1/2) v(n + 1/2)/2 and what is stored, the cell at 14 % being shaken by noise for 200,000 steps.

    Where motion is not linear the sum swings by what central differences leave out, evenly around what they keep; so the mean
    of the first fifth and that of the last one are apart by no more than five standard errors. With contact points found to
    1e-5 of a segment, which trail behind their bodies, the energy of the noise grew by half in this time.
    """
    model, state = mesh("shaken", "double", 0.14)
    neighbours, stepper = NeighbourSearch(model, state), Stepper(model, state, threads=1)
    neighbours.search()
    at_rest = stored(read(model, state))
    step = stable_step(model, state, 0)
    shake(model, state, step)
    state.steering.set(time_step=step, damping=0.0, velocity_factor=1.0, force_factor=step)
    put_in = kinetic(model, state, read(model, state), speeds_of(state))
    looks, share = 2000, 400
    energy = []
    for _ in range(looks):
        assert advance(stepper, neighbours, 99)
        reading, speeds = read(model, state), speeds_of(state)
        assert advance(stepper, neighbours, 1)
        energy.append(stored(reading) + kinetic(model, state, reading, speeds) - at_rest)
    first, last = np.array(energy[:share]), np.array(energy[-share:])
    error = 5.0 * np.sqrt((first.var() + last.var()) / share)
    assert error < 0.2 * put_in  # or nothing would be seen
    assert abs(last.mean() - first.mean()) < error


@pytest.mark.parametrize("precision", ["single", "double"])
def test_a_mesh_at_rest_stays_there_and_does_so_to_the_bit(precision: str) -> None:
    """100,000 steps more change tension and energy by no more than the residual tolerance lets them, and no contact."""
    model, state = mesh("relax", precision, 0.14)
    neighbours, stepper = NeighbourSearch(model, state), Stepper(model, state, threads=1)
    neighbours.search()
    start, kept = read(model, state), state.arrays()
    ends = []
    for _ in range(2):
        state.restore(kept)
        neighbours.search()
        assert advance(stepper, neighbours, 100_000)
        ends.append(state.arrays())
    assert all(np.array_equal(ends[0][name], ends[1][name]) for name in ends[0])
    end = read(model, state)
    assert measure.mesh_tension(end) == pytest.approx(measure.mesh_tension(start), rel=TOLERANCE, abs=0)
    assert stored(end) == pytest.approx(stored(start), rel=TOLERANCE, abs=0)
    assert np.array_equal(measure.pair_active(end), measure.pair_active(start))
