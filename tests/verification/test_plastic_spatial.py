"""Yield in bending of wires in space: radial return of the moment vector, bilinear with kinematic hardening.

pure bending by a turn t at a node, y at yield, k = EI/l, h the share of stiffness kept:
    M = k (y + h (t - y))       stays: p = (1 - h)(t - y)       let go, the wire turns back to p
the law does not know in which direction of the section a wire is bent; in one plane it is that of the planar model
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from reference.rods import SECTION, Pose, helix, relaxed
from warpknit.kernels.banded_mass import HELD_NODE, HELD_TURN
from warpknit.runner.run import run_scene
from warpknit.scene import load_scene
from warpknit.spatial.rod_relaxation import RodRelaxation
from warpknit.spatial.rod_step import RodStepper
from warpknit.spatial.rods import Rods, rods_of

HOOK = Path(__file__).parents[2] / "scenes" / "hook_spatial.toml"
KEPT = 0.2
YIELD = 0.05  # [rad] for segments of length 1
PLASTIC = replace(SECTION, yield_curvature=YIELD, hardening=KEPT)


def arc(turn: float, lean: float, nodes: int = 9) -> np.ndarray:
    """Nodes (n, 3) of a chain of segments of length 1 that turns by `turn` at each, in a plane that leans by `lean` [rad]."""
    angle = turn * np.arange(nodes - 1)
    step = np.stack([np.cos(angle), np.cos(lean) * np.sin(angle), np.sin(lean) * np.sin(angle)], axis=1)
    return np.concatenate([np.zeros((1, 3)), np.cumsum(step, axis=0)])


def straight_wire(nodes: int = 9) -> Rods:
    rods = rods_of(PLASTIC, [arc(0.0, 0.0, nodes)])
    return rods.holding([0, 1], [0])


def bent(stepper: RodStepper, *ways: tuple[float, float]) -> np.ndarray:
    """Moments (inner node, 2) over EI/l after bending by each turn in its plane, each being a state at rest. The way from one to
    the next is by the straight wire, so that sections come there without twist."""
    for turn, lean in ways:
        stepper.place(arc(0.0, 0.0))
        stepper.place(arc(turn, lean))
        moment = stepper.yielding.elastic[1:-1].copy()
        stepper.yielding.advance()
    return moment


@pytest.mark.parametrize("lean", [0.0, 0.7, 2.5])
def test_pure_bending_beyond_yield_and_springback(lean: float) -> None:
    """The moment of an arc, by the force on its nodes as by the law, and the arc that is left of it when it is let go; the moment
    it takes to hold its first segment is that force times its length. At its free end there is no moment to hold it."""
    turn = 0.2
    stepper = RodStepper(straight_wire())
    moment = YIELD + KEPT * (turn - YIELD)
    found = bent(stepper, (turn, lean))
    assert np.linalg.norm(found, axis=1) == pytest.approx(moment, rel=1e-9)
    force, _ = stepper.forces()
    stiffness = SECTION.bending_stiffness
    assert np.linalg.norm(force[0]) == pytest.approx(stiffness * moment, rel=1e-9)  # a couple over a segment of length 1
    assert np.abs(force[2:-4]).max() < 1e-9 * stiffness  # the arc is in balance
    stays = (1.0 - KEPT) * (turn - YIELD)
    rest = RodRelaxation(stepper)
    relaxed(rest, 1e-9 * stiffness)
    angle = np.linalg.norm(stepper.state.curvature.numpy()[1:-1], axis=1)
    assert angle == pytest.approx(stays, rel=1e-5)
    assert stepper.yielding.dissipated == pytest.approx(7 * stiffness * YIELD * stays, rel=1e-9)


def test_work_of_bending_is_stored_or_gone() -> None:
    """The area under the bilinear curve: k y^2/2 + k y (t - y) + h k (t - y)^2/2."""
    turn, stepper = 0.2, RodStepper(straight_wire())
    bent(stepper, (turn, 0.4))
    yielding = stepper.yielding
    area = 0.5 * YIELD**2 + YIELD * (turn - YIELD) + 0.5 * KEPT * (turn - YIELD) ** 2
    elastic = 0.5 * SECTION.bending_stiffness * float(np.sum(yielding.elastic**2))
    found = elastic + yielding.hardened_energy + yielding.dissipated
    assert found == pytest.approx(7 * SECTION.bending_stiffness * area, rel=1e-9)


def test_bending_across_after_yield_returns_radially() -> None:
    """Bent in one plane and then in another one: by hand, with the plastic turn of the first as a vector."""
    first, second, lean = 0.2, 0.15, 1.2
    stepper = RodStepper(straight_wire())
    found = bent(stepper, (first, 0.0), (second, lean))
    one, other = np.array([1.0, 0.0]), np.array([np.cos(lean), np.sin(lean)])
    plastic = (1.0 - KEPT) * (first - YIELD) * one
    back = KEPT / (1.0 - KEPT) * plastic
    trial = second * other - plastic
    size = float(np.linalg.norm(trial - back))
    assert size > YIELD
    wanted = trial - (1.0 - KEPT) * (size - YIELD) * (trial - back) / size
    # in the frame of the section, which stands anyhow about the wire: the size, and the angle to the first plane
    assert np.linalg.norm(found, axis=1) == pytest.approx(float(np.linalg.norm(wanted)), rel=1e-9)
    start = RodStepper(straight_wire())
    along = bent(start, (first, 0.0))
    cosine = np.sum(found * along, axis=1) / (np.linalg.norm(found, axis=1) * np.linalg.norm(along, axis=1))
    assert cosine == pytest.approx(float(wanted @ one) / float(np.linalg.norm(wanted)), rel=1e-9)


def test_what_has_yielded_keeps_its_forces() -> None:
    """Bent and twisted at random, at rest once, and bent on: the end of the step leaves the forces."""
    rods = rods_of(replace(PLASTIC, yield_curvature=0.02), [helix(2.0, 3.0, 9)])
    pose = Pose(rods)
    rng = np.random.default_rng(3)
    for amplitude in (0.2, 0.1):
        pose.bend_by(amplitude * rng.normal(size=(9, 3)), amplitude * rng.normal(size=9))
        assert np.count_nonzero(np.linalg.norm(pose.stepper.yielding._beyond()[0], axis=1)) >= 3
        flowing = pose.join(*pose.at(np.zeros((9, 3)), np.zeros(9))[1:])
        pose.stepper.yielding.advance()
        found = pose.join(*pose.at(np.zeros((9, 3)), np.zeros(9))[1:])
        assert found == pytest.approx(flowing, rel=0, abs=1e-12 * np.abs(flowing).max())


def test_what_has_yielded_and_is_let_back_has_forces_of_a_potential() -> None:
    """An arc bent beyond yield, and back by less than twice its yield with small moves at random."""
    pose, rng = Pose(rods_of(PLASTIC, [arc(0.0, 0.0)])), np.random.default_rng(3)
    pose.bend_by(arc(0.2, 0.4) - arc(0.0, 0.0), np.zeros(9))
    pose.stepper.yielding.advance()
    assert pose.stepper.yielding.plastic.any()
    pose.bend_by(arc(0.15, 0.4) - arc(0.2, 0.4) + 1e-3 * rng.normal(size=(9, 3)), 1e-3 * rng.normal(size=9))
    wanted = pose.join(*pose.at(np.zeros((9, 3)), np.zeros(9))[1:])
    assert np.abs(wanted - pose.gradient(1e-6)).max() < 1e-7 * np.abs(wanted).max()


def test_no_moment_is_beyond_yield() -> None:
    """A hinge between stiff neighbours, almost without hardening: slopes of the moment add nothing to that of yield."""
    section = replace(PLASTIC, hardening=1e-6)
    stepper = RodStepper(rods_of(section, [arc(0.0, 0.0)]))
    turn = np.array([0.0, 0.0, 0.0, 0.3, 0.0, 0.0, 0.0, 0.0])
    step = np.stack([np.cos(np.cumsum(turn)), np.sin(np.cumsum(turn)), np.zeros(8)], axis=1)
    stepper.place(np.concatenate([np.zeros((1, 3)), np.cumsum(step, axis=0)]))
    moment = np.linalg.norm(stepper.state.moment.numpy()[:, :2], axis=1)
    assert moment.max() == pytest.approx(section.bending_stiffness * YIELD, rel=1e-5)


def test_rods_that_do_not_yield_are_as_before() -> None:
    """Held in the same pose a wire whose yield is far off has the bits of an elastic one."""
    forces = []
    for section in (SECTION, replace(SECTION, yield_curvature=1e3, hardening=KEPT)):
        rods = rods_of(section, [arc(0.0, 0.0)])
        assert not (rods.held & (HELD_NODE | HELD_TURN)).any()
        stepper = RodStepper(rods)
        stepper.place(arc(0.3, 0.5))
        stepper.yielding.advance()
        forces.append(stepper.forces()[0])
    assert np.array_equal(*forces)


@pytest.mark.slow
def test_a_hook_that_yields_is_that_of_the_plane(tmp_path: Path) -> None:
    """Arcs that bend in their plane beyond yield, loaded to three times the elastic limit and unloaded: the force on the driven
    end is within what plane and space differ by where wires stay elastic, 3 %."""
    options = [
        "wire.plastic=true", "wire.yield_stress='150 MPa'", "wire.hardening=0.2", "load.displacement='0.6 mm'",
        "path=[{displacement='0.4 mm'}]", "output.frames=4", "output.usd=false", "output.figures=false",
        "model.nodes_per_loop=48", "solver.residual_tolerance=5e-4",
    ]  # fmt: skip
    force = []
    for kind in ("planar", "spatial"):
        scene = load_scene(HOOK, [f"model.kind={kind}", *options])
        summary = run_scene(scene, out=tmp_path / kind, device="cpu").summary.json()
        assert abs(summary["quality"]["energy_balance_of_stored"]) < 0.03
        assert summary["wire"]["plastic_fraction"] > 0.5
        force.append([stage["hook"]["drive_force_N"] for stage in summary["stages"]])
    assert force[1] == pytest.approx(force[0], rel=0.03, abs=0)
