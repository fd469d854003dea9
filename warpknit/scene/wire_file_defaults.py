"""Defaults and limits of a file of wires."""

from __future__ import annotations

import hashlib

from warpknit.scene.file import SceneFile
from warpknit.scene.keys import as_object
from warpknit.scene.source import Source
from warpknit.scene.wire import Wire
from warpknit.scene.wire_file import LOOP_SIZE, POLYLINES, USD, WITHOUT_UNIT, WireFile, WireFileError, checked_bytes


def wire_file(source: Source, file: SceneFile, wire: Wire) -> WireFile | None:
    """The file of wires with its defaults, relative to the scene, or None. Raises `SceneError`."""
    table = file.wires
    if table is None:
        return None
    path = source.path.parent / table.file
    try:
        data = checked_bytes(path)
    except WireFileError as error:
        raise source.refusal(("wires", "file"), table.file, f"{error.allowed}; this is {error.given}") from error
    suffix = path.suffix.lower()
    if table.unit is None and suffix in WITHOUT_UNIT:
        raise source.refusal(("wires", "unit"), "nothing", f"a length unit, such as 'mm', with a {suffix} file, which has none")
    if table.unit is not None and suffix in USD:
        raise source.refusal(("wires", "unit"), table.unit, f"nothing with a {suffix} file, which has a unit")
    if table.closed and suffix not in POLYLINES:
        raise source.refusal(("wires", "closed"), True, f"only with a {' or '.join(POLYLINES)} file; other formats contain it")
    if table.period is not None and suffix == ".pyp":
        raise source.refusal(("wires", "period"), table.period, "nothing with a .pyp file, which has a period")
    if table.time is not None and suffix not in USD:
        raise source.refusal(("wires", "time"), table.time, f"only with a USD file ({', '.join(USD)})")
    return as_object(
        WireFile,
        table,
        file=str(path.resolve()),
        digest=hashlib.sha256(data).hexdigest(),
        node_spacing=wire.diameter if table.node_spacing is None else table.node_spacing,
        loop_size=LOOP_SIZE * wire.diameter if table.loop_size is None else table.loop_size,
    )
