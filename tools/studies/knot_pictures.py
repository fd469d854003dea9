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


def draw_knots(path: Path, rows: Sequence[State]) -> None:
    """Force without friction, force with friction, all turns in one curve, and the contact force; lines are the theory."""
    figure, ((free, rubbed), (turns, press)) = new_figure(11.0, 8.0, 2, 2)
    pulled = [r for r in rows if r.way == "tighten"]
    numbers = sorted({r.turns for r in rows})
    for n, colour in zip(numbers, COLOURS, strict=False):
        b, own = braid(n), [r for r in pulled if r.turns == n]
        line = np.linspace(1e-3, max(r.e for r in own), 50)
        label = f"{n} turn{'s' if n > 1 else ''}"
        smooth = [r for r in own if r.friction == 0.0]
        free.plot([r.e for r in smooth], [r.force_radius for r in smooth], "o", color=colour, markersize=4, label=label)
        free.plot(line, b.elastic(line) / line**4, color=colour)
        press.plot(
            [r.e for r in smooth], [r.contact_force / r.e**3 for r in smooth], "o", color=colour, markersize=4, label=label
        )
        press.plot([0.0], [b.sigma], "D", color=colour)
        for friction, mark in ((0.1, "o"), (0.3, "^")):
            some = [r for r in own if r.friction == friction]
            x = [n * r.e for r in some]
            turns.plot(
                x,
                [n**2 * r.force for r in some],
                mark,
                color=colour,
                markersize=4,
                label=f"{label}, friction {friction:g}" if some else None,
            )
            if some:
                shown = np.linspace(min(x), max(x), 50) / n
                turns.plot(n * shown, n**2 * b.force(shown, friction), color=colour)
    one = [r for r in pulled if r.turns == 1]
    for friction, colour in zip(sorted({r.friction for r in one}), COLOURS, strict=False):
        some = sorted((r.e, r.force) for r in one if r.friction == friction)
        e = np.array([pair[0] for pair in some])
        rubbed.plot(e**-2, [pair[1] for pair in some], "o", color=colour, markersize=4, label=f"friction {friction:g}")
        rubbed.plot(e**-2, braid(1).force(e, friction), color=colour)
    free.axhline(0.5, color="#999999", linestyle=":")
    free.set(xlabel="e = (h/R)^(1/2)", ylabel="F R^2/B without friction", xlim=(0.0, None))
    rubbed.set(xlabel="loop radius R/h", ylabel="F h^2/B, one turn", xscale="log", yscale="log")
    turns.set(xlabel="n e", ylabel="n^2 F h^2/B", xscale="log", yscale="log")
    press.set(xlabel="e", ylabel="contact force h^2/(B e^3) without friction", xlim=(-0.005, None), ylim=(0.0, None))
    tidy(np.array([free, rubbed, turns, press]))
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
