"""Views of device arrays on the host."""

import gc
import weakref

import numpy as np
import warp as wp

from warpknit.compute.host import fetch, store


def test_a_view_does_not_keep_its_array() -> None:
    array = wp.zeros(100, dtype=wp.vec3d, device="cpu")
    fetch(array)[3] = 1.0
    freed = weakref.ref(array)
    del array
    gc.collect()
    assert freed() is None


def test_views_are_the_array() -> None:
    array = wp.zeros((4, 2), dtype=wp.int32, device="cpu")
    store(array, [1, 2])
    fetch(array)[2] = 7
    assert np.array_equal(array.numpy(), [[1, 2], [1, 2], [7, 7], [1, 2]])
    array.assign(np.zeros((4, 2), dtype=np.int32))
    assert not fetch(array).any()
    assert fetch(wp.zeros(0, dtype=wp.float64, device="cpu")).shape == (0,)
