"""Where the largest stress is said to be."""

from types import SimpleNamespace

import numpy as np
import pytest

from warpknit.measure import peak_position


@pytest.mark.parametrize(("boundary", "expected"), [("periodic", (0.315e-3, 0.1e-3)), ("gripped", (2.36e-3, 2.1e-3))])
def test_the_place_of_a_tile_is_within_it(boundary: str, expected: tuple[float, float]) -> None:
    """A wire that wanders leaves its tile of 1 mm x 2 mm, drawn by 2 % and sheared by 0.005: its place is told by the tile that
    is drawn. Of a gripped mesh it is where the node is."""
    observed = SimpleNamespace(
        model=SimpleNamespace(panel=SimpleNamespace(boundary=boundary, size=np.array([1e-3, 2e-3]))),
        wire_stress=SimpleNamespace(node=np.array([1.0, 3.0]), contact=np.zeros(0)),
        node_position=np.array([[0.0, 0.0, 0.0], [3.36e-3, 3.1e-3, 0.0]]),
        corner=np.array([1e-3, 1e-3, 0.0]),
        stretch=np.array([[1.02, 0.0025], [0.0, 1.0]]),
    )
    assert peak_position(observed) == pytest.approx(expected)  # type: ignore[arg-type]
