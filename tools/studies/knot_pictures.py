"""Pictures of the study of knots."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import numpy as np
from knot_braid import braid
from study import COLOURS, new_figure, tidy


class State(Protocol):
    """What the pictures need of a state of a knot (knots.py)."""

    turns: int
    friction: float
    way: str
    e: float
    force: float
    force_radius: float
    contact_force: float
    friction_share: float
    energy: float


def draw_knots(path: Path, rows: Sequence[State]) -> None:
    """Force and energy without friction, force with friction, and the contact force; lines are the theory."""
    figure, ((free, stored), (rubbed, press)) = new_figure(11.0, 8.0, 2, 2)
    smooth = [r for r in rows if r.way == "tighten" and r.friction == 0.0]
    for n, colour in zip(sorted({r.turns for r in rows}), COLOURS, strict=False):
        b, own = braid(n), [r for r in smooth if r.turns == n]
        e = np.array([r.e for r in own])
        line = np.linspace(1e-3, e.max(), 50)
        style = {"color": colour, "markersize": 4, "label": f"{n} turn{'s' if n > 1 else ''}"}
        free.plot(e, [r.force_radius for r in own], "o", **style)
        free.plot(line, b.elastic(line) / line**4, color=colour)
        stored.plot(e, [r.energy for r in own] / (np.pi * e**2), "o", **style)
        stored.plot(line, 1.0 + b.c * line, color=colour)
        press.plot(e, [r.contact_force for r in own] / e**3, "o", **style)
        press.plot([0.0], [b.sigma], "D", color=colour)
    one = [r for r in rows if r.turns == 1 and r.way == "tighten"]
    for friction, colour in zip(sorted({r.friction for r in one}), COLOURS, strict=False):
        some = sorted((r for r in one if r.friction == friction), key=lambda r: r.e)
        e = np.array([r.e for r in some])
        style = {"color": colour, "markersize": 4, "label": f"friction {friction:g}"}
        rubbed.plot(e, [r.force_radius for r in some], "o", **style)
        rubbed.plot(e, braid(1).force(e, friction) / e**4, color=colour)
        if friction:
            balance = [(r.force + (1.0 - r.friction_share) * friction * r.contact_force) / r.e**4 for r in some]
            rubbed.plot(e, balance, color=colour, linestyle=":")
    rubbed.plot([], [], color="grey", linestyle=":", label="force without friction + mu x contact force")
    free.axhline(0.5, color="#999999", linestyle=":")
    free.set(xlabel="e = (h/R)^(1/2)", ylabel="F R^2/B without friction", xlim=(0.0, None))
    stored.set(xlabel="e", ylabel="bending energy without friction, of pi B/R", xlim=(0.0, None), ylim=(1.0, None))
    rubbed.set(xlabel="e", ylabel="F R^2/B, one turn", xlim=(0.1, None), ylim=(0.0, 4.2))
    press.set(xlabel="e", ylabel="contact force h^2/(B e^3) without friction", xlim=(-0.005, None), ylim=(0.0, None))
    tidy(np.array([free, stored, rubbed, press]))
    figure.savefig(path)


def draw_trefoil(path: Path, length: Sequence[float], force: Sequence[float], energy: Sequence[float]) -> None:
    """Contact force and energy of a closed trefoil by its length over its thickness."""
    figure, ((forces, energies),) = new_figure(10.0, 4.0, 1, 2)
    forces.plot(length, force, color=COLOURS[0], marker="o", label="closed trefoil")
    energies.plot(length, energy, color=COLOURS[0], marker="o", label="closed trefoil")
    for axes in (forces, energies):
        axes.axvline(16.428, color=COLOURS[1], linestyle="--", label="tightest elastic torus knot, published")
        axes.axvline(16.372, color="black", linestyle=":", label="ideal trefoil")
        axes.set(xlabel="L/d")
    forces.set(ylabel="contact force [B/d^2]", yscale="log")
    energies.set(ylabel="bending energy, of 8 pi^2 B/L")
    tidy(np.array([forces, energies]))
    figure.savefig(path)
