"""Pictures of the study of knots."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from knot_braid import braid
from knot_long import sliding_contact_force
from study import COLOURS, new_figure, tidy


class State(Protocol):
    """State of a knot (knots.py) for pictures."""

    turns: int
    friction: float
    way: str
    e: float
    force: float
    force_radius: float
    energy_force: float
    contact_force: float
    friction_share: float
    energy: float


MARKERS = dict(zip((0.1, 0.2, 0.3), "^so", strict=True))  # by friction coefficient


def turns_of(n: int) -> str:
    return f"{n} turn{'s' if n > 1 else ''}"


def draw_knots(path: Path, rows: Sequence[State]) -> None:
    """Force, energy and contact force without friction; force with friction and what friction adds; lines are the theory."""
    figure, ((free, stored, press), (one, more, added)) = new_figure(15.0, 8.0, 2, 3)
    colours = dict(zip(sorted({r.turns for r in rows}), COLOURS, strict=False))
    tightened = sorted((r for r in rows if r.way == "tighten"), key=lambda r: r.e)
    for n, colour in colours.items():
        b, own = braid(n), [r for r in tightened if (r.turns, r.friction) == (n, 0.0)]
        e = np.array([r.e for r in own])
        line = np.linspace(1e-3, e.max(), 50)
        style: dict[str, Any] = {"color": colour, "markersize": 4, "label": turns_of(n)}
        free.plot(e, [r.force_radius for r in own], "o", **style)
        free.plot(e, [r.energy_force for r in own], color=colour, linestyle=":")
        free.plot(line, b.elastic(line) / line**4, color=colour)
        stored.plot(e, [r.energy for r in own] / (np.pi * e**2), "o", **style)
        stored.plot(line, 1.0 + b.c * line, color=colour)
        press.plot(e, [r.contact_force for r in own] / e**3, "o", **style)
        press.plot([0.0], [b.sigma], "D", color=colour)
    free.plot([], [], color="grey", linestyle=":", label="by the measured energy, -dE/dS")
    for axes in (free, stored):
        axes.plot([], [], color="grey", label="first order in e")
    press.plot([], [], "D", color="grey", markersize=4, label="limit of the first order")
    for axes, n_of in ((one, (1,)), (more, tuple(n for n in colours if n > 1))):
        for n in n_of:
            for friction, marker in MARKERS.items():
                own = [r for r in tightened if (r.turns, r.friction) == (n, friction)]
                e = np.array([r.e for r in own])
                style = {"color": colours[n], "markersize": 4}
                axes.plot(e, [r.force_radius for r in own], marker, **style)
                balance = [r.energy_force + friction * r.contact_force / r.e**4 for r in own]
                axes.plot(e, braid(n).force(e, friction) / e**4, "_-", **style)
                axes.plot(e, balance, "_:", **style)
                axes.plot(e, friction * sliding_contact_force(n, e) / e**4, "--", **style)
                added.plot(e, [r.friction_share for r in own], marker, **style)
    for friction, marker in MARKERS.items():
        for axes in (one, added):
            axes.plot([], [], marker, color="grey", markersize=4, label=f"friction {friction:g}")
    one.plot([], [], color="grey", linestyle=":", label="energy force + friction x contact force")
    for axes in (one, more):
        axes.plot([], [], color="grey", label="first order in e")
        axes.plot([], [], color="grey", linestyle="--", label="long knot that slides (Jawed and others)")
    for n in list(colours)[1:]:
        more.plot([], [], color=colours[n], label=turns_of(n))
    free.axhline(0.5, color="#999999", linestyle="-.", linewidth=0.8, label="loop alone, 1/2")
    added.axhline(1.0, color="#999999", linestyle=":")
    free.set(xlabel="e = (h/R)^(1/2)", ylabel="F R^2/B without friction", xlim=(0.0, None))
    stored.set(xlabel="e", ylabel="energy without friction, of pi B/R", xlim=(0.0, None), ylim=(1.0, None))
    press.set(xlabel="e", ylabel="contact force h^2/(B e^3) without friction", xlim=(-0.005, None), ylim=(0.0, None))
    one.set(xlabel="e", ylabel="F R^2/B, one turn with friction", ylim=(0.0, 8.5))
    more.set(xlabel="e", ylabel="F R^2/B, more turns with friction", yscale="log", ylim=(1.0, None))
    added.set(xlabel="e", ylabel="(F - energy force) over friction x contact force", ylim=(0.5, 1.2))
    tidy(np.array([free, stored, press, one, more, added]))
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
