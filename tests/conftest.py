"""What all tests share: the device they run on.

SI values are small: pytest.approx needs `abs=0` beside `rel`, or its own 1e-12 hides a force of a piconewton.
"""

import pytest
import warp as wp

wp.config.quiet = True


@pytest.fixture(params=["cpu", pytest.param("cuda:0", marks=pytest.mark.gpu)])
def device(request: pytest.FixtureRequest) -> str:
    """Each device in turn; without CUDA the second is skipped."""
    if request.param.startswith("cuda") and not wp.is_cuda_available():
        pytest.skip("no CUDA device")
    return request.param
