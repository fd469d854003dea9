"""A problem of rods (rod_problem.py) by Yade: grid nodes joined by beams, explicit in time, contact of cylinders by penalty.

    PYTHONPATH=tools/studies PROBLEM=problem.npz RESULT=result.json yade -n -x tools/studies/yade_rods.py

Runs in Yade's own Python, with NumPy. Stiffness, masses and inertia of the beams are those that `gridConnection` gives. A clamp
is at a node.
"""

from __future__ import annotations

import itertools
import json
import math
import os
import time
from pathlib import Path
from typing import Any

import numpy as np
from rod_problem import DENSITY, POISSON, RADIUS, YOUNGS_MODULUS, Problem, frames, load
from yade import (
    Bo1_GridConnection_Aabb,
    CohFrictMat,
    ForceResetter,
    FrictMat,
    Ig2_GridConnection_GridConnection_GridCoGridCoGeom,
    Ig2_GridNode_GridNode_GridNodeGeom6D,
    InsertionSortCollider,
    InteractionLoop,
    Ip2_CohFrictMat_CohFrictMat_CohFrictPhys,
    Ip2_FrictMat_FrictMat_FrictPhys,
    Law2_GridCoGridCoGeom_FrictPhys_CundallStrack,
    Law2_ScGeom6D_CohFrictPhys_CohesionMoment,
    Matrix3,
    NewtonIntegrator,
    Omega,
    Quaternion,
    Vector3,
)
from yade.gridpfacet import gridConnection, gridNode

MEASURED = 0.2  # of a level, at its end: forces are means over it
SAMPLES = 50
O = Omega()  # noqa: E741


def node_frames(tangent: np.ndarray) -> list[Any]:
    """Orientation of the section at each node, without twist, from tangents (node, 3)."""
    along = np.concatenate([np.zeros((1, 3)), np.cumsum(tangent, axis=0)])
    return [Quaternion(Matrix3(*frame.T.ravel())) for frame in frames(along)]


def bend(problem: Problem, wire: int, nodes: list[int]) -> None:
    """Move a straight rod onto its line at once, with its sections.

    Bending and twist count from the first orientation, so these moments are right; the shear force is summed over steps, and is
    set to the shape's: ks times the length times the deviation of two nodes' mean tangent from their chord.
    """
    points, tangent = problem.nodes(wire, straddle=False), problem.tangents(wire)
    for node, point, turn in zip(nodes, points, node_frames(tangent), strict=True):
        state = O.bodies[node].state
        state.pos, state.ori, state.vel, state.angVel = Vector3(*point), turn, Vector3(0, 0, 0), Vector3(0, 0, 0)
    chord = np.diff(points, axis=0)
    chord /= np.linalg.norm(chord, axis=1)[:, None]
    mean = 0.5 * (tangent[1:] + tangent[:-1])
    off = problem.length / problem.segments * (mean - chord * (mean * chord).sum(axis=1)[:, None])
    for first, second, shear in zip(nodes, nodes[1:], off):  # noqa: B905
        beam = O.interactions[first, second].phys
        beam.shearForce = Vector3(*(beam.ks * shear))


def place(problem: Problem) -> list[list[int]]:
    """The rods as bodies; ids of their nodes."""
    inner = O.materials.append(CohFrictMat(
        young=YOUNGS_MODULUS, poisson=POISSON, density=DENSITY, frictionAngle=math.radians(30.0), normalCohesion=1e30,
        shearCohesion=1e30, momentRotationLaw=True, label="inner",
    ))  # fmt: skip
    # two equal materials make a contact of stiffness young * radius
    outer = O.materials.append(FrictMat(
        young=problem.stiffness / RADIUS, poisson=0.3, density=DENSITY, frictionAngle=0.0, label="outer",
    ))  # fmt: skip
    rods = []
    for wire in range(len(problem.lines)):
        points = problem.nodes(wire, straddle=False)
        if problem.straight:
            points = np.arange(len(points))[:, None] * np.array([problem.length / problem.segments, 0.0, 0.0])
        nodes = [O.bodies.append(gridNode(Vector3(*p), RADIUS, fixed=False, material=inner)) for p in points]
        if problem.straight:
            for node, turn in zip(nodes, node_frames(np.tile([1.0, 0.0, 0.0], (len(points), 1))), strict=True):
                O.bodies[node].state.ori = turn
        for first, second in itertools.pairwise(nodes):
            O.bodies.append(gridConnection(first, second, RADIUS, material=outer))
        rods.append(nodes)
    return rods


def solve(problem: Problem) -> dict[str, Any]:
    """Forces [B/d^2] (level, wire, end, 3) on ends, processor times [s], steps."""
    begin = time.process_time()
    beams = Law2_ScGeom6D_CohFrictPhys_CohesionMoment(always_use_moment_law=True, useIncrementalForm=False)
    newton = NewtonIntegrator(damping=problem.damping, gravity=(0, 0, 0))
    O.engines = [
        ForceResetter(),
        InsertionSortCollider([Bo1_GridConnection_Aabb()], verletDist=0.2),
        InteractionLoop(
            [Ig2_GridNode_GridNode_GridNodeGeom6D(), Ig2_GridConnection_GridConnection_GridCoGridCoGeom()],
            [Ip2_CohFrictMat_CohFrictMat_CohFrictPhys(setCohesionNow=True, setCohesionOnNewContacts=False),
             Ip2_FrictMat_FrictMat_FrictPhys()],
            [beams, Law2_GridCoGridCoGeom_FrictPhys_CundallStrack()],
        ),
        newton,
    ]  # fmt: skip
    rods = place(problem)
    O.dt = 1e-12
    O.step()
    if problem.straight:
        for wire, nodes in enumerate(rods):
            bend(problem, wire, nodes)
    for wire, nodes in enumerate(rods):
        for end, node in enumerate((nodes[0], nodes[-1])):
            O.bodies[node].state.blockedDOFs = "xzXYZ" if problem.guided[wire, end] else "xyzXYZ"
    O.dt = problem.time_step
    setup, begin = time.process_time() - begin, time.process_time()
    count, before, steps, forces, wall, speed = math.ceil(problem.level_time / O.dt), 0.0, 1, [], [], []
    half = count // 2
    every = max(1, int(MEASURED * count / SAMPLES))
    for share in problem.levels_at():
        velocity = (share - before) / (half * O.dt) * problem.move
        for wire, nodes in enumerate(rods):
            for end, node in enumerate((nodes[0], nodes[-1])):
                drive(node, velocity[wire, end], bool(problem.guided[wire, end]))
        O.run(half, True)
        for wire, nodes in enumerate(rods):
            for end, node in enumerate((nodes[0], nodes[-1])):
                drive(node, np.zeros(3), bool(problem.guided[wire, end]))
        O.run(count - half - SAMPLES * every, True)
        total = np.zeros((len(rods), 2, 3))
        for _ in range(SAMPLES):
            O.run(every, True)
            total -= [[list(O.forces.f(node)) for node in (nodes[0], nodes[-1])] for nodes in rods]
        steps += count
        forces.append((total / SAMPLES).tolist())
        speed.append(max(O.bodies[node].state.vel.norm() for node in rods[0]))
        wall.append(time.process_time() - begin)
        before = share
        if not np.isfinite(total).all():
            break
    return {"force": forces, "cpu_s": wall, "setup_s": setup, "steps": steps, "speed": speed,
            "nodes": [len(nodes) for nodes in rods],
            "position": [[list(O.bodies[node].state.pos) for node in nodes] for nodes in rods]}  # fmt: skip


def drive(node: int, velocity: np.ndarray, guided: bool) -> None:
    """Move an end at a velocity [d over time unit]; a guided one keeps its own along y."""
    state = O.bodies[node].state
    state.vel = Vector3(velocity[0], state.vel[1] if guided else velocity[1], velocity[2])


if __name__ == "__main__":
    Path(os.environ["RESULT"]).write_text(json.dumps(solve(load(Path(os.environ["PROBLEM"])))))
