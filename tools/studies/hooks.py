"""Two hooked wires: what the treatments of their contact miss in the plane, and what the plane misses of wires in space.

    python tools/studies/hooks.py plane [DIR] [--nodes N]                  some minutes
    python tools/studies/hooks.py space [DIR] [--nodes N] [--levels N]     about fifteen minutes

*plane* runs scenes/hook_*.toml and sweeps what each treatment has of its own. It prints a table and leaves hook_curves.csv (a row
a recorded state), hook_sweeps.csv (a row a run), and hook_study.png. The reference, hook_reference.py, is solved at the span of
each treatment (1.25 d where a body of radius d/8 sits in between, d for a point, negative for a ring), so that an error is the
treatment's and not its geometry's; `against_hook` compares with 1.25 d whatever the treatment.

*space* runs the hook in space and with a free body at several coefficients of friction, and without friction with wires that
touch at a part of their thickness and with other resistance to twist; it compares them with the reference at fixed spans, and at
the span that wires which wind round each other keep (lens_law.py). It leaves hook_spatial.csv and hook_spatial.png.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from hook_reference import Contact, Hook
from lens_law import Law
from matplotlib.axes import Axes
from study import COLOURS, SCENES, add_directory, new_figure, picture_path, run_one_of, table_path, tidy, write_rows

from warpknit.errors import Diverged
from warpknit.model import build_model
from warpknit.planar.hook_contact import HookContact, hook_contact
from warpknit.planar.model import Model
from warpknit.planar.state import initial_state
from warpknit.scene import Scene, load_scene
from warpknit.solve.simulate import Simulation
from warpknit.spatial.hook_contact import hook_contact as spatial_hook_contact
from warpknit.spatial.model import SpatialModel

CROSSES: dict[str, Any] = {"linestyle": "none", "marker": "x", "markersize": 8}

# --- in the plane -----------------------------------------------------------------------------------------------------

TREATMENTS = ("point", "spring_point", "spring_cylinder", "ring", "friction_plane", "free_body")
COLOUR = dict(zip(TREATMENTS, (COLOURS[k] for k in (3, 4, 1, 2, 5, 0)), strict=True))
LEAST_FORCE = 1e-4  # [N] of the contact at which errors are taken: before, the wires only begin to touch


@dataclass(frozen=True)
class Outcome:
    """A row of sweeps.csv: a run, at its last recorded state, and the largest errors on the way."""

    treatment: str
    parameter: str
    value: float
    force_left_N: float
    force_right_N: float
    reference_N: float  # at the treatment's own span
    force_error: float  # of the mean of both forces, at the end
    force_error_most: float  # on the way, where the contact carries LEAST_FORCE
    arc_left_error_d: float  # largest on the way, in diameters
    arc_right_error_d: float
    against_hook: float  # of the force at the end, against the reference at 1.25 d
    slide_left_m: float
    slide_right_m: float
    ground_force_N: float
    steps: int
    wall_s: float
    note: str


@dataclass(frozen=True)
class Finished:
    """A run with its states."""

    outcome: Outcome
    states: list[HookContact]
    references: list[Contact]


@cache
def references(hook: Hook, displacements: tuple[float, ...]) -> list[Contact]:
    return hook.solve(displacements)


def span_of(model: Model) -> float:
    """[m] by which the wires are apart across the contact; a single contact point has one reach, a body two."""
    return model.treatment.reach * (1.0 if model.treatment.contact_node is not None else 2.0)


def reference_of(scene: Scene, span: float) -> Hook:
    h, wire = scene.hook, scene.wire
    return Hook(h.radius, h.length, h.overlap, span, wire.bending_stiffness, wire.axial_stiffness)


def run(treatment: str, parameter: str, value: float, *overrides: str) -> Finished:
    """Run one scene and compare it, state by state."""
    scene = load_scene(SCENES / f"hook_{treatment}.toml", overrides)
    model = build_model(scene)
    simulation = Simulation(model, initial_state(model))
    simulation.compile()
    begin = time.perf_counter()
    states, note = [], ""
    try:
        for record in simulation.run():
            states.append(hook_contact(record.observables))
    except Diverged:
        note = "does not converge"
    wall = time.perf_counter() - begin
    displacements = tuple(round(s.displacement, 15) for s in states)
    found = references(reference_of(scene, span_of(model)), displacements)
    hooks = references(reference_of(scene, 1.25 * scene.wire.diameter), displacements)
    force = np.array([0.5 * (s.force_left + s.force_right) for s in states])
    wanted = np.array([c.force for c in found])
    counted = np.flatnonzero(wanted > LEAST_FORCE)
    missed = counted[force[counted] == 0.0]
    if len(missed):
        first = f"{1e3 * displacements[missed[0]]:.2f} mm"
        note = f"missed from {first} on" if force[-1] == 0.0 else f"bounces at {first}"
    errors = force[counted] / wanted[counted] - 1.0
    arcs = [
        (abs(states[k].arc_left - found[k].arc_left), abs(states[k].arc_right - found[k].arc_right))
        for k in counted
        if force[k] > 0.0
    ]
    d = scene.wire.diameter
    most = np.max(arcs, axis=0) / d if arcs else [math.nan, math.nan]
    slides = [0.0, 0.0]
    for a, b in zip(states, states[1:], strict=False):
        if a.is_closed and b.is_closed:
            slides[0] += abs(b.arc_left - a.arc_left)
            slides[1] += abs(b.arc_right - a.arc_right)
    last, end = states[-1], float(wanted[-1])
    outcome = Outcome(
        treatment, parameter, value, last.force_left, last.force_right, end,
        float(force[-1] / end - 1.0) if end else math.nan, float(np.abs(errors).max(initial=0.0)), float(most[0]), float(most[1]),
        float(force[-1] / hooks[-1].force - 1.0) if hooks[-1].force else math.nan, slides[0], slides[1], last.ground_force,
        simulation.progress.steps, wall, note,
    )  # fmt: skip
    show_outcome(outcome)
    return Finished(outcome, states, found)


HEADINGS = ("treatment", "parameter", "value", "force mN", "reference", "error", "worst", "left d", "right d", "vs hook",
            "ground uN", "steps", "s")  # fmt: skip
WIDTHS = (18, 22, 9, 9, 9, 8, 8, 7, 7, 8, 9, 9, 6)


def show_outcome(o: Outcome) -> None:
    cells = (
        o.treatment, o.parameter, f"{o.value:.3g}", f"{5e2 * (o.force_left_N + o.force_right_N):.4f}",
        f"{1e3 * o.reference_N:.4f}", f"{o.force_error:+.2%}", f"{o.force_error_most:.2%}", f"{o.arc_left_error_d:.3f}",
        f"{o.arc_right_error_d:.3f}", f"{o.against_hook:+.2%}", f"{1e6 * o.ground_force_N:.3g}", f"{o.steps:,}",
        f"{o.wall_s:.2f}",
    )  # fmt: skip
    print(" ".join(f"{c:>{w}}" for c, w in zip(cells, WIDTHS, strict=True)), o.note, flush=True)


def in_plane(nodes: int) -> dict[str, list[Finished]]:
    """All runs, by what is varied."""
    size = f"model.nodes_per_loop={nodes}"
    print(" ".join(f"{c:>{w}}" for c, w in zip(HEADINGS, WIDTHS, strict=True)))
    done = {"treatments": [run(t, "as in its scene", math.nan, size) for t in TREATMENTS]}
    done["nodes"] = [run("free_body", "nodes_per_loop", n, f"model.nodes_per_loop={n}") for n in (16, 24, 32, 48, 64, 96)]
    for treatment in ("spring_point", "spring_cylinder", "ring"):
        done[treatment] = [
            run(treatment, "spring_stiffness", k, size, f"contact.spring_stiffness={k:.6g}") for k in np.logspace(-5.5, -0.5, 11)
        ]
    done["friction_plane"] = [
        run("friction_plane", "plane_friction", mu, size, f"contact.plane_friction={mu:.6g}") for mu in np.logspace(-2, 1, 7)
    ]
    done["body_mass"] = [
        run("free_body_dynamic", "body_mass", m, size, f"contact.body_mass={m:g}") for m in (0.01, 0.03, 0.1, 0.3, 1.0)
    ]
    done["loading_time"] = [
        run("free_body_dynamic", "loading_time", t, size, "contact.body_mass=0.1", f"solver.loading_time={t:g}")
        for t in (3e-4, 1e-3, 3e-3, 1e-2)
    ]
    done["contact_point"] = [
        run("point", "contact_point", p, size, f"contact.contact_point={p:g}", "contact.target_share=1")
        for p in (0.25, 0.3, 0.35, 0.4, 0.45, 0.5, 0.55, 0.6, 0.65)
    ]
    done["target_share"] = [
        run("point", "target_share", share, size, f"contact.target_share={share:g}") for share in (0.06, 0.1, 0.15, 0.2, 1.0)
    ]
    return done


@dataclass(frozen=True)
class CurveRow:
    """A row of hook_curves.csv: a recorded state beside the reference, SI."""

    treatment: str
    displacement: float
    drive_force: float
    force_left: float
    force_right: float
    arc_left: float
    arc_right: float
    ground_force: float
    reference_force: float
    reference_arc_left: float | None
    reference_arc_right: float | None


def curve_rows(runs: Sequence[Finished]) -> Iterator[CurveRow]:
    for run_ in runs:
        for s, c in zip(run_.states, run_.references, strict=True):
            yield without_nan(CurveRow(
                run_.outcome.treatment, s.displacement, s.drive_force, s.force_left, s.force_right, s.arc_left, s.arc_right,
                s.ground_force, c.force, c.arc_left, c.arc_right,
            ))  # fmt: skip


def draw_plane(path: Path, done: dict[str, list[Finished]]) -> None:
    """Curves of all treatments, and the error of each against its own parameter."""
    figure, panels = new_figure(13.0, 8.0, 2, 3)
    for f in done["treatments"]:
        name = f.outcome.treatment
        u = [1e3 * s.displacement for s in f.states]
        label = name.replace("_", " ")
        panels[0, 0].plot(u, [5e2 * (s.force_left + s.force_right) for s in f.states], color=COLOUR[name], label=label)
        for axes, side, reference in ((panels[0, 1], "left", None), (panels[0, 2], "right", None)):
            arc = [1e3 * getattr(s, f"arc_{side}") if s.is_closed else math.nan for s in f.states]
            axes.plot(u, arc, color=COLOUR[name], label=label)
            if name == "free_body":
                reference = [1e3 * getattr(c, f"arc_{side}") for c in f.references]
                axes.plot(u, reference, color="black", label="reference", **CROSSES)
        if name == "free_body":
            force = [1e3 * c.force for c in f.references]
            panels[0, 0].plot(u, force, color="black", label="reference", **CROSSES)
    panels[0, 0].set(xlabel="displacement [mm]", ylabel="contact force [mN]")
    for axes, side in ((panels[0, 1], "left"), (panels[0, 2], "right")):
        axes.set(xlabel="displacement [mm]", ylabel=f"contact on the {side} wire [mm from its clamp]")
    for name in ("spring_point", "spring_cylinder", "ring"):
        runs = done[name]
        _curve(panels[1, 0], runs, COLOUR[name], name.replace("_", " "))
    panels[1, 0].set(xlabel="stiffness of the ground spring [N/m]")
    _curve(panels[1, 1], done["friction_plane"], COLOUR["friction_plane"], "friction plane, load 10 µN")
    panels[1, 1].set(xlabel="friction coefficient [-]")
    _curve(panels[1, 2], done["body_mass"], COLOUR["free_body"], "free body, loading in 3.7 ms")
    at_rest = [abs(f.outcome.force_error) for f in done["body_mass"]]
    mass = [f.outcome.value for f in done["body_mass"]]
    panels[1, 2].plot(mass, at_rest, color="black", marker="x", markersize=5, label="force once it rests")
    panels[1, 2].set(xlabel="mass of the body over half a wire [-]")
    for axes in panels[1]:
        axes.set(xscale="log", yscale="log", ylabel="largest error on the way: force [-], place [d]", ylim=(1e-4, 20.0))
        axes.axhline(0.01, color="#999999", linewidth=0.8, linestyle=":")
    tidy(panels)
    figure.savefig(path)


def _curve(axes: Axes, runs: list[Finished], colour: str, label: str) -> None:
    """Largest errors on the way of runs that ended, against what is varied."""
    runs = [f for f in runs if f.outcome.force_left_N > 0.0]
    value = [f.outcome.value for f in runs]
    axes.plot(value, [f.outcome.force_error_most for f in runs], color=colour, marker="o", markersize=4, label=f"{label}: force")
    place = [max(f.outcome.arc_left_error_d, f.outcome.arc_right_error_d) for f in runs]
    axes.plot(value, place, color=colour, linestyle="--", marker="s", markersize=4, label=f"{label}: place")


# --- in space ----------------------------------------------------------------------------------------------------------

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
    span_d: float = math.nan  # in the plane, in thicknesses where they touch
    steps: int = 0
    wall_s: float = 0.0


def spatial(overrides: Sequence[str], friction: float = 0.0, thickness: float = 1.0, twist: float = 1.0) -> list[Row]:
    """The hook in space."""
    scene = load_scene(SCENES / "hook_spatial.toml", [*overrides, f"contact.friction={friction}"])
    if thickness != 1.0:
        assert scene.hook is not None and scene.hook.crossing_distance is not None
        crossing = thickness * scene.hook.crossing_distance
        scene = replace(scene, hook=replace(scene.hook, crossing_distance=crossing))
    mesh = build_model(scene)
    section = mesh.rods.section
    section = replace(section, twist_stiffness=twist * section.twist_stiffness)
    radius = np.full(2, 0.5 * thickness * section.thickness)
    mesh = replace(mesh, rods=replace(mesh.rods, section=section, thicker=radius))
    return list(_spatial_rows(mesh, friction, thickness, twist))


def _spatial_rows(mesh: SpatialModel, friction: float, thickness: float, twist: float) -> Iterator[Row]:
    begin = time.perf_counter()
    for record in Simulation(mesh).run():
        found, t = spatial_hook_contact(record.observables), record.observables.touching
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
    """The hook in the plane."""
    given = [o for o in overrides if not o.startswith("model.")]
    model = build_model(load_scene(SCENES / "hook_free_body.toml", [*given, f"contact.friction={friction}"]))
    begin, rows = time.perf_counter(), []
    for record in Simulation(model, initial_state(model)).run():
        c: HookContact = hook_contact(record.observables)
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


def without_nan(row: Any) -> Any:
    """The same with None where a kind has no such number, which leaves its cell empty."""
    none = [f.name for f in fields(row) if isinstance(value := getattr(row, f.name), float) and math.isnan(value)]
    return replace(row, **dict.fromkeys(none))


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

    curve(panels[0], "spatial", "in space", color=blue, marker="o")
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


# --- command line -----------------------------------------------------------------------------------------------------


def study_plane(given: argparse.Namespace) -> None:
    done = in_plane(given.nodes)
    write_rows(table_path(given, "hook_sweeps.csv"), [f.outcome for runs in done.values() for f in runs])
    write_rows(table_path(given, "hook_curves.csv"), list(curve_rows(done["treatments"])))
    draw_plane(picture_path(given, "hook_study.png"), done)


def study_space(given: argparse.Namespace) -> None:
    rows = in_space([f"output.frames={given.levels}", f"model.nodes_per_loop={given.nodes}"])
    write_rows(table_path(given, "hook_spatial.csv"), [without_nan(row) for row in rows])
    draw_space(picture_path(given, "hook_spatial.png"), rows)


def add_options(name: str, parser: argparse.ArgumentParser) -> None:
    add_directory(parser)
    parser.add_argument("--nodes", type=int, default=48, help="segments a wire")
    if name == "space":
        parser.add_argument("--levels", type=int, default=8)


if __name__ == "__main__":
    sys.exit(run_one_of(__doc__, {"plane": study_plane, "space": study_space}, add_options))
