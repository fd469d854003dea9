"""Paths: hysteresis by friction, and contacts that an overload costs for good.

    python tools/studies/paths.py [DIR] [--quick]

Hysteresis: scenes/friction_cycle.toml, 0 -> 16 % -> 0 -> 16 % both ways in steps of 0.03 %, by the friction coefficient.
Overload: scenes/overload.toml, 0 -> overload -> 0 both ways, a mesh as knitted each time, for 30 um tungsten and molybdenum wire
that yields at the limit in warpknit/scene/materials.py, and for molybdenum as if it never yielded. Prints tables and leaves
hysteresis.csv, overload.csv and paths.png.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
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
from warpknit.solve.simulate import Record

FRICTIONS = (0.0, 0.01, 0.02, 0.05, 0.1, 0.2, 0.4)
OVERLOADS = (0.1, 0.12, 0.14, 0.16, 0.18, 0.2, 0.24, 0.28)
WIRES = (("tungsten", True), ("molybdenum", True), ("molybdenum", False))
SERVICE = 0.1  # strain both ways at which the mesh is used
STEP = 0.01  # of strain between recorded states
YIELDING = ("solver.preset=standard", "model.nodes_per_loop=24")  # which nodes yield asks for more of them
FINE = "output.frames=512"  # 0.03 % of strain between the states of a cycle with friction, from where on they stay alike


@dataclass(frozen=True)
class State:
    """A steady state on the way."""

    stage: str
    strain: float
    share: float  # [%]
    weft: float  # [N/m]
    warp: float
    work: float  # [J] done by the boundary since the start, by the trapezoidal rule
    stored: float  # [J]
    dissipated: float  # [J]
    stress: float  # [Pa]
    yielded: float | None  # share of the nodes, of wires that may yield


@dataclass(frozen=True)
class Hysteresis:
    """A row of hysteresis.csv."""

    friction: float
    path: str
    stored_at_16_nJ: float
    dissipated_in_cycle_nJ: float  # 16 % -> 0 -> 16 %, as the model accounts for it
    work_in_cycle_nJ: float  # by the boundary, less what is stored more at the end: the area of the loop
    loss_percent: float  # dissipated over stored
    tension_out_12: float  # [N/m] sum of weft and warp at 12 % on the first way out
    tension_back_12: float
    tension_again_12: float


@dataclass(frozen=True)
class Overload:
    """A row of overload.csv."""

    wire: str
    overload: float
    path: str
    stress_max_Pa: float  # of the wire at the overload
    yielded_percent: float  # of the nodes
    share_overload: float  # [%]
    share_before: float  # [%] at the service strain on the way out
    share_after: float  # and on the way back
    tension_before: float  # [N/m] sum of weft and warp there
    tension_after: float
    lost_at: float  # strain on the way back from which fewer than half of the contacts of the overload are left


def states_of(records: Sequence[Record]) -> list[State]:
    """Values of the records of a run, with the work along them."""
    found: list[State] = []
    work, last = 0.0, None
    for record in records:
        r = record.observables
        if last is not None:
            mean = 0.5 * (last.nominal_stress + r.nominal_stress)
            work += r.model.panel.area * float(np.sum(mean * (r.gradient - last.gradient)))
        last = r
        found.append(State(
            record.stage, float(r.gradient[0, 0] - 1.0), measure.contacts(r).active_percent, *measure.mesh_tension(r), work,
            r.energies.stored, record.dissipated, measure.stress_extremes(r)[0], measure.plastic_extremes(r)[0],
        ))  # fmt: skip
    return found


def at(states: Sequence[State], stage: str, strain: float) -> State:
    """The state of a stage nearest to a strain."""
    return min((s for s in states if s.stage == stage), key=lambda s: abs(s.strain - strain))


def cycle(friction: float, *overrides: str) -> tuple[Hysteresis, list[State]]:
    """0 -> 16 % -> 0 -> 16 %."""
    states = states_of(list(run(scene_of("friction_cycle.toml", f"contact.friction={friction}", *overrides))))
    most = max(s.strain for s in states)
    out, again = at(states, "load", most), at(states, "reload", most)
    gone = again.dissipated - out.dissipated
    area = (again.work - out.work) - (again.stored - out.stored)
    tension = [sum((s.weft, s.warp)) for s in (at(states, stage, 0.12) for stage in ("load", "unload", "reload"))]
    row = Hysteresis(friction, f"0 > {most:.2g} > 0 > {most:.2g}", 1e9 * out.stored, 1e9 * gone, 1e9 * area,
                     100.0 * gone / out.stored, *tension)  # fmt: skip
    return row, states


def overload(material: str, plastic: bool, strain: float, *overrides: str) -> tuple[Overload, list[State]]:
    """0 -> overload -> 0."""
    frames = {"frames": max(1, round(strain / STEP))}
    load = {"strain_weft": strain, "strain_warp": strain}
    back = [{"name": "back", "strain_weft": 0.0, "strain_warp": 0.0}]
    wire = {"material": material, "plastic": plastic}
    scene = scene_of("overload.toml", *overrides, wire=wire, load=load, path=back, output=frames)
    states = states_of(list(run(scene)))
    top = at(states, "overload", strain)
    before, after = at(states, "overload", SERVICE), at(states, "back", SERVICE)
    if np.isclose(strain, SERVICE):
        after = top
    lost = next((s.strain for s in states if s.stage == "back" and s.share < 0.5 * top.share), 0.0)
    name = f"{material} 30 um{'' if plastic else ', elastic'}"
    row = Overload(name, strain, f"0 > {strain:.2g} > {SERVICE:.2g}", top.stress, 100.0 * (top.yielded or 0.0), top.share,
                   before.share, after.share, before.weft + before.warp, after.weft + after.warp, lost)  # fmt: skip
    return row, states


def draw(path: Path, cycles: list[tuple[Hysteresis, list[State]]], overloads: list[tuple[Overload, list[State]]]) -> None:
    figure, panels = new_figure(15.0, 4.0, 1, 4)
    shown = [pair for pair in cycles if pair[0].friction in (0.0, 0.05, 0.2)]
    for colour, (row, states) in zip(COLOURS, shown, strict=False):
        percent = [100 * s.strain for s in states]
        panels[0, 0].plot(percent, [s.weft + s.warp for s in states], color=colour, linewidth=1.0, label=f"mu {row.friction:g}")
    panels[0, 0].set(xlabel="strain both ways [%]", ylabel="tension, weft + warp [N/m]", xlim=(9, 14), ylim=(0, 0.27))
    mu = [row.friction for row, _ in cycles]
    panels[0, 1].plot(mu, [row.loss_percent for row, _ in cycles], color=COLOURS[0], marker="o", label="as accounted for")
    area = [100 * row.work_in_cycle_nJ / row.stored_at_16_nJ for row, _ in cycles]
    panels[0, 1].plot(mu, area, color=COLOURS[1], marker="x", linestyle="--", label="area of the loop")
    panels[0, 1].set(xlabel="friction coefficient [-]", ylabel="lost in a cycle, of stored energy [%]")
    wires = list(dict.fromkeys(row.wire for row, _ in overloads))
    for colour, wire in zip(COLOURS[2:], wires, strict=False):
        own = [row for row, _ in overloads if row.wire == wire]
        percent = [100 * row.overload for row in own]
        panels[0, 2].plot(percent, [row.share_after for row in own], color=colour, marker="o", markersize=4, label=wire)
    panels[0, 2].set(xlabel="overload, strain both ways [%]", ylabel=f"active contacts back at {100 * SERVICE:.0f} % [%]",
                     ylim=(-5, 105))  # fmt: skip
    chosen = [(row, states) for row, states in overloads if row.wire == wires[min(1, len(wires) - 1)]]
    for colour, (row, states) in zip(COLOURS, chosen[:: max(1, len(chosen) // 4)], strict=False):
        for stage, style in (("overload", "-"), ("back", "--")):
            own = [s for s in states if s.stage == stage]
            label = f"{100 * row.overload:.0f} %" if stage == "back" else None
            panels[0, 3].plot([100 * s.strain for s in own], [s.share for s in own], style, color=colour, label=label)
    panels[0, 3].set(xlabel="strain both ways [%]", ylabel="active contacts [%]",
                     title=f"{chosen[0][0].wire}: out (solid), back (dashed)", ylim=(-5, 105))  # fmt: skip
    panels[0, 3].title.set_fontsize(9)
    tidy(panels)
    figure.savefig(path)


def main() -> int:
    parser = new_parser(__doc__)
    add_directory(parser, quick="fewer cases")
    given = parser.parse_args()
    start_warp()
    few = slice(None, None, 3) if given.quick else slice(None)
    cycles = [cycle(mu, FINE) for mu in FRICTIONS[few]]
    show_rows([row for row, _ in cycles])
    overloads = [overload(*wire, strain, *YIELDING) for wire in WIRES for strain in OVERLOADS[few]]
    show_rows([row for row, _ in overloads])
    write_rows(table_path(given, "hysteresis.csv"), [row for row, _ in cycles])
    write_rows(table_path(given, "overload.csv"), [row for row, _ in overloads])
    draw(picture_path(given, "paths.png"), cycles, overloads)
    return 0


if __name__ == "__main__":
    sys.exit(main())
