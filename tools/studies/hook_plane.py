"""The planar hook of hooks.py: runs of its contact treatments, and their errors."""

from __future__ import annotations

import argparse
import itertools
import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from hook_reference import Contact, Hook
from matplotlib.axes import Axes
from study import COLOURS, CROSSES, SCENES, new_figure, picture_path, table_path, tidy, without_nan, write_rows

from warpknit.base.errors import Diverged
from warpknit.measure.observables import HookContact
from warpknit.planar.model import Model
from warpknit.scene import Scene, load_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation

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
    simulation = Simulation(model)
    simulation.compile()
    begin = time.perf_counter()
    states, note = [], ""
    try:
        for record in simulation.run():
            states.append(record.observables.hook_contact)
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
    for a, b in itertools.pairwise(states):
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


def study_plane(given: argparse.Namespace) -> None:
    done = in_plane(given.nodes)
    write_rows(table_path(given, "hook_sweeps.csv"), [f.outcome for runs in done.values() for f in runs])
    write_rows(table_path(given, "hook_curves.csv"), list(curve_rows(done["treatments"])))
    draw_plane(picture_path(given, "hook_study.png"), done)
