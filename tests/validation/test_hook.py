"""Two hooked wires: the free body against a boundary value problem, and what the other treatments of the contact do to it.

Moments that go linearly between nodes are exact to fourth order in the node spacing h. A contact force within a segment makes a
kink there, and the part of the moment that a line from node to node leaves out, at most F h/4, stores F^2 h^3/(96 EI) and less,
where a wire of length L between clamps stores F^2 L^3/(384 EI): an error that falls as (h/L)^3. With n segments it is KINK/n^3.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hook_reference import Contact, Hook

from reference.cases import slow
from warpknit import measure
from warpknit.measure.observables import HookContact
from warpknit.mesh.hook_mesh import LEFT_TOP, RIGHT_TOP
from warpknit.planar.observables import PlanarObservables
from warpknit.planar.state import initial_state
from warpknit.planar.step import Stepper
from warpknit.planar.time_step import stable_step
from warpknit.scene import Scene, make_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation

DIAMETER = 15e-6
DISPLACEMENT = 0.8e-3
RADIUS, ARC = 1e-3, 2e-3 * np.pi / 3  # [m] of each wire, as knitted
LEAST_FORCE = 1e-4  # [N] above which errors are taken: a contact that begins to close has none to be relative to
TOLERANCE = 1e-4  # of the residual
KINK = 20.0  # error of the contact force times the cube of the segments: 4 for a straight wire, and bent wires are loaded askew


def hook_scene(segments: int = 32, frames: int = 8, displacement: float = DISPLACEMENT, **tables: dict) -> Scene:
    solver = {"axial_softening": 64, "residual_tolerance": TOLERANCE}
    return make_scene(
        {
            "hook": {},
            "load": {"displacement": displacement},
            "model": {"kind": "planar", "nodes_per_loop": segments},
            "output": {"frames": frames},
            "contact": tables.get("contact", {}),
            "solver": solver | tables.get("solver", {}),
        }
    )


def readings(scene: Scene, device: str = "cpu") -> list[PlanarObservables]:
    model = build_model(scene, device)
    return [record.observables for record in Simulation(model, initial_state(model)).run()]


def contacts(scene: Scene) -> list[HookContact]:
    return [reading.hook_contact for reading in readings(scene)]


@cache
def reference(span: float, frames: int = 8) -> list[Contact]:
    """At the recorded displacements."""
    return Hook(span=span).solve(tuple(DISPLACEMENT * k / frames for k in range(frames + 1)))


def errors(found: list[HookContact], expected: list[Contact]) -> tuple[float, float]:
    """Largest error of the force [-] and of the contact's place [d], of the states that carry LEAST_FORCE."""
    counted = [(f, e) for f, e in zip(found, expected, strict=True) if e.force > LEAST_FORCE]
    assert len(counted) >= 3
    force = max(abs(side / e.force - 1.0) for f, e in counted for side in (f.force_left, f.force_right))
    place = max(max(abs(f.arc_left - e.arc_left), abs(f.arc_right - e.arc_right)) for f, e in counted)
    return force, place / DIAMETER


@cache
def free_body() -> list[HookContact]:
    return contacts(hook_scene())


# --- the free body


def test_free_body_agrees_with_the_boundary_value_problem() -> None:
    """Within 0.5 % in force and far within a diameter in place, at 16 segments a wire, 38 nodes in all; 0.06 % at 32."""
    for n, found in ((16, contacts(hook_scene(16))), (32, free_body())):
        force, place = errors(found, reference(1.25 * DIAMETER))
        assert force < KINK / n**3
        assert place < 0.2


def test_wires_do_not_touch_before_the_reference_does() -> None:
    for found, expected in zip(free_body(), reference(1.25 * DIAMETER), strict=True):
        assert found.is_closed == (expected.force > 0.0)
        assert found.drive_force == pytest.approx(expected.drive, rel=KINK / 32**3, abs=1e-9)


@pytest.mark.slow
def test_free_body_converges_at_third_order() -> None:
    """Twice the segments, an eighth of the error: from 0.22 % to 0.03 %."""
    found = {}
    for n in (16, 32):
        force, place = errors(contacts(hook_scene(n, solver={"residual_tolerance": 2e-5})), reference(1.25 * DIAMETER))
        assert force < KINK / n**3
        assert place < 0.2
        found[n] = force
    assert 5.0 < found[16] / found[32] < 12.0


@pytest.mark.parametrize("mass", [0.01, *slow(1.0)])
def test_free_body_does_not_depend_on_its_mass_at_rest(mass: float) -> None:
    """In real time, with a hundredth and with all of the mass of half a wire, the hook comes to rest where the relaxation does.

    Both are short of rest by the residual tolerance; the ramp keeps its softening s, which costs 5.28 s (d/4R)^2 = 0.1 % of the
    stiffness of a bend, and its penalty, F/k of 0.01 d. It keeps the length of chords and not of arcs: a wire of radius R
    that is straightened becomes shorter by L (h/R)^2/24, which moves the contact by that much, at the stiffness dF/du that the
    reference has there.
    """
    close, far = reference(1.25 * DIAMETER)[5:7]  # at 0.5 and 0.6 mm
    shorter = ARC * (ARC / 16 / RADIUS) ** 2 / 24
    chords = shorter * (far.force - close.force) / (DISPLACEMENT / 8) / far.force
    ramp = {"drive": "ramp", "axial_softening": 10, "residual_tolerance": 1e-3, "loading_time": 1e-3}
    tables = {"contact": {"body_mass": mass, "stiffness": 2e4}, "solver": ramp}
    last = contacts(hook_scene(16, 2, 0.6e-3, **tables))[-1]
    still = contacts(hook_scene(16, 6, 0.6e-3))[-1]
    for side in ("force_left", "force_right", "drive_force"):
        assert getattr(last, side) == pytest.approx(getattr(still, side), rel=chords + 3e-3, abs=0)
    assert last.arc_right == pytest.approx(still.arc_right, abs=0.2 * DIAMETER)


def test_a_light_body_does_not_bounce_faster_than_a_step_follows() -> None:
    """w_body dt <= 1 with w_body^2 = 2 k/m_body: nearer to the limit of 2 a light body gains energy at every bounce."""
    model = build_model(hook_scene(32, contact={"body_mass": 0.01}, solver={"drive": "ramp", "axial_softening": 30}))
    step = stable_step(model, initial_state(model), 1)
    assert 0.8 < step * np.sqrt(2.0 * model.contact_stiffness / model.body_mass) <= 1.0


# --- ends


@pytest.mark.parametrize("drive", ["relax", "ramp"])
def test_upper_ends_are_free_along_the_warp_only(drive: str, device: str) -> None:
    """At rest no vertical force is left at either upper end, both keep their direction and their place across, and what holds
    the driven one is the work-conjugate of its displacement, but for what is left out of balance."""
    ramp = {"drive": "ramp", "residual_tolerance": 1e-3, "loading_time": 5e-4}
    scene = hook_scene(16, 8, 0.6e-3, solver=ramp if drive == "ramp" else {})
    last = readings(scene, device)[-1]
    panel, hook = last.model.panel, scene.hook
    at = np.zeros((4, 2))
    np.add.at(at, panel.held_clamp, last.held_forces)
    pull = last.hook_contact.drive_force
    allowed = 0.02 if drive == "ramp" else 2e-3
    assert np.abs(at[[LEFT_TOP, RIGHT_TOP], 1]).max() < allowed * abs(pull)
    conjugate = last.nominal_stress[0, 1] * np.prod(panel.size) / hook.height
    assert conjugate == pytest.approx(pull, rel=allowed)
    node, _ = measure.positions(last)
    held = node[panel.held_node, :2].reshape(4, 2, 2)
    rest = panel.held_lever.reshape(4, 2, 2) + panel.clamp_position[:, None]
    moved = held - rest
    assert np.allclose(moved[[0, 2]], 0.0, atol=1e-15)
    assert np.allclose(moved[[LEFT_TOP, RIGHT_TOP], :, 0], [[0.0], [0.6e-3]], atol=1e-15)
    assert np.allclose(np.ptp(moved[:, :, 1], axis=1), 0.0, atol=1e-15)


def test_a_sliding_clamp_has_the_mass_of_both_its_nodes() -> None:
    """After a step from random velocities the kinetic energy that the control array adds up is that of all nodes: a clamp's two
    move as one, with their mean, and carry the mass of both."""
    model = build_model(hook_scene(16, 8, solver={"drive": "ramp"}))
    state = initial_state(model)
    nodes = model.panel.node_count
    mass = np.repeat(state.wire_mass.numpy(), model.panel.wire_count) / model.rest.inverse_mass.numpy()[model.panel.node_entry]
    free = ~np.isin(np.arange(nodes), model.panel.held_node)
    top = np.concatenate([model.panel.held_node.reshape(4, 2)[end] for end in (LEFT_TOP, RIGHT_TOP)])
    velocity = np.random.default_rng(0).normal(size=(2, nodes)) * free
    velocity[1, top] = np.repeat([0.8, -2.5], 2)
    state.node_vx.assign(velocity[0])
    state.node_vy.assign(velocity[1])
    state.slide_vy.assign(np.array([0.8, -2.5]))
    Stepper(model, state).step(1)
    after = np.stack([state.node_vx.numpy(), state.node_vy.numpy()])
    assert after[1, top[::2]] == pytest.approx(after[1, top[1::2]], rel=1e-15)
    kinetic = state.steering.kinetic_twice
    assert kinetic == pytest.approx(np.sum(mass * after**2), rel=1e-12)
    assert np.sum(mass[top] * after[1, top] ** 2) > 0.1 * kinetic


# --- the other treatments


@pytest.mark.parametrize(
    ("treatment", "span"), [*slow(("spring-point", 1.0), ("ring", -1.0)), ("spring-cylinder", 1.25), ("friction-plane", 1.25)]
)
def test_treatments_hold_the_wires_at_their_own_span(treatment: str, span: float) -> None:
    """A point lets them come to d, a cylinder of radius d/8 to 1.25 d, a ring of inner radius d holds them 2 d - d apart the
    other way round; soft springs and little friction leave it at that."""
    force, place = errors(contacts(hook_scene(contact={"treatment": treatment})), reference(span * DIAMETER))
    assert force < KINK / 32**3
    assert place < 0.3


@pytest.mark.slow
def test_springs_bias_the_hook_in_proportion_to_their_stiffness() -> None:
    """What a spring takes from the body is k times the way of the body, and draws the contact from its place by as much over what
    the hook itself resists with: ten times the stiffness, ten times the bias, to a tenth; none where k goes to zero. On the
    way, where the contact carries little yet, a spring of 0.3 N/m draws it by diameters."""
    free = free_body()[-1]
    bias = {}
    for k in (1e-3, 1e-2, 1e-1):
        found = contacts(hook_scene(contact={"treatment": "spring-cylinder", "spring_stiffness": k}))[-1]
        way = np.hypot(*(found.body - [0.0, 0.5 * 2e-3 * np.sin(np.pi / 3)]))
        assert found.ground_force == pytest.approx(k * way, rel=0.02)
        bias[k] = abs(found.arc_left - free.arc_left)
    assert bias[1e-3] < 0.01 * DIAMETER
    assert bias[1e-1] / bias[1e-2] == pytest.approx(10.0, rel=0.1)
    stiff = contacts(hook_scene(contact={"treatment": "spring-cylinder", "spring_stiffness": 0.3}))
    force, place = errors(stiff, reference(1.25 * DIAMETER))
    assert place > 1.0
    assert force > 0.05


def test_friction_holds_the_body_back_by_no_more_than_it_bears() -> None:
    """A body that slips is held by mu N, which is what both wires' forces differ by."""
    contact = {"treatment": "friction-plane", "plane_friction": 0.5, "plane_load": 1e-5}
    found = contacts(hook_scene(contact=contact))
    slipping = [c for c in found if c.is_closed]
    for c in slipping:
        assert c.ground_force == pytest.approx(5e-6, rel=0.02)
    assert all(c.ground_force < 5.1e-6 for c in found)


# --- the single contact point


def test_a_contact_point_holds_where_it_is_and_not_where_the_wires_touch() -> None:
    """Its target being the whole wire, the middle of the left wire stays in contact, but the wires would touch 10 d from there:
    the force is a fifth too high and more."""
    found = contacts(hook_scene(contact={"treatment": "point"}))
    free = free_body()[-1]
    assert found[-1].is_closed
    assert found[-1].arc_left == pytest.approx(np.pi / 3 * 1e-3, rel=1e-6)
    assert abs(free.arc_left - found[-1].arc_left) > 10 * DIAMETER
    assert found[-1].force_left > 1.2 * free.force_left


def test_a_contact_point_that_runs_off_its_target_is_missed() -> None:
    """The middle tenth of the right wire is 0.1 mm long either way; beyond it nothing holds the wires, and the left one is as it
    was at rest, though a free body still carries its force."""
    found = contacts(hook_scene(contact={"treatment": "point", "target_share": 0.1}))
    closed = [c.is_closed for c in found]
    assert any(closed)
    assert not closed[-1]
    assert free_body()[-1].force_left > 2e-3
    assert found[-1].body == pytest.approx([0.1e-3, np.sin(np.pi / 3) * 1e-3], abs=1e-7)


@pytest.mark.parametrize("place", [0.0, 0.25, 1.0])
def test_a_contact_point_outside_the_lens_never_touches(place: float) -> None:
    """The lens takes up the middle 44 % of the left wire: a node at a quarter of it is on the wrong side of its target, and so
    are those next to its clamps."""
    contact = {"treatment": "point", "contact_point": place}
    assert not any(c.is_closed for c in contacts(hook_scene(16, 4, contact=contact, solver={"residual_tolerance": 1e-3})))


def test_a_contact_point_gives_to_its_node_what_it_takes_from_the_target() -> None:
    """The forces on the nodes of both wires add up to none; the node's is across the target."""
    last = readings(hook_scene(contact={"treatment": "point"}))[-1]
    total = last.pair_nodal.sum(axis=(0, 1))
    assert np.abs(total).max() < 1e-12 * last.pair_force[0]
    assert np.count_nonzero(np.any(last.pair_nodal[0] != 0.0, axis=1)) == 1
    assert np.hypot(*last.pair_nodal[0].sum(axis=0)) == pytest.approx(last.pair_force[1], rel=1e-12)


# --- runs


@pytest.mark.parametrize("treatment", ["friction-plane", "point", "free-body"])
def test_a_hook_goes_on_from_where_it_was_kept(treatment: str) -> None:
    """What a checkpoint keeps is all there is: the rest of the run comes out to the bit."""
    scene = hook_scene(16, 6, contact={"treatment": treatment}, solver={"residual_tolerance": 1e-3})
    model = build_model(scene)
    whole = Simulation(model, initial_state(model))
    for record in whole.run():
        if record.index == 4:
            kept = whole.drive.snapshot()
    resumed = Simulation(model, initial_state(model))
    resumed.drive.restore(kept)
    resumed.resumed = True
    for _ in resumed.run():
        pass
    for name, value in whole.state.arrays().items():
        assert np.array_equal(value, resumed.state.arrays()[name]), name


def test_both_wire_kernels_step_a_hook_alike() -> None:
    """A thread a node, as on a GPU, and a block a thread: a thousand steps agree to the round-off of sums in another order."""
    from warpknit.planar.step import Stepper

    model = build_model(hook_scene(16, contact={"treatment": "spring-cylinder"}))
    states = []
    for by_pair in (False, True):
        state = initial_state(model)
        to = state.steering.ramp_to
        to[1] = 0.3
        state.steering.set(ramp_to=to, ramp_steps=500.0, travel_limit=np.inf)
        Stepper(model, state, by_pair=by_pair).step(1000)
        states.append(state)
    assert states[0].steering.step == 1000
    a, b = (np.stack([s.node_ux[0].numpy(), s.node_uy[0].numpy()]) for s in states)
    assert np.abs(a).max() > 1e-5
    assert np.abs(a - b).max() < 1e-9 * np.abs(a).max()
