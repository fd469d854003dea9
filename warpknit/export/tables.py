"""A run as tables: contacts (a row a body) and wires of each frame, and contacts between stitches of a spatial one.

SI units, with names in the headings.
"""

from pathlib import Path

import numpy as np

from warpknit.base.files import write_table
from warpknit.export.run_record import RunRecord
from warpknit.knit.cloth import CLASS_NAMES
from warpknit.results.frame import Frame, WireLayout, curve_position, drawn_frame, drawn_layout


def export_tables(record: RunRecord) -> list[Path]:
    """Write contacts_######.csv, wires_######.csv and, if spatial, elsewhere_######.csv into tables/; the paths."""
    paths = []
    for frame in record.frames():
        tables = {"contacts": contact_table(record.layout, frame), "wires": wire_table(record.layout, frame)}
        if record.layout.in_space:
            tables["elsewhere"] = elsewhere_table(frame)
        for name, table in tables.items():
            paths.append(write_table(record.directory / "tables" / f"{name}_{frame.index:06d}.csv", table))
    return paths


def contact_table(layout: WireLayout, frame: Frame) -> dict[str, np.ndarray]:
    """Columns, a value a body. `force_N` is what passes between the wires, the smaller of the two pairs' forces."""
    body = np.arange(layout.body_count)
    x, y, z = frame.body_position.T
    classes = {"class": np.array(list(CLASS_NAMES))[layout.body_class]} if layout.body_class.size else {}
    return {
        "body": body,
        **classes,
        "wire_a": layout.body_wires[:, 0],
        "wire_b": layout.body_wires[:, 1],
        "x_m": x,
        "y_m": y,
        "z_m": z,
        "force_N": frame.body_force,
        "force_a_N": frame.pair_force[0::2],
        "force_b_N": frame.pair_force[1::2],
        "active": frame.body_active.astype(int),
        "active_a": frame.pair_active[0::2].astype(int),
        "active_b": frame.pair_active[1::2].astype(int),
        "central_rhombus": np.isin(body, layout.rhombus_bodies).astype(int),
    }


def elsewhere_table(frame: Frame) -> dict[str, np.ndarray]:
    """Columns, a value an active contact where no wires hook."""
    (wire_a, wire_b), (x, y, z) = frame.elsewhere_wires.T, frame.elsewhere_position.T
    return {"wire_a": wire_a, "wire_b": wire_b, "x_m": x, "y_m": y, "z_m": z, "force_N": frame.elsewhere_force}


def wire_table(layout: WireLayout, frame: Frame) -> dict[str, np.ndarray]:
    """Columns with a value a wire. The length of a closed wire is that for one period."""
    start, drawn = layout.wire_start, drawn_layout(layout)
    points, segment = curve_position(drawn, drawn_frame(layout, frame)), drawn.curve_segment
    length = np.linalg.norm(points[segment + 1] - points[segment], axis=1)
    nodes = np.diff(start)
    bodies = [np.bincount(column, minlength=layout.wire_count) for column in layout.body_wires.T]
    active = [
        np.bincount(column, frame.pair_active[side::2], minlength=layout.wire_count).astype(int)
        for side, column in enumerate(layout.body_wires.T)
    ]
    return {
        "wire": np.arange(layout.wire_count),
        "closed": layout.wire_closed.astype(int),
        "nodes": nodes,
        "length_m": np.add.reduceat(length, drawn.curve_start[:-1] - np.arange(layout.wire_count)),
        "x_mean_m": np.add.reduceat(frame.node_position[:, 0], start[:-1]) / nodes,
        "y_mean_m": np.add.reduceat(frame.node_position[:, 1], start[:-1]) / nodes,
        "stress_max_Pa": np.maximum.reduceat(frame.node_stress, start[:-1]),
        "stress_mean_Pa": np.add.reduceat(frame.node_stress, start[:-1]) / nodes,
        "pairs": bodies[0] + bodies[1],
        "active_pairs": active[0] + active[1],
    }
