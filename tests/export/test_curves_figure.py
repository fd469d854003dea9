"""Curves of a run, and against temperature, are whole images; what they look like is for people to see."""

import math
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from reference.histories import history
from reference.images import check_image
from reference.in_words import quantities
from warpknit.export import curves_figure
from warpknit.export.curve_axes import JUMP, draw_curves, stage_slices
from warpknit.export.plots import scale_of
from warpknit.results.row import columns_of

pytestmark = pytest.mark.usefixtures("pictures")


def names_of(figure: Figure) -> list[str]:
    """Texts of the legends over the panels."""
    return [text.get_text() for legend in figure.legends for text in legend.get_texts()]


def dotted_in(figure: Figure) -> list[list[float]]:
    """Abscissas of the dotted lines of all panels."""
    return [np.asarray(line.get_xdata()).tolist() for axes in figure.axes for line in axes.lines if line.get_linestyle() == ":"]


@pytest.mark.parametrize(
    "rows",
    [history(10), history(10, warp=0.02), history(6, cold=5), history(1), history(5, weft=0.0, warp=0.0)],
    ids=["equal", "two strains", "stages", "one record", "no strain"],
)
def test_curves_figure(tmp_path: Path, rows: list[dict[str, object]]) -> None:
    check_image(curves_figure.curves_figure(columns_of(rows), tmp_path / "curves.png"))


def test_unrecorded_columns_are_said(tmp_path: Path) -> None:
    rows = [{"index": index, "strain_weft": 0.01 * index, "strain_warp": 0.0, "residual": math.nan} for index in range(3)]
    check_image(curves_figure.curves_figure(columns_of(rows), tmp_path / "curves.png"))


@pytest.mark.parametrize(
    ("rows", "label"),
    [
        (history(4), "strain, weft and warp [%]"),
        (history(4, warp=0.0), "weft strain [%], warp 0 %"),
        (history(4, weft=0.02), "warp strain [%], weft 0.5 to 2 %"),
        (history(4, weft=0.0, warp=0.0), "load factor"),
        (history(4, cold=3), "load step and its load factor"),
        (history(1), "strain, weft and warp [%]"),
    ],
)
def test_abscissa_is_what_varies(rows: list[dict[str, object]], label: str) -> None:
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0] if name != "stage"}
    stages = stage_slices([str(row["stage"]) for row in rows])
    values, given = curves_figure._abscissa(columns, stages)
    assert given == label and np.all(np.diff(values) > 0.0)


@pytest.mark.parametrize(
    ("largest", "scaled", "unit"),
    [(3400.0, 3.4, "kN/m"), (1.37, 1.37, "N/m"), (0.25, 250.0, "mN/m"), (2e-5, 20.0, "µN/m"), (0.0, 0.0, "N/m")],
)
def test_units_go_by_the_size_of_what_is_shown(largest, scaled, unit):
    scale, found = scale_of("N/m", np.array([0.0, -largest, np.nan]), np.array([np.nan]))
    assert (scale * largest, found) == (pytest.approx(scaled), unit)


def test_the_abscissa_is_the_tension_where_it_is_given() -> None:
    """Tensions that follow the load factor, and strains that do not: a run under tension; also in stages."""
    rows = history(6)
    for k, one in enumerate(rows):
        strain = 0.1 * np.sqrt(k / 5.0)
        one.update(load_factor=k / 5.0, strain_weft=strain, strain_warp=strain)
        one.update(tension_weft_N_per_m=0.4 * k, tension_warp_N_per_m=0.4 * k)
    columns = columns_of(rows)
    values, label = curves_figure._abscissa(columns, [("load", slice(0, 6))])
    assert label == "tension, weft and warp [N/m]" and values == pytest.approx(0.4 * np.arange(6))
    cut = {name: values[:5] for name, values in columns.items()}  # it diverged behind 80 % of its load
    assert curves_figure._abscissa(cut, [("load", slice(0, 5))])[1] == "tension, weft and warp [N/m]"
    columns["tension_warp_N_per_m"] *= 0.5
    assert curves_figure._abscissa(columns, [("load", slice(0, 6))])[1] == "mean tension of weft and warp [N/m]"
    columns["strain_weft"] = 0.02 * np.arange(6.0)
    assert "strain" in curves_figure._abscissa(columns, [("load", slice(0, 6))])[1]


def test_stages_at_different_temperatures_are_named_with_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    figures: list[Figure] = []
    monkeypatch.setattr(curves_figure, "save_figure", lambda figure, path: figures.append(figure) or path)
    more = [{**row, "stage": "more", "temperature_K": 83.15, "strain_weft": 0.2 + 0.01 * k} for k, row in enumerate(history(4))]
    rows = history(4) + more
    for shown in (rows, [{**row, "temperature_K": 293.15} for row in rows]):
        curves_figure.curves_figure(columns_of(shown), tmp_path / "curves.png")
    told, plain = ([text.get_text() for text in figure.legends[0].get_texts()] for figure in figures)
    assert told == ["load, 20 °C", "more, -190 °C"] and plain == ["load", "more"]


def test_curves_of_a_strain_that_goes_back_run_along_the_load() -> None:
    """Under given tensions a strain may fall while the load grows: over it the curves would cross themselves."""
    factor = np.linspace(0.0, 1.0, 5)
    stages = [("load", slice(0, 5))]
    for strain, label in (
        ([0.0, 0.01, 0.03, 0.02, 0.04], "load factor"),
        ([0.0, 0.01, 0.02, 0.03, 0.04], "strain, weft and warp [%]"),
    ):
        columns = {"strain_weft": np.array(strain), "strain_warp": np.array(strain), "load_factor": factor}
        assert curves_figure._abscissa(columns, stages)[1] == label


def test_a_line_over_a_jump_is_dotted_and_no_other() -> None:
    axes = Figure().subplots()
    x, jumped = np.arange(6.0), np.array([False, False, False, True, False, False])
    draw_curves(axes, x, [("load", slice(0, 6))], [("", "black", x**2)], jumped)
    drawn = [(line.get_linestyle(), np.asarray(line.get_xdata()).tolist()) for line in axes.lines]
    assert drawn == [("-", [0.0, 1.0, 2.0]), ("-", [3.0, 4.0, 5.0]), (":", [2.0, 3.0])]


@pytest.mark.parametrize(("share", "lines"), [(1.5, 1), (3.0, 0)])
def test_the_elastic_limit_is_named_on_the_axis_and_beyond(
    share: float, lines: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept: list[Figure] = []
    monkeypatch.setattr(curves_figure, "save_figure", lambda figure, path: kept.append(figure) or path)
    rows = [row | {"stress_max_Pa": 1e7 * k} for k, row in enumerate(history(11))]
    curves_figure.curves_figure(columns_of(rows), tmp_path / "curves.png", yield_stress=share * 1e8)
    axes = kept[0].axes[2]
    (label,) = [text.get_text() for text in axes.texts]
    assert quantities(label)[0] == f"{share * 100:g} MPa" and ("axis" in label) == (not lines)
    assert sum(line.get_linestyle() == "--" for line in axes.lines) == lines


@pytest.mark.parametrize(("inside", "labels"), [(0.2, ["anywhere", "away from the grips"]), (1.0, [])])
def test_stress_away_from_the_grips_is_drawn_where_it_differs(
    inside: float, labels: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept: list[Figure] = []
    monkeypatch.setattr(curves_figure, "save_figure", lambda figure, path: kept.append(figure) or path)
    rows = [row | {"stress_max_Pa": 1e8 * k, "stress_interior_max_Pa": inside * 1e8 * k} for k, row in enumerate(history(11))]
    curves_figure.curves_figure(columns_of(rows), tmp_path / "curves.png", yield_stress=8e8)
    axes = kept[0].axes[2]
    legend = axes.get_legend()
    assert [text.get_text() for text in (legend.get_texts() if legend is not None else ())] == labels
    drawn = [np.asarray(line.get_ydata())[-1] for line in axes.lines if line.get_linestyle() == "-"]
    assert drawn == pytest.approx([1.0, 0.2][: max(1, len(labels))])  # [GPa]


def test_contacts_elsewhere_are_drawn_where_there_are_some(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Their number on an axis of its own, as they are contacts and no pairs; shares of pairs reach 100 % at most."""
    kept: list[Figure] = []
    monkeypatch.setattr(curves_figure, "save_figure", lambda figure, path: kept.append(figure) or path)
    rows = [
        {
            **row,
            "active_pairs": 4 * k,
            "active_percent": 25.0 * k,
            "contacts_elsewhere": max(0, 10 * k - 10),
            "stress_max_Pa": 1e8,
        }
        for k, row in enumerate(history(4))
    ]
    curves_figure.curves_figure(columns_of(rows), tmp_path / "curves.png")
    curves_figure.curves_figure(columns_of([row | {"contacts_elsewhere": 0} for row in rows]), tmp_path / "curves.png")
    some, none = (figure.axes[0] for figure in kept)
    [right] = [axes for axes in kept[0].axes if "between stitches" in axes.get_ylabel()]
    told = [text.get_text() for axes in (some, right) for text in axes.get_legend().get_texts()]
    assert len(told) == 2 and "right axis" in told[1]
    assert none.get_legend() is None and len(none.lines) == 1 and len(kept[1].axes) == len(kept[0].axes) - 1
    [share], [count], [stress] = some.lines, right.lines, kept[0].axes[2].lines
    assert np.asarray(share.get_ydata()).tolist() == [0.0, 25.0, 50.0, 75.0]
    assert np.asarray(count.get_ydata()).tolist() == [0.0, 0.0, 10.0, 20.0] and right.get_ylim()[1] > 20.0
    assert len({line.get_color() for line in (share, count, stress)}) == 3


def test_a_logarithmic_axis_of_few_decades_has_more_than_one_label() -> None:
    """Residuals from 1.5e-5 to 8e-5 lie between two powers of ten."""
    figure = Figure()
    axes = figure.subplots()
    curve = ("", "black", np.array([1.5e-5, 3e-5, 8e-5]))
    draw_curves(axes, np.arange(3.0), [("load", slice(0, 3))], [curve], np.zeros(3, dtype=bool), least=0.0)
    figure.draw_without_rendering()
    low, high = axes.get_ylim()
    assert sum(bool(tick.label1.get_text()) and low <= tick.get_loc() <= high for tick in axes.yaxis.get_major_ticks()) >= 2


@pytest.mark.parametrize("behind", [None, 2, 6])
def test_the_legend_has_a_jump_where_a_dotted_line_is_drawn(
    behind: int | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Records 0 to 3 load the mesh, 4 to 7 cool it: their jump is in the figure of heat, and not in that of the load."""
    figures: list[Figure] = []
    monkeypatch.setattr(curves_figure, "save_figure", lambda figure, path: figures.append(figure) or path)
    rows = [row | {"jump": int(row["index"] == behind), "stress_max_Pa": 1e8} for row in history(4, cold=4)]
    for number, row in enumerate(rows[4:], 1):
        row |= {
            "temperature_K": 293.15 - 20.0 * number,
            "tension_weft_N_per_m": 2.0 + 0.1 * number,
            "strain_warp": 0.1 + 1e-4 * number,
        }
    curves_figure.curves_figure(columns_of(rows), tmp_path / "curves.png")
    curves_figure.heat_figure([columns_of(rows)], tmp_path / "heat.png")
    for figure, mine in zip(figures, (2, 6), strict=True):
        assert bool(dotted_in(figure)) == (JUMP in names_of(figure)) == (behind == mine)
    if behind == 6:
        assert dotted_in(figures[1])[0] == pytest.approx([-20.0, -40.0])


@pytest.mark.parametrize(("jump", "share"), [(0.05, 0.1), (0.0, 0.4)])
def test_a_jump_leaves_room_for_small_strains(jump: float, share: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Strains of 0.05 % before a jump of 5 % take a share of the height, in place of 1 %; all values are inside."""
    figures: list[Figure] = []
    monkeypatch.setattr(curves_figure, "save_figure", lambda figure, path: figures.append(figure) or path)
    base = history(1)[0]
    rows = [
        base | {"temperature_K": 293.15 - 20.0 * k, "strain_weft": 1e-4 * k + jump * (k > 5), "jump": int(k == 6 and jump > 0.0)}
        for k in range(11)
    ]
    curves_figure.heat_figure([columns_of(rows)], tmp_path / "heat.png")
    panel = figures[0].axes[2]
    height = panel.transAxes.inverted().transform(panel.transData.transform([(0.0, 100.0 * row["strain_weft"]) for row in rows]))
    assert np.ptp(height[:6, 1]) > share and np.all((height[:, 1] >= 0.0) & (height[:, 1] <= 1.0))
    assert ("logarithmic beyond" in panel.get_ylabel()) == (jump > 0.0) == (panel.get_yscale() == "symlog")


def test_strains_that_are_held_are_not_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A mesh in a frame, alone and beside one under a held tension: nothing but the word, and the curves of the other one."""
    figures: list[Figure] = []
    monkeypatch.setattr(curves_figure, "save_figure", lambda figure, path: figures.append(figure) or path)
    framed = [row | {"temperature_K": 293.15 + 10.0 * k, "stage": "frame held"} for k, row in enumerate(history(1) * 4)]
    free = [row | {"strain_weft": 1e-4 * k, "stage": "tension held"} for k, row in enumerate(framed)]
    for histories, lines, words in (([framed], 0, ["held"]), ([free, framed], 2, [])):
        curves_figure.heat_figure(list(map(columns_of, histories)), tmp_path / "heat.png")
        panel = figures[-1].axes[2]
        assert (
            sum(np.isfinite(line.get_ydata()).any() for line in panel.lines) == lines
            and [text.get_text() for text in panel.texts] == words
        )
        assert ("not held" in panel.get_ylabel()) == (lines > 0)


def test_change_of_strain_is_of_the_length_before_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """From 25 % to 25.5 % a mesh grows by 0.5/1.25 = 0.4 % of its length, which is what expansion tells."""
    figures: list[Figure] = []
    monkeypatch.setattr(curves_figure, "save_figure", lambda figure, path: figures.append(figure) or path)
    rows = [history(1)[0] | {"temperature_K": 293.15 + 10.0 * k, "strain_weft": 0.25 + 1e-3 * k} for k in range(6)]
    curves_figure.heat_figure([columns_of(rows)], tmp_path / "heat.png")
    assert np.asarray(figures[0].axes[2].lines[0].get_ydata()) == pytest.approx(0.08 * np.arange(6), abs=1e-9)


def test_marks_of_later_stages_are_smaller() -> None:
    """Curves of equal values lie on each other: marks beneath show about those above."""
    axes = Figure().subplots()
    stages = [("one", slice(0, 3)), ("other", slice(0, 3)), ("third", slice(0, 3))]
    draw_curves(axes, np.arange(3.0), stages, [("", "black", np.ones(3))], np.zeros(3, dtype=bool))
    assert np.all(np.diff([line.get_markersize() for line in axes.lines]) < 0.0)


@pytest.mark.parametrize(("first", "shown"), [(1e-13, 3), (1e-6, 4), (1e3, 4)])
def test_the_residual_of_an_unloaded_mesh_does_not_flatten_the_others(
    first: float, shown: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is left out if it is nearly nothing; a large one is always drawn."""
    figures: list[Figure] = []
    monkeypatch.setattr(curves_figure, "save_figure", lambda figure, path: figures.append(figure) or path)
    rows = [row | {"residual": value} for row, value in zip(history(4), (first, 1e-5, 2e-5, 1e-5), strict=True)]
    curves_figure.curves_figure(columns_of(rows), tmp_path / "curves.png")
    [line] = figures[0].axes[5].lines
    assert np.isfinite(np.asarray(line.get_ydata())).sum() == shown


def test_long_names_of_stages_are_inside_the_picture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    figures: list[Figure] = []
    monkeypatch.setattr(curves_figure, "save_figure", lambda figure, path: figures.append(figure) or path)
    cases = ("-190 degC, tension held", "120 degC, tension held", "-190 degC, frame held", "120 degC, frame held")
    histories = [
        [row | {"stage": name, "temperature_K": 200.0 + 50.0 * k, "jump": k} for k, row in enumerate(history(2))]
        for name in cases
    ]
    curves_figure.heat_figure(list(map(columns_of, histories)), tmp_path / "heat.png")
    figures[0].draw_without_rendering()
    box = figures[0].legends[0].get_window_extent()
    assert len(names_of(figures[0])) == 5 and figures[0].bbox.x0 <= box.x0 and box.x1 <= figures[0].bbox.x1
