"""Clamps that are turned where they are, `load.clamp_rotation`.

    straight wire between two clamps, turned by phi:  M = 12 EI phi/L for both, from slope phi at both ends of a beam
    any mesh:                                         the couple is the derivative of the energy by the angle

A mesh of mirror symmetry answers to -phi as to phi, with the couple reversed; on the way the work is what is stored.
"""

from __future__ import annotations

import csv
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from reference.plane_wires import Rig, panel_of_wires, straight, table_of_wires
from warpknit import measure
from warpknit.base.errors import SceneError
from warpknit.kernels import clamp
from warpknit.planar.state import initial_state
from warpknit.runner.run import run_scene
from warpknit.scene import make_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Record, Simulation

LENGTH = 0.6e-3  # [m] between the clamps of a straight wire
PHI = 1e-5  # [rad] of it: the stretch of its S shape, EA phi^2/30, is nothing beside 12 EI phi/L^2


def couple_of_beam(segments: int) -> tuple[float, float]:
    """Moment [N m] of both clamps, at nodes 1 and n - 2, and stored energy [J] of a straight wire at rest."""
    h = LENGTH / segments
    shape = straight(segments + 3, h, 0.0)
    table = table_of_wires([shape])
    held = np.array([0, 1, segments + 1, segments + 2])
    numbers = np.zeros((1, 2, clamp.CLAMP_NUMBERS))
    numbers[..., [clamp.TANGENT_X, clamp.LENGTH, clamp.NEXT_HINGE]] = 1.0, h, 1.0
    numbers[..., clamp.HINGE] = 2.0  # the hinge at a clamp stands for half a segment
    ends = shape[[1, segments + 1]]
    lever = shape[held] - np.repeat(ends, 2, axis=0)
    panel = replace(
        panel_of_wires(table, held=held.tolist()), wire_clamp=numbers, held_lever=lever, clamp_position=ends,
        held_clamp=np.array([0, 0, 1, 1], dtype=np.int32),
    )  # fmt: skip
    rig = Rig(table, panel)
    gradient = measure.rotation(-PHI)
    rig.control(gradient=gradient)
    start = rig.rest.copy()
    rig.rest = start @ gradient.T
    place = rig.rest.copy()
    place[held] = np.repeat(ends @ gradient.T, 2, axis=0) + lever
    free = np.ones_like(place, dtype=bool)
    free[held] = False
    reading = rig.observables(rig.rest_position(place, free, tolerance=1e-12))
    return measure.clamp_couple(reading) * panel.area, reading.energies.stored


def test_a_straight_wire_between_turned_clamps_bends_as_a_beam() -> None:
    """M = 12 EI phi/L and E = 6 EI phi^2/L; at its ends the wire is one order short of the fourth that it has inside."""
    wire = make_scene({"wire": {"material": "tungsten", "diameter": 15e-6}}).wire
    moment, energy = 12.0 * wire.bending_stiffness * PHI / LENGTH, 6.0 * wire.bending_stiffness * PHI**2 / LENGTH
    coarse, fine = couple_of_beam(10), couple_of_beam(20)
    for k, wanted in enumerate((moment, energy)):
        assert fine[k] == pytest.approx(wanted, rel=2.0 * 20**-3, abs=0)
        assert abs(fine[k] - wanted) < 0.15 * abs(coarse[k] - wanted)


TURN = 0.15  # [rad]


def patch(turn: float, **tables: Any) -> dict[str, Any]:
    """A gripped patch at 5 % whose clamps turn."""
    return {
        "knit": {"repeats": [2, 2]}, "model": {"kind": "planar", "boundary": "gripped"}, "solver": {"preset": "draft"},
        "load": {"strain_weft": 0.05, "strain_warp": 0.05, "clamp_rotation": turn},
        "output": {"frames": 4, "usd": False, "figures": False}, **tables,
    }  # fmt: skip


@cache
def turned(turn: float) -> Record:
    model = build_model(make_scene(patch(turn)))
    *_, last = Simulation(model, initial_state(model)).run()
    return last


def test_mirrored_turns_have_mirrored_answers() -> None:
    """The double atlas is its own mirror image: tensions stay, the couple goes round, to three times the residual tolerance."""
    right, left = (turned(turn).observables for turn in (-TURN, TURN))
    tolerance = 3.0 * right.model.scene.solver.residual_tolerance
    assert measure.mesh_tension(right) == pytest.approx(measure.mesh_tension(left), rel=tolerance, abs=0)
    assert measure.clamp_couple(right) == pytest.approx(-measure.clamp_couple(left), rel=tolerance, abs=0)
    assert measure.clamp_couple(left) > 0.0  # what turns a clamp is what it is turned by


def test_wires_leave_their_clamps_in_the_turned_direction() -> None:
    """The two held nodes of either end stand where the load puts them: turned about a clamp that moves with the boundary."""
    for turn in (0.0, TURN):
        reading = turned(turn).observables
        panel, place = reading.model.panel, measure.positions(reading)[0][:, :2]
        middle = panel.clamp_position - panel.clamp_position.min(axis=0)
        wanted = (middle @ np.diag([1.05, 1.05]))[panel.held_clamp] + panel.held_lever @ measure.rotation(turn).T
        assert place[panel.held_node] == pytest.approx(wanted, rel=0, abs=2.0 * reading.model.precision.unit)


def test_the_couple_is_what_turning_the_clamps_takes(tmp_path: Path) -> None:
    """Work along the way, with that of the couple, is what is stored at the end; it is most of it."""
    ending = run_scene(make_scene(patch(0.0, path=[{"clamp_rotation": TURN}])), out=tmp_path / "run")
    balance = ending.summary.json()["quality"]["energy_balance_of_stored"]
    with open(tmp_path / "run" / "history.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    angle, couple = (np.array([float(row[key]) for row in rows]) for key in ("clamp_rotation", "clamp_couple_N_per_m"))
    area = np.prod(make_scene(patch(0.0)).knit.size)
    work = area * float(np.sum(0.5 * (couple[1:] + couple[:-1]) * np.diff(angle)))
    assert angle[-1] == pytest.approx(TURN)
    assert work > 0.3 * float(rows[-1]["work_J"])
    assert abs(balance) < 0.01


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        ({"model": {"boundary": "periodic"}}, "periodic"),
        ({"solver": {"drive": "ramp"}}, "solver.drive = 'ramp'"),
        ({"load": {"clamp_rotation": 2.0}}, "-1.6 to 1.6"),
    ],
)
def test_what_cannot_turn_is_refused(tables: dict[str, Any], said: str) -> None:
    with pytest.raises(SceneError, match=r"load\.clamp_rotation: .*; ") as caught:
        make_scene(patch(TURN, **tables))
    assert said in str(caught.value)
