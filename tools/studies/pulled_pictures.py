"""The picture of pulled meshes: force against strain, the band of what was not published, and the strips that were pulled."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from study import COLOURS, new_figure, tidy

ALONG = {"warp": "along the wales", "weft": "along the courses"}
LEAST = 1.0  # [N/m] of the axis


def draw(path: Path, rows: Sequence[Any], levels: Sequence[Any], meshes: Sequence[Any]) -> None:
    """Write the picture of all pulls: a column for each mesh, a row for each direction."""
    shown = [mesh for mesh in meshes if any(row.mesh == mesh.name for row in rows)]
    figure, panels = new_figure(3.4 * len(shown), 6.6, 2, len(shown))
    for column, mesh in enumerate(shown):
        for panel, direction in zip(panels[:, column], ALONG, strict=True):
            here = [row for row in rows if (row.mesh, row.direction) == (mesh.name, direction)]
            curves = {
                row.case: [v for v in levels if (v.mesh, v.direction, v.case) == (mesh.name, direction, row.case)] for row in here
            }
            _draw_curves(panel, curves)
            _draw_strength(panel, here)
            _draw_measured(panel, mesh.measured[direction])
            panel.set_title(f"{mesh.name}, {ALONG[direction]}", fontsize=10)
            panel.set_yscale("log")
            panel.set_ylim(LEAST, 3e4)
            panel.set_xlim(0.0, None)
            panel.set_xlabel("strain [-]")
        panels[0, column].set_ylabel("force over the width as knitted [N/m]")
        panels[1, column].set_ylabel("force over the width as knitted [N/m]")
    tidy(panels, legend=False)
    panels[0, -1].legend(frameon=False, fontsize=7, loc="lower right")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path)


def _draw_curves(panel: Axes, curves: dict[str, list[Any]]) -> None:
    """Draw the curve of the base case, the others, and the band between."""
    farthest = max(curve[-1].strain for curve in curves.values())
    strain = np.linspace(0.0, farthest, 300)
    force = [np.interp(strain, [v.strain for v in c], [max(v.force, 1e-3) for v in c], right=np.nan) for c in curves.values()]
    if len(force) > 1:
        panel.fill_between(
            strain, np.nanmin(force, axis=0), np.nanmax(force, axis=0), color=COLOURS[5], alpha=0.3, label="band", lw=0
        )
    for case, curve in curves.items():
        base = case == "base"
        panel.plot(
            [v.strain for v in curve], [max(v.force, 1e-3) for v in curve], color=COLOURS[0], lw=1.8 if base else 0.6,
            alpha=1.0 if base else 0.7, label="simulated, base" if base else "other cases" if case == list(curves)[-1] else None,
        )  # fmt: skip


def _draw_strength(panel: Axes, rows: Sequence[Any]) -> None:
    """Draw forces of the base case: where wire is straight, at the wires' strength, and of all wires across a line."""
    (base,) = (row for row in rows if row.case == "base")
    panel.axvline(base.straight_strain, color="#777777", lw=0.8, ls=":", label="wire straight")
    weak, strong = base.force_weak, base.force_strong
    panel.plot([base.last_strain] * 2, [weak, strong], color=COLOURS[0], lw=4, alpha=0.5, label="axial stress = strength")
    panel.axhspan(base.bound_weak, base.bound_strong, color="#BBBBBB", alpha=0.5, lw=0, label="all wires at their strength")


def _draw_measured(panel: Axes, measured: Any) -> None:
    force = measured.force / measured.width
    panel.errorbar(
        [measured.strain], [force], xerr=[measured.strain * measured.strain_cv], yerr=[force * measured.force_cv],
        color=COLOURS[1], marker="o", ms=5, capsize=3, lw=1.4, zorder=5, label="measured at break",
    )  # fmt: skip
