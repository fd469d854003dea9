"""Writes the samples in scenes/wires: one plain knit in every format of [wires].

    python tools/wire_samples.py [DIR]

The centre line of a row is x = t + a sin 2t, y = h cos t, z = d cos 2t (K. Crane, Yarn Curve, 2023), rows h + 1 apart; one unit
is a quarter of a millimetre. The patch has three rows of three loops, as open wires, in .usda, .bcc, .csv and .npz; the cell has
one loop that repeats both ways, in .pyp. The writers serve the tests too.
"""

from __future__ import annotations

import struct
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

UNIT = 0.25  # [mm]
BULGE, HEIGHT, DEPTH = 1.5, 4.0, 1.0  # a, h, d
WALE, COURSE = 2.0 * np.pi * UNIT, (HEIGHT + 1.0) * UNIT  # [mm]
RADIUS = 0.05  # [mm]
POINTS_PER_LOOP = 24
LOOPS = ROWS = 3


def row(t: np.ndarray) -> np.ndarray:
    """(point, 3) [mm] of a row at parameters t (point,); a loop takes 2 pi."""
    return UNIT * np.stack([t + BULGE * np.sin(2.0 * t), HEIGHT * np.cos(t), DEPTH * np.cos(2.0 * t)], axis=1)


def patch() -> list[np.ndarray]:
    """Rows (point, 3) [mm]."""
    t = np.linspace(0.0, 2.0 * np.pi * LOOPS, POINTS_PER_LOOP * LOOPS + 1)
    return [row(t) + [0.0, number * COURSE, 0.0] for number in range(ROWS)]


def write_csv(path: Path, wires: Sequence[np.ndarray], unit: str = "mm") -> None:
    lines = [f"wire,x [{unit}],y [{unit}],z [{unit}]"]
    lines += [f"{number},{x:.6g},{y:.6g},{z:.6g}" for number, points in enumerate(wires, start=1) for x, y, z in points]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_npz(path: Path, wires: Sequence[np.ndarray]) -> None:
    counts = np.array([len(points) for points in wires], dtype=np.int32)
    np.savez_compressed(path, points=np.concatenate(wires).astype(np.float32), counts=counts)


def write_bcc(path: Path, wires: Sequence[np.ndarray], *, closed: bool = False, up: int = 2, kind: bytes = b"C0") -> None:
    total = sum(len(points) for points in wires)
    header = struct.pack("<3sB2sBBQQ40s", b"BCC", 0x44, kind, 3, up, len(wires), total, b"warpknit sample")
    sign = -1 if closed else 1
    curves = [struct.pack("<i", sign * len(points)) + points.astype("<f4").tobytes() for points in wires]
    path.write_bytes(header + b"".join(curves))


def write_usd(
    path: Path,
    wires: Sequence[np.ndarray],
    *,
    basis: str = "catmullRom",
    wrap: str = "pinned",
    radius: float = RADIUS,
    metres: float = 1e-3,
) -> None:
    """basis: "linear" for straight curves."""
    from pxr import Usd, UsdGeom, Vt

    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageMetersPerUnit(stage, metres)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    curves = UsdGeom.BasisCurves.Define(stage, "/Wires")
    stage.SetDefaultPrim(curves.GetPrim())
    curves.CreateTypeAttr("linear" if basis == "linear" else "cubic")
    if basis != "linear":
        curves.CreateBasisAttr(basis)
    curves.CreateWrapAttr(wrap)
    curves.CreateCurveVertexCountsAttr([len(points) for points in wires])
    points = np.round(np.concatenate(wires), 6).astype(np.float32)
    curves.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points))
    curves.CreateWidthsAttr([2.0 * radius])
    curves.SetWidthsInterpolation(UsdGeom.Tokens.constant)
    curves.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(np.stack([points.min(axis=0) - radius, points.max(axis=0) + radius])))
    stage.GetRootLayer().Export(str(path))


def write_pyp(
    path: Path,
    points: np.ndarray,
    edges: np.ndarray,
    period: Sequence[float],
    radius: float,
    rest: np.ndarray | None = None,
) -> None:
    """points (point, 3) [m]; edges (edge, 4): from, to, repeats along x and y; period (2,) [m]; rest (edge,) [m]."""
    lines = ["*pattern # px py radius count", f"{period[0]:.8g} {period[1]:.8g} {radius:.8g} {len(points)}"]
    lines += ["", "*Q # x y z twist"]
    lines += [f"{x:.8g} {y:.8g} {z:.8g} 0" for x, y, z in points]
    lines += ["", "*E # from to i j", *(" ".join(map(str, edge)) for edge in edges.tolist())]
    if rest is not None:
        lines += ["", "*RL # rest lengths", *(f"{length:.8g}" for length in rest)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_cell(path: Path) -> None:
    """One loop that goes on with the next along the row; its points lie within one repeat, so some edges cross its borders."""
    t = np.arange(POINTS_PER_LOOP) * 2.0 * np.pi / POINTS_PER_LOOP
    places = 1e-3 * row(t)
    period = np.array([1e-3 * WALE, 1e-3 * COURSE])
    moved = np.floor(places[:, :2] / period).astype(int)
    following = np.roll(np.arange(len(t)), -1)
    repeats = np.roll(moved, -1, axis=0) - moved
    repeats[-1, 0] += 1
    edges = np.column_stack([np.arange(len(t)), following, repeats])
    beyond = np.concatenate([places[1:], places[:1] + [period[0], 0.0, 0.0]])
    places[:, :2] -= moved * period
    write_pyp(path, places, edges, period, 1e-3 * RADIUS, np.linalg.norm(beyond - 1e-3 * row(t), axis=1))


def main(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    write_usd(folder / "plain_knit.usda", patch())
    write_bcc(folder / "plain_knit.bcc", patch())
    write_csv(folder / "plain_knit.csv", patch())
    write_npz(folder / "plain_knit.npz", patch())
    write_cell(folder / "plain_knit.pyp")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent.parent / "scenes" / "wires")
