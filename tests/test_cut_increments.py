"""Levels that fail: increments of the load are halved from the last equilibrium on."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from reference.in_words import quantities
from warpknit import measure
from warpknit.base.errors import Diverged, StepLimitExceeded
from warpknit.mesh.rim import LoadPoint
from warpknit.scene import load_scene
from warpknit.solve.equilibrium import ON_THE_WAY
from warpknit.solve.model import build_model
from warpknit.solve.relax import MAX_CUTS, Relaxation
from warpknit.solve.simulate import Simulation
from warpknit.spatial.mechanics import SpatialMechanics

SCENES = Path(__file__).parent.parent / "scenes"
LOAD = ("solver.preset=draft", "load.strain_weft=0.04", "load.strain_warp=0.04")
MODELS = {"planar": SCENES / "atlas_cell.toml", "spatial": SCENES / "atlas_cell_spatial.toml"}


def simulation_of(kind: str, frames: int) -> Simulation:
    return Simulation(build_model(load_scene(MODELS[kind], [*LOAD, f"output.frames={frames}"])))


def fail_above(increment: float, monkeypatch: pytest.MonkeyPatch, *, error: type[Diverged] = Diverged) -> list[float]:
    """Have levels of larger increments of strain fail once their load is applied; returns the strains at which they do."""
    corrected, failed = Relaxation.corrected, []

    def refused(self: Relaxation, ratio: float) -> tuple[float, bool]:
        moved = 0.0 if self._last_gradient is None else float(np.abs(self.state.gradient.ravel() - self._last_gradient).max())
        if moved > increment:
            failed.append(float(self.state.gradient[0, 0]) - 1.0)
            raise error("too far at once")
        return corrected(self, ratio)

    monkeypatch.setattr(Relaxation, "corrected", refused)
    return failed


@pytest.mark.parametrize("kind", MODELS)
def test_a_level_that_fails_is_reached_in_smaller_increments(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """4 % fail, then 2 %, then 1 % do not: the state is that of four levels of 1 %, and a note says so. Records of wires in
    space search their contacts anew, so bits differ: both are within the drift that counts as none, 1e-3 of the tension."""
    whole = simulation_of(kind, 4)
    for _ in whole.run():
        pass
    failed = fail_above(0.015, monkeypatch)
    cut = simulation_of(kind, 1)
    records = list(cut.run())
    assert failed == pytest.approx([0.04, 0.02]) and [record.load_factor for record in records] == [0.0, 1.0]
    of_cut, of_whole = (simulation.mechanics.observe() for simulation in (cut, whole))
    assert np.array_equal(of_cut.node_position, of_whole.node_position) or kind == "spatial"
    assert measure.mesh_tension(of_cut) == pytest.approx(measure.mesh_tension(of_whole), rel=1e-3)
    assert [note for note in cut.notes if "4" in quantities(note)]
    assert records[-1].steps > whole.progress.steps  # those of the levels that failed count
    resumed = simulation_of(kind, 1)
    resumed.drive.load_state_dict(cut.drive.state_dict())
    assert resumed.notes == cut.notes


def test_a_check_that_moves_the_mesh_is_not_the_last_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also on the way between two levels, where a larger residual is enough."""
    corrected, moves = Relaxation.corrected, 40

    def corrects(self: Relaxation, ratio: float) -> tuple[float, bool]:
        ratio, _ = corrected(self, ratio)
        return ratio, self.progress.checks <= moves

    simulation = simulation_of("planar", 1)
    stage = simulation.model.scene.stages[0]
    load = LoadPoint(1.001 * np.eye(2), stage.temperature)
    simulation.drive.mechanics.search()
    assert isinstance(simulation.drive, Relaxation)
    simulation.drive.solve(load, ON_THE_WAY)
    assert simulation.progress.checks < moves
    monkeypatch.setattr(Relaxation, "corrected", corrects)
    simulation.drive.solve(replace(load, gradient=1.002 * np.eye(2)), ON_THE_WAY)
    assert simulation.progress.checks == moves + 1


def test_what_fails_in_the_smallest_increment_has_failed(monkeypatch: pytest.MonkeyPatch) -> None:
    failed = fail_above(0.0, monkeypatch)
    with pytest.raises(Diverged, match="too far at once"):
        list(simulation_of("planar", 1).run())
    assert failed == pytest.approx([0.04 * 0.5**cut for cut in range(MAX_CUTS + 1)])


def test_the_step_limit_is_no_reason_for_smaller_increments(monkeypatch: pytest.MonkeyPatch) -> None:
    failed = fail_above(0.0, monkeypatch, error=StepLimitExceeded)
    with pytest.raises(StepLimitExceeded):
        list(simulation_of("planar", 1).run())
    assert failed == pytest.approx([0.04])


@pytest.mark.parametrize("error", ["stalled", "exceeded_steps"])
@pytest.mark.parametrize(("residual", "drifts", "says"), [(1.0, False, True), (0.0, True, True), (0.0, False, False)])
def test_a_larger_tolerance_is_advised_where_it_helps(error: str, residual: float, drifts: bool, says: bool) -> None:
    """Residual and drift are compared with `solver.residual_tolerance`, multipliers and membrane corrections are not."""
    simulation = simulation_of("planar", 1)
    relaxation = simulation.drive
    assert isinstance(relaxation, Relaxation)
    relaxation.progress.residual = residual
    relaxation.equilibrium.convergence._met[0] = int(drifts)
    message = str(getattr(relaxation, error)())
    assert ("solver.residual_tolerance" in message) == says
    assert "multipliers" in message or says


def test_a_set_that_fails_is_released_in_smaller_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """The two parts of 2 % become four of 1 %, without a step of the natural curvature between them."""
    corrected, release, parts = Relaxation.corrected, SpatialMechanics.release, []

    def refused(self: Relaxation, ratio: float) -> tuple[float, bool]:
        if not self.progress.cuts:
            raise Diverged("too far at once")
        return corrected(self, ratio)

    def noted(self: SpatialMechanics, begin: float, end: float) -> None:
        parts.append((begin, end))
        release(self, begin, end)

    monkeypatch.setattr(Relaxation, "corrected", refused)
    monkeypatch.setattr(SpatialMechanics, "release", noted)
    scene = load_scene(MODELS["spatial"], [*LOAD, "wire.set_fraction=0.96", "model.nodes_per_loop=20"])
    assert next(Simulation(build_model(scene)).run()).load_factor == 0.0
    assert parts == [(0.0, 0.5), (0.0, 0.25), (0.25, 0.5), (0.5, 0.75), (0.75, 1.0)]
