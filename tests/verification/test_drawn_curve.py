"""The curve of the wires that pictures and stages show: on the host it is the one on which contacts act, and at rest the true
centre line."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from warpknit import measure
from warpknit.measure.drawn_curve import edges_of, planar_curve
from warpknit.mesh.rest_table import ThreadCurve
from warpknit.planar.observables import read
from warpknit.planar.state import initial_state
from warpknit.results.frame import MOST_PARTS, POINTS_DRAWN, curve_parts, drawn_frame, drawn_layout
from warpknit.scene import load_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation
from warpknit.spatial.placed_wires import place_wires
from warpknit.spatial.rest_curve import FIT_PLACES, spatial_curve
from warpknit.spatial.sites import site_places

SCENES = Path(__file__).parents[2] / "scenes"
LOADED = ["solver.preset=draft", "output.frames=1"]


@pytest.fixture(scope="module")
def planar():
    """Observables and frame of the cell at 10 %, both ways."""
    model = build_model(load_scene(SCENES / "atlas_cell.toml", [*LOADED, "solver.precision=double"]))
    *_, last = Simulation(model, initial_state(model)).run()
    frame = measure.frame(last.observables, index=0, stage="load", load_factor=1.0, temperature=293.15)
    return last.observables, frame


@pytest.fixture(scope="module")
def spatial():
    """Observables and frame of a hook whose wires press each other, and are thicker than at rest by thermal expansion."""
    scene = load_scene(SCENES / "hook_spatial.toml", [*LOADED, "load.displacement=0.5 mm", "load.temperature=600 degC"])
    *_, last = Simulation(build_model(scene)).run()
    return last.observables, measure.frame(last.observables, index=0, stage="load", load_factor=1.0, temperature=293.15)


def test_at_rest_planar_wires_are_drawn_along_their_centre_lines():
    """To the miss of the fit, which the model gives; over the end of a closed wire too."""
    model = build_model(load_scene(SCENES / "atlas_cell.toml"))
    state = initial_state(model)
    frame = measure.frame(read(model, state), index=0, stage="", load_factor=0.0, temperature=293.15)
    layout, cloth, table = model.layout(), model.cloth, model.table
    assert layout.curve_parts > 2
    for w, thread in enumerate(model.panel.wire_thread):
        nodes = np.arange(layout.wire_start[w], layout.wire_start[w + 1])
        line = ThreadCurve(cloth.threads[thread], cloth.size[1])
        fine = line(np.linspace(0.0, len(nodes) * table.spacing[thread], 64 * len(nodes)))[:, :2]
        shift = line(np.zeros(1))[0, :2] - frame.node_position[nodes[0], :2]
        drawn = (frame.node_position[nodes, None] + frame.between[nodes])[..., :2].reshape(-1, 2) + shift
        miss = [np.linalg.norm(fine - point, axis=1).min() for point in drawn]
        step = table.spacing[thread] / 64
        assert max(miss) < model.table.curve_error + step


def test_at_rest_wires_in_space_are_drawn_along_their_centre_lines():
    mesh = build_model(load_scene(SCENES / "atlas_cell_spatial.toml", ["model.nodes_per_loop=48"]))
    rods, forms = mesh.rods, place_wires(mesh.cloth, mesh.table, mesh.panel, mesh.rods.section.thickness).forms
    assert np.array_equal(forms.form, np.arange(len(rods.wire_first)))
    line = forms.line
    curve = spatial_curve(mesh.layout(), rods.position, np.eye(2), rods.director, mesh.curve, 1.0)
    for k, place in enumerate(FIT_PLACES):
        offset = curve.offset(np.arange(rods.node_count), np.full(rods.node_count, place))
        # the fit looks at what is missed across the line only
        behind = line.between[:, k + 1] - line.between[:, k] if k == 0 else line.between[:, k] - line.between[:, k - 1]
        along = behind / np.linalg.norm(behind, axis=1, keepdims=True)
        missed = offset - line.between[:, k]
        missed -= np.sum(missed * along, axis=1, keepdims=True) * along
        assert np.linalg.norm(missed, axis=1).max() < 1.1 * mesh.curve.fit_error


def test_the_planar_curve_is_the_one_that_bodies_touch(planar):
    """|c - p| = reach + gap at the contact point p of every body c that presses, found to 1e-9 of a segment."""
    reading, frame = planar
    model = reading.model
    curve = planar_curve(model.layout(), frame.node_position, reading.gradient, model.table.curve[reading.entry])
    pressed = np.flatnonzero(reading.pair_force > 0.0)
    assert len(pressed) >= 8
    node = reading.pair_node[pressed]
    point = frame.node_position[node] + curve.offset(node, reading.pair_u[pressed])
    apart = (frame.body_position[pressed // 2] - point)[:, :2]
    periods = reading.gradient @ np.diag(model.layout().period)
    apart = apart - np.rint(apart @ np.linalg.inv(periods).T) @ periods.T
    wanted = model.treatment.reach + reading.pair_gap[pressed]
    assert np.linalg.norm(apart, axis=1) == pytest.approx(wanted, rel=1e-6)


def test_the_curve_in_space_is_the_one_that_wires_touch_on(spatial):
    """|p - q| = d - overlap, and the mark stands at the strongest contact, half of that from either wire."""
    reading, _ = spatial
    t, thickness = reading.touching, reading.length_factor * reading.model.rods.section.thickness
    assert reading.length_factor > 1.002
    assert len(t.force) >= 2
    p = reading.position[t.first] + reading.curve.offset(t.first, t.place[:, 0])
    q = reading.position[t.second] + reading.curve.offset(t.second, t.place[:, 1])
    assert np.linalg.norm(p - q, axis=1) == pytest.approx(thickness - t.overlap, rel=1e-9)
    middle = 0.5 * (p + q)[np.argmax(t.force)]
    assert site_places(reading)[0] == pytest.approx(middle, abs=1e-9 * thickness)


def test_an_open_contact_is_marked_between_the_nearest_points_of_its_wires():
    """Both wires of a hook at rest are at one distance of the mark: half of what they pass each other at."""
    scene = load_scene(SCENES / "hook_spatial.toml")
    relaxation = Simulation(build_model(scene))
    relaxation.compile()
    reading = relaxation.mechanics.observe()
    mark, position = site_places(reading)[0], reading.node_position
    left, right = np.split(position, reading.model.rods.wire_first[1:])
    spacing = scene.hook.length / scene.model.nodes_per_loop
    for wire in (left, right):
        nearest = np.linalg.norm(wire - mark, axis=1).min()
        assert nearest < np.hypot(0.5 * scene.hook.crossing_distance, 0.5 * spacing) + 0.1 * spacing


def test_drawn_curves_pass_through_the_nodes(planar):
    reading, frame = planar
    layout = reading.model.layout()
    parts, drawn, shown = layout.curve_parts, drawn_layout(layout), drawn_frame(layout, frame)
    shown.require_layout(drawn)
    assert drawn.node_count == parts * layout.node_count  # of closed wires
    assert np.array_equal(shown.node_position[::parts], frame.node_position)
    assert np.array_equal(shown.node_stress[::parts], frame.node_stress)
    assert shown.node_stress.max() == frame.node_stress.max()
    ended = replace(layout, wire_closed=np.zeros(layout.wire_count, dtype=bool))
    assert drawn_layout(ended).node_count == parts * (layout.node_count - layout.wire_count) + layout.wire_count
    assert drawn_frame(ended, frame).node_position[-1] == pytest.approx(frame.node_position[-1], abs=0.0)


def test_edges_of_open_wires_go_on_straight(spatial):
    reading, _ = spatial
    layout = reading.model.layout()
    edges = edges_of(layout, reading.position, reading.gradient)
    ends, begins = layout.wire_start[1:] - 1, layout.wire_start[:-1]
    assert np.array_equal(edges.behind[ends], edges.behind[ends - 1])
    assert np.array_equal(edges.before[begins], edges.behind[begins])
    assert not edges.has_segment[ends].any()


def test_large_meshes_are_drawn_by_their_nodes():
    assert curve_parts(128, 16) == MOST_PARTS
    assert curve_parts(500, 64) == 2
    assert curve_parts(POINTS_DRAWN, 16) == 1


def test_the_mark_of_wires_apart_is_the_middle_of_the_gap_between_them() -> None:
    """As knitted no wires touch: the mark is as far from the nodes of one wire, joined by lines, as from those of the other, and
    both together are at most the distance of the two nodes where the wires hook."""
    model = build_model(
        load_scene(SCENES / "atlas_cell_spatial.toml", [*LOADED, "model.boundary=gripped", "knit.repeats=[2, 2]"])
    )
    reading = next(Simulation(model).run()).observables
    assert len(reading.touching.force) == 0
    rods, wires, position = model.rods, model.wires, reading.position

    def distance(point: np.ndarray, wire: int) -> float:
        nodes = position[rods.wire_first[wire] : rods.wire_first[wire] + rods.wire_count[wire]]
        along = np.diff(nodes, axis=0)
        share = np.clip(np.sum((point - nodes[:-1]) * along, axis=1) / np.sum(along**2, axis=1), 0.0, 1.0)
        return float(np.linalg.norm(nodes[:-1] + share[:, None] * along - point, axis=1).min())

    places = site_places(reading)
    assert len(places) == len(wires.site_wire) > 30
    for place, pair, seed in zip(places, wires.site_wire, wires.site_seed, strict=True):
        one, other = (distance(place, wire) for wire in pair)
        last = rods.wire_count[pair] - 1
        ends = position[rods.wire_first[pair] + np.clip(np.rint(seed).astype(int), 0, last)]
        assert one == pytest.approx(other, rel=1e-9)
        assert one + other <= (1.0 + 1e-9) * np.linalg.norm(ends[1] - ends[0])
