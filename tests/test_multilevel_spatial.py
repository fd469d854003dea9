"""Large meshes in space: start from smaller meshes, and membrane corrections."""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from reference.cases import slow
from reference.in_words import quantities
from warpknit import measure
from warpknit.commands.plan import overview_of
from warpknit.kernels.banded_mass import HELD_NODE
from warpknit.measure.table import values
from warpknit.mechanics.response import zero_response
from warpknit.runner.branches import with_work
from warpknit.runner.history import row_of, with_sums
from warpknit.runner.summary import run_summary
from warpknit.scene import load_scene
from warpknit.solve.membrane import Aitken, Correction
from warpknit.solve.model import build_model, initial_state, mechanics_of
from warpknit.solve.multilevel import MEMBRANE_TOLERANCE, MultilevelRelaxation
from warpknit.solve.relax import Relaxation
from warpknit.solve.simulate import Progress, Simulation
from warpknit.spatial import transfer
from warpknit.spatial.mechanics import SpatialMechanics
from warpknit.spatial.model import SpatialModel
from warpknit.spatial.rod_step import CHECK_STEPS
from warpknit.spatial.transfer import PanelNodes

CELL = Path(__file__).parents[1] / "scenes" / "atlas_cell_spatial.toml"
TOLERANCE = 3e-3  # what a tension may still drift
SCENE = (
    "solver.preset=draft", "model.nodes_per_loop=24", f"solver.residual_tolerance={TOLERANCE}", "output.frames=1",
    "load.strain_weft=0.05", "load.strain_warp=0.05",
)  # fmt: skip
STRIP = "knit.repeats=[12, 3]"  # one of 8 x 3 repeats is its smaller mesh


def mesh(*changes: str) -> SpatialModel:
    model = build_model(load_scene(CELL, [*SCENE, *changes]))
    assert isinstance(model, SpatialModel)
    return model


@cache
def solved(*changes: str, alone: bool = False) -> tuple[SpatialMechanics, Relaxation, int]:
    """A mesh in equilibrium, with its smaller meshes or without, and its steps."""
    model = mesh(*changes)
    simulation = Simulation(model)
    if alone:
        simulation.drive = Relaxation(mechanics_of(model, simulation.state), simulation.progress)
    *_, last = simulation.run()
    return simulation.mechanics, simulation.drive, last.steps


def observed(mechanics: SpatialMechanics) -> tuple[np.ndarray, float]:
    """Tensions (2,) [N/m], and the share of active contacts."""
    observables = mechanics.observe()
    return np.array(measure.mesh_tension(observables)), float(values(observables, ["active_percent"])["active_percent"])


def test_one_repeat_in_equilibrium_is_the_equilibrium_of_a_tile(monkeypatch: pytest.MonkeyPatch) -> None:
    """Repeats of a tile are alike, so the change of one repeat, added to each, balances at once: after the first check the
    residual is below the tolerance. Undisturbed, the level takes the checks that the drift criterion waits for."""
    monkeypatch.setattr("warpknit.spatial.convergence.Stability.begin", lambda self, world: None)
    changes = ("model.nodes_per_loop=32", "knit.repeats=[3, 2]", "load.strain_weft=0.1", "load.strain_warp=0.1")
    mechanics, drive, steps = solved(*changes)
    assert isinstance(drive, MultilevelRelaxation) and drive.smaller is not None
    assert steps == CHECK_STEPS * (mechanics.drift.required_checks + 1)
    tension, active = observed(mechanics)
    expected, share = observed(drive.smaller.mechanics)
    assert tension == pytest.approx(expected, rel=2 * TOLERANCE)
    assert active == pytest.approx(share)


@pytest.mark.parametrize("precision", [*slow("single"), "double"])
def test_start_from_a_smaller_mesh_gives_the_same_answer_in_fewer_steps(precision: str) -> None:
    """12 x 3 repeats with a start from 8 x 3, against the same mesh from the knitted state, in double precision: tensions within
    what both may still drift."""
    mechanics, drive, steps = solved(STRIP, "model.boundary=gripped", f"solver.precision={precision}")
    assert isinstance(drive, MultilevelRelaxation)
    alone, _, many = solved(STRIP, "model.boundary=gripped", alone=True)
    (tension, active), (expected, share) = observed(mechanics), observed(alone)
    assert tension == pytest.approx(expected, rel=3 * TOLERANCE)
    assert active == pytest.approx(share, abs=1.0)
    assert steps < 0.75 * many


def test_a_run_says_which_smaller_mesh_it_solves() -> None:
    """While the start of a large mesh is made nothing of it is done: the display names the mesh that is solved."""
    simulation = Simulation(mesh(STRIP, "model.boundary=gripped", "load.strain_weft=0.01", "load.strain_warp=0.01"))
    said: list[str] = []

    class Done(Exception):
        pass

    def monitor(progress: Progress) -> None:
        said.append(simulation.solving)
        assert bool(simulation.solving) == (progress.checks == 0)
        if progress.checks:
            raise Done

    simulation.monitor = monitor
    with pytest.raises(Done):
        list(simulation.run())
    assert quantities(said[0]) == ["8", "3", "0 %"]
    assert said[-1] == ""


def test_notes_of_smaller_meshes_are_the_users_too() -> None:
    """A smaller mesh is tested for stability where the large one is not: what it tells is not lost."""
    simulation = Simulation(mesh(STRIP, "model.boundary=gripped"))
    assert isinstance(simulation.drive, MultilevelRelaxation) and simulation.drive.smaller is not None
    simulation.drive.smaller.mechanics.notes.append("an equilibrium was not stable")
    assert [quantities(note) for note in simulation.notes] == [["8", "3"]]


@pytest.mark.slow  # test_multilevel.py has it for the planar model
@pytest.mark.parametrize("stop_at", [20, 50])
def test_interrupted_start_continues_to_the_same_bits(stop_at: int) -> None:
    """A checkpoint in the smaller mesh or in the large one holds all that the rest of the run depends on."""
    model = mesh(STRIP, "model.boundary=gripped", "load.strain_weft=0.01", "load.strain_warp=0.01")

    class Stop(Exception):
        pass

    def run(stop_at: int | None, kept: dict | None) -> dict:
        state = initial_state(model)
        simulation = Simulation(model, state, progress=Progress.from_dict(kept["progress"]) if kept else None)
        simulation.compile()
        if kept:
            simulation.drive.load_state_dict(kept["solver"])
        checks = 0

        def monitor(_progress: Progress) -> None:
            nonlocal checks
            checks += 1
            if checks == stop_at:
                raise Stop

        simulation.monitor = monitor
        try:
            for _record in simulation.run():
                pass
        except Stop:
            pass
        about = json.loads(json.dumps(simulation.progress.as_dict()))
        return {"state": state.arrays(), "solver": simulation.drive.state_dict(), "progress": about, "checks": checks}

    expected = run(None, None)
    assert expected["checks"] > stop_at
    found = run(None, run(stop_at, None))
    for name, value in expected["state"].items():
        assert np.array_equal(value, found["state"][name]), name


def test_added_fields_are_read_back() -> None:
    """Displacements and turns of the sections are a description of the state: what is added is what is read, to round-off."""
    model = mesh("knit.repeats=[1, 1]")
    mechanics = mechanics_of(model, initial_state(model))
    assert isinstance(mechanics, SpatialMechanics)
    fields, rng = mechanics.fields, np.random.default_rng(3)
    before = fields.read()
    changes = {name: np.zeros(model.node_count) for name in before}
    smooth = np.sin(2 * np.pi * np.arange(model.node_count) / model.node_count)
    for name, size in {"x": 1e-6, "y": 1e-6, "z": 1e-6, "turn": 0.3}.items():
        changes[name] = size * rng.normal() * smooth
    fields.add(changes)
    after = fields.read()
    for name in ("x", "y", "z", "turn"):
        assert after[name] - before[name] == pytest.approx(changes[name], abs=1e-12)


def test_a_rigid_turn_of_the_sections_adds_no_twist() -> None:
    """Sections that turn by one angle along a closed wire are bent and twisted as before, about other directors: bending is
    that of a round section in its own frame, so the natural curvature turns along and only GJ (m - M) stays zero."""
    model = mesh("knit.repeats=[1, 1]")
    mechanics = mechanics_of(model, initial_state(model))
    assert isinstance(mechanics, SpatialMechanics)
    twist = mechanics.state.twist.numpy().copy()
    changes = {name: np.zeros(model.node_count) for name in mechanics.fields.read()}
    mechanics.fields.add(changes | {"turn": np.full(model.node_count, 0.2)})
    mechanics.stepper.evaluate()
    assert mechanics.state.twist.numpy() == pytest.approx(twist, abs=1e-12)


def test_no_change_moves_nothing() -> None:
    """A start from a smaller mesh that has not changed leaves the state, but for round-off of the frames."""
    model = mesh(STRIP, "model.boundary=gripped")
    drive = Simulation(model).drive
    assert isinstance(drive, MultilevelRelaxation) and drive.prolongation is not None and drive.cell is not None
    before = drive.state.displacement.numpy().copy(), drive.state.director.numpy().copy()
    drive.prolongation.carry(zero_response(drive.cell.mechanics, "cpu"))
    assert np.array_equal(drive.state.displacement.numpy(), before[0])
    assert drive.state.director.numpy() == pytest.approx(before[1], abs=1e-14)


def test_a_gripped_mesh_takes_the_place_of_the_smaller_one() -> None:
    """What a large mesh has come to by itself is gone once it starts a level from a smaller gripped mesh: contacts close where
    wires lie as on that mesh. Without that, the fields would differ by what was added to the large mesh alone."""
    fields = []
    for own in (0.0, 2e-6):
        model = mesh(STRIP, "model.boundary=gripped")
        drive = Simulation(model).drive
        assert isinstance(drive, MultilevelRelaxation) and drive.prolongation is not None and drive.cell is not None
        for relaxation, size in ((drive.smaller, 1e-6), (drive, own)):
            assert relaxation is not None and isinstance(relaxation.mechanics, SpatialMechanics)
            place = relaxation.model.rods.position[:, :2]
            wave = np.prod(np.sin(np.pi * (place - place.min(axis=0)) / np.ptp(place, axis=0)) ** 2, axis=1)  # 0 at the clamps
            panel = PanelNodes(relaxation.model).of_panel({"x": wave})["x"]
            none = dict.fromkeys(relaxation.mechanics.fields.read(), np.zeros(relaxation.model.panel.node_count))
            relaxation.mechanics.fields.add(none | {"x": size * panel, "z": size * panel})
        drive.prolongation.carry(zero_response(drive.cell.mechanics, "cpu"))
        assert isinstance(drive.mechanics, SpatialMechanics)
        fields.append(drive.mechanics.fields.read())
    without, with_own = fields
    assert np.abs(without["z"]).max() > 0.9e-6
    for name in ("x", "y", "z"):
        assert with_own[name] == pytest.approx(without[name], abs=5e-3 * 2e-6)  # cubics between nodes of panel and rods


@pytest.mark.slow
def test_wires_that_would_overlap_leave_the_large_mesh_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """A large mesh that cannot take the state of the smaller one has its own state at the new load, and says so;
    its level ends in the same equilibrium."""
    monkeypatch.setattr(transfer, "MAX_OVERLAP", -1.0)  # any state overlaps
    changes = (STRIP, "model.boundary=gripped", "load.strain_weft=0.03", "load.strain_warp=0.03")
    simulation = Simulation(mesh(*changes))
    drive = simulation.drive
    assert isinstance(drive, MultilevelRelaxation) and isinstance(drive.mechanics, SpatialMechanics)
    *_, last = simulation.run()
    assert not drive.progress.is_prolonged
    (note,) = simulation.notes
    assert quantities(note)[:2] == ["3.0 %", "3.0 %"]
    rows = with_work([row_of(last)], simulation.model)
    rows[-1] = with_sums(rows, simulation.model)
    took = {"wall": 1.0, "compile_time": 0.0, "steps": 1}
    summary = run_summary(simulation.model, rows, stop_reason="steady", notes=simulation.notes, **took)
    assert summary.solver.notes == [note]
    kept = drive.mechanics.fields.read()
    assert drive.smaller is not None and drive.prolongation is not None and isinstance(drive.smaller.mechanics, SpatialMechanics)
    nodes = drive.smaller.model.panel.node_count
    drive.smaller.mechanics.fields.add({"z": np.linspace(0.0, 1e-6, nodes)})
    assert not drive.prolongation.carry(drive._response)
    drive.prolongation.put_back()
    for name, value in drive.mechanics.fields.read().items():
        assert value == pytest.approx(kept[name], rel=1e-12, abs=1e-12 * np.abs(kept[name]).max()), name
    tension, active = observed(drive.mechanics)
    alone, _, _ = solved(*changes, alone=True)
    expected, share = observed(alone)
    assert tension == pytest.approx(expected, rel=3 * TOLERANCE)
    assert active == pytest.approx(share, abs=1.0)


def test_levels_of_a_tile_that_does_not_start_from_one_repeat_have_their_load(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(transfer, "MAX_OVERLAP", -1.0)  # any state overlaps
    simulation = Simulation(mesh("knit.repeats=[2, 1]", "load.strain_weft=0.01", "load.strain_warp=0.01"))
    *_, last = simulation.run()
    assert len(simulation.notes) == 1
    assert last.load_factor == simulation.progress.load_factor == 1.0
    assert np.diag(last.observables.gradient) == pytest.approx(1.01)


@pytest.mark.parametrize("of_segments", [False, True])
def test_cubics_along_wires_are_resampled_exactly(of_segments: bool) -> None:
    """Nodes of a clamped wire stand at begin + step k in nodes of the panel; interpolation by cubics is exact for cubics."""
    model = mesh("knit.repeats=[2, 2]", "model.boundary=gripped")
    nodes, wires, panel, rods = PanelNodes(model), model.wires, model.panel, model.rods
    assert wires.panel_begin is not None and wires.panel_step is not None
    half = 0.5 if of_segments else 0.0
    wire = np.repeat(np.arange(len(panel.wire_first)), panel.wire_count)
    there = np.arange(panel.node_count) - panel.wire_first[wire] + half
    place = wires.panel_begin[wire] + wires.panel_step[wire] * there

    def cubic(x: np.ndarray) -> np.ndarray:
        return 1.0 + 0.1 * x - 2e-3 * x**2 + 1e-5 * x**3

    name, along = "turn" if of_segments else "x", np.arange(rods.node_count) - rods.wire_first[rods.wire_of]
    found = nodes.of_panel({name: cubic(along + half)})[name]
    inside = (place >= half) & (place <= rods.wire_count[wire] - 1 - half)
    assert np.count_nonzero(inside) > 0.9 * len(inside)
    assert found[inside] == pytest.approx(cubic(place[inside]), rel=1e-9)


def test_gathered_forces_have_the_same_sum_and_moments() -> None:
    """Bilinear shape functions sum to one and reproduce places: sum R = sum f, sum R x = sum f x over the nodes not held."""
    model = mesh("knit.repeats=[4, 3]", "model.boundary=gripped")
    mechanics = mechanics_of(model, initial_state(model))
    assert isinstance(mechanics, SpatialMechanics)
    cells, low = np.array([3, 2]), model.panel.low - 1e-3
    cell = (np.array(model.panel.size) + 2e-3) / cells
    grid = mechanics.membrane_grid(low, cell, cells)
    rng = np.random.default_rng(1)
    force = rng.normal(size=(model.node_count, 3))
    mechanics.state.force.assign(force)
    gathered = grid.gather()
    force[(model.rods.held & int(HELD_NODE)) != 0] = 0.0
    place = low + cell * np.stack(np.meshgrid(*(np.arange(n + 1) for n in cells), indexing="ij"), axis=-1).reshape(-1, 2)
    assert gathered.sum(axis=0) == pytest.approx(force[:, :2].sum(axis=0), abs=1e-9)
    moments = np.einsum("ia,ib->ab", gathered, place)
    assert moments == pytest.approx(np.einsum("ia,ib->ab", force[:, :2], model.rods.position[:, :2]), abs=1e-12 + 1e-9)


@pytest.mark.parametrize("about", ["x", "y", "z"])
def test_a_rotation_of_the_grid_rotates_wires_rigidly(about: str) -> None:
    """Rotated by a small angle, an unstrained mesh carries forces of second order in it; of first order if wires bent or twisted.

    The held nodes at the edges stay, and strain the wires beside them.
    """
    model = mesh("knit.repeats=[4, 4]", "model.boundary=gripped")
    low, size = model.panel.low, np.array(model.panel.size)
    cells = np.array([3, 3])
    place = low + size / cells * np.stack(np.meshgrid(*(np.arange(4),) * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    place = place - low - 0.5 * size
    inside = np.all(np.abs(model.rods.position[:, :2] - low - 0.5 * size) < 0.25 * size, axis=1)

    def largest_force(angle: float) -> float:
        mechanics = mechanics_of(model, initial_state(model))
        assert isinstance(mechanics, SpatialMechanics)
        mechanics.contact.search()
        grid = mechanics.membrane_grid(low, size / cells, cells)
        if about == "z":
            grid.spread(angle * np.stack([-place[:, 1], place[:, 0]], axis=1), zero_response(mechanics, "cpu"))
        else:
            grid.spread_across(angle * (place[:, 1] if about == "x" else -place[:, 0]))
        return float(np.abs(mechanics.stepper.forces()[0][inside]).max())

    assert largest_force(1e-3) == pytest.approx(largest_force(2e-3) / 4.0, rel=0.1)


def test_repeated_corrections_that_overshoot_are_relaxed() -> None:
    """Aitken's factor is exact in one dimension: where a full correction takes off a times the error, the next factor is 1/a."""
    aitken, error = Aitken(), 1.0
    for _ in range(2):
        error -= aitken.next_factor(np.array([error]), 1.0) * 1.9 * error
    assert error == pytest.approx(0.0, abs=1e-15)
    aitken.begin()
    assert aitken.next_factor(np.array([1.0]), 0.3) == 0.3
    assert aitken.next_factor(np.array([2.0]), 0.3) == 0.3  # grown by more than the correction can have done


def test_a_mesh_on_cords_starts_from_one_repeat_in_space() -> None:
    """Its stations move with the mesh itself (spatial/clamps.py), in other places than those of a smaller mesh."""
    cords = ("panel.grip_pitch=5 mm", "panel.cord.tension=20 mN", "panel.cord.stiffness=10 N")
    model = mesh(STRIP, "model.boundary=gripped", *cords)
    drive = Simulation(model).drive
    assert isinstance(drive, MultilevelRelaxation) and drive.smaller is not None and drive.smaller.scene.knit.repeats == (1, 1)


def test_plan_says_from_which_mesh_a_run_starts() -> None:
    """A mesh whose edge moves starts from one repeat."""
    cords = ("panel.grip_pitch=5 mm", "panel.cord.tension=20 mN", "panel.cord.stiffness=10 N")

    def starts(*changes: str) -> list[str]:
        return [
            line for line in overview_of(load_scene(CELL, [*SCENE, *changes]), "cpu").physics if line.startswith("multilevel")
        ]

    assert "8 x 3 repeats" in starts(STRIP, "model.boundary=gripped")[0]
    assert "1 x 1 repeats" in starts("knit.repeats=[3, 2]")[0]
    assert "1 x 1 repeats" in starts(STRIP, "model.boundary=gripped", *cords)[0] and not starts("knit.repeats=[1, 1]")


def test_corrections_move_no_further_than_their_imbalance_is_worth(monkeypatch: pytest.MonkeyPatch) -> None:
    """A correction that moves far for an imbalance within its tolerance is a soft mode and is left alone (it pushed wires
    of a gripped tricot into each other); one of three tolerances is applied in three parts, three times as far as the mesh may
    move at once."""
    drive = Simulation(mesh(STRIP, "model.boundary=gripped")).drive
    assert isinstance(drive, MultilevelRelaxation) and drive.membrane is not None
    membrane, share, moved = drive.membrane, 0.1, []
    drive._begin_solving(1.0)
    grid = np.ones((int(np.prod(membrane._cells + 1)), 2))
    monkeypatch.setattr(membrane, "move", lambda correction: moved.append(correction.grid[0, 0]))
    monkeypatch.setattr(drive, "advance", lambda steps: None)
    for tolerances, parts in ((0.5, 0), (3.0, 3)):
        stress = tolerances * MEMBRANE_TOLERANCE * drive.equilibrium.convergence.least_tension
        correction = Correction(grid, np.zeros((0, 2)), share), stress
        monkeypatch.setattr(
            membrane, "solve", lambda *edge, whole=correction: (whole[0].scaled(([1.0, *edge[1:]])[-1]), whole[1])
        )
        drive._correct_as_membrane(membrane, 10.0)
        assert drive.progress.imbalance == pytest.approx(tolerances)
        assert moved == pytest.approx(parts * [share])


def test_a_large_panel_on_cords_is_corrected_as_a_membrane(monkeypatch: pytest.MonkeyPatch) -> None:
    """One repeat is its start, and gives the stiffness. The equilibrium is the one without that start. Against the cords
    alone, which are softer than cords and mesh, the forces left would move a station by no more than a hundredth of the sag, or
    across the mesh by a tenth of the thickness."""
    panel = ("model.boundary=gripped", "panel.outline=hexagon", "panel.size=12 mm", "contact.friction=0", "panel.grip_pitch=6 mm")
    panel = (*panel, "model.nodes_per_loop=16")
    changes = (*panel, 'panel.cord={tension="50 mN", stiffness="50 N"}', "solver.residual_tolerance=0.01")
    mechanics, drive, _ = solved(*changes)
    assert isinstance(drive, MultilevelRelaxation) and drive.smaller is not None and drive.membrane is not None
    monkeypatch.setattr("warpknit.solve.simulate.smaller_scene", lambda _: None)
    alone, other, _ = solved(*changes, "output.usd=false")
    assert isinstance(other, MultilevelRelaxation) and other.smaller is None
    assert drive.membrane.tangent.any() and drive.rim is mechanics.rim and mechanics.edge is not None
    assert drive.progress.imbalance <= 1.0
    edge, seen, free = mechanics.edge, mechanics.observe(), ~mechanics.edge.rim.given
    carried = edge.rim.clamps.T @ edge.grip_forces(seen.force)
    left = edge.rim.cord_forces(seen.gradient, edge.station_displacement)[0] - carried
    moves = np.repeat(free, 3)
    stiffness = edge.rim.cord_stiffness(seen.gradient, edge.station_displacement).toarray()[np.ix_(moves, moves)]
    away = np.linalg.solve(stiffness, left[free].ravel()).reshape(-1, 3)
    assert np.abs(away[:, :2]).max() <= 0.01 * np.abs(edge.station_displacement[:, :2]).max()
    assert np.abs(away[:, 2]).max() <= 0.1 * mechanics.model.scene.wire.thickness
    (tension, active), (expected, share) = observed(mechanics), observed(alone)
    assert tension == pytest.approx(expected, rel=MEMBRANE_TOLERANCE)
    assert active == pytest.approx(share, abs=2.0)
    assert mechanics.stations == pytest.approx(alone.stations, abs=0.05 * np.abs(alone.stations).max())
