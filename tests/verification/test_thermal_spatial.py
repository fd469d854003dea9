"""Heat in space: uniform, by the length factor of the wires, and uneven, by lengths of their own.

straight wire between two grips, segments with thermal_strain w:    T = EA (1/mean(1 + w) - 1)
everything f times as large, wires heated by as much:       overlaps f times as large, bending forces 1/f^2
any state:                                                  the thermal force is the derivative of the energy by f
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from reference.rods import SECTION, energy, relaxed
from warpknit import measure
from warpknit.compute.kept import Owner, restore, save
from warpknit.runner.run import run_scene
from warpknit.scene import load_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation
from warpknit.spatial.observables import read
from warpknit.spatial.rod_relaxation import RodRelaxation
from warpknit.spatial.rod_step import RodStepper
from warpknit.spatial.rods import rods_of

SCENES = Path(__file__).parents[2] / "scenes"
CELL = SCENES / "atlas_cell_spatial.toml"
DRAFT = ("solver.preset=draft", "model.nodes_per_loop=40", "solver.residual_tolerance=0.02", "output.frames=1")
PATCH = ("model.boundary=gripped", "knit.repeats=[1,2]")


@pytest.mark.parametrize("softening", [1.0, 4.0])
def test_a_wire_that_is_cold_at_one_end_pulls_as_its_mean(softening: float) -> None:
    """The multipliers bring the lengths in to 1e-9, of a wire that is softened and of one that is not."""
    count = 12
    points = np.stack([np.arange(count, dtype=float), np.zeros(count), np.zeros(count)], axis=1)
    rods = rods_of(SECTION, [points]).holding([0, 1, count - 2, count - 1], [0, count - 2])
    rest = RodRelaxation(RodStepper(rods), softening=softening)
    thermal_strain = -1e-3 * np.linspace(0.0, 1.0, count)
    rest.multipliers.set_thermal_strain(thermal_strain)
    relaxed(rest, 1e-6 * SECTION.axial_stiffness, strain_tolerance=1e-9)
    between = slice(1, count - 2)
    wanted = SECTION.axial_stiffness * (1.0 / np.mean(1.0 + thermal_strain[between]) - 1.0)
    assert rest.tension()[between] == pytest.approx(wanted, rel=1e-4, abs=0)


def test_a_wire_that_is_even_again_lets_go_after_a_resume() -> None:
    """The multipliers remove the tensions of an uneven thermal strain once it is gone, also after a resume in between: to 1e-9 of
    strain."""
    count = 12
    points = np.stack([np.arange(count, dtype=float), np.zeros(count), np.zeros(count)], axis=1)
    rods = rods_of(SECTION, [points]).holding([0, 1, count - 2, count - 1], [0, count - 2])
    rest = RodRelaxation(RodStepper(rods))
    rest.multipliers.set_thermal_strain(-1e-3 * np.linspace(0.0, 1.0, count))
    relaxed(rest, 1e-6 * SECTION.axial_stiffness, strain_tolerance=1e-9)
    rest.multipliers.set_thermal_strain(np.zeros(count))
    other = RodRelaxation(RodStepper(rods))
    kept = save(Owner(rest.stepper.state), Owner(rest))
    restore(kept, Owner(other.stepper.state), Owner(other))
    for one in (rest, other):
        relaxed(one, 1e-6 * SECTION.axial_stiffness, strain_tolerance=1e-9)
    assert np.array_equal(other.tension(), rest.tension())
    assert np.abs(other.tension()).max() < 1e-8 * SECTION.axial_stiffness


def pressed() -> Simulation:
    """A patch whose wires are so thick that they press, strained affinely and flattened: not at rest."""
    relaxation = Simulation(
        build_model(
            load_scene(
                CELL,
                [
                    *DRAFT, *PATCH, "wire.diameter='30 um'", "solver.axial_softening=1",
                ],
            )
        )
    )  # fmt: skip
    mesh, stepper = relaxation.model, relaxation.mechanics.stepper
    gradient = np.diag([1.15, 1.1])
    place = np.zeros((mesh.rods.node_count, 3))
    place[:, 2] = -0.5 * mesh.rods.position[:, 2]
    place[mesh.wires.held_node, :2] = mesh.held_shift(gradient)
    stepper.state.displacement.assign(place)
    stepper.state.steering.set(gradient=gradient)
    relaxation.mechanics.contact.search()
    stepper.evaluate()
    return relaxation


def test_thermal_force_is_the_derivative_of_the_energy() -> None:
    """By the length factor: stretch, bending, twist, what clamps hold, and contact of wires that grow thicker on curves that
    grow. Differences are of a hundredth of the least overlap over the thickness: contact of overlap o has the third derivative
    E/o^3."""
    relaxation = pressed()
    stepper, contact, mesh = relaxation.mechanics.stepper, relaxation.mechanics.contact, relaxation.model
    mechanics = relaxation.mechanics
    last = read(mesh, mechanics.sites, mechanics.relaxation, contact, mechanics.state, 0)
    assert len(last.touching.force) > 4
    step = 0.01 * float(last.touching.overlap.min()) / mesh.rods.section.thickness
    place = stepper.state.displacement.numpy().copy()

    rods, held = mesh.rods, ~mesh.rods.can_stretch & (mesh.rods.following >= 0)
    softened = mechanics.relaxation.multipliers.softened_stiffness

    def energies(factor: float) -> np.ndarray:
        stepper.state.steering.set(length_factor=factor)
        place[mesh.wires.held_node, :2] = mesh.held_shift(last.gradient, factor)
        stepper.state.displacement.assign(place)
        stepper.evaluate()
        natural, strain = rods.natural_length[held] * factor, mechanics.relaxation.strain()[held]
        rigid = 0.5 * softened * float(np.sum(natural * strain**2))  # that clamps hold
        return np.array([energy(stepper) - rigid, 0.5 * mesh.soft_penalty * float(np.sum(contact.read_contacts().overlap ** 2))])

    slope = (energies(1.0 + step) - energies(1.0 - step)) / (2.0 * step)
    assert last.contact_growth == pytest.approx(slope[1], rel=1e-3, abs=0)
    assert last.thermal_force - last.contact_growth == pytest.approx(slope[0], rel=1e-3, abs=0)


def test_what_grows_alike_touches_alike() -> None:
    """Wires heated by f in a frame f times as large, all displacements too: the same picture, f times as large, to round-off."""
    relaxation, by = pressed(), 1.02
    state, contact = relaxation.state, relaxation.mechanics.contact
    before = contact.read_contacts()
    place, gradient = state.displacement.numpy() * by, by * state.gradient
    place[:, 2] += (by - 1.0) * relaxation.model.rods.position[:, 2]
    state.displacement.assign(place)
    state.steering.set(gradient=gradient, length_factor=by)
    contact.search()
    relaxation.mechanics.stepper.evaluate()
    after = contact.read_contacts()
    order = [np.lexsort((t.second, t.first)) for t in (before, after)]
    assert len(before.force) > 4
    assert after.overlap[order[1]] == pytest.approx(by * before.overlap[order[0]], rel=1e-6, abs=1e-12 * by)


def test_cooling_in_a_rigid_frame_is_stretching() -> None:
    """A tile at 9.5 % whose wires are f times as long is one at 1.095/f: bending rules, so its tension is 1/f^3 of that. Both
    come to rest within their tolerance of 2 %, and the tension would be half as large without the heat."""
    factor = 0.99
    cold = (factor - 1.0) / 4.5e-5  # [K]
    heat = ("wire.expansion='4.5e-5 /K'", f"load.temperature='{20.0 + cold} degC'")
    heated = (*heat, "load.strain_weft=0.095", "load.strain_warp=0.095")
    strained = tuple(f"load.strain_{side}={1.095 / factor - 1.0}" for side in ("weft", "warp"))
    found = [
        np.array([measure.mesh_tension(r.observables) for r in Simulation(build_model(load_scene(CELL, [*DRAFT, *o]))).run()][-1])
        for o in (heated, strained)
    ]
    assert found[0] * factor**3 == pytest.approx(found[1], rel=0.03, abs=0)


def test_work_of_uneven_heat_is_on_the_books(tmp_path: Path) -> None:
    """Energy balance of a patch that is strained, then warmed, one side more than the other: what heat puts in, by the length
    factor and by the segments' own lengths, by the trapezoidal rule over three levels of forces that change by a third."""
    scene = load_scene(
        CELL,
        [
            *DRAFT, *PATCH, "output.frames=3", "output.usd=false", "output.figures=false",
            "load.strain_weft=0.02", "load.strain_warp=0.02", "model.nodes_per_loop=24", "wire.expansion='4.5e-5 /K'",
            "path=[{temperature='60 degC', temperature_gradient=['-1e5 K/m', '2e4 K/m']}]",
        ],
    )  # fmt: skip
    ending = run_scene(scene, out=tmp_path / "run", device="cpu")
    assert abs(ending.summary.json()["quality"]["energy_balance_of_stored"]) < 0.01
    with open(tmp_path / "run" / "history.csv", newline="", encoding="utf-8") as file:
        first, *_, last = [row for row in csv.DictReader(file) if row["load_factor"] == "1.0"]
    stored = [sum(float(row[f"energy_{kind}_J"]) for kind in ("stretch", "bend", "contact")) for row in (first, last)]
    assert abs(float(last["edge_work_J"])) > 0.05 * stored[1]
    assert stored[1] < 0.8 * stored[0]
