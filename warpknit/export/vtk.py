"""A run as a time series for ParaView and PyVista.

    wires.pvd       -> wires_######.vtu       line cells; point data `stress` [Pa] and `radius` [m] of the yarn, for tubes; cell
                                              data `wire`
    contacts.pvd    -> contacts_######.vtu    one vertex a contact body; `force`, `force_a`, `force_b` [N], `active`
                                              (both pairs closed), `active_pairs` (0, 1 or 2), `wire_a`, `wire_b`,
                                              `rhombus`
    elsewhere.pvd   -> elsewhere_######.vtu   spatial model: one vertex an active contact between stitches; `force` [N], `wire_a`,
                                              `wire_b`

SI units: lengths in m. The time is the index of the frame. Open the two .pvd files.
"""

from collections.abc import Iterable
from pathlib import Path
from xml.sax.saxutils import quoteattr

import meshio
import numpy as np

from warpknit.base.files import path_aside, write_aside
from warpknit.export.run_record import RunRecord
from warpknit.results.frame import Frame, WireLayout, curve_position, drawn_frame, drawn_layout


def export_vtk(record: RunRecord) -> list[Path]:
    """Write the frames of a run into vtk/; the paths."""
    frames = (drawn_frame(record.layout, frame) for frame in record.frames())
    return write_vtk(record.directory / "vtk", drawn_layout(record.layout), frames)


def write_vtk(directory: Path, layout: WireLayout, frames: Iterable[Frame]) -> list[Path]:
    """Write every frame, then the collections that name them; the paths, collections first."""
    segment = layout.curve_segment
    lines = np.stack((segment, segment + 1), axis=1)
    line_wire = np.repeat(np.arange(layout.wire_count, dtype=np.int32), np.diff(layout.curve_start) - 1)
    is_rhombus = np.zeros(layout.body_count, dtype=np.int32)
    is_rhombus[layout.rhombus_bodies] = 1
    series: dict[str, list[tuple[int, Path]]] = {"wires": [], "contacts": [], "elsewhere": []}
    for frame in frames:
        frame.require_layout(layout)
        frame.require_finite()
        wires = meshio.Mesh(
            curve_position(layout, frame),
            [("line", lines)],
            point_data={
                "stress": np.asarray(frame.node_stress, dtype=float)[layout.curve_node],
                "radius": 0.5 * np.repeat(layout.wire_diameter, np.diff(layout.curve_start)),
            },
            cell_data={"wire": [line_wire]},
        )
        hooks = {
            "force": frame.body_force,
            "force_a": frame.pair_force[0::2],
            "force_b": frame.pair_force[1::2],
            "active": frame.body_active.astype(np.int32),
            "active_pairs": frame.pair_active.reshape(-1, 2).sum(axis=1, dtype=np.int32),
            "rhombus": is_rhombus,
        }
        contacts = _points(frame.body_position, layout.body_wires, hooks)
        elsewhere = _points(frame.elsewhere_position, frame.elsewhere_wires, {"force": frame.elsewhere_force})
        for name, mesh in (("wires", wires), ("contacts", contacts), ("elsewhere", elsewhere)):
            # without a file ParaView shows the contacts of another record
            if layout.in_space if name == "elsewhere" else mesh.points.size:
                path = directory / f"{name}_{frame.index:06d}.vtu"
                with path_aside(path) as aside:
                    meshio.write(aside, mesh, file_format="vtu", binary=True)
                series[name].append((frame.index, path))
    collections = [_write_collection(directory / f"{name}.pvd", members) for name, members in series.items() if members]
    return collections + [path for members in series.values() for _, path in members]


def _points(position: np.ndarray, wires: np.ndarray, data: dict[str, np.ndarray]) -> meshio.Mesh:
    """A vertex a contact, with its wires (contact, 2) and the `data` [contact]."""
    data = {**data, "wire_a": wires[:, 0].astype(np.int32), "wire_b": wires[:, 1].astype(np.int32)}
    vertices = [("vertex", np.arange(len(position))[:, None])]
    return meshio.Mesh(position, vertices, point_data={name: np.ascontiguousarray(one) for name, one in data.items()})


def _write_collection(path: Path, members: list[tuple[int, Path]]) -> Path:
    rows = [f'    <DataSet timestep="{index}" part="0" file={quoteattr(member.name)}/>' for index, member in members]
    with write_aside(path) as file:
        file.write('<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>\n')
        file.write("\n".join(rows) + "\n  </Collection>\n</VTKFile>\n")
    return path
