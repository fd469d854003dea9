"""Clamps that are turned where they are, in space: the couple is the work of the turn, and the plane has the same one.

A patch that hardly touches is bent in its plane by turned clamps, so that both models solve the same problem.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from warpknit import measure
from warpknit.results.frame import Frame
from warpknit.runner.run import run_scene
from warpknit.scene import load_scene
from warpknit.spatial.model import build_model

CELL = Path(__file__).parents[2] / "scenes" / "atlas_cell_spatial.toml"
TURN = 0.1  # [rad]
STRAIN = 0.02
PATCH = (
    "model.boundary=gripped", "knit.repeats=[1,2]", "model.nodes_per_loop=40", "solver.preset=draft",
    "solver.residual_tolerance=0.02", "output.frames=2", "output.usd=false", "output.figures=false",
    f"load.strain_weft={STRAIN}", f"load.strain_warp={STRAIN}", f"load.clamp_rotation={TURN}",
)  # fmt: skip


@pytest.fixture(scope="module")
def turned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("turned") / "run"
    assert run_scene(load_scene(CELL, PATCH), out=out, device="cpu").exit_code == 0
    return out


TEXT = ("stage", "steady", "stress_max_part")


def rows_of(out: Path) -> list[dict[str, float]]:
    with open(out / "history.csv", newline="", encoding="utf-8") as file:
        return [{key: float(row[key]) for key in row if key not in TEXT} for row in csv.DictReader(file)]


def test_the_couple_is_what_turning_the_clamps_takes(turned: Path) -> None:
    """What is stored is the work of the boundary with that of the couple, which is most of it; by two levels from rest, along
    which forces grow about as the load."""
    rows = rows_of(turned)
    last = rows[-1]
    assert [row["clamp_rotation"] for row in rows] == pytest.approx([0.0, TURN / 2, TURN], abs=1e-12)
    area = np.prod(load_scene(CELL, PATCH).knit.size)
    couple, angle = (np.array([row[key] for row in rows]) for key in ("clamp_couple_N_per_m", "clamp_rotation"))
    stored = last["energy_stretch_J"] + last["energy_bend_J"] + last["energy_contact_J"]
    assert area * float(np.sum(0.5 * (couple[1:] + couple[:-1]) * np.diff(angle))) > 0.3 * stored
    assert last["work_J"] == pytest.approx(stored, rel=0.02)


def test_wires_leave_their_clamps_in_the_turned_direction(turned: Path) -> None:
    """Held nodes stand about a clamp that moves with the boundary, turned by the angle."""
    mesh = build_model(load_scene(CELL, PATCH))
    clamp = mesh.panel.clamp_position - mesh.panel.clamp_position.min(axis=0)
    wanted = np.repeat(clamp, 2, axis=0) * (1.0 + STRAIN) + mesh.wires.held_lever @ measure.rotation(TURN).T
    place = Frame.load(turned / "states" / "state_000002.npz").node_position[:, :2]
    assert place[mesh.wires.held_node] == pytest.approx(wanted, rel=0, abs=1e-12)


def test_plane_and_space_turn_alike(turned: Path, tmp_path: Path) -> None:
    """Couple and tension of the planar model within what it leaves out of heights and contacts that hardly press: 5 %, and less
    for the couple, which is of bending at the clamps."""
    run_scene(load_scene(CELL, [*PATCH, "model.kind=planar", "model.nodes_per_loop=48"]), out=tmp_path / "plane", device="cpu")
    plane, space = rows_of(tmp_path / "plane")[-1], rows_of(turned)[-1]
    assert space["clamp_couple_N_per_m"] == pytest.approx(plane["clamp_couple_N_per_m"], rel=0.03)
    assert space["tension_warp_N_per_m"] == pytest.approx(plane["tension_warp_N_per_m"], rel=0.05)
    assert space["nominal_shear_N_per_m"] == pytest.approx(plane["nominal_shear_N_per_m"], rel=0.05)
