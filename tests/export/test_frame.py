"""Frames and layouts come back as they were saved, and files are whole or absent."""

from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from warpknit.base.files import write_aside
from warpknit.results.frame import Frame, WireLayout, curve_position


def equal(first: object, second: object) -> bool:
    return all(np.array_equal(getattr(first, field.name), getattr(second, field.name)) for field in fields(first))  # type: ignore[arg-type]


def test_saved_records_come_back(tmp_path: Path, layout: WireLayout, make_frame: Callable[..., Frame]) -> None:
    frame = make_frame(3, stage="kalt, -190 °C")
    frame.save(tmp_path / "state.npz")
    layout.save(tmp_path / "layout.npz")
    assert equal(Frame.load(tmp_path / "state.npz"), frame) and equal(WireLayout.load(tmp_path / "layout.npz"), layout)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["layout.npz", "state.npz"]


def test_contacts_elsewhere_come_back_and_old_states_have_none(
    tmp_path: Path, layout: WireLayout, make_space_frame: Callable[..., Frame]
) -> None:
    frame = make_space_frame(3)
    frame.save(tmp_path / "state.npz")
    assert equal(Frame.load(tmp_path / "state.npz"), frame) and frame.elsewhere_wires.shape == (3, 2)
    with np.load(tmp_path / "state.npz") as archive:
        np.savez(tmp_path / "old.npz", **{name: archive[name] for name in archive if not name.startswith("elsewhere_")})
    assert equal(Frame.load(tmp_path / "old.npz"), make_space_frame(3, 0))
    with pytest.raises(ValueError, match=r"frame 3: elsewhere_wires .* 0 \.\. 6"):
        replace(frame, elsewhere_wires=frame.elsewhere_wires + 5).require_layout(layout)


def test_foreign_file_is_refused(tmp_path: Path, layout: WireLayout) -> None:
    layout.save(tmp_path / "layout.npz")
    (tmp_path / "text.npz").write_text("hello")
    for name in ("layout.npz", "text.npz"):
        with pytest.raises(ValueError, match="Frame"):
            Frame.load(tmp_path / name)


def test_frame_that_is_not_finite_is_not_saved(tmp_path: Path, make_frame: Callable[..., Frame]) -> None:
    force = np.array(make_frame(1).pair_force)
    force[5] = np.nan
    with pytest.raises(ValueError, match=r"frame 1: pair_force .*\(5,\)"):
        replace(make_frame(1), pair_force=force).save(tmp_path / "state.npz")
    assert list(tmp_path.iterdir()) == []


def test_file_is_whole_or_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / "note.txt"
    path.write_text("before")
    with pytest.raises(RuntimeError), write_aside(path) as file:  # noqa: PT012  (half a file is written)
        file.write("half")
        raise RuntimeError
    assert path.read_text() == "before" and list(tmp_path.iterdir()) == [path]
    with write_aside(path) as file:
        file.write("after\n")
        assert path.read_text() == "before"
    assert path.read_bytes() == b"after\n"


def test_curves_close_one_deformed_period_on(layout: WireLayout, make_frame: Callable[..., Frame]) -> None:
    frame = make_frame(2, shear=0.03)
    points = curve_position(layout, frame)
    last = layout.wire_count - 1
    assert np.allclose(points[-1], frame.node_position[layout.wire_start[last]] + [0.03 * 8e-3, 1.04 * 8e-3, 0.0], rtol=1e-14)
    keep = np.ones(len(points), dtype=bool)
    keep[layout.curve_closing] = False
    assert np.array_equal(points[keep], frame.node_position)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"wire_start": [0, 3, 3]}, "wire_start"),
        ({"wire_closed": [True]}, "wire_closed"),
        ({"body_wires": [[0, 7]]}, "body_wires"),
        ({"rhombus_bodies": [24]}, "rhombus_bodies"),
    ],
)
def test_layout_that_contradicts_itself_is_refused(layout: WireLayout, change: dict[str, list], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        replace(layout, **change)


def test_frame_of_another_layout_is_refused(layout: WireLayout, make_frame: Callable[..., Frame]) -> None:
    frame = make_frame(0)
    short = replace(frame, node_position=frame.node_position[1:], node_stress=frame.node_stress[1:])
    with pytest.raises(ValueError, match="285 .* 286"):
        short.require_layout(layout)
    with pytest.raises(ValueError, match="pair_force: shape"):
        replace(frame, pair_force=frame.pair_force[1:])
