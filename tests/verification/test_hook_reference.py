"""The boundary value problem that the hooks are compared with (tools/studies/hook_reference.py), against closed forms.

Its parts are planar elasticas, so a single part must give Euler's cantilever; its clamped arc under a small sideways load must
give the linear one; and a solution must balance as a whole.
"""

from __future__ import annotations

import numpy as np
import pytest
from hook_reference import TOLERANCE, Hook, _solved, _Unit

DEFLECTION = {1.0: 0.301721, 5.0: 0.713792, 10.0: 0.810609}  # w/L of a cantilever under an end load P L^2/EI


@pytest.mark.parametrize("load", DEFLECTION)
def test_a_part_is_the_elastica(load: float) -> None:
    """theta'' = -P cos theta, theta(0) = 0, theta'(1) = 0: straight, inextensible, the load at its end across it."""
    unit = _Unit(Hook(axial_stiffness=1e9))
    unit.curvature = (0.0, 0.0)
    s = np.linspace(0.0, 1.0, 101)
    guess = np.stack([s, 0.3 * s, s * (2 - s), 2 - 2 * s])

    def conditions(a: np.ndarray, b: np.ndarray, _p: np.ndarray) -> np.ndarray:
        return np.array([a[0], a[1], a[2], b[3], _p[0] - load])

    solution = _solved(lambda _s, y, p: unit.slope(y, 0, 0.0, p[0]), conditions, s, guess, np.array([load]))
    assert solution.y[1, -1] == pytest.approx(DEFLECTION[load], abs=1e-6)


def test_a_small_load_moves_the_driven_end_as_linear_beams_say() -> None:
    """Castigliano: H at the top of an arc clamped below, kept in direction and free up and down, bends it by H (y - mean of y)
    and pulls with N = H sin t, t from -phi to phi being the angle of the arc and y = R sin t, whose mean is zero. So it moves
    sideways by H times

        c = (R^3/EI + R/EA) integral sin^2 t dt = (R^3/EI + R/EA) (phi - sin phi cos phi)

    The error of a small displacement is of its first order, 1e-4 radii.
    """
    hook = Hook(axial_stiffness=1e3)
    unit = _Unit(hook)
    displacement = 1e-4
    half = 0.5 * unit.length
    compliance = (1.0 + unit.stretch) * (half - np.sin(half) * np.cos(half))
    assert unit.alone(displacement).p[0] == pytest.approx(displacement / compliance, rel=10 * displacement)


def test_wires_touch_where_the_force_begins() -> None:
    """At the displacement where the clearance vanishes the contact force does, and just beyond it grows from there; the places
    of contact are those nearest to touching. The force is linear in what is beyond, to a share of that."""
    hook = Hook()
    unit = _Unit(hook)
    closing = unit.closing(1.0)
    clearance, arc_left, arc_right = unit.clearance(closing)
    assert clearance == pytest.approx(0.0, abs=1e-9)
    step = 1e-3
    near, far = hook.solve([(closing + step) * hook.radius, (closing + 2 * step) * hook.radius])
    assert far.force / near.force == pytest.approx(2.0, rel=20 * step)
    for contact in (near, far):
        assert contact.arc_left / hook.radius == pytest.approx(arc_left, abs=30 * step)
        assert contact.arc_right / hook.radius == pytest.approx(arc_right, abs=30 * step)


def test_a_solution_balances_and_keeps_its_span() -> None:
    """The wires are `span` apart along the common normal at the contact, and the work of the driven end is what both wires store:
    dE/du = its force, by central differences over 2e-3 radii (error of the order of that squared)."""
    hook = Hook()
    step = 1e-3 * hook.radius
    before, at, after = hook.solve([0.6e-3 - step, 0.6e-3, 0.6e-3 + step])
    gap = np.linalg.norm(at.left[:, None] - at.right[None], axis=2)
    assert gap.min() < hook.span  # the lens has two corners, where the wires cross in the plane
    normal_gap = np.linalg.norm(_point(at.left, at.arc_left, hook) - _point(at.right, at.arc_right, hook))
    assert normal_gap == pytest.approx(hook.span, rel=1e-3)
    stored = [_bending_energy(c, hook) for c in (before, after)]
    assert (stored[1] - stored[0]) / (2 * step) == pytest.approx(at.drive, rel=2e-3)
    assert at.residual < 2 * TOLERANCE


def _arcs(line: np.ndarray) -> np.ndarray:
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])


def _point(line: np.ndarray, arc: float, hook: Hook) -> np.ndarray:
    """Point of a centre line at a share of its length; chords of 200 points a part are short by 1e-6 of it."""
    s = _arcs(line) * hook.length / _arcs(line)[-1]
    return np.array([np.interp(arc, s, line[:, 0]), np.interp(arc, s, line[:, 1])])


def _bending_energy(contact, hook: Hook) -> float:
    """[J] of both wires, from the turning of the drawn polylines."""
    total = 0.0
    for line, natural in ((contact.left, 1.0), (contact.right, -1.0)):
        edge = np.diff(line, axis=0)
        length = np.linalg.norm(edge, axis=1)
        keep = length > 1e-9 * hook.length
        edge, length = edge[keep], length[keep]
        turn = np.arctan2(edge[:-1, 0] * edge[1:, 1] - edge[:-1, 1] * edge[1:, 0], np.sum(edge[:-1] * edge[1:], axis=1))
        here = 0.5 * (length[:-1] + length[1:])
        total += 0.5 * hook.bending_stiffness * np.sum((turn / here - natural / hook.radius) ** 2 * here)
        # the halves of a segment next to the clamps
        for end in (0, -1):
            kappa = turn[end] / here[end] - natural / hook.radius
            total += 0.25 * hook.bending_stiffness * kappa**2 * length[end]
    return total
