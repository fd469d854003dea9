"""What a clamp makes of the wire next to it."""

from pathlib import Path

import numpy as np
import pytest

from warpknit.kernels import clamp
from warpknit.planar.diagnostics import Diagnostics
from warpknit.planar.state import initial_state
from warpknit.planar.world_step import WorldStepper
from warpknit.scene import load_scene
from warpknit.solve.model import build_model

HOOK = Path(__file__).parents[2] / "scenes" / "hook_free_body.toml"


def test_arcs_next_to_a_clamp_are_as_long_as_elsewhere() -> None:
    """A wire bent to a circle from its clamp on, its chords as long as at rest, has the same strain of arc everywhere, though the
    hinge at the clamp stands for half a segment and turns half as far (kernels/bend.py, clamp.py). Round-off of edges over h."""
    model = build_model(load_scene(HOOK, ["model.nodes_per_loop=24"]))
    state, panel, table = initial_state(model), model.panel, model.table
    count = int(panel.wire_count[0])
    entry = panel.node_entry[:count]
    rest = np.stack([table.x[entry], table.y[entry]], axis=1)
    spacing = np.linalg.norm(rest[2] - rest[1])
    tangent = panel.wire_clamp[0, 0, [clamp.TANGENT_X, clamp.TANGENT_Y]]
    turn = 0.7 * table.rest_turn[entry[4]]
    angle = np.arctan2(tangent[1], tangent[0]) + turn * (np.arange(count - 2) + 0.5)
    chords = spacing * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    moved = rest.copy()
    moved[2:] = rest[1] + np.cumsum(chords, axis=0)
    for values, shift in zip((state.node_ux, state.node_uy), (moved - rest).T, strict=True):
        now = values[state.parity].numpy()
        now[:count] = model.precision.counts(shift)
        values[state.parity].assign(now)
    diagnostics = Diagnostics(WorldStepper(model, state=state))
    diagnostics.sums(np.array([0]))
    strain = diagnostics.of_nodes[0]["strain"].numpy()[1 : count - 4]
    expected = (turn**2 - table.rest_turn[entry[4]] ** 2) / 24.0
    assert strain == pytest.approx(np.full(len(strain), expected), abs=1e-12)
