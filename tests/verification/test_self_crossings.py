"""Intersections of wires are refused all at once, those of one wire by the places along it."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

from warpknit.base.errors import ModelError
from warpknit.scene import make_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation

LOOPS, BULGE = 4, 0.3  # loops 1 mm apart


def in_mm(number: str, unit: str) -> float:
    return float(number) * {"um": 1e-3, "mm": 1.0}[unit]


def test_all_intersections_of_a_wire_with_itself_are_listed(tmp_path: Path) -> None:
    """x = t/(2 pi) + BULGE sin t, y = - cos t in mm, in the plane, meets itself at t = (2 k + 1) pi +- u, where u = 2 pi BULGE
    sin u, at x = k + 1/2 and y = cos u. Places are told to two decimals or three digits, on chords of 0.05 mm whose sag at a
    radius of more than 0.1 mm is below 0.05^2/0.8 = 3e-3 mm; arcs to four digits."""
    t = np.linspace(0.0, 2.0 * np.pi * LOOPS, 400 * LOOPS + 1)
    points = np.stack([t / (2.0 * np.pi) + BULGE * np.sin(t), -np.cos(t), 0.0 * t], axis=1)
    np.savez(tmp_path / "loops.npz", wire=points)
    wires = {"file": "loops.npz", "unit": "mm", "loop_size": "1 mm", "node_spacing": "0.05 mm"}
    table = {"wires": wires, "wire": {"diameter": "0.05 mm"}, "contact": {"friction": 0.0}}
    simulation = Simulation(build_model(make_scene(table, path=tmp_path / "loops.toml")))
    with pytest.raises(ModelError) as refused:
        simulation.compile()
    one = r"the centre lines of two parts of wire 1 intersect near \((\S+), (\S+)\) (\wm), (\S+) (\wm) and (\S+) (\wm) along it"
    found = re.findall(one, str(refused.value))
    assert len(found) == LOOPS
    u = brentq(lambda u: u - 2.0 * np.pi * BULGE * np.sin(u), 1.0, 3.0)
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    for k, (x, y, unit, first, first_unit, second, second_unit) in enumerate(found):
        assert (in_mm(x, unit), in_mm(y, unit)) == pytest.approx((k + 0.5, np.cos(u)), abs=8e-3)
        arcs = np.interp((2 * k + 1) * np.pi + np.array([-u, u]), t, arc)
        assert (in_mm(first, first_unit), in_mm(second, second_unit)) == pytest.approx(arcs, rel=1e-3)
