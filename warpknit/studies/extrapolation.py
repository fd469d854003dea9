"""Richardson extrapolation to infinitely many nodes, from results at three node counts.

    f(n) = f + C n^-p        (f1 - f2)/(f2 - f3) = r^-p        f = f1 + (f1 - f2)/(r^p - 1)

with f1 at the most nodes and r the ratio of successive node counts (Roache, J. Fluids Eng. 116 (1994) 405).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

MIN_ORDER, MAX_ORDER = 1.0, 4.0  # accepted orders of convergence; outside, the differences are too small or too noisy


@dataclass(frozen=True)
class Extrapolated:
    """Order of convergence, limit and error of one quantity."""

    order: float  # p, clipped to the accepted range
    limit: float  # f
    error: float  # of the finest value: |f1 - f|, more where the order is clipped


def extrapolate(finest: float, middle: float, coarsest: float, ratio: float) -> Extrapolated:
    """Extrapolate from values at n, n/ratio and n/ratio^2 nodes.

    Where the differences do not decrease monotonically by an order in the accepted range, that order is clipped, and the error is
    at least the larger difference.
    """
    first, second = finest - middle, middle - coarsest
    apparent = math.log(second / first) / math.log(ratio) if first * second > 0.0 else 0.0
    order = min(max(apparent, MIN_ORDER), MAX_ORDER)
    step = first / (ratio**order - 1.0)
    least = 0.0 if order == apparent else max(abs(first), abs(second))
    return Extrapolated(order, finest + step, max(abs(step), least))
