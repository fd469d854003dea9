"""Cords along the edge, pulls at it, and temperatures that differ from place to place."""

from functools import cache

import numpy as np
import pytest

from reference.planar import planar_scene
from warpknit import measure
from warpknit.mesh.rim import Rim, build_rim
from warpknit.planar.mechanics import wire_thermal_strain
from warpknit.planar.model import Model
from warpknit.planar.observables import PlanarObservables, read
from warpknit.planar.state import initial_state
from warpknit.planar.step import Stepper
from warpknit.runner.run import run_scene
from warpknit.solve.model import build_model
from warpknit.solve.multilevel import EDGE_TOLERANCE, MEMBRANE_TOLERANCE
from warpknit.solve.simulate import Record, Simulation

CORD = {"grip_pitch": 0.0136, "cord": {"tension": 0.5, "stiffness": 50.0}}
LOAD = {"strain_weft": 0.1, "strain_warp": 0.1}
QUICK = {"preset": "draft"}


def corded_rim() -> tuple[Model, Rim]:
    scene = planar_scene({"knit": {"repeats": [8, 8]}, "panel": CORD, "solver": QUICK})
    model = build_model(scene)
    return model, build_rim(model.panel, scene)


def test_clamps_follow_the_stations_straight_in_between() -> None:
    """Weights add up to one and give back any motion that is linear along the edges."""
    model, rim = corded_rim()
    assert rim.clamps.sum(axis=1) == pytest.approx(1.0)
    assert rim.clamps @ rim.place == pytest.approx(model.panel.clamp_position, abs=1e-12)
    assert rim.given.sum() == 8 + 0 * len(rim.arc)  # 27.2 mm x 32 mm: two spans a side
    assert np.all(np.diff(rim.arc) > 0.0)


def test_a_cord_of_given_tension_bends_as_a_string() -> None:
    """A flat parabola of sag s over a span L carries 8 T s/L^2 a length; stations h apart see it times h, to (4 s/L)^2."""
    _, rim = corded_rim()
    net = np.nonzero(rim.given)[0]
    first, last = net[0], net[1]
    between = np.arange(first, last + 1)
    span = float(np.linalg.norm(rim.place[last] - rim.place[first]))
    share = (rim.arc[between] - rim.arc[first]) / span
    sag = 1e-4 * span
    moved = np.zeros_like(rim.place)
    moved[between, 1] = 4.0 * sag * share * (1.0 - share)
    force, tension = rim.cord_forces(np.eye(2), moved)
    h = span / (len(between) - 1)
    expected = -8.0 * rim.cord.tension * sag / span**2 * h
    assert force[between[1:-1], 1] == pytest.approx(expected, rel=50.0 / 0.5 * (4.0 * sag / span) ** 2 + 1e-9)
    assert tension.min() == pytest.approx(0.5, rel=1e-9)


@pytest.mark.parametrize("axes", [2, 3])
def test_the_stiffness_of_the_cord_is_the_derivative_of_its_forces(axes: int) -> None:
    """In the plane and out of it, of free stations: the outline is straight between the given ones."""
    _, rim = corded_rim()
    rng = np.random.default_rng(3)
    moved = 1e-6 * rng.normal(size=(len(rim.arc), axes))
    matrix = rim.cord_stiffness(np.diag([1.1, 1.05]), moved)
    step = 1e-9
    free = np.flatnonzero(np.repeat(~rim.given, axes))
    for k in free[rng.integers(0, len(free), 6)]:
        there = moved.ravel().copy()
        there[k] += step
        change = (
            rim.cord_forces(np.diag([1.1, 1.05]), there.reshape(-1, axes))[0] - rim.cord_forces(np.diag([1.1, 1.05]), moved)[0]
        )
        column = matrix[:, k].toarray().ravel()
        taut = np.abs(column) > 1e-4 * np.abs(column).max()
        assert -change.ravel()[taut] / step == pytest.approx(column[taut], rel=1e-3, abs=1e-3 * np.abs(column).max())


def test_a_raised_cord_is_straight_between_net_nodes_and_has_its_tension() -> None:
    """A cord on straight lines between net nodes of any height pulls along these lines with T, at the net nodes alone."""
    _, rim = corded_rim()
    height = 1e-3 * np.random.default_rng(5).normal(size=int(rim.given.sum()))
    moved = np.zeros((len(rim.arc), 3))
    moved[:, 2] = rim.chords @ height
    assert moved[rim.given, 2] == pytest.approx(height, abs=1e-15)
    force, tension = rim.cord_forces(np.diag([1.1, 1.05]), moved)
    assert tension == pytest.approx(rim.cord.tension, rel=1e-12)
    assert np.abs(force[~rim.given]).max() < 1e-12 * rim.cord.tension
    assert np.abs(force[rim.given, 2]).max() > 0.01 * rim.cord.tension


@cache
def corded() -> Record:
    scene = planar_scene({"knit": {"repeats": [6, 5]}, "panel": CORD, "load": LOAD, "solver": QUICK, "output": {"frames": 1}})
    model = build_model(scene)
    *_, last = Simulation(model, initial_state(model)).run()
    return last


def test_the_cord_balances_the_mesh() -> None:
    """At rest, what the wires pull at a station between net nodes is what the cord gives, over what counts as balanced."""
    record = corded()
    model = record.observables.model
    rim = build_rim(model.panel, model.scene)
    wires = rim.clamps.T @ -record.observables.edge_force
    cord, tension = rim.cord_forces(record.observables.gradient, record.stations)
    free = ~rim.given
    spacing = rim.outline.length / len(rim.arc)
    nominal = np.abs(record.observables.nominal_stress).max()
    assert np.abs(wires[free]).max() > 0.2 * nominal * spacing  # there is something to balance
    # the membrane's tolerance is that of the stress over the whole mesh; the edge is a band of some cells of it
    assert np.sqrt(np.mean((wires + cord)[free] ** 2)) < 5.0 * MEMBRANE_TOLERANCE * nominal * spacing
    assert tension.min() > 0.0
    outward = rim.place - rim.outline.corners.mean(axis=0)
    assert np.all(np.sum(record.stations[free] * outward[free], axis=1) < 0.0)  # the mesh draws its edge in
    assert np.all(record.stations[rim.given] == 0.0)


def test_a_stiff_cord_is_solved_though_the_mesh_hardly_feels_it() -> None:
    """A cord that is stiff against a small mesh carries the string's load q L^2/(8 T) all the same."""
    panel = {"outline": "hexagon", "size": 0.014, "grip_pitch": 0.014, "cord": {"tension": 0.5, "stiffness": 50.0}}
    model = build_model(planar_scene({"panel": panel, "load": LOAD, "solver": QUICK, "output": {"frames": 1}}))
    *_, record = Simulation(model, initial_state(model)).run()
    rim = build_rim(model.panel, model.scene)
    wires = rim.clamps.T @ -record.observables.edge_force
    cord, _ = rim.cord_forces(record.observables.gradient, record.stations)
    free = ~rim.given
    assert np.abs(record.stations[free]).max() > 1e-7
    left, pulled = (np.sqrt(np.mean(f[free] ** 2)) for f in (wires + cord, wires))
    # balanced at the last look; the last steps and multipliers move the forces by the tolerance of the draft preset
    assert left < (EDGE_TOLERANCE + 3e-2) * pulled


def test_a_facet_converges_from_one_repeat() -> None:
    """A start from one repeat is out of balance at the edge at first, in short waves that decay. A membrane correction for them,
    at the first check, would ask for a third of the size of the mesh and put it far out of balance."""
    panel = {"outline": "hexagon", "size": 0.015, "grip_pitch": 0.0075, "cord": {"tension": 0.5, "stiffness": 2000.0}}
    load = {"strain_weft": 0.025, "strain_warp": 0.025}
    model = build_model(planar_scene({"panel": panel, "load": load, "solver": QUICK, "output": {"frames": 1}}))
    *_, record = Simulation(model, initial_state(model)).run()
    assert record.steps < 10_000


def test_every_place_on_an_outline_that_begins_at_a_mild_corner_has_stations() -> None:
    """The first corner turns too little for a net node, so that places before the first station belong to the last stretch."""
    corners = [[0.0, -0.012], [0.012, -0.011], [0.011, 0.012], [-0.012, 0.012], [-0.012, -0.011]]
    scene = planar_scene({"panel": {"outline": "polygon", "corners": corners, **CORD}})
    rim = build_rim(build_model(scene).panel, scene)
    arc = np.linspace(0.0, rim.outline.length, 101, endpoint=False)
    weights = rim.weights(arc)
    assert weights.sum(axis=1) == pytest.approx(1.0)
    # straight stretches between stations: places that share a side with both stations come back
    back = weights @ rim.place
    on_side = np.linalg.norm(back - rim.outline.place(arc), axis=1) < 1e-12
    assert on_side.sum() > 80


def test_work_at_the_edge_is_on_the_books(tmp_path) -> None:
    """Energy balance of a run whose edge is pulled and hangs on a cord, with a gradient of temperature."""
    scene = planar_scene(
        {
            "knit": {"repeats": [3, 2]},
            "panel": {"grip_pitch": 0.01, "cord": {"tension": 0.5, "stiffness": 50.0}},
            "load": {**LOAD, "temperature_gradient": [2e3, 1e3], "pull": [{"at": [5.1e-3, 0.0], "by": [5e-4, 1e-4]}]},
            "solver": QUICK,
            "output": {"frames": 8, "usd": False, "figures": False},
        }
    )
    summary = run_scene(scene, out=tmp_path / "run").summary.json()
    assert summary["stop_reason"] == "steady"
    rows = (tmp_path / "run" / "history.csv").read_text().splitlines()
    edge = float(rows[-1].split(",")[rows[0].split(",").index("edge_work_J")])
    stored = sum(float(rows[-1].split(",")[rows[0].split(",").index(f"energy_{k}_J")]) for k in ("stretch", "bend", "contact"))
    assert abs(edge) > 0.05 * stored
    # the trapezoidal rule over 8 levels of a load whose force grows about as its square: 1/(4 64) of the work, and a spline
    assert abs(summary["quality"]["energy_balance_of_stored"]) < 0.02


def test_the_ramp_takes_the_clamps_where_they_should_be() -> None:
    """x = F c + q, on either kernel of grips there is."""
    model, rim = corded_rim()
    state = initial_state(model)
    rng = np.random.default_rng(1)
    moved = rim.clamps @ (1e-5 * rng.normal(size=rim.place.shape))
    state.move_clamps(moved, moved)
    Stepper(model, state).step(1)
    reading = read(model, state)
    held = model.panel.held_node
    # counts of 2^-38 m
    assert reading.u[held] == pytest.approx(moved[model.panel.held_clamp], abs=model.precision.unit)


def hot(gradient: tuple[float, float]) -> tuple[Model, PlanarObservables]:
    scene = planar_scene({"knit": {"repeats": [3, 3]}, "solver": {"precision": "double"}})
    model = build_model(scene)
    state = initial_state(model)
    state.wire_thermal_strain.assign(wire_thermal_strain(model, scene.wire.reference_temperature, gradient))
    return model, read(model, state)


def test_a_gradient_of_temperature_strains_each_wire_by_where_it_lies() -> None:
    """Excess length is alpha (T - T_middle) at both ends of a wire, whichever way the gradient points."""
    model, reading = hot((3e3, -2e3))
    alpha = model.scene.wire.expansion
    middle = model.panel.low + 0.5 * model.panel.size
    ends = model.panel.clamp_position.reshape(-1, 2, 2) - middle
    first, growth = reading.thermal_strain.T
    warm = np.stack([first, first + growth * (model.panel.wire_count - 1)], axis=1)
    # the first and last node stand up to two nodes beyond the clamps
    beyond = 2.0 * float(model.table.spacing.max()) * 3e3 * alpha
    assert warm == pytest.approx(alpha * ends @ np.array([3e3, -2e3]), abs=beyond)


def test_warmth_strains_as_the_length_factor_does() -> None:
    """The strain that multipliers take out is (l/(l0 (1 + w)) - 1): the same whether all wires are warm by the length factor or
    by their own thermal strain."""
    from reference.plane_wires import strains

    scene = planar_scene({"knit": {"repeats": [2, 2]}, "solver": {"precision": "double"}})
    model = build_model(scene)
    found = []
    for own in (False, True):
        state = initial_state(model)
        if own:
            state.wire_thermal_strain.assign(np.tile([1e-3, 0.0], (len(model.panel.wire_first), 1)))
        else:
            state.steering.set(length_factor=1.001)
        found.append(strains(model, state))
    assert np.abs(found[0]).max() > 5e-4
    assert found[1] == pytest.approx(found[0], abs=1e-12)


def test_pulls_move_what_is_near_them() -> None:
    scene = planar_scene({"knit": {"repeats": [8, 8]}, "load": {"pull": [{"at": [13.6e-3, 0], "by": [1e-3, 0], "width": 8e-3}]}})
    model = build_model(scene)
    rim = build_rim(model.panel, scene)
    moved = rim.pulled(scene.stages[0].pull)
    middle = model.panel.low + 0.5 * model.panel.size
    away = np.abs(rim.place - middle - [13.6e-3, 0.0])
    near = (away[:, 0] < 1e-9) & (away[:, 1] < 4e-3)
    assert moved[near, 0] == pytest.approx(1e-3 * np.cos(np.pi * away[near, 1] / 8e-3) ** 2)
    assert np.all(moved[~near] == 0.0)
    assert near.sum() >= 2


@pytest.mark.slow
@pytest.mark.parametrize("repeats", [[8, 8], [16, 16]])
def test_a_pulled_edge_costs_few_steps_and_ends_where_more_care_ends(repeats: list[int]) -> None:
    """The membrane is only a start: the state is that of a run in three levels and to a tenth of the tolerance, by a hundredth of
    the tension, which is the tolerance. (Four levels may end in another equilibrium, with 2 % less tension.)"""
    width, by = 2.5e-3 * repeats[0], 0.05e-3 * repeats[0]
    pull = [{"at": [1.7e-3 * repeats[0], 0.0], "by": [by, 0.0], "width": width}]
    tensions, steps = [], []
    for frames, tolerance in ((1, 0.01), (3, 0.001)):
        solver = {**QUICK, "residual_tolerance": tolerance}
        table = {"knit": {"repeats": repeats}, "load": {**LOAD, "pull": pull}, "solver": solver, "output": {"frames": frames}}
        model = build_model(planar_scene(table | {"model": {"nodes_per_loop": 12}}))
        *_, last = Simulation(model, initial_state(model)).run()
        tensions.append(measure.mesh_tension(last.observables))
        steps.append(last.steps)
    assert tensions[0] == pytest.approx(tensions[1], rel=0.01)
    assert steps[0] < 20_000
