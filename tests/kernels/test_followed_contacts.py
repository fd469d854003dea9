"""Contacts that go on from the step before, by vectors of the processor, against the kernels that find all contacts."""

from pathlib import Path

import numpy as np
import pytest

from reference.touching import advance
from warpknit import Simulation, build_model, load_scene
from warpknit.compute.host import fetch, store
from warpknit.compute.steering import Steering
from warpknit.kernels.control import GRADIENT, LENGTH_FACTOR
from warpknit.kernels.wire_closest import FOLLOWED_FORCE, ONE_PLACE, PLACES, TWO_PLACES
from warpknit.kernels.wire_minima import NEWTON_ACCURACY
from warpknit.scene.new_scene import SceneRequest, scene_text
from warpknit.spatial.wire_contact import WireContact

ATLAS = Path(__file__).parents[2] / "scenes" / "atlas_cell_spatial.toml"
STEPS = 40
PUSHED = 1e-3  # of the thickness: random motion before the steps, so that contacts come, go and slide
PAIR = ("pair_found", "pair_place", "pair_wake_travel")
TOUCH = ("touch_loaded", "touch_force", "touch_couple", "touch_overlap", "touch_normal_force", "touch_normal")
FRICTION = ("touch_friction",)  # where there is any
UNWRITTEN = -7.0  # in arrays that the launches are to write
SLIP = ("slip_step", "slip_place", "elastic_slip")


def at_load(knit: str, friction: float) -> WireContact:
    """Contact of a knit under its load, moving."""
    given = SceneRequest(knit=knit, wales="26 /inch", courses="30 /inch", load="6 %", model="spatial")
    scene = load_scene(ATLAS) if knit == "double-atlas" else load_scene(scene_text(given, "x.toml"))
    scene = scene.changed({"output.frames": 4, "solver.residual_tolerance": 0.05, "contact.friction": friction}, preset="draft")
    simulation = Simulation(build_model(scene, "cpu"))
    list(simulation.run())
    contact = simulation.drive.mechanics.contact
    state, thickness = contact.stepper.state, contact.stepper.rods.section.thickness
    move = np.random.default_rng(1).normal(size=(contact.stepper.rods.node_count, 3))
    store(state.velocity, PUSHED * thickness * move)
    if friction > 0.0:  # an equilibrium before, of another load
        before = contact._before
        store(before.before_position, fetch(before.before_position) + PUSHED * thickness * move)
        control = fetch(before.before_control).copy()
        control[:, int(GRADIENT)] *= 1.0 + PUSHED
        control[:, int(LENGTH_FACTOR)] *= 1.0 + PUSHED
        store(before.before_control, control)
    return contact


def found(contact: WireContact, status: float, *, follows: bool) -> dict[str, np.ndarray]:
    """What the launches of contact find in the state of now, of each pair that is near; all pairs stay as they are."""
    pairs, touch, near = contact.pairs, contact.touch, contact.near_pairs()
    contact.stepper.state.steering.set(status=status, evaluated_gap=0.3 * contact.stepper.rods.section.thickness)
    kept = {name: fetch(getattr(pairs, name)).copy() for name in (*PAIR, "pair_renewal_travel")}
    half = (int(contact.stepper.steering.step[0]) + 1) % 2  # of the slips, that the step writes
    store(touch.touch_followed, 0)
    store(touch.touch_loaded, 0)
    of_touch = TOUCH + FRICTION if contact.friction > 0.0 else TOUCH
    for name in of_touch[3:]:
        store(getattr(touch, name), UNWRITTEN)
    for name in SLIP if contact.friction > 0.0 else ():
        store(getattr(contact.slips, name)[half], UNWRITTEN)
    for launch in contact.launches():
        if follows or launch.kernel.key != "find_followed_contacts":
            launch.run("cpu")
    values = {name: fetch(getattr(pairs, name)).copy() for name in PAIR}
    for name, before in kept.items():
        store(getattr(pairs, name), before)
    contact.stepper.state.steering.set(status=Steering.RUNNING)
    one = {name: values[name].reshape(pairs.capacity, -1)[near] for name in PAIR}
    one |= {name: fetch(getattr(touch, name)).copy().reshape(touch.capacity, -1)[: len(near)] for name in of_touch}
    if contact.friction > 0.0:
        one |= {name: fetch(getattr(contact.slips, name))[half].reshape(contact.slips.capacity, -1)[near] for name in SLIP}
    return one | {"followed": fetch(touch.touch_followed)[: len(near)].copy()}


def error_of(name: str, own: dict[str, np.ndarray], of_all: dict[str, np.ndarray]) -> np.ndarray:
    """(pair, place) largest difference of the components at each place."""
    return np.asarray(np.abs(own[name] - of_all[name]).reshape(len(own[name]), PLACES, -1).max(axis=2))


@pytest.mark.parametrize("friction", [0.0, 0.2])
@pytest.mark.parametrize("knit", ["double-atlas", "tricot", "single-atlas", "reverse-locknit"])
def test_followed_contacts_are_those_that_a_search_finds(knit: str, friction: float) -> None:
    """Same places, forces and couples, in a step and in an evaluation, whether a pair touches in one place or two, inside its
    segments or at a node."""
    contact = at_load(knit, friction)
    stepper, thickness = contact.stepper, contact.stepper.rods.section.thickness
    near, followed, with_force, kinds = 0, 0, 0, dict.fromkeys(("one", "two", "at a node", "apart"), 0)
    for step in range(STEPS):
        advance(contact, 1)
        stepper.update_frames()
        evaluates = step % 2 == 1
        status = Steering.EVALUATING if evaluates else Steering.RUNNING
        all_of, own = found(contact, status, follows=False), found(contact, status, follows=True)
        is_followed = own["followed"] != 0
        assert np.array_equal(own["touch_loaded"], all_of["touch_loaded"])
        of_all, of_own = all_of["pair_found"][:, 0], own["pair_found"][:, 0]
        touches = is_followed & (of_own > 0)
        assert np.array_equal(of_own[touches], of_all[touches])
        assert evaluates or np.all(of_all[is_followed & ~touches] <= 0)
        places = touches[:, None] & (np.where(of_own == TWO_PLACES, PLACES, 1)[:, None] > np.arange(PLACES))
        error = np.abs(own["pair_place"] - all_of["pair_place"]).reshape(-1, PLACES, 2)
        assert error[places].max(initial=0.0) < float(NEWTON_ACCURACY)
        largest = np.abs(all_of["touch_force"]).max()
        loaded = is_followed & (all_of["touch_loaded"][:, 0] != 0)
        for name, scale in (("touch_force", largest), ("touch_couple", largest * thickness)):
            assert np.abs(own[name] - all_of[name])[loaded].max(initial=0.0) < float(NEWTON_ACCURACY) * scale, name
        if evaluates:  # a step needs forces and couples alone
            weighs = places & (all_of["touch_overlap"] > -1.0)
            assert np.array_equal(weighs, places & (own["touch_overlap"] > -1.0))
            assert error_of("touch_overlap", own, all_of)[weighs].max(initial=0.0) < float(NEWTON_ACCURACY) * thickness
            pushes = weighs & loaded[:, None] & (all_of["touch_normal_force"] != 0.0)
            for name in ("touch_normal_force", *(FRICTION if friction > 0.0 else ())):
                assert error_of(name, own, all_of)[pushes].max(initial=0.0) < float(NEWTON_ACCURACY) * largest, name
        at_node = np.any((own["pair_place"] <= 0.0) | (own["pair_place"] >= 1.0), axis=1)
        if not evaluates:  # an evaluation searches sooner anew
            near, followed = near + len(is_followed), followed + int(is_followed.sum())
            with_force += int((own["followed"] == int(FOLLOWED_FORCE)).sum())
            if friction > 0.0:
                assert np.array_equal(own["slip_step"], all_of["slip_step"])
                written = own["slip_step"] == contact.stepper.steering.step[0] + 1
                error = np.abs(own["slip_place"] - all_of["slip_place"]).reshape(-1, 2, 2)[is_followed & written.any(axis=1)]
                assert error.max(initial=0.0) < float(NEWTON_ACCURACY)
                assert np.array_equal(own["elastic_slip"], all_of["elastic_slip"])
        kinds["one"] += int(np.sum(touches & (of_own == ONE_PLACE)))
        kinds["two"] += int(np.sum(touches & (of_own == TWO_PLACES)))
        kinds["at a node"] += int(np.sum(touches & at_node))
        kinds["apart"] += int(np.sum(is_followed & (of_own < 0)))
    assert followed > 0.7 * near
    assert with_force > 0.9 * followed
    assert min(kinds["one"], kinds["at a node"], kinds["apart"]) > 0
    assert kinds["two"] > 0 or knit == "single-atlas"
