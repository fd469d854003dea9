"""The spatial hook of hooks.py, beside planar one, reference and lens law."""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from hook_reference import Contact
from lens_law import Law
from matplotlib.axes import Axes
from study import COLOURS, CROSSES, SCENES, new_figure, picture_path, table_path, tidy, without_nan, write_rows

from warpknit.measure.observables import HookContact
from warpknit.scene import load_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation
from warpknit.spatial.model import SpatialModel

FRICTION = (0.0, 0.2, 0.4)
THICKNESS = (0.5, 0.25)  # of the wire's
TWIST = (0.01, 10.0)  # of the wire's GJ


@dataclass(frozen=True)
class Row:
    """One state of one hook, SI; what a kind does not have is nan."""

    kind: str  # spatial | free body | reference 1 d | reference 1.25 d | lens law
    friction: float
    thickness: float  # over the wire's, where it touches
    twist: float  # GJ over the wire's
    displacement_m: float
    force_N: float
    drive_N: float
    arc_left_m: float
    arc_right_m: float
    contacts: int = 0
    contact_force_N: float = math.nan  # of all contacts, added up as numbers
    across: float = math.nan  # share of that which is across the plane
    span_d: float = math.nan  # planar, in thicknesses where they touch
    steps: int = 0
    wall_s: float = 0.0


def spatial(overrides: Sequence[str], friction: float = 0.0, thickness: float = 1.0, twist: float = 1.0) -> list[Row]:
    """The spatial hook."""
    scene = load_scene(SCENES / "hook_spatial.toml", [*overrides, f"contact.friction={friction}"])
    if thickness != 1.0:
        assert scene.hook is not None and scene.hook.crossing_distance is not None
        crossing = thickness * scene.hook.crossing_distance
        scene = replace(scene, hook=replace(scene.hook, crossing_distance=crossing))
    mesh = build_model(scene)
    section = mesh.rods.section
    section = replace(section, twist_stiffness=twist * section.twist_stiffness)
    sections = (replace(section, thickness=thickness * section.thickness),) * 2
    mesh = replace(mesh, rods=replace(mesh.rods, section=section, sections=sections))
    return list(_spatial_rows(mesh, friction, thickness, twist))


def _spatial_rows(mesh: SpatialModel, friction: float, thickness: float, twist: float) -> Iterator[Row]:
    begin = time.perf_counter()
    for record in Simulation(mesh).run():
        found, t = record.observables.hook_contact, record.observables.touching
        total = float(t.force.sum())
        row = Row(
            "spatial", friction, thickness, twist, found.displacement, found.force_left, found.drive_force,
            found.arc_left, found.arc_right, len(t.force), total,
            float(np.abs(t.force * t.normal[:, 2]).sum()) / total if total else math.nan,
            steps=record.steps, wall_s=time.perf_counter() - begin,
        )  # fmt: skip
        show(row)
        yield row


def free_body(overrides: Sequence[str], friction: float) -> list[Row]:
    """The planar hook."""
    given = [o for o in overrides if not o.startswith("model.")]
    model = build_model(load_scene(SCENES / "hook_free_body.toml", [*given, f"contact.friction={friction}"]))
    begin, rows = time.perf_counter(), []
    for record in Simulation(model).run():
        c: HookContact = record.observables.hook_contact
        rows.append(Row("free body", friction, 1.0, 1.0, c.displacement, 0.5 * (c.force_left + c.force_right), c.drive_force,
                        c.arc_left, c.arc_right, steps=record.steps, wall_s=time.perf_counter() - begin))  # fmt: skip
        show(rows[-1])
    return rows


def row_of(kind: str, c: Contact, thickness: float, span: float) -> Row:
    return Row(kind, 0.0, thickness, 1.0, c.displacement, c.force, c.drive, c.arc_left, c.arc_right, span_d=span)


def law_rows(law: Law, thickness: float, displacements: Sequence[float]) -> list[Row]:
    """The lens law at displacements [m] where it presses."""
    rows = []
    for displacement in displacements:
        found = law.solve(displacement)
        if found is None:
            continue
        c, lens = found
        row = row_of("lens law", c, thickness, lens.span / law.thickness)
        rows.append(replace(row, contacts=2, contact_force_N=2.0 * lens.contact_force, across=lens.across))
        show(rows[-1])
    return rows


def in_space(overrides: Sequence[str]) -> list[Row]:
    scene = load_scene(SCENES / "hook_spatial.toml", overrides)
    hook, wire = scene.hook, scene.wire
    assert hook is not None and hook.crossing_distance is not None
    rows: list[Row] = []
    for friction in FRICTION:
        rows += free_body(overrides, friction) + spatial(overrides, friction)
    displacements = [round(r.displacement_m, 12) for r in rows if r.kind == "spatial" and r.friction == 0.0]
    for thickness in (1.0, *THICKNESS):
        d = thickness * wire.thickness
        law = Law(replace(hook, crossing_distance=thickness * hook.crossing_distance), wire.bending_stiffness, d)
        rows += law_rows(law, thickness, displacements)
        for span in (1.0, 1.25):
            found = replace(law.planar, span=span * d).solve(displacements)
            rows += [row_of(f"reference {span:g} d", c, thickness, span) for c in found]
        if thickness != 1.0:
            rows += spatial(overrides, thickness=thickness)
    for twist in TWIST:
        rows += spatial(overrides, twist=twist)
    return rows


def show(r: Row) -> None:
    what = f"{r.kind:16s} mu {r.friction:3.1f} d x {r.thickness:4.2f} GJ x {r.twist:5.2f}"
    place = f"{1e3 * r.arc_left_m:7.4f} {1e3 * r.arc_right_m:7.4f} mm"
    pressed = f"{r.contacts} contacts {1e3 * r.contact_force_N:6.3f} mN, {r.across:5.3f} across, span {r.span_d:6.3f}"
    force = f"{1e3 * r.displacement_m:5.2f} mm {1e3 * r.force_N:8.4f} mN"
    print(f"{what} {force} at {place} {pressed} {r.steps:9,} {r.wall_s:6.1f} s", flush=True)


def draw_space(path: Path, rows: list[Row]) -> None:
    """Force against displacement without friction, by thickness, and with friction."""
    figure, ((*panels,),) = new_figure(13.0, 4.4, 1, 3)
    blue, red, green, pink = COLOURS[:4]
    several = (blue, green, pink)

    def curve(axes: Axes, kind: str, label: str, *, friction: float = 0.0, thickness: float = 1.0, **style) -> None:
        same = (kind, friction, thickness, 1.0)
        chosen = [r for r in rows if (r.kind, r.friction, r.thickness, r.twist) == same]
        axes.plot([1e3 * r.displacement_m for r in chosen], [1e3 * r.force_N for r in chosen], label=label, **style)

    curve(panels[0], "spatial", "spatial", color=blue, marker="o")
    curve(panels[0], "lens law", "plane, span of the lens law", color="black", **CROSSES)
    curve(panels[0], "reference 1.25 d", "plane, span 1.25 d", color=red)
    curve(panels[0], "reference 1 d", "plane, span 1 d", color=red, linestyle="--")
    for thickness, colour in zip((1.0, *THICKNESS), several, strict=True):
        curve(panels[1], "spatial", f"touching at {thickness:g} d", thickness=thickness, color=colour, marker="o")
        curve(panels[1], "reference 1.25 d", "_", thickness=thickness, color=colour, linestyle=":")
        curve(panels[1], "lens law", "_", thickness=thickness, color=colour, **CROSSES)
    panels[1].plot([], [], color="grey", linestyle=":", label="plane, 1.25 of that")
    panels[1].plot([], [], label="lens law", color="grey", **CROSSES)
    for friction, colour in zip(FRICTION, several, strict=True):
        curve(panels[2], "spatial", f"friction {friction:g}", friction=friction, color=colour, marker="o")
        curve(panels[2], "free body", "_", friction=friction, color=colour, linestyle=":")
    panels[2].plot([], [], color="grey", linestyle=":", label="plane, free body")
    for axes in panels:
        axes.set(xlabel="displacement [mm]", ylabel="contact force [mN]")
    tidy(np.array(panels))
    figure.savefig(path)


def study_space(given: argparse.Namespace) -> None:
    rows = in_space([f"output.frames={given.levels}", f"model.nodes_per_loop={given.nodes}"])
    write_rows(table_path(given, "hook_spatial.csv"), [without_nan(row) for row in rows])
    draw_space(picture_path(given, "hook_spatial.png"), rows)
