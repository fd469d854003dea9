"""Width of the lens of two hooked wires under load, from beam theory.

    lens = press(force, Wires(bending_stiffness, thickness, arms, curvature, slope))

Two wires that hook pass over each other at one end of their lens and under at the other. Drawn together they touch near both
ends, at -c and +c along them, where the line between their axes stands at the angle phi to the plane. With X, Z the in-plane and
out-of-plane distances of the axes, N the force of either contact and F the force of one wire on the other,

    X(c) = d sin phi     Z(c) = d cos phi     X X' + Z Z' = 0 at c     F = 2 N sin phi

(the third: nowhere are they nearer). Both distances belong to straight beams that are clamped at the far ends of their arms,

    X = X_0 - kappa x^2/2 + (F/2) [G(x, c) + G(x, -c)]           Z = slope x + N cos phi [G(x, c) - G(x, -c)]

with G the sum of both wires' deflections, kappa their relative curvature and slope their relative lean without the contact. The
span is what two wires in one plane would be held apart by, by a body in their middle, for the same F and the same ends,

    span = X_0 + F G(0, 0)

To leading order, for long arms a, F = 4 EI d^2/(a kappa c^4) and span = kappa c^2/2, so span = d sqrt(EI kappa/(a F)). Nothing is
fitted. `Law` puts the boundary value problem of the plane (hook_reference.py) at that span.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from hook_reference import Contact, Hook
from scipy.optimize import brentq, fsolve

from warpknit.scene import Hook as SceneHook
from warpknit.spatial.placed_wires import tilt

STEPS = 12  # of the force, from one that hardly presses: each is the start of the next
LEAST = 1e-3  # of the force: where they begin
WIDEST = 8.0  # diameters: spans that are tried
NARROWEST = 0.3


@dataclass(frozen=True)
class Wires:
    """Two wires in their lens, SI."""

    bending_stiffness: float
    thickness: float
    arms: Sequence[tuple[float, float]]  # for each wire the lengths from the lens to its clamps, below and above
    curvature: float  # [1/m] relative, without the contact
    slope: float  # relative, across the plane, without the contact

    def deflection(self, x: float, at: float) -> tuple[float, float]:
        """Deflection of both wires at x [m] by a unit force at `at`, and slope."""
        found = [_clamped_beam(self.bending_stiffness, below + above, below + x, below + at) for below, above in self.arms]
        return sum(f[0] for f in found), sum(f[1] for f in found)

    def pair(self, c: float, sign: float) -> tuple[float, float]:
        """Mean deflection and slope at both ends. By unit forces at c and, times `sign`, at -c."""
        (a, p), (b, q) = self.deflection(c, c), self.deflection(c, -c)
        (e, r), (f, s) = self.deflection(-c, -c), self.deflection(-c, c)
        return 0.5 * (a + e + sign * (b + f)), 0.5 * (p - r + sign * (q - s))


@dataclass(frozen=True)
class Lens:
    """Two wires pressed together."""

    half_length: float  # [m] c
    across: float  # cos phi: share of a contact's force that is across the plane
    contact_force: float  # [N] N
    span: float  # [m]


def press(force: float, wires: Wires) -> Lens:
    """The lens under a force [N]. Raises `RuntimeError` where no solution is found."""
    d = wires.thickness
    # leading order, for the first force
    first = LEAST * force
    arm = float(np.mean(wires.arms))
    c = (4.0 * wires.bending_stiffness * d**2 / (arm * wires.curvature * first)) ** 0.25
    guess = np.array([min(c, 0.9 * d / wires.slope if wires.slope > 0.0 else c), d / (wires.curvature * c**2)])
    for now in np.geomspace(first, force, STEPS):
        scale = np.array([guess[0], 1.0])

        def unbalanced(u: np.ndarray, now: float = float(now), scale: np.ndarray = scale) -> list[float]:
            c, phi = u * scale
            push = now / (2.0 * np.tan(phi))
            z, lean = wires.pair(c, -1.0)
            _, turn = wires.pair(c, 1.0)
            inward = -wires.curvature * c + 0.5 * now * turn
            across = wires.slope + push * lean
            return [
                (wires.slope * c + push * z) / d - np.cos(phi),
                (np.sin(phi) * inward + np.cos(phi) * across) / (wires.curvature * c),
            ]

        found, _, code, message = fsolve(unbalanced, guess / scale, full_output=True)
        if code != 1:
            raise RuntimeError(f"no lens at {now:.3g} N: {message}")
        guess = found * scale
    c, phi = (float(v) for v in guess)
    beside, _ = wires.pair(c, 1.0)
    middle, _ = wires.deflection(0.0, 0.0)
    span = d * np.sin(phi) + 0.5 * wires.curvature * c**2 + force * (middle - 0.5 * beside)
    return Lens(c, float(np.cos(phi)), force / (2.0 * float(np.sin(phi))), float(span))


def _clamped_beam(stiffness: float, length: float, x: float, at: float) -> tuple[float, float]:
    """Deflection and slope at x of a clamped beam; unit force at `at`."""
    if x > at:
        value, slope = _clamped_beam(stiffness, length, length - x, length - at)
        return value, -slope
    b = length - at
    value = b**2 * x**2 * (3 * at * length - x * (3 * at + b)) / (6 * stiffness * length**3)
    return value, b**2 * (6 * at * length * x - 3 * x**2 * (3 * at + b)) / (6 * stiffness * length**3)


class Law:
    """The planar hook at the span of spatial wires."""

    def __init__(self, hook: SceneHook, bending_stiffness: float, thickness: float) -> None:
        """thickness [m] where they touch."""
        self.length, self.thickness, self.bending_stiffness = hook.length, thickness, bending_stiffness
        self.slope = 2.0 * math.tan(tilt(hook))
        self.planar = Hook(radius=hook.radius, length=hook.length, overlap=hook.overlap)

    def contact(self, displacement: float, span: float) -> Contact:
        """Of the plane, at a span [m]."""
        return _solved(replace(self.planar, span=span), displacement)

    def lens(self, c: Contact, force: float | None = None) -> Lens:
        """Lens of spatial wires at the planar position, under its force or another one [N]."""
        arms = [(arc, self.length - arc) for arc in (c.arc_left, c.arc_right)]
        wires = Wires(self.bending_stiffness, self.thickness, arms, 1.0, self.slope)
        step = 1e-4 * self.length
        turned = (wires.deflection(-step, 0.0)[1] - wires.deflection(step, 0.0)[1]) / (2.0 * step)
        return press(c.force if force is None else force, replace(wires, curvature=c.curvature - c.force * turned))

    def solve(self, displacement: float) -> tuple[Contact, Lens] | None:
        """Plane and lens of equal force and span; None where the wires do not press."""

        def miss(span: float) -> float:
            c = self.contact(displacement, span)
            return self.lens(c).span - span if c.force > 0.0 else self.thickness

        narrowest, widest = NARROWEST * self.thickness, WIDEST * self.thickness
        if miss(widest) > 0.0:
            return None
        c = self.contact(displacement, brentq(miss, narrowest, widest, xtol=1e-4 * self.thickness))
        return c, self.lens(c)


@cache
def _solved(hook: Hook, displacement: float) -> Contact:
    return hook.solve([displacement])[0]
