"""Heat: a mesh cooled and heated between edges of different metals, against the same stretch without heat.

    python tools/studies/heat.py [DIR] [--quick]

scenes/heat.toml (the periodic cell) with `model.frame_expansion` of edges that stand still, of the wire's own metal, of
aluminium and of carbon fibre, at 10 % and 14 % both ways. *Equivalent* is an isothermal run: at temperature T the mesh is the
one at 20 degC stretched by (1 + a_frame (T - T0)) (1 + e)/(1 + a_wire (T - T0)) - 1, all lengths rescaled by f = 1 + a_wire
(T - T0). Forces of bending go with 1/f^2 and tension, a force a width, with 1/f^3. Prints a table, leaves heat.csv and
heat.png.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from study import (
    COLOURS,
    add_directory,
    new_figure,
    new_parser,
    picture_path,
    run,
    scene_of,
    show_rows,
    table_path,
    tidy,
    write_rows,
)

from warpknit import measure
from warpknit.compute.device import start_warp

FRAMES = (("edges that stand still", 0.0), ("tungsten", 4.5e-6), ("aluminium", 23e-6), ("CFRP", 0.0))
STRAINS = (0.1, 0.14)
STAGES = {"load": 20.0, "cold": -190.0, "hot": 140.0}  # [degC] of scenes/heat.toml


@dataclass(frozen=True)
class Heated:
    """A row of heat.csv."""

    frame: str
    frame_expansion: float  # [1/K]
    strain: float  # both ways, of the frame at 20 degC
    temperature_degC: float
    equivalent_strain: float
    active_percent: float
    tension_weft: float  # [N/m]
    tension_warp: float
    equivalent_active_percent: float
    equivalent_weft: float  # [N/m] of the isothermal run, rescaled
    equivalent_warp: float
    force_max_N: float
    stress_max_Pa: float


def heated(name: str, frame_expansion: float, strain: float, *overrides: str) -> list[Heated]:
    """A mesh at 20, -190 and 140 degC beside its isothermal equivalents."""
    load = {"strain_weft": strain, "strain_warp": strain}
    scene = scene_of("heat.toml", *overrides, load=load, model={"frame_expansion": frame_expansion})
    ends = {record.stage: record.observables for record in run(scene)}
    rows = []
    for stage, temperature in STAGES.items():
        r = ends[stage]
        change = temperature + 273.15 - scene.wire.reference_temperature
        factor = 1.0 + scene.wire.expansion * change
        equivalent = (1.0 + frame_expansion * change) * (1.0 + strain) / factor - 1.0
        share, weft, warp = isothermal(equivalent, *overrides)
        rows.append(Heated(
            name, frame_expansion, strain, temperature, equivalent, measure.contacts(r).active_percent, *measure.mesh_tension(r),
            share, weft / factor**3, warp / factor**3, float(r.pair_force.max()), measure.stress_extremes(r)[0],
        ))  # fmt: skip
    return rows


def isothermal(strain: float, *overrides: str) -> tuple[float, float, float]:
    """Share of active contacts [%] and tensions [N/m] at 20 degC."""
    load = {"strain_weft": strain, "strain_warp": strain}
    stay = [{"name": "load-held", "temperature": "20 degC"}]
    *_, last = run(scene_of("heat.toml", *overrides, load=load, path=stay))
    return (measure.contacts(last.observables).active_percent, *measure.mesh_tension(last.observables))


def draw(path: Path, rows: Sequence[Heated]) -> None:
    """Tension and share against temperature."""
    figure, panels = new_figure(9.0, 3.8, 1, 2)
    for axes, strain in zip(panels[0], STRAINS, strict=False):
        for colour, (name, _expansion) in zip(COLOURS, FRAMES[:3], strict=False):
            own = sorted((r for r in rows if r.frame == name and r.strain == strain), key=lambda r: r.temperature_degC)
            degrees = [r.temperature_degC for r in own]
            axes.plot(degrees, [1e3 * r.tension_weft for r in own], color=colour, marker="o", markersize=4, label=f"{name}, weft")
            warp = [1e3 * r.tension_warp for r in own]
            axes.plot(degrees, warp, color=colour, linestyle="--", marker="s", markersize=4, label=f"{name}, warp")
            there = [1e3 * r.equivalent_weft for r in own]
            axes.plot(degrees, there, color="black", linestyle="none", marker="x", markersize=7,
                      label="isothermal stretch" if name == FRAMES[2][0] else None)  # fmt: skip
        axes.set(xlabel="temperature [°C]", ylabel="tension [mN/m]", title=f"{100 * strain:.0f} % both ways", ylim=(0, None))
    tidy(panels)
    figure.savefig(path)


def main() -> int:
    parser = new_parser(__doc__)
    add_directory(parser, quick="10 %% only")
    given = parser.parse_args()
    start_warp()
    strains = STRAINS[:1] if given.quick else STRAINS
    rows = [row for strain in strains for name, expansion in FRAMES for row in heated(name, expansion, strain)]
    write_rows(table_path(given, "heat.csv"), rows)
    draw(picture_path(given, "heat.png"), rows)
    show_rows(rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
