"""`output.frames = "auto"`: load levels are added where something happens, and answers are read off them."""

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from reference.interrupted import assert_parts_are_the_whole
from warpknit import Simulation, build_model, load_scene, measure
from warpknit.base.errors import Diverged, InputError
from warpknit.knit.named import NAMED_KNITS
from warpknit.measure import class_median_force, classes_of
from warpknit.measure.jumps import Level, happens
from warpknit.measure.strain import EdgeWork
from warpknit.scene import Scene, make_scene
from warpknit.solve.equilibrium import Equilibrium
from warpknit.solve.relax import FEWEST_LEVELS, Relaxation, Target

NEAR = 0.02  # of the load: output.load_tolerance


def knit_scene(name: str, **tables: dict[str, object]) -> Scene:
    knit = NAMED_KNITS[name]
    bars = [{"chain": bar.chain, "threading": bar.threading, "shift": bar.shift} for bar in knit.bars]
    scene = {
        "wire": {"material": "molybdenum", "diameter": "30 um"},
        "knit": {"bars": bars, "wales": f"{knit.wales} /inch", "courses": f"{knit.courses} /inch"},
        "model": {"boundary": "periodic"},
        "contact": {"friction": 0.0},
        "variants": {"count": 1},
        "load": {"strain_weft": 0.01 * knit.strain, "strain_warp": 0.01 * knit.strain},
        "output": {"usd": False, "figures": False},
    }
    return make_scene({**scene, **{key: scene.get(key, {}) | table for key, table in tables.items()}}, preset="draft")


def closings(scene: Scene) -> tuple[dict[str, tuple[float, float]], int]:
    """The load factors of the records between which each class last closes, and the number of records."""
    model = build_model(scene)
    threshold = measure.active_threshold(model)
    shares: list[float] = []
    closed: dict[str, list[bool]] = {name: [] for name in classes_of(model)}
    for record in Simulation(model).run():
        shares.append(record.load_factor)
        for name, series in closed.items():
            series.append((class_median_force(record.observables, name) or 0.0) > threshold)
    found = {}
    for name, series in closed.items():
        last = [k for k, (before, after) in enumerate(pairwise(series)) if after and not before]
        if series[-1] and last:
            found[name] = (shares[last[-1]], shares[last[-1] + 1])
    return found, len(shares)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["atlas", "tricot"])
def test_classes_close_where_a_hundred_levels_show_it(name: str) -> None:
    """Each class closes within 2 % of the load of where 100 equal levels have it (to 1 %), by far fewer records."""
    (auto, records), (even, _) = closings(knit_scene(name)), closings(knit_scene(name, output={"frames": 100}))
    assert auto.keys() == even.keys() and auto
    assert records < 25
    for letter, (low, high) in auto.items():
        assert high - low <= NEAR
        assert low - NEAR <= even[letter][1] and even[letter][0] <= high + NEAR


def straight_wire(tmp_path: Path, **tables: dict[str, object]) -> Scene:
    rows = [f"{wire},{x},{0.5 * wire},0" for wire in range(2) for x in range(5)]
    (tmp_path / "wires.csv").write_text("\n".join(["wire,x [mm],y [mm],z [mm]", *rows]))
    scene = {
        "wires": {"file": tmp_path / "wires.csv", "node_spacing": "0.1 mm"},
        "wire": {"diameter": "0.1 mm"},
        "load": {"strain_weft": 1e-3},
        "contact": {"friction": 0.0},
        "variants": {"count": 1},
    }
    return load_scene({**scene, **{key: scene.get(key, {}) | table for key, table in tables.items()}})


def test_nothing_happens_to_a_straight_wire_in_tension(tmp_path: Path) -> None:
    records = list(Simulation(build_model(straight_wire(tmp_path))).run())
    assert [record.load_factor for record in records] == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert records[-1].steps < 1_500


def test_a_straight_wire_yields_at_its_limit_over_its_modulus(tmp_path: Path) -> None:
    """e = Y/E, at 0.371 of the load: the records on both sides of it are 1/64 of the load apart."""
    modulus = build_model(straight_wire(tmp_path)).scene.wire.youngs_modulus
    scene = straight_wire(tmp_path, wire={"yield_stress": 0.371e-3 * modulus})
    records = list(Simulation(build_model(scene)).run())
    yielded = [measure.largest_stress(record.observables) > scene.wire.yield_stress for record in records]
    after = yielded.index(True)
    assert records[after - 1].load_factor <= 0.371 <= records[after].load_factor
    assert records[after].load_factor - records[after - 1].load_factor == 1.0 / 64.0
    assert len(records) <= 5 + 4


def test_a_number_of_frames_adds_none() -> None:
    scene = knit_scene("atlas", output={"frames": 3}, load={"strain_weft": 0.03, "strain_warp": 0.03})
    assert [record.load_factor for record in Simulation(build_model(scene)).run()] == [0.0, 1 / 3, 2 / 3, 1.0]


def test_resuming_between_levels_that_are_added_gives_the_same_bits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Interrupted at every 45th check; some of the interruptions are in levels below one that is kept."""
    scene, kept = knit_scene("atlas"), []
    original = Relaxation.load_state_dict

    def load(self: Relaxation, arrays: dict[str, np.ndarray]) -> None:
        original(self, arrays)
        if "targets" in arrays:
            kept.append(sum(bool(target.kept) for target in self._targets))

    monkeypatch.setattr(Relaxation, "load_state_dict", load)
    assert_parts_are_the_whole(scene, tmp_path, monkeypatch, every=45)
    assert max(kept) >= 1


def test_the_work_at_the_edge_is_that_of_the_records_in_their_order(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where the mesh returns to a level that it has left for one below."""
    load = {"strain_weft": 0.02, "strain_warp": 0.02, "temperature": 330.0, "temperature_gradient": [800.0, 0.0]}
    scene = knit_scene("atlas", knit={"repeats": [4, 2]}, model={"boundary": "gripped"}, load=load)
    add, has_event = EdgeWork.add, Relaxation._has_event
    terms: list[tuple[tuple[np.ndarray, np.ndarray], ...]] = []
    events = [True]

    def adds(self: EdgeWork, *pairs: tuple[np.ndarray, np.ndarray]) -> float:
        terms.append(pairs)
        return add(self, *pairs)

    def has_one(self: Relaxation, lower: Target, upper: Target) -> bool:
        return events.pop() if events else has_event(self, lower, upper)

    monkeypatch.setattr(EdgeWork, "add", adds)
    monkeypatch.setattr(Relaxation, "_has_event", has_one)
    records = list(Simulation(build_model(scene)).run())
    monkeypatch.undo()
    work = EdgeWork()
    assert [work.add(*pairs) for pairs in terms] == [record.edge_work for record in records]
    assert len(records) > FEWEST_LEVELS + 1 and records[-1].edge_work != 0.0


def test_an_increment_that_fails_is_halved(monkeypatch: pytest.MonkeyPatch) -> None:
    """The mesh converges to a quarter of the load only from an eighth of it: both are recorded."""
    simulation = Simulation(build_model(knit_scene("atlas", load={"strain_weft": 0.01, "strain_warp": 0.01})))
    solve, failed = Equilibrium.solve, []

    def failing(self: Equilibrium) -> None:
        solve(self)
        if simulation.progress.load_factor == 0.25 and not failed:
            failed.append(True)
            raise Diverged("too far")

    monkeypatch.setattr(Equilibrium, "solve", failing)
    assert [record.load_factor for record in simulation.run()] == [0.0, 0.125, 0.25, 0.5, 0.75, 1.0]


def test_an_increment_that_fails_ends_the_run_at_the_tolerance(monkeypatch: pytest.MonkeyPatch) -> None:
    """The last record is within 1/64 of the load of where the mesh fails."""
    simulation = Simulation(build_model(knit_scene("atlas", load={"strain_weft": 0.01, "strain_warp": 0.01})))
    solve, shares = Equilibrium.solve, []

    def failing(self: Equilibrium) -> None:
        solve(self)
        if simulation.progress.load_factor > 0.3:
            raise Diverged("too far")

    monkeypatch.setattr(Equilibrium, "solve", failing)
    with pytest.raises(Diverged, match="too far"):
        shares.extend(record.load_factor for record in simulation.run())
    assert 0.3 - 1 / 64 <= simulation.progress.load_factor <= 0.3 + 1 / 64
    assert FEWEST_LEVELS == 4


def level(share: float, force: float, stored: float, *passed: bool) -> Level:
    """A spring with this force at the displacement `share`."""
    values = (share, [*passed], [force], [share], stored, 0.0)
    return Level(*map(np.array, values))


def test_events_of_springs_by_hand() -> None:
    """A linear spring stores 1/2 k x^2, the mean force times x; one that is slack up to x = 1/2 half of that at x = 1, k/8."""
    linear = [level(x, x, 0.5 * x * x, False) for x in (0.5, 1.0)]
    assert not happens(*linear, energy_scale=1.0)
    assert happens(level(0.0, 0.0, 0.0), level(1.0, 0.5, 0.125), energy_scale=1.0)
    assert happens(linear[0], level(1.0, 1.0, 0.5, True), energy_scale=1.0)
    assert not happens(level(0.0, 0.0, 0.0), level(1.0, 1e-6, 1e-7), energy_scale=1.0)  # round-off of an unloaded mesh


def test_a_tolerance_is_a_share_of_the_load(tmp_path: Path) -> None:
    scene = straight_wire(tmp_path, wire={"yield_stress": "100 MPa"}, output={"load_tolerance": 0.2})
    shares = [record.load_factor for record in Simulation(build_model(scene)).run()]
    assert min(after - before for before, after in pairwise(shares)) == 0.125
    with pytest.raises(InputError, match=r"'auto' .* 1 to 100000"):
        straight_wire(tmp_path, output={"frames": "automatic"})
    assert replace(scene.output, frames=7).levels == 7 and scene.output.levels == 20
    assert json.loads(json.dumps(scene.output.frames)) == "auto"
