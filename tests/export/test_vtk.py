"""The time series holds what it was given, read back by another library and from its text."""

import base64
import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from warpknit.export.vtk import write_vtk
from warpknit.frame import Frame, WireLayout, curve_position

FRAMES = (0, 1, 3)


@pytest.fixture
def frames(make_frame: Callable[..., Frame]) -> list[Frame]:
    return [make_frame(index) for index in FRAMES]


def test_series_reads_back(tmp_path: Path, layout: WireLayout, frames: list[Frame]) -> None:
    pyvista = pytest.importorskip("pyvista")
    paths = write_vtk(tmp_path, layout, frames)
    assert [path.name for path in paths[:2]] == ["wires.pvd", "contacts.pvd"] and all(path.is_file() for path in paths)
    wires, contacts = (pyvista.get_reader(str(path)) for path in paths[:2])
    assert wires.time_values == contacts.time_values == list(map(float, FRAMES))
    for frame in frames:
        wires.set_active_time_value(frame.index)
        (mesh,) = wires.read()
        assert np.array_equal(mesh.points, curve_position(layout, frame))
        assert np.array_equal(mesh["stress"], frame.node_stress[layout.curve_node])
        assert np.array_equal(np.diff(mesh.offset), np.diff(layout.curve_start))
        assert mesh["wire"].tolist() == list(range(layout.wire_count))
        contacts.set_active_time_value(frame.index)
        (mesh,) = contacts.read()
        assert np.array_equal(mesh.points, frame.body_position) and mesh.n_cells == layout.body_count
        assert np.array_equal(mesh["force"], frame.body_force)
        assert np.array_equal(mesh["active"], frame.body_active)
        assert np.array_equal(np.stack((mesh["wire_a"], mesh["wire_b"]), axis=1), layout.body_wires)
        assert np.flatnonzero(mesh["rhombus"]).tolist() == layout.rhombus_bodies.tolist()


def arrays(path: Path) -> dict[str, np.ndarray]:
    """The arrays of a .vtu file: base64 of a header of four numbers, and of a block behind it."""
    found = {}
    for entry in ElementTree.parse(path).iter("DataArray"):
        text, kind = entry.text or "", np.dtype(entry.attrib["type"].lower()).newbyteorder("<")
        blocks, size, partial, packed = np.frombuffer(base64.b64decode(text[:44]), dtype="<u8")
        block = base64.b64decode(text[44:])
        assert (blocks, partial, packed) == (1, 0, len(block))
        found[entry.attrib["Name"]] = np.frombuffer(zlib.decompress(block), dtype=kind)
        assert found[entry.attrib["Name"]].nbytes == size
    return found


def test_each_wire_is_a_polyline_with_its_radius(tmp_path: Path, layout: WireLayout, frames: list[Frame]) -> None:
    """Tubes of radius d/2 along each wire, as thick as the wires, need one cell a wire and a radius at every point."""
    write_vtk(tmp_path, layout, frames[-1:])
    found = arrays(tmp_path / f"wires_{FRAMES[-1]:06d}.vtu")
    assert np.array_equal(found["Points"].reshape(-1, 3), curve_position(layout, frames[-1]))
    assert np.array_equal(found["radius"], np.full(layout.curve_node.size, 0.5 * layout.diameter))
    assert found["types"].tolist() == [4] * layout.wire_count
    assert np.array_equal(found["offsets"], layout.curve_start[1:])
    assert np.array_equal(found["connectivity"], np.arange(layout.curve_node.size))
    contacts = arrays(tmp_path / f"contacts_{FRAMES[-1]:06d}.vtu")
    assert np.array_equal(contacts["force"], frames[-1].body_force)
    assert np.array_equal(contacts["active"], frames[-1].body_active)


def test_no_line_joins_two_wires(layout: WireLayout) -> None:
    wire = np.repeat(np.arange(layout.wire_count), np.diff(layout.curve_start))
    segment = layout.curve_segment
    assert np.array_equal(wire[segment], wire[segment + 1])
    assert segment.size == wire.size - layout.wire_count


def test_number_that_is_not_finite_is_refused(tmp_path: Path, layout: WireLayout, frames: list[Frame]) -> None:
    stress = frames[0].node_stress.copy()
    stress[7] = np.inf
    with pytest.raises(ValueError, match=r"node_stress is not finite at \(7,\)"):
        write_vtk(tmp_path, layout, [replace(frames[0], node_stress=stress)])
    assert list(tmp_path.iterdir()) == []
