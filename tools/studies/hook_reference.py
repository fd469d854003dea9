"""Two hooked wires as a boundary value problem: planar elasticas with one frictionless contact, by scipy.integrate.solve_bvp.

    solution = Hook(radius=1e-3, ...).solve([0.5e-3, 1.0e-3])

Shares nothing with the kernels: no nodes, no bodies, no relaxation. The left wire runs from a clamp at its lower end to an upper
end that is free to move up and down only; the right wire's upper end is free up and down too and stands `displacement` to the
right of where it was. Every end keeps its direction (`upper_ends_turn` lets the upper ones go). On each of the four parts between
an end and the contact, with s the arc length at rest, theta the direction of the wire and (H, V) the force by which the part
above pulls on the part below,

    x' = (1 + N/EA) cos theta     y' = (1 + N/EA) sin theta     theta' = kappa0 + m/EI
    m' = (1 + N/EA) (H sin theta - V cos theta)                 N = H cos theta + V sin theta

At the contact x, y, theta and m are continuous, and the force jumps by the contact force F along the normal that both wires have
in common: theta_left = theta_right, and the right wire lies at `span` to the left of the left one. With a contact body of a mesh
span = 1.25 d. Both V above the contact vanish, as the upper ends are free along y. Unknown are the four functions on each part,
F, both H above the contact, and where the contact is on either wire: 16 equations of first order and 5 numbers for 21 conditions.
Lengths are in units of the radius, forces of EI/R^2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_bvp
from scipy.optimize import brentq, minimize_scalar

TOLERANCE = 1e-8  # relative residual of the boundary value problem
LARGEST_STEP = 0.02  # radii of displacement from one solution to the next
PARTS = ("left below", "left above", "right below", "right above")


@dataclass(frozen=True)
class Contact:
    """The state of the hook at one displacement, in SI units."""

    displacement: float  # [m]
    force: float  # [N] of the contact; 0 where the wires do not touch
    arc_left: float  # [m] of the contact from the lower end, along the wire at rest; nan where there is none
    arc_right: float
    drive: float  # [N] that moves the driven end
    left: np.ndarray  # (n, 2) [m] centre lines
    right: np.ndarray
    residual: float  # largest relative residual that solve_bvp reports
    curvature: float = np.nan  # [1/m] of the left wire less the right one's at the contact


@dataclass(frozen=True)
class Hook:
    """Wires and geometry in SI units; lower ends stand at y = 0, the middle of the hook at x = 0."""

    radius: float = 1e-3
    length: float = 2.0 * np.pi / 3.0 * 1e-3
    overlap: float = 0.2e-3
    span: float = 1.25 * 15e-6  # the right wire lies left of the left one by this, along the common normal
    bending_stiffness: float = 400e9 * np.pi / 64.0 * 15e-6**4  # [N m2]
    axial_stiffness: float = 400e9 * np.pi / 4.0 * 15e-6**2  # [N]
    upper_ends_turn: bool = False  # whether they are hinged instead, which is how the paper may be read too

    def solve(self, displacements: Sequence[float], points: int = 201) -> list[Contact]:
        """States at rising displacements [m]. Raises `RuntimeError` where the solver does not converge."""
        unit = _Unit(self)
        found: list[Contact] = []
        contact = None
        closes = unit.closing(max(displacements) / self.radius)
        at = closes
        for displacement in displacements:
            wanted = displacement / self.radius
            if closes is None or wanted < closes:
                found.append(unit.open(wanted, points))
                continue
            if contact is None:
                contact = unit.touch(closes)
            steps = max(1, int(np.ceil((wanted - at) / LARGEST_STEP)))
            for k in range(1, steps + 1):
                contact = unit.press(at + (wanted - at) * k / steps, contact)
            at = wanted
            found.append(unit.state(wanted, contact, points))
        return found


class _Unit:
    """The same in units of radius and EI/R^2."""

    def __init__(self, hook: Hook) -> None:
        self.hook = hook
        self.length = hook.length / hook.radius
        self.turns = hook.upper_ends_turn
        self.span = hook.span / hook.radius
        self.stretch = hook.bending_stiffness / hook.radius**2 / hook.axial_stiffness  # N/EA of a unit force
        self.force_unit = hook.bending_stiffness / hook.radius**2
        half = 0.5 * self.length
        away = 1.0 - 0.5 * hook.overlap / hook.radius
        # x of the lower end, direction there, natural curvature; left wire, right wire
        self.foot = (-away + np.cos(half), away - np.cos(half))
        self.direction = (0.5 * np.pi - half, 0.5 * np.pi + half)
        self.curvature = (1.0, -1.0)

    def slope(self, y: np.ndarray, wire: int, horizontal: float, vertical: float) -> np.ndarray:
        """d(x, y, theta, m)/ds of one part."""
        theta, moment = y[2], y[3]
        cos, sin = np.cos(theta), np.sin(theta)
        stretch = 1.0 + self.stretch * (horizontal * cos + vertical * sin)
        return np.stack(
            [stretch * cos, stretch * sin, self.curvature[wire] + moment, stretch * (horizontal * sin - vertical * cos)]
        )

    def rest(self, wire: int, s: np.ndarray) -> np.ndarray:
        """(x, y, theta, m) (4, n) of the wire at rest at arc lengths s."""
        theta = self.direction[wire] + self.curvature[wire] * s
        x = self.foot[wire] + (np.sin(theta) - np.sin(self.direction[wire])) / self.curvature[wire]
        y = -(np.cos(theta) - np.cos(self.direction[wire])) / self.curvature[wire]
        return np.stack([x, y, theta, np.zeros_like(s)])

    # --- before they touch: only the right wire moves

    def alone(self, displacement: float):
        """The right wire without contact: its solution over s, and H."""
        before = None
        for share in np.linspace(0.0, 1.0, 1 + max(1, int(np.ceil(displacement / 0.1)))):
            top = self.rest(1, np.array([self.length]))[:, 0]

            def conditions(a: np.ndarray, b: np.ndarray, _p: np.ndarray, top=top, share=share) -> np.ndarray:
                return np.array([a[0] - self.foot[1], a[1], a[2] - self.direction[1],
                                 b[0] - top[0] - share * displacement, b[3] if self.turns else b[2] - top[2]])  # fmt: skip

            s = np.linspace(0.0, self.length, 41) if before is None else before.x
            guess = self.rest(1, s) if before is None else before.y
            start = np.zeros(1) if before is None else before.p
            before = _solved(lambda _s, y, p: self.slope(y, 1, p[0], 0.0), conditions, s, guess, start)
        return before

    def clearance(self, displacement: float) -> tuple[float, float, float]:
        """Distance of the wires along their common normal, and the arcs there."""
        right = self.alone(displacement).sol
        centre = np.array([self.foot[0] - np.cos(self.direction[0] - 0.5 * np.pi), np.sin(0.5 * self.length)])

        def depth(s: float) -> float:
            return float(np.linalg.norm(right(s)[:2] - centre))

        # the left wire is a circle about its centre: the right one lies inside it, by 1 - depth at its deepest
        best = minimize_scalar(depth, bounds=(0.0, self.length), method="bounded", options={"xatol": 1e-12})
        place = right(best.x)[:2] - centre
        arc_left = np.arctan2(place[1], place[0]) + 0.5 * self.length
        return 1.0 - depth(best.x) - self.span, float(arc_left), float(best.x)

    def closing(self, most: float) -> float | None:
        """Displacement at which the wires begin to touch, or None."""
        if self.clearance(0.0)[0] <= 0.0:
            raise RuntimeError("the wires touch at rest")
        low = 0.0
        for high in np.arange(0.05, most + 0.05, 0.05):
            if self.clearance(float(high))[0] <= 0.0:
                return float(brentq(lambda d: self.clearance(d)[0], low, high, xtol=1e-12))
            low = float(high)
        return None

    def open(self, displacement: float, points: int) -> Contact:
        hook, s = self.hook, np.linspace(0.0, self.length, points)
        right = self.alone(displacement)
        return Contact(
            displacement * hook.radius, 0.0, np.nan, np.nan, float(right.p[0]) * self.force_unit,
            hook.radius * self.rest(0, s)[:2].T, hook.radius * right.sol(s)[:2].T, float(right.rms_residuals.max()),
        )  # fmt: skip

    # --- in touch

    def touch(self, displacement: float):
        """The solution where the contact closes with no force, as a start."""
        _, arc_left, arc_right = self.clearance(displacement)
        right = self.alone(displacement)
        t = np.linspace(0.0, 1.0, 41)
        parts = [self.rest(0, arc_left * t), self.rest(0, arc_left + (self.length - arc_left) * t)]
        parts += [right.sol(arc_right * t), right.sol(arc_right + (self.length - arc_right) * t)]
        numbers = np.array([arc_left, arc_right, 0.0, 0.0, right.p[0]])
        return _Start(t, np.concatenate(parts), numbers)

    def press(self, displacement: float, before):
        """The solution at a displacement, from one near it."""
        top_left, top_right = (self.rest(wire, np.array([self.length]))[:, 0] for wire in (0, 1))

        def forces(y: np.ndarray, p: np.ndarray) -> list[tuple[int, float, float, float]]:
            """Wire, arc length, H and V of the four parts; `y` at the end of the parts below gives the normal."""
            arc_left, arc_right, force, pull_left, pull_right = p
            theta = y
            # left normal of the wires: the right wire lies there as seen from the left one, and pushes it the other way
            nx, ny = -np.sin(theta), np.cos(theta)
            return [
                (0, arc_left, pull_left - force * nx, -force * ny),
                (0, self.length - arc_left, pull_left, 0.0),
                (1, arc_right, pull_right + force * nx, force * ny),
                (1, self.length - arc_right, pull_right, 0.0),
            ]

        def slope(_t: np.ndarray, y: np.ndarray, p: np.ndarray) -> np.ndarray:
            # the direction at the contact is the last unknown number
            parts = forces(p[5], p[:5])
            return np.concatenate([
                length * self.slope(y[4 * k : 4 * k + 4], wire, horizontal, vertical)
                for k, (wire, length, horizontal, vertical) in enumerate(parts)
            ])  # fmt: skip

        def conditions(a: np.ndarray, b: np.ndarray, p: np.ndarray) -> np.ndarray:
            theta = p[5]
            feet = [a[0] - self.foot[0], a[1], a[2] - self.direction[0], a[8] - self.foot[1], a[9], a[10] - self.direction[1]]
            tops = [b[4] - top_left[0], b[12] - top_right[0] - displacement]
            tops += [b[7], b[15]] if self.turns else [b[6] - top_left[2], b[14] - top_right[2]]
            joints = [*(b[0:4] - a[4:8]), *(b[8:12] - a[12:16])]
            normal = np.array([-np.sin(theta), np.cos(theta)])
            apart = b[8:10] - b[0:2] - self.span * normal
            return np.array([*feet, *tops, *joints, b[2] - theta, b[10] - theta, *apart])

        numbers = before.p if len(before.p) == 6 else np.append(before.p, before.y[2, -1])
        return _solved(slope, conditions, before.x, before.y, numbers)

    def state(self, displacement: float, solution, points: int) -> Contact:
        hook, t = self.hook, np.linspace(0.0, 1.0, points)
        y = solution.sol(t)
        arc_left, arc_right, force, _, pull_right, _ = (float(v) for v in solution.p)
        left = np.concatenate([y[0:2], y[4:6, 1:]], axis=1).T
        right = np.concatenate([y[8:10], y[12:14, 1:]], axis=1).T
        return Contact(
            displacement * hook.radius, force * self.force_unit, arc_left * hook.radius, arc_right * hook.radius,
            pull_right * self.force_unit, hook.radius * left, hook.radius * right, float(solution.rms_residuals.max()),
            float(self.curvature[0] + y[3, -1] - self.curvature[1] - y[11, -1]) / hook.radius,
        )  # fmt: skip


@dataclass(frozen=True)
class _Start:
    """Initial guess in the form of a solution of solve_bvp."""

    x: np.ndarray
    y: np.ndarray
    p: np.ndarray


def _solved(slope, conditions, x: np.ndarray, guess: np.ndarray, numbers: np.ndarray):
    solution = solve_bvp(slope, conditions, x, guess, p=numbers, tol=TOLERANCE, max_nodes=20_000)
    if not solution.success:
        raise RuntimeError(f"no solution of the boundary value problem: {solution.message}")
    return solution
