"""Wires from arrays: the same scene as an .npz file of them gives, and one line for arrays that are no wires."""

from pathlib import Path

import numpy as np
import pytest

from warpknit import load_run, load_scene, run, wires_from_arrays
from warpknit.base.errors import InputError
from warpknit.wires.read import rest_wires

TURN = np.linspace(0.0, 2.0 * np.pi, 41)
RING = 1e-3 * np.stack([np.cos(TURN), np.sin(TURN), np.zeros(41)], axis=1)[:-1]  # [m]
LINE = 1e-3 * np.stack([np.linspace(-2.0, 2.0, 9), np.full(9, 0.3), np.full(9, 0.2)], axis=1)
WIRE = {"diameter": "0.1 mm"}


def test_arrays_give_the_wires_of_a_file(tmp_path: Path) -> None:
    """To the bit, and the same scene; the closed one goes on behind its last point."""
    np.savez(tmp_path / "file.npz", points=np.concatenate([RING, LINE]), counts=[40, 9], closed=[True, False])
    keys = {"node_spacing": "50 um"}
    of_file = load_scene({"wire": WIRE, "wires": {"file": tmp_path / "file.npz", "unit": "m", **keys}})
    of_arrays = load_scene({"wire": WIRE, "wires": wires_from_arrays([RING, LINE.tolist()], closed=[True, False], **keys)})
    assert of_arrays.hash == of_file.hash and of_arrays == of_file
    for found, wanted in zip(rest_wires(of_arrays).points, rest_wires(of_file).points, strict=True):
        assert np.array_equal(found, wanted)
    assert rest_wires(of_arrays).kinds == ("closed", "open")
    assert rest_wires(of_arrays).lengths[0] == pytest.approx(2e-3 * np.pi, rel=1e-3)  # chords of an arc: (h/r)^2/24


def test_one_array_may_hold_all_wires_and_closed_count_for_all() -> None:
    scene = load_scene({"wire": WIRE, "wires": wires_from_arrays(np.stack([RING, RING + 5e-3]), closed=True)})
    assert rest_wires(scene).kinds == ("closed", "closed")


def test_a_scene_of_arrays_is_changed_and_run(tmp_path: Path) -> None:
    """A run keeps the arrays, from which its scene is read again and resumed."""
    scene = load_scene(
        {"wire": WIRE, "wires": wires_from_arrays([LINE]), "output": {"frames": 1, "usd": False, "figures": False}}
    )
    scene = scene.changed({"load.strain_weft": 1e-4, "wires.node_spacing": "0.2 mm"})
    assert len(rest_wires(scene).points[0]) == 21  # 4 mm in 20 segments
    first = run(scene, tmp_path / "run", quiet=True)
    assert load_run(tmp_path / "run").scene == scene
    with np.load(tmp_path / "run" / "wires.npz") as kept:
        assert np.array_equal(kept["points"], LINE)
    again = run(first.scene, tmp_path / "run", quiet=True, resume=True)
    assert again.summary["solver"]["steps"] == first.summary["solver"]["steps"]


@pytest.mark.parametrize(
    ("points", "closed", "said"),
    [
        ([], False, "no wires"),
        ([LINE, LINE[:, :2]], False, "wire 2 has shape (9, 2)"),
        (LINE, False, "wire 1 has shape (3,)"),
        ([LINE[:0]], False, "wire 1 has shape (0, 3)"),
        ([np.where(LINE > 0.0, np.nan, LINE)], False, "point 1 at"),
        ([["a", "b", "c"]], False, "wire 1 is not an array of numbers"),
        ([LINE], [True, False], "closed [True, False] does not fit 1 wire"),
        ([LINE], "yes", "closed 'yes'"),
        ([np.zeros((2_000_001, 3))], False, "2,000,001 points"),
    ],
)
def test_what_is_no_wires_is_one_line(points: object, closed: object, said: str) -> None:
    with pytest.raises(InputError) as caught:
        wires_from_arrays(points, closed=closed)
    assert said in str(caught.value) and "\n" not in str(caught.value) and "; give " in str(caught.value)


def test_points_in_one_place_are_refused_where_the_scene_is_read() -> None:
    scene = load_scene({"wire": WIRE, "wires": wires_from_arrays([np.zeros((4, 3))])})
    with pytest.raises(InputError, match=r"wires\.file: 'wires\.npz' .*wire 1"):
        rest_wires(scene)
