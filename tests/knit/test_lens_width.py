"""Where the wires of a lens first touch: parabolas in plan whose heights part evenly, for which it is known."""

from types import SimpleNamespace

import numpy as np
import pytest

from warpknit.knit.clasps import Arm, Clasp
from warpknit.mesh.tight_loops import approach_at_touch, lens_widths

DIAMETER, CURVATURE, WIDTH = 15e-6, 400.0, 90e-6


def two_hooked(slope: float, curvature: float = CURVATURE) -> SimpleNamespace:
    """A cloth of one lens, its wires evenly bent in plan, of which one rises by as much as the other falls."""
    half = np.sqrt(WIDTH / curvature)
    x = np.linspace(-half, half, 400)
    bow = 0.5 * WIDTH - 0.5 * curvature * x**2
    lines = [np.stack([x, sign * bow, sign * 0.5 * slope * x], axis=1) for sign in (1.0, -1.0)]
    threads = tuple(SimpleNamespace(stretch=lambda low, high, height, line=line: line) for line in lines)
    arms = tuple(Arm(k, 0, 0.0, -half, half, 1, 0.5 * WIDTH) for k in (0, 1))
    return SimpleNamespace(threads=threads, size=np.ones(2), clasps=(Clasp(np.zeros(2), arms, 1),))


@pytest.mark.parametrize("q", [0.2, 0.4, 0.7, 1.5, 4.0])
def test_wires_touch_where_the_law_of_the_lens_says(q: float) -> None:
    """D = d (q + 1/q)/2 with q = slope^2/(curvature d) below one, else d (studies/condensation.md). The wires are moved apart by
    the slope of their bow, at most sqrt(WIDTH curvature) = 0.19: lengths are 1 + 0.19^2/2 off."""
    relative = 2.0 * CURVATURE
    slope = np.sqrt(q * relative * DIAMETER)
    width, touching = lens_widths(two_hooked(slope), DIAMETER)[0]
    assert width == pytest.approx(WIDTH, rel=1e-3)
    law = 0.5 * (q + 1.0 / q) if q < 1.0 else 1.0
    assert touching == pytest.approx(law * DIAMETER, rel=0.03)


def test_the_approach_is_the_share_at_the_first_touch() -> None:
    q = 0.25
    cloth = two_hooked(np.sqrt(q * 2.0 * CURVATURE * DIAMETER))
    touching = 0.5 * (q + 1.0 / q) * DIAMETER
    assert approach_at_touch(cloth, DIAMETER, 1.25 * DIAMETER) == pytest.approx(
        (WIDTH - touching) / (WIDTH - 1.25 * DIAMETER), rel=0.02
    )
    assert approach_at_touch(two_hooked(0.5), DIAMETER, 1.25 * DIAMETER) == 1.0
