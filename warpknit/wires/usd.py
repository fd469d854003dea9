"""BasisCurves of USD stages (.usd, .usda, .usdc, .usdz): linear, and cubic in all bases and wraps.

The stage says unit (metersPerUnit, 0.01 where it does not, as USD has it) and upright axis (upAxis); transforms are applied. Of
points that move, those at the first time code are taken, or at the one asked for. Curves with invalid points, basis or wrap are
skipped. Widths, or the primvar of that name, are constant, per curve, or per point and then the same along a curve.
"""

from __future__ import annotations

import io
import os
import subprocess
import sys
from functools import lru_cache
from pathlib import Path

import numpy as np

from warpknit.base.text import engineering
from warpknit.wires.bases import BASES, MOST, WRAPS, BadFile, Curve, CurveFile, check_points, cubic, polyline, some_of, upright

CENTIMETRE = 0.01  # USD's unit where a stage does not say
SAME_WIDTH = 1e-3  # relative difference of widths along a wire that is none
PATIENCE = 300.0  # [s] that a stage may take to read


def read_usd(path: Path, interpolation: str, *, time: float | None = None) -> CurveFile:
    """The wires of a stage; interpolation: of linear curves, a key of `bases.polyline`. Raises `BadFile`, OSError."""
    state = path.stat()
    return curves_of(_arrays(path.absolute(), time, (state.st_mtime_ns, state.st_size)), interpolation)


@lru_cache(maxsize=1)
def _arrays(path: Path, time: float | None, state: tuple[int, int]) -> dict[str, np.ndarray]:
    """`stage_arrays` of the stage, read by another process; state: of the file, to read it once."""
    command = [sys.executable, "-m", "warpknit.wires.stage_process", os.fspath(path)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    try:
        done = subprocess.run(
            command + ([] if time is None else [repr(time)]),
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            timeout=PATIENCE,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise BadFile(f"a file that is not read after {PATIENCE:g} s") from error
    if done.returncode == 2 and done.stdout:
        raise BadFile(done.stdout.decode(errors="replace"))
    if done.returncode != 0:
        raise BadFile("a file that breaks the USD library, or takes more memory than there is for it")
    with np.load(io.BytesIO(done.stdout), allow_pickle=False) as archive:
        return dict(archive)


def curves_of(arrays: dict[str, np.ndarray], interpolation: str) -> CurveFile:
    """The curves of `stage_process.stage_arrays`. Raises `BadFile`."""
    metres = float(arrays["metres"])
    if not (np.isnan(metres) or 1e-12 <= metres <= 1e6):
        raise BadFile(f"a stage with {metres:g} metres per unit")
    curves: list[Curve] = []
    kept: list[int] = []
    bad: list[str] = []
    of_curves = np.split(arrays["points"], np.cumsum(arrays["counts"])[:-1])
    for number, points in enumerate(of_curves):
        name = f"curve {number + 1} of {arrays['paths'][number]}"
        try:
            points = upright(check_points(points), int(arrays["up"]))
            curves.append(_curve(points, str(arrays["bases"][number]), str(arrays["wraps"][number]), interpolation))
            kept.append(number)
        except BadFile as error:
            bad.append(f"{name}: {error}")
    if bad and not curves:
        raise BadFile(bad[0])
    notes = [*arrays["notes"].tolist()]
    if bad:
        notes.append(f"curves that are skipped: {some_of(bad)}")
    low, high = arrays["widths"][kept].T
    has_width, no_radius = np.isfinite(low), ""
    uneven = np.flatnonzero(high - low > SAME_WIDTH * high)
    if len(uneven):
        wire, unit = int(uneven[0]), CENTIMETRE if np.isnan(metres) else metres
        limits = " to ".join(engineering(float(limit[wire]) * unit, "m") for limit in (low, high))
        no_radius = f"widths of {limits} along wire {wire + 1}"
    elif len(faults := arrays["faults"]):
        no_radius = str(faults[0])
    elif has_width.any() and not has_width.all():
        no_radius = f"widths of some curves, none of wire {int(np.argmin(has_width)) + 1}"
    elif not ((low > 0.0) & (high <= MOST))[has_width].all():
        no_radius = f"a width of {np.nanmin(low):g}"
    radius = 0.5 * _seven_digits(0.5 * (low + high)) if has_width.any() and not no_radius else None
    return CurveFile(tuple(curves), CENTIMETRE if np.isnan(metres) else metres, radius, no_radius, notes=tuple(notes))


def _seven_digits(values: np.ndarray) -> np.ndarray:
    """The decimal numbers that single precision stands for."""
    different, place = np.unique(values, return_inverse=True)
    return np.array([float(f"{value:.7g}") for value in different])[place]


def _curve(points: np.ndarray, basis: str, wrap: str, interpolation: str) -> Curve:
    if basis not in ("linear", *BASES) or wrap not in WRAPS:
        raise BadFile(f"basis {basis!r} and wrap {wrap!r}")
    if basis == "linear":
        return polyline(points, interpolation, closed=wrap == "periodic")
    return cubic(points, basis, wrap)
