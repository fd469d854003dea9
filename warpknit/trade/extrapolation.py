"""Richardson extrapolation: what a value would be with endlessly many nodes, from three numbers of nodes.

    f(n) = f + C n^-p        (f1 - f2)/(f2 - f3) = r^-p        f = f1 + (f1 - f2)/(r^p - 1)

with f1 of the most nodes and r the ratio of the nodes of one to the next (Roache, J. Fluids Eng. 116 (1994) 405).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

LEAST_ORDER, MOST_ORDER = 1.0, 4.0  # of convergence that is believed: beyond, differences are too small or too rough to tell


@dataclass(frozen=True)
class Extrapolated:
    """What three values of one quantity say."""

    order: float  # p, within the range that is believed
    limit: float  # f
    error: float  # |f1 - f|: of the finest value


def extrapolate(finest: float, middle: float, coarsest: float, ratio: float) -> Extrapolated:
    """Extrapolate from values at n, n/ratio and n/ratio^2 nodes.

    Where the differences do not fall steadily the order counts as LEAST_ORDER, which makes the error the larger.
    """
    first, second = finest - middle, middle - coarsest
    order = LEAST_ORDER
    if first * second > 0.0:
        order = min(max(math.log(second / first) / math.log(ratio), LEAST_ORDER), MOST_ORDER)
    step = first / (ratio**order - 1.0)
    return Extrapolated(order, finest + step, abs(step))
