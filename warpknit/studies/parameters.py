"""Numerical parameters of a scene with their values, and the points of a study."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from ..mechanics.probe_settings import Varied, setting_of
from ..mechanics.protocols import Model
from ..scene.presets import PRESETS

Overrides = tuple[tuple[str, object], ...]

BASE = "base"  # name of the point with no parameter changed
STIFFNESSES = (0.25, 4.0, 16.0)  # times what the model chooses
LEVELS = (1, 2, 5, 10, 20)
PERIODS = (1.0, 3.0, 10.0, 30.0)  # slowest periods over which a ramp loads
DAMPINGS = (0.1, 0.3, 3.0)  # times the slowest angular frequency
SCALINGS = (100.0, 1e4)  # of all masses
STEPS = (3.0, 10.0)  # times the step that the real masses allow, reached by raising the masses of the nodes that limit it
BODY_MASSES = (0.1, 2.0)  # over half a loop of wire
RAMP_SOFTENINGS = (1.0, 100.0)


@dataclass(frozen=True)
class Point:
    """One choice of settings: overrides of the scene, and the group of the point."""

    group: str  # reference | preset | alone | together
    parameter: str  # the varied one; the preset; empty where several are
    overrides: Overrides
    preset: str | None = None

    @property
    def name(self) -> str:
        """Unique name, the same in every run of a study."""
        settings = " ".join(f"{key}={value}" for key, value in self.overrides)
        return f"{self.group}: {' '.join(part for part in (self.preset or '', settings) if part)}"


def reference_points(finest: Sequence[int], tolerance: float) -> list[Point]:
    """Reference runs: double precision, tightest tolerance, the finest first."""
    fixed = (("solver.precision", "double"), ("solver.residual_tolerance", tolerance), ("solver.drive", "relax"))
    softening = ("solver.axial_softening", PRESETS["reference"]["planar", "relax"].axial_softening)
    return [Point("reference", "", (("model.nodes_per_loop", n), *fixed, softening)) for n in finest]


def preset_points(base: Model) -> list[Point]:
    """The presets, which override the keys of the scene that they set."""
    drive = base.scene.solver.drive
    return [
        Point("preset", name, (
            ("model.nodes_per_loop", preset.nodes_per_loop), ("solver.axial_softening", preset.axial_softening),
            ("solver.residual_tolerance", preset.residual_tolerance),
        ), preset=name)
        for name, preset in ((name, presets[base.scene.model.kind, drive]) for name, presets in PRESETS.items())
    ]  # fmt: skip


def single_parameter_points(base: Model, varied: Varied) -> Iterator[Point]:
    """The scene itself, then one parameter varied at a time."""
    scene = base.scene
    preset = scene.solver.preset
    yield Point("alone", BASE, (), preset=preset)
    for parameter, key, values in _relaxation_parameters(base, varied):
        for value in values:
            yield Point("alone", parameter, ((key, value),), preset=preset)
    if scene.hook is None and scene.model.boundary == "gripped" and scene.panel.outline == "rectangle":
        for boundary, repeats in (("periodic", [1, 1]), ("gripped", [2, 2]), ("gripped", [4, 4])):
            overrides = (("model.boundary", boundary), ("knit.repeats", repeats))
            yield Point("alone", "size", overrides, preset=preset)


def _relaxation_parameters(base: Model, varied: Varied) -> Iterator[tuple[str, str, Sequence[object]]]:
    yield "nodes_per_loop", "model.nodes_per_loop", varied.nodes_per_loop
    yield "axial_softening", "solver.axial_softening", [_rounded(value) for value in varied.axial_softening]
    yield "residual_tolerance", "solver.residual_tolerance", varied.residual_tolerance
    yield "contact_stiffness", "contact.stiffness", [_rounded(factor * base.contact_stiffness) for factor in STIFFNESSES]
    yield "precision", "solver.precision", ("single", "double")
    yield "multipliers", "solver.multipliers", (False,)
    yield "levels", "output.frames", LEVELS
    if base.scene.hook is None:
        yield "merge_lenses", "model.merge_lenses", (not base.scene.model.merge_lenses,)


def ramp_points(base: Model, varied: Varied, period: float, time_step: float) -> Iterator[Point]:
    """A ramp in real time, then one of its parameters varied at a time.

    `period` [s]: of the slowest mode; `time_step` [s]: the stable one at the ramp's masses.
    """
    rate, preset = 2.0 * math.pi / period, base.scene.solver.preset
    drive = ("solver.drive", "ramp")
    yield Point("alone", "drive", (drive,), preset=preset)
    for parameter, key, values in (
        ("loading_time", "solver.loading_time", [_rounded(k * period) for k in PERIODS]),
        ("damping", "solver.damping", [_rounded(k * rate) for k in DAMPINGS]),
        ("target_time_step", "solver.target_time_step", [_rounded(k * time_step) for k in STEPS]),
        ("body_mass", "contact.body_mass", BODY_MASSES),
        ("ramp_softening", "solver.axial_softening", RAMP_SOFTENINGS),
        ("ramp_nodes", "model.nodes_per_loop", varied.ramp_nodes_per_loop),
    ):
        for value in values:
            yield Point("alone", parameter, (drive, (key, value)), preset=preset)
    for value in SCALINGS:
        # mass scaling scales every period: the loading time is unchanged in periods
        yield Point("alone", "mass_scaling", (drive, ("solver.mass_scaling", value)), preset=preset)


def combined_points(base: Model, varied: Varied, finest: int) -> Iterator[Point]:
    """Several parameters varied together."""
    _nodes, *others = setting_of(base.scene).overrides
    for setting in varied.combined:
        changed = tuple(each for each in setting.overrides if each not in others)
        if setting.nodes_per_loop < finest and len(changed) > 1:
            yield Point("together", "", changed)


def _rounded(value: float) -> float:
    """The value to three digits, for the tables."""
    return float(f"{value:.3g}")
