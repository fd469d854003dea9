"""Discrete elastic rods: forces from the energy, invariance, momentum, and the largest stable step."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from reference.rods import SECTION, Pose, helix, round_section, straight
from warpknit.spatial.rod_relaxation import RodRelaxation
from warpknit.spatial.rod_step import RodStepper
from warpknit.spatial.rods import Rods, rods_of
from warpknit.spatial.step_bound import TERMS, largest_rates, stable_step

ROUND_OFF = 1e-12


def mixed_rods() -> Rods:
    """An open helix, a ring, and a wire that goes on into the next tile."""
    ring = helix(2.0, 0.0, 7) + [0, 0, 5]
    wavy = np.array([[0, 0, 9], [2, 0.3, 9], [3, 2, 9.5], [1, 3, 10]], dtype=float)
    return rods_of(SECTION, [helix(5.0, 4.0, 9, 0.6), ring, wavy], [None, np.zeros(3), np.array([0.0, 4.0, 0.0])])


def deformed(seed: int = 1, size: float = 0.3) -> tuple[Pose, np.ndarray, np.ndarray]:
    """A pose far from rest, with its forces and torques."""
    rng = np.random.default_rng(seed)
    pose = Pose(mixed_rods())
    nodes = pose.rods.node_count
    pose.bend_by(size * rng.normal(size=(nodes, 3)), size * rng.normal(size=nodes))
    _, force, torque = pose.at(np.zeros((nodes, 3)), np.zeros(nodes))
    return pose, force, torque


def test_wires_are_free_of_stress_as_they_are_made() -> None:
    energy, force, torque = Pose(mixed_rods()).at(np.zeros((20, 3)), np.zeros(20))
    assert energy < ROUND_OFF * SECTION.axial_stiffness
    assert max(np.abs(force).max(), np.abs(torque).max()) < ROUND_OFF * SECTION.axial_stiffness


@pytest.mark.parametrize("seed", [1, 2])
def test_forces_and_moments_are_the_gradient_of_the_energy(seed: int) -> None:
    """f = -dE/dx and torque = -dE/d(angle), frames carried along; central differences are off by (step)^2 and round-off/step."""
    pose, force, torque = deformed(seed)
    step = 1e-5
    found = pose.join(force, torque)
    tolerance = (100 * step**2 + ROUND_OFF / step) * np.abs(found).max()
    assert np.abs(found - pose.gradient(step)).max() < tolerance


def test_a_tension_that_keeps_arcs_is_the_gradient_of_their_energy() -> None:
    """Where T/EA is the strain of the arc, |e|/L - 1 + ((L/l)^2 |a|^2 + (L/l')^2 |a'|^2)/48 less that at rest, with the arcs L of
    segments and l of nodes, the energy is EA L/2 its square.

    Central differences are off by (step)^2 and round-off/step.
    """
    rng = np.random.default_rng(6)
    pose = Pose(rods_of(SECTION, [helix(5.0, 4.0, 9, 0.6), helix(2.0, 0.0, 7)], [None, np.zeros(3)]))
    rods, state, step = pose.rods, pose.stepper.state, 1e-5
    length = np.where(pose.has_segment, rods.natural_length, 0.0)

    def bow() -> np.ndarray:
        square = np.sum((state.curvature.numpy() / rods.node_length[:, None]) ** 2, axis=1)
        return rods.slope_length**2 * (square + square[rods.following]) / 48

    def arc_energy(move: np.ndarray, turn: np.ndarray) -> float:
        stored, *_ = pose.at(move, turn)  # with chords: no offset, and the whole stiffness
        chord = np.where(pose.has_segment, state.length.numpy() / rods.natural_length - 1, 0.0)
        arc = chord + bow() - at_rest
        return stored + 0.5 * SECTION.axial_stiffness * float(np.sum(length * (arc**2 - chord**2)))

    at_rest = bow()
    pose.bend_by(0.1 * rng.normal(size=(16, 3)), 0.1 * rng.normal(size=16))
    found = np.zeros(pose.unknowns())
    for k in range(len(found)):
        way = np.zeros(len(found))
        way[k] = step
        found[k] = -(arc_energy(*pose.split(way)) - arc_energy(*pose.split(-way))) / (2 * step)
    pose.at(np.zeros((16, 3)), np.zeros(16))
    state.tension_offset.assign(np.where(pose.has_segment, SECTION.axial_stiffness * (bow() - at_rest), 0.0))
    state.steering.set(bow_moment=1 / 24)
    _, force, torque = pose.at(np.zeros((16, 3)), np.zeros(16))
    scale = np.abs(found).max()
    assert np.abs(pose.join(force, torque) - found).max() < (100 * step**2 + ROUND_OFF / step) * scale


def test_no_net_force_and_no_net_moment() -> None:
    """sum f = 0 and sum x x f + torque t = 0, open and closed wires, whatever their shape.

    The wire that goes on into the next tile carries a force through it, and so a moment about the origin.
    """
    pose, force, torque = deformed()
    inside = pose.rods.wire_of < 2
    scale = np.abs(force).max()
    assert np.abs(force.sum(axis=0)).max() < 100 * ROUND_OFF * scale
    moment = np.cross(pose.position, force) + np.where(pose.has_segment, torque, 0.0)[:, None] * pose.tangent
    assert np.abs(moment[inside].sum(axis=0)).max() < 100 * ROUND_OFF * scale * np.abs(pose.position).max()


def test_energy_does_not_see_a_rigid_motion() -> None:
    """Carried and turned in twenty steps by a whole turn about an axis, frames with it, a deformed wire stores what it did."""
    open_and_ring = rods_of(SECTION, [helix(5.0, 4.0, 9, 0.6), helix(2.0, 0.0, 7)], [None, np.zeros(3)])
    rng = np.random.default_rng(3)
    pose = Pose(open_and_ring)
    pose.bend_by(0.3 * rng.normal(size=(16, 3)), 0.3 * rng.normal(size=16))
    start, still = pose.position.copy(), np.zeros((16, 3))
    before, *_ = pose.at(still, np.zeros(16))
    axis = np.array([1.0, 2.0, -0.5]) / np.linalg.norm([1.0, 2.0, -0.5])
    steps = 20
    for k in range(1, steps + 1):
        # a section turns with the body, of which its tangent's own way takes no part about itself
        turn = _own_turn(pose.tangent, axis, 2 * np.pi / steps)
        pose.bend_by(Rotation.from_rotvec(2 * np.pi * k / steps * axis).apply(start) + 0.1 * k - pose.position, turn)
    after, *_ = pose.at(still, np.zeros(16))
    assert after == pytest.approx(before, rel=1e-10, abs=0)


def _own_turn(tangent: np.ndarray, axis: np.ndarray, angle: float) -> np.ndarray:
    """Angle that a rotation turns sections by, beyond carrying their tangents the shortest way."""
    rotation = Rotation.from_rotvec(angle * axis)
    turned = rotation.apply(tangent)
    across = np.cross(tangent, axis)
    across /= np.linalg.norm(across, axis=1)[:, None]
    way = np.cross(tangent, turned)
    moved = np.array([
        Rotation.from_rotvec(w / np.linalg.norm(w) * np.arctan2(np.linalg.norm(w), t @ r)).apply(v)
        for w, t, r, v in zip(way, tangent, turned, across, strict=True)
    ])  # fmt: skip
    wanted = rotation.apply(across)
    return np.arctan2(np.sum(np.cross(moved, wanted) * turned, axis=1), np.sum(moved * wanted, axis=1))


def test_free_motion_keeps_momentum() -> None:
    """sum m v is kept to round-off. sum m x x v + I w t changes by I w dt/dt alone: rods leave out the gyroscopic couple of
    the spin.

    Leapfrog positions and velocities give x x v without error, as x' x v' = x x v + dt x x f/m.
    """
    rng = np.random.default_rng(4)
    rods = rods_of(SECTION, [helix(5.0, 4.0, 12, 0.8)])
    stepper = RodStepper(rods)
    state = stepper.state
    mass, inertia = state.node_mass.numpy()[:, 0], np.where(rods.following >= 0, state.spin_inertia.numpy(), 0.0)
    stepper.set_time_step(0.2 * stable_step(largest_rates(rods, mass, np.maximum(state.spin_inertia.numpy(), 1e-9), turning=0.6)))
    state.velocity.assign(rng.normal(size=(12, 3)))
    state.spin.assign(rng.normal(size=12))
    stepper.evaluate()

    def momenta() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        v, spin, t = (state.velocity.numpy(), state.spin.numpy(), state.tangent.numpy())
        x = rods.position + state.displacement.numpy()
        spinning = (inertia * spin)[:, None] * t
        return (mass[:, None] * v).sum(0), np.cross(x, mass[:, None] * v).sum(0), spinning

    linear, angular, spinning = momenta()
    start, left_out = angular + spinning.sum(axis=0), np.zeros(3)
    for _ in range(2000):
        tangent = state.tangent.numpy().copy()
        stepper.step(1)
        now, angular, spinning = momenta()
        stepper.evaluate()
        left_out += ((inertia * state.spin.numpy())[:, None] * (state.tangent.numpy() - tangent)).sum(axis=0)
    end = angular + ((inertia * state.spin.numpy())[:, None] * state.tangent.numpy()).sum(axis=0)
    scale = np.linalg.norm(mass[:, None] * rods.position) * 1.0
    assert np.abs(now - linear).max() < 1e-9 * np.abs(mass).sum()
    assert np.linalg.norm(left_out) > 1e-6 * scale  # the spin is seen at all
    assert np.abs(end - start - left_out).max() < 1e-2 * np.linalg.norm(left_out)


@pytest.mark.parametrize("rules", ["stretch", "bending", "twist"])
def test_step_bound_of_a_straight_wire_is_sharp(rules: str) -> None:
    """A long straight chain is stable at 0.999 of the bound and not at 1.02 of it, whichever of the three rules.

    The highest mode of n nodes falls short of a chain without end by (pi/2n)^2 = 0.06 %.
    """
    nodes = 64
    points = np.stack([np.arange(nodes), np.zeros(nodes), np.zeros(nodes)], axis=1).astype(float)
    soft = {"axial_stiffness": 1.0, "bending_stiffness": 1e-6, "twist_stiffness": 1e-6, "rotary_inertia": 1.0}
    if rules == "bending":
        soft |= {"axial_stiffness": 1e-6, "bending_stiffness": 1.0}
    elif rules == "twist":
        soft |= {"axial_stiffness": 1e-6, "twist_stiffness": 1.0}
    rods = straight(rods_of(replace(SECTION, linear_density=1.0, **soft), [points], [np.array([nodes, 0.0, 0.0])]))
    state = RodStepper(rods).state
    rates = largest_rates(rods, state.node_mass.numpy()[:, 0], state.spin_inertia.numpy())
    assert max(TERMS, key=lambda name: rates[name]) == rules
    kick = 1e-8 * np.random.default_rng(5).normal(size=(nodes, 3))
    grown = []
    for share in (0.999, 1.02):
        stepper = RodStepper(rods)
        stepper.set_time_step(share * stable_step(rates))
        stepper.state.velocity.assign(kick)
        stepper.state.spin.assign(kick[:, 0])
        stepper.step(400)
        state = stepper.state
        grown.append(max(np.abs(state.velocity.numpy()).max(), np.abs(state.spin.numpy()).max()) / 1e-8)
    assert grown[0] < 1e3 and grown[1] > 1e6


@pytest.mark.parametrize(("turn", "tightness"), [(0.05, 0.99), (0.4, 0.88), (1.2, 0.6)])
def test_step_bound_of_a_coil_holds(turn: float, tightness: float) -> None:
    """The largest w^2 of M^-1 K of an open coil, by differences, is below the bound; its step is at most 1/tightness of the
    bound's.

    Masses are the true ones of a wire so thick that stretch, bending and twist have about the same rate. What couples them with
    the turn p is bounded by sin^2 p, which is more than it is: the bound loses with p.
    """
    nodes = 18
    radius, angle = 1.0 / (2 * np.sin(turn / 2)), turn * np.arange(nodes)
    rods = rods_of(SECTION, [np.stack([radius * np.cos(angle), radius * np.sin(angle), 0.1 * angle], axis=1)])
    pose = Pose(rods)
    state = pose.stepper.state
    mass, inertia = state.node_mass.numpy()[:, 0], np.where(pose.has_segment, state.spin_inertia.numpy(), 1e30)
    weight = pose.join(np.repeat(1 / np.sqrt(mass), 3), 1 / np.sqrt(inertia))
    stiffness = pose.stiffness(1e-5) * weight[:, None] * weight[None, :]
    largest = np.linalg.eigvalsh(0.5 * (stiffness + stiffness.T))[-1]
    bound = largest_rates(rods, mass, inertia, turning=turn)["all"]
    assert tightness**2 * bound < largest < bound


@pytest.mark.parametrize("plastic", [False, True])
def test_wires_of_several_sections_are_each_as_alone(plastic: bool) -> None:
    """Forces, torques, energy, inertia and fictitious masses of two wires together, the second 1.5 times as thick, are those of
    each alone. The slowest wave is long: its mass would depend on the mean distance of all nodes."""
    kappa = 0.02 if plastic else 0.0
    thin = replace(SECTION, yield_curvature=kappa, hardening=0.2)
    thick = replace(round_section(1.5, 1e4, 0.3, 1.0), yield_curvature=kappa / 1.5, hardening=0.2)
    shapes, rng = [helix(5.0, 4.0, 9, 0.6), helix(2.0, 0.0, 7)], np.random.default_rng(3)
    closing = [None, np.zeros(3)]
    move, turn = 0.3 * rng.normal(size=(16, 3)), 0.3 * rng.normal(size=16)

    def found(rods: Rods, nodes: slice) -> tuple[float, np.ndarray]:
        pose = Pose(rods)
        energy, force, torque = pose.at(move[nodes], turn[nodes])
        state = pose.stepper.state
        true = np.column_stack([state.node_mass.numpy(), state.spin_inertia.numpy(), state.stretch_stiffness.numpy()])
        RodRelaxation(pose.stepper, wave_length=1e9)
        banded = np.column_stack([state.node_mass.numpy(), state.next_mass.numpy(), state.spin_inertia.numpy()])
        return energy, np.column_stack([force, torque, true, banded])

    both, of_both = found(replace(rods_of(thin, shapes, closing), sections=(thin, thick)), slice(None))
    one, of_one = found(rods_of(thin, shapes[:1], closing[:1]), slice(0, 9))
    other, of_other = found(rods_of(thick, shapes[1:], closing[1:]), slice(9, 16))
    assert both == pytest.approx(one + other, rel=100 * ROUND_OFF)
    differences = np.abs(of_both - np.concatenate([of_one, of_other]))
    assert np.all(differences <= 100 * ROUND_OFF * np.abs(of_both).max(axis=0))
