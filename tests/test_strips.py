"""A mesh that ranks share in strips goes the way it goes on one rank, bit by bit. Here the ranks are threads; see test_mpi.py."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from reference.planar import planar_scene
from reference.thread_ranks import run_ranks
from warpknit import measure
from warpknit.base.errors import ModelError
from warpknit.compute.ranks import Ranks
from warpknit.mesh.panel import Panel
from warpknit.mesh.rim import LoadPoint
from warpknit.mesh.strip import Strip, cut_strip
from warpknit.planar.host_state import friction_energy
from warpknit.planar.observables import PlanarObservables, read
from warpknit.planar.state import initial_state
from warpknit.planar.world_step import WorldStepper
from warpknit.scene import Scene, load_scene
from warpknit.solve import simulate
from warpknit.solve.membrane import Correction
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation

CELL = Path(__file__).parents[1] / "scenes" / "atlas_cell.toml"
STRAIN = ("load.strain_weft=0.1", "load.strain_warp=0.1", "output.frames=1")
PER_MESH = ("u", "body_u", "edge", "tension", "turning", "wire_axial", "pair_force", "pair_offset", "pair_gap", "pair_node",
            "pair_slide", "pair_u", "pair_nodal")  # fmt: skip


def scene(repeats: list[int], boundary: str, *overrides: str) -> Scene:
    mesh = (f"knit.repeats={repeats}", f"model.boundary={boundary}", "solver.preset=draft")
    return load_scene(CELL, [*mesh, *(overrides or STRAIN)])


def panel(repeats: list[int], boundary: str) -> Panel:
    return build_model(scene(repeats, boundary)).panel


def last_reading(scene: Scene, ranks: Ranks) -> tuple[PlanarObservables, int, np.ndarray]:
    """The reading at the end of a run, its steps, and the control numbers of this rank."""
    model = build_model(scene, "cpu", ranks)
    state = initial_state(model)
    *_, last = Simulation(model, state).run()
    return last.observables, last.steps, state.steering.values.copy()


def assert_same_bits(shared: PlanarObservables, alone: PlanarObservables) -> None:
    for name in PER_MESH:
        assert np.array_equal(getattr(shared, name), getattr(alone, name)), name


# --- how a mesh is cut


@pytest.mark.parametrize("ranks", [2, 3, 5])
@pytest.mark.parametrize("boundary", ["gripped", "periodic"])
def test_strips_are_the_mesh(boundary: str, ranks: int) -> None:
    """Every wire, node and pair is in one strip, every body is spoken for once, both sides of a border list the same bodies."""
    whole = panel([6, 3], boundary)
    strips = [cut_strip(whole, rank, ranks) for rank in range(ranks)]
    assert [s.wires.start for s in strips[1:]] == [s.wires.stop for s in strips[:-1]]
    assert strips[0].nodes.start == 0 and strips[-1].nodes.stop == whole.node_count
    for counted, total in (
        ([s.body[: s.owned_bodies] for s in strips], whole.body_count),
        ([s.pair_of_whole for s in strips], 2 * whole.body_count),
    ):
        assert np.array_equal(np.sort(np.concatenate(counted)), np.arange(total))
    for name in ("wire_thread", "block_table", "held_lever", "clamp_position"):
        joined = np.concatenate([getattr(s.panel, name) for s in strips])
        assert np.array_equal(joined, getattr(whole, name)), name
    for rank, s in enumerate(strips):
        assert np.all((s.panel.pair_wire >= 0) == np.isin(np.arange(2 * len(s.body)), s.pair))
        assert np.array_equal(s.panel.pair_seed[s.pair] + s.nodes.start, whole.pair_seed[s.pair_of_whole])
        for n in s.neighbours:
            (back,) = [m for m in strips[n.rank].neighbours if m.rank == rank]
            assert np.array_equal(whole_pair(s, n.own_pair), whole_pair(strips[n.rank], back.foreign_pair))
    # a strip is a whole number of wires: no further from an equal share than one wire
    nodes = [s.nodes.stop - s.nodes.start for s in strips]
    assert max(nodes) - min(nodes) <= 2 * whole.wire_count.max()


def whole_pair(strip: Strip, pair: np.ndarray) -> np.ndarray:
    return 2 * strip.body[pair // 2] + pair % 2


def test_more_ranks_than_wires_are_refused() -> None:
    with pytest.raises(ModelError, match=r"knit.repeats: 2 wires .* 3 ranks"):
        cut_strip(panel([1, 1], "periodic"), 0, 3)


# --- how it moves


@pytest.mark.parametrize(
    ("repeats", "boundary", "ranks"),
    [([3, 2], "gripped", 3), ([4, 2], "periodic", 3), ([1, 1], "periodic", 2)],
)
def test_strips_come_to_rest_like_the_whole_mesh(repeats: list[int], boundary: str, ranks: int) -> None:
    """Loaded to 10 % both ways and brought to rest: the same steps and the same bits, on all ranks the same decisions. The 4 x 2
    tile starts from one repeat; one repeat has two wires, which hook only each other and themselves round the tile."""
    here = scene(repeats, boundary)
    alone, steps, _ = last_reading(here, Ranks())
    results = run_ranks(ranks, lambda r: last_reading(here, r))
    assert [taken for _, taken, _ in results] == ranks * [steps]
    assert all(np.array_equal(control, results[0][2]) for _, _, control in results)
    assert_same_bits(results[0][0], alone)


def test_strips_are_one_membrane() -> None:
    """The forces that strips gather on the grid add up to those of the whole mesh, and a displacement of the grid moves both
    alike: the copies of a shared body too, which are not told of it."""
    here = scene([10, 10], "gripped")

    def gathered_and_moved(ranks: Ranks) -> tuple[np.ndarray, PlanarObservables, list]:
        model = build_model(here, "cpu", ranks)
        state = initial_state(model)
        drive = Simulation(model, state).drive
        drive.mechanics.set_load(LoadPoint(np.diag([1.05, 1.05]), model.scene.wire.reference_temperature), 80)
        drive.advance(100)
        drive.mechanics.group.slowest_mode.measure(np.array([0]))
        drive.membrane.warm_up(drive._response)
        force = drive.membrane.imbalance().copy()
        drive.membrane.move(Correction(1e-6 * np.random.default_rng(3).normal(size=force.shape), np.zeros((0, 2))))
        body = np.arange(model.panel.body_count) if model.strip is None else model.strip.body
        return force, read(model, state), [body, state.body_ux.numpy().copy()]

    force, alone, (_, body_ux) = gathered_and_moved(Ranks())
    results = run_ranks(2, gathered_and_moved)
    scale = np.abs(force).max()
    assert scale > 0.0
    for shared, _, (body, ux) in results:
        assert np.abs(shared - force).max() < 1e-12 * scale
        assert np.array_equal(ux, body_ux[body])
    assert np.array_equal(results[0][1].u, alone.u)


@pytest.mark.slow
@pytest.mark.parametrize("least", [100, 1_000_000])
def test_large_strips_start_from_a_smaller_mesh_and_move_as_a_membrane(least: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """14 x 14 repeats: as above, but the forces on the membrane's grid are added in another order, which may show in the last
    count of a displacement. It did not in this case."""
    monkeypatch.setattr(simulate, "NODES_A_STRIP", least)  # the smaller mesh is shared, too, or every rank has it to itself
    here = scene([14, 14], "gripped")
    alone, steps, _ = last_reading(here, Ranks())
    (shared, taken, _), _ = run_ranks(2, lambda r: last_reading(here, r))
    assert taken == steps
    assert np.abs(shared.u - alone.u).max() <= 1e-4 * np.abs(alone.u).max()
    assert measure.mesh_tension(shared) == pytest.approx(measure.mesh_tension(alone), rel=1e-4, abs=0)


def test_strips_driven_by_tension_find_the_same_strain() -> None:
    """The first rank measures the tension and tells the others; its sums over the whole mesh are those of one rank."""
    here = scene([2, 2], "periodic", 'load.tension_weft="0.01 N/m"', 'load.tension_warp="0.01 N/m"', "output.frames=1")
    alone, steps, _ = last_reading(here, Ranks())
    (shared, taken, _), _ = run_ranks(2, lambda r: last_reading(here, r))
    assert taken == steps
    assert_same_bits(shared, alone)


SIDES = ("weft", "warp")


def test_strips_remember_friction_and_yield() -> None:
    """Where contacts stick and how wires have yielded: the same bits, and the heat of both added up over the strips."""
    path = ("contact.friction=0.3", "wire.plastic=true", "wire.yield_stress=2e8", *(f"load.strain_{side}=0.05" for side in SIDES))
    here = scene([2, 2], "gripped", *path, "output.frames=1")

    def at_the_end(ranks: Ranks) -> tuple[PlanarObservables, float]:
        model = build_model(here, "cpu", ranks)
        simulation = Simulation(model, initial_state(model))
        *_, last = simulation.run()
        return last.observables, simulation.mechanics.history.dissipated

    alone, heat = at_the_end(Ranks())
    (shared, shared_heat), _ = run_ranks(2, at_the_end)
    assert heat > 0.0 and np.any(alone.plastic_turn != 0.0)
    assert_same_bits(shared, alone)
    assert np.array_equal(shared.plastic_turn, alone.plastic_turn)
    assert np.array_equal(shared.pair_stuck, alone.pair_stuck) and friction_energy(alone) > 0.0
    assert shared_heat == pytest.approx(heat, rel=1e-12, abs=0)


def test_strips_of_a_panel_on_cords() -> None:
    """A hexagon on elastic cords, warmer on one side: the pulls of the wires of all strips at the stations of the rim are added
    in another order than on one rank, so the clamps stand where they do there but for the last bits."""
    facet = {"outline": "hexagon", "size": 0.015, "grip_pitch": 0.0075, "cord": {"tension": 0.5, "stiffness": 50.0}}
    load = {"strain_weft": 0.05, "strain_warp": 0.05, "temperature": 330.0, "temperature_gradient": [800.0, 0.0]}
    here = planar_scene({"panel": facet, "load": load, "solver": {"preset": "draft"}, "output": {"frames": 1}})
    alone, steps, _ = last_reading(here, Ranks())
    (shared, taken, _), _ = run_ranks(2, lambda r: last_reading(here, r))
    assert taken == steps
    assert np.abs(alone.clamp_shift).max() > 0.0
    assert np.abs(shared.clamp_shift - alone.clamp_shift).max() < 1e-9 * np.abs(alone.clamp_shift).max()
    assert np.abs(shared.u - alone.u).max() < 1e-6 * np.abs(alone.u).max()
    assert np.array_equal(shared.thermal_strain, alone.thermal_strain)


def test_strips_ramp_like_the_whole_mesh() -> None:
    """Real time: step, work and steadiness come from sums over all strips."""
    ramp = ("solver.drive=ramp", 'solver.loading_time="0.2 ms"', "solver.damping=30000", "solver.residual_tolerance=0.05")
    here = scene([2, 2], "gripped", *STRAIN, *ramp)
    alone, steps, _ = last_reading(here, Ranks())
    (shared, taken, _), _ = run_ranks(2, lambda r: last_reading(here, r))
    assert taken == steps
    assert_same_bits(shared, alone)


@pytest.mark.parametrize(("precision", "threads", "by_pair"), [("single", 2, False), ("double", 1, False), ("single", 1, True)])
def test_threads_and_kernels_of_strips(precision: str, threads: int, by_pair: bool) -> None:
    """150 steps of a tile under load, in strips of one and two threads and with the kernels of a GPU."""
    here = scene([4, 2], "periodic", *STRAIN, f"solver.precision={precision}")

    def displacements(ranks: Ranks) -> np.ndarray:
        model = build_model(here, "cpu", ranks)
        state = initial_state(model)
        drive = Simulation(model, state).drive
        drive.mechanics.group.stepper = WorldStepper(model, state=state, by_pair=by_pair, threads=threads)
        drive.mechanics.set_load(LoadPoint(np.diag([1.1, 1.1]), model.scene.wire.reference_temperature), 100)
        drive.advance(150)
        reading = read(model, state)
        if ranks.is_first:
            assert np.count_nonzero(reading.pair_force) > 0
        return reading.u

    alone = displacements(Ranks())
    assert np.array_equal(run_ranks(2, displacements)[0], alone)


# --- sums


@given(st.lists(st.floats(-1e6, 1e6, allow_subnormal=False), min_size=1, max_size=40), st.integers(0, 40))
def test_exact_sums_do_not_depend_on_who_adds(values: list[float], cut: int) -> None:
    """Ranks with two parts of a list find the rounded sum of all values, wherever the list is cut."""

    class Two(Ranks):
        def everyone(self, value):
            return [values_of(values[:cut]), values_of(values[cut:])]

    assert Two().exact_sum(values_of(values[:cut]))[0] == math.fsum(values)
    assert Ranks().exact_sum(values_of(values))[0] == math.fsum(values)


def values_of(numbers: list[float]) -> np.ndarray:
    return np.array(numbers).reshape(-1, 1)


def test_a_number_that_is_not_finite_shows_in_the_sum() -> None:
    assert math.isnan(Ranks().exact_sum(np.array([[1.0], [math.inf], [-math.inf]]))[0])


def test_an_error_of_the_first_rank_is_raised_on_all() -> None:
    def fail(ranks: Ranks) -> str:
        try:
            ranks.from_first(lambda: 1 / 0)
        except ZeroDivisionError as error:
            return str(error)
        return ""

    assert run_ranks(2, fail) == ["division by zero"] * 2
