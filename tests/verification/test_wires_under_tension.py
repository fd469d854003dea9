"""Wires whose ends are drawn apart by a tension, whose strain is an unknown: closed forms and boundary value problems.

A wire of half rings, and two hooked loops, are elastic lines in a plane (elastica): with s the arc length at rest, theta the
direction, m the moment, P the pull along x and V the force across it,

    x' = (1 + N/EA) cos theta     y' = (1 + N/EA) sin theta     theta' = kappa0 + m/EI
    m' = (1 + N/EA) (P sin theta - V cos theta)                 N = P cos theta + V sin theta
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_bvp

from warpknit import Simulation, build_model, measure
from warpknit.scene import Scene, make_scene
from warpknit.solve.simulate import Record

DIAMETER, RADIUS, PERIOD = 1e-4, 2e-3, 10e-3  # [m]
TOLERANCE = 1e-4  # of the residual; a third of it of the tension


def scene_of(folder: Path, wires: list[np.ndarray], boundary: str, nodes: float, **tables) -> Scene:
    """Frictionless wires through these points; nodes: an arc of RADIUS."""
    np.savez(folder / "wires.npz", *wires)
    spacing = RADIUS / nodes
    period = {"period": [4.0 * RADIUS, PERIOD]} if boundary == "periodic" else {}
    table = {
        "wires": {"file": "wires.npz", "unit": "m", "node_spacing": spacing} | period,
        "wire": {"material": "tungsten", "diameter": DIAMETER},
        "model": {"kind": "spatial", "boundary": boundary},
        "contact": {"friction": 0.0},
        "solver": {"residual_tolerance": TOLERANCE},
        "output": {"frames": 2},
    }
    return make_scene(table | tables, path=folder / "scene.toml")


def last_of(scene: Scene) -> Record:
    *_, last = Simulation(build_model(scene)).run()
    assert measure.mesh_tension(last.observables)[0] == pytest.approx(scene.stages[0].tension_weft, rel=TOLERANCE)
    return last


def test_a_straight_wire_strains_by_its_tension_over_ea(tmp_path: Path) -> None:
    """Of a wire every PERIOD: e = T PERIOD/EA, to the tolerance of the tension."""
    along = np.linspace(0.0, 4.0 * RADIUS, 41)
    scene = scene_of(
        tmp_path,
        [np.stack([along, 0 * along, 0 * along], axis=1)],
        "periodic",
        10.0,
        load={"tension_weft": 1e4, "strain_warp": 0.0},
    )
    strain = last_of(scene).observables.stretch[0, 0] - 1.0
    assert strain == pytest.approx(1e4 * PERIOD / scene.wire.axial_stiffness, rel=TOLERANCE)


def elastica(scene: Scene, parts: list[tuple[float, float]], theta: float, pull: float, *, is_clamped: bool) -> float:
    """x at the end of a line that ends across the pull where it is clamped to begin with, along it where it begins on a hinge.

    Lengths in units of RADIUS, pull in those of EI/RADIUS^2. parts: (length, natural curvature); theta: direction as it begins. A
    clamped line begins at y = 1 and ends at y = 0; V is the unknown number. On a hinge V vanishes.
    """
    soft = scene.wire.bending_stiffness / (RADIUS**2 * scene.wire.axial_stiffness)
    last = 4 * (len(parts) - 1)

    def slope(_s: np.ndarray, y: np.ndarray, p: np.ndarray) -> np.ndarray:
        found = []
        for k, (length, curvature) in enumerate(parts):
            turned, moment = y[4 * k + 2], y[4 * k + 3]
            stretch = 1.0 + soft * (pull * np.cos(turned) + p[0] * np.sin(turned))
            across = pull * np.sin(turned) - p[0] * np.cos(turned)
            rates = (stretch * np.cos(turned), stretch * np.sin(turned), curvature + moment, stretch * across)
            found += [length * rate for rate in rates]
        return np.stack(found)

    def conditions(a: np.ndarray, b: np.ndarray, p: np.ndarray) -> np.ndarray:
        ends = [a[2] - theta, b[last + 1], b[last + 2] + 0.5 * np.pi] if is_clamped else [a[3], p[0], b[last + 2]]
        return np.array([a[0], a[1] - is_clamped, *ends, *(a[4:] - b[:last])])

    s = np.linspace(0.0, 1.0, 41)
    guess, turned = [], theta
    for length, curvature in parts:
        guess += [length * s, 0 * s, turned + curvature * length * s, 0 * s]
        turned += curvature * length
    solution = solve_bvp(slope, conditions, s, np.stack(guess), np.zeros(1), tol=1e-8, max_nodes=10_000)
    assert solution.success, solution.message
    return float(solution.y[last, -1])


@pytest.mark.parametrize("pull", [0.05, 1.0])
def test_a_wire_of_half_rings_is_the_elastica(pull: float, tmp_path: Path) -> None:
    """Half rings, up and down in turn, hinge on each other where they meet on the axis. Pull in units of EI/R^2; nodes keep
    chords and not arcs, by 10/N^2 of N nodes a ring (test_ring.py). Under a small pull d = (pi/2) P R^3/EI a half ring."""
    nodes = 8.0
    arc = np.linspace(0.0, np.pi, 81)
    up = np.stack([RADIUS * (1.0 - np.cos(arc)), RADIUS * np.sin(arc)], axis=1)
    line = np.concatenate([up, (up * [1, -1] + [2 * RADIUS, 0])[1:]])
    scene = scene_of(tmp_path, [np.column_stack([line, 0 * line[:, 0]])], "periodic", nodes, load={"strain_warp": 0.0})
    force = pull * scene.wire.bending_stiffness / RADIUS**2
    scene = scene.changed({"load": {"tension_weft": force / PERIOD}})
    strain = last_of(scene).observables.stretch[0, 0] - 1.0
    expected = elastica(scene, [(0.5 * np.pi, -1.0)], 0.5 * np.pi, pull, is_clamped=False) - 1.0
    assert strain == pytest.approx(expected, rel=10.0 / (2.0 * np.pi * nodes) ** 2)
    if pull < 0.1:
        assert expected == pytest.approx(0.25 * np.pi * pull, rel=pull)


def loops(leg: float) -> list[np.ndarray]:
    """Two loops of a half ring and straight legs, one in the plane and one across it, that hook each other and just touch."""
    arc = np.linspace(0.5 * np.pi, -0.5 * np.pi, 121)
    along = np.linspace(-leg, 0.0, 61)[:-1]
    x = np.concatenate([along, RADIUS * np.cos(arc), along[::-1]]) + 0.5 * DIAMETER - RADIUS
    side = np.concatenate([np.full(60, RADIUS), RADIUS * np.sin(arc), np.full(60, -RADIUS)])
    return [np.stack([x, side, 0 * x], axis=1), np.stack([-x, 0 * x, side], axis=1)]


@pytest.mark.parametrize("pull", [0.5, 3.0])
def test_two_hooked_loops_under_dead_weight(pull: float, tmp_path: Path) -> None:
    """Half of each loop is clamped at its leg, and half of the weight bears on its top, across which it passes on. Clamps end
    half a segment inside the ends; the wires may overlap by 0.004 of their thickness, and hinges keep chords, by 10/N^2."""
    nodes, leg = 10.0, 2.0 * RADIUS
    scene = scene_of(tmp_path, loops(leg), "gripped", nodes, load={"strain_warp": 0.0})
    size = build_model(scene).panel.size
    scene = scene.changed({"load": {"tension_weft": 2.0 * pull * scene.wire.bending_stiffness / RADIUS**2 / size[1]}})
    strain = last_of(scene).observables.stretch[0, 0] - 1.0
    straight = (leg - 0.5 * RADIUS / nodes) / RADIUS
    top = elastica(scene, [(straight, 0.0), (0.5 * np.pi, -1.0)], 0.0, pull, is_clamped=True)
    expected = 2.0 * RADIUS * (top - 1.0 - straight)
    found = strain * (2.0 * (straight + 1.0) * RADIUS - DIAMETER)
    assert found == pytest.approx(expected, rel=10.0 / (2.0 * np.pi * nodes) ** 2, abs=0.004 * DIAMETER)
