"""Pictures of a report against the tension."""

import itertools
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from warpknit.export import curve_axes, curves_figure, design_figures
from warpknit.results.row import Values, columns_of, valued

pytestmark = pytest.mark.usefixtures("pictures")


def test_the_axis_of_tension_ends_little_above_the_elastic_limit(tmp_path, monkeypatch):
    """Tension 2 N/m where the stress passes the limit, 1000 N/m behind it; the curves that stay below it carry less."""
    drawn = []
    monkeypatch.setattr(design_figures, "save_figure", lambda figure, path: drawn.append(figure))
    beyond = {"stress_max_Pa": [0.0, 5e8, 7e8, 9e9], "tension_weft_N_per_m": [0.0, 1.0, 3.0, 1000.0]}
    below = {"stress_max_Pa": [0.0, 1e8, 2e8, np.nan], "tension_weft_N_per_m": [0.0, 0.5, 1.0, np.nan]}
    curves = {}
    for load, curve in (("both", beyond), ("weft_alone", below)):
        strains = {f"strain_{side}": np.linspace(0.0, 0.1, 4) for side in ("weft", "warp")}
        columns = {name: np.array(values) for name, values in curve.items()} | strains
        curves[load] = columns | {"tension_warp_N_per_m": np.zeros(4), "jump": np.zeros(4)}
    design_figures.tension_strain_figure(curves, tmp_path / "a.png", yield_stress=6e8)
    top = design_figures.BEYOND_LIMIT * 2.0
    assert drawn[0].axes[0].get_ylim() == pytest.approx((-design_figures.ROOM * top, (1.0 + design_figures.ROOM) * top))


def test_curves_of_a_report_are_dotted_over_jumps_as_those_of_a_run(tmp_path, monkeypatch) -> None:
    """The mesh jumps between 1 and 2 % strain; the legend names the dots only then."""
    drawn = []
    monkeypatch.setattr(design_figures, "save_figure", lambda figure, path: drawn.append(figure) or path)
    names = ("tension_weft_N_per_m", "tension_warp_N_per_m", "stress_max_Pa", "active_percent")
    names += ("sheet_resistance_weft_ohm", "sheet_resistance_warp_ohm", "strain_weft", "strain_warp")
    for jump, dotted in (([0, 0, 1, 0], 2), ([0, 0, 0, 0], 0)):
        curve = {name: 0.01 * np.arange(1.0, 5.0) for name in names} | {"jump": np.array(jump, dtype=float)}
        design_figures.tension_strain_figure({"both": curve}, tmp_path / "curves.png", yield_stress=6e8)
        design_figures.resistance_figure(curve, tmp_path / "resistance.png")
        for figure in drawn[-2:]:
            lines = [line for line in figure.axes[0].lines if line.get_linestyle() == ":"]
            assert [np.asarray(line.get_xdata()).tolist() for line in lines] == [pytest.approx([2.0, 3.0])] * dotted
            texts = [text.get_text() for text in figure.legends[0].get_texts()]
            assert texts.count("snap-through to another equilibrium") == bool(dotted) and len(set(texts)) == len(texts)


def test_the_axis_of_tension_begins_where_contacts_change(tmp_path, monkeypatch) -> None:
    """Half the tension of the last record before the first change of the active share."""
    shown = []
    monkeypatch.setattr(design_figures, "save_figure", lambda figure, path: shown.append(figure.axes[0].get_xlim()) or path)
    rows = [
        {"tension_weft_N_per_m": t, "tension_warp_N_per_m": t, "active_percent": 10.0 * (t > 1.0), "stress_max_Pa": 1e8 * t}
        for t in (1e-3, 1e-2, 1e-1, 1.0, 2.0, 4.0)
    ]
    answers = {"contacts": [], "best": None}
    design_figures.tension_figure(columns_of(rows), valued(answers), tmp_path / "tension.png", yield_stress=6e8)
    assert shown[0][0] == pytest.approx(0.5) and shown[0][1] > 4.0


def test_service_tensions_have_most_of_the_axis_of_tension(tmp_path, monkeypatch) -> None:
    """Records from 1 mN/m to 1 kN/m, contacts that close at 2 mN/m, first yield at 6 N/m: the axis ends at 1.5 times that and
    begins at 1/20 of its end, where 2 to 6 N/m take log(3)/log(20), 37 % of it."""
    shown = []
    monkeypatch.setattr(design_figures, "save_figure", lambda figure, path: shown.append(figure.axes[0].get_xlim()) or path)
    rows = [
        {"tension_weft_N_per_m": t, "tension_warp_N_per_m": t, "active_percent": 10.0 * k, "stress_max_Pa": 1e8 * t}
        for k, t in enumerate(np.geomspace(1e-3, 1e3, 25).tolist())
    ]

    def state(tension: float) -> dict[str, float]:
        return {"tension_weft_N_per_m": tension, "tension_warp_N_per_m": tension}

    service = [{"tension_N_per_m": t, "state": state(t)} for t in (2.0, 3.4)] + [{"tension_N_per_m": 50.0, "state": None}]
    answers = {"contacts": [{"name": "A", "closes": state(2e-3)}], "best": None, "first_yield": state(6.0), "service": service}
    rows = [row | {"active_A_percent": row["active_percent"]} for row in rows]
    design_figures.tension_figure(columns_of(rows), valued(answers), tmp_path / "tension.png", yield_stress=6e8)
    end = design_figures.BEYOND_LIMIT * 6.0
    room = design_figures.LONGEST_AXIS**design_figures.ROOM
    assert shown[0] == pytest.approx((end / design_figures.LONGEST_AXIS, end * room))
    best = {**state(0.1), "low": state(0.05), "high": state(0.2)}
    design_figures.tension_figure(columns_of(rows), valued(answers | {"best": best}), tmp_path / "tension.png", yield_stress=6e8)
    assert shown[1][0] == pytest.approx(design_figures.BEFORE * 0.1)  # the best tension is always shown


@pytest.mark.parametrize("least", [1.0, 0.1, 0.01, 7.5e-4])
def test_labels_of_the_axis_of_tension_do_not_overlap(least: float, tmp_path, monkeypatch) -> None:
    drawn = []
    monkeypatch.setattr(design_figures, "save_figure", lambda figure, path: drawn.append(figure) or path)
    rows = [
        {"tension_weft_N_per_m": t, "tension_warp_N_per_m": t, "active_percent": 10.0 * k, "stress_max_Pa": 1e8 * t}
        for k, t in enumerate(np.geomspace(least, 7.4, 9).tolist())
    ]
    design_figures.tension_figure(columns_of(rows), Values(contacts=[], best=None), tmp_path / "tension.png", yield_stress=6e8)
    drawn[0].draw_without_rendering()
    axes = drawn[0].axes[0]
    low, high = axes.get_xlim()
    labels = [*axes.get_xticklabels(), *axes.get_xticklabels(minor=True)]
    labels = [label for label in labels if label.get_text() and low <= label.get_position()[0] <= high]
    boxes = sorted((label.get_window_extent() for label in labels), key=lambda box: box.x0)
    assert len(boxes) > 1
    assert all(one.x1 < other.x0 for one, other in itertools.pairwise(boxes))


@pytest.mark.parametrize("count", [4, 10])
def test_shares_of_classes_that_are_equal_show_beside_each_other(
    count: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each line is narrower than those beneath it, and no two look alike."""
    figures: list[Figure] = []
    monkeypatch.setattr(design_figures, "save_figure", lambda figure, path: figures.append(figure) or path)
    names = "ABCDEFGHIJ"[:count]
    shares = {f"active_{name}_percent": 100.0 for name in names} | {"active_percent": 100.0}
    rows = [{"tension_weft_N_per_m": t, "tension_warp_N_per_m": t, "stress_max_Pa": 1e8 * t} | shares for t in (1.0, 2.0)]
    answers = {"contacts": [{"name": name, "closes": None} for name in names], "best": None}
    design_figures.tension_figure(columns_of(rows), valued(answers), tmp_path / "tension.png", yield_stress=6e8)
    lines = figures[0].axes[0].lines
    assert len(lines) == 1 + count and np.diff([line.get_linewidth() for line in lines]).max() < -0.5
    assert len({(line.get_color(), line.get_linestyle()) for line in lines}) == len(lines)


def test_compression_is_shaded_and_meshes_have_their_range(tmp_path, monkeypatch) -> None:
    """Below zero up to the axis, not where tensions scatter about zero."""
    drawn = []
    monkeypatch.setattr(design_figures, "save_figure", lambda figure, path: drawn.append(figure) or path)
    for weft, shaded in (([0.0, -0.5, 1.0], 1), ([0.0, -1e-4, 1.0], 0)):
        curve = {f"strain_{side}": np.linspace(0.0, 0.1, 3) for side in ("weft", "warp")}
        curve |= {"tension_weft_N_per_m": np.array(weft), "tension_warp_N_per_m": np.linspace(0.0, 1.0, 3)}
        curve |= {"stress_max_Pa": np.zeros(3), "jump": np.zeros(3)}
        curve |= {"p10_tension_weft_N_per_m": np.array(weft) - 0.1, "p90_tension_weft_N_per_m": np.array(weft) + 0.2}
        design_figures.tension_strain_figure({"both": curve}, tmp_path / "curves.png", yield_stress=6e8)
        (axes,) = drawn[-1].axes
        spans = [patch for patch in axes.patches if str(patch.get_label()).startswith("compressed")]
        assert len(spans) == shaded
        (band,) = axes.collections
        assert band.get_paths()[0].get_extents().ymax == pytest.approx(1.2)
    span = next(patch for patch in drawn[0].axes[0].patches if str(patch.get_label()).startswith("compressed"))
    low, high = span.get_extents().transformed(drawn[0].axes[0].transData.inverted()).intervaly
    assert low < drawn[0].axes[0].get_ylim()[0] and high == pytest.approx(0.0, abs=1e-9)


def test_compression_in_a_run_is_shaded(tmp_path, monkeypatch) -> None:
    drawn = []
    monkeypatch.setattr(curves_figure, "save_figure", lambda figure, path: drawn.append(figure) or path)
    for least in (-0.3, -1e-6):
        rows = [
            {"stage": "load", "load_factor": share, "strain_weft": 0.1 * share, "strain_warp": 0.0, "active_percent": 0.0}
            | {"tension_weft_N_per_m": share, "tension_warp_N_per_m": least * share, "stress_max_Pa": 1e8 * share}
            | {"temperature_K": 293.15, "residual": 1e-5, "contact_force_max_N": share, "jump": 0.0}
            | {f"energy_{name}_J": share for name in ("bend", "stretch", "contact", "kinetic")}
            for share in (0.0, 0.5, 1.0)
        ]
        curves_figure.curves_figure(columns_of(rows), tmp_path / "curves.png")
    patches = [[patch.get_label() for patch in figure.axes[1].patches] for figure in drawn]
    assert patches == [[curve_axes.COMPRESSED], []]


@pytest.mark.parametrize(
    ("least", "most", "labels"),
    [
        (0.035, 0.25, ["0.05", "0.1", "0.2"]),
        (20.0, 30.0, ["15", "20", "25", "30", "35", "40", "45"]),  # less than a decade
        (1e-3, 1.0, ["0.001", "0.002", "0.005", "0.01", "0.02", "0.05", "0.1", "0.2", "0.5", "1"]),
    ],
)
def test_labels_of_resistance_are_apart_and_differ(least: float, most: float, labels: list[str], tmp_path, monkeypatch) -> None:
    shown = []

    def drawn(figure, path):
        figure.canvas.draw()
        axes = figure.axes[0]
        texts = [(one, one.get_window_extent()) for one in axes.get_yticklabels(which="both") if one.get_text()]
        inside = [(one.get_text(), box) for one, box in texts if axes.bbox.y0 <= 0.5 * (box.y0 + box.y1) <= axes.bbox.y1]
        shown.extend(sorted(inside, key=lambda one: one[1].y0))
        return path

    monkeypatch.setattr(design_figures, "save_figure", drawn)
    found = np.geomspace(least, most, 3)
    curve = {f"sheet_resistance_{side}_ohm": found for side in ("weft", "warp")} | dict.fromkeys(
        ("strain_weft", "strain_warp", "active_percent", "jump"), np.arange(3.0)
    )
    design_figures.resistance_figure(curve, tmp_path / "resistance.png")
    assert [text for text, _ in shown] == labels
    assert all(below.y1 <= above.y0 for (_, below), (_, above) in itertools.pairwise(shown))
