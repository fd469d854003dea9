"""Rods in space that ranks share in strips go the way they go on one rank, bit by bit.

Here the ranks are threads; see test_mpi.py.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from reference.cases import slow
from reference.thread_ranks import run_ranks
from warpknit import measure
from warpknit.base.errors import Diverged, ModelError, SceneError
from warpknit.compute.host import fetch, store
from warpknit.compute.ranks import Ranks
from warpknit.mesh.rim import LoadPoint
from warpknit.scene import Scene, load_scene
from warpknit.solve import simulate
from warpknit.solve.membrane import Correction
from warpknit.solve.model import build_model, initial_state
from warpknit.solve.relax import Relaxation
from warpknit.solve.simulate import Simulation
from warpknit.spatial.model import BORDER
from warpknit.spatial.observables import SpatialObservables
from warpknit.spatial.pair_search import search_cells
from warpknit.spatial.strip import cut_rods

SCENES = Path(__file__).parents[1] / "scenes"
KNITS = {
    "double atlas": [
        {"chain": "1-0/1-2/2-3/2-1", "threading": "|."},
        {"chain": "2-3/2-1/1-0/1-2", "threading": "|.", "shift": 1},
    ],
    "tricot": [{"chain": "1-0/1-2"}, {"chain": "1-2/1-0"}],
    "single atlas": [{"chain": "1-0/1-2/2-3/2-1"}],
    "reverse locknit": [{"chain": "1-0/1-2"}, {"chain": "2-3/1-0"}],
}
ARRAYS = ("position", "director", "segment_tangent", "tension", "moment", "twist_change", "segment_force", "force", "chord",
          "pair_force", "body_near", "elsewhere_position", "elsewhere_force", "elsewhere_wires")  # fmt: skip
OF_CONTACTS = ("first", "second", "place", "shift", "force", "friction", "normal", "overlap")


def scene(knit: str, repeats: list[int], boundary: str, strain: float = 0.04, **tables: dict) -> Scene:
    table = {
        "wire": {"material": "tungsten", "diameter": 15e-6},
        "knit": {"bars": KNITS[knit], "wales": "26 /inch", "courses": "40 /inch", "repeats": repeats},
        "model": {"kind": "spatial", "boundary": boundary},
        "contact": {"friction": 0.0},
        "variants": {"count": 1},
        "load": {"strain_weft": strain, "strain_warp": strain},
        "solver": {"preset": "draft"},
        "output": {"frames": 1},
    }
    for name, keys in tables.items():
        table[name] = table.get(name, {}) | keys
    return load_scene(table)


def last_reading(here: Scene, ranks: Ranks) -> tuple[SpatialObservables, int, np.ndarray, float]:
    """The reading at the end of a run, its steps, the control numbers of this rank, and what was dissipated."""
    model = build_model(here, "cpu", ranks)
    state = initial_state(model)
    simulation = Simulation(model, state)
    *_, last = simulation.run()
    return last.observables, last.steps, state.steering.values.copy(), simulation.mechanics.dissipated


def assert_same_bits(shared: SpatialObservables, alone: SpatialObservables) -> None:
    for name in ARRAYS:
        assert np.array_equal(getattr(shared, name), getattr(alone, name)), name
    for contacts in ("touching", "near"):
        for name in OF_CONTACTS:
            assert np.array_equal(getattr(getattr(shared, contacts), name), getattr(getattr(alone, contacts), name)), name
    for name in ("bend_energy", "stretch_energy", "contact_energy", "contact_growth", "penetration"):
        assert getattr(shared, name) == getattr(alone, name), name
    assert np.array_equal(shared.nominal_stress, alone.nominal_stress)


# --- how a mesh is cut


class Rank(Ranks):
    """One of several ranks, which only says so."""

    def __init__(self, rank: int, count: int) -> None:
        self.rank, self.count = rank, count


@pytest.mark.parametrize("ranks", [2, 3])
@pytest.mark.parametrize("boundary", ["gripped", "periodic"])
def test_strips_are_the_mesh(boundary: str, ranks: int) -> None:
    """Every wire is stepped by one rank; what one sends another receives; all wires that touch own ones are there."""
    model = build_model(scene("single atlas", [16, 1], boundary))
    rods = model.rods
    reach = search_cells(rods, model.curve).radius + BORDER * model.scene.knit.wale_spacing
    strips = [cut_rods(model.panel, rods, Rank(rank, ranks), reach) for rank in range(ranks)]
    own = [s.wire[s.wires.start : s.wires.stop] for s in strips]
    assert np.array_equal(np.concatenate(own), np.arange(len(rods.wire_first)))
    assert np.array_equal(np.concatenate([s.nodes_of_mesh[s.own] for s in strips]), np.arange(rods.node_count))
    assert any(len(s.wire) < len(rods.wire_first) for s in strips)
    for s in strips:
        assert all(a < b for a, b in pairwise(s.wire.tolist()))
        copies = np.setdiff1d(np.arange(len(s.wire)), np.arange(s.wires.start, s.wires.stop))
        assert np.array_equal(np.sort(np.concatenate([n.received for n in s.neighbours])), copies)
        for n in s.neighbours:
            (back,) = [m for m in strips[n.rank].neighbours if m.rank == s.ranks.rank]
            assert np.array_equal(s.wire[n.sent], strips[n.rank].wire[back.received])
    simulation = Simulation(model)
    simulation.mechanics.search()
    pairs = simulation.mechanics.contact.pairs
    first, second = (
        rods.wire_of[fetch(nodes)[: simulation.mechanics.contact.pair_count]] for nodes in (pairs.pair_first, pairs.pair_second)
    )
    for s, wires in zip(strips, own, strict=True):
        touched = np.concatenate([second[np.isin(first, wires)], first[np.isin(second, wires)]])
        assert np.isin(touched, s.wire).all()


def test_wires_that_come_past_the_border_are_noticed() -> None:
    """A wire that is no copy here moves next to own ones."""

    def search(ranks: Ranks) -> str:
        model = build_model(scene("single atlas", [16, 1], "gripped"), "cpu", ranks)
        mechanics = Simulation(model).mechanics
        mechanics.contact.search()
        if not ranks.is_first:
            moved = fetch(mechanics.state.displacement).copy()
            moved[:, 0] -= 0.5 * model.panel.size[0]
            store(mechanics.state.displacement, moved)
        try:
            mechanics.contact.search()
        except ModelError as error:
            return str(error)
        return ""

    for said in run_ranks(2, search):
        assert said


@pytest.mark.parametrize("nodes", [8, *slow(20)])
@pytest.mark.parametrize("knit", KNITS)
def test_wide_meshes_have_wires_that_are_no_copies(knit: str, nodes: int) -> None:
    """However far the search of pairs reaches, as knitted no wire is missed."""

    def held(ranks: Ranks) -> tuple[int, int]:
        model = build_model(scene(knit, [24, 1], "gripped", model={"nodes_per_loop": nodes}), "cpu", ranks)
        Simulation(model).mechanics.contact.search()
        return len(model.rods.wire_first), len(model.global_model.rods.wire_first)

    assert all(here < whole for here, whole in run_ranks(2, held))


def test_a_ramp_in_space_is_refused_on_ranks() -> None:
    with pytest.raises(SceneError, match="solver.drive: 'ramp' .* model.kind = 'spatial'"):
        build_model(scene("tricot", [4, 2], "gripped", solver={"drive": "ramp"}), "cpu", Rank(0, 2))


# --- how it moves


@pytest.mark.parametrize(
    ("knit", "repeats", "boundary", "ranks"),
    [
        *slow(
            ("double atlas", [3, 2], "gripped", 3),
            ("double atlas", [4, 1], "periodic", 2),
            ("tricot", [6, 2], "periodic", 2),
            ("reverse locknit", [5, 2], "periodic", 3),
        ),
        ("tricot", [1, 1], "periodic", 2),  # both wires on both ranks
        ("single atlas", [6, 2], "gripped", 2),
    ],
)
def test_strips_converge_like_the_whole_mesh(knit: str, repeats: list[int], boundary: str, ranks: int) -> None:
    """The same steps and the same bits; on all ranks the same decisions, but for the last bits of sums of a step."""
    here = scene(knit, repeats, boundary, 0.1 if knit == "double atlas" else 0.07 if knit == "tricot" else 0.05)
    alone, steps, *_ = last_reading(here, Ranks())
    results = run_ranks(ranks, lambda r: last_reading(here, r))
    assert [taken for _, taken, *_ in results] == ranks * [steps]
    assert all(np.array_equal(control, results[0][2]) for _, _, control, _ in results)
    assert len(alone.touching.force) > 0
    assert_same_bits(results[0][0], alone)


@pytest.mark.slow
def test_strips_in_single_precision_with_two_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WARPKNIT_THREADS", "2")
    here = scene("tricot", [6, 3], "gripped", solver={"precision": "single"})
    alone, steps, *_ = last_reading(here, Ranks())
    (shared, taken, *_), _ = run_ranks(2, lambda r: last_reading(here, r))
    assert taken == steps
    assert_same_bits(shared, alone)


@pytest.mark.slow
def test_strips_driven_by_tension_find_the_same_strain() -> None:
    load = {"strain_weft": None, "strain_warp": None, "tension_weft": 0.5, "tension_warp": 0.5}
    here = scene("tricot", [4, 2], "periodic")
    here = here.changed([f"load={ {k: v for k, v in load.items() if v is not None} }".replace("'", "").replace(":", "=")])
    alone, steps, *_ = last_reading(here, Ranks())
    (shared, taken, *_), _ = run_ranks(2, lambda r: last_reading(here, r))
    assert taken == steps
    assert_same_bits(shared, alone)


def test_strips_remember_friction_and_yield() -> None:
    """Where contacts stick and how wires have yielded: the same bits, and the heat of both added up over the strips."""
    tables = {"contact": {"friction": 0.3}, "wire": {"plastic": True, "yield_stress": 2e8}, "model": {"nodes_per_loop": 14}}
    here = scene("tricot", [4, 2], "gripped", 0.03, **tables)
    alone, steps, _, heat = last_reading(here, Ranks())
    (shared, taken, _, shared_heat), _ = run_ranks(2, lambda r: last_reading(here, r))
    assert taken == steps and heat > 0.0 and np.any(alone.plastic_curvature != 0.0) and np.any(alone.touching.friction != 0.0)
    assert_same_bits(shared, alone)
    assert np.array_equal(shared.plastic_curvature, alone.plastic_curvature)
    assert shared_heat == pytest.approx(heat, rel=1e-12, abs=0)


@pytest.mark.slow
def test_strips_in_a_temperature_field() -> None:
    here = scene("single atlas", [6, 2], "gripped", load={"temperature": 330.0, "temperature_gradient": [800.0, 0.0]})
    alone, *_ = last_reading(here, Ranks())
    (shared, *_), _ = run_ranks(2, lambda r: last_reading(here, r))
    assert np.any(alone.thermal_strain != 0.0) and np.array_equal(shared.thermal_strain, alone.thermal_strain)
    assert_same_bits(shared, alone)


def test_strips_are_one_membrane() -> None:
    """The forces that strips gather on the grid add up to those of the whole mesh, and a displacement of the grid moves both
    alike, copies included."""
    here = scene("double atlas", [10, 10], "gripped", model={"nodes_per_loop": 14})

    def gathered_and_moved(ranks: Ranks) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        model = build_model(here, "cpu", ranks)
        drive = Simulation(model, initial_state(model)).drive
        drive.mechanics.search()
        drive.mechanics.set_load(LoadPoint(np.diag([1.01, 1.01]), model.scene.wire.reference_temperature), 75)
        drive.advance(75)
        drive.mechanics.group.check(np.array([0]), np.array([3]), np.array([False]))
        drive.membrane.warm_up(drive._response)
        force = drive.membrane.imbalance().copy()
        drive.membrane.move(Correction(1e-6 * np.random.default_rng(3).normal(size=force.shape), np.zeros((0, 2))))
        place = fetch(drive.state.displacement).copy()
        return force, place, np.arange(len(place)) if model.strip is None else model.strip.nodes_of_mesh

    force, place, _ = gathered_and_moved(Ranks())
    assert np.abs(force).max() > 0.0
    for shared, moved, nodes in run_ranks(2, gathered_and_moved):
        assert np.array_equal(shared, force)
        assert np.array_equal(moved, place[nodes])


@pytest.mark.slow
@pytest.mark.parametrize("least", [100, 1_000_000])
def test_large_strips_start_from_a_smaller_mesh_and_move_as_a_membrane(least: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """12 x 12 repeats, and the smaller mesh shared too, or every rank has it to itself."""
    monkeypatch.setattr(simulate, "NODES_A_STRIP", least)
    here = scene("double atlas", [12, 12], "gripped", 0.1, model={"nodes_per_loop": 20})
    alone, steps, *_ = last_reading(here, Ranks())
    (shared, taken, *_), _ = run_ranks(2, lambda r: last_reading(here, r))
    assert taken == steps
    assert_same_bits(shared, alone)
    assert measure.mesh_tension(shared) == measure.mesh_tension(alone)


@pytest.mark.slow
def test_large_strips_under_a_tension_begin_at_the_same_strain(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is expected from the smaller mesh, which is shared, and from one repeat, which every rank has to itself."""
    monkeypatch.setattr(simulate, "NODES_A_STRIP", 100)
    here = scene("reverse locknit", [13, 13], "gripped", model={"nodes_per_loop": 20})
    here = here.changed(["load={tension_weft=0.05, tension_warp=0.05}"])
    alone, steps, *_ = last_reading(here, Ranks())
    (shared, taken, *_), _ = run_ranks(2, lambda r: last_reading(here, r))
    assert taken == steps
    assert_same_bits(shared, alone)


def test_all_ranks_say_which_wires_overlap() -> None:
    """The first finds them in the mesh of all."""

    def text(ranks: Ranks) -> str:
        model = build_model(scene("tricot", [6, 2], "gripped"), "cpu", ranks)
        mechanics = Simulation(model).mechanics
        mechanics.search()
        moved = fetch(mechanics.state.displacement).copy()
        moved[:, 2] = -0.6 * model.rods.position[:, 2]  # flattened
        store(mechanics.state.displacement, moved)
        mechanics.contact.search()
        return mechanics.deepest_overlap()

    alone = text(Ranks())
    assert alone
    assert run_ranks(2, text) == [alone, alone]


@pytest.mark.slow
def test_a_level_that_fails_is_reached_in_smaller_increments_by_all_ranks(monkeypatch: pytest.MonkeyPatch) -> None:
    """As on one rank, to the bit: 4 % fail, then 2 % do not."""
    corrected = Relaxation.corrected

    def refused(self: Relaxation, ratio: float) -> float:
        moved = 0.0 if self._last_gradient is None else float(np.abs(self.state.gradient.ravel() - self._last_gradient).max())
        if moved > 0.03:
            raise Diverged("too far at once")
        return corrected(self, ratio)

    monkeypatch.setattr(Relaxation, "corrected", refused)
    here = scene("tricot", [4, 2], "gripped")
    alone, steps, *_ = last_reading(here, Ranks())
    (shared, taken, *_), _ = run_ranks(2, lambda r: last_reading(here, r))
    assert taken == steps
    assert_same_bits(shared, alone)


@pytest.mark.slow
def test_forces_on_the_nodes_of_the_mesh() -> None:
    """Given for the mesh of all ranks, on each of them: the middle is lifted."""

    def lifted(ranks: Ranks) -> SpatialObservables:
        model = build_model(scene("tricot", [4, 2], "gripped"), "cpu", ranks)
        simulation = Simulation(model)
        node = model.global_model.rods.position
        simulation.set_force(np.where(np.abs(node[:, :1]) < 0.2 * np.ptp(node[:, 0]), [0.0, 0.0, 1e-8], 0.0))
        *_, last = simulation.run()
        return last.observables

    alone = lifted(Ranks())
    assert_same_bits(run_ranks(2, lifted)[0], alone)
