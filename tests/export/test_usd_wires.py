"""A stage of our own is a file of wires: what was written is read back, at every time."""

import numpy as np
import pytest

from warpknit.export.usd.writer import StageWriter
from warpknit.results.frame import curve_position
from warpknit.wires.bases import CurveFile
from warpknit.wires.file_curves import read_usd
from warpknit.wires.read import read_wires

FLOAT32 = 2.0**-24 * 10e-3  # [m] of a point within 10 mm of the middle of its tile


def corners(found: CurveFile) -> np.ndarray:
    """(point, 3) [m] of straight curves."""
    assert found.metres is not None
    return found.metres * np.concatenate([np.concatenate([curve.pieces[:, 0], curve.pieces[-1:, 3]]) for curve in found.curves])


def test_wires_of_a_run_are_read_back(tmp_path, layout, make_frame):
    frames = [make_frame(index, shear=0.01 * index) for index in range(3)]
    writer = StageWriter(tmp_path, layout, scene_name="zigzag", scene_hash="0123abcd", version="1.0")
    for frame in frames:
        writer.add_frame(frame)
    writer.close()
    for time, frame in ((None, frames[0]), (0.0, frames[0]), (2.0, frames[2])):
        found = read_usd(writer.path, "linear", time=time)
        assert len(found.curves) == layout.wire_count
        assert np.allclose(corners(found), curve_position(layout, frame), rtol=0.0, atol=FLOAT32)
    wires = read_wires(writer.path, node_spacing=1e-4, interpolation="linear", time=2.0)
    assert wires.radius == pytest.approx(0.5 * layout.diameter, rel=1e-6)
    drawn = curve_position(layout, frames[2])
    assert np.allclose(wires.points[0][0], drawn[0], rtol=0.0, atol=FLOAT32)
    assert np.allclose(wires.points[-1][-1], drawn[-1], rtol=0.0, atol=FLOAT32)
    assert wires.kinds == ("open",) * layout.wire_count
