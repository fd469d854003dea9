"""Stages written from frames, and their prims and points read back."""

from pathlib import Path

import numpy as np
from pxr import Usd, UsdGeom

from warpknit.export.usd.writer import StageWriter
from warpknit.results.frame import Frame, WireLayout

FLOAT32_STEP = 2.0**-24  # half a unit in the last place: what rounding a number to float32 may cost


def write(directory: Path, layout: WireLayout, frames: list[Frame], *, close: bool = True, **options: object) -> StageWriter:
    writer = StageWriter(directory, layout, scene_name="zigzag", scene_hash="0123abcd", version="1.0", **options)
    for frame in frames:
        writer.add_frame(frame)
    if close:
        writer.close()
    return writer


def prims(stage: Usd.Stage, kind: type) -> list:
    return [kind(prim) for prim in stage.Traverse() if prim.IsA(kind)]


def world_points(shape: UsdGeom.PointBased, time: float) -> np.ndarray:
    """[m]  points of a prim, double precision."""
    matrix = np.array(UsdGeom.Xformable(shape).ComputeLocalToWorldTransform(time))
    return (np.array(shape.GetPointsAttr().Get(time), dtype=float) + matrix[3, :3]) / 1000.0


def primvar(shape: UsdGeom.Gprim, name: str, time: float = 0.0) -> np.ndarray:
    return np.array(UsdGeom.PrimvarsAPI(shape).GetPrimvar(name).Get(time))
