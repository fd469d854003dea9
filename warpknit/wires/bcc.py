"""BCC, the Binary Curve Collection of Cem Yuksel's yarn-level cloth models.

    https://www.cemyuksel.com/cyCodeBase/soln/using_bcc_files.html

A header of 64 bytes: "BCC"; a byte 0x44 (integers and numbers of 4 bytes); the type of the curves, "C0" for Catmull-Rom curves
with uniform parameters (some programs write "PL", polylines); the number of dimensions, 3; which of them points up; the number
of curves and of all control points, 8 bytes each; 40 bytes of text. Then for each curve its number of control points, negative
where the curve is closed, and these. Little-endian. There is no unit.

An open curve passes through its first and last control points, as USD's pinned curves do; the format does not say.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from warpknit.wires.axes import upright
from warpknit.wires.bases import cubic, polyline
from warpknit.wires.curve import BadFile, Curve, CurveFile, check_count, check_points

HEADER = struct.Struct("<3sB2sBBQQ40s")
COUNT, POINT = 4, 12  # bytes


def read_bcc(path: Path, interpolation: str) -> CurveFile:
    """The curves of a BCC file. interpolation: of polylines, a key of `bases.polyline`. Raises `BadFile`, OSError."""
    data = path.read_bytes()
    if len(data) < HEADER.size:
        raise BadFile(f"a file of {len(data)} bytes, less than its header of {HEADER.size}")
    sign, sizes, kind, dimensions, up, curve_count, point_count, _ = HEADER.unpack_from(data)
    if sign != b"BCC":
        raise BadFile("a file that does not begin with BCC")
    if sizes != 0x44 or kind not in (b"C0", b"PL") or dimensions != 3 or up > 2:
        raise BadFile(
            f"a header with sizes {sizes:#04x}, curves {kind.decode('latin-1')!r}, {dimensions} dimensions and up {up},"
            " not 0x44, 'C0' or 'PL', 3 and 0 to 2"
        )
    check_count(point_count)
    size = HEADER.size + COUNT * curve_count + POINT * point_count
    if len(data) != size:
        raise BadFile(
            f"{len(data):,} bytes where the header says {curve_count:,} curves of {point_count:,} points, {size:,} bytes"
        )
    curves: list[Curve] = []
    place = HEADER.size
    for number in range(1, curve_count + 1):
        count = struct.unpack_from("<i", data, place)[0] if place + COUNT <= len(data) else 0
        place += COUNT
        if count == 0 or place + POINT * abs(count) > len(data):
            raise BadFile(f"curve {number} with {count} control points" if count else f"curve {number} without control points")
        points = np.frombuffer(data, "<f4", 3 * abs(count), place).reshape(-1, 3)
        place += POINT * abs(count)
        try:
            points = upright(check_points(points), up)
            if kind == b"PL":
                curves.append(polyline(points, interpolation, closed=count < 0))
            else:
                curves.append(cubic(points, "catmullRom", "periodic" if count < 0 else "pinned"))
        except BadFile as error:
            raise BadFile(f"curve {number}: {error}") from error
    if place != len(data):
        raise BadFile(f"{len(data) - place:,} bytes behind its last curve")
    return CurveFile(tuple(curves))
