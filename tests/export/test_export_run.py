"""A run's directory is exported in every form, or refused in one line."""

import csv
import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from reference.histories import history
from warpknit.base.errors import ExportError, RunDirectoryError
from warpknit.export import export_run
from warpknit.export.tables import contact_table
from warpknit.results.frame import Frame, WireLayout, curve_position


@pytest.fixture
def run_dir(tmp_path: Path, layout: WireLayout, make_frame: Callable[..., Frame]) -> Path:
    directory = tmp_path / "zigzag"
    layout.save(directory / "layout.npz")
    for index in range(4):
        frame = make_frame(index, stage="load" if index < 3 else "cold air")
        frame.save(directory / "states" / f"state_{index:06d}.npz")
    rows = history(3, cold=1)
    with open(directory / "history.csv", "w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    summary = {
        "scene": {"name": "zigzag", "hash": "0123abcd"},
        "version": "1.0",
        "stop_reason": "steady",
        "wire": {"stress_max_Pa": 3e8, "yield_stress_Pa": 2e9},
        "stages": [{"name": "load", "wire": {"stress_max_Pa": 4e8}}],
    }
    (directory / "summary.json").write_text(json.dumps(summary))
    return directory


def names(run_dir: Path, paths: list[Path]) -> set[str]:
    assert all(path.is_file() for path in paths)
    return {path.relative_to(run_dir).as_posix() for path in paths}


def test_usd(run_dir: Path) -> None:
    from pxr import Usd

    assert {"scene.usda", "frames/wires.000003.usdc"} < names(run_dir, export_run(run_dir, "usd"))
    stage = Usd.Stage.Open(str(run_dir / "scene.usda"))
    data = stage.GetRootLayer().customLayerData["warpknit"]
    assert data["complete"] and data["colourStressMax"] == 2e9  # the elastic limit, as of a run, not the largest stress
    assert list(data["load"]["stage"]) == [*3 * ["load"], "cold air"]


def test_vtk(run_dir: Path) -> None:
    assert {"vtk/wires.pvd", "vtk/contacts.pvd", "vtk/wires_000000.vtu"} < names(run_dir, export_run(run_dir, "vtk"))


def test_png(run_dir: Path) -> None:
    assert names(run_dir, export_run(run_dir, "png")) == {
        "figures/curves.png",
        "figures/heat.png",
        "figures/mesh.png",
        "figures/mesh_00_load.png",
        "figures/mesh_01_cold_air.png",
    }


def test_csv(run_dir: Path, layout: WireLayout, make_frame: Callable[..., Frame]) -> None:
    assert len(names(run_dir, export_run(run_dir, "csv"))) == 8
    frame = make_frame(2)
    contacts, wires = (
        np.genfromtxt(run_dir / "tables" / f"{name}_000002.csv", delimiter=",", names=True) for name in ("contacts", "wires")
    )
    assert np.array_equal(contacts["force_a_N"], frame.pair_force[0::2])
    assert np.array_equal(contacts["active"], frame.body_active)
    assert np.flatnonzero(contacts["central_rhombus"]).tolist() == layout.rhombus_bodies.tolist()
    classes = np.arange(layout.body_count) % 2
    assert "".join(contact_table(replace(layout, body_class=classes), frame)["class"][:3]) == "ABA"
    points = curve_position(layout, frame)
    for wire in range(layout.wire_count):
        steps = np.diff(points[layout.curve_start[wire] : layout.curve_start[wire + 1]], axis=0)
        assert np.isclose(wires["length_m"][wire], np.linalg.norm(steps, axis=1).sum(), rtol=1e-12)
        stress = frame.node_stress[layout.wire_start[wire] : layout.wire_start[wire + 1]]
        assert wires["stress_max_Pa"][wire] == stress.max() and np.isclose(wires["stress_mean_Pa"][wire], stress.mean())
    assert wires["active_pairs"].sum() == frame.pair_active.sum() and wires["pairs"].sum() == 2 * layout.body_count


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda run_dir: (run_dir / "summary.json").unlink(), "--resume"),
        (lambda run_dir: [path.unlink() for path in (run_dir / "states").iterdir()], "no states"),
        (lambda run_dir: (run_dir / "summary.json").write_text("{"), "summary.json: "),
        (lambda run_dir: (run_dir / "summary.json").write_text("[1]"), "summary.json: "),
        (lambda run_dir: (run_dir / "layout.npz").write_bytes(b"PK"), "WireLayout"),
        (lambda run_dir: (run_dir / "states" / "state_000001.npz").write_bytes(b"spoiled"), "Frame"),
    ],
)
def test_unusable_directory_is_refused_in_one_line(run_dir: Path, spoil: Callable[[Path], object], message: str) -> None:
    spoil(run_dir)
    with pytest.raises(RunDirectoryError, match=message) as caught:
        export_run(run_dir, "usd")
    assert "\n" not in str(caught.value) and str(run_dir) in str(caught.value)


def test_missing_and_foreign_directories_are_refused(tmp_path: Path) -> None:
    with pytest.raises(RunDirectoryError, match="absent: "):
        export_run(tmp_path / "absent", "csv")
    with pytest.raises(RunDirectoryError, match="no layout.npz"):
        export_run(tmp_path, "csv")


def test_unknown_format_is_refused(run_dir: Path) -> None:
    with pytest.raises(ExportError, match="--to: 'stl' ") as caught:
        export_run(run_dir, "stl")
    assert not isinstance(caught.value, RunDirectoryError) and caught.value.exit_code == 2


def test_a_map_is_told_from_a_run(tmp_path: Path) -> None:
    (tmp_path / "map.json").write_text("{}")
    with pytest.raises(RunDirectoryError, match="map"):
        export_run(tmp_path, "csv")


@pytest.mark.parametrize("name", ["summary.json", "layout.npz"])
@pytest.mark.parametrize("missing", [True, False])
def test_a_damaged_file_is_named_before_anything_else(run_dir: Path, name: str, missing: bool) -> None:
    """Also without states, which a missing layout does not mean."""
    if missing and name == "layout.npz":
        (run_dir / name).unlink()
    else:
        (run_dir / name).write_text("torn")
    if name == "summary.json" and missing:
        shutil.rmtree(run_dir / "states")
    with pytest.raises(RunDirectoryError, match=name):
        export_run(run_dir, "csv")


def test_contacts_elsewhere_are_a_table_in_space(
    run_dir: Path, space_layout: WireLayout, make_space_frame: Callable[..., Frame]
) -> None:
    space_layout.save(run_dir / "layout.npz")
    frame = make_space_frame(3)
    frame.save(run_dir / "states" / "state_000003.npz")
    assert len(names(run_dir, export_run(run_dir, "csv"))) == 12
    table = np.genfromtxt(run_dir / "tables" / "elsewhere_000003.csv", delimiter=",", names=True)
    assert np.array_equal(np.stack([table["wire_a"], table["wire_b"]], axis=1), frame.elsewhere_wires)
    assert np.array_equal(np.stack([table["x_m"], table["y_m"], table["z_m"]], axis=1), frame.elsewhere_position)
    assert np.array_equal(table["force_N"], frame.elsewhere_force)
    assert (run_dir / "tables" / "elsewhere_000002.csv").read_text().split() == ["wire_a,wire_b,x_m,y_m,z_m,force_N"]
