"""The double atlas cell in space: against the planar model, against its own energy, and against itself as part of a larger
tile."""

import functools
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from reference.cases import slow
from reference.rods import energy as stored_energy
from warpknit import measure
from warpknit.kernels.wire_minima import SINGLE_STEP
from warpknit.knit.named import named_knit
from warpknit.planar.state import initial_state
from warpknit.scene import load_scene, make_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation
from warpknit.spatial.observables import NEAR, SpatialObservables
from warpknit.spatial.pair_search import search_cells

CELL = Path(__file__).parents[2] / "scenes" / "atlas_cell_spatial.toml"
DRAFT = ("solver.preset=draft", "model.nodes_per_loop=40", "solver.residual_tolerance=0.02")


@functools.cache
def relaxed(*overrides: str) -> tuple[Simulation, list[SpatialObservables]]:
    """The cell run to its end at so few nodes that it takes seconds, and the readings of all its records."""
    relaxation = Simulation(build_model(load_scene(CELL, [*DRAFT, *overrides])))
    return relaxation, [record.observables for record in relaxation.run()]


def readings(*overrides: str) -> list[SpatialObservables]:
    return relaxed(*overrides)[1]


def test_nothing_touches_as_knitted() -> None:
    """The knit's wires pass each other at 1.25 d and more, free of stress: no contact, no tension."""
    unloaded = readings("output.frames=3")[0]
    assert unloaded.energies.stored < 1e-20 and not measure.pair_active(unloaded).any() and len(unloaded.touching.force) == 0


def test_a_yarn_is_knitted_as_thick_as_it_is() -> None:
    """The wires of a yarn of three ends do not overlap as knitted either."""
    relaxation, (unloaded, *_) = relaxed("wire.ends=3", "load.strain_weft=0", "load.strain_warp=0", "output.frames=1")
    assert not relaxation.notes and len(unloaded.touching.force) == 0


def test_wires_that_overlap_as_knitted_are_pushed_apart() -> None:
    """Wires thicker than the knit keeps their centre lines apart: said, and taken out before the load comes on."""
    model = build_model(load_scene(CELL, [*DRAFT, "load.strain_weft=0", "load.strain_warp=0", "output.frames=1"]))
    section, count = model.rods.section, len(model.rods.wire_first)
    sections = (replace(section, thickness=1.6 * section.thickness),) * count
    relaxation = Simulation(replace(model, rods=replace(model.rods, sections=sections)))
    unloaded, *_ = [record.observables for record in relaxation.run()]
    assert "as knitted, wires overlap in" in relaxation.notes[0]
    assert unloaded.touching.force.max() > 0.0 and unloaded.penetration < 0.01


def test_cell_in_space_is_near_the_planar_one() -> None:
    """At 10 % both ways the contacts that carry are the same, and tension is within what the planar model leaves out. In space
    more touch, with less than a fiftieth of the largest force.

    It takes wires for crossing in one plane with a body of d/4 between them, closed at 1.25 d; in space they close at d, over
    and under each other. On the contact curve 0.25 d of gap are worth 4.6 % a 0.05 d in contact force near 10 %
    (studies/models.md), so up to 25 %.
    """
    spatial = readings("output.frames=3")[-1]
    planar = load_scene(CELL, ["model.kind=planar", "solver.preset=draft", "output.frames=10"])
    model = build_model(planar)
    *_, record = Simulation(model, initial_state(model)).run()
    carrying = spatial.site_force > 0.02 * spatial.site_force.max()
    assert 2 * carrying.sum() == measure.contacts(record.observables).active
    assert measure.mesh_tension(spatial) == pytest.approx(measure.mesh_tension(record.observables), rel=0.25)
    assert measure.stress_extremes(spatial)[0] == pytest.approx(measure.stress_extremes(record.observables)[0], rel=0.25)


def assert_stress_is_the_derivative_of_the_energy(relaxation: Simulation) -> None:
    """A0 P = dE/dF at held displacements, stretch, bending, twist and contact, clamps carried: by central differences.

    They are off by (step)^2 times the third derivative, which contact of overlap o makes E/o^3: a hundredth of o is taken for
    the step of the places, F by that over the size of the cell. All contacts have the same penalty and the same offset a of
    either wire, so that their energy is N (o + 2 a)/2.
    """
    stepper, contact, mesh = relaxation.mechanics.stepper, relaxation.mechanics.contact, relaxation.model
    offset = 0.02 * mesh.rods.section.thickness
    stepper.state.contact_penalty.fill_(mesh.contact_stiffness)
    stepper.state.contact_offset.fill_(offset)
    stepper.state.steering.set(bow_moment=0.0)  # chords: the length of arcs is kept by multipliers, at rest only
    last = relaxation.mechanics.observe()
    assert len(last.touching.force) > 4
    step = 0.01 * float(last.touching.overlap.min() + 2.0 * offset) / mesh.panel.size.max()
    gradient, found = last.gradient.copy(), np.zeros((2, 2))
    place = stepper.state.displacement.numpy().copy()

    def energy(f: np.ndarray) -> float:
        stepper.state.steering.set(gradient=f)
        place[mesh.wires.held_node, :2] = mesh.held_shift(f)
        stepper.state.displacement.assign(place)
        stepper.evaluate()
        near = contact.read_contacts()
        return stored_energy(stepper) + 0.5 * float(np.sum(near.force * (near.overlap + 2.0 * offset)))

    for k in np.ndindex(2, 2):
        way = np.zeros((2, 2))
        way[k] = step
        found[k] = (energy(gradient + way) - energy(gradient - way)) / (2 * step)
    energy(gradient)
    assert last.nominal_stress * mesh.panel.area == pytest.approx(found, rel=2e-3, abs=2e-3 * np.abs(found).max())


def test_nominal_stress_of_a_tile_is_the_derivative_of_the_energy() -> None:
    assert_stress_is_the_derivative_of_the_energy(relaxed("output.frames=3")[0])


def patch(*overrides: str) -> Simulation:
    """A small gripped patch as knitted."""
    return Simulation(build_model(load_scene(CELL, [*DRAFT, "model.boundary=gripped", "knit.repeats=[1,2]", *overrides])))


def test_nominal_stress_of_a_patch_is_the_derivative_of_the_energy() -> None:
    """Clamps included, in a state that is not at rest: strained affinely, with wires so thick that they touch."""
    relaxation = patch("wire.diameter='30 um'")
    gradient = np.array([[1.15, 0.02], [0.0, 1.1]])
    place = np.zeros((relaxation.model.rods.node_count, 3))
    place[:, 2] = -0.5 * relaxation.model.rods.position[:, 2]
    place[relaxation.model.wires.held_node, :2] = relaxation.model.held_shift(gradient)
    relaxation.mechanics.stepper.state.displacement.assign(place)
    relaxation.mechanics.stepper.state.steering.set(gradient=gradient)
    relaxation.mechanics.contact.search()
    assert_stress_is_the_derivative_of_the_energy(relaxation)


def test_clamps_sit_where_the_planar_model_has_them() -> None:
    """In the middle of the first and last segment, but for the sag of an arc, h^2 kappa/8 with 1/kappa above a tenth of a
    course."""
    mesh = patch().model
    rods, clamps = mesh.rods, mesh.panel.clamp_position.reshape(-1, 2, 2)
    last = rods.wire_first + rods.wire_count - 1
    spacing = float(rods.natural_length.max())
    sag = spacing**2 / (8 * 0.1 * mesh.scene.knit.course_spacing)
    for nodes, clamp in (((rods.wire_first, rods.wire_first + 1), clamps[:, 0]), ((last - 1, last), clamps[:, 1])):
        middle = 0.5 * (rods.position[nodes[0]] + rods.position[nodes[1]])
        assert np.linalg.norm(middle[:, :2] - clamp, axis=1).max() < sag
    assert len(mesh.wires.site_wire) == mesh.panel.body_count


def test_contacts_are_where_the_knit_hooks_its_wires() -> None:
    """Of the active contacts those elsewhere carry a small part."""
    last = readings("output.frames=3")[-1]
    assert last.contact_elsewhere.sum() < 0.1 * last.site_force.sum()
    assert last.penetration < 0.01


def test_coarse_cell_comes_to_rest_where_contacts_pass_over_nodes() -> None:
    """At 14 % and 40 nodes a loop two contacts of a clasp stand in one segment, or on either side of a node: neither is lost on
    the way, and the force at rest is that of 48 nodes within what the curve between the nodes misses, 1 % (studies/models.md)."""
    options = ("load.strain_weft=0.14", "load.strain_warp=0.14", "output.frames=1", "solver.residual_tolerance=0.003")
    coarse, fine = (readings(*options, "solver.max_steps=20000", f"model.nodes_per_loop={n}")[-1] for n in (40, 48))
    assert coarse.site_force.sum() == pytest.approx(fine.site_force.sum(), rel=0.01)
    assert measure.mesh_tension(coarse) == pytest.approx(measure.mesh_tension(fine), rel=0.01)


@pytest.mark.slow
def test_rhombus_of_a_patch_is_that_of_the_cell() -> None:
    """Two repeats a side, gripped, at 14 %: the central rhombus has the share of the cell at the same strain, as in the plane.

    Contacts of less than 10 uN, where those that hook carry a hundred, come and go with the grips. At 40 nodes a loop the cell
    does not come to rest at that load.
    """
    strain = ("load.strain_weft=0.14", "load.strain_warp=0.14")
    load = ("model.nodes_per_loop=56", "output.frames=4", "contact.threshold='10 uN'", *strain)
    relaxation = patch("knit.repeats=[2,2]", *load)
    *_, last = relaxation.run()
    rhombus = measure.contacts(last.observables, last.observables.model.panel.rhombus_bodies)
    assert rhombus.bodies == 12
    assert rhombus.active_percent == measure.contacts(readings(*load)[-1]).active_percent


@pytest.mark.parametrize(
    ("friction", "residual", "accuracy"), slow((0.0, 1e-6, 3e-5), (0.2, 0.1, 1e-9)), ids=["without", "with friction"]
)
def test_tile_of_three_by_three_repeats_is_the_cell(friction: float, residual: float, accuracy: float) -> None:
    """At so few nodes that segments of one repeat are near several images of each other, one repeat rests as nine do.

    Without friction that is one state, to the residual, by which the tensions of both may drift. With friction the state depends
    on the way there, which is the same but for round-off; not so at 14 nodes, where a closest point passes a node and
    its saddle is lower than the least barrier (kernels/wire_closest.py): forces then move by the third root of that, 2e-4.
    """
    load = ("load.strain_weft=0.1", "load.strain_warp=0.1", "output.frames=1", f"solver.residual_tolerance={residual}")
    one, nine = (
        readings("model.nodes_per_loop=16", f"knit.repeats=[{n}, {n}]", f"contact.friction={friction}", *load)[-1] for n in (1, 3)
    )
    rods = one.model.rods
    assert rods.tile[:2].min() < 3.0 * search_cells(rods, one.model.curve).radius
    assert measure.contacts(nine).active_percent == measure.contacts(one).active_percent > 0.0
    assert measure.mesh_tension(nine) == pytest.approx(measure.mesh_tension(one), rel=accuracy)
    assert measure.stress_extremes(nine)[0] == pytest.approx(measure.stress_extremes(one)[0], rel=accuracy)
    assert nine.site_force.sum() == pytest.approx(9.0 * one.site_force.sum(), rel=2.0 * accuracy)


TRICOT = (
    'knit.bars=[{chain="1-0/1-2"}, {chain="1-2/1-0"}]', "knit.wale_spacing='1 mm'", "knit.course_spacing='0.8 mm'",
    "model.nodes_per_loop=24", "output.frames=1",
)  # fmt: skip


def test_nominal_stress_of_a_narrow_tile_is_the_derivative_of_the_energy() -> None:
    """One repeat of a tricot, a wale wide, whose wires touch images of each other."""
    relaxation = relaxed(*TRICOT)[0]
    touching = relaxation.mechanics.contact.read_contacts()
    assert len(np.unique(np.abs(touching.shift).round(9), axis=0)) > 2
    assert_stress_is_the_derivative_of_the_energy(relaxation)


def test_near_contacts_are_those_of_a_new_search() -> None:
    """In equilibrium the steps look at fewer pairs than count as near; what they look at stays."""
    mechanics = relaxed("model.nodes_per_loop=64", "output.frames=1")[0].mechanics
    contact, distance = mechanics.contact, (NEAR - 1.0) * mechanics.model.rods.section.thickness
    before = contact.near_pairs()
    mechanics.stepper.evaluate(distance)
    seen = contact.read_contacts(distance)
    near = mechanics.observe().near
    assert np.array_equal(contact.near_pairs(), before)
    contact.search()
    contact.list_near_pairs(np.inf)
    mechanics.stepper.evaluate(distance)
    found = contact.read_contacts(distance)
    assert len(seen.first) < len(found.first) == len(near.first)
    order = [np.lexsort((*np.rint(1e9 * x.shift).T, x.place[:, 0], x.second, x.first)) for x in (near, found)]
    assert near.overlap[order[0]] == pytest.approx(found.overlap[order[1]], abs=1e-6 * distance)


def test_forces_in_a_narrow_tile_are_those_in_many_repeats() -> None:
    """The state of one repeat of a tricot, laid out over 4 x 3: the same forces on all copies of a node, and on its sites.
    Contact points are found to the square of a last step of SINGLE_STEP, times the ratio of third to second derivatives."""
    relaxation = relaxed(*TRICOT)[0]
    one = relaxation.mechanics
    many = Simulation(build_model(load_scene(CELL, [*DRAFT, *TRICOT, "knit.repeats=[4, 3]"])))
    small, large = relaxation.model.rods, many.model.rods
    box = small.tile + [0.0, 0.0, 1.0]
    distance, node = cKDTree(np.mod(small.position, box), boxsize=box).query(np.mod(large.position, box))
    assert distance.max() < 1e-12
    there = many.mechanics
    for name, values in vars(one.state).items():
        if values.shape[0] == small.node_count:
            getattr(there.state, name).assign(values.numpy()[node])
    there.state.steering.values[:] = one.state.steering.values
    for mechanics in (one, there):
        mechanics.contact.search()
        mechanics.stepper.evaluate()
    assert there.contact.pair_count == 12 * one.contact.pair_count
    force = one.state.force.numpy()[node]
    assert np.abs(there.state.force.numpy() - force).max() < 4.0 * float(SINGLE_STEP) ** 2 * np.abs(force).max()
    few, all_of_them = (s.mechanics.observe() for s in (relaxation, many))
    assert all_of_them.near.force.size == 12 * few.near.force.size
    assert np.sort(all_of_them.site_force)[::12] == pytest.approx(
        np.sort(few.site_force), rel=1e-6, abs=1e-9 * few.site_force.max()
    )
    assert all_of_them.body_near.sum() == 12 * few.body_near.sum() > 0


def test_a_level_at_which_a_contact_passes_a_node_converges() -> None:
    """A force that jumps as a closest point passes a node of the contact curve keeps a mesh from equilibrium: here, at 11 %."""
    bars = [asdict(bar) for bar in named_knit("reverse-locknit").bars]
    scene = make_scene(
        {
            "wire": {"material": "molybdenum", "diameter": "20 um", "ends": 3},
            "knit": {"bars": bars, "wales": "26 /inch", "courses": "30 /inch"},
            "model": {"kind": "spatial", "boundary": "periodic"},
            "contact": {"friction": 0.0},
            "variants": {"count": 1},
            "load": {"strain_weft": 0.11, "strain_warp": 0.11},
            "solver": {"max_steps": 10_000},
            "output": {"frames": 11},
        }
    )
    *_, last = Simulation(build_model(scene)).run()
    assert last.steady and measure.contacts(last.observables).active_percent > 50.0
