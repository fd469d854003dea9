"""Centre lines in NumPy arrays, as a file of wires in memory."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from warpknit.base.errors import InputError
from warpknit.base.text import counted
from warpknit.scene.wire_file import WireArrays
from warpknit.wires.bases import BadFile, check_count, check_points


def wires_from_arrays(points: Sequence[ArrayLike], *, closed: bool | Sequence[bool] = False, **keys: Any) -> dict[str, Any]:
    """The table `[wires]` of centre lines in arrays, for `load_scene`.

        s = np.linspace(-2e-3, 2e-3, 81)                                           # [m]
        wave = 0.06e-3 * np.cos(2e3 * np.pi * s)
        weft, warp = np.stack([s, 0 * s, wave], axis=1), np.stack([0 * s, s, -wave], axis=1)
        load_scene({"wires": wires_from_arrays([weft, warp]), "wire": {"diameter": "0.1 mm"}, "load": {"strain_weft": 0.01}})

    points: an array (point, 3) [m] for each wire: x along weft, y along warp, z across. A smooth curve passes through them.
    closed: whether the ends are joined, for all wires or for each (wire,). A wire whose last point repeats its first is closed.
    keys: other keys of `[wires]`, such as node_spacing="50 um" or period=["1.2 mm", "1 mm"]; see docs/scenes.md.

    An .npz file of the same arrays gives the same wires (docs/how-to/wires_from_a_file.md). A run keeps a copy, wires.npz.

    Raises `InputError`, with the number of the wire, for points that are not (point, 3) finite numbers.
    """
    wires = [_points_of(number, wire) for number, wire in enumerate(points, start=1)]
    if not wires:
        raise InputError("wires_from_arrays: no wires; give a list of arrays (point, 3), one for each wire")
    rings = np.asarray(closed) if np.ndim(closed) else np.full(len(wires), closed)
    if rings.shape != (len(wires),) or rings.dtype != bool:
        wrong = f"closed {closed!r} does not fit {counted(len(wires), 'wire')}"
        raise InputError(f"wires_from_arrays: {wrong}; give one boolean, or one for each wire")
    try:
        check_count(sum(map(len, wires)))
    except BadFile as error:
        raise InputError(f"wires_from_arrays: {error}; give fewer points") from error
    archive = io.BytesIO()
    np.savez(archive, points=np.concatenate(wires), counts=[len(wire) for wire in wires], closed=rings)
    return {"file": WireArrays(archive.getvalue()), "unit": "m", **keys}


def _points_of(number: int, points: ArrayLike) -> np.ndarray:
    """(point, 3) [m] points of a wire. Raises `InputError`."""
    try:
        array = np.asarray(points, dtype=np.float64)
        if array.ndim == 2 and array.shape[1] == 3 and len(array) > 0:
            return check_points(array)
        wrong = f"has shape {array.shape}"
    except BadFile as error:
        wrong = f"has {error}"
    except (TypeError, ValueError):
        wrong = "is not an array of numbers"
    raise InputError(f"wires_from_arrays: wire {number} {wrong}; give finite numbers (point, 3) in m")
