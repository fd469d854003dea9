"""Figures of `warpknit report`: contacts and stress against tension, tension against strain, sheet resistance, openings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, NullLocator
from scipy.constants import speed_of_light

from warpknit.export.curve_axes import draw_line, draw_range, mark_handles, shade_compression
from warpknit.export.plots import BLUE, GREEN, GREY, ORANGE, PURPLE, WIDTHS, LineLook, figure_of, plain, save_figure, scale_of
from warpknit.results.row import Columns, Row, Values

TITLES = {
    "weft_alone": "weft strained, warp held",
    "warp_alone": "warp strained, weft held",
}
FREQUENCIES = (1e9, 1e11)  # [Hz]
BEYOND_LIMIT = 1.5  # of the largest tension below the elastic limit: upper end of the axis
LABELLED_DECADES = 3.0  # of the axis of tension: on a longer one only powers of ten have labels
ROOM = 0.04  # of the axis, at both ends
LONGEST_AXIS = 20.0  # upper over lower end of the axis of tension: service tensions keep most of it
BEFORE = 0.8  # of the lowest reported tension: begin of the axis
LEAST_TENSION = 1e-4  # of the largest: less is not drawn, on a logarithmic axis
CLASS_COLOURS, CLASS_DASHES = (BLUE, ORANGE, PURPLE, GREY), ("-", "--", ":")  # dashes where colours come again
FRICTION_DASHES = ((0, (1.0, 1.5)), (0, (6.0, 2.0)))  # of half and twice the friction
LAST_CLASS, WIDER_CLASS, WIDEST_CLASS = 1.2, 0.9, 6.3  # [pt] of the last class, of each before it, which it may lie on, at most
LEAST_DRIFT = 0.01  # of the axis of tension: a narrower one stands beside the best tension
EQUAL = 1e-6  # of a strain: round-off between weft and warp
LEAST_DECADES = 0.6  # of a resistance axis: a constant resistance is a level line

SIDES: dict[str, LineLook] = {
    "weft": {"color": BLUE, "marker": "o", "linewidth": WIDTHS[0], "markersize": 6.5},
    "warp": {"color": ORANGE, "marker": "s", "linewidth": WIDTHS[1], "markersize": 4},
}


def tension_figure(
    history: Columns,
    answers: Values,
    path: Path,
    *,
    yield_stress: float,
    jumps: Sequence[tuple[float, float]] = (),
    frictions: Mapping[str, str] | None = None,
) -> Path:
    """Draw active contacts and largest wire stress against equal tensions.

    history: columns under such tensions; answers: theirs (runner/answers.py); jumps: tensions [N/m] on both sides of each;
    frictions: labels of lines with another friction, by name.
    """
    tension = 0.5 * (history["tension_weft_N_per_m"] + history["tension_warp_N_per_m"])
    shown = tension > LEAST_TENSION * tension.max()
    to_stress, stress_unit = scale_of("Pa", history["stress_max_Pa"], np.array([yield_stress]))

    def column(name: str) -> np.ndarray:
        return history[name][shown]

    active = column("active_percent")
    begin, end = _tension_range(tension[shown], active, answers)
    decades = np.log10(end / begin)
    scale, unit = scale_of("N/m", np.array([end]))
    abscissa = scale * tension[shown]
    between = zip(tension[shown][:-1], tension[shown][1:], strict=True)
    jumped = np.array([False, *(any(one <= low < high <= other for low, high in jumps) for one, other in between)])

    figure = figure_of(10.5, 4.4)
    contacts, stress = figure.subplots(1, 2)
    classes = [one.name for one in answers.contacts]
    widths = np.linspace(min(LAST_CLASS + WIDER_CLASS * len(classes), WIDEST_CLASS), LAST_CLASS, 1 + len(classes)).tolist()
    draw_line(contacts, abscissa, active, jumped, color=GREEN, linewidth=widths[0], label="all contacts")
    draw_range(contacts, abscissa, history, "active_percent", GREEN, 1.0, shown)
    draw_range(stress, abscissa, history, "stress_max_Pa", BLUE, to_stress, shown)
    for (name, label), dash in zip((frictions or {}).items(), FRICTION_DASHES, strict=False):
        if f"{name}_active_percent" in history:
            thin = {"linestyle": dash, "linewidth": 1.0, "label": label}
            contacts.plot(abscissa, column(f"{name}_active_percent"), color=GREEN, **thin)
            stress.plot(abscissa, to_stress * column(f"{name}_stress_max_Pa"), color=BLUE, **thin)
    if len(classes) > 1:
        for number, name in enumerate(classes):
            again, colour = divmod(number, len(CLASS_COLOURS))
            look = {"color": CLASS_COLOURS[colour], "linestyle": CLASS_DASHES[again % len(CLASS_DASHES)]}
            values = column(f"active_{name}_percent")
            draw_line(contacts, abscissa, values, jumped, linewidth=widths[1 + number], label=f"class {name}", **look)
    contacts.set_ylim(-3.0, 103.0)
    contacts.set_ylabel("active contacts [% of pairs]")
    draw_line(stress, abscissa, to_stress * column("stress_max_Pa"), jumped, color=BLUE, linewidth=WIDTHS[1], marker=".")
    stress.axhline(to_stress * yield_stress, color=ORANGE, linestyle="--", label="elastic limit")
    stress.set_ylim(0.0, to_stress * 1.15 * min(max(column("stress_max_Pa").max(initial=0.0), yield_stress), 2.0 * yield_stress))
    stress.set_ylabel(f"largest wire stress [{stress_unit}]")
    for axes in (contacts, stress):
        axes.set_xscale("log")
        axes.set_xlim(scale * begin, scale * end * 10.0 ** (ROOM * decades))
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
        axes.xaxis.set_minor_formatter("{x:g}" if decades < LABELLED_DECADES else NullFormatter())
        axes.set_xlabel(f"tension, weft and warp [{unit}]")
        for low, high in jumps:
            axes.axvspan(scale * low, scale * high, color="#BBBBBB", linewidth=0.0, zorder=0.5, label="jump")
        if (best := answers.best) is not None:
            here, low, high = (
                0.5 * scale * (one.tension_weft_N_per_m + one.tension_warp_N_per_m) for one in (best, best.low, best.high)
            )
            is_wide = np.log10(high / max(low, scale * begin)) > LEAST_DRIFT * decades
            label = "best tension" if is_wide else "best tension, its valid range within the line"
            axes.axvline(here, color=GREEN, linestyle=":", linewidth=1.4, zorder=0.8, label=label)
            if is_wide:
                axes.axvspan(low, high, color="#CDE9DC", linewidth=0.0, zorder=0, label="valid range")
        plain(axes)
    figure.legend(handles=_handles(figure), loc="outside upper center", ncols=6, frameon=False, fontsize="small")
    return save_figure(figure, path)


def _tension_range(tension: np.ndarray, active: np.ndarray, answers: Values) -> tuple[float, float]:
    """Ends [N/m] of the axis: from the first change of contacts to a little beyond first yield and the service tensions.

    At most LONGEST_AXIS times the lower end, but never beyond the best tension. tension, active: of the records that are drawn.
    """

    def mean(state: Row) -> float:
        return float(0.5 * (state.tension_weft_N_per_m + state.tension_warp_N_per_m))

    best, first_yield = answers.best, answers.get("first_yield")
    end = float(tension.max())
    if first_yield is not None:
        asked = [one.tension_N_per_m for one in answers.get("service", ()) if one.state is not None]
        asked += [] if best is None else [mean(best)]
        end = min(end, BEYOND_LIMIT * max([mean(first_yield), *asked]))
    changes = np.flatnonzero(np.diff(active))
    shown = [one.closes for one in answers.contacts if one.closes is not None] + ([] if best is None else [best.low])
    first = [0.5 * float(tension[changes[0]])] if len(changes) else [0.0]
    begin = max(min(first + [BEFORE * mean(one) for one in shown]), float(tension.min()), end / LONGEST_AXIS)
    return (begin if best is None else min(begin, BEFORE * mean(best))), end


def tension_strain_figure(curves: Mapping[str, Columns], path: Path, *, yield_stress: float) -> Path:
    """Draw the tensions against strain. curves: columns of tension_strain.csv by load; lines over jumps are dotted."""
    figure = figure_of(10.5, 3.9)
    panels = figure.subplots(1, len(curves), sharey=True)
    top = _top_tension(list(curves.values()), yield_stress)
    tensions = [curve[f"tension_{side}_N_per_m"] for curve in curves.values() for side in ("weft", "warp")]
    bottom = min(0.0, float(np.nanmin(np.concatenate(tensions), initial=0.0)))
    scale, unit = scale_of("N/m", np.array([top]))
    for axes, (load, curve) in zip(np.atleast_1d(panels), curves.items(), strict=True):
        strain, axis, together = _strain_axis(curve)
        for side, look in SIDES.items():
            name = f"tension_{side}_N_per_m"
            values = scale * curve[name]
            draw_range(axes, strain, curve, name, look["color"], scale)
            draw_line(axes, strain, values, curve["jump"] > 0.0, label=f"tension in {side}", **look)
        beyond = np.nonzero(curve["stress_max_Pa"] > yield_stress)[0]
        if len(beyond):
            first = max(beyond[0] - 1, 0)
            there = [first, beyond[0]]
            begin = np.interp(yield_stress, curve["stress_max_Pa"][there], strain[there])
            axes.axvspan(float(begin), strain[-1], color="#F3D9C6", zorder=0, label="beyond the elastic limit")
        axes.set_title(TITLES.get(load, together), fontsize="medium")
        axes.set_xlabel(axis)
        plain(axes)
    first = np.atleast_1d(panels)[0]
    first.set_ylabel(f"tension [{unit}]")
    room = ROOM * scale * (top - bottom)
    first.set_ylim(scale * bottom - room, scale * top + room)
    for axes in np.atleast_1d(panels):
        shade_compression(axes, [scale * values for values in tensions])
    figure.legend(handles=_handles(figure), loc="outside lower center", ncols=4, frameon=False, fontsize="small")
    return save_figure(figure, path)


def _strain_axis(curve: Columns) -> tuple[np.ndarray, str, str]:
    """Strains [%] of a curve, label of their axis, title."""
    weft, warp = (100.0 * float(curve[f"strain_{side}"][-1]) for side in ("weft", "warp"))
    side = "weft" if weft >= warp else "warp"
    is_equal = abs(weft - warp) <= EQUAL * max(weft, warp)
    together = "equal strain in both directions" if is_equal else f"both strained, to {weft:.3g} % in weft, {warp:.3g} % in warp"
    return 100.0 * curve[f"strain_{side}"], "strain [%]" if is_equal else f"strain in {side} [%]", together


def _top_tension(curves: Sequence[Columns], yield_stress: float) -> float:
    """[N/m] of the axis: what wires below their elastic limit carry, and little above; all of it where none yields."""
    largest = [np.fmax(curve["tension_weft_N_per_m"], curve["tension_warp_N_per_m"]) for curve in curves]
    everything = float(np.nanmax(np.concatenate(largest), initial=0.0))
    elastic = [0.0]
    for curve, tension in zip(curves, largest, strict=True):
        elastic += tension[curve["stress_max_Pa"] <= yield_stress].tolist()
        behind = np.nonzero(curve["stress_max_Pa"] > yield_stress)[0]
        if len(behind) and behind[0] > 0:
            there = [behind[0] - 1, behind[0]]
            elastic.append(float(np.interp(yield_stress, curve["stress_max_Pa"][there], tension[there])))
    shown = BEYOND_LIMIT * float(np.nanmax(elastic))
    return (min(shown, everything) if shown > 0.0 else everything) or 1.0


def resistance_figure(curve: Columns, path: Path) -> Path:
    """Draw sheet resistance and active contacts against strain in both directions."""
    figure = figure_of(7.0, 4.0)
    axes = figure.subplots()
    strain, axis, together = _strain_axis(curve)
    axes.set_title(together, fontsize="medium")
    for side, look in SIDES.items():
        resistance = curve[f"sheet_resistance_{side}_ohm"]
        label = f"along {side}" if np.isfinite(resistance).any() else f"along {side}: does not conduct"
        draw_line(axes, strain, resistance, curve["jump"] > 0.0, label=label, **look)
    known = np.concatenate([curve[f"sheet_resistance_{side}_ohm"] for side in ("weft", "warp")])
    known = known[np.isfinite(known)]
    if len(known):
        axes.set_yscale("log")
        least, most = np.log10(known.min()), np.log10(known.max())
        half = max(0.55 * (most - least), 0.5 * LEAST_DECADES)
        axes.set_ylim(10.0 ** (0.5 * (least + most) - half), 10.0 ** (0.5 * (least + most) + half))
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_locator(NullLocator())
    axes.set_xlabel(axis)
    axes.set_ylabel("sheet resistance [ohm/sq]")
    axes.grid(color="#DDDDDD", linewidth=0.6)
    share = axes.twinx()
    look = {"color": GREEN, "linestyle": "-."}
    draw_line(share, strain, curve["active_percent"], curve["jump"] > 0.0, label="active contacts (right)", **look)
    share.set_ylim(-3.0, 103.0)
    share.set_ylabel("active contacts [% of pairs]")
    # above both axes: `best` looks at the curves of one only
    figure.legend(handles=_handles(figure), loc="outside upper center", ncols=4, frameon=False, fontsize="small")
    return save_figure(figure, path)


def _handles(figure: Figure) -> list[Artist]:
    """Legend entries of all axes, once for each label, and of dots and bands."""
    every = {str(one.get_label()): one for axes in figure.axes for one in axes.get_legend_handles_labels()[0]}
    return [*every.values(), *mark_handles(figure)]


def openings_figure(circles: Sequence[tuple[str, float]], bands: Sequence[tuple[str, float]], path: Path) -> Path:
    """Draw circles (label, diameter [m]) in openings over the wavelength, and bands (name, frequency [Hz])."""
    figure = figure_of(7.0, 4.0)
    axes = figure.subplots()
    frequency = np.geomspace(*FREQUENCIES, 60)
    for (label, circle), colour, width in zip(circles, (GREY, BLUE), WIDTHS, strict=False):
        axes.loglog(1e-9 * frequency, circle * frequency / speed_of_light, color=colour, linewidth=width, label=label)
    for part in (10, 20, 50):
        axes.axhline(1.0 / part, color="#909090", linewidth=0.8, linestyle="--")
        axes.text(1e-9 * FREQUENCIES[0] * 1.05, 1.04 / part, f"1/{part}", fontsize="small", color="#606060")
    for name, band in bands:
        axes.axvline(1e-9 * band, color="#DDDDDD", linewidth=0.8, zorder=0)
        axes.text(1e-9 * band, 0.985, name, transform=axes.get_xaxis_transform(), ha="center", va="top", fontsize="small")
    axes.xaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_major_formatter("{x:g}")
    axes.set_xlabel("frequency [GHz]")
    axes.set_ylabel("largest inscribed circle / wavelength")
    axes.legend(loc="lower right", frameon=True, framealpha=0.9, edgecolor="none", fontsize="small")
    return save_figure(figure, path)
