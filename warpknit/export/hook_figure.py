"""Figure of two hooked wires: their shape, and contact forces and places against the displacement."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from warpknit.export.plots import BLUE, GREEN, GREY, ORANGE, figure_of, save_figure, scale_of
from warpknit.results.frame import Frame, WireLayout, drawn_frame, drawn_layout

__all__ = ["hook_figure"]

WIRES = (("left", BLUE), ("right", ORANGE))
BETWEEN = 4  # states drawn pale between rest and the last
TOUCHING = 1e-3  # of the largest force: with less the wires just graze, at places that mean nothing


def hook_figure(
    layout: WireLayout, frames: Sequence[Frame], history: Sequence[Mapping[str, Any]], path: str | os.PathLike[str]
) -> Path:
    """Draw the frames of a hook; `history` has one row for each."""
    figure = figure_of(12.0, 5.6)
    panels = figure.subplot_mosaic([["hook", "force"], ["hook", "place"]], width_ratios=(1.0, 1.15))

    def column(name: str, scale: float = 1.0) -> np.ndarray:
        return scale * np.array([float(row[name]) for row in history])

    _draw_hook(panels["hook"], layout, frames)
    displacement = column("displacement_m", 1e3)
    force = panels["force"]
    scale, unit = scale_of("N", *(column(f"{name}_N") for name in ("force_left", "force_right", "drive_force", "ground_force")))
    for side, colour in WIRES:
        style: dict[str, Any] = {"linewidth": 3.0 if side == "left" else 1.5, "alpha": 0.55 if side == "left" else 1.0}
        force.plot(displacement, column(f"force_{side}_N", scale), color=colour, label=f"contact, {side} wire", **style)
    force.plot(displacement, column("drive_force_N", scale), color=GREY, linestyle="--", label="driven end, lateral")
    if np.any(column("ground_force_N") > 0.0):
        force.plot(displacement, column("ground_force_N", scale), color=GREEN, linestyle=":", label="ground on the body")
    force.set_ylabel(f"force [{unit}]")
    place = panels["place"]
    least = np.minimum(column("force_left_N"), column("force_right_N"))
    closed = least > TOUCHING * least.max(initial=0.0)
    for side, colour in WIRES:
        arc = column(f"arc_{side}_m", 1e3)
        place.plot(displacement, np.where(closed, arc, np.nan), color=colour, marker="o", markersize=3, label=f"{side} wire")
    place.set(ylabel="contact position [mm from the clamp]", xlabel="displacement of the driven end [mm]")
    place.set_xlim(force.get_xlim())
    for axes in (force, place):
        axes.grid(color="#DDDDDD", linewidth=0.6)
        axes.spines[["top", "right"]].set_visible(False)
        axes.legend(frameon=True, framealpha=0.8, edgecolor="none", loc="best")
    return save_figure(figure, path)


def _draw_hook(axes: Axes, layout: WireLayout, frames: Sequence[Frame]) -> None:
    """Both wires at the start, half-way and at the end, with the body."""
    drawn = drawn_layout(layout)
    shown = np.unique(np.linspace(0, len(frames) - 1, BETWEEN + 2).round().astype(int))
    for index in shown:
        frame = frames[index]
        last = index == shown[-1]
        for wire, (_, colour) in enumerate(WIRES):
            # a segment beyond either clamp only carries the contact curve
            points = slice(drawn.wire_start[wire] + layout.curve_parts, drawn.wire_start[wire + 1] - layout.curve_parts)
            x, y = 1e3 * np.asarray(drawn_frame(layout, frame).node_position)[points, :2].T
            axes.plot(x, y, color=colour, linewidth=2.0 if last else 0.9, alpha=1.0 if last else 0.35)
            if index == shown[0]:
                axes.plot(x[0], y[0], color="black", marker="s", markersize=6)
            if last:
                axes.plot(x[-1], y[-1], color=colour, marker="^" if wire == 0 else ">", markersize=8)
        body = 1e3 * np.asarray(frame.body_position)[0, :2]
        axes.plot(*body, color=GREEN, marker="o", markersize=6 if last else 3, alpha=1.0 if last else 0.5)
    kinds = (
        ("lower ends, clamped", "black", "s"),
        ("left upper end, slides up and down", BLUE, "^"),
        ("right upper end, driven sideways", ORANGE, ">"),
        ("contact", GREEN, "o"),
    )
    handles = [Line2D([], [], color=colour, marker=marker, linestyle="none", label=name) for name, colour, marker in kinds]
    axes.legend(handles=handles, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2, fontsize=9)
    axes.set(xlabel="x [mm]", ylabel="y [mm]")
    axes.set_aspect("equal", adjustable="datalim")
