"""Cutting a gripped mesh: what is cut is decided in metres, not in nodes."""

from __future__ import annotations

from dataclasses import asdict
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from warpknit import measure
from warpknit.kernels import clamp
from warpknit.knit.named import named_knit
from warpknit.planar.model import Model
from warpknit.planar.observables import read
from warpknit.planar.state import initial_state
from warpknit.scene import load_scene, make_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation

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


def test_first_free_node_is_near_its_clamp() -> None:
    """Between 0.75 and 1.75 spacings of wire, so that the first segment is neither much stiffer nor much coarser."""
    model = patch(24)
    panel, spacing = model.panel, model.table.spacing.max()
    length = panel.wire_clamp[:, :, clamp.LENGTH] / spacing
    assert (length < 1.75 * (1 + 1e-6)).all() and (length > 0.7).all()


def test_lengths_and_hinges_add_up_to_the_wire_between_its_clamps() -> None:
    """Chords fall short of the wire by the bow of their arcs: 0.65^2/24 at the sharpest foot at 24 a loop. Hinges stand for arcs,
    all of them together for the wire, as even as the nodes lie on its curve."""
    model = patch(24)
    panel = model.panel
    reading = read(model, initial_state(model))
    chords, hinges = reading.natural_length.copy(), reading.hinge_length.copy()
    first, last = panel.wire_first, panel.wire_first + panel.wire_count - 1
    for node in (first, last - 1, last):
        chords[node] = 0.0
    for node in (first, last):
        hinges[node] = 0.0
    total = np.add.reduceat(chords, first)
    np.testing.assert_allclose(total, panel.wire_length, rtol=0.02)
    assert (total < panel.wire_length).all()
    np.testing.assert_allclose(np.add.reduceat(hinges, first), panel.wire_length, rtol=1e-9)


def test_tension_of_a_small_gripped_patch_settles_with_the_nodes() -> None:
    """Before any contact closes; its shortest wires have three free nodes at 24 a loop, which is where the 6 % come from."""
    tension = []
    for nodes_per_loop in (24, 54):
        model = build_model(load_scene(PATCH, [
            "knit.repeats=[2, 2]", f"model.nodes_per_loop={nodes_per_loop}", "load.strain_weft=0.02", "load.strain_warp=0.02",
            "output.frames=1", "solver.precision='double'",
        ]))  # fmt: skip
        *_, last = Simulation(model, initial_state(model)).run()
        tension.append(measure.mesh_tension(last.observables))
    assert tension[0] == pytest.approx(tension[1], rel=0.06)


@pytest.mark.parametrize("knit", ["full-double-atlas", "tricot", "atlas", "reverse-locknit"])
def test_wires_of_a_tight_patch_are_the_same_however_they_are_divided(knit: str) -> None:
    """In the plane and in space, at the nodes of every preset: grips leave pieces of a sixth of a loop and more, and what is
    shorter than a quarter of a loop is not part of the mesh."""
    bars = [asdict(bar) for bar in named_knit(knit).bars]
    spacing = {"wale_spacing": 25.4e-3 / 26, "course_spacing": 25.4e-3 / 30}
    lengths = []
    for kind, nodes in (("planar", 12), ("planar", 16), ("spatial", 20), ("spatial", 28), ("spatial", 40)):
        scene = make_scene({
            "wire": {"material": "tungsten", "diameter": 15e-6},
            "knit": {"bars": bars, **spacing, "repeats": [4, 4]},
            "model": {"kind": kind, "boundary": "gripped", "nodes_per_loop": nodes},
        })  # fmt: skip
        model = build_model(scene)
        lengths.append(np.sort(model.panel.wire_length) / model.cloth.stitch_length)
        assert lengths[-1].min() >= 0.25
    assert all(len(each) == len(lengths[0]) and each == pytest.approx(lengths[0], rel=1e-6) for each in lengths)
