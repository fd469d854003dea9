"""Cutting a gripped mesh: what is cut is decided in metres, not in nodes."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from warpknit import measure
from warpknit.model import Model, build_model
from warpknit.scene import load_scene
from warpknit.simulate import Simulation
from warpknit.state import initial_state

PATCH = Path(__file__).parents[1] / "scenes/atlas_patch.toml"


@cache
def patch(nodes_per_loop: int) -> Model:
    return build_model(load_scene(PATCH, ["knit.repeats=[2, 3]", f"model.nodes_per_loop={nodes_per_loop}"]))


@pytest.mark.parametrize("nodes_per_loop", [12, 16, 27, 92])
def test_division_does_not_change_what_is_cut(nodes_per_loop: int) -> None:
    """The same wires between the same clamps, and the same bodies, however many nodes a loop has."""
    here, fine = patch(nodes_per_loop).panel, patch(54).panel
    assert here.body_count == fine.body_count
    assert here.notes == fine.notes
    np.testing.assert_allclose(here.clamp_position, fine.clamp_position, atol=1e-12)
    np.testing.assert_allclose(here.wire_length, fine.wire_length, atol=1e-12)
    np.testing.assert_allclose(here.body_rest, fine.body_rest, atol=1e-12)


def test_clamps_sit_on_the_boundary() -> None:
    panel = patch(24).panel
    middle = 0.5 * (panel.clamp_position.min(axis=0) + panel.clamp_position.max(axis=0))
    outside = np.abs(panel.clamp_position - middle) - 0.5 * panel.size
    np.testing.assert_allclose(outside.max(axis=1), 0.0, atol=1e-9 * panel.size.max())


def test_held_nodes_stand_before_and_behind_their_clamp() -> None:
    """Nodes of a wire are one spacing apart, so two of them take the clamp in their middle or nearer to one."""
    model = patch(24)
    panel, spacing = model.panel, model.table.spacing.max()
    distance = np.hypot(*panel.held_lever.T).reshape(-1, 2)
    assert (distance.sum(axis=1) <= spacing * (1 + 1e-9)).all()
    facing = np.einsum("cx,cx->c", panel.held_lever[0::2], panel.held_lever[1::2])
    assert (facing <= 1e-9 * spacing**2).all()


def test_hinges_beside_a_clamp_stand_for_the_wire_that_is_free() -> None:
    """Lengths that the hinges stand for add up to the wire between its clamps."""
    model = patch(24)
    panel = model.panel
    spacing = model.table.spacing[panel.wire_thread]
    inner = panel.wire_count - 4  # hinges of a full spacing each: all but the two outermost of each end
    represented = spacing * (inner + (1.0 / panel.wire_hinge).sum(axis=1))
    np.testing.assert_allclose(represented, panel.wire_length, rtol=1e-9)


def test_tension_of_a_small_gripped_patch_settles_with_the_nodes() -> None:
    """Before any contact closes; its shortest wires have three free nodes at 24 a loop, which is where the 4 % come from."""
    tension = []
    for nodes_per_loop in (24, 54):
        model = build_model(load_scene(PATCH, [
            "knit.repeats=[2, 2]", f"model.nodes_per_loop={nodes_per_loop}", "load.strain_weft=0.02", "load.strain_warp=0.02",
            "output.frames=1", "solver.precision='double'",
        ]))  # fmt: skip
        *_, last = Simulation(model, initial_state(model)).run()
        tension.append(measure.mesh_tension(last.reading))
    assert tension[0] == pytest.approx(tension[1], rel=0.04)
