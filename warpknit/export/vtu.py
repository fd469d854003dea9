"""Unstructured grids as VTK XML files, compressed."""

import base64
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from warpknit.files import write_aside

__all__ = ["POLYLINE", "VERTEX", "Grid", "write_vtu"]

VERTEX, POLYLINE = 1, 4  # types of cells
TYPES = {"f": "Float", "i": "Int", "u": "UInt"}  # of a value, by the kind of its NumPy type


@dataclass(frozen=True)
class Grid:
    """Cells of one type, each of the next `cell_sizes` points in order."""

    points: NDArray[Any]  # [point, 3]
    cell_type: int
    cell_sizes: NDArray[np.integer[Any]]  # [cell]
    point_data: Mapping[str, NDArray[Any]] = field(default_factory=dict)  # name -> [point]
    cell_data: Mapping[str, NDArray[Any]] = field(default_factory=dict)  # name -> [cell]


def write_vtu(path: Path, grid: Grid) -> None:
    """Write a grid aside, and rename the file."""
    points, cells = len(grid.points), len(grid.cell_sizes)
    parts: dict[str, Mapping[str, NDArray[Any]]] = {
        "Points": {"Points": np.asarray(grid.points, dtype=float)},
        "Cells": {
            "connectivity": np.arange(points, dtype=np.int64),
            "offsets": np.cumsum(grid.cell_sizes, dtype=np.int64),
            "types": np.full(cells, grid.cell_type, dtype=np.uint8),
        },
        "PointData": grid.point_data,
        "CellData": grid.cell_data,
    }
    with write_aside(path) as file:
        file.write('<?xml version="1.0"?>\n<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian"')
        file.write(' header_type="UInt64" compressor="vtkZLibDataCompressor">\n<UnstructuredGrid>\n')
        file.write(f'<Piece NumberOfPoints="{points}" NumberOfCells="{cells}">\n')
        for part, arrays in parts.items():
            file.write(f"<{part}>\n{''.join(_array(name, values) for name, values in arrays.items())}</{part}>\n")
        file.write("</Piece>\n</UnstructuredGrid>\n</VTKFile>\n")


def _array(name: str, values: NDArray[Any]) -> str:
    """An array as one compressed block, after its header: count of blocks, their size, size of a partial one, compressed size."""
    little = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<"))
    block = zlib.compress(little.tobytes())
    header = np.array([1, little.nbytes, 0, len(block)], dtype="<u8").tobytes()
    kind = f"{TYPES[little.dtype.kind]}{8 * little.itemsize}"
    components = values.shape[1] if values.ndim > 1 else 1
    start = f'<DataArray type="{kind}" Name={quoteattr(name)} NumberOfComponents="{components}" format="binary">'
    return f"{start}{base64.b64encode(header).decode()}{base64.b64encode(block).decode()}</DataArray>\n"
