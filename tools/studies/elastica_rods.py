"""A problem of rods (rod_problem.py) by PyElastica: shearable Cosserat rods, explicit in time, contact by penalty.

    python elastica_rods.py PROBLEM.npz RESULT.json

Contact (RodRodContact, RodSelfContact), damping (AnalyticalLinearDamper) and stepper (PositionVerlet) are as shipped. Both nodes
and the section of an end segment are held, with the clamp in its middle. Needs the extra `other-codes`.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

import elastica as ea
import numpy as np
from numba import njit
from rod_problem import AXIAL, DENSITY, POISSON, RADIUS, YOUNGS_MODULUS, Problem, arcs, frames, load

MEASURED = 0.2  # of a level, at its end: forces are means over it


class System(ea.BaseSystemCollection, ea.Constraints, ea.Damping, ea.Contact):
    """Base of a PyElastica simulation."""


class Clamps(ea.ConstraintBase):
    """Holds both end segments of a rod and moves them by the course; a guided end moves freely along y, as one body."""

    def __init__(self, *, guided: np.ndarray, move: np.ndarray, course: np.ndarray, **given: Any) -> None:
        """guided [end] bool; move (end, 3) [d]; course: share of the move, and its rate."""
        super().__init__(**given)
        rod = self._system
        self.course, self.move, self.guided = course, move, guided
        self.position = rod.position_collection[:, [0, 1, -2, -1]].copy()
        self.director = rod.director_collection[..., [0, -1]].copy()

    def constrain_values(self, system: Any, time: float) -> None:
        place_ends(
            system.position_collection,
            system.director_collection,
            self.position,
            self.director,
            self.move,
            self.guided,
            self.course,
        )

    def constrain_rates(self, system: Any, time: float) -> None:
        drive_ends(system.velocity_collection, system.omega_collection, self.move, self.guided, self.course)


@njit(cache=True)
def place_ends(
    position: np.ndarray,
    director: np.ndarray,
    first_position: np.ndarray,
    first_director: np.ndarray,
    move: np.ndarray,
    guided: np.ndarray,
    course: np.ndarray,
) -> None:
    """Write positions and sections of both end segments at a share of their move."""
    for end in range(2):
        node = 0 if end == 0 else position.shape[1] - 2
        first = 2 * end
        risen = 0.5 * (position[1, node] + position[1, node + 1] - first_position[1, first] - first_position[1, first + 1])
        for k in range(2):
            for axis in range(3):
                position[axis, node + k] = first_position[axis, first + k] + course[0] * move[end, axis]
            if guided[end]:
                position[1, node + k] = first_position[1, first + k] + risen
        director[:, :, 0 if end == 0 else director.shape[2] - 1] = first_director[:, :, end]


@njit(cache=True)
def drive_ends(velocity: np.ndarray, omega: np.ndarray, move: np.ndarray, guided: np.ndarray, course: np.ndarray) -> None:
    """Write velocities of both end segments, which do not turn."""
    for end in range(2):
        node = 0 if end == 0 else velocity.shape[1] - 2
        rising = 0.5 * (velocity[1, node] + velocity[1, node + 1])
        for k in range(2):
            for axis in range(3):
                velocity[axis, node + k] = course[1] * move[end, axis]
            if guided[end]:
                velocity[1, node + k] = rising
        omega[:, 0 if end == 0 else omega.shape[1] - 1] = 0.0


def rod_of(problem: Problem, wire: int) -> Any:
    """A CosseratRod at its nodes, stress-free there or bent from straight."""
    points = problem.nodes(wire, straddle=True)
    count = len(points) - 1
    rod = ea.CosseratRod.straight_rod(
        count, points[0], points[1] - points[0], frames(points)[0, 0], float(arcs(points)[-1]), RADIUS, DENSITY,
        youngs_modulus=YOUNGS_MODULUS, shear_modulus=YOUNGS_MODULUS / (2.0 * (1.0 + POISSON)),
        position=points.T.copy(), directors=np.ascontiguousarray(frames(points).transpose(1, 2, 0)),
    )  # fmt: skip
    if problem.straight:
        rod.rest_lengths[:] = problem.length / problem.segments
        rod.rest_voronoi_lengths[:] = problem.length / problem.segments
    else:
        rod.rest_kappa[:] = rod.kappa
        rod.rest_sigma[:] = rod.sigma
    assert np.allclose(rod.shear_matrix[2, 2], AXIAL)
    return rod


def solve(problem: Problem) -> dict[str, Any]:
    """Forces [B/d^2] (level, wire, end, 3) on ends, processor times [s], steps."""
    begin = time.process_time()
    system, course = System(), np.zeros(2)
    rods = [rod_of(problem, wire) for wire in range(len(problem.lines))]
    for wire, rod in enumerate(rods):
        system.append(rod)
        system.constrain(rod).using(Clamps, guided=problem.guided[wire], move=problem.move[wire], course=course)
        system.dampen(rod).using(ea.AnalyticalLinearDamper, uniform_damping_constant=problem.damping, time_step=problem.time_step)
    contact = {"k": problem.stiffness, "nu": 0.0}
    if len(rods) == 2:
        system.detect_contact_between(rods[0], rods[1]).using(ea.RodRodContact, **contact)
    else:
        system.detect_contact_between(rods[0], rods[0]).using(ea.RodSelfContact, **contact)
    system.finalize()
    stepper, now, dt = ea.PositionVerlet(), np.float64(0.0), np.float64(problem.time_step)
    stepper.step(system, now, dt)  # compiles, or reads what an earlier process compiled
    setup, begin = time.process_time() - begin, time.process_time()
    count, before, steps = int(np.ceil(problem.level_time / dt)), 0.0, 1
    forces, speed, cpu = [], [], []
    for share in problem.levels_at():
        total, measured = np.zeros((len(rods), 2, 3)), 0
        for k in range(count):
            into = min(1.0, 2.0 * k / count)
            course[0] = before + (share - before) * into
            course[1] = 2.0 * (share - before) / (count * dt) if into < 1.0 else 0.0
            now = stepper.step(system, now, dt)
            if k >= (1.0 - MEASURED) * count and k % 10 == 0:
                total += [[end_force(rod, end) for end in (0, 1)] for rod in rods]
                measured += 1
        steps += count
        forces.append((total / measured).tolist())
        speed.append(float(np.abs(rods[0].velocity_collection).max()))
        cpu.append(time.process_time() - begin)
        before = share
        if not np.isfinite(total).all():
            break
    return {"force": forces, "cpu_s": cpu, "setup_s": setup, "steps": steps, "speed": speed,
            "nodes": [len(problem.nodes(w, True)) for w in range(len(rods))],
            "position": [rod.position_collection.T.tolist() for rod in rods]}  # fmt: skip


def end_force(rod: Any, end: int) -> np.ndarray:
    """(3,) [B/d^2] by which a clamp pulls its end, less what moves its nodes."""
    nodes = [0, 1] if end == 0 else [-2, -1]
    return -(rod.internal_forces + rod.external_forces)[:, nodes].sum(axis=1)


if __name__ == "__main__":
    Path(sys.argv[2]).write_text(json.dumps(solve(load(Path(sys.argv[1])))))
