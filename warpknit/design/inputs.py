"""What is known of a mesh when its loops were never measured: openings per length, wire length a loop, a biaxial test.

Wales and courses are scaled to the openings, their ratio kept. The loops are fitted by factors (loop_fit.py).
"""

from __future__ import annotations

import csv
import itertools
import json
import math
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from scipy.constants import inch
from scipy.optimize import minimize_scalar

from .. import measure
from ..base.files import write_aside
from ..base.text import at_most, exact, percent
from ..errors import Diverged, InputError
from ..knit.openings import find_openings
from ..mesh.layout import knit_scene
from ..runner.progress_display import Progress
from ..scene import Knit, Scene
from ..scene.scene import Override
from ..studies.states import mesh_of
from .fine_states import states_at
from .loop_fit import FIT_TOLERANCE, Fitted, factors, fit_loop_length, fit_run_in, fitted_by, scaled

COMPLETE = 2.0 / 3.0  # of the largest area: openings that are counted; between wales 0.72 or more, within loops 0.58 or less
FAR = 1.25  # change of the spacings, or its inverse, that is told
COLUMNS = ("strain_weft", "strain_warp", "tension_weft_N_per_m", "tension_warp_N_per_m")  # of a measured curve
POOR_FIT, NO_FIT = 0.1, 0.5  # rms error over the tensions: reported; refused
FIT = "fit.json"
MOST_TRIED = 20  # factors
REMAINING = 5  # factors that are still tried, about, in what progress tells


@dataclass(frozen=True)
class Known:
    """Measured properties of the mesh, in addition to its scene; None where unknown."""

    openings: float | None = None  # [1/m]
    loop_length: tuple[float, ...] | None = None  # [m] of a loop, or of the loops of each bar
    curve: Path | None = None
    areal_mass: float | None = None  # [kg/m2] as knitted; for comparison only


def with_known(scene: Scene, known: Known, progress: Progress | None = None) -> Fitted:
    """`scene` fitted to the `known` properties, with notes. Raises `InputError`, `KnitError`, `ModelError`."""
    fitted = Fitted(scene)
    if known.openings is not None:
        fitted = fitted.then(with_openings(fitted.scene, known.openings))
    if known.loop_length is not None:
        lengths = known.loop_length
        one = len(lengths) == 1
        fitted = fitted.then(fit_loop_length(fitted.scene, lengths[0]) if one else fit_run_in(fitted.scene, lengths))
    if known.curve is not None:
        fitted = fitted.then(fit_curve(fitted.scene, known.curve, progress or Progress()))
    if known.areal_mass is not None:
        cloth = knit_scene(fitted.scene)
        (knitted,) = states_at(mesh_of(fitted.scene), [np.eye(2)])
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
    """Write fit.json into `out`, or remove that of an earlier report where nothing was fitted or compared."""
    if not fitted.notes:
        (out / FIT).unlink(missing_ok=True)
        return
    loops, knit = fitted.loops, fitted.scene.knit
    content = {
        "fitted_to": None if loops is None else loops.to,
        "factor": None if loops is None else loops.factor,
        "bar_factors": None if loops is None else loops.bar_factors,
        "rms_error": None if loops is None else loops.rms_error,
        "loop": {} if loops is None else loops.proportions,
        "wale_spacing_m": knit.wale_spacing,
        "course_spacing_m": knit.course_spacing,
        "notes": list(fitted.notes),
    }
    with write_aside(out / FIT) as file:
        json.dump(content, file, indent=2, allow_nan=False)


def fitted_overrides(knit: Knit) -> list[Override]:
    """Overrides that give a scene the spacings and the loops of a fitted knit."""
    loop = [(f"knit.loop.{name}", value) for name, value in asdict(knit.loop).items() if value is not None]
    bars = [("knit.bars", [asdict(bar) for bar in knit.bars])] if any(bar.loop_scale != 1.0 for bar in knit.bars) else []
    return [("knit.wale_spacing", knit.wale_spacing), ("knit.course_spacing", knit.course_spacing), *loop, *bars]


def openings_per_length(scene: Scene) -> float | None:
    """[1/m] square root of the number of complete openings per area; None where wires leave none."""
    count, area = complete_openings(scene)
    return math.sqrt(count / area) if count else None


def complete_openings(scene: Scene) -> tuple[int, float]:
    """Number of complete openings of a repeat, and its area [m2].

    Those between centre lines in plan view count that have at least COMPLETE of the largest area. Scatter of the loops does not
    enter.

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
            f" {inch / course:.3g} courses an inch: the scene has {inch * now:.3g} openings per inch,"
            f" {complete_openings(scene)[0]} in a repeat; check the knit, and what was counted"
        )
    return Fitted(resized, tuple(notes))


def fit_curve(scene: Scene, path: Path, progress: Progress) -> Fitted:
    """Loops whose tensions come nearest to a measured biaxial curve in the CSV file `path`, with COLUMNS.

    Least squares over all tensions, by one factor. Raises `InputError` for the file, and where no factor brings the mesh to
    rest at all of its strains.
    """
    strains, tensions = _read_curve(path)
    gradients = [np.diag(1.0 + strain) for strain in strains]
    progress.stage("fit of the loops", number=1, of=1)
    tried = itertools.count()

    def misfit(factor: float) -> float:
        done = next(tried)
        progress.update(done=done / (done + REMAINING), load_factor=1.0, now=f"loops times {factor:.3f}")
        states = states_at(mesh_of(scaled(scene, factor)), gradients)
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
    instead = f"give a CSV file with the columns {', '.join(COLUMNS)}"
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            rows = list(csv.DictReader(file))
    except (OSError, ValueError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or "no text in UTF-8"
        raise InputError(f"{path}: {reason.lower()}; {instead}") from error
    missing = [name for name in COLUMNS if not rows or name not in rows[0]]
    if missing:
        raise InputError(f"{path}: no {f'column {missing[0]}' if rows else 'rows'}; {instead}")
    values = np.zeros((len(rows), len(COLUMNS)))
    for number, row in enumerate(rows):
        for column, name in enumerate(COLUMNS):
            try:
                values[number, column] = float(row[name])
            except (TypeError, ValueError) as error:
                raise InputError(f"{path}: {name}: {row[name]!r} in row {number + 1} is not a number; write one") from error
    if not np.all(np.isfinite(values)) or np.any(values[:, :2] <= -0.5) or np.any(values[:, :2] > 2.0):
        raise InputError(f"{path}: a strain or tension is out of range; give finite ones, and strains from -0.5 to 2")
    if not np.any(values[:, 2:]):
        raise InputError(f"{path}: all tensions are 0; give those of a biaxial test [N/m]")
    return values[:, :2], values[:, 2:]
