"""Openings between straight wires."""

import numpy as np
import pytest

from warpknit.planar.observables import read
from warpknit.planar.state import initial_state
from warpknit.scene import make_scene
from warpknit.solve.model import build_model
from warpknit.studies.opening_size import POINTS_ACROSS, openings, openings_between

PITCH, THICKNESS = 1e-3, 50e-6


def lattice(periods: np.ndarray, copies: int):
    """Wires along both periods, `copies` of the cell a side in one tile."""
    begins, ends = [], []
    for k in range(copies):
        begins += [periods @ [0.0, k], periods @ [k, 0.0]]
        ends += [periods @ [copies, k], periods @ [k, copies]]
    return np.array(begins), np.array(ends), copies * periods


@pytest.mark.parametrize("copies", [1, 2])
def test_openings_of_a_square_lattice(copies):
    """Squares of side p - d, one a cell, with a circle of that diameter; to a step of the grid on each side."""
    found = openings_between(*lattice(PITCH * np.eye(2), copies), THICKNESS)
    assert len(found) == copies**2
    step, side = THICKNESS / POINTS_ACROSS, PITCH - THICKNESS
    for opening in found:
        assert opening.circle == pytest.approx(side, abs=2 * step)
        assert opening.width == pytest.approx(side, abs=2 * step)
        assert opening.height == pytest.approx(side, abs=2 * step)
        assert opening.area == pytest.approx(side**2, abs=4 * side * step)


def test_openings_of_a_sheared_lattice():
    """Shear by g leaves height p - d between the wires along x; the circle fits between the closer pair, p/sqrt(1 + g^2) - d."""
    shear = 0.5
    found = openings_between(*lattice(PITCH * np.array([[1.0, shear], [0.0, 1.0]]), 1), THICKNESS)
    assert len(found) == 1
    step = THICKNESS / POINTS_ACROSS
    assert found[0].height == pytest.approx(PITCH - THICKNESS, abs=2 * step)
    assert found[0].circle == pytest.approx(PITCH / np.hypot(1.0, shear) - THICKNESS, abs=2 * step)


def test_a_yarn_of_many_ends_leaves_smaller_openings():
    """Four ends count as a round bundle of twice the diameter of one, as they do where they touch: the circle is smaller by one
    diameter; a step of the grid is a fifth of one thickness."""
    found, diameter = [], 60e-6
    for ends in (1, 4):
        scene = {"wire": {"diameter": diameter, "ends": ends}, "model": {"kind": "planar", "boundary": "periodic"}}
        model = build_model(make_scene(scene))
        found.append(max(opening.circle for opening in openings(read(model, initial_state(model)))))
    assert found[0] - found[1] == pytest.approx(diameter, abs=0.5 * diameter)
