"""Where wires from a file hook each other: as the clasps of a knit do, whichever way the wires run and repeat."""

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from warpknit.knit.cloth import knit_cloth
from warpknit.scene import load_scene, make_scene
from warpknit.spatial.model import build_model
from warpknit.spatial.sites import NOWHERE, Sites
from warpknit.wires.centre_lines import Wires
from warpknit.wires.hooks import find_places
from warpknit.wires.read import rest_wires

SCENES = Path(__file__).parents[2] / "scenes" / "wires"
KNITS = {
    "double atlas": None,
    "tricot": [("1-0/1-2", "|", 0), ("1-2/1-0", "|", 0)],
    "locknit": [("1-2/1-0", "|", 0), ("1-0/2-3", "|", 0)],
    "atlas": [("1-0/1-2/2-3/2-1", "|", 0)],
}


def arcs(*signs: float, opening: float = 0.2) -> Wires:
    """Two arcs of radius 1 that bulge through each other, the left one at these heights over its lower and upper half."""
    angle = np.linspace(-1.0, 1.0, 81)
    height = np.where(angle < 0.0, *signs)
    left = np.stack([np.cos(angle) - 1.0 + 0.5 * opening, np.sin(angle), 5e-3 * height], axis=1)
    right = np.stack([-left[:, 0], np.sin(angle), 0.0 * angle], axis=1)
    return Wires((left, right), ("open", "open"), np.zeros((2, 2), dtype=int), None, None, None)


@pytest.mark.parametrize(("signs", "hooks"), [((1.0, -1.0), 1), ((-1.0, 1.0), 1), ((1.0, 1.0), 0), ((-1.0, -1.0), 0)])
def test_wires_hook_where_they_lie_over_and_under_each_other(signs: tuple[float, float], hooks: int) -> None:
    """The lens of two arcs of radius 1 that reach 0.2 through each other lies between the angles +-acos(0.9)."""
    found = find_places(arcs(*signs), loop_length=4.0)
    assert found.hooks == hooks
    if hooks:
        corner = np.arccos(0.9)
        assert found.low == pytest.approx(np.full((1, 2), 1.0 - corner), abs=3e-3)
        assert found.high == pytest.approx(np.full((1, 2), 1.0 + corner), abs=3e-3)
        assert found.position == pytest.approx(np.zeros((1, 2)), abs=3e-3)


def test_wires_that_do_not_reach_through_each_other_do_not_hook() -> None:
    assert find_places(arcs(1.0, -1.0, opening=-0.1), loop_length=4.0).hooks == 0
    assert find_places(arcs(1.0, -1.0), loop_length=0.5).hooks == 0, "a lens longer than half a loop is none"


@pytest.mark.parametrize("name", KNITS)
def test_hooks_of_a_knit_are_its_lenses(name: str) -> None:
    """The threads of a knit as wires of a file, that go on in the repeat above: as many hooks as the knit has lenses, where it
    has them; drawn in another repeat, or from its other end, a wire hooks the same ones."""
    bars = KNITS[name]
    knit = {} if bars is None else {"bars": [{"chain": c, "threading": t, "shift": s} for c, t, s in bars]}
    scene = make_scene({"knit": knit})
    cloth = knit_cloth(scene.knit, scene.wire.diameter, merge_lenses=False)
    loop = sum(thread.length for thread in cloth.threads) / len(cloth.stitches)
    size, count = np.array(cloth.size), len(cloth.threads)
    points = [thread.points for thread in cloth.threads]
    up = np.tile([0, 1], (count, 1))
    again = [p + np.append(size * [k, -k], 0.0) for k, p in enumerate(points)]
    for drawn, shift in ((points, up), (again, up), ([p[::-1] for p in points], -up)):
        found = find_places(Wires(tuple(drawn), ("periodic",) * count, shift, size, None, None), loop)
        assert found.hooks == len(cloth.clasps)
        expected = np.array([clasp.position for clasp in cloth.clasps])
        away = (found.position[: found.hooks, None] - expected + 0.5 * size) % size - 0.5 * size
        distance = np.linalg.norm(away, axis=2)
        assert distance[linear_sum_assignment(distance)].max() < 0.1 * loop


@pytest.mark.parametrize(
    ("scene", "overrides", "hooks"),
    [
        ("plain_knit_cell", (), 2),  # one loop that hooks the copy of itself below it with both its legs
        ("plain_knit_spatial", (), 8),  # 2 x 2 of it, as two wires
        ("plain_knit_spatial", ("wires.repeats=[1, 3]",), 6),
        ("plain_knit_patch", (), 12),  # three rows of three loops, open: two of the rows hook one below
    ],
)
def test_every_leg_of_plain_knit_hooks(scene: str, overrides: tuple[str, ...], hooks: int) -> None:
    loaded = load_scene(SCENES / f"{scene}.toml", ["wires.loop_size=1.5 mm", *overrides])
    assert find_places(rest_wires(loaded), loaded.wires.loop_length).hooks == hooks


@pytest.mark.parametrize("repeats", [[1, 2], [2, 2]])
def test_contacts_of_a_file_belong_to_their_hooks(repeats: list[int]) -> None:
    """What touches in the middle of a lens is that hook's, whichever of its wires comes first; elsewhere, or with another image,
    is none's."""
    mesh = build_model(load_scene(SCENES / "plain_knit_spatial.toml", [f"wires.repeats={repeats}"]))
    wires, rods = mesh.wires, mesh.rods
    sites, place = Sites(wires, rods), np.rint(wires.site_seed).astype(np.int64)
    nodes = rods.wire_first[wires.site_wire] + np.clip(place, 0, rods.wire_count[wires.site_wire] - 1)
    assert sites.count == mesh.panel.body_count == 2 * np.prod(repeats)
    assert mesh.layout().body_wires.shape == (sites.count, 2)
    for first, second, side in ((nodes[:, 0], nodes[:, 1], 1.0), (nodes[:, 1], nodes[:, 0], -1.0)):
        site, sign = sites.of(first, second, side * sites.shift)
        assert site.tolist() == list(range(sites.count))
        assert (sign == side).all()
    wire = mesh.rods.wire_of[nodes[:, 1]]
    first, count = mesh.rods.wire_first[wire], mesh.rods.wire_count[wire]
    away = first + (nodes[:, 1] - first + count // (2 * repeats[0])) % count  # half a loop along the second wire
    assert (sites.of(nodes[:, 0], away, sites.shift)[0] == NOWHERE).all()
    assert (sites.of(nodes[:, 0], nodes[:, 1], sites.shift + [3.0 * rods.tile[0], 0.0, 0.0])[0] == NOWHERE).all()
