"""Single precision in space: positions, lengths and tensions are float64, the rest is float32."""

import numpy as np
import pytest

from reference.rods import SECTION, helix
from warpknit import measure
from warpknit.compute.arrays import DOUBLE, Precision, precision_of
from warpknit.compute.host import fetch, store
from warpknit.scene import load_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation
from warpknit.spatial.rod_step import RodStepper
from warpknit.spatial.rods import Rods, rods_of

SINGLE = precision_of("single", 1.0)
EPSILON = float(np.finfo(np.float32).eps)
KNITS = {
    "double atlas": (
        '{chain="1-0/1-2/2-3/2-1", threading="|.", shift=0}, {chain="2-3/2-1/1-0/1-2", threading="|.", shift=1}', 46
    ),
    "tricot": ('{chain="1-0/1-2"}, {chain="1-2/1-0"}', 30),
    "single atlas": ('{chain="1-0/1-2/2-3/2-1"}', 30),
    "reverse locknit": ('{chain="1-0/1-2"}, {chain="2-3/1-0"}', 30),
}  # fmt: skip


def deformed(rods: Rods, precision: Precision) -> tuple[np.ndarray, np.ndarray]:
    """Forces and torques of rods that are bent, twisted and pulled at random."""
    rng, stepper = np.random.default_rng(5), RodStepper(rods, precision=precision)
    nodes, spacing = rods.node_count, rods.natural_length.min()
    stepper.place(rods.position + 0.1 * spacing * rng.normal(size=(nodes, 3)), 0.3 * rng.normal(size=nodes))
    force, torque = stepper.forces()
    assert force.dtype == torque.dtype == np.dtype(precision.real.__name__)
    return force.astype(float), torque.astype(float)


def test_forces_miss_those_in_double_precision_by_round_off() -> None:
    """A turn is off by a few roundings of unit vectors, so a moment by B/h of it and a force by B/h^2, whatever its size; and the
    tension by roundings of itself. Ten of each bound what adds up at a node of four neighbours."""
    rods = rods_of(SECTION, [helix(5.0, 4.0, 40, 1.5), helix(2.0, 0.0, 70)], [None, np.zeros(3)])
    (force, torque), (exact_force, exact_torque) = deformed(rods, SINGLE), deformed(rods, DOUBLE)
    spacing = rods.natural_length.min()
    stiff = max(SECTION.bending_stiffness, SECTION.twist_stiffness)
    pulled = SECTION.axial_stiffness * np.abs(fetch(RodStepper(rods).state.length) / rods.natural_length).max()
    bound = 10 * EPSILON * (stiff / spacing**2 + 0.5 * pulled)
    assert 0.0 < np.abs(force - exact_force).max() < bound
    assert 0.0 < np.abs(torque - exact_torque).max() < 10 * EPSILON * stiff / spacing


def test_slow_motion_is_not_lost_in_space() -> None:
    """A free wire 50 mm from the origin, whose step is a hundredth of what float32 resolves there, moves by n v dt, to what
    float32 leaves of v."""
    rods = rods_of(SECTION, [helix(1e-3, 1e-3, 30) + [50e-3, 0.0, 0.0]], [None])
    stepper = RodStepper(rods, precision=SINGLE)
    speed, steps, time_step = 1e-3, 2000, 4e-8
    assert np.float32(50e-3) + np.float32(speed * time_step) == np.float32(50e-3)
    stepper.set_time_step(time_step)
    store(stepper.state.node_mass, 1e30)  # no force moves it
    stepper.factor_masses()
    store(stepper.state.velocity, [speed, -speed, speed])
    stepper.step(steps)
    way = steps * time_step * speed
    assert np.abs(np.abs(fetch(stepper.state.displacement)) - way).max() < 2 * EPSILON * way


@pytest.mark.slow  # the only ones that need all kernels in single precision
@pytest.mark.parametrize("knit", KNITS)
def test_knits_carry_what_they_do_in_double_precision(knit: str) -> None:
    """Both equilibria are within the residual tolerance of the true one: tensions to that share of the larger, and the largest
    stress, the sum of all contact forces and the contacts likewise."""
    bars, courses = KNITS[knit]

    def equilibrium(precision: str) -> tuple[np.ndarray, float, int]:
        scene = load_scene(
            f'''
            wire = {{material = "tungsten", diameter = "15 um"}}
            knit = {{bars = [{bars}], wales = "26 /inch", courses = "{courses} /inch"}}
            model = {{kind = "spatial", boundary = "periodic"}}
            contact = {{friction = 0}}
            load = {{strain_weft = 0.04, strain_warp = 0.04}}
            solver = {{preset = "draft", precision = "{precision}"}}
            output = {{frames = 4}}
            '''
        )
        *_, last = Simulation(build_model(scene)).run()
        assert last.steady
        seen = last.observables
        return np.array(measure.mesh_tension(seen)), measure.stress_extremes(seen)[0], int(measure.pair_active(seen).sum())

    (single, stress, active), (double, exact_stress, exact_active) = equilibrium("single"), equilibrium("double")
    assert np.abs(single - double).max() < 1e-2 * np.abs(double).max()
    assert stress == pytest.approx(exact_stress, rel=1e-2)
    assert active == exact_active
