"""Sums and largest values over blocks of nodes."""

from types import SimpleNamespace

import numpy as np
import pytest

from warpknit.compute.ranks import Ranks
from warpknit.spatial.strip import WireSums


@pytest.mark.parametrize(("blocks", "worlds", "left_out"), [(999, 1, 0), (2_500, 1, 2), (2_500, 3, 2)])
def test_the_largest_value_leaves_out_one_block_in_a_thousand(blocks: int, worlds: int, left_out: int) -> None:
    """Values 0 to n - 1 in any order: the largest one is n - 1, less those left out, in every world and column."""
    strip = SimpleNamespace(ranks=Ranks(), wires=range(worlds))
    rods = SimpleNamespace(wire_first=np.arange(worlds))
    sums = WireSums(strip, rods, np.repeat(np.arange(worlds), blocks), range(worlds * blocks), worlds)
    random = np.random.default_rng(0)
    rows = np.concatenate([np.stack([random.permutation(blocks), -random.permutation(blocks)], axis=1) for _ in range(worlds)])
    expected = np.tile([blocks - 1 - left_out, -left_out], (worlds, 1))
    assert np.array_equal(sums.largest(rows), expected)
    assert np.array_equal(sums.largest(rows, np.array([worlds - 1])), expected[:1])
