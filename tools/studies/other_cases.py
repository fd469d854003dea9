"""Hook and knot of other_codes.py, as problems of rods (rod_problem.py) and scenes.

The hook is scenes/hook_spatial.toml: two circular arcs, stress-free as placed, whose lower ends are clamped; the upper ends keep
their direction, the left one at its x, the right one moved by 0.8 mm, both free along y. The knot is one turn of
`knot_curves.overhand` in a rod that is straight without load, whose clamped ends move apart until e = 0.3 (knots.py).
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from knot_curves import DIAMETER, overhand, pulled
from knots import end_force
from rod_problem import RADIUS, Problem, arcs
from study import SCENES

from warpknit.scene import load_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation
from warpknit.spatial.placed_wires import TiltedArc, tilt

LEVELS = 4
HOOK_MOVE = 0.8e-3  # [m]
KNOT_RADIUS, KNOT_TAIL = 8.0, 32.0  # [d] of the drawn knot
KNOT_E = 0.3  # sqrt(h/R) at the last level
PENALTY = 30.0  # [B/d^3] of contact in the relaxation of the knot: too soft a one lets strands pass through each other


@dataclass(frozen=True)
class Numerics:
    """Numerical parameters of a code for a case; 0 where it has none."""

    segments: int  # of a wire between its clamps
    periods: float = 0.0  # time of a level over the period of the lowest mode of a wire without contact
    step: float = 0.0  # time step over `time_step_unit`
    damping: float = 0.0  # PyElastica: over critical damping of that mode; Yade: local damping
    stiffness: float = 0.0  # [B/d^3] of contact
    tolerance: float = 0.0  # warpknit: residual tolerance
    softening: float = 0.0  # warpknit: axial softening


@dataclass(frozen=True)
class Solved:
    """Force at each level [B/d^2], processor time until then [s], and what it took."""

    force: np.ndarray
    cpu: np.ndarray
    setup: float
    steps: int
    nodes: int


def hook_lines(beyond: float) -> np.ndarray:
    """(2, point, 3) [d] arcs of the hook, `beyond` [d] past the clamps."""
    scene = load_scene(SCENES / "hook_spatial.toml")
    hook, d = scene.hook, scene.wire.diameter
    assert hook is not None
    along = np.linspace(-beyond * d, hook.length + beyond * d, 4001)
    return np.array([TiltedArc(hook, wire, sign * tilt(hook))(along) / d for wire, sign in ((0, -1.0), (1, 1.0))])


def knot_line(beyond: float) -> np.ndarray:
    """(point, 3) [d] the drawn knot along x, `beyond` [d] past the clamps."""
    line = overhand(1, KNOT_RADIUS, KNOT_TAIL)
    shift = np.array([beyond, 0.0, 0.0])
    return np.concatenate([[line[0] - shift], line, [line[-1] + shift]])


def knot_shortening() -> tuple[float, float, float]:
    """Distance of the clamps at first [d]; end-to-end shortening then and at the last level."""
    line = overhand(1, KNOT_RADIUS, KNOT_TAIL)
    distance = float(line[-1, 0] - line[0, 0])
    return distance, float(arcs(line)[-1]) - distance, 2.0 * np.pi * RADIUS / KNOT_E**2


def lowest_frequency(case: str, length: float) -> float:
    """[sqrt(B/rho A)/d^2] of a wire without contact: clamped and guided (hook), clamped at both ends (knot)."""
    return (2.3650 if case == "hook" else 4.7300) ** 2 / length**2


def problem_of(code: str, case: str, numerics: Numerics) -> Problem:
    """The problem for PyElastica or Yade, with its discretization."""
    guided, move = np.zeros((2, 2), dtype=bool), np.zeros((2, 2, 3))
    if case == "hook":
        lines, beyond = hook_lines(20.0), 20.0
        guided[:, 1] = True
        move[1, 1, 0] = HOOK_MOVE / load_scene(SCENES / "hook_spatial.toml").wire.diameter
    else:
        lines, beyond = knot_line(5.0)[None], 5.0
        guided, move = guided[:1], move[:1]
        _, first, last = knot_shortening()
        move[0, :, 0] = -0.5 * (first - last), 0.5 * (first - last)
    length = float(arcs(lines[0])[-1]) - 2.0 * beyond
    frequency = lowest_frequency(case, length)
    spacing = length / numerics.segments
    return Problem(
        lines=lines, beyond=beyond, straight=case == "knot", guided=guided, move=move, levels=LEVELS, relaxes=case == "knot",
        segments=numerics.segments, level_time=numerics.periods * 2.0 * np.pi / frequency,
        time_step=numerics.step * time_step_unit(spacing),
        damping=numerics.damping * (2.0 * frequency if code == "PyElastica" else 1.0), stiffness=numerics.stiffness,
    )  # fmt: skip


def time_step_unit(spacing: float) -> float:
    """[d^2 sqrt(rho A/B)] an axial wave over one segment, whose speed is 4 in these units."""
    return spacing / 4.0


def by_warpknit(case: str, numerics: Numerics) -> Solved:
    """The case in the spatial model."""
    begin = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        if case == "hook":
            overrides = [f"output.frames={LEVELS}", f"model.nodes_per_loop={numerics.segments}",
                         f"solver.axial_softening={numerics.softening:g}",
                         f"solver.residual_tolerance={numerics.tolerance:g}"]  # fmt: skip
            scene = load_scene(SCENES / "hook_spatial.toml", overrides)
        else:
            distance, first, last = knot_shortening()
            spacing = (first + distance) / numerics.segments
            scene = pulled(
                Path(folder), [knot_line(0.5 * spacing)], spacing=spacing, friction=0.0,
                strains=[(first - last) / distance], levels=LEVELS, tolerance=numerics.tolerance, penalty=PENALTY,
            )  # fmt: skip
        model = build_model(scene)
    simulation = Simulation(model)
    simulation.compile()
    setup, begin = time.process_time() - begin, time.process_time()
    forces, cpu, steps = [], [], 0
    for record in simulation.run():
        if case == "hook":
            unit = model.bending_stiffness / scene.wire.diameter**2
            forces.append(record.observables.hook_contact.force_left / unit)
        else:
            forces.append(end_force(record) / (model.bending_stiffness / DIAMETER**2))
        cpu.append(time.process_time() - begin)
        steps = record.steps
    return Solved(np.array(forces), np.array(cpu), setup, steps, model.node_count)
