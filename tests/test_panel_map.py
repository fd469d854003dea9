"""Maps over a panel, and the surface that its tension makes of it."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from reference.flat_panel import flat_map, held_rim
from reference.planar import planar_scene
from warpknit import measure
from warpknit.measure.surface import find_surface
from warpknit.measure.tiles import Tiles
from warpknit.mesh.rim import build_rim
from warpknit.planar.observables import find_panel_map, read
from warpknit.scene import Cord
from warpknit.scene.outline import Outline, disc, rectangle, turned
from warpknit.solve.model import build_model, initial_state
from warpknit.solve.simulate import Record, Simulation

LOAD = {"strain_weft": 0.1, "strain_warp": 0.08}


@cache
def stretched(kind: str = "planar") -> Record:
    table = {"knit": {"repeats": [5, 4]}, "load": LOAD, "solver": {"preset": "draft"}, "output": {"frames": 1}}
    model = build_model(planar_scene(table | {"model": {"kind": kind}, "contact": {"friction": 0.0}}))
    *_, last = Simulation(model, initial_state(model)).run()
    return last


@pytest.mark.parametrize("kind", ["planar", "spatial"])
def test_the_tiles_add_up_to_the_whole(kind: str) -> None:
    """Virials of the tiles are parts of one sum, and so are the pairs; mean slopes are those of the boundary, but for what the
    bodies of the outer tiles move from the affine prediction over the distance of these tiles."""
    reading = stretched(kind).observables
    found = reading.panel_map
    assert found is not None
    assert found.inside.shape == (5, 4)
    assert np.all(found.known)
    assert found.nominal.mean(axis=(0, 1)) == pytest.approx(reading.nominal_stress, rel=1e-9)
    assert found.stress_max.max() == pytest.approx(reading.wire_stress.node.max())
    moved = np.abs(reading.displacement).max(axis=0) / (found.tile * [4, 3])
    assert (np.abs(np.diag(found.gradient.mean(axis=(0, 1))) - [1.1, 1.08]) < moved).all()
    assert (moved < 0.03).all()
    assert found.area_share(np.ones((5, 4), dtype=bool)) == 1.0
    everywhere = found.tension[..., 0, 0] > 0.0
    assert found.area_share(everywhere) == pytest.approx(everywhere.mean())
    pairs = 2.0 * np.bincount(Tiles.of(reading.model).of_body, minlength=20).reshape(5, 4)
    assert np.sum(pairs * found.active_percent) / pairs.sum() == pytest.approx(measure.contacts(reading).active_percent)


def test_a_uniform_motion_in_space_is_a_uniform_map() -> None:
    """Wires that move by a linear field have its slope in every tile, but for the part of their curve between two nodes that only
    turns with them: of the bow of a segment, a tenth of a millimetre of the tile of 3.4 mm, the slope."""
    reading = stretched("spatial").observables
    slope = np.array([[0.02, 0.01, 0.0], [-0.005, 0.03, 0.0], [0.0, 0.0, 0.0]])
    rest = reading.model.rods.position
    affine = np.pad(reading.gradient, (0, 1))
    found = replace(reading, position=rest @ (affine + slope).T).panel_map
    change = found.gradient - reading.gradient
    assert change == pytest.approx(np.broadcast_to(slope[:2, :2], change.shape), abs=0.03 * 0.1 / 3.4)


@pytest.mark.parametrize("outline", ["rectangle", "hexagon"])
def test_a_uniform_motion_is_a_uniform_map(outline: str) -> None:
    """A mesh whose bodies move by a linear field, those of each kind by some more, has that slope in every tile that has a
    neighbour, at slanted edges too, where tiles hold some of the kinds only."""
    if outline == "rectangle":
        reading = stretched().observables
    else:
        model = build_model(planar_scene({"panel": {"outline": "hexagon", "size": 0.012, "rotation": 0.2}}))
        reading = read(model, initial_state(model))
    panel = reading.model.panel
    slope = np.array([[0.02, 0.01], [-0.005, 0.03]])
    place = panel.body_rest + panel.body_origin
    own = 1e-4 * np.random.default_rng(0).normal(size=(len(reading.model.cloth.clasps), 2))
    found = find_panel_map(replace(reading, body_u=place @ slope.T + own[panel.body_clasp]))
    assert np.all(found.inside > 0.99) == (outline == "rectangle")
    change = found.gradient[found.known] - reading.gradient
    assert change == pytest.approx(np.broadcast_to(slope, change.shape), abs=1e-12)


@pytest.mark.parametrize("tension", [np.eye(2), 7.0 * np.eye(2)])
def test_a_disc_held_on_a_paraboloid_stays_flat(tension: np.ndarray) -> None:
    """w is harmonic and R^2/(4 f) on the edge, so it is that everywhere: it misses the paraboloid by (R^2 - r^2)/(4 f), whose
    root mean square is R^2/(4 sqrt(3) f) and whose best fit by a plane is R^2/(4 f sqrt(12))."""
    radius, focal, spacing = 0.05, 3.0, 2.5e-3
    outline = disc(2.0 * radius)
    n = round(outline.length / spacing)
    surface = find_surface(
        flat_map(outline, spacing, tension), held_rim(outline, spacing), np.eye(2), np.zeros((n, 2)), np.zeros(2), focal
    )
    depth = radius**2 / (4.0 * focal)
    # a polygon of that spacing misses the circle by h^2/(8 R), linear triangles the paraboloid by h^2/(16 f)
    error = spacing**2 / radius**2
    assert surface.area.sum() == pytest.approx(np.pi * radius**2, rel=error)
    assert surface.pillowing == pytest.approx(depth, rel=2 * error)
    assert surface.rms_deviation == pytest.approx(depth / np.sqrt(3.0), rel=4 * error)
    assert surface.rms_best_fit == pytest.approx(depth / np.sqrt(12.0), rel=4 * error)


def test_tension_one_way_hangs_straight_that_way() -> None:
    """With next to no tension across, each line along weft is straight between its ends: w = (a^2 + y^2)/(4 f) on a square."""
    side, focal, spacing = 0.04, 2.0, 1e-3
    outline = rectangle(side, side)
    n = round(outline.length / spacing)
    tension = np.diag([1.0, 0.002])
    surface = find_surface(
        flat_map(outline, spacing, tension), held_rim(outline, spacing), np.eye(2), np.zeros((n, 2)), np.zeros(2), focal
    )
    _, y = surface.point.T
    inner = np.abs(y) < 0.3 * side  # away from the edges along weft, by more than side sqrt(0.002)
    expected = (0.25 * side**2 + y**2) / (4.0 * focal)
    assert surface.height[inner] == pytest.approx(expected[inner], abs=0.02 * side**2 / (4.0 * focal))


@pytest.mark.parametrize("shear", [0.5, -0.5])
def test_shear_tension_tilts_the_surface_of_a_slanted_ellipse(shear: float) -> None:
    """On the ellipse x . Q x = 1 the paraboloid r^2/(4 f) is that of w = (r^2 + h (1 - x . Q x))/(4 f) for any h, and
    div(N grad w) = 0 asks for h = tr N / tr(N Q). With Q slanted by 45 degrees, h depends on the sign of N_xy. Triangles of
    side s across the half axes a, b miss it by s^2/(a b)."""
    a, b, focal, spacing = 0.04, 0.02, 2.0, 1e-3
    angle = 2.0 * np.pi * np.arange(240) / 240
    outline = turned(Outline(np.stack([a * np.cos(angle), b * np.sin(angle)], axis=1)), np.pi / 4)
    axes = np.array([[1.0, -1.0], [1.0, 1.0]]) / np.sqrt(2.0)
    q = axes @ np.diag([a**-2, b**-2]) @ axes.T
    tension = np.array([[1.0, shear], [shear, 0.8]])
    n = round(outline.length / spacing)
    surface = find_surface(
        flat_map(outline, spacing, tension), held_rim(outline, spacing), np.eye(2), np.zeros((n, 2)), np.zeros(2), focal
    )
    height = np.trace(tension) / np.trace(tension @ q)
    x = surface.point
    expected = (np.sum(x**2, axis=1) + height * (1.0 - np.einsum("pa,ab,pb->p", x, q, x))) / (4.0 * focal)
    assert surface.height == pytest.approx(expected, abs=2 * spacing**2 / (a * b) * expected.max())
    assert height == pytest.approx(1.8 / (0.9 * (a**-2 + b**-2) + shear * (a**-2 - b**-2)))


def test_the_tension_of_a_tile_is_the_force_per_current_width_under_shear() -> None:
    """P F^T / det F with the tile's own P and F, by its components. Under a shear of 0.1 P F, P^T F and P F^T differ."""
    table = {"knit": {"repeats": [4, 4]}, "load": {**LOAD, "shear": 0.1}, "solver": {"preset": "draft"}, "output": {"frames": 1}}
    model = build_model(planar_scene(table))
    *_, last = Simulation(model, initial_state(model)).run()
    found = find_panel_map(last.observables)
    assert found.gradient[..., 0, 1].mean() == pytest.approx(0.1, abs=0.02)
    for tile in np.ndindex(4, 4):
        p, f = found.nominal[tile], found.gradient[tile]
        across = [[p[i, 0] * f[j, 0] + p[i, 1] * f[j, 1] for j in range(2)] for i in range(2)]
        size = f[0, 0] * f[1, 1] - f[0, 1] * f[1, 0]
        assert found.tension[tile] == pytest.approx(np.array(across) / size, rel=1e-12)
    scale = np.abs(found.tension).max()
    assert np.abs(found.nominal[..., 0, 1] - found.nominal[..., 1, 0]).max() > 0.02 * scale  # the forms are told apart


def test_a_taut_cord_runs_straight_between_net_nodes() -> None:
    side, focal, spacing = 0.04, 2.0, 2e-3
    outline = rectangle(side, side)
    n = round(outline.length / spacing)
    given = np.zeros(n, dtype=bool)
    given[:: n // 4] = True
    rim = held_rim(outline, spacing, given, Cord(tension=1e6, stiffness=1.0))
    surface = find_surface(flat_map(outline, spacing, np.eye(2)), rim, np.eye(2), np.zeros((n, 2)), np.zeros(2), focal)
    corner = 2.0 * (0.5 * side) ** 2 / (4.0 * focal)
    assert surface.height == pytest.approx(np.full(len(surface.height), corner), rel=1e-6)


@pytest.mark.parametrize("kind", ["planar", "spatial"])
def test_a_gripped_panel_reports_what_its_thresholds_ask_for(kind: str) -> None:
    from warpknit.runner.summary import panel_of

    record = stretched(kind)
    model = record.observables.model
    options = replace(model.scene.panel, tension_threshold=1e9, active_threshold=0.0, focal_length=1.0)
    reading = replace(record.observables, model=replace(model, scene=replace(model.scene, panel=options)))
    tables, summary = panel_of(replace(record, observables=reading))
    assert summary is not None
    assert summary["area_below_tension_percent"] == pytest.approx(100.0)
    assert summary["area_below_active_percent"] == 0.0
    assert summary["area_m2"] == model.panel.area
    assert 0.0 < summary["surface"]["rms_deviation_m"] < summary["surface"]["pillowing_m"]
    assert len({len(column) for column in tables["map"].values()}) == 1
    rim = build_rim(model.panel, model.scene)
    assert len(tables["surface"]["x_m"]) > len(rim.arc)
    # the tiles and the edge are drawn as strained: the tiles' far corners reach the edge of the panel
    tiles = tables["map"]
    stretch = np.diag(reading.gradient)
    assert tiles["x_m"] == pytest.approx(stretch[0] * tiles["weft_m"])
    half = 0.5 * stretch * model.panel.size
    assert (tables["edge"]["x_m"].max(), tables["edge"]["y_m"].min()) == pytest.approx((half[0], -half[1]))
    assert tables["edge"]["held"].all()
