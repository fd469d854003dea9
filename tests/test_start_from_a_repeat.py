"""A facet of a tight knit starts from one repeat of endless cloth; where it cannot, from its own state."""

import contextlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from warpknit.base.errors import NoProgress
from warpknit.mechanics.response import Response
from warpknit.mesh.rim import LoadPoint
from warpknit.scene import load_scene
from warpknit.solve.model import build_model
from warpknit.solve.multilevel import STIFFER, MultilevelRelaxation
from warpknit.solve.progress import Progress
from warpknit.solve.relax import Relaxation
from warpknit.solve.simulate import Record, Simulation
from warpknit.spatial.transfer import Fields, Prolongation
from warpknit.spatial.worlds import SpatialWorlds

SCENES = Path(__file__).parents[1] / "scenes"
TRICOT, ATLAS = [{"chain": "1-0/1-2"}, {"chain": "1-2/1-0"}], [{"chain": "1-0/1-2/2-3/3-4/3-2/2-1"}]
FACET = {
    "wire": {"material": "molybdenum", "diameter": "30 um"},
    "knit": {"wales": "26 /inch", "courses": "30 /inch"},
    "model": {"kind": "spatial", "boundary": "gripped"},
    "panel": {
        "outline": "hexagon",
        "size": "6 mm",
        "grip_pitch": "3 mm",
        "cord": {"tension": "5 N", "stiffness": "5 kN"},
        "focal_length": "3 m",
    },
    "contact": {"friction": 0},
}


def solved(
    knit: list[dict[str, str]], strain: tuple[float, float], levels: int, friction: float = 0.0, **keys: float
) -> tuple[Simulation, Record]:
    scene = load_scene(FACET, {"knit.bars": knit, "load.strain_weft": strain[0], "load.strain_warp": strain[1],
                               "output.frames": levels, "contact.friction": friction} | keys, "draft")  # fmt: skip
    simulation = Simulation(build_model(scene, "cpu"))
    *_, last = simulation.run()
    return simulation, last


def tension(simulation: Simulation, record: Record) -> np.ndarray:
    return simulation.drive.mesh_tension(record.observables)


@pytest.mark.parametrize(("knit", "strain", "starts"), [(TRICOT, (0.096, 0.014), True), (ATLAS, (0.06, 0.06), False)])
def test_the_start_does_not_change_the_equilibrium(
    knit: list[dict[str, str]], strain: tuple[float, float], starts: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same tensions as without it, to a quarter of the tolerance of the residual. A tricot takes a start of 10 % strain, in a
    quarter of the steps; wires of the atlas would pass each other, so that it is loaded from its own state."""
    fine = {"solver.residual_tolerance": 2e-3}
    simulation, last = solved(knit, strain, 1, **fine)
    drive = simulation.drive
    assert isinstance(drive, MultilevelRelaxation)
    monkeypatch.setattr("warpknit.solve.simulate.smaller_scene", lambda _: None)
    alone, expected = solved(knit, strain, 7 if starts else 1, **fine)
    assert isinstance(alone.drive, MultilevelRelaxation) and alone.drive.smaller is None
    tolerance = drive.scene.solver.residual_tolerance
    assert tension(simulation, last) == pytest.approx(tension(alone, expected), rel=0.25 * tolerance)
    assert len(simulation.notes) == int(not starts)
    if starts:
        assert last.steps < 0.25 * expected.steps


@pytest.mark.parametrize("most_kept", [0, 300_000], ids=["large", "with a snapshot"])
def test_a_start_that_overlaps_wires_is_repeated_with_stiffer_contacts(most_kept: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The mesh comes to the same place again, within the tolerance of the repeat, and to the same equilibrium.

    A mesh that is too large to keep its last equilibrium returns by itself, without the repeat.
    """
    expected = tension(*solved(TRICOT, (0.096, 0.014), 1))
    monkeypatch.setattr("warpknit.solve.relax.MOST_KEPT", most_kept)
    carried, deep = [], [0.6]
    carry, overlap = Prolongation.carry, SpatialWorlds.overlap

    def carries(self: Prolongation, response: Response) -> bool:
        fits = carry(self, response)
        if self.large.node_count > 1000:
            carried.append(self._fields.stepper.state.displacement.numpy().copy())
        return fits

    def overlaps(self: SpatialWorlds, rows: np.ndarray) -> np.ndarray:
        found = overlap(self, rows)
        return np.array([deep.pop()]) if self.model.node_count > 1000 and deep else found

    monkeypatch.setattr(Prolongation, "carry", carries)
    monkeypatch.setattr(SpatialWorlds, "overlap", overlaps)
    simulation, last = solved(TRICOT, (0.096, 0.014), 1)
    first, second = carried[-2:]
    assert second == pytest.approx(first, abs=2e-3 * np.abs(first).max())
    multipliers = simulation.drive.mechanics.group.multipliers
    assert multipliers is not None and multipliers.loading_factor.tolist() == [STIFFER]
    assert not simulation.notes
    assert tension(simulation, last) == pytest.approx(expected, rel=0.25 * simulation.drive.scene.solver.residual_tolerance)


def contact_forces(fields: Fields) -> tuple[np.ndarray, np.ndarray]:
    """(contact, 2) [N] normal and friction force of those that touch, and their first nodes."""
    fields.stepper.evaluate()
    found = fields.contact.read_contacts()
    return np.stack([found.force, np.linalg.norm(found.friction, axis=1)], axis=1), found.first


def test_a_start_from_a_repeat_has_its_friction(monkeypatch: pytest.MonkeyPatch) -> None:
    """At the start each contact that sticks, away from the edge, has the friction of one of the repeat; without their
    slips the mesh would have none. A later level goes on from there."""
    started, carry = [], Prolongation.carry

    def carries(self: Prolongation, response: Response) -> bool:
        fits = carry(self, response)
        started.append((contact_forces(self._fields), contact_forces(self._small_fields)[0], self.large))
        return fits

    monkeypatch.setattr(Prolongation, "carry", carries)
    simulation, _ = solved(TRICOT, (0.096, 0.014), 1, friction=0.2)
    drive = simulation.drive
    assert isinstance(drive, MultilevelRelaxation) and drive.progress.is_prolonged
    assert len(started) == 1
    assert not drive._starts_from_smaller
    (forces, node), of_repeat, model = started[-1]
    away = model.panel.outline.nearest(model.rods.position[node, :2])[1]
    inside = forces[away > 2.0 * max(model.scene.knit.repeat)]
    stuck, known = inside[inside[:, 1] < 0.19 * inside[:, 0], 1], of_repeat[:, 1]
    assert len(stuck) > 10
    assert np.abs(stuck[:, None] / known - 1.0).min(axis=1).max() < 1e-3


def test_an_interrupted_start_with_friction_goes_on_to_the_same_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    """The level has one increment, also where it is resumed."""
    beside, is_beside = Relaxation.equilibrium_beside, [False]

    def goes_beside(self: Relaxation, *load: Any) -> Any:
        is_beside[0] = True
        found = beside(self, *load)
        is_beside[0] = False
        return found

    monkeypatch.setattr(Relaxation, "equilibrium_beside", goes_beside)
    keys = {"knit.bars": TRICOT, "load.strain_weft": 0.096, "load.strain_warp": 0.014, "output.frames": 1}
    model, checks = build_model(load_scene(FACET, keys | {"contact.friction": 0.2}, "draft"), "cpu"), [0]

    def run(kept: dict[str, np.ndarray], stop_at: int = 0) -> Simulation:
        def monitor(_: Progress) -> None:
            assert not is_beside[0]  # a checkpoint would have the state of another load
            checks[0] += 1
            if checks[0] == stop_at:
                raise KeyboardInterrupt

        simulation = Simulation(model, monitor=monitor)
        simulation.compile()
        if kept:
            simulation.drive.restore(kept)
            simulation.resumed = True
        with contextlib.suppress(KeyboardInterrupt):
            list(simulation.run())
        return simulation

    expected = run({}).state.arrays()
    late, checks[0] = checks[0] - 10, 0  # the checks of the repeat come first
    kept = run({}, late).drive.snapshot()
    found = run(kept).state.arrays()
    assert [name for name, value in expected.items() if not np.array_equal(value, found[name])] == []


def test_a_mesh_with_friction_that_cannot_start_from_a_repeat_follows_the_load(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its start is refused here; then it has the increments that it has without one, at most 2 % of strain."""
    begun: list[float] = []
    begin_level, carry = MultilevelRelaxation.begin_level, Prolongation.carry

    def refuses(self: Prolongation, response: Response) -> bool:
        carry(self, response)
        return False

    def begins(self: MultilevelRelaxation, load: LoadPoint, to_ratio: float) -> None:
        begun.append(float(load.gradient[0, 0]) - 1.0)
        begin_level(self, load, to_ratio)

    monkeypatch.setattr(MultilevelRelaxation, "begin_level", begins)
    monkeypatch.setattr(Prolongation, "carry", refuses)
    solved(TRICOT, (0.03, 0.005), 1, friction=0.2)
    assert begun == pytest.approx([0.03, 0.015, 0.03])


def test_a_mesh_with_friction_whose_start_fails_is_loaded_on_from_half_the_load(monkeypatch: pytest.MonkeyPatch) -> None:
    """Half the load starts from the repeat, too; the rest is applied in increments, and nothing is taken back."""
    begun: list[float] = []
    begin_level = MultilevelRelaxation.begin_level

    def begins(self: MultilevelRelaxation, load: LoadPoint, to_ratio: float) -> None:
        begun.append(float(load.gradient[0, 0]) - 1.0)
        begin_level(self, load, to_ratio)
        if len(begun) == 1:
            raise NoProgress("no progress")

    monkeypatch.setattr(MultilevelRelaxation, "begin_level", begins)
    solved(TRICOT, (0.03, 0.005), 1, friction=0.2)
    assert begun == pytest.approx([0.03, 0.015, 0.0225, 0.03])


@pytest.mark.slow
def test_cords_of_a_facet_find_their_places_after_a_change_of_temperature():
    """Long cords overshoot where the mesh beside them is softer than its membrane; corrections of the edge are damped."""
    facet = {"panel.size": "25 mm", "output.usd": False, "solver.max_steps": 4_000}
    simulation = Simulation(build_model(load_scene(SCENES / "reflector_facet.toml", facet, preset="draft")))
    ends = [record for record in simulation.run() if record.load_factor == 1.0]
    stretched, cold = (simulation.drive.mesh_tension(record.observables) for record in ends[:2])
    assert len(ends) == 3 and np.all(cold > stretched)
