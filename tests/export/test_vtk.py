"""The time series holds what it was given, read back by another library."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pytest

from warpknit.export.vtk import write_vtk
from warpknit.results.frame import Frame, WireLayout, curve_position

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
        lines = mesh.cells.reshape(-1, 3)
        assert np.all(lines[:, 0] == 2) and np.all(lines[:, 2] == lines[:, 1] + 1)
        assert np.array_equal(np.bincount(mesh["wire"]), np.diff(layout.wire_start) - 1 + layout.wire_closed)
        contacts.set_active_time_value(frame.index)
        (mesh,) = contacts.read()
        assert np.array_equal(mesh.points, frame.body_position) and mesh.n_cells == layout.body_count
        assert np.array_equal(mesh["force"], frame.body_force)
        assert np.array_equal(mesh["active"], frame.body_active)
        assert np.array_equal(np.stack((mesh["wire_a"], mesh["wire_b"]), axis=1), layout.body_wires)
        assert np.flatnonzero(mesh["rhombus"]).tolist() == layout.rhombus_bodies.tolist()


def test_radius_is_at_every_point(tmp_path: Path, layout: WireLayout, frames: list[Frame]) -> None:
    """Tubes along the wires, as thick as they are, need it."""
    write_vtk(tmp_path, layout, frames[-1:])
    mesh = meshio.read(tmp_path / f"wires_{FRAMES[-1]:06d}.vtu")
    assert np.array_equal(mesh.point_data["radius"], np.full(layout.curve_node.size, 0.5 * layout.diameter))


def test_no_line_joins_two_wires(layout: WireLayout) -> None:
    wire = np.repeat(np.arange(layout.wire_count), np.diff(layout.curve_start))
    segment = layout.curve_segment
    assert np.array_equal(wire[segment], wire[segment + 1])
    assert segment.size == wire.size - layout.wire_count


def test_number_that_is_not_finite_is_refused(tmp_path: Path, layout: WireLayout, frames: list[Frame]) -> None:
    stress = frames[0].node_stress.copy()
    stress[7] = np.inf
    with pytest.raises(ValueError, match=r"node_stress .*\(7,\)"):
        write_vtk(tmp_path, layout, [replace(frames[0], node_stress=stress)])
    assert list(tmp_path.iterdir()) == []


def test_contacts_elsewhere_are_a_series_in_space(
    tmp_path: Path, layout: WireLayout, space_layout: WireLayout, make_space_frame: Callable[..., Frame]
) -> None:
    """With a file for a record without any, in whose place another record's would be shown; none in the plane."""
    frames = [make_space_frame(index) for index in FRAMES]
    paths = {path.name: path for path in write_vtk(tmp_path, space_layout, frames)}
    for frame in frames:
        assert f'timestep="{frame.index}"' in paths["elsewhere.pvd"].read_text()
        path = paths[f"elsewhere_{frame.index:06d}.vtu"]
        assert f'NumberOfPoints="{frame.index}" NumberOfCells="{frame.index}"' in path.read_text()
        if not frame.index:
            continue  # meshio writes what is empty, and does not read it
        mesh = meshio.read(path)
        np.testing.assert_array_equal(mesh.points, frame.elsewhere_position)
        assert mesh.cells_dict["vertex"].ravel().tolist() == list(range(frame.index))
        for name, values in zip(("force", "wire_a", "wire_b"), (frame.elsewhere_force, *frame.elsewhere_wires.T), strict=True):
            np.testing.assert_array_equal(mesh.point_data[name], values)
    assert not [path for path in write_vtk(tmp_path / "plane", layout, frames) if "elsewhere" in path.name]
