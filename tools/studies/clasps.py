"""Two rods hooked at right angles and pulled apart: where they press on each other.

Each rod turns around the other and has parallel arms, whose ends are clamped along x and moved apart. Lengths are over the
distance d at which the centre lines touch, forces over B/d^2; T is the tension of an arm. Rods touch at the tips of the turns as
long as the tips are bent by less than 1/d: near the tips of two rods with curvature k in perpendicular planes the squared
distance of points at y and z from the tips is

    d^2 + (y^2 + z^2) (1 - k d)

so beyond k d = 1 the tips part, and the rods touch on either side of them. Of a long elastica that is held back by 2 T at its
tip, B k^2/2 = T, so this begins at T d^2/B = 1/2.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from knot_curves import DIAMETER, clasp, pulled
from study import COLOURS, new_figure, tidy

from warpknit.base.errors import Diverged
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Record, Simulation
from warpknit.spatial.contact_arrays import Contacts
from warpknit.spatial.model import SpatialModel

FINE = 3.0  # distance d over the diameter of the wire of the scene, so that nodes may be closer than half of d
ARM, BEND = 12.0, 1.5  # [d] straight arms, and the radius of the turns at first
STIFF = 100.0  # factor of EA: rods that do not stretch, as in the theory of ideal shapes
TOLERANCE = 5e-3
PENALTY = 30.0  # [B/d^3] of contact


@dataclass(frozen=True)
class ClaspRow:
    """One state of the clasp. Lengths over d, forces over B/d^2."""

    friction: float
    twist: float  # GJ over the rod's
    spacing: float
    shear: float
    tension: float  # of an arm, mean of four
    tension_ratio: float  # of the arms of the first rod
    tip_curvature: float  # k d, mean of both rods
    tip_distance: float
    gap: float  # distance of the innermost contact from the tips, sqrt(s1^2 + s2^2) with the arcs s1, s2 from them
    reach: float  # arc from the tip to the outermost contact
    mean_place: float  # mean distance of the contact force from the tips
    balance: float  # contact force along x over 2 T
    asymmetry: float  # distance of the resultant contact force from the tip of the first rod
    contacts: int
    overlap: float
    steps: int
    wall_s: float


@dataclass(frozen=True)
class Pressure:
    """Contacts of a state: places [contact] on both rods, from their tips [d], and forces [contact] over B/d^2."""

    row: ClaspRow
    first: np.ndarray
    second: np.ndarray
    force: np.ndarray


def places(model: SpatialModel, t: Contacts) -> tuple[np.ndarray, np.ndarray]:
    """[contact] arc lengths [d] from the middle of the first and of the second rod."""
    rods = model.rods
    found = []
    for node, share in ((t.first, t.place[:, 0]), (t.second, t.place[:, 1])):
        arc = rods.arc[node] + share * rods.natural_arc[node] - 0.5 * rods.wire_length[rods.wire_of[node]]
        found.append((rods.wire_of[node], arc / DIAMETER))
    is_first = found[0][0] == 0
    return np.where(is_first, found[0][1], found[1][1]), np.where(is_first, found[1][1], found[0][1])


def pressure_of(
    model: SpatialModel, record: Record, friction: float, twist: float, spacing: float, shear: float, wall: float
) -> Pressure:
    o, t, rods = record.observables, record.observables.touching, model.rods
    unit = rods.section.bending_stiffness / DIAMETER**2
    first, second = places(model, t)
    pull = np.linalg.norm(o.edge_force, axis=1) / unit
    force, far = t.force / unit, np.hypot(first, second)
    middle = rods.wire_first + rods.wire_count // 2
    is_between = rods.wire_count[0] % 2 == 0  # the tips are between two nodes, and the wire bulges beyond their chord
    moment = np.linalg.norm(o.moment[:, :2], axis=1)
    k = float(np.mean([moment[m - int(is_between) : m + 1].mean() for m in middle])) * DIAMETER / rods.section.bending_stiffness
    tips = 0.5 * (o.position[middle] + o.position[middle - 1]) if is_between else o.position[middle]
    bulge = 2.0 * k * spacing**2 / 8.0 if is_between else 0.0
    row = ClaspRow(
        friction, twist, spacing, shear, float(pull.mean()), float(pull[:2].max() / pull[:2].min()),
        k, float(np.linalg.norm(tips[0] - tips[1])) / DIAMETER + bulge, float(far.min()),
        float(np.abs(np.concatenate([first, second])).max()), float(np.sum(far * force) / force.sum()),
        float(abs(np.sum((t.force[:, None] * t.normal + t.friction)[:, 0]))) / unit / (0.5 * np.abs(pull).sum()),
        float(abs(np.sum(first * force) / np.sum(force))), len(force),
        o.penetration / FINE, record.steps, wall,
    )  # fmt: skip
    return Pressure(row, first, second, force)


def clasp_states(
    strains: Sequence[float],
    levels: int,
    spacing: float,
    *,
    friction: float = 0.0,
    twist: float = 1.0,
    shear: float = 0.0,
    tolerance: float = TOLERANCE,
) -> Iterator[Pressure]:
    """States of a clasp whose arms are pulled; then a shear moves the clamps of the first rod oppositely along x."""
    begin = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        scene = pulled(
            Path(folder), clasp(ARM, BEND), spacing=spacing, friction=friction, strains=strains, levels=levels,
            tolerance=tolerance, diameter=1.0 / FINE, shear=shear, penalty=PENALTY,
        )  # fmt: skip
        model = build_model(scene)
    given = model.rods.section
    section = replace(given, axial_stiffness=STIFF * given.axial_stiffness, twist_stiffness=twist * given.twist_stiffness)
    rods = replace(model.rods, section=section, sections=(replace(section, thickness=DIAMETER),) * 2)
    model = replace(model, rods=rods, softening=STIFF * model.softening)
    simulation = Simulation(model)
    try:
        for record in simulation.run():
            if not len(record.observables.touching.force):
                continue
            now = shear * record.load_factor if record.stage_index == len(strains) else 0.0
            found = pressure_of(model, record, friction, twist, spacing, now, time.perf_counter() - begin)
            r = found.row
            print(
                f"friction {friction:g} shear {now:.2f} T {r.tension:.3f}: k d {r.tip_curvature:.3f}, tips {r.tip_distance:.4f} d"
                f" apart, contacts from {r.gap:.3f} to {r.reach:.3f} d, tensions {r.tension_ratio:.3f}, {r.steps:,} steps",
                flush=True,
            )
            yield found
    except Diverged as error:
        print(f"ended: {error}", flush=True)


PULLED, TIGHT = (0.016, 0.0265, 0.03), 0.025  # strains
FINE_SPACING, SPACING = 1.0 / 6.0, 0.25  # [d] of nodes: without and with friction
FRICTIONS = ((0.2, 1.0), (0.2, 100.0), (0.4, 100.0))  # friction coefficient, and GJ over the rod's
SHEAR = 0.6
SHOWN = (0.4, 0.75, 2.5, 13.0)  # T of the states in the picture


def clasp_rows(*, quick: bool = False) -> list[Pressure]:
    """Without friction by tension; with friction also by the sliding of one rod."""
    if quick:
        return list(clasp_states((TIGHT,), 3, SPACING))
    found = [*clasp_states(PULLED, 4, FINE_SPACING), *clasp_states((TIGHT,), 3, SPACING)]
    for friction, twist in FRICTIONS:
        found += clasp_states((TIGHT,), 3, SPACING, friction=friction, twist=twist, shear=SHEAR)
    return found


def profile(p: Pressure, width: float = 0.25) -> tuple[np.ndarray, np.ndarray]:
    """Contact force per length of the first rod over 2 T/d, in bins of `width` [d]; their middles."""
    edges = np.arange(-2.25 - 0.5 * width, 2.25 + width, width)
    total, _ = np.histogram(p.first, edges, weights=p.force)
    return 0.5 * (edges[1:] + edges[:-1]), total / width / (2.0 * p.row.tension)


def draw_clasp(path: Path, found: list[Pressure]) -> None:
    """Draw the places of contact by tension, and the pressure along a rod."""
    figure, ((shape, ridge), (along, slid)) = new_figure(11.0, 8.0, 2, 2)
    free = [p for p in found if p.row.friction == 0.0 and p.row.spacing == found[0].row.spacing]
    tension = [p.row.tension for p in free]
    shape.plot(tension, [p.row.gap for p in free], color=COLOURS[0], marker="o", label="innermost contact")
    shape.plot(tension, [p.row.reach for p in free], color=COLOURS[2], marker="o", label="outermost contact")
    shape.plot(tension, [p.row.tip_curvature for p in free], color=COLOURS[1], marker="o", label="curvature of the tips, k d")
    shape.axvline(0.5, color="#999999", linestyle=":", label="k d = 1 of a long elastica")
    shape.set(xscale="log", xlabel="tension of an arm [B/d^2]", ylabel="from the tip [d]; k d [-]")
    for wanted, colour in zip(SHOWN, COLOURS, strict=False):
        p = min(free, key=lambda p: abs(np.log(p.row.tension / wanted)))
        size = 60.0 * np.clip(p.force / p.row.tension, 0.0, None)
        ridge.scatter(p.first, p.second, s=size + 2.0, color=colour, alpha=0.6, label=f"T d^2/B = {p.row.tension:.2g}")
        along.plot(*profile(p), color=colour, label=f"T d^2/B = {p.row.tension:.2g}")
    ridge.set(xlabel="arc from the tip of one rod [d]", ylabel="arc from the tip of the other [d]", aspect="equal")
    along.set(xlabel="arc from the tip [d]", ylabel="pressure, of 2 T/d")
    for (friction, twist), colour in zip(FRICTIONS, COLOURS[1:], strict=False):
        last = [p for p in found if (p.row.friction, p.row.twist) == (friction, twist)]
        if last:
            p = last[-1]
            label = f"friction {friction:g}, GJ x {twist:g}: tensions {p.row.tension_ratio:.2f}"
            slid.plot(*profile(p), color=colour, label=label)
    slid.set(xlabel="arc from the middle of the sliding rod [d]", ylabel="pressure, of 2 T/d")
    tidy(np.array([shape, ridge, along, slid]))
    figure.savefig(path)
