"""What is known of a mesh when its loops were never measured: openings per length, wire length a loop, a biaxial test.

Wales and courses are scaled to the openings, their ratio kept. The loops are fitted by one factor on the proportions that make
them large (SCALED), within the range of each.
"""

from __future__ import annotations

import csv
import json
import math
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from .. import measure
from ..errors import Diverged, InputError
from ..files import write_aside
from ..knit.chain import KnitError
from ..knit.lapping import lapping_table
from ..knit.loops import RANGES, LoopProportions, loop_shape
from ..knit.openings import find_openings
from ..mesh.layout import knit_scene
from ..scene import Knit, Scene
from ..scene.objects import Override
from ..sweep.states import mesh_of
from ..text import at_least, at_most, exact, percent
from .fine_states import states_at

INCH = 0.0254  # [m]
SCALED = {
    "circular-oval": ("closed_radius", "closed_head", "open_head", "open_half_width"),
    "general": ("foot_half_width", "leg_half_width", "head_height"),
}
SAME_AREA = 0.99  # of the rhombus's area: openings that are counted
COLUMNS = ("strain_weft", "strain_warp", "tension_weft_N_per_m", "tension_warp_N_per_m")  # of a measured curve
FIT_TOLERANCE = 2e-3  # of the factor
POOR_FIT, NO_FIT = 0.1, 0.5  # rms error over the tensions: reported; refused
EDGE, SHORTER = 1e-9, 0.8  # distance of a factor from the end of its range; reduction of one that cannot be knitted


FIT = "fit.json"


@dataclass(frozen=True)
class LoopFit:
    """A fit of the loops by one factor on their proportions."""

    to: str  # "loop length", or the name of the file of a biaxial test
    factor: float
    proportions: dict[str, float]  # of knit.loop, that were fitted
    rms_error: float | None = None  # over the tensions of the test


@dataclass(frozen=True)
class Fitted:
    """A fitted scene, sentences on how it was fitted, and the fit of its loops if there was one."""

    scene: Scene
    notes: tuple[str, ...] = ()
    loops: LoopFit | None = None

    def then(self, other: Fitted) -> Fitted:
        """`other`, which was fitted from this scene, with the notes and the fit of both."""
        return Fitted(other.scene, self.notes + other.notes, other.loops or self.loops)


@dataclass(frozen=True)
class Known:
    """Measured properties of the mesh, in addition to its scene; None where unknown."""

    openings: float | None = None  # [1/m]
    loop_length: float | None = None  # [m]
    curve: Path | None = None
    areal_mass: float | None = None  # [kg/m2] as knitted; for comparison only


def with_known(scene: Scene, known: Known) -> Fitted:
    """`scene` fitted to the `known` properties, with notes. Raises `InputError`, `KnitError`, `ModelError`."""
    fitted = Fitted(scene)
    if known.openings is not None:
        fitted = fitted.then(with_openings(fitted.scene, known.openings))
    if known.loop_length is not None:
        fitted = fitted.then(fit_loop_length(fitted.scene, known.loop_length))
    if known.curve is not None:
        fitted = fitted.then(fit_curve(fitted.scene, known.curve))
    if known.areal_mass is not None:
        cloth = knit_scene(fitted.scene)
        (knitted,) = states_at(mesh_of(fitted.scene), [np.eye(2)])
        if isinstance(knitted, Diverged):
            raise InputError(f"{scene.path}: --areal-mass: the mesh as knitted did not converge: {knitted}")
        found = measure.areal_mass(knitted)
        needed = cloth.stitch_length * known.areal_mass / found
        note = (
            f"the areal mass as knitted is {1e3 * found:.3g} g/m2, {percent(found / known.areal_mass - 1.0, 0, signed=True)} from"
            " the given"
            f" {1e3 * known.areal_mass:.3g} g/m2, which requires {1e3 * needed:.3g} mm of wire per loop in plan view"
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
    return [("knit.wale_spacing", knit.wale_spacing), ("knit.course_spacing", knit.course_spacing), *loop]


def openings_per_length(scene: Scene) -> float | None:
    """[1/m] square root of the number of openings per area; None where wires leave none.

    Those count that are as large as the rhombus, or, where a knit has none, as the largest. Scatter of the loops does not enter.
    """
    cloth = knit_scene(replace(scene, knit=replace(scene.knit, scatter=0.0)))
    found = find_openings(cloth.threads, cloth.crossings, cloth.size)
    if not found:
        return None
    whole = cloth.rhombus.opening.area if cloth.rhombus is not None else found[0].area
    return math.sqrt(sum(opening.area > SAME_AREA * whole for opening in found) / float(np.prod(cloth.size)))


def with_openings(scene: Scene, wanted: float) -> Fitted:
    """Wales and courses scaled to `wanted` openings per length [1/m]. Raises `InputError`, `KnitError`, `ModelError`."""
    knit = scene.knit
    now = openings_per_length(scene)
    if now is None:
        raise InputError(f"{scene.path}: --openings: given, allowed: left out (this knit has no openings)")
    wale, course = (now / wanted * spacing for spacing in (knit.wale_spacing, knit.course_spacing))
    if min(wale, course) < 2.0 * scene.wire.diameter:
        most = now * min(knit.wale_spacing, knit.course_spacing) / (2.0 * scene.wire.diameter)
        allowed = f"at most {at_most(INCH * most, 'per inch')} (loops two wires apart)"
        raise InputError(f"--openings: given {exact(INCH * wanted, 'per inch')}, allowed: {allowed}")
    scaled = replace(scene, knit=replace(knit, wale_spacing=wale, course_spacing=course))
    return Fitted(
        scaled, (f"wale spacing {1e3 * wale:.4g} mm and course spacing {1e3 * course:.4g} mm, from the openings per inch",)
    )


def fit_loop_length(scene: Scene, wanted: float) -> Fitted:
    """Loops with a wire length of `wanted` [m] each, in plan view. Raises `InputError` if it cannot be reached."""
    low, high = _factors(scene)

    def missing(factor: float) -> float:
        return knit_scene(_scaled(scene, factor)).stitch_length - wanted

    ends = missing(low), missing(high)
    if not min(ends) <= 0.0 <= max(ends):
        allowed = f"{at_least(wanted + min(ends), 'm')} to {at_most(wanted + max(ends), 'm')}"
        raise InputError(
            f"{scene.path}: --fit-loop-length: given {exact(wanted, 'm')}, allowed: {allowed}"
            " with these spacings (beyond that, the proportions of knit.loop leave their ranges)"
        )
    factor = float(brentq(missing, low, high, xtol=FIT_TOLERANCE / 10))
    return _fitted(scene, factor, "the wire length per loop", "loop length")


def fit_curve(scene: Scene, path: Path) -> Fitted:
    """Loops whose tensions come nearest to a measured biaxial curve in the CSV file `path`, with COLUMNS.

    Least squares over all tensions, by one factor. Raises `InputError` for the file, and where no factor brings the mesh to
    rest at all of its strains.
    """
    strains, tensions = _read_curve(path)
    gradients = [np.diag(1.0 + strain) for strain in strains]

    def misfit(factor: float) -> float:
        states = states_at(mesh_of(_scaled(scene, factor)), gradients)
        if any(isinstance(state, Diverged) for state in states):
            return math.inf
        found = np.array([measure.mesh_tension(state) for state in states if not isinstance(state, Diverged)])
        return float(np.linalg.norm(found - tensions) / np.linalg.norm(tensions))

    best = minimize_scalar(misfit, bounds=_factors(scene), method="bounded", options={"xatol": FIT_TOLERANCE, "maxiter": 20})
    if not math.isfinite(best.fun):
        raise InputError(f"{path}: strain: given strains at which the mesh did not converge, allowed: smaller strains")
    if best.fun > NO_FIT:
        raise InputError(
            f"{path}: given tensions that cannot be fitted by one factor on the proportions of knit.loop (smallest rms error"
            f" {percent(best.fun, 0)}), allowed: tensions [N/m] of this mesh, with the spacings and the wire of the scene"
        )
    how = f"{path.name} with an rms error of {percent(best.fun)} of the tensions"
    fitted = _fitted(scene, float(best.x), how, path.name, float(best.fun))
    ends = _factors(scene)
    doubts = []
    if best.fun > POOR_FIT:
        doubts.append("this is a poor fit: the loops or the test differ from the scene by more than one factor")
    if min(abs(best.x - end) for end in ends) < 2.0 * FIT_TOLERANCE:
        doubts.append("the factor is at the limit of the range of knit.loop")
    return replace(fitted, notes=fitted.notes + tuple(doubts))


def _read_curve(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Strains (point, 2) and tensions (point, 2) [N/m]."""
    allowed = f"a CSV file with the columns {', '.join(COLUMNS)}"
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            rows = list(csv.DictReader(file))
    except (OSError, ValueError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or "no text in UTF-8"
        raise InputError(f"{path}: given {reason.lower()}, allowed: {allowed}") from error
    missing = [name for name in COLUMNS if not rows or name not in rows[0]]
    if missing:
        raise InputError(f"{path}: given no {'rows' if not rows else missing[0]}, allowed: {allowed}")
    values = np.zeros((len(rows), len(COLUMNS)))
    for number, row in enumerate(rows):
        for column, name in enumerate(COLUMNS):
            try:
                values[number, column] = float(row[name])
            except (TypeError, ValueError) as error:
                raise InputError(f"{path}: {name}: given {row[name]!r} in row {number + 1}, allowed: a number") from error
    if not np.all(np.isfinite(values)) or np.any(values[:, :2] <= -0.5) or np.any(values[:, :2] > 2.0):
        raise InputError(f"{path}: given a strain or tension out of range, allowed: finite, strains from -0.5 to 2")
    if not np.any(values[:, 2:]):
        raise InputError(f"{path}: given no tension other than 0, allowed: the tensions [N/m] of a biaxial test")
    return values[:, :2], values[:, 2:]


def _scaled(scene: Scene, factor: float) -> Scene:
    loop = scene.knit.loop
    larger = {name: factor * getattr(loop, name) for name in _names(scene)}
    return replace(scene, knit=replace(scene.knit, loop=replace(loop, **larger)))


def _fitted(scene: Scene, factor: float, how: str, to: str, rms_error: float | None = None) -> Fitted:
    """The scene scaled by `factor`. Raises `InputError` if its wires hook differently."""
    scaled = _scaled(scene, factor)
    meant, found = len(knit_scene(scene).clasps), len(knit_scene(scaled).clasps)
    if found != meant:
        allowed = f"{meant} times, as with knit.loop"
        raise InputError(f"{scene.path}: {how}: given loops that hook {found} times per repeat, allowed: {allowed}")
    loops = LoopFit(to, factor, {name: getattr(scaled.knit.loop, name) for name in _names(scene)}, rms_error)
    return Fitted(scaled, (f"loop proportions times {factor:.3f}, fitted to {how}",), loops)


def _names(scene: Scene) -> tuple[str, ...]:
    return SCALED[loop_shape(lapping_table(scene.knit.bars, (1, 1)), LoopProportions.of(scene.knit.loop))]


def _factors(scene: Scene) -> tuple[float, float]:
    """Smallest and largest factor that keep all proportions in range and the loops of neighbouring wales separate."""
    ranges = [np.array(RANGES[name]) / getattr(scene.knit.loop, name) for name in _names(scene)]
    low, high = max(float(r[0]) for r in ranges) + EDGE, min(float(r[1]) for r in ranges) - EDGE
    while high > 1.0:
        try:
            knit_scene(_scaled(scene, high))
        except KnitError:
            high = 1.0 + SHORTER * (high - 1.0) if high - 1.0 > FIT_TOLERANCE else 1.0
        else:
            break
    return low, high
