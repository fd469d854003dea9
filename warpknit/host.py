"""Device arrays on the host."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

_VIEW = "host_view"  # attribute of an array on the CPU: its view, made once


def fetch(array: wp.array) -> np.ndarray:
    """The array on the host: a view on the CPU, a copy from a GPU."""
    view: np.ndarray | None = array.__dict__.get(_VIEW)
    if view is None:
        view = array.numpy()
        if wp.get_device(array.device).is_cpu:
            array.__dict__[_VIEW] = view
    return view


def store(array: wp.array, values: Any) -> None:
    """Set all entries of the array to values that have its shape on the host, or broadcast to it."""
    host = fetch(array)
    host[...] = values
    if _VIEW not in array.__dict__:
        array.assign(host)
