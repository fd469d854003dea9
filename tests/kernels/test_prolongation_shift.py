"""The shift from a place on a large mesh to that on a smaller one: edges are copied, the interior is stretched without jumps."""

import numpy as np
import pytest
import warp as wp

from warpknit.kernels.prolong import shift_along, slope_along
from warpknit.mechanics.prolongation import RIM


@wp.kernel
def find_shifts(
    place: wp.array(dtype=wp.float64),
    large: int,
    small: int,
    rim: int,
    shift: wp.array(dtype=wp.float64),
    slope: wp.array(dtype=wp.float64),
):
    i = wp.tid()
    shift[i] = shift_along(place[i], large, small, rim, 0)
    slope[i] = slope_along(place[i], large, small, rim, 0)


@pytest.mark.parametrize(("large", "small"), [(12, 8), (24, 8), (43, 15), (128, 44), (205, 69)])
def test_shift_is_smooth_and_keeps_the_order_of_places(large: int, small: int) -> None:
    """None within RIM of the lower edge, all of it within RIM of the upper one; the slope is its derivative and changes by at
    most a blend's share between neighbours; places on the small mesh follow each other as on the large one."""
    place, step = np.linspace(0.0, large, 4001, retstep=True)
    arrays = [wp.array(values, dtype=wp.float64, device="cpu") for values in (place, np.zeros(len(place)), np.zeros(len(place)))]
    wp.launch(find_shifts, dim=len(place), inputs=[arrays[0], large, small, RIM, *arrays[1:]], device="cpu")
    shift, slope = arrays[1].numpy(), arrays[2].numpy()
    missing, blend = large - small, np.clip(0.5 * (small - 2 * RIM), 1.0, 3.0)
    assert shift[place <= RIM] == pytest.approx(0.0, abs=1e-12)
    assert shift[place >= large - RIM] == pytest.approx(-missing, rel=1e-12)
    assert shift + shift[::-1] == pytest.approx(-missing, rel=1e-12)  # of both edges alike
    # of a parabola the difference quotient is the mean slope; the rest is where it begins or ends within a step
    assert np.diff(shift) / step == pytest.approx(0.5 * (slope[1:] + slope[:-1]), abs=0.51 * step / blend * np.abs(slope).max())
    assert np.abs(np.diff(slope)).max() <= 1.01 * step / blend * np.abs(slope).max()
    assert np.diff(place + shift).min() >= -1e-12
