"""Process that reads the curves of a USD stage; it writes them to standard output.

A damaged .usdc can make the USD library take all memory, or never return. Here it has a limit of memory, and whoever started
the process a limit of time; what the library says on the way does not reach the terminal.

    python -m warpknit.wires.stage_process FILE [TIME]     an NPZ archive (status 0), or a line that says why not (status 2)
"""

from __future__ import annotations

import io
import os
import sys
from typing import Any

import numpy as np
import psutil
from pxr import Tf, Usd, UsdGeom

from warpknit.wires.bases import BadFile, check_count, some_of

SAME_SCALE = 1e-3  # relative difference of the scales of a transform that is none
MEMORY = 6 << 30  # bytes that it may take, and no more than half of the machine's


def stage_arrays(stage: Usd.Stage, time: float | None) -> dict[str, np.ndarray]:
    """Curves of all drawn BasisCurves: not hidden, guides or stand-ins (purpose proxy).

    points (point, 3) in the unit and axes of the stage; counts (curve,) points of each; bases and wraps (curve,) names, "linear"
    for straight ones; paths (curve,) of the prims; widths (curve, 2) least and largest along each, or NaN; up (an axis); metres
    (in a unit), NaN where the stage does not say; notes: what is not read; faults: why widths are not. time: a time code; None:
    of fixed points, else the first one. Raises `BadFile`.
    """
    points, counts, bases, wraps, paths, widths = [np.empty((0, 3))], [], [], [], [], [np.empty((0, 2))]
    faults: list[str] = []
    others: list[str] = []  # prims with wires of another kind
    bad: list[str] = []  # prims that are skipped
    total = 0
    prims = iter(Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies()))
    for prim in prims:
        curves, is_instancer = UsdGeom.BasisCurves(prim), prim.IsA(UsdGeom.PointInstancer)
        if not is_instancer and not prim.IsA(UsdGeom.Curves):
            continue
        if UsdGeom.Imageable(prim).ComputePurpose() in (UsdGeom.Tokens.proxy, UsdGeom.Tokens.guide):
            continue
        times = UsdGeom.PointBased(prim).GetPointsAttr().GetTimeSamples() if time is None else [time]
        code = Usd.TimeCode(times[0]) if times else Usd.TimeCode.Default()
        if UsdGeom.Imageable(prim).ComputeVisibility(code) == UsdGeom.Tokens.invisible:
            continue
        if not curves:
            others.append(f"{prim.GetTypeName()} {prim.GetPath()}")
            prims.PruneChildren()
            continue
        of_prim = _numbers(curves.GetCurveVertexCountsAttr(), code, np.int64)
        total += int(of_prim.clip(0).sum())
        check_count(total)
        places = _numbers(curves.GetPointsAttr(), code, np.float64).reshape(-1, 3)
        if (of_prim < 1).any() or int(of_prim.sum()) != len(places):
            bad.append(f"{prim.GetPath()} with {len(places):,} points and counts of {int(of_prim.sum()):,}")
            continue
        matrix = np.array(curves.ComputeLocalToWorldTransform(code))  # of rows: points stand on its left
        with np.errstate(invalid="ignore", over="ignore"):  # what is no number is refused later, by its point
            points.append(places @ matrix[:3, :3] + matrix[3, :3])
        is_linear = curves.GetTypeAttr().Get(code) == UsdGeom.Tokens.linear
        wrap = str(curves.GetWrapAttr().Get(code))
        counts.append(of_prim)
        bases += ["linear" if is_linear else str(curves.GetBasisAttr().Get(code))] * len(of_prim)
        wraps += [wrap] * len(of_prim)
        paths += [str(prim.GetPath())] * len(of_prim)
        scale, sides = float(np.cbrt(abs(np.linalg.det(matrix[:3, :3])))), np.linalg.norm(matrix[:3, :3], axis=1)
        try:
            of_curves = _widths(curves, code, of_prim)
            if np.isfinite(of_curves).any() and (np.abs(sides - scale) > SAME_SCALE * scale).any():
                raise BadFile(f"widths of {prim.GetPath()}, which is scaled unevenly")
        except BadFile as error:
            faults.append(str(error))
            of_curves = np.full((len(of_prim), 2), np.nan)
        widths.append(scale * of_curves)
    if not counts:
        none = "curves, but no BasisCurves among those drawn" if others else "a stage without BasisCurves"
        raise BadFile(bad[0] if bad else none)
    found = (("prims that are not read", others), ("curves that are skipped", bad))
    notes = [f"{what}: {some_of(names)}" for what, names in found if names]
    has_unit = stage.HasAuthoredMetadata(UsdGeom.Tokens.metersPerUnit)
    return {
        "points": np.concatenate(points),
        "counts": np.concatenate(counts),
        "bases": np.array(bases, dtype="U16"),
        "wraps": np.array(wraps, dtype="U16"),
        "paths": np.array(paths, dtype=str),
        "widths": np.concatenate(widths),
        "up": np.array("XYZ".index(str(UsdGeom.GetStageUpAxis(stage)))),
        "metres": np.array(UsdGeom.GetStageMetersPerUnit(stage) if has_unit else np.nan),
        "notes": np.array(notes, dtype=str),
        "faults": np.array(faults, dtype=str),
    }


def _numbers(attribute: Usd.Attribute, code: Usd.TimeCode, kind: type) -> np.ndarray:
    """The values of an attribute; none where it has none. Raises `BadFile`."""
    values = attribute.Get(code)
    try:
        return np.asarray([] if values is None else values, dtype=kind)
    except TypeError as error:  # values of no registered type
        raise BadFile(f"{attribute.GetPath()} with values that are no numbers") from error


def _widths(curves: UsdGeom.BasisCurves, code: Usd.TimeCode, counts: np.ndarray) -> np.ndarray:
    """(curve, 2) least and largest width along each curve of a prim, NaN without widths. Raises `BadFile`."""
    none = np.full((len(counts), 2), np.nan)
    primvar = UsdGeom.PrimvarsAPI(curves).GetPrimvar("widths")
    if primvar and primvar.HasAuthoredValue():  # goes before the attribute
        found, kind = primvar.ComputeFlattened(code), primvar.GetInterpolation()
        values = np.asarray([] if found is None else found, dtype=np.float64).ravel()
    else:
        values, kind = _numbers(curves.GetWidthsAttr(), code, np.float64).ravel(), curves.GetWidthsInterpolation()
    if not len(values):
        return none
    if not np.isfinite(values).all():
        raise BadFile(f"widths of {curves.GetPath()} that are no numbers")
    if len(values) == 1 or kind == UsdGeom.Tokens.constant:
        sizes = np.full(1, len(values))
    elif kind == UsdGeom.Tokens.uniform:
        sizes = np.ones(len(counts), dtype=np.int64)
    elif kind == UsdGeom.Tokens.varying:
        periodic = curves.GetWrapAttr().Get(code) == UsdGeom.Tokens.periodic
        sizes = np.asarray(curves.ComputeSegmentCounts(code), dtype=np.int64) + (not periodic)
    else:
        sizes = counts
    if sizes.sum() != len(values) or (sizes < 1).any():
        raise BadFile(f"{len(values):,} widths of {curves.GetPath()}, where {kind} ones are {int(sizes.sum()):,}")
    begin = np.cumsum(sizes) - sizes
    return np.zeros_like(none) + np.stack([np.minimum.reduceat(values, begin), np.maximum.reduceat(values, begin)], axis=1)


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
    """Reason why the stage cannot be used, of this module or the USD library. Its errors have the shape of a report."""
    if isinstance(error, BadFile):
        return str(error)
    if isinstance(error, MemoryError):
        return "a file that takes more memory than there is for it"
    said = [" ".join(str(getattr(part, "commentary", part)).split())[:120] for part in error.args]
    reason = (*said, "no reason given")[0] if isinstance(error, Tf.ErrorException) else type(error).__name__
    return f"a file that the USD library cannot read ({reason})"


if __name__ == "__main__":
    status = main(sys.argv[1:])
    sys.stdout.flush()
    os._exit(status)  # a damaged stage is not taken down in an orderly way
