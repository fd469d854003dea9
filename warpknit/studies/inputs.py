"""Inputs for unmeasured loops: openings per length, wire length a loop, a biaxial test.

Wales and courses are scaled to the openings, their ratio kept.

Loops get one factor on the proportions that make them large (SIZES), for all loops or for each bar. Lengths are measured along
the spatial wire, in both models.
"""

from __future__ import annotations

import csv
import itertools
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
from scipy.constants import inch
from scipy.optimize import brentq, minimize_scalar

from .. import measure
from ..base.errors import Diverged, InputError
from ..base.files import write_aside
from ..base.text import at_least, at_most, exact, percent
from ..knit.lapping import KnitError, lapping_table
from ..knit.loops import RANGES, SIZES, LoopProportions, loop_shape
from ..knit.openings import find_openings
from ..mesh.layout import knit_scene
from ..runner.progress_display import Display
from ..scene import Knit, Scene
from ..scene.knit import Bar
from ..scene.scene import Override
from ..solve.model import build_model
from .load_path import states_at

# of fit.json: name of the fit, or of the file of a biaxial test; factor on all loops, and proportions of knit.loop; factors on
# the loops of each bar; rms error over the tensions of a test
NO_LOOPS: dict[str, object] = {"fitted_to": None, "factor": None, "bar_factors": None, "rms_error": None, "loop": {}}
FIT_TOLERANCE = 2e-3  # of the factor
EDGE, SHORTER = 1e-9, 0.8  # distance of a factor from the end of its range; reduction of one that cannot be knitted


@dataclass(frozen=True)
class Fitted:
    """A fitted scene, with notes and the fit of its loops."""

    scene: Scene
    notes: tuple[str, ...] = ()
    loops: Mapping[str, object] = field(default_factory=dict)  # keys of fit.json (NO_LOOPS); empty without a fit

    def then(self, other: Fitted) -> Fitted:
        """`other`, fitted from this scene, with the notes and fits of both."""
        return Fitted(other.scene, self.notes + other.notes, other.loops or self.loops)


def fit_loop_length(scene: Scene, wanted: float) -> Fitted:
    """Loops with a wire length of `wanted` [m] each. Raises `InputError` if it cannot be reached."""
    factor = _factor(scene, lambda factor: knit_scene(scaled(scene, factor)).wire_length, *factors(scene), wanted)
    return fitted_by(scene, factor, "the wire length per loop", "loop length")


def fit_run_in(scene: Scene, wanted: tuple[float, ...]) -> Fitted:
    """Loops of each bar of `knit.bars` with the `wanted` length [m] a course. Raises `InputError` out of its range."""
    bars = scene.knit.bars
    if len(wanted) != len(bars):
        given = ", ".join(exact(length, "m") for length in wanted)
        wrong = f"{given} are {len(wanted)} lengths for {len(bars)} bars"
        raise InputError(f"{scene.path}: --fit-loop-length: {wrong}; give one length, or one for each bar")
    fit, found = scene, []
    for bar, length in enumerate(wanted):
        larger = partial(_with_bar, fit, bar)
        low, high = _bounded(fit, bars[bar : bar + 1], larger)
        length_of = partial(_run_in, larger, bar)
        found.append(_factor(scene, length_of, low, high, length, of=f" for bar {bar + 1}"))
        fit = larger(found[-1])
    text = ", ".join(f"bar {bar + 1}: {factor:.3f}" for bar, factor in enumerate(found))
    note = f"loop proportions of each bar times a factor fitted to its run-in ({text})"
    meant, hooks = len(knit_scene(scene).clasps), len(knit_scene(fit).clasps)
    if hooks != meant:
        note += f"; wires then hook {hooks} times per repeat in plan view, not {meant} times as with loops of one size"
    return Fitted(fit, (note,), {"fitted_to": "run-in", "bar_factors": tuple(found)})


def _run_in(larger: Callable[[float], Scene], bar: int, factor: float) -> float:
    """[m] wire of a bar a course, with its loops larger by a factor."""
    return knit_scene(larger(factor)).run_in(bar)


def _factor(scene: Scene, length: Callable[[float], float], low: float, high: float, wanted: float, of: str = "") -> float:
    """Factor between `low` and `high` at which a `length` [m] is as `wanted`. Raises `InputError`."""

    def missing(factor: float) -> float:
        return length(factor) - wanted

    ends = missing(low), missing(high)
    if not min(ends) <= 0.0 <= max(ends):
        raise InputError(
            f"{scene.path}: --fit-loop-length: {exact(wanted, 'm')}{of} takes proportions of knit.loop out of their ranges;"
            f" give {at_least(wanted + min(ends), 'm')} to {at_most(wanted + max(ends), 'm')} with these spacings"
        )
    return float(brentq(missing, low, high, xtol=FIT_TOLERANCE / 10))


def _with_bar(scene: Scene, bar: int, factor: float) -> Scene:
    bars = list(scene.knit.bars)
    bars[bar] = replace(bars[bar], loop_scale=factor * bars[bar].loop_scale)
    return replace(scene, knit=replace(scene.knit, bars=tuple(bars)))


def scaled(scene: Scene, factor: float) -> Scene:
    """The scene with all loops larger by a factor."""
    loop = scene.knit.loop
    larger = {name: factor * getattr(loop, name) for name in _names(scene)}
    return replace(scene, knit=replace(scene.knit, loop=replace(loop, **larger)))


def fitted_by(scene: Scene, factor: float, how: str, to: str, rms_error: float | None = None) -> Fitted:
    """The scene scaled by `factor`. Raises `InputError` if its wires hook differently."""
    larger = scaled(scene, factor)
    meant, found = len(knit_scene(scene).clasps), len(knit_scene(larger).clasps)
    if found != meant:
        wrong = f"the fitted loops hook {found} times per repeat, the loops of the scene {meant} times"
        raise InputError(f"{scene.path}: {how}: {wrong}; use a value closer to the scene")
    loop = {name: getattr(larger.knit.loop, name) for name in _names(scene)}
    loops = {"fitted_to": to, "factor": factor, "rms_error": rms_error, "loop": loop}
    return Fitted(larger, (f"loop proportions times {factor:.3f}, fitted to {how}",), loops)


def _names(scene: Scene) -> tuple[str, ...]:
    return SIZES[loop_shape(lapping_table(scene.knit.bars, (1, 1)), LoopProportions.of(scene.knit.loop))]


def factors(scene: Scene) -> tuple[float, float]:
    """Smallest and largest factor with proportions in range and neighbouring wales separate."""
    return _bounded(scene, scene.knit.bars, lambda factor: scaled(scene, factor))


def _bounded(scene: Scene, bars: Sequence[Bar], larger: Callable[[float], Scene]) -> tuple[float, float]:
    """The same for the loops of some bars; larger: the scene at a factor."""
    sizes = [bar.loop_scale for bar in bars]
    ranges = [np.array(RANGES[name]) / (getattr(scene.knit.loop, name) * size) for name in _names(scene) for size in sizes]
    low, high = max(float(r[0]) for r in ranges) + EDGE, min(float(r[1]) for r in ranges) - EDGE
    while high > 1.0:
        try:
            knit_scene(larger(high))
        except KnitError:
            high = 1.0 + SHORTER * (high - 1.0) if high - 1.0 > FIT_TOLERANCE else 1.0
        else:
            break
    return low, high


COMPLETE = 2.0 / 3.0  # of the largest area: openings that are counted; between wales 0.72 or more, within loops 0.58 or less
FAR = 1.25  # reported change of the spacings, or its inverse
COLUMNS = ("strain_weft", "strain_warp", "tension_weft_N_per_m", "tension_warp_N_per_m")  # of a measured curve
POOR_FIT, NO_FIT = 0.1, 0.5  # rms error over the tensions: reported; refused
FIT = "fit.json"
MOST_TRIED = 20  # factors
REMAINING = 5  # factors still to try, about, for the progress


@dataclass(frozen=True)
class Known:
    """Measured properties of the mesh, in addition to its scene; None where unknown."""

    openings: float | None = None  # [1/m]
    loop_length: tuple[float, ...] | None = None  # [m] of a loop, or of the loops of each bar
    curve: Path | None = None
    areal_mass: float | None = None  # [kg/m2] as knitted; for comparison only


def with_known(scene: Scene, known: Known, progress: Display | None = None) -> Fitted:
    """`scene` fitted to the `known` properties, with notes. Raises `InputError`, `KnitError`, `ModelError`."""
    fitted = Fitted(scene)
    if known.openings is not None:
        fitted = fitted.then(with_openings(fitted.scene, known.openings))
    if known.loop_length is not None:
        lengths = known.loop_length
        one = len(lengths) == 1
        fitted = fitted.then(fit_loop_length(fitted.scene, lengths[0]) if one else fit_run_in(fitted.scene, lengths))
    if known.curve is not None:
        fitted = fitted.then(fit_curve(fitted.scene, known.curve, progress or Display()))
    if known.areal_mass is not None:
        cloth = knit_scene(fitted.scene)
        (knitted,) = states_at(build_model(fitted.scene), [np.eye(2)])
        if isinstance(knitted, Diverged):
            raise InputError(f"{scene.path}: --areal-mass: the mesh as knitted did not converge ({knitted}); leave it out")
        found = measure.areal_mass(knitted)
        needed = knitted.wire_length / len(cloth.stitches) * known.areal_mass / found
        note = (
            f"the areal mass as knitted is {1e3 * found:.3g} g/m2, {percent(found / known.areal_mass - 1.0, 0, signed=True)} from"
            " the given"
            f" {1e3 * known.areal_mass:.3g} g/m2, which requires {1e3 * needed:.3g} mm of wire per loop"
        )
        fitted = fitted.then(Fitted(fitted.scene, (note,)))
    return fitted


def write_fit(fitted: Fitted, out: Path) -> None:
    """Write fit.json into `out`; without a fit or comparison, remove an earlier one."""
    if not fitted.notes:
        (out / FIT).unlink(missing_ok=True)
        return
    knit = fitted.scene.knit
    spacings = {"wale_spacing_m": knit.wale_spacing, "course_spacing_m": knit.course_spacing}
    content = {**NO_LOOPS, **fitted.loops, **spacings, "notes": list(fitted.notes)}
    with write_aside(out / FIT) as file:
        json.dump(content, file, indent=2, allow_nan=False)


def fitted_overrides(knit: Knit) -> list[Override]:
    """Overrides with the spacings and loops of a fitted knit."""
    loop = [(f"knit.loop.{name}", value) for name, value in asdict(knit.loop).items() if value is not None]
    bars = [("knit.bars", [asdict(bar) for bar in knit.bars])] if any(bar.loop_scale != 1.0 for bar in knit.bars) else []
    return [("knit.wale_spacing", knit.wale_spacing), ("knit.course_spacing", knit.course_spacing), *loop, *bars]


def openings_per_length(scene: Scene) -> float | None:
    """[1/m] square root of the number of complete openings per area; None where wires leave none."""
    count, area = complete_openings(scene)
    return math.sqrt(count / area) if count else None


def complete_openings(scene: Scene) -> tuple[int, float]:
    """Number of complete openings of a repeat, and its area [m2].

    Openings between centre lines in plan view count from COMPLETE of the largest area on, without scatter of the loops.

    One for each wale and course of a fully threaded knit; two for the two wales and four courses of a half-set double atlas.
    """
    cloth = knit_scene(replace(scene, knit=replace(scene.knit, scatter=0.0)))
    found = find_openings(cloth.threads, cloth.crossings, cloth.size)
    return sum(opening.area >= COMPLETE * found[0].area for opening in found), float(np.prod(cloth.size))


def with_openings(scene: Scene, wanted: float) -> Fitted:
    """Wales and courses scaled to `wanted` openings per length [1/m]. Raises `InputError`, `KnitError`, `ModelError`."""
    knit = scene.knit
    now = openings_per_length(scene)
    if now is None:
        raise InputError(f"{scene.path}: --openings: this knit has no openings; leave it out")
    wale, course = (now / wanted * spacing for spacing in (knit.wale_spacing, knit.course_spacing))
    if min(wale, course) < 2.0 * scene.wire.diameter:
        most = now * min(knit.wale_spacing, knit.course_spacing) / (2.0 * scene.wire.diameter)
        wrong = f"{exact(inch * wanted, 'per inch')} put loops less than two wire diameters apart"
        raise InputError(f"{scene.path}: --openings: {wrong}; give at most {at_most(inch * most, 'per inch')}")
    resized = replace(scene, knit=replace(knit, wale_spacing=wale, course_spacing=course))
    notes = [f"wale spacing {1e3 * wale:.4g} mm and course spacing {1e3 * course:.4g} mm, from the openings per inch"]
    if not 1.0 / FAR < now / wanted < FAR:
        notes.append(
            f"the openings per inch change both spacings by a factor of {now / wanted:.2g}, to {inch / wale:.3g} wales and"
            f" {inch / course:.3g} courses an inch. The scene has {inch * now:.3g} openings per inch,"
            f" {complete_openings(scene)[0]} in a repeat: check the knit and the count"
        )
    return Fitted(resized, tuple(notes))


def fit_curve(scene: Scene, path: Path, progress: Display) -> Fitted:
    """Loops with tensions nearest to a biaxial curve, a CSV file with COLUMNS.

    Least squares over all tensions, by one factor. Raises `InputError` for the file, and where the mesh converges at all its
    strains with no factor.
    """
    strains, tensions = _read_curve(path)
    gradients = [np.diag(1.0 + strain) for strain in strains]
    progress.stage("fit of the loops", number=1, of=1)
    tried = itertools.count()

    def misfit(factor: float) -> float:
        done = next(tried)
        progress.update(done=done / (done + REMAINING), load_factor=1.0, now=f"loops times {factor:.3f}")
        states = states_at(build_model(scaled(scene, factor)), gradients)
        if any(isinstance(state, Diverged) for state in states):
            return math.inf
        found = np.array([measure.mesh_tension(state) for state in states if not isinstance(state, Diverged)])
        return float(np.linalg.norm(found - tensions) / np.linalg.norm(tensions))

    best = minimize_scalar(
        misfit, bounds=factors(scene), method="bounded", options={"xatol": FIT_TOLERANCE, "maxiter": MOST_TRIED}
    )
    if not math.isfinite(best.fun):
        raise InputError(f"{path}: strain: the mesh does not converge at these strains; give smaller ones")
    if best.fun > NO_FIT:
        raise InputError(
            f"{path}: no factor on the proportions of knit.loop fits the tensions (smallest rms error {percent(best.fun, 0)});"
            " give tensions [N/m] of a mesh with the spacings and the wire of the scene"
        )
    how = f"{path.name} with an rms error of {percent(best.fun)} of the tensions"
    fitted = fitted_by(scene, float(best.x), how, path.name, float(best.fun))
    ends = factors(scene)
    doubts = []
    if best.fun > POOR_FIT:
        doubts.append("this is a poor fit: the loops or the test differ from the scene by more than one factor")
    if min(abs(best.x - end) for end in ends) < 2.0 * FIT_TOLERANCE:
        doubts.append("the factor is at the limit of the range of knit.loop")
    return replace(fitted, notes=fitted.notes + tuple(doubts))


def _read_curve(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Strains (point, 2) and tensions (point, 2) [N/m]."""
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file)
            if missing := [name for name in COLUMNS if name not in (reader.fieldnames or ())]:
                raise LookupError(f"no column {missing[0]}")
            values = np.array([[float(row[name] or "") for name in COLUMNS] for row in reader])
    except (OSError, LookupError, TypeError, ValueError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{path}: {reason}; give a CSV file with numbers in the columns {', '.join(COLUMNS)}") from error
    if not len(values):
        raise InputError(f"{path}: no rows; give the strains and tensions of a biaxial test")
    is_allowed = np.isfinite(values).all() and (values[:, :2] > -0.5).all() and (values[:, :2] <= 2.0).all()
    if not (is_allowed and values[:, 2:].any()):
        raise InputError(f"{path}: out of range; give finite numbers, strains from -0.5 to 2, and tensions [N/m] not all 0")
    return values[:, :2], values[:, 2:]
