"""The statements of the paper on its mesh, one by one: what it says, our figure, holds or not.

    python tools/studies/statements.py [DIR] [--cells N] [--quick]

Every statement is read from a map of 11 x 11 strain pairs from 0 to 20 %: of the periodic cell (scenes/atlas_cell.toml), of
the gripped 7 x 6 patch (scenes/atlas_patch.toml; all contacts, and the central rhombus), of cells with other proportions of
the loops, one changed at a time, and of the mean of N cells whose proportions are all scattered by 10 %. A row of a map is
one path: warp strain first, then weft strain. Leaves statements.csv, sweep.csv and statements.png. --quick leaves out
the patch.

The criteria, fixed before looking: a share is *few* below a quarter of that at 10 % both ways; *significant* is half of all
contacts; *around 10 %* is 7 to 13 %; *quickly* is at least 1.5 times as much as when warp strain drops by as much.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from study import add_directory, new_figure, new_parser, picture_path, run, scene_of, show_rows, table_path, write_rows

from warpknit import measure
from warpknit.base.errors import Diverged, SceneError
from warpknit.compute.device import start_warp
from warpknit.scene import Scene
from warpknit.solve.model import build_model

STRAINS = np.linspace(0.0, 0.2, 11)
FEW = 0.25  # of the share at 10 % both ways
SIGNIFICANT = 50.0  # [%] of the contacts
AROUND = (0.07, 0.13)  # strain
QUICKLY = 1.5  # times the loss when warp strain drops
DROP = 0.06  # of strain
HEAT = ("-190 degC", "140 degC")
SLACK = 1e-4  # [N/m]: what the draft preset leaves of the tension of a slack direction
SCATTER = 0.1  # relative standard deviation


@dataclass(frozen=True)
class ContactMap:
    """Shares [%] and tensions [N/m] over strains (weft, warp)."""

    strains: np.ndarray
    share: np.ndarray
    weft: np.ndarray
    warp: np.ndarray

    def at(self, values: np.ndarray, weft: float, warp: float) -> float:
        return float(values[self._index(weft), self._index(warp)])

    def _index(self, strain: float) -> int:
        return int(np.argmin(np.abs(self.strains - strain)))


@dataclass(frozen=True)
class Statement:
    """A row of statements.csv."""

    mesh: str
    statement: str
    ours: str
    value: float  # the number that decides
    bound: str
    holds: bool


@dataclass(frozen=True)
class SweepRow:
    """A row of sweep.csv: what decides each statement, for one geometry."""

    geometry: str
    bodies: int
    share_4: float  # [%] at 4 % both ways
    share_10: float
    share_20: float
    half_at: float  # strain both ways from which half of the contacts are active
    stiffness_alone: float  # warp over weft tension at 10 % in one direction, the other held
    stiffness_10: float  # warp over weft tangent stiffness at 10 % both ways
    stiffness_16: float
    share_weft_20: float  # [%] at 20 % in weft alone
    share_warp_20: float
    weft_half: float  # [%] mean share over the half of the map with more weft strain
    warp_half: float
    loss_weft: float  # points lost when weft strain drops by 6 points, mean over 10 .. 20 % both ways
    loss_warp: float
    few: bool
    warp_stiffer: bool
    warp_stiffer_hooked: bool
    needs_weft: bool
    around_10: bool
    lost_quickly: bool


# --- runs -------------------------------------------------------------------------------------------------------------


def contact_maps(file: str, *overrides: str, strains: np.ndarray = STRAINS) -> tuple[ContactMap, ContactMap]:
    """Maps of all contacts and of the central rhombus, nan without convergence. Raises SceneError where loops of such proportions
    make no knit.
    """
    n = len(strains)
    found = np.full((4, n, n), np.nan)
    frames = {"frames": n - 1}
    for column, warp in enumerate(strains):
        load = {"strain_weft": 0.0, "strain_warp": float(warp)}
        stage = [{"name": "weft", "strain_weft": float(strains[-1])}]
        scene = scene_of(file, "solver.preset=draft", *overrides, load=load, path=stage, output=frames)
        try:
            for record in run(scene):
                r = record.observables
                row = int(np.argmin(np.abs(strains - (r.gradient[0, 0] - 1.0))))
                rhombus = measure.contacts(r, r.model.panel.rhombus_bodies)
                found[:, row, column] = (measure.contacts(r).active_percent, rhombus.active_percent, *measure.mesh_tension(r))
        except Diverged as error:
            print(f"{' '.join(overrides)}, {100 * warp:.0f} % warp: left out from here on: {error}", file=sys.stderr)
    share, rhombus_share, weft, warp_tension = found
    return ContactMap(strains, share, weft, warp_tension), ContactMap(strains, rhombus_share, weft, warp_tension)


def heat_shares(file: str, *overrides: str) -> list[float]:
    """[%] of active contacts at 10 % both ways: at 20 degC, and at each of HEAT."""
    stages = [{"name": t, "temperature": t} for t in HEAT]
    load = {"strain_weft": 0.1, "strain_warp": 0.1}
    scene = scene_of(file, "solver.preset=draft", *overrides, load=load, path=stages, output={"frames": 5})
    ends = {record.stage: record for record in run(scene)}
    return [measure.contacts(record.observables).active_percent for record in ends.values()]


# --- what decides -----------------------------------------------------------------------------------------------------


def sweep_row(geometry: str, bodies: int, m: ContactMap) -> SweepRow:
    """Values that decide the statements on a map of at least 10 % +- 2 %."""
    diagonal = np.diagonal(m.share)
    reached = np.flatnonzero(diagonal >= SIGNIFICANT)
    half_at = float("nan")
    if len(reached) and reached[0]:
        k = int(reached[0])
        half_at = float(np.interp(SIGNIFICANT, diagonal[k - 1 : k + 1], m.strains[k - 1 : k + 1]))
    more_weft = np.tril(np.ones_like(m.share, dtype=bool), -1)
    weft_half, warp_half = float(np.nanmean(m.share[more_weft])), float(np.nanmean(m.share.T[more_weft]))
    bases = [e for e in m.strains if e > 0.0999]
    loss_weft = float(np.nanmean([m.at(m.share, e, e) - m.at(m.share, e - DROP, e) for e in bases]))
    loss_warp = float(np.nanmean([m.at(m.share, e, e) - m.at(m.share, e, e - DROP) for e in bases]))
    share_4, share_10 = m.at(m.share, 0.04, 0.04), m.at(m.share, 0.1, 0.1)
    alone = max(m.at(m.warp, 0.0, 0.1), SLACK) / max(m.at(m.weft, 0.1, 0.0), SLACK)
    stiff_10, stiff_16 = tangent_ratio(m, 0.1), tangent_ratio(m, 0.16)
    return SweepRow(
        geometry, bodies, share_4, share_10, m.at(m.share, 0.2, 0.2), half_at, alone, stiff_10, stiff_16,
        m.at(m.share, 0.2, 0.0), m.at(m.share, 0.0, 0.2), weft_half, warp_half, loss_weft, loss_warp,
        few=share_4 < FEW * share_10,
        warp_stiffer=alone > 1.0,
        warp_stiffer_hooked=stiff_10 > 1.0 and stiff_16 > 1.0,
        needs_weft=weft_half > warp_half and m.at(m.share, 0.2, 0.0) > m.at(m.share, 0.0, 0.2),
        around_10=share_10 >= SIGNIFICANT and AROUND[0] <= half_at <= AROUND[1],
        lost_quickly=loss_weft > 0.0 and loss_weft >= QUICKLY * loss_warp,
    )  # fmt: skip


def tangent_ratio(m: ContactMap, strain: float) -> float:
    """d(warp tension)/d(warp strain) over d(weft tension)/d(weft strain), across two points of strain on either side."""
    warp = m.at(m.warp, strain, strain + 0.02) - m.at(m.warp, strain, strain - 0.02)
    weft = m.at(m.weft, strain + 0.02, strain) - m.at(m.weft, strain - 0.02, strain)
    return warp / weft


def statements(mesh: str, s: SweepRow, heat: list[float] | None) -> list[Statement]:
    rows = [
        Statement(mesh, "few contacts at poor strain", f"{s.share_4:.0f} % at 4 % both ways, {s.share_10:.0f} % at 10 %",
                  s.share_4 / s.share_10 if s.share_10 else 0.0, f"< {FEW}", s.few),
        Statement(mesh, "warp stiffer than weft, each strained alone", f"tension warp / weft {s.stiffness_alone:.2f} at 10 %",
                  s.stiffness_alone, "> 1", s.warp_stiffer),
        Statement(mesh, "warp stiffer than weft, once hooked",
                  f"tangent warp / weft {s.stiffness_10:.2f} at 10 %, {s.stiffness_16:.2f} at 16 % both ways",
                  min(s.stiffness_10, s.stiffness_16), "> 1", s.warp_stiffer_hooked),
        Statement(mesh, "contacts need weft strain more than warp strain",
                  f"20 % alone: weft {s.share_weft_20:.0f} %, warp {s.share_warp_20:.0f} %; halves of the map"
                  f" {s.weft_half:.0f} / {s.warp_half:.0f} %", s.weft_half - s.warp_half, "> 0 points", s.needs_weft),
        Statement(mesh, "about 10 % both ways activates a significant number",
                  f"{s.share_10:.0f} % at 10 %; half of all from {100 * s.half_at:.1f} %",
                  s.half_at, "0.07 .. 0.13", s.around_10),
        Statement(mesh, "contacts are lost quickly when weft strain drops",
                  f"6 points less: weft {s.loss_weft:.0f}, warp {s.loss_warp:.0f} points lost", s.loss_weft - s.loss_warp,
                  f"weft >= {QUICKLY} warp", s.lost_quickly),
    ]  # fmt: skip
    if heat:
        change = max(abs(share - heat[0]) for share in heat)
        text = f"{heat[0]:.1f} % at 20 degC, " + ", ".join(f"{s:.1f} % at {t}" for s, t in zip(heat[1:], HEAT, strict=True))
        rows.append(Statement(mesh, "-190 .. +140 degC at 10 % leaves the share", text, change, "< 2 points", change < 2.0))
    return rows


# --- geometries -------------------------------------------------------------------------------------------------------

LOOP = {"closed_radius": 0.6, "closed_head": 0.55, "open_head": 0.5, "open_half_width": 0.26}
LIMITS = {"closed_radius": (0.35, 0.8), "closed_head": (0.3, 0.8), "open_head": (0.3, 0.8), "open_half_width": (0.22, 0.5)}
SIDES = {"closed_radius": (0.5, 0.7), "closed_head": (0.45, 0.65), "open_head": (0.4, 0.6), "open_half_width": (0.22, 0.34)}
GENERAL = {"foot_half_width": (0.09, 0.16), "leg_half_width": (0.2, 0.3), "head_height": (0.15, 0.35)}


def geometries() -> dict[str, list[str]]:
    """Overrides of each geometry, one proportion away from the default at a time."""
    found = {"default": []}
    for key, values in SIDES.items():
        found |= {f"{key} {value}": [f"knit.loop.{key}={value}"] for value in values}
    found |= {f"wale / course spacing {w}": [f'knit.wale_spacing="{w} mm"'] for w in (1.3, 1.5, 1.9)}
    found |= {f"body_radius d/{n}": [f'model.body_radius="{15 / n} um"'] for n in (32, 4, 2)}
    found["merge_lenses false"] = ["model.merge_lenses=false"]
    slim = "knit.loop.shape=general"
    found["general loops"] = [slim]
    for key, values in GENERAL.items():
        found |= {f"general {key} {value}": [slim, f"knit.loop.{key}={value}"] for value in values}
    return found


def scattered(count: int, seed: int = 0) -> list[list[str]]:
    """Overrides of cells with proportions drawn normally about the default, within limits."""
    rng = np.random.default_rng(seed)
    cells = []
    for _cell in range(count):
        drawn = {key: value * (1.0 + SCATTER * rng.standard_normal()) for key, value in LOOP.items()}
        cells.append([f"knit.loop.{key}={np.clip(value, *LIMITS[key]):.6g}" for key, value in drawn.items()])
    return cells


def mean_map(maps: list[ContactMap]) -> ContactMap:
    means = (np.nanmean([getattr(m, name) for m in maps], axis=0) for name in ("share", "weft", "warp"))
    return ContactMap(maps[0].strains, *means)


@cache
def body_count(scene: Scene) -> int:
    """Bodies of the whole mesh."""
    return build_model(scene).panel.body_count


# --- output -----------------------------------------------------------------------------------------------------------


def draw(path: Path, maps: dict[str, ContactMap]) -> None:
    """Contour pictures as in the paper's figure 8: weft horizontal, warp vertical."""
    figure, panels = new_figure(4.2 * len(maps) + 0.6, 4.2, 1, len(maps))
    for axes, (name, m) in zip(panels[0], maps.items(), strict=True):
        percent = 100.0 * m.strains
        filled = axes.contourf(percent, percent, m.share.T, levels=np.linspace(0, 100, 11), cmap="viridis")
        axes.plot(percent, percent, color="white", linewidth=0.8, linestyle=":")
        axes.set(title=name, xlabel="weft strain [%]", ylabel="warp strain [%]", aspect="equal")
    figure.colorbar(filled, ax=panels, label="active contacts [%]", shrink=0.85)
    figure.savefig(path)


def main() -> int:
    parser = new_parser(__doc__)
    add_directory(parser, quick="leave out the gripped patch")
    parser.add_argument("--cells", type=int, default=16, help="cells with scattered proportions")
    given = parser.parse_args()
    start_warp()
    cell = "atlas_cell.toml"
    sweep, maps, table = [], {}, []
    for name, overrides in geometries().items():
        try:
            m, _rhombus = contact_maps(cell, *overrides)
        except SceneError as error:
            print(f"{name}: {error}", file=sys.stderr)
            continue
        sweep.append(sweep_row(name, body_count(scene_of(cell, *overrides)), m))
        print(f"{name}: {m.at(m.share, 0.1, 0.1):.0f} % at 10 %", flush=True)
        if name == "default":
            maps["periodic cell"] = m
            table += statements("periodic cell", sweep[0], heat_shares(cell))
    if given.cells:
        cells = [contact_maps(cell, *overrides)[0] for overrides in scattered(given.cells)]
        maps[f"mean of {len(cells)} scattered cells"] = m = mean_map(cells)
        sweep.append(sweep_row(f"mean of {len(cells)} scattered cells", sweep[0].bodies, m))
        heat = np.mean([heat_shares(cell, *overrides) for overrides in scattered(given.cells)], axis=0)
        table += statements("scattered cells", sweep[-1], list(heat))
    if not given.quick:
        patch, rhombus = contact_maps("atlas_patch.toml")
        maps["gripped patch, all contacts"] = patch
        maps["gripped patch, central rhombus"] = rhombus
        heat = heat_shares("atlas_patch.toml")
        bodies = body_count(scene_of("atlas_patch.toml"))
        sweep.append(sweep_row("gripped patch, all", bodies, patch))
        table += statements("gripped patch, all", sweep[-1], heat)
        sweep.append(sweep_row("gripped patch, rhombus", 12, rhombus))
        table += statements("gripped patch, rhombus", sweep[-1], None)
    write_rows(table_path(given, "statements.csv"), table)
    write_rows(table_path(given, "sweep.csv"), sweep)
    draw(picture_path(given, "statements.png"), maps)
    show_rows(table)
    show_rows(sweep)
    return 0


if __name__ == "__main__":
    sys.exit(main())
