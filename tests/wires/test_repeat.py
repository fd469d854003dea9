"""Several repeats as one: as much wire, the same contacts in each, and wires that go on where they should."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from warpknit.base.errors import SceneError
from warpknit.scene import load_scene
from warpknit.wires.centre_lines import Wires, repeated
from warpknit.wires.overlaps import find_overlaps
from warpknit.wires.read import rest_wires

CELL = Path(__file__).parents[2] / "scenes" / "wires" / "plain_knit_cell.toml"


def line(shift, count=12) -> Wires:
    """A straight wire that goes on by `shift` repeats of 1 x 2, and a ring beside it."""
    closing = np.array([shift[0] * 1.0, shift[1] * 2.0, 0.0])
    angle = 2.0 * np.pi * np.arange(count) / count
    ring = 0.1 * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1) + [0.5, 0.5, 1.0]
    wire = [0.1, 0.1, 0.0] + np.arange(count)[:, None] / count * closing
    return Wires(
        points=(wire, ring),
        kinds=("periodic", "closed"),
        shifts=np.array([shift, (0, 0)]),
        period=np.array([1.0, 2.0]),
        radius=np.array([0.01, 0.02]),
        rest_lengths=(np.full(count, 0.3), np.full(count, 0.2)),
    )


@pytest.mark.parametrize(
    ("shift", "repeats", "wires", "goes_on"),
    [  # of the straight wire: how many there are, and by how many of the larger repeats each goes on
        ((0, 1), (3, 2), 3, (0, 1)),
        ((1, 0), (3, 2), 2, (1, 0)),
        ((1, 1), (3, 2), 1, (2, 3)),
        ((1, 1), (2, 2), 2, (1, 1)),
        ((2, 0), (2, 1), 2, (1, 0)),
        ((-1, 2), (2, 4), 4, (-1, 1)),
    ],
)
def test_wires_are_joined_until_they_come_back(shift, repeats, wires, goes_on):
    cell = line(shift)
    whole = repeated(cell, repeats)
    count = repeats[0] * repeats[1]
    assert whole.kinds.count("periodic") == wires and whole.kinds.count("closed") == count
    assert [tuple(each) for each, kind in zip(whole.shifts, whole.kinds, strict=True) if kind == "periodic"] == [goes_on] * wires
    assert whole.period.tolist() == [repeats[0] * 1.0, repeats[1] * 2.0]
    assert whole.node_count == count * cell.node_count
    assert whole.lengths.sum() == pytest.approx(count * cell.lengths.sum())
    assert sum(rest.sum() for rest in whole.rest_lengths) == pytest.approx(count * sum(rest.sum() for rest in cell.rest_lengths))
    for number in range(len(whole.points)):  # no jumps, so each piece goes on where the next begins
        begin, end = whole.ends(number)
        assert np.ptp(np.linalg.norm(end - begin, axis=1)) < 1e-12


@pytest.mark.parametrize("repeats", [(2, 1), (1, 3), (2, 2)])
def test_contacts_are_those_of_every_repeat(repeats):
    """Plain knit as thick as makes neighbouring rows overlap in four places a loop."""
    cell = rest_wires(load_scene(CELL))
    count = repeats[0] * repeats[1]
    found, alone = find_overlaps(repeated(cell, repeats), 0.38e-3), find_overlaps(cell, 0.38e-3)
    assert alone.places == 4 and found.places == 4 * count
    assert found.closest == pytest.approx(alone.closest, rel=1e-9)


def test_repeats_of_a_scene():
    scene = load_scene(CELL, ["wires.repeats=[3, 2]"])
    wires = rest_wires(scene)
    assert wires.kinds == ("periodic",) * 2 and wires.node_count == 6 * rest_wires(load_scene(CELL)).node_count
    assert scene.hash != load_scene(CELL).hash
    assert scene.wires is not None
    with pytest.raises(SceneError, match="wires.repeats: "):
        rest_wires(replace(scene, wires=replace(scene.wires, repeats=(10_000, 10_000))))
