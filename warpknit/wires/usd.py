"""BasisCurves of USD stages (.usd, .usda, .usdc, .usdz): linear, and cubic in all bases and wraps.

The stage says unit (metersPerUnit, 0.01 where it does not, as USD has it) and upright axis (upAxis); transforms are applied. Of
points that move, those at the first time code are taken, or at the one asked for.
"""

from __future__ import annotations

import io
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from warpknit.wires.axes import upright
from warpknit.wires.bases import BASES, WRAPS, cubic, polyline
from warpknit.wires.curve import BadFile, Curve, CurveFile, check_points

CENTIMETRE = 0.01  # USD's unit where a stage does not say
PATIENCE = 300.0  # [s] that a stage may take to read


def read_usd(path: Path, interpolation: str, *, time: float | None = None) -> CurveFile:
    """The wires of a stage; interpolation: of linear curves, a key of `bases.polyline`. Raises `BadFile`, OSError."""
    return curves_of(_arrays(path, time), interpolation)


def _arrays(path: Path, time: float | None) -> dict[str, np.ndarray]:
    """`stage_arrays` of the stage, read by another process."""
    command = [sys.executable, "-m", "warpknit.wires.stage_process", os.fspath(path.absolute())]
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
    points = upright(check_points(arrays["points"]), int(arrays["up"]))
    curves: list[Curve] = []
    of_curves = np.split(points, np.cumsum(arrays["counts"])[:-1])
    for number, (of_curve, basis, wrap) in enumerate(
        zip(of_curves, arrays["bases"].tolist(), arrays["wraps"].tolist(), strict=True), start=1
    ):
        if basis not in ("linear", *BASES) or wrap not in WRAPS:
            raise BadFile(f"curve {number} with basis {basis!r} and wrap {wrap!r}")
        try:
            if basis == "linear":
                curves.append(polyline(of_curve, interpolation, closed=wrap == "periodic"))
            else:
                curves.append(cubic(of_curve, basis, wrap))
        except BadFile as error:
            raise BadFile(f"curve {number}: {error}") from error
    radius = arrays["radius"]
    is_one = len(radius) > 0 and float(np.ptp(radius)) <= 1e-3 * abs(float(radius[0])) and 0.0 < float(radius[0]) <= 1e9
    return CurveFile(tuple(curves), CENTIMETRE if np.isnan(metres) else metres, float(radius[0]) if is_one else None)
