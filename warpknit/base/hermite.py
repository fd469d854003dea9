"""Cubic Hermite shape functions: the part of a wire's curve that its nodes and slopes give.

With x1, x2 the ends of a segment and M1, M2 the slopes dp/ds there, for s in 0 .. 1 and relative to x1

    p(s) = h10 M1 + h01 (x2 - x1) + h11 M2

Slopes that are half of x2 - x0 and of x3 - x1, from node to node beside it, make it Catmull-Rom's curve. The kernels have
the same in kernels/wire_curve.py and kernels/contact.py.
"""

from __future__ import annotations

import numpy as np


def hermite(s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """h10, h01 and h11 at places s, 0 .. 1 on a segment.

    >>> hermite(0.5)
    (0.125, 0.5, -0.125)
    """
    return s * (1 - s) ** 2, s * s * (3 - 2 * s), s * s * (s - 1)
