"""Pictures of contact maps: read back from the file."""

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import LineCollection, QuadMesh
from matplotlib.contour import QuadContourSet
from matplotlib.image import imread
from matplotlib.transforms import Bbox

from reference.in_words import quantities
from warpknit.export import map_figure as module
from warpknit.export.map_figure import Marks, map_figure

pytestmark = pytest.mark.usefixtures("pictures")

STRAINS = [0.0, 0.05, 0.1]
RISING = np.add.outer(np.arange(3.0), np.arange(3.0)) * 20.0
LIMIT = (0xD5 / 255, 0x5E / 255, 0.0)
BLANK = (0xE8 / 255, 0xE8 / 255, 0xE8 / 255)


def share_of(colour: tuple[float, float, float], path: Path) -> float:
    """Share of the picture in a colour."""
    picture = imread(path)[..., :3]
    return float(np.mean(np.all(np.abs(picture - colour) < 1 / 255, axis=2)))


def test_colours_of_forces_end_little_above_the_elastic_limit(tmp_path, monkeypatch):
    """A few cells far beyond it do not leave the others in one colour; the axis says so, and its unit follows what it shows."""
    drawn = []
    monkeypatch.setattr(module, "save_figure", lambda figure, path: drawn.append(figure))
    tension = np.array([[0.0, 0.01, 0.02], [0.1, 0.2, 0.3], [0.1, 50.0, 1000.0]])
    stress = np.array([[0.0, 1e8, 2e8], [3e8, 4e8, 5e8], [7e8, 3e9, np.nan]])
    marks = Marks(stress=stress, yield_stress=6e8, optimum=None)
    map_figure(tmp_path / "a.png", STRAINS, STRAINS, tension, title="", label="weft tension", unit="N/m", marks=marks)
    (tiles,) = [item for item in drawn[0].axes[0].collections if isinstance(item, QuadMesh)]
    assert tiles.get_clim() == pytest.approx((0.0, 1e3 * 0.3 * module.BEYOND_LIMIT))
    assert tiles.colorbar.extend == "max" and tiles.colorbar.ax.get_ylabel() == "weft tension [mN/m]"


def draw(path: Path, values: np.ndarray, limit: float = 1e9, optimum: tuple[float, float] | None = None) -> Path:
    marks = Marks(stress=np.where(np.isnan(values), np.nan, RISING * 1e6), yield_stress=limit, optimum=optimum)
    strains = STRAINS[: values.shape[0]]
    return map_figure(path, STRAINS, strains, values, title="a mesh", label="share", unit="% of pairs", marks=marks)


def test_the_elastic_limit_is_drawn_where_it_runs_through_the_map(tmp_path):
    """Stress goes from 0 to 80 MPa: a limit of 30 MPa is a line on the map, one of 1 GPa is nowhere."""
    assert share_of(LIMIT, draw(tmp_path / "a.png", RISING, limit=30e6)) > 1e-3
    assert share_of(LIMIT, draw(tmp_path / "b.png", RISING, limit=1e9)) == 0.0


def test_a_cell_above_the_elastic_limit_is_hatched_beside_a_jump_too(tmp_path, monkeypatch):
    """The middle cell alone is above the limit, and jumps to a neighbour: no line, but hatched, and named so."""
    drawn = []
    monkeypatch.setattr(module, "save_figure", lambda figure, path: drawn.append(figure))
    stress, (low, middle) = np.full((3, 3), 1e8), STRAINS[:2]
    stress[1, 1] = 7e8
    marks = Marks(stress=stress, yield_stress=6e8, optimum=None, jumps=[((middle, middle), (low, middle))])
    map_figure(tmp_path / "a.png", STRAINS, STRAINS, RISING, title="", label="share", unit="% of pairs", marks=marks)
    hatched = [patch for patch in drawn[0].axes[0].patches if patch.get_hatch()]
    assert len(hatched) == 1 and hatched[0].get_window_extent().contains(
        *drawn[0].axes[0].transData.transform([100 * middle] * 2)
    )
    texts = [text.get_text() for legend in drawn[0].legends + [drawn[0].axes[0].get_legend()] if legend for text in legend.texts]
    assert ["600 MPa"] in map(quantities, texts)


@pytest.mark.parametrize(("limit", "lines"), [(30e6, 1), (1e9, 0)])
def test_the_legend_has_the_line_of_the_elastic_limit_where_it_is_drawn(limit, lines, tmp_path, monkeypatch):
    """Beside the cells above it, which begin elsewhere: at an edge of a cell, not between two middles."""
    drawn = []
    monkeypatch.setattr(module, "save_figure", lambda figure, path: drawn.append(figure))
    draw(tmp_path / "a.png", RISING, limit=limit)
    axes = drawn[0].axes[0]
    shown = [item for item in axes.collections if isinstance(item, QuadContourSet) and item.levels.tolist() == [limit]]
    named = [handle for handle in axes.get_legend().legend_handles if str(handle.get_label()).startswith("elastic limit")]
    assert len(shown) == len(named) == lines
    assert all(handle.get_color() == module.LIMIT_COLOUR for handle in named)


def test_cells_without_a_value_stay_blank(tmp_path):
    """The middle cell of nine, those at the edges being shown by half: a quarter of the map, about 0.55 of the picture."""
    holed = RISING.copy()
    holed[1, 1] = np.nan
    assert share_of(BLANK, draw(tmp_path / "a.png", RISING)) < 1e-4  # edges of letters
    assert share_of(BLANK, draw(tmp_path / "b.png", holed)) == pytest.approx(0.55 / 4, rel=0.25)


@pytest.mark.parametrize("values", [np.zeros((3, 3)), np.full((3, 3), np.nan)])
def test_maps_without_contrast_are_drawn(tmp_path, values):
    assert draw(tmp_path / "a.png", values, optimum=(0.05, 0.05)).stat().st_size > 0


def test_lines_of_a_share_run_along_the_edges_of_cells(tmp_path, monkeypatch):
    """A line of 50 % lies on the edge between two cells if one of them reaches 50 % and the other does not, and on no other."""
    drawn = []
    monkeypatch.setattr(module, "FEW_LOADS", 0)
    monkeypatch.setattr(module, "save_figure", lambda figure, path: drawn.append(figure))
    shares = np.array([[0.0, 45.0, 90.0], [45.0, 90.0, 90.0], [10.0, 60.0, 100.0]])
    draw(tmp_path / "a.png", shares)
    (lines,) = [item for item in drawn[0].axes[0].collections if isinstance(item, QuadContourSet)]
    (path,) = [path for level, path in zip(lines.levels, lines.get_paths(), strict=True) if level == 50.0]
    middle = 100.0 * np.array(STRAINS)
    for row, column in np.ndindex(3, 3):
        for other in ((row + 1, column), (row, column + 1)):
            if max(other) < 3:
                between = 0.5 * np.array([middle[column] + middle[other[1]], middle[row] + middle[other[0]]])
                is_edge = (shares[row, column] >= 50.0) != (shares[other] >= 50.0)
                assert distance(path, between) < 0.01 if is_edge else distance(path, between) > 1.0


@pytest.mark.parametrize("unit", ["% of pairs", "Pa"])
def test_values_of_few_loads_stand_beside_them(unit, tmp_path, monkeypatch):
    """One for each load that is known, on its side of the map; larger maps have lines instead."""
    drawn = []
    monkeypatch.setattr(module, "save_figure", lambda figure, path: drawn.append(figure))
    holed = np.where(RISING == RISING[1, 1], np.nan, RISING)
    for values in (holed, np.arange(49.0).reshape(7, 7)):
        axis = np.linspace(0.0, 0.1, len(values))
        marks = Marks(stress=values, yield_stress=1e9, optimum=None)
        map_figure(tmp_path / "a.png", axis, axis, values, title="", label="", unit=unit, marks=marks)
    few, many = (figure.axes[0] for figure in drawn)
    found = {tuple(np.round(text.xy, 6)): float(text.get_text()) for text in few.texts}
    expected = {(5.0 * j, 5.0 * i): holed[i, j] for i, j in np.ndindex(3, 3) if np.isfinite(holed[i, j])}
    assert found == pytest.approx(expected)
    few.figure.draw_without_rendering()
    assert all(few.bbox.contains(*corner) for text in few.texts for corner in text.get_window_extent().corners())
    assert not any(isinstance(item, QuadContourSet) for item in few.collections)
    assert any(isinstance(item, QuadContourSet) for item in many.collections)


def distance(path, place: np.ndarray) -> float:
    """From a place to the segments of a path."""
    begin, end = path.vertices[:-1], path.vertices[1:]
    along = end - begin
    share = np.clip(np.sum((place - begin) * along, axis=1) / np.maximum(np.sum(along**2, axis=1), 1e-30), 0.0, 1.0)
    return float(np.linalg.norm(begin + share[:, None] * along - place, axis=1).min())


@pytest.mark.parametrize("unit", ["% of pairs", "Pa"])
@pytest.mark.parametrize("cells", [4, 6, 11])
def test_names_of_lines_are_read_at_a_glance(tmp_path, monkeypatch, cells: int, unit: str):
    """In maps full of lines and marks the boxes of the names are inside the map, and meet neither each other nor a mark."""
    drawn = []
    monkeypatch.setattr(module, "FEW_LOADS", 0)
    monkeypatch.setattr(module, "save_figure", lambda figure, path: drawn.append(figure))
    strains = np.linspace(0.0, 0.1, cells)
    values = 100.0 * np.random.default_rng(cells).random((cells, cells))
    jumps = [((at, at), (at, other)) for at, other in zip(strains[1:], strains, strict=False)]
    marks = Marks(stress=1e6 * values, yield_stress=60e6, optimum=(strains[-1], strains[1]), jumps=jumps)
    map_figure(tmp_path / "a.png", strains, strains, values, title="", label="", unit=unit, marks=marks)
    drawn[-1].draw_without_rendering()
    axes = drawn[-1].axes[0]
    names = [label.get_window_extent() for label in axes.texts if label.get_visible()]
    marked = [
        Bbox([place - reach, place + reach])
        for line in axes.get_lines()
        for reach in [0.5 * line.get_markersize() * drawn[-1].dpi / 72.0]
        for place in axes.transData.transform(line.get_xydata())
    ]
    assert len(names) > 1
    assert all(axes.bbox.contains(*corner) for name in names for corner in name.corners())
    assert not any(one.overlaps(other) for one, other in combinations(names, 2))
    assert not any(name.overlaps(mark) for name in names for mark in marked)


def test_the_legend_names_what_is_outside_the_map_and_what_limits_the_optimum(tmp_path, monkeypatch):
    """One service tension has its marker in the map, the other a cross that is not in the map."""
    drawn = []
    monkeypatch.setattr(module, "save_figure", lambda figure, path: drawn.append(figure))
    marks = Marks(
        stress=RISING * 1e6, yield_stress=1e9, optimum=(0.05, 0.05), optimum_note=", beside a snap-through",
        places=(("2 N/m", None, 50.0), ("1 N/m", (0.05, 0.1), 50.0)),
    )  # fmt: skip
    map_figure(tmp_path / "a.png", STRAINS, STRAINS, RISING, title="", label="share", unit="% of pairs", marks=marks)
    legend = drawn[0].axes[0].get_legend()
    shown = dict(zip([text.get_text() for text in legend.get_texts()], legend.legend_handles, strict=True))
    (outside,) = [handle for label, handle in shown.items() if label.startswith("2 N/m")]
    assert outside.get_marker() == "x" and shown["1 N/m"].get_marker() == "o"
    assert [line.get_marker() for line in drawn[0].axes[0].get_lines()].count("x") == 0
    (optimum,) = [label for label in shown if label.startswith("optimum")]
    assert quantities(optimum) == ["5 %", "5 %"] and optimum.endswith(marks.optimum_note)


def test_no_line_of_equal_value_runs_through_a_cell_with_a_jump() -> None:
    x = y = np.array([0.0, 2.0, 4.0])
    marks = Marks(stress=np.zeros((3, 3)), yield_stress=1.0, optimum=None, jumps=[((0.02, 0.04), (0.04, 0.04))])
    shown = module._smooth(np.arange(9.0).reshape(3, 3), x, y, marks, 100.0)
    assert np.argwhere(np.ma.getmaskarray(shown)).tolist() == [[2, 1], [2, 2]]


def test_each_line_of_a_stress_has_its_own_value(tmp_path, monkeypatch):
    """204 MPa below and 608 MPa above: lines of 300, 400, 500 and 600 MPa lie where a straight line between both has them."""
    drawn = []
    monkeypatch.setattr(module, "FEW_LOADS", 0)
    monkeypatch.setattr(module, "save_figure", lambda figure, path: drawn.append(figure))
    stress = 1e6 * np.array([[0.0, 0.0, 0.0], [204.0, 204.0, 204.0], [608.0, 608.0, 608.0]])
    marks = Marks(stress=stress, yield_stress=1e9, optimum=None)
    map_figure(tmp_path / "a.png", STRAINS, STRAINS, stress, title="", label="stress", unit="Pa", marks=marks)
    axes = drawn[0].axes[0]
    (lines,) = [item for item in axes.collections if isinstance(item, QuadContourSet)]
    places = {level: path.vertices[:, 1].mean() for level, path in zip(lines.levels, lines.get_paths(), strict=True)}
    assert {300.0, 400.0, 500.0, 600.0} <= set(places)
    for level in (300.0, 400.0, 500.0, 600.0):
        assert places[level] == pytest.approx(5.0 + 5.0 * (level - 204.0) / 404.0, abs=0.01)
    named = {float(label.get_text()): label.get_position()[1] for label in axes.texts}
    assert named and all(place == pytest.approx(places[level], abs=0.01) for level, place in named.items())


def test_a_mark_in_a_corner_hides_no_tick_label(tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(module, "save_figure", lambda figure, path: drawn.append(figure))
    draw(tmp_path / "a.png", RISING, optimum=(0.0, 0.0))
    drawn[0].draw_without_rendering()
    axes = drawn[0].axes[0]
    star = axes.transData.transform((0.0, 0.0)) + 0.5 * 15.0 * drawn[0].dpi / 72.0 * np.array([[-1.0, -1.0], [1.0, 1.0]])
    labels = [*axes.get_xticklabels(), *axes.get_yticklabels()]
    assert not any(label.get_window_extent().overlaps(Bbox(star)) for label in labels if label.get_text())


def test_lines_that_would_merge_are_left_out(tmp_path, monkeypatch):
    """A stress that rises by 800 MPa within a fortieth of the map: seven lines within the height of a name are one."""
    drawn = []
    monkeypatch.setattr(module, "save_figure", lambda figure, path: drawn.append(figure))
    strains = np.linspace(0.0, 0.1, 41)
    stress = np.repeat(np.where(strains > 0.05, 8e8, 0.0)[:, None], 41, axis=1)
    marks = Marks(stress=stress, yield_stress=1e9, optimum=None)
    map_figure(tmp_path / "a.png", strains, strains, stress, title="", label="stress", unit="Pa", marks=marks)
    (lines,) = [item for item in drawn[0].axes[0].collections if isinstance(item, QuadContourSet)]
    assert len(lines.levels) == 1


def test_stubs_of_lines_are_left_out(tmp_path, monkeypatch):
    """Values rise along the diagonal: of the lines of 0.4, 5 and 9.6 cells the first and the last cut a corner in 0.57 cells."""
    drawn = []
    monkeypatch.setattr(module, "FEW_LOADS", 0)
    monkeypatch.setattr(module, "save_figure", lambda figure, path: drawn.append(figure))
    monkeypatch.setattr(module.MaxNLocator, "tick_values", lambda self, low, high: np.array([0.4, 5.0, 9.6]))
    cells = np.arange(6.0)
    marks = Marks(stress=np.full((6, 6), 1.0), yield_stress=10.0, optimum=None)
    map_figure(tmp_path / "a.png", cells, cells, np.add.outer(cells, cells), title="", label="", unit="", marks=marks)
    (lines,) = [item for item in drawn[0].axes[0].collections if isinstance(item, QuadContourSet)]
    pieces = [len(path.to_polygons(closed_only=False)) for path in lines.get_paths()]
    assert dict(zip(lines.levels.tolist(), pieces, strict=True))[5.0] == 1 and sum(pieces) == 1


def test_jumps_are_the_edges_between_their_cells(tmp_path, monkeypatch) -> None:
    """Of 12 jumps along weft and warp as many edges, each half way between the two cells and as long as they are wide."""
    drawn = []
    monkeypatch.setattr(module, "save_figure", lambda figure, path: drawn.append(figure))
    cells = [(one, other) for one in STRAINS for other in STRAINS]
    pairs = [(a, b) for a, b in combinations(cells, 2) if np.isclose(np.ptp([a, b], axis=0).sum(), 0.05)]
    marks = Marks(stress=RISING, yield_stress=1e9, optimum=None, jumps=pairs)
    map_figure(tmp_path / "a.png", STRAINS, STRAINS, RISING, title="", label="share", unit="% of pairs", marks=marks)
    axes = drawn[0].axes[0]
    (edges,) = [item for item in axes.collections if isinstance(item, LineCollection) and not isinstance(item, QuadContourSet)]
    assert len(pairs) == len(edges.get_segments()) == 12
    for segment, pair in zip(edges.get_segments(), 100.0 * np.array(pairs), strict=True):
        assert segment.mean(axis=0) == pytest.approx(pair.mean(axis=0))
        assert np.linalg.norm(segment[1] - segment[0]) == pytest.approx(5.0)
        assert np.dot(segment[1] - segment[0], pair[1] - pair[0]) == pytest.approx(0.0)
    assert not [line for line in axes.get_lines() if line.get_marker() == "x"]


def test_a_line_of_several_levels_has_the_name_of_the_highest(tmp_path, monkeypatch) -> None:
    """From 0 to 60 % at one edge: the line of 10, 25 and 50 % is named 50 %."""
    drawn = []
    monkeypatch.setattr(module, "FEW_LOADS", 0)
    monkeypatch.setattr(module, "save_figure", lambda figure, path: drawn.append(figure))
    draw(tmp_path / "a.png", np.array([[0.0, 60.0, 60.0]] * 3))
    assert [text.get_text() for text in drawn[0].axes[0].texts if text.get_visible()] == ["50 %"]


def test_colours_between_loads_are_those_of_the_lines(tmp_path, monkeypatch):
    """Where all loads are known and none jumps; else, and for shares, a tile is one load."""
    drawn = []
    monkeypatch.setattr(module, "FEW_LOADS", 0)
    monkeypatch.setattr(module, "save_figure", lambda figure, path: drawn.append(figure))
    holed = np.where(RISING == RISING[1, 1], np.nan, RISING)
    jumps = [((STRAINS[0], STRAINS[0]), (STRAINS[1], STRAINS[0]))]
    for values, unit, pairs in ((RISING, "Pa", []), (RISING, "Pa", jumps), (holed, "Pa", []), (RISING, "% of pairs", [])):
        marks = Marks(stress=RISING, yield_stress=1e9, optimum=None, jumps=pairs)
        map_figure(tmp_path / "a.png", STRAINS, STRAINS, values, title="", label="", unit=unit, marks=marks)
    tiles = [next(one for one in figure.axes[0].collections if isinstance(one, QuadMesh)) for figure in drawn]
    assert [one._shading for one in tiles] == ["gouraud", "flat", "flat", "flat"]
    assert np.asarray(tiles[0].get_array()).reshape(3, 3) == pytest.approx(RISING)


def test_a_map_of_one_value_says_it(tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(module, "FEW_LOADS", 0)
    monkeypatch.setattr(module, "save_figure", lambda figure, path: drawn.append(figure))
    marks = Marks(stress=RISING, yield_stress=1e9, optimum=None, is_assumed=True)
    for values in (np.zeros((3, 3)), RISING):
        map_figure(tmp_path / "a.png", STRAINS, STRAINS, values, title="", label="", unit="%", marks=marks)
    assert [quantities(text.get_text()) for text in drawn[0].axes[0].texts] == [["0 %"]]
    assert "(assumed)" in drawn[1].axes[0].get_legend().get_texts()[-1].get_text()
