"""Reads the curves of a USD stage in a process of its own, and writes them to its standard output.

A damaged .usdc can make the USD library take all memory, or never return. Here it has a limit of memory, and whoever started
the process a limit of time; what the library says on the way does not reach the terminal.

    python -m warpknit.wires.stage_process FILE [TIME]     an NPZ archive (status 0), or a line that says why not (status 2)
"""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
import psutil
from pxr import Tf, Usd, UsdGeom

from warpknit.wires.curve import BadFile, check_count

MEMORY = 6 << 30  # bytes that it may take, and no more than half of the machine's


def stage_arrays(stage: Usd.Stage, time: float | None) -> dict[str, np.ndarray]:
    """The curves of all BasisCurves that are drawn: not those hidden, nor guides, nor stand-ins (purpose proxy).

    points (point, 3) in the unit and axes of the stage; counts (curve,) points of each; bases and wraps (curve,) names, the basis
    of a straight one being "linear"; radius (curve,) NaN where there is none; up (an axis); metres (in a unit), NaN where the
    stage does not say.
    time: a time code; None: where the points do not move, else the first that they have. Raises `BadFile`.
    """
    points, counts, bases, wraps, radii = [np.empty((0, 3))], [], [], [], []
    total, others = 0, 0
    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        others += prim.IsA(UsdGeom.Curves)
        curves = UsdGeom.BasisCurves(prim)
        if not curves or curves.ComputePurpose() in (UsdGeom.Tokens.proxy, UsdGeom.Tokens.guide):
            continue
        code = _time_code(curves, time)
        if curves.ComputeVisibility(code) == UsdGeom.Tokens.invisible:
            continue
        of_prim = _numbers(curves.GetCurveVertexCountsAttr(), code, np.int64)
        total += int(of_prim.clip(0).sum())
        check_count(total)
        places = _numbers(curves.GetPointsAttr(), code, np.float64).reshape(-1, 3)
        if (of_prim < 1).any() or int(of_prim.sum()) != len(places):
            raise BadFile(f"{prim.GetPath()} with {len(places):,} points and counts of {int(of_prim.sum()):,}")
        matrix = np.array(curves.ComputeLocalToWorldTransform(code))  # of rows: points stand on its left
        with np.errstate(invalid="ignore", over="ignore"):  # what is no number is refused later, by its point
            points.append(places @ matrix[:3, :3] + matrix[3, :3])
        is_linear = curves.GetTypeAttr().Get(code) == UsdGeom.Tokens.linear
        counts.append(of_prim)
        bases += ["linear" if is_linear else str(curves.GetBasisAttr().Get(code))] * len(of_prim)
        wraps += [str(curves.GetWrapAttr().Get(code))] * len(of_prim)
        radii += [0.5 * _width(curves, code) * float(np.cbrt(abs(np.linalg.det(matrix[:3, :3]))))] * len(of_prim)
    if not counts:
        raise BadFile("curves, but no BasisCurves among those drawn" if others else "a stage without BasisCurves")
    is_told = stage.HasAuthoredMetadata(UsdGeom.Tokens.metersPerUnit)
    return {
        "points": np.concatenate(points),
        "counts": np.concatenate(counts),
        "bases": np.array(bases, dtype="U16"),
        "wraps": np.array(wraps, dtype="U16"),
        "radius": np.array(radii, dtype=float),
        "up": np.array("XYZ".index(str(UsdGeom.GetStageUpAxis(stage)))),
        "metres": np.array(UsdGeom.GetStageMetersPerUnit(stage) if is_told else np.nan),
    }


def _time_code(curves: UsdGeom.BasisCurves, time: float | None) -> Usd.TimeCode:
    if time is not None:
        return Usd.TimeCode(time)
    samples = curves.GetPointsAttr().GetTimeSamples()
    return Usd.TimeCode(samples[0]) if samples else Usd.TimeCode.Default()


def _numbers(attribute: Usd.Attribute, code: Usd.TimeCode, kind: type) -> np.ndarray:
    """The values of an attribute; none where it has none. Raises `BadFile`."""
    values = attribute.Get(code)
    try:
        return np.asarray([] if values is None else values, dtype=kind)
    except TypeError as error:  # values of no registered type
        raise BadFile(f"{attribute.GetPath()} with values that are no numbers") from error


def _width(curves: UsdGeom.BasisCurves, code: Usd.TimeCode) -> float:
    """The one width of the curves of a prim, NaN where they have none or several."""
    widths = _numbers(curves.GetWidthsAttr(), code, np.float64).ravel()
    return float(widths[0]) if len(widths) and np.ptp(widths) <= 1e-3 * abs(widths[0]) else float("nan")


def main(arguments: list[str]) -> int:
    try:
        import resource
    except ImportError:  # not a POSIX system
        pass
    else:
        memory = min(MEMORY, psutil.virtual_memory().total // 2)
        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    try:
        stage = Usd.Stage.Open(arguments[0])
        answer = io.BytesIO()
        arrays: dict[str, Any] = stage_arrays(stage, float(arguments[1]) if len(arguments) > 1 else None)
        np.savez(answer, **arrays)
    except Exception as error:
        sys.stdout.buffer.write(_reason(error).encode())
        return 2
    sys.stdout.buffer.write(answer.getvalue())
    return 0


def _reason(error: Exception) -> str:
    """Why the stage cannot be used: from this module, or from the USD library, whose errors have the shape of a report."""
    if isinstance(error, BadFile):
        return str(error)
    if isinstance(error, MemoryError):
        return "a file that takes more memory than there is for it"
    if isinstance(error, Tf.ErrorException):
        return f"a file that the USD library cannot read ({next(_sentences(error))})"
    return f"a file that the USD library cannot read ({type(error).__name__})"


def _sentences(error: Tf.ErrorException) -> Iterator[str]:
    for part in error.args:
        yield " ".join(str(getattr(part, "commentary", part)).split())[:120]
    yield "no reason given"


if __name__ == "__main__":
    status = main(sys.argv[1:])
    sys.stdout.flush()
    os._exit(status)  # a damaged stage is not taken down in an orderly way
