"""Large meshes: multilevel start and membrane correction give the same result, in a bounded number of steps."""

import itertools
import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from warpknit import measure
from warpknit.compute.steering import Steering
from warpknit.mechanics.response import STRAIN, find_response, zero_response
from warpknit.mesh.layout import smaller_scene
from warpknit.planar.mechanics import PlanarMechanics
from warpknit.planar.model import Model
from warpknit.planar.observables import read
from warpknit.planar.state import State, initial_state
from warpknit.planar.transfer import state_variables
from warpknit.scene import load_scene
from warpknit.solve.membrane import CORRECTION_STEPS, Correction
from warpknit.solve.model import build_model, mechanics_of
from warpknit.solve.multilevel import MEMBRANE_TOLERANCE, MultilevelRelaxation
from warpknit.solve.relax import Relaxation
from warpknit.solve.simulate import Progress, Simulation

CELL = Path(__file__).parents[1] / "scenes" / "atlas_cell.toml"
LARGE = (12, 3)  # repeats of a mesh that starts from one of 8 x 3
TOLERANCE = 3e-3  # of LOADED: what a tension may still drift
LOADED = (
    "solver.preset=draft", "model.nodes_per_loop=12", "solver.residual_tolerance=3e-3",
    "load.strain_weft=0.1", "load.strain_warp=0.1", "output.frames=1",
)  # fmt: skip


def panel(repeats: list[int], boundary: str = "gripped") -> Model:
    return build_model(load_scene(CELL, [*LOADED, f"knit.repeats={repeats}", f"model.boundary={boundary}"]))


@cache
def settled(repeats: tuple[int, int], boundary: str, alone: bool) -> tuple[Model, State, Simulation, int]:
    """A mesh at 10 % both ways, with its smaller meshes or without; what changes its state puts it back."""
    model = panel(list(repeats), boundary)
    state = initial_state(model)
    simulation = Simulation(model, state)
    if alone:
        simulation.drive = Relaxation(mechanics_of(model, state), simulation.progress)
    *_, last = simulation.run()
    return model, state, simulation, last.steps


def tension(model: Model, state: State) -> np.ndarray:
    return np.array(measure.mesh_tension(read(model, state)))


def test_smaller_scene_keeps_the_parity_and_ends() -> None:
    """Odd panels are cut through the middle of a repeat, even ones between two: a smaller panel must be cut alike."""
    scene = load_scene(CELL, ["model.boundary=gripped"])
    for repeats in ((290, 291), (24, 300), (13, 40)):
        there, sizes = replace(scene, knit=replace(scene.knit, repeats=repeats)), [repeats]
        while (there := smaller_scene(there)) is not None:
            sizes.append(there.knit.repeats)
        assert all(np.all((np.array(larger) - less) % 2 == 0) for larger, less in itertools.pairwise(sizes))
        assert max(sizes[-1]) <= 13 and len(sizes) <= 5
    assert smaller_scene(replace(scene, knit=replace(scene.knit, repeats=(7, 6)))) is None


def test_periodic_mesh_starts_at_its_answer() -> None:
    """Repeats of a periodic mesh are alike, so it begins where one repeat came to rest, and needs no more than the looks that
    tell so: `drift_looks` + 1. The tensions of both may drift by the tolerance."""
    model, state, simulation, steps = settled((3, 2), "periodic", False)
    cell = simulation.drive.smaller
    assert steps <= 10 * 50
    assert tension(model, state) == pytest.approx(tension(cell.model, cell.state), rel=2 * TOLERANCE)


def test_start_from_smaller_meshes_gives_the_same_answer_in_fewer_steps() -> None:
    """12 x 12 repeats with a start from 8 x 8, against the same mesh that begins undeformed: tensions within what both may still
    drift; contact forces, which rise about three times as steeply, within three times the local tension's MEMBRANE_TOLERANCE;
    all in less than half of the steps."""
    model, state, _, steps = settled(LARGE, "gripped", False)
    _, alone, _, many = settled(LARGE, "gripped", True)
    assert tension(model, state) == pytest.approx(tension(model, alone), rel=3 * TOLERANCE)
    force, expected = state.pair_force.numpy(), alone.pair_force.numpy()
    assert np.sqrt(np.mean((force - expected) ** 2)) < 3 * MEMBRANE_TOLERANCE * np.sqrt(np.mean(expected**2))
    assert steps < 0.5 * many


def test_the_smallest_mesh_converges_at_the_end_of_its_path(monkeypatch: pytest.MonkeyPatch) -> None:
    """Well within its tolerance; on the way it need not converge: the answer is the same, in fewer steps."""
    model, state, simulation, _steps = settled(LARGE, "gripped", False)
    smaller = simulation.drive.smaller
    way, end = PlanarMechanics.path_ratios
    assert way > 1.0 > end
    assert smaller.progress.residual < end * smaller.scene.solver.residual_tolerance
    monkeypatch.setattr(PlanarMechanics, "path_ratios", (1.0, end))
    strict = Simulation(panel(list(LARGE)))
    list(strict.run())
    assert tension(model, state) == pytest.approx(tension(strict.model, strict.state), rel=TOLERANCE)
    assert smaller.progress.steps < 0.7 * strict.drive.smaller.progress.steps


def test_a_slack_mesh_is_not_moved_far_for_short_waves() -> None:
    """At 2.5 % both ways, the first check of 12 x 12 repeats asks for a displacement of a millimetre; short waves alone decay."""
    slack = ("load.strain_weft=0.025", "load.strain_warp=0.025", "output.frames=1", "solver.preset=draft")
    model = build_model(load_scene(CELL, ["model.boundary=gripped", "knit.repeats=[12, 12]", *slack]))
    *_, last = Simulation(model, initial_state(model)).run()
    assert last.steps < 4000


def test_a_gripped_mesh_takes_the_place_of_the_smaller_one() -> None:
    """What a large mesh came to by itself is gone once it starts a level from a smaller gripped mesh: to the bit, all that is
    transferred is as on a mesh that did not move before."""
    found = []
    for own in (0, 100):
        model = panel(list(LARGE))
        state = initial_state(model)
        drive = Simulation(model, state).drive
        assert isinstance(drive, MultilevelRelaxation) and drive.smaller is not None and drive.prolongation is not None
        for moved, counts in ((drive.smaller.state, 50), (state, own)):
            for array in (moved.node_ux[moved.parity], moved.body_uy):
                array.assign(array.numpy() + np.arange(array.shape[0], dtype=np.int64) % 7 * counts)
        assert drive.cell is not None
        drive.prolongation.carry(zero_response(drive.cell.mechanics, "cpu"))
        names = ("node_ux", "node_uy", "body_ux", "body_uy", "tension_offset", "pair_offset")
        found.append([state.arrays()[name] for name in names])
    assert all(np.array_equal(one, other) for one, other in zip(*found, strict=True))
    assert np.any(found[0][0])


def test_membrane_moves_and_forces_are_adjoint() -> None:
    """A displacement w of the grid does the work w . R on the grid, R the gathered forces, and f . (w spread) on the mesh."""
    model, state, simulation, _ = settled(LARGE, "gripped", False)
    drive = simulation.drive
    kept = state.arrays()
    state.restore(kept)
    rng = np.random.default_rng(5)
    for speed in (state.node_vx, state.node_vy):
        speed.zero_()
    group, membrane = drive.mechanics.group, drive.membrane
    group.slowest_mode.measure(np.array([0]))
    table = model.rest.node_mass.numpy()[model.panel.node_entry]
    mass = table * np.repeat(state.wire_mass.numpy(), model.panel.wire_count)
    shaken = 1e-3 * rng.normal(size=(2, model.panel.node_count)) / mass  # by forces of a millinewton
    shaken[:, model.panel.held_node] = 0.0
    for values, there in zip(group.stepper.accelerations[0], shaken, strict=True):
        values.assign(there)
    state.pair_force.zero_()
    gathered = membrane.imbalance().copy()
    before = state_variables(model, state)
    displacement = 1e-6 * rng.normal(size=gathered.shape)
    stations = np.zeros((len(membrane.rim.arc), 2))
    response = replace(drive._response, change={name: _nothing(value) for name, value in drive._response.change.items()})
    membrane.warm_up(response)
    membrane.move(Correction(displacement, stations))
    after = state_variables(model, state)
    work = np.sum(mass * (shaken[0] * (after["x"] - before["x"]) + shaken[1] * (after["y"] - before["y"])))
    # counts of 2^-39 m against moves of 1 um
    assert work == pytest.approx(np.sum(gathered * displacement), rel=1e-4)
    membrane.renew(drive._response)
    state.restore(kept)


def _nothing(value: object) -> object:
    import warp as wp

    return wp.zeros_like(value)


def test_response_is_the_derivative_of_the_stress() -> None:
    """dP/dF of an elastic cloth has the major symmetry, and a rotation W turns the stress: dP/dF : W F = W P.

    Differences are one-sided: what they miss is STRAIN over the strain of 10 % by which the stiffness changes by itself."""
    model, _, simulation, _ = settled(LARGE, "gripped", False)
    tangent = simulation.drive._response.tangent
    assert tangent == pytest.approx(tangent.transpose(2, 3, 0, 1))
    cell = simulation.drive.cell
    gradient = np.diag([1.1, 1.1])
    stress, _ = cell.equilibrium_at(gradient, model.scene.wire.reference_temperature)
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    turned = np.einsum("abcd,cd->ab", tangent, turn @ gradient)
    assert turned == pytest.approx(turn @ stress, abs=STRAIN / 0.1 * np.abs(tangent).max())


def test_the_response_needs_only_the_equilibria_beside_the_present_one() -> None:
    """Of P = P0 + C : (F - F0) with symmetric, positive C it is C, from four equilibria."""
    rng, gradient = np.random.default_rng(0), np.diag([1.1, 1.05])
    matrix = rng.normal(size=(4, 4))
    stiffness, stress = (matrix @ matrix.T + np.eye(4)).reshape(2, 2, 2, 2), rng.normal(size=(2, 2))
    found: list[np.ndarray] = []

    def cell_at(there: np.ndarray, temperature: float) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        found.append(there - gradient)
        assert temperature == 250.0
        return stress + np.einsum("abcd,cd->ab", stiffness, there - gradient), {"slide": there.ravel()}

    table = SimpleNamespace(start=np.array([0]), lead=0, x=np.zeros(4), nodes=np.array([4]))
    cell = SimpleNamespace(table=table, panel=SimpleNamespace(wire_first=np.array([0]), node_count=4))
    response = find_response((stress, {"slide": gradient.ravel()}), cell_at, cell, gradient, 250.0, "cpu")
    assert np.array(found).reshape(4, 4) == pytest.approx(STRAIN * np.eye(4))
    assert response.tangent == pytest.approx(stiffness, rel=1e-9)
    assert response.change["slide"].numpy() == pytest.approx(np.eye(4), abs=1e-9)


@pytest.mark.parametrize("stop_at", [pytest.param(5, marks=pytest.mark.slow), 60])
def test_interrupted_start_goes_on_to_the_same_bits(stop_at: int) -> None:
    """What a look at any time keeps is enough to go on from: in the smaller mesh, the cell and the large mesh alike."""
    model, whole, _, _ = settled(LARGE, "gripped", False)

    class Stop(Exception):
        pass

    def run(stop_at: int | None, kept: dict | None) -> dict:
        state = initial_state(model)
        simulation = Simulation(model, state, progress=Progress.from_dict(kept["about"]) if kept else None)
        if kept:
            simulation.drive.load_state_dict(kept["memory"])
        looks = 0

        def monitor(progress: Progress) -> None:
            nonlocal looks
            looks += 1
            if looks == stop_at:
                raise Stop

        simulation.monitor = monitor
        try:
            for _record in simulation.run():
                pass
        except Stop:
            pass
        about = json.loads(json.dumps(simulation.progress.as_dict()))
        return {"state": state.arrays(), "memory": simulation.drive.state_dict(), "about": about}

    expected = whole.arrays()
    part = run(None, run(stop_at, None))
    for name, value in expected.items():
        assert np.array_equal(value, part["state"][name]), name
    assert Steering(expected["control"]).step > 0


def test_a_mesh_has_time_between_corrections() -> None:
    """With checks 50 steps apart. A small imbalance is left to a mesh whose other criteria are met."""
    moved: list[int] = []
    correction = Correction(np.ones((1, 2)), np.ones((1, 2)))
    progress = Progress()
    mechanics = SimpleNamespace(checked_stress=np.eye(2), check_steps=50, search=lambda: None)
    drive = SimpleNamespace(
        progress=progress, mechanics=mechanics, lift=0, state=SimpleNamespace(gradient=np.eye(2)), stations=None
    )
    drive.equilibrium = SimpleNamespace(convergence=SimpleNamespace(least_tension=1.0))
    drive._correction = SimpleNamespace(next_factor=lambda _vector, most: most)
    drive._move_in_parts = lambda *_: moved.append(progress.checks)

    def corrections(imbalance: float, *, ratio: float) -> list[int]:
        moved.clear()
        progress.next_correction = 0
        solved = correction, imbalance * MEMBRANE_TOLERANCE
        membrane = SimpleNamespace(rim=SimpleNamespace(is_free=False), imbalance=lambda: None, solve=lambda *_: solved)
        for progress.checks in range(1, 10):
            MultilevelRelaxation._correct_as_membrane(drive, membrane, ratio)
        return moved

    wait = CORRECTION_STEPS // 50
    assert corrections(1.1, ratio=0.5) == list(range(1, 10, wait))
    assert corrections(0.9, ratio=2.0) == list(range(1, 10, wait))
    assert not corrections(0.9, ratio=0.5)
