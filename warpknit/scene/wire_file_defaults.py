"""Defaults and limits of a file of wires."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from warpknit.base.text import both, exact
from warpknit.scene.file import SceneFile
from warpknit.scene.keys import as_object
from warpknit.scene.messages import scene_error
from warpknit.scene.source import Source
from warpknit.scene.wire import Wire
from warpknit.scene.wire_file import (
    LOOP_SIZE,
    MOST_THICKNESS,
    POLYLINES,
    USD,
    WITH_WIDTHS,
    WITHOUT_UNIT,
    WireFile,
    WireFileError,
    WiresTable,
    checked_bytes,
)


def file_diameter(source: Source, file: SceneFile) -> float | None:
    """[m] Diameter of the thickest wire in a file whose widths count; None: they do not. Raises `SceneError`."""
    table = file.wires
    is_given = "diameter" in source.table.get("wire", {})
    if table is None or table.widths is False or (is_given and table.widths is None):
        return None
    path = source.path.parent / table.file
    radius, fault = _file_radius(source, path, table) if path.suffix.lower() in WITH_WIDTHS else (None, "")
    if fault and not table.widths:
        raise scene_error(source.path, "wire.diameter", f"missing: {path.name!r} has {fault}", "write one")
    if radius is None:
        if table.widths:
            wrong = f"does not fit {path.name!r}, which has {fault or 'no widths'}"
            raise source.refusal(("wires", "widths"), True, wrong, "leave it out")
        return None
    thickest, thinnest = (2.0 * float(limit) for limit in (radius.max(), radius.min()))
    if thickest > MOST_THICKNESS or file.wire.with_thickness(thinnest).diameter <= 0.0:
        wrong = f"{path.name!r} has wires {both(exact(thinnest, 'm'), exact(thickest, 'm'))} thick"
        instead = f"use wires thicker than their plating, of at most {exact(MOST_THICKNESS, 'm')}"
        raise scene_error(source.path, "wires.file", wrong, instead)
    return file.wire.with_thickness(thickest).diameter


def _file_radius(source: Source, path: Path, table: WiresTable) -> tuple[np.ndarray | None, str]:
    """(wire,) [m] radius of the wires in a file, and why it has none. Raises `SceneError`."""
    from warpknit.wires.file_curves import stated_radius

    try:
        return stated_radius(path, time=table.time)
    except WireFileError as error:
        raise scene_error(source.path, "wires.file", f"{table.file!r} {error.wrong}", error.instead) from error


def wire_file(source: Source, file: SceneFile, wire: Wire, has_widths: bool) -> WireFile | None:
    """The file of wires with its defaults, relative to the scene, or None; has_widths: whether its widths count.

    Raises `SceneError`.
    """
    table = file.wires
    if table is None:
        return None
    path = source.path.parent / table.file
    try:
        data = checked_bytes(path)
    except WireFileError as error:
        raise source.refusal(("wires", "file"), table.file, error.wrong, error.instead) from error
    suffix = path.suffix.lower()
    if table.unit is None and suffix in WITHOUT_UNIT:
        raise scene_error(source.path, "wires.unit", f"missing: a {suffix} file has no unit", "write one, such as 'mm'")
    if table.unit is not None and suffix in USD:
        raise source.refusal(("wires", "unit"), table.unit, f"is not allowed: a {suffix} file has its own unit", "leave it out")
    if table.closed and suffix not in POLYLINES:
        raise source.refusal(("wires", "closed"), True, f"is not allowed: a {suffix} file marks its closed wires", "leave it out")
    if table.period is not None and suffix == ".pyp":
        raise source.refusal(("wires", "period"), table.period, "is not allowed: a .pyp file has its own period", "leave it out")
    if table.time is not None and suffix not in USD:
        raise source.refusal(("wires", "time"), table.time, f"has no effect with a {suffix} file", "leave it out")
    return as_object(
        WireFile,
        table,
        file=str(path.resolve()),
        widths=has_widths,
        digest=hashlib.sha256(data).hexdigest(),
        node_spacing=wire.diameter if table.node_spacing is None else table.node_spacing,
        loop_size=LOOP_SIZE * wire.diameter if table.loop_size is None else table.loop_size,
    )
